// What to know of a view, below it.

import { h } from "./dom.js";

const SOFTWARE = "Software rendering: this browser has no graphics card to draw with. Everything works, large surfaces move slowly.";

export function notesOf(header, isSoftware) {
  const notes = isSoftware ? [...header.notes, SOFTWARE] : header.notes;
  if (!notes.length) return null;
  return h("section", { class: "notes" }, h("h2", {}, "What to know"), h("ul", {}, notes.map((note) => h("li", {}, note))));
}
