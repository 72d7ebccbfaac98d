// The row of colours: what is coloured by what, its scale, and what else is shown.

import { bar } from "./charts.js";
import { h, numeral, refill } from "./dom.js";

export const COLOURS = [
  ["inward", "Inward motion"],
  ["motion", "Displacement"],
  ["error", "Error"],
  ["plain", "Plain"],
];

export class ColourRow {
  // What is called with a colour's name, and with whether surfaces as sent and data are shown.
  // Inward motion is offered where there is a cavity.
  constructor({ setColour, showSent, showData }, hasCavity) {
    const choice = ([name, text]) =>
      h("label", {}, h("input", { type: "radio", name: "colour", value: name, onchange: () => setColour(name) }), h("span", {}, text));
    this.choices = h("fieldset", { class: "choices" }, h("legend", {}, "Colour"), COLOURS.filter(([name]) => hasCavity || name !== "inward").map(choice));
    this.sent = h("input", { type: "checkbox", checked: true, onchange: () => showSent(this.sent.checked) });
    this.data = h("input", { type: "checkbox", checked: true, onchange: () => showData(this.data.checked) });
    this.bar = bar("0", "");
    this.legend = h("span", {});
    this.dataChoice = h("label", { class: "sent data", hidden: true }, this.data, this.legend);
    this.element = h("div", { class: "colours" }, this.choices, h("label", { class: "sent" }, this.sent, h("span", {}, "Show as sent")), this.bar, this.dataChoice);
  }

  mark(name) {
    for (const input of this.choices.querySelectorAll("input")) input.checked = input.value === name;
  }

  // Offers to show the points of clouds, where there are any.
  offer(clouds) {
    refill(this.legend, [
      h("span", {}, "Show the data: "), h("span", { class: "dot counted" }), "counted",
      ...(clouds.some((cloud) => cloud.hasStrays) ? [h("span", { class: "dot stray" }), "left out"] : []),
      ...(clouds.some((cloud) => cloud.hasLandmarks) ? [h("span", { class: "dot place" }), "landmark"] : []),
    ]);
    this.dataChoice.hidden = !clouds.length;
  }

  showScale(colour, [lowest, largest], title, unit) {
    this.bar.hidden = colour === "plain";
    const [low, of, high] = this.bar.texts;
    low.textContent = lowest ? numeral(lowest, 2).replace("-", "−") : "0";
    of.textContent = title;
    high.textContent = `${numeral(largest)} ${unit}`;
  }
}
