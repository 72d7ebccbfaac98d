// The charts under a view: volume, strain, bull's-eye, amplitudes, motion and error.

import { BullsEye, CurveChart } from "./charts.js";
import { h, interval, numeral } from "./dom.js";

const NAMED = 5;

const of = (values) => Array.from(values);
const later = (seconds) => (seconds == null ? "–" : `${Math.round(1000 * seconds)} ms`);

// A table below a chart: rows of { name, unit, value, low, high, time_to_peak }.
function tableOf(what, columns, rows) {
  if (!rows.length) return null;
  const cells = (figure) => {
    const [value, ends] = interval(figure);
    return [h("td", {}, `${value} ${figure.unit}`), h("td", { class: "soft" }, ends), h("td", {}, later(figure.time_to_peak))];
  };
  return h("table", { class: "figures" },
    h("thead", {}, h("tr", {}, h("th", { scope: "col" }, h("span", { class: "unseen" }, what)), columns.map((name) => h("th", { scope: "col" }, name)))),
    h("tbody", {}, rows.map((row) => h("tr", {}, h("th", { scope: "row" }, row.name), cells(row)))));
}

// Curves of a motion's modes: coloured by label, the largest named at their ends.
function modeCurves(motion) {
  const { waves } = motion.header;
  const order = waves.map((_, w) => w).sort((a, b) => waves[b].rms - waves[a].rms).slice(0, NAMED);
  return motion.trajectories().map((points, w) => {
    const { tone, dash, label } = waves[w];
    return order.includes(w) && waves[w].rms > 0 ? { points, tone, dash, end: label.replace(", cos", "") } : { points, className: "quiet" };
  });
}

function volumeChart(motion, common) {
  const { header: { volume }, arrays } = motion;
  const { at } = common;
  const v = of(arrays.volumes.values);
  const [largest, smallest] = volume.figures;
  return new CurveChart({
    ...common, title: "Volume", yLabel: volume.unit,
    note: volume.share ? `${volume.share.name[0].toUpperCase()}${volume.share.name.slice(1)} ${interval(volume.share)[0]} %` : "",
    curves: [
      { points: of(arrays.other_volumes.values), className: "quiet dashed" },
      { points: v, reach: of(arrays.volume_reach.values), className: "first" },
    ],
    marks: [
      { at: at[volume.end_diastole], value: v[volume.end_diastole], name: volume.moments[0], text: numeral(largest.value), above: true },
      { at: at[volume.end_systole], value: v[volume.end_systole], name: volume.moments[1], text: numeral(smallest.value), above: false },
    ],
    legend: volume.is_tracked
      ? [["first", "tracked surface"], ["quiet dashed", "from the amplitudes"]]
      : [["first", "from the amplitudes"], ["quiet dashed", "the mesh as sent"]],
    below: tableOf("Rate", ["Rate", "Bounds", "Time to peak"], motion.header.rates),
  });
}

function strainChart(motion, common) {
  const { header: { strain, volume }, arrays } = motion;
  const { at } = common;
  const names = strain.figures.filter(({ peak }) => peak);
  const column = (name, k, n) => of(arrays[name].values).filter((_, i) => i % n === k);
  const n = names.length;
  const segments = strain.segments;
  const known = segments.map((_, k) => column("segment_strain", k, segments.length)).filter((points) => points.every((x) => x > -1e8));
  return new CurveChart({
    ...common, title: "Strain", yLabel: "%",
    note: `Since end diastole; thin lines: longitudinal strain of each ${segments.length === 17 ? "segment" : "ring"}.`,
    curves: [
      ...known.map((points) => ({ points, className: "quiet" })),
      ...names.map(({ name }, k) => ({ points: column("strain", k, n), reach: column("strain_reach", k, n), className: `strain${k}`, dash: [[], [7, 2.5], [2, 2]][k], end: name })),
    ],
    marks: [{ at: at[volume.end_diastole], name: volume.moments[0] }, { at: at[volume.end_systole], name: volume.moments[1] }],
    below: tableOf("Strain", ["Peak", "95 % interval", "Time to peak"], names.map(({ name, unit, peak, time_to_peak }) => ({ name, unit, ...peak, time_to_peak }))),
  });
}

// Charts of each motion: an element, and what is told the time. `goTo(number, t)` goes to a time of
// one of them; `place` leads to where the anterior wall is stated.
export function chartsOf(motions, goTo, place) {
  const rows = [];
  const boxes = motions.map((motion, number) => {
    const { header, arrays } = motion;
    const at = Array.from({ length: motion.nFrames }, (_, f) => motion.timeAt(f));
    const common = { at, xLabel: motion.times ? "time (s)" : "frame", seek: (t) => goTo(number, t) };
    const charts = [];
    if (arrays.volumes) charts.push(volumeChart(motion, common));
    if (arrays.strain) charts.push(strainChart(motion, common));
    const { segments } = header;
    const eye = segments.refused ? null : new BullsEye(segments, motion.times ? `, ${at[segments.end_systole].toFixed(2)} s` : "", number ? null : place);
    const read = [...charts.map((chart) => chart.element), ...(eye ? [eye.element] : [])];
    const trajectories = new CurveChart({
      ...common, title: "Amplitudes", yLabel: header.unit,
      note: "Each mode along its main direction. Colours are those of the list of modes.",
      curves: modeCurves(motion),
    });
    charts.push(trajectories, new CurveChart({
      ...common, title: "Motion and error", yLabel: header.unit, fromZero: true,
      note: `Error ${numeral(header.error.rms)} ${header.unit} RMS over all frames, at most ${numeral(header.error.max)} ${header.unit}.`,
      curves: [
        { points: of(arrays.motion_rms.values), className: "area", area: true },
        { points: of(arrays.max_errors.values), className: "second dashed" },
        { points: of(arrays.rms_errors.values), className: "first" },
      ],
      legend: [["area", "motion, RMS"], ["first", "error, RMS"], ["second dashed", "error, largest"]],
    }));
    rows.push({ motion, charts, trajectories });
    return h(
      "section",
      { class: "charts", "aria-label": `Charts${motions.length > 1 ? ` of ${header.title || header.sequence_id.slice(0, 8)}` : ""}` },
      motions.length > 1 ? h("h2", {}, header.title || header.sequence_id.slice(0, 12)) : null,
      read.length ? h("div", { class: "grid-of-charts" }, read) : null,
      h("div", { class: "grid-of-charts wide" }, charts.slice(-2).map((chart) => chart.element)),
    );
  });
  return { element: h("div", {}, boxes), rows };
}
