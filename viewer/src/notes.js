// What to know of a view, below it.

import { h } from "./dom.js";

const SOFTWARE = "Software rendering: this browser has no graphics card to draw with. Everything works, large surfaces move slowly.";

export function notesOf({ notes: own, volume, strain }, isSoftware) {
  const notes = [...new Set([...own, ...(volume.notes || []), ...(strain.notes || []), ...(isSoftware ? [SOFTWARE] : [])])];
  if (!notes.length) return null;
  return h("section", { class: "notes" }, h("h2", {}, "What to know"), h("ul", {}, notes.map((note) => h("li", {}, note))));
}
