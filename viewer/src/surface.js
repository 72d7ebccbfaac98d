// A surface that is drawn: moved by the shader where its shapes fit a texture, else in JavaScript.

import {
  BufferAttribute, BufferGeometry, DataTexture, DoubleSide, FloatType, GLSL3, LineSegments, Mesh,
  NearestFilter, Points, RedFormat, RedIntegerFormat, RGBAFormat, Scene, ShaderMaterial,
  UnsignedShortType, WebGLRenderTarget, Matrix3, Vector3, OrthographicCamera,
} from "three";
import { normalsOf } from "./motion.js";
import { viridisTexels } from "./viridis.js";

const WIDTH = 4096;
const MOST_TEXELS = WIDTH * 8192;

// One shader: where MOVED is defined it superposes the modes itself.
const MOVE = /* glsl */ `
  uniform highp sampler2D shapes;
  uniform highp sampler2D amplitudes;
  uniform highp int nModes;
  uniform highp int nVertices;
  uniform mat3 rotation;
  uniform vec3 drift;
  uniform highp usampler2D sentFirst;
  uniform highp usampler2D sentSecond;
  uniform highp float share;
  uniform highp int firstTexel;
  uniform highp int secondTexel;
  uniform vec3 low;
  uniform vec3 stepSize;
  highp ivec2 place(highp int i) { return ivec2(i % ${WIDTH}, i / ${WIDTH}); }
  uniform vec3 sinceDrift;
  // Row 0 now, row 1 at end diastole.
  vec3 displacement(highp int v, highp int row) {
    vec3 u = vec3(0.0);
    for (highp int m = 0; m < nModes; m++)
      u += texelFetch(shapes, place(m * nVertices + v), 0).r
        * texelFetch(amplitudes, ivec2(m, row), 0).rgb;
    return u;
  }
  vec3 superposed(highp int v, vec3 rest) {
    return rotation * (rest + displacement(v, 0) - drift) + drift;
  }
  vec3 asSent(highp int v) {
    highp int i = firstTexel + 3 * v;
    highp int j = secondTexel + 3 * v;
    vec3 a = vec3(texelFetch(sentFirst, place(i), 0).r, texelFetch(sentFirst, place(i + 1), 0).r,
      texelFetch(sentFirst, place(i + 2), 0).r);
    vec3 b = vec3(texelFetch(sentSecond, place(j), 0).r, texelFetch(sentSecond, place(j + 1), 0).r,
      texelFetch(sentSecond, place(j + 2), 0).r);
    return low + mix(a, b, share) * stepSize;
  }
`;

const VERTEX = /* glsl */ `
  precision highp float;
  precision highp int;
  uniform int mode;      // 0 superposed, 1 as sent
  uniform int coloured;  // 0 plain, 1 distance to what was sent, 2 displacement, 3 inward motion
  out vec3 seen;
  out vec3 across;
  out float shade;
  #ifdef MOVED
  in vec3 outward;
  ${MOVE}
  #else
  in float value;
  #endif
  void main() {
    #ifdef MOVED
    highp int v = gl_VertexID;
    vec3 x = mode == 1 ? asSent(v) : superposed(v, position);
    shade = coloured == 1 ? distance(superposed(v, position), asSent(v))
      : coloured == 2 ? length(displacement(v, 0))
      : coloured == 3 ? dot(outward, displacement(v, 1) - displacement(v, 0) - sinceDrift) : 0.0;
    across = vec3(0.0);
    #else
    vec3 x = position;
    shade = value;
    across = normalMatrix * normal;
    #endif
    vec4 eye = modelViewMatrix * vec4(x, 1.0);
    seen = eye.xyz;
    gl_Position = projectionMatrix * eye;
    gl_PointSize = 1.0;
  }
`;

