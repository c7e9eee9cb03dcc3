/** The pan from above on a canvas in metres, y up: at rest while a path is drawn, shaken when a plan is played. */

import { number, roundStep } from "./dom.js";
import { RADIUS, locate, pointAt, stateAt, valueAt } from "./motion.js";

const BEAT = 50;  // samples between the dots along a command: close where it is slow
const RIM = 1.065;  // of the pan's radius, which is that of its floor: there the object's edge meets the rim
const AROUND = 1.1;  // of the radius: how much is seen of a pan at rest
const FLOOR_STEP = 52;  // pixels at least between the lines of the floor
const COLORS = ["stage-grid", "stage-ink", "pan", "object", "bad", "track-1", "track-2", "track-3", "track-4"];
const ON_PAN = {  // the pan is dark by day and by night
  command: "#f4f0e8", pan: "#4fa9e0", object: "#f27a2a", bad: "#ff8a80",
  "track-1": "#35d0a8", "track-2": "#e79aca", "track-3": "#ecd35c", "track-4": "#b3a8ff",
};
const SHADOW = [0.35, -0.55];  // where a shadow falls, by the height
const OBJECT_COLOR = { sticks: "pan", slides: "object", "off the pan": "bad" };
const CAST_IRON = {
  handle: "#34363a", groove: "#55585e",
  rim: ["#75787e", "#4c4f54", "#2c2e31"], floor: ["#3b3e43", "#26282b", "#17181a"],
  edge: "rgb(255 255 255 / .28)", ring: "rgb(255 255 255 / .05)", shadow: "rgb(0 0 0 / .38)",
};

function disc(x, y, r) {
  const path = new Path2D();
  path.arc(x, y, r, 0, 2 * Math.PI);
  return path;
}

function polyline(points) {
  const path = new Path2D();
  for (const [x, y] of points) path.lineTo(x, y);
  return path;
}

/** The samples of a motion up to a place in time. */
function trace({ x, y }, place) {
  const path = new Path2D();
  for (let i = 0; i <= place.k; i++) path.lineTo(x[i], y[i]);
  path.lineTo(valueAt(x, place), valueAt(y, place));
  return path;
}

export class Stage {
  constructor(canvas) {
    this.canvas = canvas;
    this.context = canvas.getContext("2d");
    this.colors = {};  // of the page, for what lies beside the pan
    this.dashes = {};  // of the tracks
    this.scale = 1;  // pixels per metre
    this.middle = [0, 0];  // of what is drawn, in pixels
    this.place = { x: 0, y: 0, nearer: 1 };  // of the pan in it (m), and how much larger it is drawn
    this.resize();
  }

  /** Take a motion to draw. */
  load(motion) {
    this.motion = motion;
    this.commandPath = trace(motion.command, locate(motion, motion.end));
  }

  resize() {
    const style = getComputedStyle(document.documentElement);
    for (const name of COLORS) {
      this.colors[name] = style.getPropertyValue(`--${name}`);
      this.dashes[name] = style.getPropertyValue(`--${name}-dash`).split(" ").map(Number);
    }
    this.colors.command = this.colors["stage-ink"];
    this.width = this.canvas.clientWidth;
    this.height = this.canvas.clientHeight;
    this.canvas.width = Math.round(this.width * devicePixelRatio);
    this.canvas.height = Math.round(this.height * devicePixelRatio);
    this.sprite = null;  // its colours may have changed
  }

  /** Where on the pan, as it is drawn now, a pointer is: [x, y] in metres. */
  toMetres({ clientX, clientY }) {
    const box = this.canvas.getBoundingClientRect(), { middle, place, scale } = this;
    const x = (clientX - box.left - middle[0]) / scale - place.x, y = (middle[1] + box.top - clientY) / scale - place.y;
    return [x / place.nearer, y / place.nearer];
  }

