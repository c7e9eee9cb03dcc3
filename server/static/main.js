/** The page: a path is drawn or taken, planned by the server or by the page itself, and played. */

import { curlOf, localPlanner, requestInfo, requestPlan } from "./api.js";
import { copyCurl, saveFile } from "./download.js";
import { EXAMPLES } from "./examples.js";
import { DT, commandAlong, commandDocument } from "./path.js";
import { listenToPen } from "./pen.js";
import { $, element, number } from "./viewer/dom.js";
import { RADIUS, motionOf } from "./viewer/motion.js";
import { Viewer, calm } from "./viewer/viewer.js";

const REACH = 0.15;  // m from the start of a path, unless the server's model was trained on another
const LONG = 1.5;  // s, the same for its duration
const trainedOn = { reach: REACH, duration: LONG };

const redraw = element("button", { id: "redraw", type: "button", className: "plain", textContent: "Draw again" });
const viewer = new Viewer({ beside: [redraw], idle: showDraft });

/** What is drawn, what is asked of it, and the last answer: all that the page shows follows from these. */
const draft = { drawn: EXAMPLES[1].points, down: false, pen: null, command: null };
let planned = null;  // {body, text, motion}, or null before the first plan
let planning = false;
let local = null;  // a promise of the page's own planner; of null where a server is behind it

const pen = listenToPen(viewer.stage, () => !viewer.plays, (points, { down, pen: at }) => {
  Object.assign(draft, { drawn: points, down, pen: at });
  if (down) {
    requestAnimationFrame(() => draft.down && showDraft());
    if (draft.command === null) return;
  }
  markExample(null);
  update();
});

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
  $("plan").textContent = planning ? "Planning…" : viewer.plays ? "Plan again" : "Plan";
  if (!planning) $("summary").textContent = summary();
  if (!viewer.plays) showDraft();
}

function summary() {
  const { command, down, drawn } = draft;
  if (viewer.plays && planned && bodyNow() === planned.body) return planned.told;
  if (down) return "";
  if (!command) return drawn.length ? "Too short a path: draw on." : "Draw a path on the pan, or take an example.";
  const duration = (command.positions.length - 1) * DT;
  const parts = [`${number(command.length * 100, 0)} cm in ${number(duration, 2)} s.`];
  if (viewer.plays) parts.unshift("Not planned yet:");
  if (command.shrunk < 1) {
    parts.push(`Shrunk to ${number(command.shrunk * 100, 0)} %, to stay within ` +
      `${number(trainedOn.reach * 1e3, 0)} mm of its start.`);
  }
  if (duration > trainedOn.duration) {
    parts.push(`Longer than the ${number(trainedOn.duration)} s that the model was trained on: ` +
      "it may follow less well.");
  }
  return parts.join(" ");
}

function showDraft() {
  viewer.stage.drawDraft({ drawn: draft.drawn, positions: draft.command?.positions, pen: draft.pen });
  $("hint").hidden = draft.down;
  $("hint").textContent = draft.pen ? "Arrow keys draw, with Shift finely; Esc clears" : "Draw on the pan";
}

/** Play a motion; or, if it is null, let the pan at rest be drawn on. */
function turnTo(motion) {
  const plays = motion !== null;
  $("stage-card").dataset.mode = plays ? "play" : "draw";
  $("transport").hidden = $("chip").hidden = !plays;
  $("hint").hidden = plays;
  $("stage").setAttribute("aria-label",
    plays ? "The frying pan from above; on the moving pan the object slides along the path"
      : "Drawing area: the frying pan from above");
  $("stage").setAttribute("role", plays ? "img" : "application");
  viewer.load(motion);
}

function drawAgain() {
  pen.lift();
  draft.pen = null;
  turnTo(null);
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
    const { positions } = draft.command, { friction } = JSON.parse(body);
    const own = await local;
    const answer = own ? await own.plan(positions, friction) : await requestPlan(body, $("token").value);
    planned = { body, text: answer.text, motion: motionOf(answer.plan), own: own !== null };
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
  $("how").hidden = true;
  for (const id of ["quality", "plots"]) $(id).hidden = false;
  $("curl").textContent = curlOf(planned.body, $("token").value !== "");
  for (const part of [$("copy"), $("curl").parentElement]) part.hidden = planned.own;
  turnTo(motion);
  update();
  $("stage-card").scrollIntoView({ block: "nearest", behavior: calm() ? "auto" : "smooth" });
  viewer.begin();
}

/** Find out who plans: the page's own planner where no server answers, null where one does. */
async function findPlanner() {
  const info = await requestInfo();
  const own = info ? null : await localPlanner(say);
  takeFrom((info ?? own?.info)?.model);
  return own;
}

/** Whatever differs from what the page takes for granted: the model's name, and what it was trained on. */
function takeFrom(model) {
  const known = model?.trained_on;
  if (!known) return;
  trainedOn.reach = known.reach?.[1] ?? REACH;
  trainedOn.duration = known.samples ? known.samples[1] * DT : LONG;
  const { sizes } = model;
  if (sizes) Object.assign(RADIUS, { pan: sizes.pan_radius, object: sizes.object_radius });
  for (const id of ["static", "kinetic", "speed"]) if (known[id]) $(id).max = known[id][1];
  for (const id of ["static", "kinetic"]) if (known[id]) $(id).min = known[id][0];
  $("footer").textContent = `Model ${model.name}, sha256 ${model.sha256}.`;
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
  redraw.addEventListener("click", () => {
    drawAgain();
    $("stage").focus();
  });
  $("download").addEventListener("click", () => saveFile("plan.json", planned.text));
  $("copy").addEventListener("click", copyCurl);
}

function start() {
  listen();
  markExample(EXAMPLES[1].name);
  update();
  local = findPlanner();
  local.catch((error) => say(error.message));
  document.body.dataset.ready = "true";
}
start();