const FRAGMENT = /* glsl */ `
  precision highp float;
  uniform sampler2D colours;
  uniform float lowest;
  uniform float largest;
  uniform int coloured;
  uniform vec3 plain;
  uniform float lit;
  in vec3 seen;
  in vec3 across;
  in float shade;
  out vec4 pixel;
  void main() {
    #ifdef MOVED
    vec3 n = normalize(cross(dFdx(seen), dFdy(seen)));
    #else
    vec3 n = normalize(across);
    #endif
    vec3 base = coloured == 0 ? plain : texture(colours, vec2(clamp((shade - lowest) / (largest - lowest), 0.0, 1.0)
      * 255.0 / 256.0 + 0.5 / 256.0, 0.5)).rgb;
    // From both sides: an open surface shows its inside, a little darker.
    bool inside = dot(n, seen) > 0.0;
    if (inside) n = -n;
    float key = max(dot(n, normalize(vec3(-0.35, 0.55, 0.75))), 0.0);
    float fill = 0.5 + 0.5 * n.y;
    float light = 0.42 + 0.22 * fill + 0.42 * key;
    if (inside) light *= 0.82;
    float rim = pow(1.0 - abs(dot(n, normalize(seen))), 3.0);
    // Colours that mean a number keep most of their own light.
    if (coloured != 0) light = mix(1.0, light, 0.6);
    vec3 colour = base * mix(1.0, light, lit) * (1.0 - 0.18 * rim * lit);
    pixel = vec4(colour, 1.0);
  }
`;

let colourTable = null;
function colours() {
  if (!colourTable) {
    colourTable = new DataTexture(viridisTexels(), 256, 1, RGBAFormat);
    colourTable.needsUpdate = true;
  }
  return colourTable;
}

function filled(Type, values, texels) {
  const height = Math.max(1, Math.ceil(texels / WIDTH));
  const data = new Type(WIDTH * height);
  data.set(values);
  return [data, height];
}

function wholeTexture(motion) {
  const n = motion.nModes * motion.nVertices;
  const [data, height] = filled(Float32Array, motion.shapes, n);
  const texture = new DataTexture(data, WIDTH, height, RedFormat, FloatType);
  texture.needsUpdate = true;
  return texture;
}

// Steps of all frames in one texture; of none where they do not fit.
function framesTexture(motion, fits) {
  const n = fits ? 3 * motion.nVertices * motion.nFrames : 1;
  const data = new Uint16Array(WIDTH * Math.ceil(n / WIDTH));
  const texture = new DataTexture(data, WIDTH, data.length / WIDTH, RedIntegerFormat, UnsignedShortType);
  texture.internalFormat = "R16UI";
  texture.minFilter = texture.magFilter = NearestFilter;
  texture.unpackAlignment = 2;
  // Also an empty one: what is not uploaded is of another type to the shader.
  texture.needsUpdate = true;
  return texture;
}

// Shapes and frames on the graphics card, shared by the panels of one sequence.
class Card {
  constructor(motion) {
    this.motion = motion;
    this.shapes = wholeTexture(motion);
    this.amplitudes = new DataTexture(
      new Float32Array(8 * motion.nModes), motion.nModes, 2, RGBAFormat, FloatType,
    );
    this.fits = 3 * motion.nVertices * motion.nFrames <= MOST_TEXELS;
    this.frames = framesTexture(motion, false);
    this.nFrames = 0;
  }

  // The steps of frames that have come; false until all are there.
  get hasFrames() {
    const { sent, nVertices } = this.motion;
    if (!this.fits || !sent.isReady) return false;
    if (!this.nFrames) {
      this.frames.dispose();
      this.frames = framesTexture(this.motion, true);
      sent.pieces.forEach(({ steps }, f) => this.frames.image.data.set(steps, 3 * f * nVertices));
      this.nFrames = sent.pieces.length;
    }
    return true;
  }
}

export function fitsShader(motion) {
  return (
    !motion.directions && motion.nDirections === 3 && motion.nModes * motion.nVertices <= MOST_TEXELS
  );
}

