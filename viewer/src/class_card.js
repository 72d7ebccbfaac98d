// The class of a motion: the answer of a model, and what moved it.

import { h, refill } from "./dom.js";

// `classification`: answer of a model, or null; `classify()`, where it is there, asks for one;
// `showOnly(waves)` shows some modes alone.
export function classCard({ waves, classification }, classify, showOnly) {
  const box = h("div", { class: "card class" });
  const reason = (part) => {
    const shown = waves
      .map((wave, w) => [wave, w])
      .filter(([wave]) => part.modes.some((name) => labelsOf(wave).includes(name)))
      .map(([, w]) => w);
    const name = shown.length ? waves[shown[0]].name : "not among these modes";
    const label = shown.map((w) => waves[w].label).join(" ") || part.modes.join(" ");
    return h("button", {
      type: "button",
      disabled: !shown.length,
      title: shown.length ? "Show these modes alone" : "Not among the modes of this view: ask for more modes.",
      onclick: () => showOnly(shown),
    }, h("span", { class: `sign ${part.score >= 0 ? "for" : "against"}` }, part.score >= 0 ? "for" : "against"), ` ${name} `, h("code", {}, label));
  };
  const show = (answer) => {
    box.hidden = !answer && !classify;
    if (!answer) {
      refill(
        box,
        h("h2", {}, "Class of the motion"),
        h("button", {
          type: "button",
          onclick: async (event) => {
            event.currentTarget.disabled = true;
            try {
              show(await classify());
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
    refill(
      box,
      h("h2", {}, "Class of the motion"),
      h("p", { class: "big" }, answer.label === null ? "no class" : answer.label, answer.label === null ? null : h("span", {}, ` probability ${answer.probability.toFixed(3)}`)),
      answer.label === null ? null : h("p", { class: "note" }, set),
      answer.explanation.length
        ? h("div", { class: "reasons" },
            h("p", { class: "note" }, "What moved the answer. A button shows these modes alone:"),
            answer.explanation.slice(0, 6).map(reason))
        : null,
      answer.notes.slice(0, 3).map((note) => h("p", { class: "note" }, note)),
    );
  };
  show(classification);
  return box;
}

// Labels of a wave's modes, as answers of a model write them.
function labelsOf(wave) {
  if (!wave.label.startsWith("(") || wave.modes.length === 1) return [wave.label];
  const inner = wave.label.slice(1, -1);
  return [`(${inner}, cos)`, `(${inner}, sin)`];
}
