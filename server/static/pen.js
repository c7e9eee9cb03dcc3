/** The pen: a path from the mouse, a finger or the arrow keys, kept on the pan. */

import { keepWithin, lengthOf } from "./path.js";
import { RADIUS } from "./viewer/motion.js";

const reach = () => RADIUS.pan - RADIUS.object;  // m from the middle of the pan: there the object touches the rim
const MOST = 2.5;  // m: then the ink is out
const GRAIN = 0.0008;  // m: closer points tell nothing but the tremor of the hand
const STEP = 0.005, FINE_STEP = 0.001;  // m: what an arrow key draws, and with Shift

const ARROWS = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] };

/**
 * Let people draw on the stage's canvas.
 *
 * @param stage  the Stage, which knows where on the pan a pointer is
 * @param mayDraw  () => whether the pan lies still, to be drawn on with keys
 * @param begins  () before a stroke of the pointer, which lays the pan still
 * @param show  (points, {down, pen}) after every change: the points (m), whether the pen is down, and where a pen
 *   moved by keys is, or null
 * @param ends  () when a path is drawn: the pointer is lifted, or Enter pressed
 */
export function listenToPen(stage, { mayDraw, begins, show, ends }) {
  const { canvas } = stage;
  let points = [], length = 0, down = false, byKeys = false;

  function begin(point) {
    points = [keepWithin(point, reach())];
    length = 0;
  }
  function add(point) {
    const next = keepWithin(point, reach());
    const piece = lengthOf([points.at(-1), next]);
    if (piece < GRAIN || length + piece > MOST) return;
    points.push(next);
    length += piece;
  }
  const tell = () => show(points, { down, pen: byKeys ? points.at(-1) : null });

  canvas.addEventListener("pointerdown", (event) => {
    if (event.button !== 0 || down || !begins(event)) return;
    event.preventDefault();
    canvas.focus({ preventScroll: true, focusVisible: false });
    canvas.setPointerCapture(event.pointerId);
    down = true;
    byKeys = false;
    begin(stage.toMetres(event));
    tell();
  });
  canvas.addEventListener("pointermove", (event) => {
    if (!down) return;
    const passed = event.getCoalescedEvents?.() ?? [];
    for (const each of passed.length ? passed : [event]) add(stage.toMetres(each));
    tell();
  });
  for (const end of ["pointerup", "pointercancel"]) {
    canvas.addEventListener(end, () => {
      if (!down) return;
      down = false;
      tell();
      ends();
    });
  }

  canvas.addEventListener("keydown", (event) => {
    if (!mayDraw() || event.ctrlKey || event.metaKey || event.altKey) return;
    const arrow = ARROWS[event.key];
    if (arrow) {
      if (!byKeys) begin([0, 0]);
      byKeys = true;
      const step = event.shiftKey ? FINE_STEP : STEP;
      const [x, y] = points.at(-1);
      add([x + arrow[0] * step, y + arrow[1] * step]);
    } else if (event.key === "Enter" && byKeys) {
      event.preventDefault();
      ends();
      return;
    } else if (event.key === "Escape") {
      points = [];
      byKeys = false;
    } else {
      return;
    }
    event.preventDefault();
    tell();
  });

  return { lift: () => { byKeys = false; } };
}
