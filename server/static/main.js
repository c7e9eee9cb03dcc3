/** The page: a path is drawn or taken, planned by the server or the page itself once the pen is lifted, and played. */

import { curlOf, localPlanner, requestCommand, requestInfo } from "./api.js";
import { copy, csvOf, film, plotsAsSvg, saveFile } from "./download.js";
import { History, decode, encode } from "./drawing.js";
import { ArmCard } from "./arm_card.js";
import { Closing } from "./closing.js";
import { Controls } from "./controls.js";
import { EXAMPLES } from "./examples.js";
import { later, withNextFrame } from "./frames.js";
import { OwnStream } from "./own_stream.js";
import { DT, commandAlong, commandDocument, keepWithin, lengthOf } from "./path.js";
import { listenToPen } from "./pen.js";
import { Planning, toldOf } from "./planning.js";
import { Stream } from "./stream.js";
import { $, element, mm, number } from "./viewer/dom.js";
import { RADIUS } from "./viewer/motion.js";
import { Viewer, calm } from "./viewer/viewer.js";

const REACH = 0.15;  // m from the start of a path, unless the planner's model was trained on another
const SETTLED = 250;  // ms after the last change of a slider, until it is planned with
let mostReach = () => REACH, mostBytes;

const redraw = element("button", { id: "redraw", type: "button", className: "plain", textContent: "Draw again" });
const closing = new Closing();
const viewer = new Viewer({ beside: [...closing.parts, redraw], idle: showDraft, onShow: showBeside, later });
const armCard = new ArmCard();
const planning = new Planning();
const controls = new Controls(change);
const history = new History();

/**
 * What is on the pan, and what follows from it: the command, from points drawn or from a file that was `given`.
 * `planned` is the last answer: {asked, body, text, plan, motion, told}.
 */
const draft = { drawn: EXAMPLES[1].points, given: null, down: false, pen: null, command: null };
let planned = null, settling = 0, made = {};

const pen = listenToPen(viewer.stage, {
  mayDraw: () => !viewer.plays,
  begins: () => {
    if (closing.closed) return false;  // then a pointer pulls the object
    planning.stop();
    if (viewer.plays) drawAgain();
    return true;
  },
  show: (points, { down, pen: at }) => {
    const lifted = draft.down && !down;
    Object.assign(draft, { drawn: points, given: null, down, pen: at });
    if (down) drawSoon();
    if (down && !draft.command) return;
    if (!lifted) planning.stop();
    markExample(null);
    update();
  },
  ends: () => {
    if (draft.command) plan();
    const { drawn, given } = draft;
    setTimeout(() => remember({ drawn, given }));  // the server plans meanwhile
  },
});

const drawSoon = withNextFrame(() => draft.down && showDraft());

/** The friction and the limits, as a server is told them. */
const optionsNow = () => ({ friction: controls.friction, ...(controls.limited && { limits: controls.limits }) });

/** What is asked of the server for what is on the pan now; null if that is no path. */
function requestNow() {
  const { command, given } = draft;
  if (!command) return null;
  command.document ??= given ? { dt: DT, position: command.positions } : commandDocument(command.positions);
  return { command: command.document, ...optionsNow() };
}

/** The command of what is drawn; null if that is too short. */
function drawnCommand() {
  const { drawn } = draft, { speed } = controls, reach = mostReach(), { length } = drawn;
  if (made.drawn !== drawn || made.length !== length || made.speed !== speed || made.reach !== reach) {
    made = { drawn, length, speed, reach, command: commandAlong(drawn, { speed, reach }) };
  }
  return made.command;
}

/** Work out the command again, and show it. */
function update() {
  draft.command = draft.down ? null : draft.given ?? drawnCommand();
  controls.show();
  armCard.suggest(controls.arm);
  $("plan").setAttribute("aria-disabled", String(!draft.command));
  $("plan").textContent = planning.busy ? "Planning…" : planned ? "Plan again" : "Plan";
  $("undo").disabled = !history.canUndo;
  $("redo").disabled = !history.canRedo;
  $("summary").textContent = summary();
  $("stage-card").classList.toggle("stale", isStale());
  if (!viewer.plays) showDraft();
}

/** Whether what is played is of another path, or another friction, than what is on the pan now. */
const isStale = () => viewer.plays && planned?.asked !== JSON.stringify(requestNow());

function summary() {
  const { command, down, drawn } = draft;
  if (down) return "";
  if (!command) return drawn.length ? "Too short a path: draw on." : "Draw a path on the pan, or take an example.";
  const { rest = 0 } = command, duration = (command.positions.length - 1 - rest) * DT;
  const still = rest ? `, and ${number(rest * DT, 1)} s at rest` : "";
  const parts = [`${number(command.length * 100, 0)} cm in ${number(duration, 2)} s${still}.`];
  if (viewer.plays) parts.push(isStale() ? "Not planned yet." : planned.told);
  if (command.shrunk < 1) {
    parts.push(`Shrunk to ${number(command.shrunk * 100, 0)} %, to stay within ${mm(mostReach())} mm of its start.`);
  }
  if (command.notes?.length) parts.push(`Of the file: ${command.notes.join("; ")}.`);
  return parts.join(" ");
}

