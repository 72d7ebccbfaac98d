// Modal superposition: x = R (rest + sum a phi - d) + d, and the frames as they were sent.

import { closedShapes } from "./shapes.js";

export class Motion {
  constructor({ header, arrays }) {
    this.header = header;
    this.nVertices = header.n_vertices;
    this.nFrames = header.n_frames;
    this.rest = arrays.rest.values;
    this.faces = arrays.faces.values;
    this.directions = arrays.directions ? arrays.directions.values : null;
    this.amplitudes = arrays.amplitudes.values;
    [, this.nModes, this.nDirections] = arrays.amplitudes.shape;
    this.quaternions = arrays.quaternions.values;
    this.translations = arrays.translations.values;
    this.times = arrays.times ? arrays.times.values : null;
    this.arrays = arrays;
    this.closes = header.cycle === "closes";
    this.waveOf = new Int32Array(this.nModes);
    header.waves.forEach((wave, w) => wave.modes.forEach((mode) => (this.waveOf[mode] = w)));
    this.sent = new Frames(this);
  }

  // Evaluated when they are first needed: what is said of a motion stands before it is drawn.
  get shapes() {
    const { header, arrays } = this;
    this._shapes ||= arrays.shapes
      ? arrays.shapes.values
      : closedShapes(header.ends, header.wavenumbers, header.sines, arrays.coordinates.values, this.nVertices);
    return this._shapes;
  }

  // Seconds from the first frame to the end of the cycle; frames where there are no times.
  get span() {
    const last = this.nFrames - 1;
    if (!this.times) return this.closes ? this.nFrames : last;
    const measured = this.times[last];
    if (!this.closes) return measured;
    const step = measured / Math.max(last, 1);
    return this.header.period > measured ? this.header.period : measured + step;
  }

  // Place (frame and fraction) at a time from the first frame.
  placeAt(time) {
    const last = this.nFrames - 1;
    if (!this.times) return Math.min(time, this.closes ? this.nFrames - 1e-6 : last);
    if (time >= this.times[last]) {
      const rest = this.span - this.times[last];
      return this.closes && rest > 0 ? last + Math.min((time - this.times[last]) / rest, 0.999999) : last;
    }
    let frame = 0;
    while (frame < last - 1 && this.times[frame + 1] <= time) frame++;
    const step = this.times[frame + 1] - this.times[frame];
    return frame + (step > 0 ? (time - this.times[frame]) / step : 0);
  }

  timeAt(place) {
    if (!this.times) return place;
    const frame = Math.min(Math.floor(place), this.nFrames - 1);
    const next = frame + 1 < this.nFrames ? this.times[frame + 1] : this.span;
    return this.times[frame] + (place - frame) * (next - this.times[frame]);
  }

  // The two frames on either side of a place, and the share of the second.
  around(place) {
    const first = Math.min(Math.floor(place), this.nFrames - 1);
    const share = place - first;
    const second = first + 1 < this.nFrames ? first + 1 : this.closes ? 0 : first;
    return [first, second, share];
  }

  // Amplitudes at a place, each wave times its gain, as modes x directions.
  amplitudesAt(place, gains, out) {
    const [first, second, share] = this.around(place);
    const n = this.nModes * this.nDirections;
    for (let i = 0; i < n; i++) {
      const a = this.amplitudes[first * n + i];
      const b = this.amplitudes[second * n + i];
      out[i] = gains[this.waveOf[(i / this.nDirections) | 0]] * (a + share * (b - a));
    }
    return out;
  }

  // Rotation as a row-major matrix, and the drift, at a place.
  poseAt(place) {
    const [first, second, share] = this.around(place);
    const q = slerp(this.quaternions, 4 * first, 4 * second, share);
    const drift = [0, 1, 2].map((k) => {
      const a = this.translations[3 * first + k];
      return a + share * (this.translations[3 * second + k] - a);
    });
    return { rotation: matrixOf(q), drift };
  }

  positions(place, gains, out) {
    const { rotation: R, drift: d } = this.poseAt(place);
    this.body(place, gains, out);
    for (let i = 0; i < out.length; i += 3) {
      const [x, y, z] = [out[i], out[i + 1], out[i + 2]];
      out[i] = R[0] * x + R[1] * y + R[2] * z + d[0];
      out[i + 1] = R[3] * x + R[4] * y + R[5] * z + d[1];
      out[i + 2] = R[6] * x + R[7] * y + R[8] * z + d[2];
    }
    return out;
  }

