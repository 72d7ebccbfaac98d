// The modes of a motion: how large each is, and how much of it is shown.

import { h, numeral } from "./dom.js";

// An element, and `show(w, gain)`, which sets the slider of a wave.
export function modeCard({ waves, unit }, { setGain, showOnly, highlight }) {
  const most = Math.max(...waves.map((wave) => wave.rms), 1e-300);
  const sliders = [];
  const rows = waves.map((wave, w) => {
    const number = h("output", { class: "gain" }, "100 %");
    const slider = h("input", {
      type: "range", min: 0, max: 300, step: 5, value: 100,
      "aria-label": `Share of ${wave.name}, ${wave.label}`,
      oninput: () => setGain(w, slider.value / 100),
      onfocus: () => highlight(w),
    });
    sliders.push([slider, number]);
    const level = h("span", { class: "level", style: { width: `${Math.max((100 * wave.rms) / most, 0.5)}%` } });
    return h(
      "li",
      { onpointerenter: () => highlight(w) },
      h("div", { class: "mode-name" }, h("span", {}, wave.name), h("code", {}, wave.label)),
      h("div", { class: "spectrum" }, h("span", { class: "track", "aria-hidden": "true" }, level), h("span", {}, `${numeral(wave.rms)} ${unit}`)),
      h("div", { class: "mode-row" }, slider, number,
        h("button", { type: "button", class: "only", "aria-label": `Only ${wave.name}, ${wave.label}`, onclick: () => showOnly([w]) }, "only")),
    );
  });
  const element = h(
    "div",
    { class: "card modes" },
    h("div", { class: "modes-head" }, h("h2", {}, "Modes"),
      h("button", { type: "button", onclick: () => waves.forEach((_, w) => setGain(w, 1)) }, "All as measured"),
      h("button", { type: "button", onclick: () => waves.forEach((_, w) => setGain(w, 0)) }, "None")),
    h("p", { class: "note" }, "Bars: RMS amplitude over the frames. Sliders: how much of it is shown."),
    h("ol", { tabindex: "0", "aria-label": "Modes, by rank" }, rows),
  );
  const show = (w, gain) => {
    const [slider, number] = sliders[w];
    slider.value = 100 * gain;
    number.textContent = `${Math.round(100 * gain)} %`;
    number.classList.toggle("changed", gain !== 1);
  };
  return { element, show };
}
