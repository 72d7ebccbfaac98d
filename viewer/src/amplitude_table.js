// A table of amplitudes, as they stand in the page: in single precision.

import { save } from "./api.js";

export function saveTable(motion) {
  const { header } = motion;
  const nd = motion.nDirections;
  const rows = [["frame", "time_s", "wave", "mode", "direction", "amplitude"].join(",")];
  for (let f = 0; f < motion.nFrames; f++)
    header.waves.forEach(({ modes, label }) =>
      modes.forEach((mode, part) => {
        for (let d = 0; d < nd; d++)
          rows.push([f, motion.times ? motion.times[f] : "", `"${label}"`, part, d, motion.amplitudes[(f * motion.nModes + mode) * nd + d]].join(","));
      }),
    );
  save(new Blob([rows.join("\n") + "\n"], { type: "text/csv" }), `${header.sequence_id.slice(0, 12)}-amplitudes.csv`);
}
