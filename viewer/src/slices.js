// Planes through images: of a set as they are, of a volume cut along its axes.

import { readContainer } from "./container.js";

const sub = (a, b) => a.map((x, k) => x - b[k]);
const dot = (a, b) => a.reduce((sum, x, k) => sum + x * b[k], 0);
const length = (a) => Math.sqrt(dot(a, a));
const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];

// Pixels of one plane with their places: `at(i, j)`, mm along three axes.
class Slice {
  constructor({ pixels, start, counts, strides, origin, steps, thickness, shift }) {
    Object.assign(this, { pixels, start, counts, strides, origin, steps, thickness, shift });
    const normal = cross(steps[0], steps[1]);
    this.normal = normal.map((x) => x / length(normal));
    this.stand();
    this.spacing = this.steps.map(length);
  }

  // As it is usually seen: head or front at the top, the patient's right or front at the left.
  stand() {
    const parts = (k) => this.steps.map((step) => Math.abs(step[k]) / length(step));
    const [z, y] = [parts(2), parts(1)];
    const [upright, other] = Math.max(...z) > 0.5 ? [z, -1] : [y, 1];
    if (upright[0] > upright[1]) for (const name of ["counts", "strides", "steps"]) this[name] = [this[name][1], this[name][0]];
    const [right, down] = this.steps;
    const across = Math.abs(right[0]) >= Math.abs(right[1]) ? right[0] : right[1];
    if (across < 0) this.turn(0);
    if (down[other < 0 ? 2 : 1] * other < 0) this.turn(1);
  }

  // Counts an axis from its other end.
  turn(axis) {
    const last = this.counts[axis] - 1;
    this.start += last * this.strides[axis];
    this.origin = this.origin.map((x, k) => x + last * this.steps[axis][k]);
    this.strides[axis] *= -1;
    this.steps[axis] = this.steps[axis].map((x) => -x);
  }

  at(i, j) {
    return this.origin.map((x, k) => x + i * this.steps[0][k] + j * this.steps[1][k]);
  }

  // Pixel under a place, and how far the place lies before or behind the plane, mm.
  under(place) {
    const [a, b] = this.steps;
    const way = sub(place, this.origin);
    const [aa, ab, bb, wa, wb] = [dot(a, a), dot(a, b), dot(b, b), dot(way, a), dot(way, b)];
    const whole = aa * bb - ab * ab;
    return { i: (wa * bb - wb * ab) / whole, j: (wb * aa - wa * ab) / whole, off: dot(way, this.normal) };
  }

  // Where a surface crosses the plane: ends of segments in pixels, i, j, i, j.
  contours({ vertices, faces }) {
    const { origin, normal, shift } = this;
    const heights = new Float32Array(vertices.length / 3);
    for (let v = 0; v < heights.length; v++)
      heights[v] = (vertices[3 * v] - origin[0]) * normal[0] + (vertices[3 * v + 1] - origin[1]) * normal[1] + (vertices[3 * v + 2] - origin[2]) * normal[2];
    const crossing = (a, b) => {
      const share = heights[a] / (heights[a] - heights[b]);
      return this.under([0, 1, 2].map((k) => vertices[3 * a + k] + share * (vertices[3 * b + k] - vertices[3 * a + k]) + shift[k]));
    };
    const segments = [];
    for (let f = 0; f < faces.length; f += 3) {
      const corners = [faces[f], faces[f + 1], faces[f + 2]];
      const above = corners.map((v) => heights[v] > 0);
      if (above[0] === above[1] && above[1] === above[2]) continue;
      const ends = [0, 1, 2].filter((k) => above[k] !== above[(k + 1) % 3]).map((k) => crossing(corners[k], corners[(k + 1) % 3]));
      segments.push([ends[0].i, ends[0].j, ends[1].i, ends[1].j]);
    }
    return segments;
  }

