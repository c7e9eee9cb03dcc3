/** Elements and numbers. Text that comes from elsewhere enters the page through textContent and append only. */

export const $ = (id) => document.getElementById(id);

export function element(tag, properties = {}, ...children) {
  const node = Object.assign(document.createElement(tag), properties);
  node.append(...children);
  return node;
}

/** An SVG element from markup of our own; no style attributes, which the page's policy forbids: classes. */
export function svg(attributes, content) {
  const holder = document.createElement("template");
  holder.innerHTML = `<svg ${attributes}>${content}</svg>`;
  return holder.content.firstChild;
}

/** A piece of a line for legends; `kind` is a class of viewer.css that sets its colour and dashes. */
export const swatch = (kind) =>
  svg('viewBox="0 0 20 8" aria-hidden="true"', `<path class="curve ${kind}" d="M0 4H20"/>`);

const formats = new Map();  // by their digits: to make one takes longer than all else that is written

function formatOf(digits) {
  const known = formats.get(digits);
  if (known) return known;
  const made = new Intl.NumberFormat("en", { minimumFractionDigits: digits, maximumFractionDigits: digits });
  formats.set(digits, made);
  return made;
}

export function number(value, digits = 1) {
  const text = formatOf(digits).format(value);
  return text.replace(/^-(?=[0.]*$)/, "").replace("-", "\u2212").replace(/,/g, "\u202f");
}

/** A length (m) in millimetres. */
export const mm = (length) => number(length * 1e3, Math.abs(length) < 0.1 ? 1 : 0);

/** The smallest of 1, 2, 5, 10, 20, 50 ... and their tenths and hundredths that is not below `rough`. */
export function roundStep(rough) {
  const power = 10 ** Math.floor(Math.log10(rough));
  return [1, 2, 5, 10].map((factor) => factor * power).find((candidate) => candidate >= rough * 0.999);
}
