// Frames of a compressed stream that a page holds, in the steps in which pieces of frames come.

import { decoder } from "../../web/decode/decode.js";

const STEPS = 65535;

export async function framesOf(stream, code, { header: { centre, length } }) {
  const { positions, nFrames, nVertices } = (await decoder(code))(new Uint8Array(stream));
  const low = [Infinity, Infinity, Infinity];
  const high = low.map((x) => -x);
  positions.forEach((x, i) => {
    const k = i % 3;
    low[k] = Math.min(low[k], x);
    high[k] = Math.max(high[k], x);
  });
  const values = Uint16Array.from(positions, (x, i) => {
    const size = high[i % 3] - low[i % 3];
    return size > 0 ? Math.round(((x - low[i % 3]) / size) * STEPS) : 0;
  });
  return {
    header: {
      first: 0,
      low: low.map((x, k) => (x - centre[k]) / length),
      step: low.map((x, k) => (high[k] - x) / length / STEPS),
    },
    arrays: { frames: { values, shape: [nFrames, nVertices, 3] } },
  };
}