  /**
   * The pan at rest with a path on it.
   *
   * @param drawn  [[x, y], ...] the pen's points so far (m)
   * @param positions  the command made of them, every millisecond, or null while the pen is down or has drawn nothing
   * @param pen  [x, y] where a pen moved by keys is, or null
   */
  drawDraft({ drawn, positions, pen }) {
    const farthest = (positions ?? []).reduce((most, [x, y]) => Math.max(most, Math.hypot(x, y)), 0) + RADIUS.object;
    this.#begin(Math.max(RADIUS.pan * AROUND, farthest * 1.04), 0);
    this.#floor([0, 0]);
    this.#pan(RADIUS.pan);
    this.place = { x: 0, y: 0, nearer: 1 };
    if (positions) {
      this.#parted(RADIUS.pan, farthest, (colors) => this.#draft(positions, colors));
    } else if (drawn.length) {
      this.#stroke(polyline(drawn), ON_PAN.command, 2.2);
      this.#object(drawn[0], RADIUS.object, ON_PAN.pan);
    }
    if (pen) this.#stroke(disc(...pen, 7 / this.scale), ON_PAN.object, 2);
    this.#end();
  }

  /** A command, with dots along it, and in red where the object would be over the rim. */
  #draft(positions, colors) {
    this.#stroke(polyline(positions), colors.command, 1.5, [5, 5]);
    for (let k = BEAT; k < positions.length - 1; k += BEAT) {
      this.#fill(disc(...positions[k], 2 / this.scale), colors.command);
    }
    for (const [x, y] of positions) {
      if (Math.hypot(x, y) > RADIUS.pan - RADIUS.object + 1e-6) this.#fill(disc(x, y, 2 / this.scale), colors.bad);
    }
    this.#stroke(disc(...positions.at(-1), 5.5 / this.scale), colors.command, 1.8);
    this.#object(positions[0], RADIUS.object, colors.pan);
  }

  /**
   * The pan, the object and the command at time t (s); `still` keeps the pan in the middle and moves the world.
   *
   * The scale is the largest at which all of the motion is seen, an object that leaves the pan included.
   */
  drawMotion(t, still) {
    const { motion } = this, { pan, radius, reachLimit, quality, eye } = motion;
    const place = locate(motion, t), nearest = eye / (eye - (quality.height_max ?? 0));
    const around = Math.max(radius.pan * 1.12, (motion.farthest + radius.object) * 1.04) * nearest;
    this.#begin(still ? around : Math.max((reachLimit ?? 0) * 1.06, motion.reach + around), still ? 0 : 1);
    const [x, y] = pointAt(pan, place);
    const world = still ? [-x, -y] : [0, 0];
    this.#shifted(world, () => this.#floor(world));
    const height = motion.lifts ? valueAt(pan.z, place) : 0;
    this.place = { x: world[0] + x, y: world[1] + y, nearer: eye / (eye - height) };
    this.#shifted([world[0] + x, world[1] + y], () => {
      if (motion.lifts) this.#lift(height, radius.pan);
      this.#pan(radius.pan);
      this.#parted(radius.pan, motion.farthest + radius.object, (colors) => this.#motions(t, place, colors));
    });
    this.#shifted(world, () => this.#reach(place));
    this.#end();
    this.#ruler();
    this.#dial(pointAt(motion.acceleration, place), valueAt(motion.acceleration.z, place));
  }

  /** Show the height z (m) of a pan: seen from above it is the larger the nearer, and its shadow falls farther away. */
  #lift(z, radius) {
    const { context, motion } = this, { eye, heightLimit, quality } = motion;
    const height = Math.max(z + (heightLimit ?? quality.height_max), 0), nearer = eye / (eye - z);
    context.save();
    context.filter = `blur(${(2 + 0.05 * height * this.scale).toFixed(1)}px)`;
    this.#fill(disc(SHADOW[0] * height, SHADOW[1] * height, radius), CAST_IRON.shadow);
    context.restore();
    context.scale(nearer, nearer);
  }

  /** Draw in the colours of the pan what lies on it, and in those of the page what lies beyond its rim. */
  #parted(radius, farthest, draw) {
    if (farthest <= radius * RIM) {
      draw(ON_PAN);
      return;
    }
    const rim = disc(0, 0, radius * RIM), beyond = new Path2D(rim), far = 4 * this.half;
    beyond.rect(-far, -far, 2 * far, 2 * far);
    for (const [region, colors] of [[rim, ON_PAN], [beyond, this.colors]]) {
      this.context.save();
      this.context.clip(region, "evenodd");
      draw(colors);
      this.context.restore();
    }
  }

  /** The command, where each motion has slid so far, the object, and where it should be now. */
  #motions(t, place, colors) {
    const { command, object, tracks, rests, radius } = this.motion;
    this.#stroke(this.commandPath, colors.command, 1.5, [5, 5]);
    for (const track of tracks) {
      this.#stroke(trace(track.object, place), colors[track.kind], 1.6, this.dashes[track.kind]);
      this.#stroke(disc(...pointAt(track.object, place), radius.object), colors[track.kind], 1.6);
    }
    this.#stroke(trace(object, place), colors.object, 2.6);
    for (const k of rests) {  // a dot wherever it came to rest on the way
      if (k <= place.k) this.#fill(disc(object.x[k], object.y[k], 3 / this.scale), colors.pan);
    }
    this.#object(pointAt(object, place), radius.object, colors[OBJECT_COLOR[stateAt(this.motion, t)]]);
    this.#stroke(disc(...pointAt(command, place), 5.5 / this.scale), colors.command, 1.8);
    const { pulled } = this.motion;  // by a pointer, to there
    if (pulled) this.#stroke(polyline([pointAt(object, place), pulled]), colors.command, 3);
  }

  #begin(half, aside) {
    const { context, width, height } = this;
    this.half = half;  // m from the middle to the nearer edges
    this.scale = Math.max(1, Math.min(width, height)) / 2 / half;  // 1: a window may have no size
    this.step = roundStep(FLOOR_STEP / this.scale);
    context.setTransform(devicePixelRatio, 0, 0, devicePixelRatio, 0, 0);
    context.clearRect(0, 0, width, height);
    this.middle = [width / 2 + aside * Math.max(0, width - height) / 2, height / 2];  // aside: room for the handle
    context.translate(...this.middle);
    context.scale(this.scale, -this.scale);
    context.lineCap = context.lineJoin = "round";
  }

  #end() {
    this.context.setTransform(devicePixelRatio, 0, 0, devicePixelRatio, 0, 0);
  }

  #fill(path, color) {
    this.context.fillStyle = color;
    this.context.fill(path);
  }

  /** Strokes a path; width and dashes are in pixels on the screen, given the scale that the context is in. */
  #stroke(path, color, pixels, dash = [], scale = this.scale) {
    const { context } = this;
    context.strokeStyle = color;
    context.lineWidth = pixels / scale;
    context.setLineDash(dash.map((part) => part / scale));
    context.stroke(path);
  }

  #shifted([x, y], draw) {
    this.context.save();
    this.context.translate(x, y);
    draw();
    this.context.restore();
  }

  /** Lines at even distances in the world: they show how the pan moves. */
  #floor([x, y]) {
    const { step } = this, half = step * Math.ceil(Math.hypot(this.width, this.height) / this.scale / step);
    const [left, low] = [-x, -y].map((center) => step * Math.floor(center / step) - half);
    const lines = new Path2D();
    for (let at = 0; at <= 2 * half + step; at += step) {
      lines.moveTo(left + at, low);
      lines.lineTo(left + at, low + 2 * half);
      lines.moveTo(left, low + at);
      lines.lineTo(left + 2 * half, low + at);
    }
    this.#stroke(lines, this.colors["stage-grid"], 1);
  }

  /** The frying pan; drawn once for each scale, because its shadow takes longer than all the rest. */
  #pan(radius) {
    const ratio = this.scale * devicePixelRatio;
    if (this.sprite?.ratio !== ratio || this.sprite.radius !== radius) this.#drawSprite(radius, ratio);
    const { canvas, left, right, half } = this.sprite;
    this.context.save();
    this.context.scale(1, -1);
    this.context.drawImage(canvas, left, -half, right - left, 2 * half);
    this.context.restore();
  }

  #drawSprite(radius, ratio) {
    const right = radius + 0.08, half = right, left = -radius * 2.06 - 0.05;  // m: what pan and shadow cover
    const canvas = document.createElement("canvas");
    canvas.width = Math.max(1, Math.ceil((right - left) * ratio));
    canvas.height = Math.max(1, Math.ceil(2 * half * ratio));
    const context = canvas.getContext("2d");
    context.setTransform(canvas.width / (right - left), 0, 0, -canvas.height / (2 * half), 0, 0);
    context.translate(-left, -half);
    const screen = this.context;
    this.context = context;
    this.#drawPan(radius);
    this.context = screen;
    this.sprite = { canvas, ratio, radius, left, right, half };
  }

  /** The frying pan, its handle towards the robot at negative x. */
  #drawPan(r) {
    const { context } = this;
    const polished = (colors) => {
      const paint = context.createRadialGradient(-r * 0.35, r * 0.4, r * 0.05, 0, 0, r * 1.05);
      colors.forEach((color, index) => paint.addColorStop(index / 2, color));
      return paint;
    };
    const outline = new Path2D();  // handle and disc as one, so that they throw one shadow
    outline.moveTo(-r * 0.96, 0.021);
    outline.bezierCurveTo(-r * 1.22, 0.012, -r * 1.5, 0.011, -r * 1.9, 0.0155);
    outline.arc(-r * 2.06, 0, 0.0165, Math.PI / 2, -Math.PI / 2);
    outline.bezierCurveTo(-r * 1.5, -0.011, -r * 1.22, -0.012, -r * 0.96, -0.021);
    outline.arc(0, 0, r * RIM, Math.PI + 0.12, Math.PI - 0.12);
    const pixels = this.scale * devicePixelRatio;  // a shadow knows no transform
    context.save();
    Object.assign(context, { shadowColor: CAST_IRON.shadow, shadowBlur: 0.03 * pixels });
    Object.assign(context, { shadowOffsetX: 0.008 * pixels, shadowOffsetY: 0.014 * pixels });
    this.#fill(outline, CAST_IRON.handle);
    context.restore();
    this.#stroke(outline, CAST_IRON.edge, 1.5);
    this.#fill(disc(-r * 2.06, 0, 0.0062), this.colors["stage-grid"]);
    this.#stroke(new Path2D(`M${-r * 1.16} 0H${-r * 1.9}`), CAST_IRON.groove, 1);
    this.#fill(disc(0, 0, r * RIM), polished(CAST_IRON.rim));
    this.#fill(disc(0, 0, r), polished(CAST_IRON.floor));
    this.#stroke(disc(0, 0, r * RIM), CAST_IRON.edge, 1.5);
    for (const part of [0.35, 0.6, 0.82]) this.#stroke(disc(0, 0, r * part), CAST_IRON.ring, 1);
  }

  #object(center, radius, color) {
    const { context } = this;
    context.globalAlpha = 0.42;
    this.#fill(disc(...center, radius), color);
    context.globalAlpha = 1;
    this.#stroke(disc(...center, radius), color, 2.2);
    this.#fill(disc(...center, 3.2 / this.scale), color);
  }

  /** Where the pan's centre has been, is and may go: drawn over the pan, which covers most of it. */
  #reach(place) {
    const { pan, reachLimit } = this.motion;
    this.context.globalAlpha = 0.75;
    this.#stroke(trace(pan, place), ON_PAN.pan, 1.5);
    this.context.globalAlpha = 1;
    this.#fill(disc(...pointAt(pan, place), 4 / this.scale), ON_PAN.pan);
    if (reachLimit) this.#stroke(disc(0, 0, reachLimit), this.colors.pan, 1.4, [3, 6]);
  }

  #ruler() {
    const x = 16, y = this.height - 16, length = this.step * this.scale;
    this.#stroke(new Path2D(`M${x} ${y - 5}v5h${length}v-5`), this.colors["stage-ink"], 1.5, [], 1);
    this.context.fillStyle = this.colors["stage-ink"];
    this.context.font = "12px system-ui, sans-serif";
    this.context.fillText(`${number(this.step * 1e3, 0)} mm`, x + 5, y - 6);
  }

  /**
   * The pan's acceleration in the plane as an arrow in a dial, whose ring is mu (g + w), w being that upwards: an
   * object at rest breaks away beyond it.
   */
  #dial([ux, uy], w) {
    const { quality, breakaway: level, static: mu } = this.motion, breakaway = level + mu * w;
    const size = this.width < 480 ? 32 : 44, margin = 14 + size;
    const scale = size / Math.max(quality.acceleration_max, level, 1e-9);
    const [x, y] = [ux * scale, -uy * scale];
    this.#shifted([this.width - margin, margin], () => {
      this.#fill(disc(0, 0, size), this.colors["stage-grid"]);
      this.#stroke(disc(0, 0, breakaway * scale), this.colors["stage-ink"], 1, [3, 3], 1);
      this.#stroke(new Path2D(`M0 0L${x} ${y}`), this.colors.pan, 2.5, [], 1);
      if (Math.hypot(x, y) < 8) return;
      this.context.translate(x, y);
      this.context.rotate(Math.atan2(y, x));
      this.#fill(new Path2D("M4 0L-6 4.5V-4.5z"), this.colors.pan);
    });
  }
}
