// A table with a row for each frame: time, volume, strain, motion, error and every amplitude.

import { save } from "./api.js";

export function frameRows(motion) {
  const { header, arrays, nDirections: nd } = motion;
  const columns = [["frame", (f) => f], ["time_s", (f) => (motion.times ? motion.times[f] : "")]];
  const add = (name, array, k = 0, n = 1) => array && columns.push([name, (f) => array.values[f * n + k]]);
  const cubed = header.volume.unit === "ml" ? "ml" : "cubed_units";
  add(`volume_${cubed}`, arrays.volumes);
  add(`volume_half_interval_${cubed}`, arrays.volume_reach);
  if (arrays.strain) {
    const names = header.strain.figures.filter(({ peak }) => peak);
    names.forEach(({ name }, k) => {
      add(`${name}_percent`, arrays.strain, k, names.length);
      add(`${name}_half_interval`, arrays.strain_reach, k, names.length);
    });
  }
  add("motion_rms", arrays.motion_rms);
  add("error_rms", arrays.rms_errors);
  add("error_max", arrays.max_errors);
  header.waves.forEach(({ modes, label }) =>
    modes.forEach((mode, part) => {
      for (let d = 0; d < nd; d++) {
        const name = modes.length === 1 ? label : label.replace(")", part ? ", sin)" : ", cos)");
        columns.push([`"${name} ${d}"`, (f) => motion.amplitudes[(f * motion.nModes + mode) * nd + d]]);
      }
    }),
  );
  return [columns.map(([name]) => name), ...Array.from({ length: motion.nFrames }, (_, f) => columns.map(([, value]) => value(f)))];
}

export function saveTable(motion, name) {
  save(new Blob([frameRows(motion).map((row) => row.join(",")).join("\n") + "\n"], { type: "text/csv" }), name);
}