function showDraft() {
  viewer.stage.drawDraft({ drawn: draft.drawn, positions: draft.command?.positions, pen: draft.pen });
  $("hint").hidden = draft.down;
  $("hint").textContent = draft.pen ? "Arrow keys draw, with Shift finely; Enter plans, Esc clears" : "Draw on the pan";
}

/** What else is shown of the moment t (s) that is played. */
function showBeside(t) {
  closing.show();
  armCard.show(viewer.player.motion, t);
}

/** Play a motion; or, if it is null, let the pan at rest be drawn on. */
function turnTo(motion, { beside = false } = {}) {
  const plays = motion !== null;
  if (!beside) closing.leave();
  $("stage-card").dataset.mode = plays ? "play" : "draw";
  $("transport").hidden = $("chip").hidden = !plays;
  $("hint").hidden = plays;
  $("stage").setAttribute("aria-label",
    plays ? "The frying pan from above; on the moving pan the object slides along the path"
      : "Drawing area: the frying pan from above");
  $("stage").setAttribute("role", plays ? "img" : "application");
  viewer.load(motion, { beside });
}

/** What is followed in closed loop: the plan that is played. */
function beginLoop() {
  planning.stop();
  return planned;
}

function playLoop(loop) {
  turnTo(loop ?? planned.motion, { beside: loop !== null });
  viewer.player.play(true);
  update();
}

function drawAgain() {
  planning.stop();
  pen.lift();
  draft.pen = null;
  turnTo(null);
  $("quality").hidden = true;  // it is of what lay here before
  armCard.show(null, 0);
  update();
}

/** Keep what is on the pan: in the history, and in the address, so that it survives a reload. */
function remember(drawing) {
  if (drawing.drawn.length > 1) history.add(drawing);
  keepInAddress();
  update();
}

function keepInAddress() {
  if (draft.drawn.length < 2) return;
  globalThis.history.replaceState(null, "", `#${encode({ points: draft.drawn, ...controls.kept })}`);
}

