// The view of one sequence, or of two side by side: stage, clock, modes, charts.

import { save } from "./api.js";
import { chartsOf } from "./chart_rows.js";
import { bar } from "./charts.js";
import { Cloud } from "./cloud.js";
import { readContainer } from "./container.js";
import { h, numeral, refill, svg } from "./dom.js";
import { Motion } from "./motion.js";
import { Stage } from "./stage.js";
import { trackCard } from "./tracking.js";

const COLOURS = [
  ["plain", "Plain"],
  ["error", "Distance to what was sent"],
  ["motion", "Displacement"],
];
const SPEEDS = [0.1, 0.25, 0.5, 1, 2];

export class Viewer {
  // `payloads`: one or two ArrayBuffers; `actions`: { frames(motion), data(motion), csv, page, classify }.
  constructor(root, payloads, actions = {}, isEmbedded = false) {
    this.motions = payloads.map((payload) => new Motion(readContainer(payload)));
    this.actions = actions;
    this.isEmbedded = isEmbedded;
    this.header = this.motions[0].header;
    this.state = this.readAddress();
    this.gains = this.motions.map((motion) => new Float32Array(motion.header.waves.length).fill(1));
    this.time = 0;
    this.isPlaying = false;
    this.clouds = this.motions.map(() => null);
    this.root = root;
    root.replaceChildren(this.build());
    this.applyAddress();
    this.loadFrames();
    this.loadData();
    this.onKey = (event) => this.key(event);
    document.addEventListener("keydown", this.onKey);
    this.onResize = () => this.wish();
    addEventListener("resize", this.onResize);
    this.observer = new ResizeObserver(this.onResize);
    this.observer.observe(this.canvas);
    const still = matchMedia("(prefers-reduced-motion: reduce)").matches;
    if (!still && this.nFrames > 1 && !this.state.frame && this.state.play !== "0") this.play(true);
    this.wish();
  }

  get nFrames() {
    return this.motions[0].nFrames;
  }

  get span() {
    return this.motions[0].span;
  }

  // Place in each motion: two sequences run through their own span together.
  place(number) {
    const motion = this.motions[number];
    if (number === 0) return motion.placeAt(this.time);
    return motion.placeAt((this.time / (this.span || 1)) * motion.span);
  }

  readAddress() {
    const query = this.isEmbedded ? new URLSearchParams() : new URLSearchParams(location.search);
    return Object.fromEntries(query.entries());
  }

  applyAddress() {
    const { frame, colour, gains, sent, data } = this.state;
    if (frame) this.seek(this.motions[0].timeAt(Math.min(Math.max(+frame || 0, 0), this.nFrames - 1)));
    if (COLOURS.some(([name]) => name === colour)) this.setColour(colour);
    else this.setColour(this.motions[0].faces.length ? "error" : "plain");
    if (sent === "0") this.showSent(false);
    if (data === "0") this.showData(false);
    if (gains)
      gains.split(",").forEach((gain, w) => {
        if (w < this.gains[0].length && Number.isFinite(+gain)) this.setGain(w, +gain);
      });
    if (this.state.speed) this.setSpeed(+this.state.speed || 1);
    this.isReady = true;
  }

  // The address says everything but the key, so that a view can be sent to a colleague.
  writeAddress() {
    if (this.isEmbedded || !this.isReady || !location.pathname.startsWith("/view/")) return;
    clearTimeout(this.writing);
    this.writing = setTimeout(() => {
      const query = new URLSearchParams(location.search);
      const own = Array.from(this.gains[0], (gain) => Math.round(gain * 100) / 100);
      const set = (name, value) => (value ? query.set(name, value) : query.delete(name));
      set("frame", this.isPlaying ? "" : String(Math.round(this.place(0))));
      set("colour", this.colour === "error" ? "" : this.colour);
      set("gains", own.every((gain) => gain === 1) ? "" : own.join(","));
      set("sent", this.isSentShown ? "" : "0");
      set("data", this.areDataShown ? "" : "0");
      history.replaceState(null, "", `${location.pathname}?${query}`.replace(/\?$/, ""));
    }, 300);
  }