  // Positions before the whole is turned and shifted.
  body(place, gains, out) {
    const { nVertices: n, nModes, nDirections: nd, shapes, rest, directions } = this;
    const a = this.amplitudesAt(place, gains, new Float32Array(nModes * nd));
    const { drift: d } = this.poseAt(place);
    const u = nd === 3 ? out : new Float32Array(n);
    u.fill(0);
    for (let m = 0; m < nModes; m++) {
      const row = m * n;
      if (nd === 1) {
        if (a[m]) for (let v = 0; v < n; v++) u[v] += shapes[row + v] * a[m];
        continue;
      }
      const [x, y, z] = [a[3 * m], a[3 * m + 1], a[3 * m + 2]];
      if (!x && !y && !z) continue;
      for (let v = 0, i = 0; v < n; v++, i += 3) {
        const phi = shapes[row + v];
        u[i] += phi * x;
        u[i + 1] += phi * y;
        u[i + 2] += phi * z;
      }
    }
    const [dx, dy, dz] = this.header.holds_drift ? d : [0, 0, 0];
    for (let v = 0, i = 0; v < n; v++, i += 3) {
      let ux = u[i], uy = u[i + 1], uz = u[i + 2];
      if (nd === 1) {
        const h = u[v];
        [ux, uy, uz] = [directions[i] * h, directions[i + 1] * h, directions[i + 2] * h];
      } else if (directions) {
        const k = 9 * v;
        const [r, t, s] = [ux, uy, uz];
        ux = directions[k] * r + directions[k + 3] * t + directions[k + 6] * s;
        uy = directions[k + 1] * r + directions[k + 4] * t + directions[k + 7] * s;
        uz = directions[k + 2] * r + directions[k + 5] * t + directions[k + 8] * s;
      }
      out[i] = rest[i] + ux - dx;
      out[i + 1] = rest[i + 1] + uy - dy;
      out[i + 2] = rest[i + 2] + uz - dz;
    }
    return out;
  }

  // Frames at which the volume is largest and smallest; null where there is no volume.
  get moments() {
    const { volume } = this.header;
    return volume.refused ? null : [volume.end_diastole, volume.end_systole];
  }

  // Outward normals of the reference, of length 1.
  get outward() {
    if (this._outward) return this._outward;
    const out = new Float32Array(this.rest.length);
    normalsOf(this.rest, this.faces, out);
    let sense = 0;
    for (let i = 0; i < out.length; i++) sense += this.rest[i] * out[i];
    for (let i = 0; i < out.length; i += 3) {
      const size = Math.hypot(out[i], out[i + 1], out[i + 2]) * (Math.sign(sense) || 1) || 1;
      for (let k = 0; k < 3; k++) out[i + k] /= size;
    }
    return (this._outward = out);
  }

  // How far each vertex is inward of where it was at end diastole, along the reference's normal.
  inward(place, gains, out) {
    const n = 3 * this.nVertices;
    const key = gains.join();
    if (this._from !== key) {
      this._from = key;
      this._start = this.body(this.moments[0], gains, this._start || new Float32Array(n));
    }
    const { _start: from, outward } = this;
    const now = this.body(place, gains, (this._now ||= new Float32Array(n)));
    for (let v = 0, i = 0; v < out.length; v++, i += 3)
      out[v] = outward[i] * (from[i] - now[i]) + outward[i + 1] * (from[i + 1] - now[i + 1]) + outward[i + 2] * (from[i + 2] - now[i + 2]);
    return out;
  }

  // Inward motion at end systole that all but a hundredth of the vertices lie within, from 0.
  get inwardRange() {
    if (this._range) return this._range;
    const own = this.inward(this.moments[1], new Float32Array(this.header.waves.length).fill(1), new Float32Array(this.nVertices)).sort();
    const at = (share) => own[Math.round(share * (own.length - 1))];
    return (this._range = [Math.min(0, at(0.01)), Math.max(at(0.99), 1e-12)]);
  }

