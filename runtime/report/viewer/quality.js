/** What is to be said of a plan: its status in plain words, and its figures beside the limits. */

import { element, mm, number, svg } from "./dom.js";

const SIGNS = { good: "M3 8.5l3.2 3.2L13 5", mixed: "M8 3v6M8 12.5v.2", bad: "M4 4l8 8M12 4l-8 8" };

/** Of each status: how good it is, its name, and what follows from it. */
export const STATUS = {
  ok: ["good", "Within limits", "Every limit holds, and the network was trained on paths of this kind."],
  governed: ["good", "Within limits, governed",
    "Every limit holds. Where the network asked for more than one allows, the governor gave less; what you see is " +
    "the motion after that."],
  limited: ["mixed", "Held back by its limits",
    "Every limit holds, but the governor changed more than one sample in twenty to keep them: a slower path, or " +
    "higher limits, would be followed better."],
  beyond_training_range: ["mixed", "Beyond the training range",
    "Every limit holds, but the network was not trained on such a path, such friction or such a start: expect it to " +
    "follow less well."],
  poor: ["bad", "Follows poorly",
    "Every limit holds, but the object hardly follows the path. A slower path or higher limits may help."],
  cannot_slide: ["bad", "Cannot slide",
    "Static friction holds the object against everything that the acceleration limit allows. Allow more, or take a " +
    "pan with less friction."],
  off_pan: ["bad", "Off the pan",
    "The path, or the object as predicted, comes over the rim of the pan; from there on the prediction is wrong. " +
    "Move the path or make it smaller."],
  tolerance_missed: ["bad", "Tolerance missed",
    "Every limit holds, but the object strays farther from the path than the tolerance allows."],
  limit_exceeded: ["bad", "Limit exceeded", "A limit is passed: a robot must not execute this plan as it is."],
};

/** A note as a sentence. */
const sentence = (note) =>
  `${note.replaceAll("^2", "²").replaceAll("^3", "³").replace(/^./, (first) => first.toUpperCase())}.`;

/** Rows of the table: name, unit, value, limit and margin, as they are to be read. */
function rowsOf({ quality, stop, radius }) {
  const { limits, margins } = quality;
  const free = (name, unit, value) => [name, unit, value, "", ""];
  const known = (name, value) => (value == null ? [] : [free(name, "mm", mm(value))]);  // older plans lack some figures
  const bounded = (name, unit, value, limit, format) => {
    const given = limits[limit] != null;
    return [name, unit, format(value), given ? format(limits[limit]) : "none", given ? format(margins[limit]) : ""];
  };
  const round = (value) => number(Number(value.toPrecision(3)), 0);
  const room = radius.pan - radius.object;
  const beyond = Math.max(quality.command_off_pan?.farthest ?? 0, quality.object_off_pan?.farthest ?? 0);
  return [
    free("Tracking error, RMS", "mm", mm(quality.tracking_rmse)),
    free("Tracking error, largest", "mm", mm(quality.tracking_max)),
    ...known("RMS if friction is 10 % off", quality.friction_off_rmse),
    ...known("Object to its mark, at rest", quality.rest_error),
    ...(beyond ? [["Over the rim, at most", "mm", mm(beyond), `${mm(room)} from the middle`, ""]] : []),
    bounded("Pan reach", "mm", quality.pan_reach, "pan_reach", mm),
    ...(limits.height || quality.height_max ? [bounded("Pan height", "mm", quality.height_max, "height", mm)] : []),
    ...(limits.speed == null && !quality.height_max ? [] : [
      bounded("Pan speed", "m/s", quality.speed_max, "speed", (value) => number(value, 2))]),
    bounded("Pan acceleration", "m/s²", quality.acceleration_max, "acceleration", (value) => number(value, 1)),
    bounded("Pan jerk", "m/s³", quality.jerk_max, "jerk", round),
    free("Time sliding", "%", number(quality.sliding_share * 100, 0)),
    ...(stop ? [free("Stop after the end", "ms", number(stop * 1e3, 0))] : []),
  ];
}

/** A table: names of its columns, and rows of a name, what stands beside it, and cells of text. */
export function table(heads, rows) {
  return element("table", { className: "number" },
    element("thead", {}, element("tr", {}, ...heads.map((head) => element("th", { scope: "col", textContent: head })))),
    element("tbody", {}, ...rows.map(([name, ...cells]) => element("tr", {},
      element("th", { scope: "row" }, ...name), ...cells.map((cell) => element("td", { textContent: cell }))))));
}

/** Fill an element with the quality of a motion. */
export function showQuality(parent, motion) {
  const { quality } = motion;
  const [level, verdict, words] = STATUS[quality.status] ?? ["mixed", quality.status.replaceAll("_", " "), ""];
  const sign = svg('viewBox="0 0 16 16" aria-hidden="true"', `<path d="${SIGNS[level]}"/>`);
  const rows = rowsOf(motion).map(([name, unit, ...cells]) =>
    [[`${name} `, element("small", { textContent: unit })], ...cells]);
  parent.replaceChildren(
    element("div", { className: "row" }, element("h2", { id: "quality-title", textContent: "How well it goes" }),
      element("span", { id: "badge", className: `badge ${level}` }, sign, verdict)),
    element("p", { id: "explanation", className: "explanation" },
      "The object follows the path to ", element("b", { textContent: `${mm(quality.tracking_rmse)} mm` }),
      ` (root mean square), and is never farther from it than ${mm(quality.tracking_max)} mm. ${words}`),
    element("ul", { id: "notes", className: "notes", hidden: quality.notes.length === 0 },
      ...quality.notes.map((note) => element("li", { textContent: sentence(note) }))),
    element("div", { id: "figures", className: "wide" }, table(["Figure", "Value", "Limit", "Margin"], rows)));
}
