/** What is to be said of a plan: its status in plain words, and its figures beside the limits. */

import { $, element, mm, number, svg } from "./dom.js";

const TICK = "M3 8.5l3.2 3.2L13 5", CROSS = "M4 4l8 8M12 4l-8 8", MARK = "M8 3v6M8 12.5v.2";

const STATUS = {
  ok: ["Within limits", TICK, "Every limit holds, and the network was trained on paths of this kind."],
  governed: ["Within limits, governed", TICK,
    "Every limit holds. Where the network asked for more than one allows, the governor gave less; what you see is the " +
    "motion after that."],
  beyond_training_range: ["Beyond the training range", MARK,
    "Every limit holds, but the network was not trained on such a path or such friction: expect it to follow less well."],
  tolerance_missed: ["Tolerance missed", CROSS,
    "Every limit holds, but the object strays farther from the path than was asked for."],
  limit_exceeded: ["Limit exceeded", CROSS, "A limit is passed: a robot must not execute this plan as it is."],
};

const unitsOf = (note) => note.replaceAll("^2", "²").replaceAll("^3", "³").replace(/^./, (first) => first.toUpperCase());

/** Rows of the table: name, unit, value, limit and margin, as they are to be read. */
function rowsOf(quality) {
  const { limits, margins } = quality;
  const free = (name, unit, value) => [name, unit, value, "", ""];
  const bounded = (name, unit, value, limit, format) => {
    const given = limits[limit] != null;
    return [name, unit, format(value), given ? format(limits[limit]) : "none", given ? format(margins[limit]) : ""];
  };
  const round = (value) => number(Number(value.toPrecision(3)), 0);
  return [
    free("Tracking error, RMS", "mm", mm(quality.tracking_rmse)),
    free("Tracking error, largest", "mm", mm(quality.tracking_max)),
    bounded("Pan reach", "mm", quality.pan_reach, "pan_reach", mm),
    bounded("Pan acceleration", "m/s²", quality.acceleration_max, "acceleration", (value) => number(value, 1)),
    bounded("Pan jerk", "m/s³", quality.jerk_max, "jerk", round),
    free("Time sliding", "%", number(quality.sliding_share * 100, 0)),
  ];
}

/** Fill the card with a plan's quality. */
export function showQuality(quality) {
  const [verdict, sign, words] = STATUS[quality.status] ?? [quality.status, MARK, ""];
  $("badge").replaceChildren(svg('viewBox="0 0 16 16" aria-hidden="true"', `<path d="${sign}"/>`), verdict);
  $("badge").className = `badge ${quality.status}`;
  $("explanation").replaceChildren(
    "The object follows the path to ", element("b", { textContent: `${mm(quality.tracking_rmse)} mm` }),
    ` (root mean square), and is never farther from it than ${mm(quality.tracking_max)} mm. ${words}`);
  $("notes").replaceChildren(...quality.notes.map((note) => element("li", { textContent: `${unitsOf(note)}.` })));
  $("notes").hidden = quality.notes.length === 0;
  $("figures").replaceChildren(...rowsOf(quality).map(([name, unit, ...cells]) => element("tr", {},
    element("th", { scope: "row" }, `${name} `, element("small", { textContent: unit })),
    ...cells.map((cell) => element("td", { textContent: cell })))));
}