  build() {
    const { header } = this;
    this.canvas = h("canvas", {
      tabindex: "0",
      role: "application",
      "aria-label": "The moving surface. Arrow keys turn it, plus and minus bring it nearer, Home resets the view.",
    });
    this.stage = new Stage(this.canvas, () => this.wish());
    this.surfaces = this.motions.map((motion) => this.stage.surfaces(motion));
    const windows = this.motions.flatMap((motion, i) => this.windowsOf(motion, i));
    this.stage.panels = windows.map(({ surface, element, kind, number }) => ({ surface, element, kind, number, isShown: true }));
    this.windows = h("div", { class: "windows" }, windows.map(({ element }) => element));
    this.cross = svg("svg", { class: "cross", viewBox: "-24 -24 48 48", "aria-hidden": "true" });
    this.busy = h("p", { class: "busy", role: "status" });
    this.colourBar = bar("0", "");
    const stageBox = h("div", { class: "stage" }, this.canvas, this.windows, this.cross, this.busy);
    const charts = chartsOf(this.motions, (number, t) => {
      this.play(false);
      this.seek(number ? (t / (this.motions[number].span || 1)) * this.span : t);
    });
    this.charts = charts.rows;
    const notes = [
      ...header.notes,
      ...(this.stage.isSoftware
        ? ["Software rendering: this browser has no graphics card to draw with. Everything works, large surfaces move slowly."]
        : []),
    ];
    return h(
      "div",
      { class: "viewer" },
      this.buildHead(),
      h(
        "div",
        { class: "work" },
        h("section", { class: "left", "aria-label": "Surface" }, stageBox, this.buildClock(), this.buildColours()),
        h("aside", { class: "right", "aria-label": "Modes" }, this.buildReadouts(), this.buildClass(), this.buildTrack(), this.buildModes()),
      ),
      charts.element,
      notes.length
        ? h("section", { class: "notes" }, h("h2", {}, "What to know"), h("ul", {}, notes.map((note) => h("li", {}, note))))
        : null,
      h("p", { class: "foot" }, header.intended_use),
    );
  }

  windowsOf(motion, number) {
    const { header } = motion;
    const name = this.motions.length > 1 ? `${header.title || header.sequence_id.slice(0, 8)}: ` : "";
    const make = (kind, title, sub) => ({
      surface: this.surfaces[number][kind],
      kind,
      number,
      element: h("div", { class: "window" }, h("div", { class: "caption" }, h("strong", {}, name + title), h("span", {}, sub))),
    });
    const count = header.n_amplitudes;
    return [
      make("sent", "As sent", `${header.n_vertices.toLocaleString("en")} vertices a frame`),
      make("superposed", `From ${count} amplitude${count === 1 ? "" : "s"}`, `${numeral(header.error.rms)} ${header.unit} RMS error, ${header.compression.toFixed(0)} : 1`),
    ];
  }

  buildHead() {
    const { header, actions } = this;
    const title = header.title || `Sequence ${header.sequence_id.slice(0, 12)}`;
    const facts = [
      header.surface === "mesh" ? "mesh with modes of its own" : header.surface,
      `${header.n_frames} frame${header.n_frames === 1 ? "" : "s"}`,
      this.motions[0].times ? `${numeral(this.span)} s` : "times unknown",
      header.unit === "length units" ? "length unit unknown" : `lengths in ${header.unit}`,
      { closes: "a cycle", repeats: "a cycle, first frame repeated", open: "does not return to its start" }[header.cycle],
    ];
    const button = (text, work, what) =>
      work
        ? h("button", {
            type: "button",
            onclick: async (event) => {
              const own = event.currentTarget;
              own.disabled = true;
              try {
                await work();
              } catch (error) {
                this.say(error.message);
              }
              own.disabled = false;
            },
            title: what,
          }, text)
        : null;
    return h(
      "header",
      { class: "head" },
      h("div", {}, this.isEmbedded ? null : h("a", { class: "brand", href: "/", hidden: !actions.isServed }, "modalmotion"), h("h1", {}, title), h("p", { class: "facts" }, facts.join(" · "))),
      h(
        "div",
        { class: "actions" },
        button("Save picture", () => this.savePicture(), "What you see, as PNG"),
        button("Table (CSV)", actions.csv || (() => this.saveTable()), "Amplitudes of each frame"),
        button("Save as one file", actions.page, "A page that opens from disk, without a network"),
      ),
    );
  }

