// Elements made one by one: under the page's policy no text is parsed as HTML.

const SVG = "http://www.w3.org/2000/svg";

function fill(element, properties, children) {
  for (const [name, value] of Object.entries(properties || {})) {
    if (name.startsWith("on")) element.addEventListener(name.slice(2), value);
    else if (name === "style") Object.assign(element.style, value);
    else if (value === true) element.setAttribute(name, "");
    else if (value !== false && value != null) element.setAttribute(name, value);
  }
  element.append(...children.flat(Infinity).filter((child) => child != null && child !== false));
  return element;
}

export const h = (tag, properties, ...children) =>
  fill(document.createElement(tag), properties, children);

export const svg = (tag, properties, ...children) =>
  fill(document.createElementNS(SVG, tag), properties, children);

// Puts these in place of what an element held.
export const refill = (element, ...children) => {
  element.replaceChildren();
  return fill(element, {}, children);
};

// Three significant digits, or none after the point for large numbers.
export function numeral(x, digits = 3) {
  if (!Number.isFinite(x)) return "–";
  if (x === 0) return "0";
  const size = Math.abs(x);
  if (size >= 1e5 || size < 1e-4) return x.toExponential(digits - 1).replace("e", "e");
  return x.toFixed(Math.min(Math.max(digits - 1 - Math.floor(Math.log10(size)), 0), 6));
}

// With its sign, also where it is positive.
export const signed = (x) => `${x < 0 ? "−" : "+"}${numeral(Math.abs(x))}`;

// A probability; near 1 its bound, as no estimate is certain.
export const probability = (p) => (p > 0.99 ? ">\u00a00.99" : p.toFixed(2));

// A number and its interval: one decimal, or as many as tell the ends apart, two at most.
export function interval({ value, low, high }) {
  const minus = (text) => text.replace("-", "−");
  for (let digits = 1; digits < 3; digits++) {
    const [a, b] = [low.toFixed(digits), high.toFixed(digits)];
    if (a !== b) return [minus(value.toFixed(digits)), `${minus(a)} to ${minus(b)}`];
  }
  return [minus(value.toFixed(2)), "± less than 0.01"];
}
