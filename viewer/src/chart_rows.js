// The charts under a view: volume, amplitudes, motion and error, bull's-eye.

import { BullsEye, CurveChart } from "./charts.js";
import { h, numeral } from "./dom.js";

// Charts of each motion: an element, and what is told the time. `goTo(number, t)` goes to a time of
// one of them.
export function chartsOf(motions, goTo) {
  const rows = [];
  const boxes = motions.map((motion, number) => {
    const { header, arrays } = motion;
    const at = Array.from({ length: motion.nFrames }, (_, f) => motion.timeAt(f));
    const xLabel = motion.times ? "time (s)" : "frame";
    const seek = (t) => goTo(number, t);
    const values = (name) => Array.from(arrays[name].values);
    const charts = [];
    const { volume } = header;
    if (arrays.volumes) {
      const v = values("volumes");
      charts.push(new CurveChart({
        title: "Volume", at, xLabel, yLabel: volume.unit, seek,
        note: volume.share ? `${volume.share.name} ${volume.share.value.toFixed(1)} % (of the mesh itself ${volume.share.mesh === null ? "–" : volume.share.mesh.toFixed(1)} %)` : "",
        curves: [{ points: values("mesh_volumes"), className: "quiet dashed" }, { points: v, className: "first" }],
        marks: [
          { at: at[volume.end_diastole], value: v[volume.end_diastole], text: numeral(volume.largest), above: true },
          { at: at[volume.end_systole], value: v[volume.end_systole], text: numeral(volume.smallest), above: false },
        ],
        legend: [["first", "from the amplitudes"], ["quiet dashed", "the mesh as sent"]],
      }));
    }
    const paths = motion.trajectories();
    const order = header.waves.map((_, w) => w).sort((a, b) => header.waves[b].rms - header.waves[a].rms);
    const tone = (w) => (order.indexOf(w) < 5 ? `tone${order.indexOf(w)}` : "quiet");
    const trajectories = new CurveChart({
      title: "Amplitudes", at, xLabel, yLabel: header.unit, seek,
      note: "Each pair along its main direction; point at a mode to find its curve.",
      curves: paths.map((points, w) => ({ points, className: tone(w) })),
      legend: order.slice(0, 5).map((w) => [tone(w), `${header.waves[w].label} ${header.waves[w].name}`]),
    });
    charts.push(trajectories);
    charts.push(new CurveChart({
      title: "Motion and error", at, xLabel, yLabel: header.unit, seek, fromZero: true,
      note: `${numeral(header.error.rms)} ${header.unit} RMS over all frames, at most ${numeral(header.error.max)}.`,
      curves: [
        { points: values("motion_rms"), className: "area", area: true },
        { points: values("max_errors"), className: "tone1 dashed" },
        { points: values("rms_errors"), className: "first" },
      ],
      legend: [["area", "motion, RMS"], ["first", "error, RMS"], ["tone1 dashed", "error, largest"]],
    }));
    let eye = null;
    if (arrays.segments) eye = new BullsEye(header, arrays.segments.values);
    rows.push({ motion, charts, eye, trajectories });
    return h(
      "section",
      { class: "charts", "aria-label": `Charts${motions.length > 1 ? ` of ${header.title || header.sequence_id.slice(0, 8)}` : ""}` },
      motions.length > 1 ? h("h2", {}, header.title || header.sequence_id.slice(0, 12)) : null,
      h("div", { class: "grid-of-charts" }, charts.map((chart) => chart.element), eye ? eye.element : null),
    );
  });
  return { element: h("div", {}, boxes), rows };
}
