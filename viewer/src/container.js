// Reads what modalmotion.viewer.container writes: a header and aligned arrays, none copied.

const MAGIC = "MMVIEW1\n";
const TYPES = {
  "<f8": Float64Array,
  "<f4": Float32Array,
  "<f2": Uint16Array,
  "<u4": Uint32Array,
  "<u2": Uint16Array,
  "|u1": Uint8Array,
};

export function readContainer(buffer) {
  const bytes = new Uint8Array(buffer);
  if (String.fromCharCode(...bytes.subarray(0, 8)) !== MAGIC)
    throw new Error("These bytes are not what the viewer reads.");
  const length = new DataView(buffer).getUint32(8, true);
  const header = JSON.parse(new TextDecoder().decode(bytes.subarray(12, 12 + length)));
  const arrays = {};
  for (const [name, { dtype, shape, place }] of Object.entries(header.arrays)) {
    const count = shape.reduce((product, n) => product * n, 1);
    const values = new TYPES[dtype](buffer, 12 + length + place, count);
    arrays[name] = { values: dtype === "<f2" ? fromHalf(values) : values, shape };
  }
  return { header, arrays };
}

// IEEE 754 half precision: 1 sign, 5 exponent, 10 fraction bits.
export function fromHalf(halves) {
  const table = new Float32Array(65536);
  for (let h = 0; h < 65536; h++) {
    const exponent = (h >> 10) & 31;
    const fraction = h & 1023;
    const size =
      exponent === 0 ? fraction * 2 ** -24 : (1 + fraction / 1024) * 2 ** (exponent - 15);
    table[h] = h & 0x8000 ? -size : size;
  }
  return Float32Array.from(halves, (h) => table[h]);
}
