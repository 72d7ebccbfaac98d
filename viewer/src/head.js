// The head of a view: what is seen, and what can be taken away.

import { BASE } from "./api.js";
import { h, numeral } from "./dom.js";

// A button that is not pressed twice, and tells what went wrong.
export const worker = (text, work, what, say, properties = {}) =>
  h("button", {
    type: "button",
    ...properties,
    onclick: async (event) => {
      const own = event.currentTarget;
      own.disabled = true;
      try {
        await work();
      } catch (error) {
        say(error.message);
      }
      own.disabled = false;
    },
    title: what,
  }, text);

// `actions`: { isServed, picture, csv, page, report, fhir, dicom, remove }; `say(text)` tells what went
// wrong; `compare` is the picker, where there is one.
export function headOf(motion, actions, isEmbedded, say, compare) {
  const { header } = motion;
  const title = header.title || `Recording ${header.sequence_id.slice(0, 12)}`;
  const facts = [
    header.surface === "mesh" ? "mesh with modes of its own" : header.surface,
    `${header.n_frames} frame${header.n_frames === 1 ? "" : "s"}`,
    motion.times ? `${numeral(motion.span)} s` : "(times unknown)",
    header.unit === "length units" ? "(unit unknown)" : `lengths in ${header.unit}`,
    { closes: "a cycle", repeats: "a cycle, first frame repeated", open: "does not return to its start" }[header.cycle],
  ];
  const button = (text, work, what, properties) => (work ? worker(text, work, what, say, properties) : null);
  return h(
    "header",
    { class: "head" },
    h("div", {},
      isEmbedded || !actions.isServed ? null : h("a", { class: "brand", href: `${BASE}/` }, "modalmotion"),
      h("h1", {}, title),
      h("p", { class: "facts" }, facts.join(" · "), actions.isServed && header.title ? h("span", { class: "id", title: header.sequence_id }, ` · ${header.sequence_id.slice(0, 8)}`) : null)),
    h(
      "div",
      { class: "actions", role: "group", "aria-label": "Take away" },
      compare || null,
      button("Report (PDF)", actions.report, "A page for people: volumes, strain, segments, class"),
      button("FHIR", actions.fhir, "The report for systems: a FHIR R4 bundle"),
      button("DICOM SR", actions.dicom, "The report as objects of the patient's study: choose any instance of that study"),
      button("Table (CSV)", actions.csv, "A row for each frame: time, volume, strain, amplitudes"),
      button("One-file page", actions.page, "This page with its data as one file that opens without a network"),
      button("Picture", actions.picture, "What you see, as PNG"),
      button("Delete", actions.remove, "Delete the recording with all results", { class: "delete" }),
    ),
  );
}