  buildClock() {
    const { nFrames } = this;
    this.playButton = h("button", { type: "button", class: "play", "aria-label": "Play", disabled: nFrames < 2, onclick: () => this.play(!this.isPlaying) });
    this.clock = h("input", {
      type: "range",
      class: "time",
      min: 0,
      max: Math.max(nFrames - 1, 0),
      step: 1,
      value: 0,
      disabled: nFrames < 2,
      "aria-label": "Frame",
      oninput: () => {
        this.play(false);
        this.seek(this.motions[0].timeAt(+this.clock.value));
      },
    });
    this.moment = h("output", { class: "moment" });
    this.speed = h(
      "select",
      { "aria-label": "Speed", onchange: () => this.setSpeed(+this.speed.value) },
      SPEEDS.map((s) => h("option", { value: s, selected: s === 1 }, s === 1 ? "real time" : `${s} ×`)),
    );
    // A movement of milliseconds or of hours is shown in two seconds.
    const seconds = this.motions[0].times ? this.span : this.span / 20;
    this.rate = this.motions[0].times ? 1 : 20;
    if (seconds > 20 || seconds < 0.2) this.rate *= seconds / 2 || 1;
    this.factor = 1;
    if (this.rate !== 1) this.speed.options[SPEEDS.indexOf(1)].textContent = this.motions[0].times ? `${numeral(this.rate, 2)} × real` : "1 ×";
    return h("div", { class: "clock" }, this.playButton, this.clock, this.moment, this.speed);
  }

  buildColours() {
    const choice = (name, text) =>
      h("label", {}, h("input", { type: "radio", name: "colour", value: name, onchange: () => this.setColour(name) }), h("span", {}, text));
    this.colourChoices = h("fieldset", { class: "choices" }, h("legend", {}, "Colour"), COLOURS.map(([name, text]) => choice(name, text)));
    this.isSentShown = true;
    this.sentBox = h("input", { type: "checkbox", checked: true, onchange: () => this.showSent(this.sentBox.checked) });
    this.areDataShown = true;
    this.dataBox = h("input", { type: "checkbox", checked: true, onchange: () => this.showData(this.dataBox.checked) });
    this.dataLegend = h("span", {});
    this.dataChoice = h("label", { class: "sent data", hidden: true }, this.dataBox, this.dataLegend);
    return h("div", { class: "colours" }, this.colourChoices, h("label", { class: "sent" }, this.sentBox, h("span", {}, "Show as sent")), this.colourBar, this.dataChoice);
  }

  buildReadouts() {
    const rows = this.motions.map(({ header }) => {
      const { volume } = header;
      if (volume.refused)
        return h("div", { class: "card" }, h("h2", {}, "Volume"), h("p", { class: "note" }, volume.refused));
      const { share } = volume;
      const name = share ? share.name[0].toUpperCase() + share.name.slice(1) : "Volume";
      return h(
        "div",
        { class: "card readouts" },
        h("h2", {}, this.motions.length > 1 ? `${name}: ${header.title || header.sequence_id.slice(0, 8)}` : name),
        share
          ? h("p", { class: "big" }, `${share.value.toFixed(1)} %`, h("span", {}, ` ${share.low.toFixed(1)} to ${share.high.toFixed(1)} %`))
          : null,
        h(
          "dl",
          {},
          [["largest", volume.largest], ["smallest", volume.smallest], ["difference", volume.stroke]].map(([what, value]) =>
            h("div", {}, h("dt", {}, what), h("dd", {}, `${numeral(value)} ${volume.unit}`)),
          ),
        ),
        volume.notes.map((note) => h("p", { class: "note" }, note)),
      );
    });
    return h("div", {}, rows);
  }

  buildTrack() {
    const { header, actions } = this;
    return header.is_tracked && actions.track ? trackCard(actions.track, header.unit, (text) => this.say(text)) : null;
  }

  buildClass() {
    this.classBox = h("div", { class: "card class" });
    this.showClass(this.header.classification);
    return this.classBox;
  }

  showClass(answer) {
    const { actions } = this;
    const box = this.classBox;
    box.hidden = !answer && !actions.classify;
    if (!answer) {
      refill(box, 
        h("h2", {}, "Class of the motion"),
        h("button", {
          type: "button",
          onclick: async (event) => {
            event.currentTarget.disabled = true;
            try {
              this.showClass(await actions.classify());
            } catch (error) {
              refill(box, h("h2", {}, "Class of the motion"), h("p", { class: "note" }, error.message));
            }
          },
        }, "Classify"),
      );
      return;
    }
    const set = answer.class_set.length
      ? `Not ruled out at ${Math.round(100 * answer.coverage)} %: ${answer.class_set.join(", ")}.`
      : "Unlike every class that the model knows.";
    refill(box, 
      h("h2", {}, "Class of the motion"),
      h("p", { class: "big" }, answer.label === null ? "no class" : answer.label, answer.label === null ? null : h("span", {}, ` probability ${answer.probability.toFixed(3)}`)),
      answer.label === null ? null : h("p", { class: "note" }, set),
      answer.explanation.length
        ? h("div", { class: "reasons" },
            h("p", { class: "note" }, "What moved the answer. A button shows these modes alone:"),
            answer.explanation.slice(0, 6).map((part) => this.reason(part)))
        : null,
      answer.notes.slice(0, 3).map((note) => h("p", { class: "note" }, note)),
    );
  }

