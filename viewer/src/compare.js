// Beside another recording, or beside one's own controls.

import { CurveChart } from "./charts.js";
import { h, numeral, refill } from "./dom.js";
import { worker } from "./head.js";

export const nameOfRecord = (one) => one.name || one.subject || one.id.slice(0, 8);

// A list of what else is there, filled when it is needed; `choose(id)` shows one, "" none.
export function comparePicker(calls, id, other, choose) {
  const select = h("select", { "aria-label": "Compare with", onchange: () => choose(select.value) }, h("option", { value: "" }, "Compare with …"));
  calls.sequences().then(({ sequences }) => {
    const others = sequences.filter((one) => one.id !== id);
    if (!others.length) select.hidden = true;
    refill(select,
      h("option", { value: "" }, other ? "Compare with none" : "Compare with …"),
      others.map((one) => h("option", { value: one.id, selected: one.id === other }, `${nameOfRecord(one)}, ${one.created.slice(0, 10)}`)));
  }, () => (select.hidden = true));
  return select;
}

// Deviations from one's own controls, where a norm exists.
export function normCard(calls, id) {
  const box = h("div", { class: "card norm", hidden: true });
  calls.norms().then(({ norms }) => {
    if (!norms.length) return;
    const result = h("div", { role: "status" });
    const select = h("select", { "aria-label": "Norm" }, norms.map(({ name }) => h("option", {}, name)));
    const ask = async () => {
      const answer = await calls.deviations(id, select.value);
      refill(result,
        h("p", { class: "sentence" }, h("strong", {}, answer.deviates ? "Deviates" : "Lies within"), ` ${answer.deviates ? "from " : ""}the ${answer.n_controls} controls of ${answer.norm} (p = ${numeral(answer.p, 2)}).`),
        h("table", { class: "figures" }, h("thead", {}, h("tr", {}, ["Quantity", "Value", "Controls with less"].map((name) => h("th", { scope: "col" }, name)))),
          h("tbody", {}, answer.quantities.map((one) => h("tr", {}, h("th", { scope: "row" }, one.name.replaceAll("_", " ")), h("td", {}, `${numeral(one.value)} ${one.unit}`), h("td", {}, `${Math.round(100 * one.share_less)} %`))))),
        [...answer.groups.filter((one) => one.deviates).map(({ words }) => words), ...answer.warnings].map((words) => h("p", { class: "note" }, words)));
    };
    refill(box, h("h2", {}, "Beside own controls"), h("div", { class: "row" }, select, worker("Compare", ask, "How far it lies from these controls", (words) => refill(result, h("p", { class: "note" }, words)))), result);
    box.hidden = false;
  }, () => {});
  return box;
}

// Values of a curve at shares of the motion's span.
function sampled(motion, points, n) {
  return Array.from({ length: n }, (_, k) => {
    const [first, second, share] = motion.around(motion.placeAt((k / (n - 1)) * motion.span * 0.999999));
    return points[first] + share * (points[second] - points[first]);
  });
}

const N = 101;

// Curves of two motions over the cycle, and the second less the first; `seek(share)` goes to a time.
export function differenceCharts(motions, names, seek) {
  const at = Array.from({ length: N }, (_, k) => (100 * k) / (N - 1));
  const charts = [];
  const add = (title, unit, find, kind) => {
    const found = motions.map((motion) => find(motion));
    if (!found.every(Boolean)) return;
    const [own, other] = found.map((points, k) => sampled(motions[k], points, N));
    const gap = other.map((v, i) => v - own[i]);
    const most = gap.reduce((best, v) => (Math.abs(v) > Math.abs(best) ? v : best), 0);
    charts.push(new CurveChart({
      title, at, xLabel: "share of the motion (%)", yLabel: unit, seek: (share) => seek(share / 100),
      note: `Difference: ${names[1]} less ${names[0]}, at most ${numeral(Math.abs(most))} ${unit}.`,
      curves: [{ points: own, ...kind, dash: [] }, { points: other, ...kind, dash: [6, 3] }, { points: gap, className: "difference", dash: [1.5, 2.5] }],
      legend: [[{ ...kind, dash: [] }, names[0]], [{ ...kind, dash: [6, 3] }, names[1]], [{ className: "difference", dash: [1.5, 2.5] }, "difference"]],
    }));
  };
  const column = (name, k) => ({ arrays, header }) => {
    if (!arrays[name]) return null;
    const n = header.strain.figures.filter(({ peak }) => peak).length;
    return Array.from(arrays[name].values).filter((_, i) => i % n === k);
  };
  const units = new Set(motions.map(({ header }) => header.volume.unit));
  if (units.size === 1) add("Volume", [...units][0], ({ arrays }) => arrays.volumes && Array.from(arrays.volumes.values), { className: "first" });
  ["GLS", "GCS"].forEach((name, k) => add(name, "%", column("strain", k), { className: `strain${k}` }));
  const { waves, unit } = motions[0].header;
  if (unit === motions[1].header.unit) {
    const largest = [...waves].sort((a, b) => b.rms - a.rms).slice(0, 2);
    for (const wave of largest)
      add(`${wave.name[0].toUpperCase()}${wave.name.slice(1)} ${wave.label}`, unit, (motion) => {
        const w = motion.header.waves.findIndex(({ label }) => label === wave.label);
        return w < 0 ? null : motion.trajectories()[w];
      }, { tone: wave.tone });
  }
  if (!charts.length) return null;
  return {
    charts,
    element: h("section", { class: "charts", "aria-label": "Differences" }, h("h2", {}, "Differences"), h("div", { class: "grid-of-charts" }, charts.map(({ element }) => element))),
  };
}
