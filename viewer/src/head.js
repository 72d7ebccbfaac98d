// The head of a view: what is seen, and what can be done with it.

import { h, numeral } from "./dom.js";

// `actions`: { isServed, picture, csv, page }; `say(text)` tells what went wrong.
export function headOf(motion, actions, isEmbedded, say) {
  const { header } = motion;
  const title = header.title || `Sequence ${header.sequence_id.slice(0, 12)}`;
  const facts = [
    header.surface === "mesh" ? "mesh with modes of its own" : header.surface,
    `${header.n_frames} frame${header.n_frames === 1 ? "" : "s"}`,
    motion.times ? `${numeral(motion.span)} s` : "times unknown",
    header.unit === "length units" ? "(unit unknown)" : `lengths in ${header.unit}`,
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
              say(error.message);
            }
            own.disabled = false;
          },
          title: what,
        }, text)
      : null;
  return h(
    "header",
    { class: "head" },
    h("div", {}, isEmbedded ? null : h("a", { class: "brand", href: "/", hidden: !actions.isServed }, "modalmotion"), h("h1", {}, title), h("p", { class: "facts" }, facts.join(" · "))),
    h(
      "div",
      { class: "actions" },
      button("Save picture", actions.picture, "What you see, as PNG"),
      button("Table (CSV)", actions.csv, "A row for each frame: time, volume, strain, amplitudes"),
      button("Save as one file", actions.page, "A page that opens from disk, without a network"),
    ),
  );
}
