// Data that a surface was tracked through, drawn over it in the frame nearest to the moment.

import {
  BufferAttribute, BufferGeometry, GLSL3, GreaterDepth, LessEqualDepth, Points, ShaderMaterial,
} from "three";
import { readContainer } from "./container.js";

// Weights, of 255, below which a point hardly counted.
const STRAY = 26;
const COUNTED = [0.1, 0.14, 0.22];
const LEFT_OUT = [0.78, 0.3, 0.12];
const LANDMARK = [0.62, 0.1, 0.45];

const VERTEX = /* glsl */ `
  precision highp float;
  in vec3 tone;
  in float size;
  uniform float ratio;
  out vec3 shade;
  void main() {
    shade = tone;
    gl_Position = projectionMatrix * modelViewMatrix * vec4(position, 1.0);
    gl_PointSize = size * ratio;
  }
`;

const FRAGMENT = /* glsl */ `
  precision highp float;
  uniform float strength;
  in vec3 shade;
  out vec4 pixel;
  void main() {
    float away = length(gl_PointCoord - 0.5);
    if (away > 0.5) discard;
    // A pale rim, for dark colours under it.
    pixel = vec4(mix(shade, vec3(0.93), smoothstep(0.28, 0.4, away)), strength);
  }
`;

// What lies behind the surface shows faintly through it.
const LAYERS = [[LessEqualDepth, 1], [GreaterDepth, 0.22]];

export class Cloud {
  constructor(buffer, motion) {
    const { header, arrays: { points, weights, landmarks } } = readContainer(buffer);
    const { centre, length } = motion.header;
    // Both are far from the origin, and their difference need not be.
    const from = header.origin.map((x, k) => x - centre[k]);
    this.motion = motion;
    this.starts = [0];
    for (const count of header.counts) this.starts.push(this.starts.at(-1) + count);
    this.counts = header.counts;
    const n = weights.values.length;
    const kinds = Array.from(weights.values, (weight, i) => (landmarks.values[i] ? 2 : weight < STRAY ? 1 : 0));
    this.hasStrays = kinds.includes(1);
    this.hasLandmarks = kinds.includes(2);
    this.geometry = new BufferGeometry();
    const set = (name, values, size) => this.geometry.setAttribute(name, new BufferAttribute(values, size));
    set("position", Float32Array.from(points.values, (x, i) => (x * header.length + from[i % 3]) / length), 3);
    set("tone", Float32Array.from({ length: 3 * n }, (_, i) => [COUNTED, LEFT_OUT, LANDMARK][kinds[Math.floor(i / 3)]][i % 3]), 3);
    set("size", Float32Array.from(kinds, (kind) => [5, 6, 11][kind]), 1);
    this.drawn = [];
  }

  // Is drawn with a surface, in its scene.
  join(surface) {
    for (const [depthFunc, strength] of LAYERS) {
      const material = new ShaderMaterial({
        glslVersion: GLSL3,
        vertexShader: VERTEX,
        fragmentShader: FRAGMENT,
        transparent: true,
        depthWrite: false,
        depthFunc,
        uniforms: { ratio: { value: 1 }, strength: { value: strength } },
      });
      const object = new Points(this.geometry, material);
      object.frustumCulled = false;
      object.matrixAutoUpdate = false;
      object.matrix.copy(surface.object.matrix);
      surface.scene.add(object);
      this.drawn.push(object);
    }
  }

  // Points of the frame nearest to a place between frames.
  show(place, isShown, ratio) {
    const frame = Math.round(place) % this.counts.length;
    this.geometry.setDrawRange(this.starts[frame], this.counts[frame]);
    for (const object of this.drawn) {
      object.visible = isShown && this.counts[frame] > 0;
      object.material.uniforms.ratio.value = ratio;
    }
  }

  // Positions in a frame, as the tests compare them.
  read(frame) {
    const { array } = this.geometry.attributes.position;
    return Array.from(array.subarray(3 * this.starts[frame], 3 * this.starts[frame + 1]));
  }

  dispose() {
    this.geometry.dispose();
    for (const object of this.drawn) object.material.dispose();
  }
}
