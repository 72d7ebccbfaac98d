// What the volumes and the wall of each motion say: one number large, the others in a table.

import { h, interval } from "./dom.js";
import { noteOf } from "./notes.js";

const POINTS = { noise: "the mesh as sent", mesh: "the mesh as sent", points: "points", images: "images" };

function figureRow({ name, unit, ...figure }) {
  const [value, ends] = interval(figure);
  return h("tr", {}, h("th", { scope: "row" }, name), h("td", {}, `${value} ${unit}`), h("td", { class: "soft" }, ends));
}

function definitions(header, figures) {
  const { volume, strain } = header;
  const frames = `Diastole ends at frame ${volume.end_diastole}, where the volume is largest; systole at frame ${volume.end_systole}, where it is smallest.`;
  const layer = strain.refused ? "" : `Strain is of the ${strain.layer}, from ${POINTS[strain.source] || strain.source}.`;
  const openings = volume.n_openings ? `${volume.n_openings === 1 ? "1 opening" : `${volume.n_openings} openings`}, capped.` : "";
  return h(
    "details",
    { class: "definitions" },
    h("summary", {}, "Definitions"),
    h("dl", {}, figures.map(({ name, definition }) => [h("dt", {}, name), h("dd", {}, definition)])),
    h("p", { class: "note" }, [frames, layer, openings, "Intervals hold the true value in 95 of 100 cases."].filter(Boolean).join(" ")),
  );
}

export function readoutCard(header, title, lead) {
  const { volume, strain } = header;
  if (volume.refused) return h("div", { class: "card" }, h("h2", {}, title || "Volume"), h("p", { class: "note" }, noteOf(volume.refused, lead)));
  const { share } = volume;
  const name = share ? share.name[0].toUpperCase() + share.name.slice(1) : "Volume";
  const figures = [...volume.figures, ...(strain.refused ? [] : strain.figures)];
  const short = share && share.name === "ejection fraction" ? "EF" : name;
  const [value, ends] = share ? interval(share) : [];
  return h(
    "div",
    { class: "card readouts" },
    h("h2", {}, title ? `${name}: ${title}` : name),
    share ? h("p", { class: "big" }, `${value} %`, h("span", {}, ` ${ends} %`)) : null,
    h("table", { class: "figures" },
      h("thead", {}, h("tr", {}, h("th", { scope: "col" }, h("span", { class: "unseen" }, "Quantity")), h("th", { scope: "col" }, h("span", { class: "unseen" }, "Value")), h("th", { scope: "col" }, "95 % interval"))),
      h("tbody", {}, figures.map(figureRow))),
    strain.refused ? h("p", { class: "note" }, noteOf(strain.refused, lead)) : null,
    definitions(header, [...(share ? [{ name: short, definition: share.definition }] : []), ...figures]),
  );
}
