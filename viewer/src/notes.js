// What to know of a view, below it; what a note asks for is led to.

import { fieldAskedBy } from "./about.js";
import { h } from "./dom.js";

const SOFTWARE = "Software rendering: this browser has no graphics card to draw with. Everything works, large surfaces move slowly.";

// Whoever reads a page has no command line.
export const plain = (note) =>
  note
    .replace(/ ?\(--[^)]*\)/g, "")
    .replace(/[;,] state [^.;]*--[^.;]*/g, "")
    .replace(/ by --[a-z-]+( [A-Z]+)?/g, "")
    .replace(/(the fact )?tracking=material/, "this")
    .replace(/the landmark '?(\w+)'?/g, (_, name) => `the landmark ${name.replace("_", " ")}`);

// A note, with a button that leads to the field that it asks for.
export function noteOf(note, lead) {
  const asked = lead && fieldAskedBy(note);
  return [plain(note), asked ? [" ", h("button", { type: "button", class: "lead-to", onclick: () => lead(asked[1]) }, asked[2])] : null];
}

export function notesOf({ notes: own, volume, strain, reasons }, isSoftware, lead) {
  const all = [...own, ...(volume.notes || []), ...(strain.notes || []), ...(reasons || [])].map((note) => note.text);
  const notes = [...new Set([...all, ...(isSoftware ? [SOFTWARE] : [])])];
  if (!notes.length) return null;
  return h("section", { class: "notes" }, h("h2", {}, "What to know"), h("ul", {}, notes.map((note) => h("li", {}, noteOf(note, lead)))));
}