  // Each wave's amplitude along the direction in which it varies most, waves x frames.
  trajectories() {
    if (this._trajectories) return this._trajectories;
    const { nFrames, nModes, nDirections: nd } = this;
    this._trajectories = this.header.waves.map(({ modes }) => {
      const size = modes.length * nd;
      const rows = Array.from({ length: nFrames }, (_, f) =>
        modes.flatMap((mode) => {
          const start = (f * nModes + mode) * nd;
          return Array.from(this.amplitudes.subarray(start, start + nd));
        }),
      );
      let along = new Array(size).fill(0).map((_, i) => 1 + i / 10);
      for (let turn = 0; turn < 60; turn++) {
        const next = new Array(size).fill(0);
        for (const row of rows) {
          const dot = row.reduce((sum, x, i) => sum + x * along[i], 0);
          row.forEach((x, i) => (next[i] += dot * x));
        }
        const length = Math.hypot(...next);
        if (!(length > 0)) break;
        along = next.map((x) => x / length);
      }
      const path = rows.map((row) => row.reduce((sum, x, i) => sum + x * along[i], 0));
      const most = path.reduce((a, b) => (Math.abs(b) > Math.abs(a) ? b : a), 0);
      return most < 0 ? path.map((x) => -x) : path;
    });
    return this._trajectories;
  }
}

// Frames as they were sent, which come in pieces after the first picture.
export class Frames {
  constructor(motion) {
    this.motion = motion;
    this.pieces = new Array(motion.nFrames).fill(null);
    this.nReady = 0;
  }

  get isReady() {
    return this.nReady === this.pieces.length;
  }

  add({ header, arrays }) {
    const n = 3 * this.motion.nVertices;
    const { values, shape } = arrays.frames;
    for (let k = 0; k < shape[0]; k++) {
      if (!this.pieces[header.first + k]) this.nReady++;
      this.pieces[header.first + k] = {
        steps: values.subarray(k * n, (k + 1) * n),
        low: header.low,
        step: header.step,
      };
    }
  }

  positions(place, out) {
    const [first, second, share] = this.motion.around(place);
    const [a, b] = [this.pieces[first], this.pieces[second]];
    if (!a || !b) return null;
    for (let i = 0; i < out.length; i++) {
      const k = i % 3;
      const x = a.low[k] + a.steps[i] * a.step[k];
      out[i] = share ? x + share * (b.low[k] + b.steps[i] * b.step[k] - x) : x;
    }
    return out;
  }
}

// Sums of the normals of the faces at each vertex, as large as their areas.
export function normalsOf(points, faces, out) {
  out.fill(0);
  for (let f = 0; f < faces.length; f += 3) {
    const [i, j, k] = [3 * faces[f], 3 * faces[f + 1], 3 * faces[f + 2]];
    const ax = points[j] - points[i], ay = points[j + 1] - points[i + 1], az = points[j + 2] - points[i + 2];
    const bx = points[k] - points[i], by = points[k + 1] - points[i + 1], bz = points[k + 2] - points[i + 2];
    const nx = ay * bz - az * by, ny = az * bx - ax * bz, nz = ax * by - ay * bx;
    for (const c of [i, j, k]) {
      out[c] += nx;
      out[c + 1] += ny;
      out[c + 2] += nz;
    }
  }
}

// Between two rotations along the shortest way.
function slerp(q, i, j, share) {
  const a = q.subarray(i, i + 4);
  let b = Array.from(q.subarray(j, j + 4));
  let dot = a[0] * b[0] + a[1] * b[1] + a[2] * b[2] + a[3] * b[3];
  if (dot < 0) {
    b = b.map((x) => -x);
    dot = -dot;
  }
  let [wa, wb] = [1 - share, share];
  if (dot < 0.9995) {
    const angle = Math.acos(dot);
    wa = Math.sin((1 - share) * angle) / Math.sin(angle);
    wb = Math.sin(share * angle) / Math.sin(angle);
  }
  const mixed = [0, 1, 2, 3].map((k) => wa * a[k] + wb * b[k]);
  const length = Math.hypot(...mixed) || 1;
  return mixed.map((x) => x / length);
}

function matrixOf([x, y, z, w]) {
  return [
    1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w),
    2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w),
    2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y),
  ];
}
