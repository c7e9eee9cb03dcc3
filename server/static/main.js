/** The page: a path is drawn or taken, planned by the server, and played. */

import { curlOf, requestInfo, requestPlan } from "./api.js";
import { $, element, number, swatch } from "./dom.js";
import { listenToPen } from "./pen.js";
import { EXAMPLES } from "./examples.js";
import { motionOf } from "./motion.js";
import { DT, commandAlong, commandDocument } from "./path.js";
import { Player } from "./player.js";
import { Plots } from "./plots.js";
import { showQuality } from "./quality.js";
import { Stage } from "./stage.js";
import { copyCurl, saveFile } from "./download.js";

const REACH = 0.15;  // m from the start of a path, unless the server's model was trained on another
const LONG = 1.5;  // s, the same for its duration
const trainedOn = { reach: REACH, duration: LONG };

const stage = new Stage($("stage"));
const player = new Player(showMotion);
const plots = new Plots($("plots"), player);

/** What is drawn, what is asked of it, and the last answer: all that the page shows follows from these. */
const draft = { drawn: EXAMPLES[1].points, down: false, pen: null, command: null };
let planned = null;  // {body, text, motion}, or null before the first plan
let planning = false;

const pen = listenToPen(stage, () => !playing(), (points, { down, pen: at }) => {
  Object.assign(draft, { drawn: points, down, pen: at });
  if (down) {
    requestAnimationFrame(() => draft.down && showDraft());
    if (draft.command === null) return;
  }
  markExample(null);
  update();
});

const playing = () => $("stage-card").dataset.mode === "play";
const valueOf = (id) => $(id).valueAsNumber;

/** The body of the request for what is on the pan now; null if that is no path. */
function bodyNow() {
  if (!draft.command) return null;
  const friction = { static: valueOf("static"), kinetic: valueOf("kinetic") };
  return JSON.stringify({ command: commandDocument(draft.command.positions), friction });
}

/** Work out the command again, and show it. */
function update() {
  const asked = { speed: valueOf("speed"), reach: trainedOn.reach };
  draft.command = draft.down ? null : commandAlong(draft.drawn, asked);
  $("speed-value").textContent = `${number(asked.speed, 2)} m/s`;
  for (const id of ["static", "kinetic"]) $(`${id}-value`).textContent = number(valueOf(id), 2);
  $("plan").setAttribute("aria-disabled", String(planning || !draft.command));
  $("plan").textContent = planning ? "Planning…" : playing() ? "Plan again" : "Plan";
  if (!planning) $("summary").textContent = summary();
  if (!playing()) showDraft();
}

function summary() {
  const { command, down, drawn } = draft;
  if (playing() && planned && bodyNow() === planned.body) return planned.told;
  if (down) return "";
  if (!command) return drawn.length ? "Too short a path: draw on." : "Draw a path on the pan, or take an example.";
  const duration = (command.positions.length - 1) * DT;
  const parts = [`${number(command.length * 100, 0)} cm in ${number(duration, 2)} s.`];
  if (playing()) parts.unshift("Not planned yet:");
  if (command.shrunk < 1) {
    parts.push(`Shrunk to ${number(command.shrunk * 100, 0)} %, to stay within ` +
      `${number(trainedOn.reach * 1e3, 0)} mm of its start.`);
  }
  if (duration > trainedOn.duration) {
    parts.push(`Longer than the ${number(trainedOn.duration)} s that the model was trained on: it may follow less well.`);
  }
  return parts.join(" ");
}

function showDraft() {
  stage.drawDraft({ drawn: draft.drawn, positions: draft.command?.positions, pen: draft.pen });
  $("hint").hidden = draft.down;
  $("hint").textContent = draft.pen ? "Arrow keys draw, with Shift finely; Esc clears" : "Draw on the pan";
}

function showMotion() {
  stage.drawMotion(player.motion, Math.min(player.t, player.motion.end), $("still").checked);
  plots.show();
}