  reason(part) {
    const waves = this.header.waves
      .map((wave, w) => [wave, w])
      .filter(([wave]) => part.modes.some((name) => this.labelsOf(wave).includes(name)))
      .map(([, w]) => w);
    const name = waves.length ? this.header.waves[waves[0]].name : "not among these modes";
    const label = waves.map((w) => this.header.waves[w].label).join(" ") || part.modes.join(" ");
    return h("button", {
      type: "button",
      disabled: !waves.length,
      title: waves.length ? "Show these modes alone" : "Not among the modes of this view: ask for more modes.",
      onclick: () => this.showOnly(waves),
    }, h("span", { class: `sign ${part.score >= 0 ? "for" : "against"}` }, part.score >= 0 ? "for" : "against"), ` ${name} `, h("code", {}, label));
  }

  // Labels of a wave's modes, as answers of a model write them.
  labelsOf(wave) {
    if (!wave.label.startsWith("(") || wave.modes.length === 1) return [wave.label];
    const inner = wave.label.slice(1, -1);
    return [`(${inner}, cos)`, `(${inner}, sin)`];
  }

  buildModes() {
    const { waves, unit } = this.header;
    const most = Math.max(...waves.map((wave) => wave.rms), 1e-300);
    this.sliders = [];
    const rows = waves.map((wave, w) => {
      const number = h("output", { class: "gain" }, "100 %");
      const slider = h("input", {
        type: "range", min: 0, max: 300, step: 5, value: 100,
        "aria-label": `Share of ${wave.name}, ${wave.label}`,
        oninput: () => this.setGain(w, slider.value / 100),
        onfocus: () => this.highlight(w),
      });
      this.sliders.push([slider, number]);
      const level = h("span", { class: "level", style: { width: `${Math.max((100 * wave.rms) / most, 0.5)}%` } });
      return h(
        "li",
        { onpointerenter: () => this.highlight(w) },
        h("div", { class: "mode-name" }, h("span", {}, wave.name), h("code", {}, wave.label)),
        h("div", { class: "spectrum" }, h("span", { class: "track", "aria-hidden": "true" }, level), h("span", {}, `${numeral(wave.rms)} ${unit}`)),
        h("div", { class: "mode-row" }, slider, number,
          h("button", { type: "button", class: "only", "aria-label": `Only ${wave.name}, ${wave.label}`, onclick: () => this.showOnly([w]) }, "only")),
      );
    });
    return h(
      "div",
      { class: "card modes" },
      h("div", { class: "modes-head" }, h("h2", {}, "Modes"),
        h("button", { type: "button", onclick: () => this.gains[0].forEach((_, w) => this.setGain(w, 1)) }, "All as measured"),
        h("button", { type: "button", onclick: () => this.gains[0].forEach((_, w) => this.setGain(w, 0)) }, "None")),
      h("p", { class: "note" }, "Bars: RMS amplitude over the frames. Sliders: how much of it is shown."),
      h("ol", { tabindex: "0", "aria-label": "Modes, by rank" }, rows),
    );
  }

  async loadFrames() {
    for (const motion of this.motions) {
      if (!this.actions.frames) continue;
      try {
        await this.actions.frames(motion, (piece) => {
          motion.sent.add(readContainer(piece));
          this.wish();
        });
      } catch (error) {
        this.say(`The frames as sent did not come: ${error.message}`);
      }
    }
    this.wish();
  }

