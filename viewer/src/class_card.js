// The class of a motion in a sentence: the answer of a model, and what moved it.

import { h, probability, refill, signed } from "./dom.js";
import { noteOf } from "./notes.js";

const capital = (text) => text[0].toUpperCase() + text.slice(1);

// The answer in a sentence, with what is not ruled out; of no class the reason.
export function classSentence(answer) {
  const level = `${Math.round(100 * answer.coverage)} %`;
  if (answer.label === null) {
    const why = answer.flags && answer.flags.length ? answer.flags.map((flag) => flag.replaceAll("_", " ")).join("; ") : answer.class_set.length ? "more than one is likely" : "it is unlike every class that the model knows";
    return ["No class", `: ${why}.${answer.class_set.length ? ` Not ruled out at ${level}: ${answer.class_set.join(", ")}.` : ""}`];
  }
  const others = answer.class_set.filter((name) => name !== answer.label);
  const rest = others.length ? `not ruled out at ${level}: ${others.join(", ")}` : `no other class remains at ${level}`;
  return [capital(answer.label), ` with probability\u00a0${probability(answer.probability)}; ${rest}.`];
}

// `classification`: answer of a model, or null; `classify()`, where it is there, asks for one;
// `showOnly(waves)` shows some modes alone.
export function classCard({ waves, classification }, classify, showOnly, lead) {
  const box = h("div", { class: "card class" });
  const reason = (part) => {
    const shown = waves
      .map((wave, w) => [wave, w])
      .filter(([wave]) => part.modes.some((name) => labelsOf(wave).includes(name)))
      .map(([, w]) => w);
    if (!shown.length) return null;
    const label = shown.map((w) => waves[w].label).join(" ");
    return h("button", { type: "button", title: "Show these modes alone", onclick: () => showOnly(shown) },
      h("span", { class: `sign ${part.score >= 0 ? "for" : "against"}` }, part.score >= 0 ? "for" : "against"), ` ${waves[shown[0]].name} `, h("code", {}, label),
      part.per_unit ? ` ${signed(part.per_unit)} per ${part.unit || "length unit"}` : "");
  };
  const show = (answer) => {
    box.hidden = !answer && !classify;
    if (!answer) {
      refill(
        box,
        h("h2", {}, "Class (model)"),
        h("button", {
          type: "button",
          onclick: async (event) => {
            event.currentTarget.disabled = true;
            try {
              show(await classify());
            } catch (error) {
              refill(box, h("h2", {}, "Class (model)"), h("p", { class: "note" }, error.message));
            }
          },
        }, "Classify"),
      );
      return;
    }
    const [label, rest] = classSentence(answer);
    const reasons = answer.explanation.slice(0, 6).map(reason).filter(Boolean);
    refill(
      box,
      h("h2", {}, "Class (model)"),
      h("p", { class: "sentence" }, h("strong", {}, label), rest),
      answer.notes.slice(0, 3).map((note) => h("p", { class: "note" }, noteOf(note.text, lead))),
      reasons.length
        ? h("details", {}, h("summary", {}, "What moved the answer"), h("div", { class: "reasons" }, reasons),
          h("p", { class: "note" }, "Per length unit: change of the class score, the logarithm of the odds of this class against the next, by so much more motion of these modes."))
        : null,
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