export class Surface {
  // `kind`: "sent" or "superposed"; `card`: a Card where the shader moves the vertices.
  constructor(motion, kind, card) {
    this.motion = motion;
    this.kind = kind;
    this.card = card;
    const n = motion.nVertices;
    this.geometry = new BufferGeometry();
    this.isLine = motion.faces.length === 0;
    this.points = card ? motion.rest : new Float32Array(motion.rest);
    this.geometry.setAttribute("position", new BufferAttribute(this.points, 3));
    if (card) this.geometry.setAttribute("outward", new BufferAttribute(motion.outward, 3));
    else {
      this.normals = new Float32Array(3 * n);
      this.values = new Float32Array(n);
      this.other = new Float32Array(3 * n);
      this.geometry.setAttribute("normal", new BufferAttribute(this.normals, 3));
      this.geometry.setAttribute("value", new BufferAttribute(this.values, 1));
    }
    this.geometry.setIndex(new BufferAttribute(this.isLine ? lineIndex(motion) : motion.faces, 1));
    this.material = new ShaderMaterial({
      glslVersion: GLSL3,
      vertexShader: VERTEX,
      fragmentShader: FRAGMENT,
      side: DoubleSide,
      defines: card ? { MOVED: 1 } : {},
      uniforms: uniforms(motion, card),
    });
    this.object = new (this.isLine ? LineSegments : Mesh)(this.geometry, this.material);
    this.object.frustumCulled = false;
    this.object.matrixAutoUpdate = false;
    const view = motion.header.view;
    this.object.matrix.set(
      view[0][0], view[1][0], view[2][0], 0,
      view[0][2], view[1][2], view[2][2], 0,
      -view[0][1], -view[1][1], -view[2][1], 0,
      0, 0, 0, 1,
    );
    this.scene = new Scene();
    this.scene.add(this.object);
    this.uniforms = this.material.uniforms;
    if (this.isLine) this.uniforms.lit.value = 0;
  }

  // `coloured`: 0 plain, 1 distance to what was sent, 2 displacement, 3 inward motion. False if it has
  // no frames yet.
  update(place, gains, coloured, largest, lowest = 0) {
    const { motion, card } = this;
    const isSent = this.kind === "sent";
    const needsFrames = isSent || coloured === 1;
    if (needsFrames && !(card ? card.hasFrames : motion.sent.isReady)) {
      if (isSent) return false;
      coloured = 0;
    }
    this.uniforms.coloured.value = coloured;
    this.uniforms.largest.value = largest || 1;
    this.uniforms.lowest.value = lowest;
    if (card) return this.updateCard(place, gains, isSent);
    const superposed = isSent && coloured !== 1 ? null : motion.positions(place, gains, isSent ? this.other : this.points);
    if (isSent) motion.sent.positions(place, this.points);
    if (coloured === 1) {
      const sent = isSent ? this.points : motion.sent.positions(place, this.other);
      distances(superposed, sent, this.values);
    } else if (coloured === 2) {
      displacements(motion, place, gains, this.values);
    } else if (coloured === 3) motion.inward(place, gains, this.values);
    normalsOf(this.points, motion.faces, this.normals);
    for (const name of ["position", "normal", "value"])
      this.geometry.attributes[name].needsUpdate = true;
    return true;
  }

  updateCard(place, gains, isSent) {
    const { motion, card, uniforms: u } = this;
    const a = motion.amplitudesAt(place, gains, new Float32Array(3 * motion.nModes));
    const data = card.amplitudes.image.data;
    const { rotation, drift } = motion.poseAt(place);
    for (let m = 0; m < motion.nModes; m++) data.set(a.subarray(3 * m, 3 * m + 3), 4 * m);
    if (u.coloured.value === 3) {
      const [start] = motion.moments;
      motion.amplitudesAt(start, gains, a);
      for (let m = 0; m < motion.nModes; m++) data.set(a.subarray(3 * m, 3 * m + 3), 4 * (motion.nModes + m));
      const from = motion.poseAt(start).drift;
      u.sinceDrift.value.set(...drift.map((x, k) => (motion.header.holds_drift ? from[k] - x : 0)));
    }
    card.amplitudes.needsUpdate = true;
    u.rotation.value.set(...rotation);
    u.drift.value.set(...drift);
    u.mode.value = isSent ? 1 : 0;
    u.sentFirst.value = u.sentSecond.value = card.frames;
    if (card.nFrames) {
      const [first, second, share] = motion.around(place);
      u.firstTexel.value = 3 * motion.nVertices * first;
      u.secondTexel.value = 3 * motion.nVertices * second;
      u.share.value = share;
      u.low.value.set(...motion.sent.pieces[0].low);
      u.stepSize.value.set(...motion.sent.pieces[0].step);
    }
    return true;
  }

  // What is drawn, read back: positions and colour values, as the tests compare them.
  read(renderer, place, gains, coloured, largest) {
    if (!this.update(place, gains, coloured, largest)) return null;
    if (!this.card) return { positions: Array.from(this.points), values: Array.from(this.values) };
    return readCard(renderer, this);
  }

  dispose() {
    this.geometry.dispose();
    this.material.dispose();
  }
}