  // Points that the surfaces were tracked through, where somebody kept them.
  async loadData() {
    if (!this.actions.data) return;
    for (const [number, motion] of this.motions.entries()) {
      try {
        const buffer = await this.actions.data(motion);
        if (!buffer) continue;
        const cloud = new Cloud(buffer, motion);
        Object.values(this.surfaces[number]).forEach((surface) => surface.scene && cloud.join(surface));
        this.clouds[number] = cloud;
      } catch (error) {
        this.say(`The data that were tracked did not come: ${error.message}`);
      }
    }
    const there = this.clouds.filter(Boolean);
    const parts = [
      h("span", {}, "Show the data: "), h("span", { class: "dot counted" }), "counted",
      ...(there.some((cloud) => cloud.hasStrays) ? [h("span", { class: "dot stray" }), "left out"] : []),
      ...(there.some((cloud) => cloud.hasLandmarks) ? [h("span", { class: "dot place" }), "landmark"] : []),
    ];
    refill(this.dataLegend, parts);
    this.dataChoice.hidden = !there.length;
    this.wish();
  }

  showData(areShown) {
    this.areDataShown = areShown;
    this.dataBox.checked = areShown;
    this.wish();
    this.writeAddress();
  }

  say(text) {
    this.busy.textContent = text;
  }

  setColour(name) {
    this.colour = name;
    for (const input of this.colourChoices.querySelectorAll("input")) input.checked = input.value === name;
    this.wish();
    this.writeAddress();
  }

  showSent(isShown) {
    this.isSentShown = isShown;
    this.sentBox.checked = isShown;
    for (const panel of this.stage.panels)
      if (panel.kind === "sent") {
        panel.isShown = isShown;
        panel.element.hidden = !isShown;
      }
    this.windows.classList.toggle("single", !isShown && this.motions.length === 1);
    this.wish();
    this.writeAddress();
  }

  setSpeed(speed) {
    this.factor = speed;
    this.speed.value = String(speed);
  }

  setGain(w, gain) {
    this.gains.forEach((own, number) => {
      const label = this.header.waves[w].label;
      const there = number === 0 ? w : this.motions[number].header.waves.findIndex((wave) => wave.label === label);
      if (there >= 0) own[there] = gain;
    });
    const [slider, number] = this.sliders[w];
    slider.value = 100 * gain;
    number.textContent = `${Math.round(100 * gain)} %`;
    number.classList.toggle("changed", gain !== 1);
    this.wish();
    this.writeAddress();
  }

  showOnly(waves) {
    this.gains[0].forEach((_, w) => this.setGain(w, waves.includes(w) ? 1 : 0));
    if (waves.length) this.highlight(waves[0]);
  }

  highlight(w) {
    for (const { motion, trajectories } of this.charts) {
      const label = this.header.waves[w].label;
      trajectories.highlight(motion.header.waves.findIndex((wave) => wave.label === label));
    }
  }

  play(isPlaying) {
    if (isPlaying && this.header.cycle === "open" && this.time >= this.motions[0].timeAt(this.nFrames - 1)) this.time = 0;
    this.isPlaying = isPlaying && this.nFrames > 1;
    this.playButton.setAttribute("aria-label", this.isPlaying ? "Pause" : "Play");
    this.playButton.classList.toggle("playing", this.isPlaying);
    this.before = null;
    if (!isPlaying && this.isReady) {
      // Still pictures are of frames that were measured.
      const frame = Math.round(this.place(0));
      this.time = this.motions[0].timeAt(Math.min(frame, this.nFrames - 1));
      this.writeAddress();
    }
    this.wish();
  }

  seek(time) {
    this.time = Math.min(Math.max(time, 0), this.span);
    this.wish();
    if (!this.isPlaying) this.writeAddress();
  }

  step(by) {
    this.play(false);
    const frame = Math.round(this.place(0)) + by;
    const n = this.nFrames;
    this.seek(this.motions[0].timeAt(this.header.cycle === "open" ? Math.min(Math.max(frame, 0), n - 1) : (frame + n) % n));
  }

  key(event) {
    const at = event.target;
    if (event.ctrlKey || event.metaKey || event.altKey) return;
    if (at.closest && at.closest("input, select, textarea, button, a, dialog")) return;
    if (this.isEmbedded && !this.root.contains(at)) return;
    const works = { " ": () => this.play(!this.isPlaying), ",": () => this.step(-1), ".": () => this.step(1) };
    if (!works[event.key]) return;
    event.preventDefault();
    works[event.key]();
  }

  // Ask for a picture at the next chance.
  wish() {
    if (this.wished) return;
    this.wished = requestAnimationFrame((now) => {
      this.wished = 0;
      this.frame(now);
    });
  }

  frame(now) {
    if (this.isPlaying) {
      const passed = this.before === null ? 0 : Math.min((now - this.before) / 1000, 0.25);
      this.before = now;
      this.time += passed * this.rate * this.factor;
      if (this.time >= this.span) {
        if (this.header.cycle === "open") {
          this.time = this.span;
          this.play(false);
        } else this.time %= this.span || 1;
      }
      this.wish();
    }
    this.show();
  }

