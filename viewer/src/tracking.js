// What a track says beside its surface: how well the data were followed, and its pictures.

import { h, numeral, refill } from "./dom.js";
import { plain } from "./notes.js";

const PICTURES = [
  ["data", "Data over the surface", "What was tracked, in frames spread over the beat"],
  ["deviations", "Estimated error", "The standard deviation of each place on the surface"],
  ["determined", "What the data determine", "The share of each mode that the data set, and not the prior"],
  ["overlay", "Contours over the images", "The surface in slices of the images, over the beat"],
];

const mean = (values) => {
  const known = values.filter((x) => x !== null);
  return known.length ? known.reduce((sum, x) => sum + x, 0) / known.length : null;
};

// `track`: { describe(), picture(name), slices(images) }.
export function trackCard(track, unit, say) {
  const box = h("div", { class: "card track" }, h("h2", {}, "Tracking"), h("p", { class: "note" }, "Loading"));
  const frame = h("dialog", { class: "picture", "aria-label": "Picture of the track" });
  const show = async (name, title) => {
    const bitmap = await createImageBitmap(await track.picture(name));
    const canvas = h("canvas", { role: "img", "aria-label": title, width: bitmap.width, height: bitmap.height });
    canvas.getContext("2d").drawImage(bitmap, 0, 0);
    const close = h("button", { type: "button", onclick: () => frame.close() }, "Close");
    refill(frame, h("div", { class: "head" }, h("h2", {}, title), close), canvas);
    frame.showModal();
  };
  const fill = (answer) => {
    const length = (x) => (x === null ? "–" : `${numeral(x)} ${unit}`);
    const share = (x) => (x === null ? "–" : `${Math.round(100 * x)} %`);
    const rows = [
      ["RMS distance to the data", length(mean(answer.residual_rms))],
      ["Data used", share(mean(answer.inliers))],
      ["Surface covered", share(mean(answer.coverage))],
      ["Estimated error (normal)", length(mean(answer.deviation_across))],
    ];
    const images = answer.links.images && answer.links.images.split("/").pop();
    const unseen = answer.unseen.length ? `Interpolated, for nothing was seen: frames ${answer.unseen.join(", ")}.` : null;
    const pictures = PICTURES.filter(([name]) => name !== "overlay" || images);
    refill(box,
      h("h2", {}, "Tracking"),
      h("table", { class: "figures" }, h("tbody", {}, rows.map(([what, value]) => h("tr", {}, h("th", { scope: "row" }, what), h("td", {}, value))))),
      unseen && h("p", { class: "note" }, unseen),
      answer.notes.length
        ? h("details", {}, h("summary", {}, `What to know: ${answer.notes.length} notes`), answer.notes.map((note) => h("p", { class: "note" }, plain(note.text))))
        : null,
      h("div", { class: "actions" }, images && h("button", {
        type: "button",
        title: "The slices of each frame, and the surface cut with them",
        onclick: () => track.slices(images),
      }, "Contours in the slices"), pictures.map(([name, title, words]) => h("button", {
        type: "button",
        title: words,
        onclick: async (event) => {
          const own = event.currentTarget;
          own.disabled = true;
          await show(name, title).catch((error) => say(error.message));
          own.disabled = false;
        },
      }, title))),
      frame);
  };
  track.describe().then(fill, (error) => refill(box, h("h2", {}, "Tracking"), h("p", { class: "note" }, error.message)));
  return box;
}
