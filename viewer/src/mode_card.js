// The modes of a motion: a moving picture of each, how large it is, and how much of it is shown.

import { h, numeral, signed } from "./dom.js";

// What a unit of a wave's amplitudes adds to each read-out, in the direction where it adds most.
function effectsOf({ names, units, directions, step }, [values, ways], isPair) {
  const rows = names.map((name, k) => values[k] !== 0 && h("tr", {},
    h("th", { scope: "row" }, name === "ejection fraction" ? "EF" : name),
    h("td", {}, `${signed(values[k])} ${units[k]}`),
    h("td", { class: "soft way" }, isPair ? directions[ways[k]] : directions[ways[k]].split(",")[0])));
  return rows.some(Boolean) && h("details", {}, h("summary", {}, `${step} adds`), h("table", { class: "figures" }, h("tbody", {}, rows)));
}

// An element, `show(w, gain)`, which sets the slider of a wave, and the canvases of its pictures.
export function modeCard({ waves, unit, effects }, { setGain, showOnly, highlight }) {
  const most = Math.max(...waves.map((wave) => wave.rms), 1e-300);
  const sliders = [];
  const pictures = waves.map(() => h("canvas", { class: "mode-picture", width: 72, height: 72, "aria-hidden": "true" }));
  const rows = waves.map((wave, w) => {
    const number = h("output", { class: "gain" }, "100 %");
    const slider = h("input", {
      type: "range", min: 0, max: 300, step: 5, value: 100,
      "aria-label": `Share of ${wave.name}, ${wave.label}`,
      oninput: () => setGain(w, slider.value / 100),
      onfocus: () => highlight(w),
    });
    sliders.push([slider, number]);
    const level = h("span", { class: `level tone tone${wave.tone}`, style: { width: `${Math.max((100 * wave.rms) / most, 0.5)}%` } });
    return h(
      "li",
      { onpointerenter: () => highlight(w) },
      pictures[w],
      h("div", { class: "mode-words" },
        h("div", { class: "mode-name" }, h("span", {}, wave.name), " ", h("code", {}, wave.label)),
        h("div", { class: "spectrum" }, h("span", { class: "track", "aria-hidden": "true" }, level), h("span", {}, `${numeral(wave.rms)} ${unit}`)),
        h("div", { class: "mode-row" }, slider, number,
          h("button", { type: "button", class: "only", "aria-label": `Only ${wave.name}, ${wave.label}`, onclick: () => showOnly([w]) }, "only")),
        effects && effectsOf(effects, effects.waves[w], wave.modes.length > 1)),
    );
  });
  const element = h(
    "section",
    { class: "modes", "aria-label": "Modes" },
    h("div", { class: "modes-head" }, h("h2", {}, "Modes"),
      h("p", { class: "note" }, "Bars: RMS amplitude over the frames. Sliders: how much of each is shown above. Pictures are enlarged.",
        effects ? ` “${effects.step} adds”: change of each read-out by so much of a mode at its frame (SDI: in every frame by its share of the contraction), in the direction where it changes most.` : ""),
      h("button", { type: "button", onclick: () => waves.forEach((_, w) => setGain(w, 1)) }, "All as measured"),
      h("button", { type: "button", onclick: () => waves.forEach((_, w) => setGain(w, 0)) }, "None")),
    h("ol", {}, rows),
  );
  const show = (w, gain) => {
    const [slider, number] = sliders[w];
    slider.value = 100 * gain;
    number.textContent = `${Math.round(100 * gain)} %`;
    number.classList.toggle("changed", gain !== 1);
  };
  return { element, show, pictures };
}