  // Largest value of the colour bar: the stated error, or the motion where modes are changed.
  scaleOf() {
    const isWhole = this.gains[0].every((gain) => gain === 1);
    const errors = this.motions.map(({ header }) => header.error.max);
    const moved = this.motions.map(({ arrays }) => 2 * Math.max(...arrays.motion_rms.values));
    if (this.colour === "motion") return [Math.max(...moved), "displacement"];
    if (!isWhole) return [Math.max(...moved), "what is shown, against what was sent"];
    return [Math.max(...errors), "distance to what was sent"];
  }

  show() {
    const started = performance.now();
    const [largest, title] = this.scaleOf();
    const coloured = { plain: 0, error: 1, motion: 2 }[this.colour];
    for (const panel of this.stage.panels) {
      if (!panel.isShown) continue;
      // Beside its reconstruction a surface as sent is plain, unless it stands for the motion.
      const own = panel.kind === "sent" ? (coloured === 1 ? 0 : coloured) : coloured;
      const isThere = panel.surface.update(this.place(panel.number), this.gains[panel.number], own, largest);
      panel.surface.object.visible = isThere;
      panel.element.classList.toggle("waiting", !isThere);
    }
    this.clouds.forEach((cloud, number) => cloud && cloud.show(this.place(number), this.areDataShown, this.stage.ratio));
    this.stage.render();
    this.milliseconds = performance.now() - started;
    this.colourBar.hidden = this.colour === "plain";
    const [low, of, high] = this.colourBar.texts;
    low.textContent = "0";
    of.textContent = title;
    high.textContent = `${numeral(largest)} ${this.header.unit}`;
    const place = this.place(0);
    const frame = Math.min(Math.round(place), this.nFrames - 1);
    this.clock.value = frame;
    const moment = this.motions[0].times ? `${this.time.toFixed(this.span < 10 ? 2 : 1)} s` : `frame ${frame}`;
    this.clock.setAttribute("aria-valuetext", `frame ${frame}, ${moment}`);
    this.moment.textContent = this.motions[0].times ? `${moment} · frame ${frame}` : moment;
    this.charts.forEach(({ motion, charts, eye }, number) => {
      const t = number ? (this.time / (this.span || 1)) * motion.span : this.time;
      charts.forEach((chart) => chart.show(t));
      if (eye) eye.show(motion.around(this.place(number)));
    });
    const axes = this.stage.axes(this.header.view);
    this.cross.replaceChildren(
      ...axes.flatMap(([x, y], k) => [
        svg("line", { x1: 0, y1: 0, x2: 15 * x, y2: 15 * y }),
        svg("text", { x: 20 * x, y: 20 * y + 3, "text-anchor": "middle" }, "xyz"[k]),
      ]),
    );
  }

  savePicture() {
    this.show();
    this.canvas.toBlob((blob) => save(blob, `${this.header.sequence_id.slice(0, 12)}.png`));
  }

  // Amplitudes as they stand in the page: in single precision.
  saveTable() {
    const { motions: [motion], header } = this;
    const nd = motion.nDirections;
    const rows = [["frame", "time_s", "wave", "mode", "direction", "amplitude"].join(",")];
    for (let f = 0; f < motion.nFrames; f++)
      header.waves.forEach(({ modes, label }) =>
        modes.forEach((mode, part) => {
          for (let d = 0; d < nd; d++)
            rows.push([f, motion.times ? motion.times[f] : "", `"${label}"`, part, d, motion.amplitudes[(f * motion.nModes + mode) * nd + d]].join(","));
        }),
      );
    save(new Blob([rows.join("\n") + "\n"], { type: "text/csv" }), `${header.sequence_id.slice(0, 12)}-amplitudes.csv`);
  }

  // What a test reads: positions and colours as drawn, at a frame and with gains.
  read(number, kind, place, gains, coloured) {
    const surface = this.surfaces[number][kind];
    return surface.read(this.stage.renderer, place, Float32Array.from(gains), coloured, 1);
  }

  dispose() {
    cancelAnimationFrame(this.wished);
    document.removeEventListener("keydown", this.onKey);
    removeEventListener("resize", this.onResize);
    this.observer.disconnect();
    this.clouds.forEach((cloud) => cloud && cloud.dispose());
    this.stage.dispose();
  }
}
