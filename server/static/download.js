/** What can be taken along: the plan as files, its plots, its animation, and the request as a line for a terminal. */

import { shake, slide } from "./law.js";
import { $, element } from "./viewer/dom.js";

const FILM_FORMATS = ["video/webm;codecs=vp9", "video/webm;codecs=vp8", "video/webm", "video/mp4"];
const FRAMES = 30;  // of a film, a second
const DRAWN = ["fill", "stroke", "stroke-width", "stroke-dasharray", "stroke-linejoin", "stroke-linecap", "opacity",
  "font-size", "font-family", "paint-order"];  // what a drawing's look is made of
const GAP = 26;  // pixels above each plot of a drawing, for its title

/** Hand the browser a file to save. */
export function saveFile(name, content, type) {
  const address = URL.createObjectURL(content instanceof Blob ? content : new Blob([content], { type }));
  const link = element("a", { href: address, download: name });
  document.body.append(link);
  link.click();
  link.remove();
  setTimeout(() => URL.revokeObjectURL(address), 10_000);
}

/** The plan as the table that `slide-plan` writes as CSV: a row a sample, and after the command's those of the stop. */
export function csvOf({ command, object, pan, stop, friction, dt }) {
  const rows = command.position.map((position, k) => [position, object.position[k], object.velocity[k],
    pan.position[k], pan.velocity[k], pan.acceleration[k], 0]);
  let sliding = [...object.position.at(-1), ...object.velocity.at(-1)], acting = pan.acceleration.at(-1);
  let moving = { position: pan.position.at(-1), velocity: pan.velocity.at(-1) };
  const left = stop?.acceleration ?? [];
  for (const acceleration of left.length ? [...left, acting.map(() => 0)] : []) {
    sliding = slide(sliding, acting, friction, dt);
    moving = shake(moving, acting, dt);
    rows.push([command.position.at(-1), sliding.slice(0, 2), sliding.slice(2), moving.position, moving.velocity,
      acceleration, 1]);
    acting = acceleration;
  }
  const names = ["command_", "object_", "object_v", "pan_", "pan_v", "pan_a"];
  const head = names.flatMap((name, part) => [..."xyz"].slice(0, rows[0][part].length).map((axis) => name + axis));
  const lines = rows.map((row, k) => [Number((k * dt).toFixed(9)), ...row.flat()].join(","));
  return [["t", ...head, "stop"].join(","), ...lines, ""].join("\n");
}

/** All plots of an element as one drawing, with the colours they have on the page. */
export function plotsAsSvg(parent) {
  const style = getComputedStyle(document.body), parts = [];
  const svgElement = (name) => document.createElementNS(parent.querySelector("svg").namespaceURI, name);
  let width = 0, top = 0;
  for (const plot of parent.querySelectorAll(".plot")) {
    const drawing = plot.querySelector(".frame > svg"), copy = drawing.cloneNode(true);
    const all = [...drawing.querySelectorAll("*")];
    [...copy.querySelectorAll("*")].forEach((node, k) => {
      const look = getComputedStyle(all[k]);
      node.removeAttribute("class");
      for (const name of DRAWN) node.setAttribute(name, look.getPropertyValue(name));
    });
    const { width: wide, height } = drawing.getBoundingClientRect();
    copy.removeAttribute("class");
    const place = { x: 0, y: top + GAP, width: wide, height };
    for (const [name, value] of Object.entries(place)) copy.setAttribute(name, value);
    const title = svgElement("text");
    title.textContent = plot.querySelector("h2").textContent;
    const look = { x: 4, y: top + GAP - 9, fill: style.color, "font-size": 14, "font-family": style.fontFamily };
    for (const [name, value] of Object.entries(look)) title.setAttribute(name, value);
    parts.push(title, copy);
    width = Math.max(width, wide);
    top += height + GAP;
  }
  const whole = svgElement("svg");
  whole.setAttribute("viewBox", `0 0 ${width} ${top}`);
  whole.append(...parts);
  return new XMLSerializer().serializeToString(whole);
}

/**
 * Play a motion once and film it.
 *
 * @returns {blob, ending}: the film, and the ending of its name; null where the browser makes none
 */
export async function film(canvas, player) {
  const type = FILM_FORMATS.find((each) => globalThis.MediaRecorder?.isTypeSupported(each));
  if (!type) return null;
  const recorder = new MediaRecorder(canvas.captureStream(FRAMES), { mimeType: type, videoBitsPerSecond: 6e6 });
  const pieces = [];
  recorder.addEventListener("dataavailable", ({ data }) => pieces.push(data));
  const stopped = new Promise((resolve) => recorder.addEventListener("stop", resolve));
  player.seek(0);
  recorder.start();
  player.play(true);
  const until = performance.now() + (player.motion.end / player.rate + 0.3) * 1e3, { motion } = player;
  await new Promise((resolve) => {
    const look = () => performance.now() > until || player.motion !== motion ? resolve() : requestAnimationFrame(look);
    look();
  });
  recorder.stop();
  await stopped;
  return { blob: new Blob(pieces, { type }), ending: type.startsWith("video/mp4") ? "mp4" : "webm" };
}

/** Copy a text, or, where the browser forbids it (no https, not this machine), select what shows it. */
export async function copy(text, shown) {
  try {
    await navigator.clipboard.writeText(text);
    $("copied").textContent = "Copied.";
  } catch {
    const around = shown.closest("details");
    if (around) around.open = true;
    shown.hidden = false;
    shown.focus();
    getSelection().selectAllChildren(shown);
    $("copied").textContent = "Selected: copy it with your keyboard.";
  }
  setTimeout(() => { $("copied").textContent = ""; }, 4000);
}