  // Whether a pixel within some mm of a place on the plane is brighter than the background.
  isInk(i, j, reach) {
    const [di, dj] = this.spacing.map((size) => reach / size);
    for (let a = Math.max(0, Math.ceil(i - di)); a <= Math.min(this.counts[0] - 1, i + di); a++)
      for (let b = Math.max(0, Math.ceil(j - dj)); b <= Math.min(this.counts[1] - 1, j + dj); b++)
        if (((a - i) / di) ** 2 + ((b - j) / dj) ** 2 <= 1 && this.pixels[this.start + a * this.strides[0] + b * this.strides[1]] > 1) return true;
    return false;
  }

  paint(canvas) {
    const [width, height] = this.counts;
    canvas.width = width;
    canvas.height = height;
    const context = canvas.getContext("2d");
    const picture = context.createImageData(width, height);
    for (let j = 0, place = 0; j < height; j++)
      for (let i = 0; i < width; i++, place += 4) {
        const shade = this.pixels[this.start + i * this.strides[0] + j * this.strides[1]];
        picture.data[place] = picture.data[place + 1] = picture.data[place + 2] = shade;
        picture.data[place + 3] = 255;
      }
    context.putImageData(picture, 0, 0);
  }
}

const column = (affine, k) => affine.map((row) => row[k]);

// Stacks of parallel slices: by direction of a set's planes, by axis of a volume.
function stacksOf(header, pixels) {
  if (header.kind === "volume") {
    const [{ shape, affine, shift }] = header.parts;
    const steps = [0, 1, 2].map((k) => column(affine, k));
    const strides = [1, shape[0], shape[0] * shape[1]];
    return [2, 1, 0].map((across) => {
      const [a, b] = [0, 1, 2].filter((k) => k !== across);
      return Array.from({ length: shape[across] }, (_, n) => new Slice({
        pixels,
        start: n * strides[across],
        counts: [shape[a], shape[b]],
        strides: [strides[a], strides[b]],
        origin: column(affine, 3).map((x, k) => x + n * steps[across][k]),
        steps: [steps[a], steps[b]],
        thickness: length(steps[across]),
        shift,
      }));
    });
  }
  const stacks = [];
  let start = 0;
  for (const { shape, affine, thickness, stack, shift } of header.parts) {
    const slice = new Slice({
      pixels, start, counts: shape, strides: [1, shape[0]],
      origin: column(affine, 2), steps: [column(affine, 0), column(affine, 1)], thickness, shift,
    });
    (stacks[stack] ||= []).push(slice);
    start += shape[0] * shape[1];
  }
  // From one end to the other, whatever the order in which they came.
  for (const stack of stacks) stack.sort((a, b) => dot(sub(a.origin, b.origin), stack[0].normal));
  return stacks;
}

// One frame of images, as the service sends it.
export class Frame {
  constructor(buffer) {
    const { header, arrays } = readContainer(buffer);
    this.header = header;
    this.stacks = stacksOf(header, arrays.pixels.values);
    this.surface = arrays.faces ? { vertices: arrays.vertices.values, faces: arrays.faces.values } : null;
  }
}

// "Axial" and the like in LPS, or the number of a view that is oblique.
export function directionOf(slice, number) {
  const names = ["Sagittal", "Coronal", "Axial"];
  const axis = slice.normal.findIndex((x) => Math.abs(x) > 0.95);
  return axis < 0 ? `View ${number + 1}` : names[axis];
}

// Letters at the sides of a slice: towards the patient's left, front, head and so on.
export function sidesOf(slice) {
  const letters = [["R", "L"], ["A", "P"], ["F", "H"]];
  const word = (step, sign) => {
    const k = step.map(Math.abs).indexOf(Math.max(...step.map(Math.abs)));
    return letters[k][sign * step[k] > 0 ? 1 : 0];
  };
  const [right, down] = slice.steps;
  return { left: word(right, -1), right: word(right, 1), top: word(down, -1), bottom: word(down, 1) };
}
