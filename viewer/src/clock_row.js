// The row under the surfaces: play, the slider of frames, the moment, the speed.

import { h, numeral } from "./dom.js";

const SPEEDS = [0.1, 0.25, 0.5, 1, 2];

export class ClockRow {
  // `toggle()` starts or stops, `goTo(frame)` shows one frame.
  constructor(motion, toggle, goTo) {
    const { nFrames } = motion;
    this.motion = motion;
    this.playButton = h("button", { type: "button", class: "play", "aria-label": "Play", disabled: nFrames < 2, onclick: toggle });
    this.slider = h("input", {
      type: "range",
      class: "time",
      min: 0,
      max: Math.max(nFrames - 1, 0),
      step: 1,
      value: 0,
      disabled: nFrames < 2,
      "aria-label": "Frame",
      oninput: () => goTo(+this.slider.value),
    });
    this.moment = h("output", { class: "moment" });
    this.speed = h(
      "select",
      { "aria-label": "Speed", onchange: () => this.setSpeed(+this.speed.value) },
      SPEEDS.map((s) => h("option", { value: s, selected: s === 1 }, s === 1 ? "real time" : `${s} ×`)),
    );
    // A movement of milliseconds or of hours is shown in two seconds.
    const seconds = motion.times ? motion.span : motion.span / 20;
    this.rate = motion.times ? 1 : 20;
    if (seconds > 20 || seconds < 0.2) this.rate *= seconds / 2 || 1;
    this.factor = 1;
    if (this.rate !== 1) this.speed.options[SPEEDS.indexOf(1)].textContent = motion.times ? `${numeral(this.rate, 2)} × real` : "1 ×";
    this.element = h("div", { class: "clock" }, this.playButton, this.slider, this.moment, this.speed);
  }

  // Time of the motion that passes in a second.
  get pace() {
    return this.rate * this.factor;
  }

  setSpeed(speed) {
    this.factor = speed;
    this.speed.value = String(speed);
  }

  showPlaying(isPlaying) {
    this.playButton.setAttribute("aria-label", isPlaying ? "Pause" : "Play");
    this.playButton.classList.toggle("playing", isPlaying);
  }

  show(time, frame) {
    const { motion } = this;
    this.slider.value = frame;
    const moment = motion.times ? `${time.toFixed(motion.span < 10 ? 2 : 1)} s` : `frame ${frame}`;
    this.slider.setAttribute("aria-valuetext", `frame ${frame}, ${moment}`);
    this.moment.textContent = motion.times ? `${moment} · frame ${frame}` : moment;
  }
}
