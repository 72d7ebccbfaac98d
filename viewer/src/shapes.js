// Mode shapes in closed form at natural coordinates: (6) of Nastar (1994), evaluated once.
//   open:   cos(p pi s)
//   closed: cos or sin(2 pi p theta), of all closed axes together cos or sin(a + b)
//   cup:    cos(r pi s) where p' is even, sin((r + 1/2) pi s) where it is odd
//   sphere: cos(r pi s) where p' is even, sin((r + 1) pi s) where it is odd
// each scaled to mean square 1; at a pole every mode that turns about it is zero.

export function closedShapes(ends, wavenumbers, sines, coordinates, nVertices) {
  const nAxes = ends.length;
  const isClosed = ends.map(([first]) => first === "closed");
  const isPole = ends.map((pair) => pair.includes("pole"));
  const isTwoPoles = ends.map(([first, last]) => first === "pole" && last === "pole");
  const shapes = new Float32Array(wavenumbers.length * nVertices);
  wavenumbers.forEach((p, mode) => {
    const odd = p.map((_, axis) => isPole[axis] && Math.abs(p[axis + 1]) % 2 === 1);
    const halves = p.map((n, axis) =>
      isClosed[axis] ? n : 2 * n + (odd[axis] ? (isTwoPoles[axis] ? 2 : 1) : 0),
    );
    const turns = halves.some((h, axis) => isClosed[axis] && h !== 0);
    const waves = halves.filter((h, axis) => !isClosed[axis] && h !== 0).length + (turns ? 1 : 0);
    const scale = Math.sqrt(2 ** waves);
    for (let v = 0; v < nVertices; v++) {
      let value = scale;
      let phase = 0;
      for (let axis = 0; axis < nAxes; axis++) {
        const x = coordinates[v * nAxes + axis];
        if (isClosed[axis]) {
          phase += 2 * Math.PI * halves[axis] * x;
          continue;
        }
        const y = (halves[axis] * Math.PI * x) / 2;
        value *= odd[axis] ? Math.sin(y) : Math.cos(y);
        if (isPole[axis] && p[axis + 1] !== 0 && (x <= 0 || (isTwoPoles[axis] && x >= 1)))
          value = 0;
      }
      if (turns || sines[mode]) value *= sines[mode] ? Math.sin(phase) : Math.cos(phase);
      shapes[mode * nVertices + v] = value;
    }
  });
  return shapes;
}