/** Put a drawing on the pan and plan it. */
function take(drawing, example = null) {
  Object.assign(draft, { given: null, pen: null }, drawing);
  markExample(example);
  drawAgain();
  keepInAddress();
  plan();
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

/** Say what is wrong, and bring it into sight: on a phone it may lie far from what one has done. */
function complain(message) {
  say(message);
  bringIntoSight("message");
}

const bringIntoSight = (id) => $(id).scrollIntoView({ block: "nearest", behavior: calm() ? "auto" : "smooth" });

/** Plan what is on the pan: soon any way, and then the best way there is time for. */
async function plan() {
  clearTimeout(settling);
  const request = requestNow();
  if (!request) {
    complain("There is no path yet: draw one on the pan, or take an example.");
    return;
  }
  say("");
  const token = $("token").value, whole = JSON.stringify(request);
  try {
    const { positions } = draft.command, options = optionsNow();
    const answers = planning.ask(request, positions, token);
    update();
    for await (const answer of answers) show({ ...answer, positions, options }, whole);
  } catch (error) {
    if (error.name === "AbortError") return;
    if (error.status === 401) askForToken();
    complain(error.message);
  } finally {
    update();
  }
}

function show({ body, text, plan: document, motion, took, better, positions, options }, whole) {
  const before = planned?.asked === whole && viewer.plays ? viewer.player : null;
  planned = { asked: whole, body, text, plan: document, motion, positions, options };
  planned.told = toldOf(took, motion.quality, better);
  const paused = before && !before.playing ? before.t : null;
  $("how").hidden = true;
  $("quality").hidden = false;
  for (const part of [$("copy"), $("curl").parentElement]) part.hidden = body === null;
  if (body) $("curl").textContent = curlOf(body, $("token").value !== "");
  turnTo(motion);
  update();
  if (paused !== null) {
    viewer.player.seek(paused);
    return;
  }
  viewer.begin();
  if (!before) later(() => bringIntoSight("stage-card"));
}

/** Get to know who plans, from now on with the token that is given. */
function getReady() {
  planning.own = findPlanner();
  return planning.own.catch((error) => say(error.message));
}

/** Find out who plans: the page's own planner where no server answers, null where one does. */
async function findPlanner() {
  const info = await requestInfo($("token").value, askForToken);
  const own = info ? null : await localPlanner(say);
  planning.mayAsk(info?.settings);
  mostBytes = info?.settings.max_body;
  const { model } = info ?? own?.info ?? {};
  takeFrom(model);
  $("limits-row").hidden = own !== null && !model.trained_on.pan_reach;  // else its own limits hold
  $("interface").hidden = own !== null;
  closing.offer(streamsOf(info, own));
  showLinks(info?.links ?? {});
  return own;
}

/** What opens a stream for the closed loop; null if nothing does. */
function streamsOf(info, own) {
  if (own) return (request) => new OwnStream(own, request);
  return info ? (request) => new Stream(request, $("token").value) : null;
}

/** A server that wants a token says nothing of itself before it is given. */
const askForToken = () => { $("token-row").hidden = false; };

/** Where there is more to read, as far as whoever runs this says so; addresses come from the server. */
function showLinks(links) {
  for (const id of ["documents", "source"]) {
    const address = links[id] ?? document.querySelector(`meta[name=${id}]`)?.content;
    const { href, protocol } = new URL(address ?? "", document.baseURI);
    if (address && /^https?:$/.test(protocol)) Object.assign($(id), { href, hidden: false });
  }
}

/** Whatever differs from what the page takes for granted: the model's name, and what it was trained on. */
function takeFrom(model) {
  const known = model?.trained_on;
  if (!known) return;
  const farthest = known.reach?.[1] ?? REACH;  // of a network for every pan as a share of the pan's own reach
  mostReach = known.pan_reach ? () => farthest * controls.limits.pan_reach : () => farthest;
  const { sizes } = model;
  if (sizes) Object.assign(RADIUS, { pan: sizes.pan_radius, object: sizes.object_radius });
  controls.takeFrom(model);
  $("footer").textContent = `Model ${model.name}, sha256 ${model.sha256}.`;
  update();
}

async function openFile() {
  const [file] = $("file").files;
  $("file").value = "";
  if (!file) return;
  say("");
  try {
    const own = await planning.own.catch(() => null);
    const { positions, notes } = own ? await own.read(file)
      : await requestCommand(file, controls.speed, $("token").value, mostBytes);
    const drawn = positions.filter((_, k) => k % 5 === 0 || k === positions.length - 1);
    const drawing = { drawn, given: { positions, notes, length: lengthOf(drawn), shrunk: 1 } };
    history.add(drawing);
    take(drawing);
  } catch (error) {
    if (error.status === 401) askForToken();
    complain(error.message);
  }
}

async function saveFilm() {
  $("film").disabled = true;
  $("film").textContent = "Filming…";
  const made = await film(viewer.stage.canvas, viewer.player);
  Object.assign($("film"), { disabled: false, textContent: "Film" });
  if (made) saveFile(`plan.${made.ending}`, made.blob); else complain("This browser makes no films.");
}

/** A slider was moved: plan again, once it rests. */
function change() {
  if (draft.drawn.length > 1) keepInAddress();
  planning.stop();
  update();
  clearTimeout(settling);
  if (planned && draft.command) settling = setTimeout(plan, SETTLED);
}

function listen() {
  closing.listen(viewer.stage, { begin: beginLoop, take: playLoop, play: () => viewer.player.play(true), say });
  for (const { name, points } of EXAMPLES) {
    const button = element("button", { type: "button", className: "plain", textContent: name });
    button.addEventListener("click", () => {
      history.add({ drawn: points, given: null });
      take({ drawn: points }, name);
    });
    $("examples").append(button);
  }
  $("controls").addEventListener("submit", (event) => {
    event.preventDefault();
    plan();
  });
  $("undo").addEventListener("click", () => take(history.undo()));
  $("redo").addEventListener("click", () => take(history.redo()));
  addEventListener("keydown", (event) => {
    if (event.key.toLowerCase() !== "z" || !(event.ctrlKey || event.metaKey) || event.target.closest("#token")) return;
    event.preventDefault();
    $(event.shiftKey ? "redo" : "undo").click();
  });
  redraw.addEventListener("click", () => {
    drawAgain();
    $("stage").focus();
  });
  $("file").addEventListener("change", openFile);
  $("token").addEventListener("change", getReady);
  $("share").addEventListener("click", () => {
    keepInAddress();
    $("link").textContent = location.href;
    copy(location.href, $("link"));
  });
  $("download").addEventListener("click", () => saveFile("plan.json", planned.text, "application/json"));
  $("csv").addEventListener("click", () => saveFile("plan.csv", csvOf(planned.plan), "text/csv"));
  $("drawing").addEventListener("click", () => {
    viewer.drawAll();
    saveFile("plots.svg", plotsAsSvg($("plots")), "image/svg+xml");
  });
  $("film").addEventListener("click", saveFilm);
  $("copy").addEventListener("click", () => copy($("curl").textContent, $("curl")));
}

function start() {
  listen();
  const linked = decode(location.hash.slice(1));
  if (linked) {
    controls.restore(linked);
    draft.drawn = linked.points.map((point) => keepWithin(point, RADIUS.pan - RADIUS.object));
  } else {
    markExample(EXAMPLES[1].name);
  }
  history.add({ drawn: draft.drawn, given: null });
  update();
  getReady().then(() => linked && plan());
  document.body.dataset.ready = "true";
}
start();
