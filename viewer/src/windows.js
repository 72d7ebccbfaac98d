// What stands over the stage: a caption on each surface, and the axes of space.

import { h, numeral, svg } from "./dom.js";

// Windows of a motion, one for each of its surfaces; `isOne` says that it is the only motion.
export function windowsOf({ header }, number, surfaces, isOne) {
  const name = isOne ? "" : `${header.title || header.sequence_id.slice(0, 8)}: `;
  const make = (kind, title, sub) => ({
    surface: surfaces[kind],
    kind,
    number,
    isShown: true,
    element: h("div", { class: "window" }, h("div", { class: "caption" }, h("strong", {}, name + title), h("span", {}, sub))),
  });
  const count = header.n_amplitudes;
  return [
    make("sent", "As sent", `${header.n_vertices.toLocaleString("en")} vertices per frame`),
    make("superposed", `From ${count} amplitude${count === 1 ? "" : "s"}`, `${numeral(header.error.rms)} ${header.unit} RMS error, ${header.compression.toFixed(0)} : 1`),
  ];
}

export const crossOfAxes = () => svg("svg", { class: "cross", viewBox: "-24 -24 48 48", "aria-hidden": "true" });

// `axes`: x and y of each axis on the screen.
export function turnCross(cross, axes) {
  cross.replaceChildren(
    ...axes.flatMap(([x, y], k) => [
      svg("line", { x1: 0, y1: 0, x2: 15 * x, y2: 15 * y }),
      svg("text", { x: 20 * x, y: 20 * y + 3, "text-anchor": "middle" }, "xyz"[k]),
    ]),
  );
}