/** Turn between drawing on the pan at rest and playing the plan. */
function turnTo(mode) {
  $("stage-card").dataset.mode = mode;
  const plays = mode === "play";
  $("transport").hidden = $("chip").hidden = !plays;
  $("hint").hidden = plays;
  $("stage").setAttribute("aria-label",
    plays ? "The frying pan from above; on the moving pan the object slides along the path"
      : "Drawing area: the frying pan from above");
  $("stage").setAttribute("role", plays ? "img" : "application");
  stage.resize();
}

function drawAgain() {
  player.load(null);
  pen.lift();
  draft.pen = null;
  turnTo("draw");
  update();
}

function markExample(name) {
  for (const button of $("examples").children) {
    button.setAttribute("aria-pressed", String(button.textContent === name));
  }
}

function say(message) {
  $("message").textContent = message;
  $("message").hidden = !message;
}

async function plan(event) {
  event.preventDefault();
  const body = bodyNow();
  if (planning) return;
  if (!body) {
    say("There is no path yet: draw one on the pan, or take an example.");
    return;
  }
  planning = true;
  say("");
  update();
  try {
    const answer = await requestPlan(body, $("token").value);
    planned = { body, text: answer.text, motion: motionOf(answer.plan) };
    planned.told = `Planned ${number(planned.motion.end, 2)} s of motion in ${number(answer.took, 0)} ms.`;
  } catch (error) {
    if (error.status === 401) $("token-row").hidden = false;
    say(error.message);
    return;
  } finally {
    planning = false;
    update();
  }
  showPlan(planned.motion);
}

function showPlan(motion) {
  turnTo("play");
  $("how").hidden = true;
  for (const id of ["quality", "plots"]) $(id).hidden = false;
  $("curl").textContent = curlOf(planned.body, $("token").value !== "");
  showQuality(motion.quality);
  plots.load(motion);
  player.load(motion);
  update();
  const calm = matchMedia("(prefers-reduced-motion: reduce)").matches;
  $("stage-card").scrollIntoView({ block: "nearest", behavior: calm ? "auto" : "smooth" });
  if (calm) player.seek(motion.end * 0.6); else player.play(true);
}

/** Whatever differs from what the page takes for granted: the model's name, and what it was trained on. */
async function askServer() {
  const info = await requestInfo();
  const known = info?.model?.trained_on;
  if (!known) return;
  trainedOn.reach = known.reach?.[1] ?? REACH;
  trainedOn.duration = known.samples ? known.samples[1] * DT : LONG;
  for (const id of ["static", "kinetic", "speed"]) if (known[id]) $(id).max = known[id][1];
  for (const id of ["static", "kinetic"]) if (known[id]) $(id).min = known[id][0];
  $("footer").textContent = `Model ${info.model.name}, sha256 ${info.model.sha256}.`;
  update();
}

function listen() {
  for (const { name, points } of EXAMPLES) {
    const button = element("button", { type: "button", className: "plain", textContent: name });
    button.addEventListener("click", () => {
      draft.drawn = points;
      markExample(name);
      drawAgain();
    });
    $("examples").append(button);
  }
  for (const id of ["speed", "static", "kinetic"]) {
    $(id).addEventListener("input", () => {  // friction at rest is never less than while sliding
      if (id === "static" && valueOf("kinetic") > valueOf("static")) $("kinetic").value = valueOf("static");
      if (id === "kinetic" && valueOf("static") < valueOf("kinetic")) $("static").value = valueOf("kinetic");
      update();
    });
  }
  $("controls").addEventListener("submit", plan);
  $("redraw").addEventListener("click", () => {
    drawAgain();
    $("stage").focus();
  });
  $("download").addEventListener("click", () => saveFile("plan.json", planned.text));
  $("copy").addEventListener("click", copyCurl);
}

function layOut() {
  stage.resize();
  player.recolor();
  plots.resize();
  if (playing()) player.show(); else showDraft();
}

function start() {
  listen();
  markExample(EXAMPLES[1].name);
  $("stage-legend").append(...[
    ["command", "path drawn"], ["object", "path taken"], ["pan", "pan centre’s path"], ["pan dotted", "its limit"],
  ].map(([kind, name]) => element("span", {}, swatch(kind), name)), "dial: the pan’s acceleration, its ring at μg");
  update();
  addEventListener("resize", layOut);
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", layOut);
  askServer();
  document.body.dataset.ready = "true";
}
start();
