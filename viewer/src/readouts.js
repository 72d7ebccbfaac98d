// What the volumes of each motion say.

import { h, numeral } from "./dom.js";

const signed = (value) => value.toFixed(1).replace("-", "\u2212");

function strainRows(strain) {
  if (!strain || strain.refused) return null;
  return h(
    "div",
    {},
    h(
      "dl",
      {},
      strain.figures.map(({ name, definition, value, low, high }) =>
        h(
          "div",
          { title: `Change of the ${definition}, since end diastole, at end systole` },
          h("dt", {}, name),
          h("dd", {}, `${signed(value)} % (${signed(low)} to ${signed(high)})`),
        ),
      ),
    ),
    strain.notes.map((note) => h("p", { class: "note" }, note)),
  );
}

export function readoutCards(motions) {
  const rows = motions.map(({ header }) => {
    const { volume } = header;
    if (volume.refused)
      return h("div", { class: "card" }, h("h2", {}, "Volume"), h("p", { class: "note" }, volume.refused));
    const { share } = volume;
    const name = share ? share.name[0].toUpperCase() + share.name.slice(1) : "Volume";
    return h(
      "div",
      { class: "card readouts" },
      h("h2", {}, motions.length > 1 ? `${name}: ${header.title || header.sequence_id.slice(0, 8)}` : name),
      share
        ? h("p", { class: "big" }, `${share.value.toFixed(1)} %`, h("span", {}, ` ${share.low.toFixed(1)} to ${share.high.toFixed(1)} %`))
        : null,
      h(
        "dl",
        {},
        [["largest", volume.largest], ["smallest", volume.smallest], ["difference", volume.stroke]].map(([what, value]) =>
          h("div", {}, h("dt", {}, what), h("dd", {}, `${numeral(value)} ${volume.unit}`)),
        ),
      ),
      strainRows(header.strain),
      volume.notes.map((note) => h("p", { class: "note" }, note)),
    );
  });
  return h("div", {}, rows);
}