export function makeSurfaces(motion, inShader) {
  const card = inShader && fitsShader(motion) ? new Card(motion) : null;
  const sentCard = card && card.fits ? card : null;
  return {
    sent: new Surface(motion, "sent", sentCard),
    superposed: new Surface(motion, "superposed", card),
    isInShader: Boolean(card),
  };
}

function uniforms(motion, card) {
  const common = {
    colours: { value: colours() },
    lowest: { value: 0 },
    largest: { value: 1 },
    coloured: { value: 0 },
    plain: { value: new Vector3(0.79, 0.77, 0.73) },
    lit: { value: 1 },
    mode: { value: 0 },
  };
  if (!card) return common;
  return {
    ...common,
    shapes: { value: card.shapes },
    amplitudes: { value: card.amplitudes },
    nModes: { value: motion.nModes },
    nVertices: { value: motion.nVertices },
    rotation: { value: new Matrix3() },
    drift: { value: new Vector3() },
    sinceDrift: { value: new Vector3() },
    sentFirst: { value: card.frames },
    sentSecond: { value: card.frames },
    share: { value: 0 },
    firstTexel: { value: 0 },
    secondTexel: { value: 0 },
    low: { value: new Vector3() },
    stepSize: { value: new Vector3() },
  };
}

function lineIndex(motion) {
  const n = motion.nVertices;
  const isRing = motion.header.surface === "closed curve";
  const pairs = [];
  for (let v = 0; v < (isRing ? n : n - 1); v++) pairs.push(v, (v + 1) % n);
  return new Uint32Array(pairs);
}

function distances(a, b, out) {
  for (let v = 0, i = 0; v < out.length; v++, i += 3)
    out[v] = Math.hypot(a[i] - b[i], a[i + 1] - b[i + 1], a[i + 2] - b[i + 2]);
}

// Lengths of the displacements: rotation and drift of the whole are not part of them.
function displacements(motion, place, gains, out) {
  const { nModes, nDirections: nd, nVertices: n, shapes } = motion;
  const a = motion.amplitudesAt(place, gains, new Float32Array(nModes * nd));
  for (let v = 0; v < n; v++) {
    let [x, y, z] = [0, 0, 0];
    for (let m = 0; m < nModes; m++) {
      const phi = shapes[m * n + v];
      x += phi * a[m * nd];
      if (nd === 3) {
        y += phi * a[m * nd + 1];
        z += phi * a[m * nd + 2];
      }
    }
    out[v] = Math.hypot(x, y, z);
  }
}

// Draws each vertex as one pixel that holds its position and colour value.
function readCard(renderer, surface) {
  const n = surface.motion.nVertices;
  const height = Math.ceil(n / 1024);
  const target = new WebGLRenderTarget(1024, height, { type: FloatType, format: RGBAFormat });
  const material = new ShaderMaterial({
    glslVersion: GLSL3,
    defines: { MOVED: 1 },
    uniforms: surface.uniforms,
    vertexShader: VERTEX.replace(
      /vec4 eye[\s\S]*gl_PointSize/,
      `across = x; seen = x;
       float column = float(v % 1024); float row = float(v / 1024);
       gl_Position = vec4((column + 0.5) / 512.0 - 1.0, (row + 0.5) / ${height}.0 * 2.0 - 1.0, 0.0, 1.0);
       gl_PointSize`,
    ),
    fragmentShader: `precision highp float; in vec3 seen; in vec3 across; in float shade;
      out vec4 pixel; void main() { pixel = vec4(across, shade); }`,
  });
  const geometry = new BufferGeometry();
  for (const name of ["position", "outward"]) geometry.setAttribute(name, surface.geometry.attributes[name]);
  const points = new Points(geometry, material);
  points.frustumCulled = false;
  const scene = new Scene();
  scene.add(points);
  renderer.setScissorTest(false);
  renderer.setRenderTarget(target);
  renderer.setClearColor(0, 0);
  renderer.clear();
  renderer.render(scene, new OrthographicCamera());
  const texels = new Float32Array(4 * 1024 * height);
  renderer.readRenderTargetPixels(target, 0, 0, 1024, height, texels);
  renderer.setRenderTarget(null);
  target.dispose();
  material.dispose();
  const positions = [], values = [];
  for (let v = 0; v < n; v++) {
    positions.push(texels[4 * v], texels[4 * v + 1], texels[4 * v + 2]);
    values.push(texels[4 * v + 3]);
  }
  return { positions, values };
}
