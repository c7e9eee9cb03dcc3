/** The report: the plan in this page's data block, with what it was made for, and with other motions beside it. */

import { $, element, mm, number, swatch } from "./viewer/dom.js";
import { GRAVITY, distances, motionOf } from "./viewer/motion.js";
import { table } from "./viewer/quality.js";
import { Viewer } from "./viewer/viewer.js";

const report = JSON.parse($("report").textContent);
const motion = motionOf(report);
const keys = element("span", { className: "keys" });
keys.innerHTML = "<kbd>space</kbd> plays, <kbd>←</kbd> <kbd>→</kbd> step, <kbd>P</kbd> holds the pan";
const viewer = new Viewer({ beside: [keys] });

function fillHead() {
  const { model, friction } = report;
  const bold = (text) => element("b", { textContent: text });
  document.title = `Sliding plan, ${model.name}`;
  $("title").textContent = `${number(report.samples * report.dt)} s of shaking a pan`;
  $("intro").append(
    "Planned by ", bold(model.name), " for friction ", bold(`${friction.static} static`), " and ",
    bold(`${friction.kinetic} kinetic`), ". The object lies loose on the pan. As long as the pan accelerates by less " +
    `than μg\u00a0=\u00a0${number(motion.breakaway)}\u00a0m/s², static friction carries the object along; shaken ` +
    "harder, it breaks away and slides, and so it is made to follow the command." +
    (motion.lifts ? " The pan also rises and sinks: as it sinks, the object weighs less and slides more easily." : ""));
}

function fillFooter() {
  const { model, samples, dt } = report, { radius, time } = motion;
  const drawn = time.length < samples ? `, of which ${number(time.length, 0)} are drawn; the figures are of all` : "";
  $("footer").textContent =
    `Model ${model.name}, sha256 ${model.sha256}. ${number(samples, 0)} samples, one every ${dt * 1e3} ms${drawn}. ` +
    `g = ${GRAVITY} m/s². The pan has a radius of ${mm(radius.pan)} mm, the object one of ${mm(radius.object)} mm.`;
}

function fillComparison() {
  const { quality, tracks } = report;
  if (!tracks.length) return;
  const atEnd = distances(motion.object, motion.command).at(-1);
  const rows = [["object", "as planned", quality.tracking_rmse, quality.tracking_max, atEnd, null]];
  tracks.forEach((track, index) => rows.push([motion.tracks[index].kind, track.name,
    track.tracking_rmse, track.tracking_max, track.end_distance, track.pan_deviation_max]));
  const textOf = (length) => length === null ? "" : mm(length);
  $("tracks").append(table(["mm", "error, RMS", "largest", "at the end", "pan off by"],
    rows.map(([kind, name, ...lengths]) => [[swatch(kind), name], ...lengths.map(textOf)])));
  $("tracks").hidden = false;
}

/** Follow an address like `#t=0.6&frame=pan`; says whether it named a time. */
function followAddress() {
  const wanted = new URLSearchParams(location.hash.slice(1));
  const t = Number.parseFloat(wanted.get("t"));
  $("still").checked = wanted.get("frame") === "pan";
  if (Number.isFinite(t)) viewer.player.seek(t); else viewer.player.show();
  return Number.isFinite(t);
}

fillHead();
fillFooter();
fillComparison();
viewer.load(motion);
if (!followAddress()) viewer.begin();
addEventListener("hashchange", followAddress);
document.body.dataset.ready = "true";
