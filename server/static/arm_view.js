/** The arm in three dimensions, holding the pan: drawn by three.js, which is loaded with this module alone. */

import { Arm, parseArm } from "./arm.js";
import { RADIUS, locate, pointAt, stateAt, valueAt } from "./viewer/motion.js";
import * as THREE from "./three/three.js";

const LINK_RADIUS = 0.05;  // m, where an arm's description has none
const THICK = 0.012;  // m: how high the object is, and the pan's rim
const HANDLE = 0.22;  // m, from the pan's middle to the flange
const STATE = { sticks: "--pan", slides: "--object", "off the pan": "--bad" };
const UP = new THREE.Vector3(0, 1, 0);  // along which three.js makes cylinders
const DRAG = 0.008;  // rad a pixel

const vector = (point) => new THREE.Vector3(...point);
const paint = (color, more = {}) =>
  new THREE.MeshStandardMaterial({ color, roughness: 0.55, metalness: 0.15, ...more });

export class ArmView {
  #renderer;
  #scene = new THREE.Scene();
  #camera = new THREE.PerspectiveCamera(38, 1, 0.05, 20);
  #turn = { around: -0.9, above: 0.42 };
  #arm = null;
  #body = new THREE.Group();

  /**
   * @param canvas  to draw on
   * @throws Error, in words to be shown, where the browser draws nothing in three dimensions
   */
  constructor(canvas) {
    this.canvas = canvas;
    try {
      this.#renderer = new THREE.WebGLRenderer({ canvas, antialias: true, alpha: true });
    } catch {
      throw new Error("This browser draws nothing in three dimensions: it has no WebGL, or it is turned off.");
    }
    this.#camera.up.set(0, 0, 1);
    const sun = new THREE.DirectionalLight("#ffffff", 2.2);
    sun.position.set(1.5, -2, 3);
    this.#scene.add(new THREE.HemisphereLight("#ffffff", "#8a8175", 1.5), sun, this.#body);
    this.#listen();
  }

  /**
   * Draw another arm.
   *
   * @param name  of a description
   * @throws Error, in words to be shown, if it cannot be loaded
   */
  async take(name) {
    const response = await fetch(`arms/${name}.toml`).catch(() => null);
    if (!response?.ok) throw new Error("The arm’s description cannot be loaded: the server may have been stopped.");
    this.#arm = new Arm(parseArm(await response.text()));
    this.#build();
  }

  /** The moment t (s) of a motion, or the pan at rest if that is null; says whether the arm reaches it. */
  show(motion, t) {
    if (!this.#arm) return true;
    this.object.visible = motion !== null;
    let pan = [0, 0, 0];
    if (motion) {
      const place = locate(motion, t);
      pan = [...pointAt(motion.pan, place), valueAt(motion.pan.z, place)];
      this.object.position.set(...pointAt(motion.object, place), THICK / 2);
      this.object.material.color.set(this.#color(STATE[stateAt(motion, t)]));
    }
    const reaches = this.#arm.moveTo(pan);
    if (reaches) this.#pose();
    this.#draw();
    return reaches;
  }

  resize() {
    const { clientWidth: width, clientHeight: height } = this.canvas;
    if (!width) return;
    this.#renderer.setPixelRatio(Math.min(devicePixelRatio, 2));
    this.#renderer.setSize(width, height, false);
    this.#camera.aspect = width / height;
    this.#camera.updateProjectionMatrix();
    this.#draw();
  }

  #color(name) {
    return getComputedStyle(document.documentElement).getPropertyValue(name).trim();
  }

  /** The shapes of the arm: a ball a joint, a rod to the next, and the pan with the object at the end. */
  #build() {
    this.#body.clear();
    const metal = paint("#c9c4ba"), dark = paint("#3c3f45"), iron = paint("#26282b", { metalness: 0.5 });
    const radii = this.#arm.joints.map(({ radius = LINK_RADIUS }) => radius);
    this.balls = radii.map((radius) => new THREE.Mesh(new THREE.SphereGeometry(1.15 * radius, 24, 16), dark));
    this.rods = radii.map((radius) => new THREE.Mesh(new THREE.CylinderGeometry(radius, radius, 1, 24), metal));
    const base = new THREE.Mesh(new THREE.CylinderGeometry(radii[0] * 1.4, radii[0] * 1.7, 0.06, 32), dark);
    base.rotateX(Math.PI / 2);
    base.position.z = 0.03;
    const ground = paint("#b7b0a3", { transparent: true, opacity: 0.35 });
    const floor = new THREE.Mesh(new THREE.CircleGeometry(1.1, 64), ground);
    const { pan: r, object } = RADIUS, length = HANDLE - 0.8 * r;
    const disc = new THREE.Mesh(new THREE.CylinderGeometry(r, r, THICK, 64), iron);
    const rim = new THREE.Mesh(new THREE.TorusGeometry(r + THICK / 2, THICK / 2, 10, 64), iron);
    const handle = new THREE.Mesh(new THREE.CylinderGeometry(0.011, 0.014, length, 16), iron);
    disc.rotateX(Math.PI / 2);
    disc.position.z = -THICK / 2;
    rim.position.z = THICK / 4;
    handle.rotateZ(Math.PI / 2);
    handle.position.x = -(HANDLE - length / 2);
    this.object = new THREE.Mesh(new THREE.CylinderGeometry(object, object, THICK, 32), paint("#d55e00"));
    this.object.rotateX(Math.PI / 2);
    this.pan = new THREE.Group().add(disc, rim, handle, this.object);
    this.#body.add(floor, base, this.pan, ...this.balls, ...this.rods);
    this.#pose();
    this.resize();
  }

  #pose() {
    const { joints, tip, pan } = this.#arm.pose(this.#arm.angles);
    const points = [...joints, tip].map(({ position }) => vector(position));
    this.balls.forEach((ball, k) => ball.position.copy(points[k]));
    this.rods.forEach((rod, k) => between(rod, points[k], points[k + 1]));
    const [x, y, z] = pan.rotation;
    this.pan.matrixAutoUpdate = false;
    this.pan.matrix.set(...x, pan.position[0], ...y, pan.position[1], ...z, pan.position[2], 0, 0, 0, 1);
  }

  #draw() {
    if (!this.#arm) return;
    const { around, above } = this.#turn, middle = vector(this.#arm.place.position).multiplyScalar(0.55);
    middle.z = Math.max(middle.z, 0.18);
    const far = 1.05 + 0.75 * vector(this.#arm.place.position).length();
    const from = new THREE.Vector3().setFromSphericalCoords(1, Math.PI / 2 - above, around + Math.PI / 2);
    const aside = new THREE.Vector3(from.x, -from.z, from.y);
    this.#camera.position.copy(middle).addScaledVector(aside, far / Math.min(1, this.#camera.aspect));
    this.#camera.lookAt(middle);
    this.#renderer.render(this.#scene, this.#camera);
  }

  /** Look from elsewhere: by dragging, or with the arrow keys. */
  #listen() {
    let from = null;
    const look = (dx, dy) => {
      this.#turn.around -= dx * DRAG;
      this.#turn.above = Math.min(Math.max(this.#turn.above + dy * DRAG, 0.05), 1.5);
      this.#draw();
    };
    this.canvas.addEventListener("pointerdown", (event) => {
      from = event;
      this.canvas.setPointerCapture(event.pointerId);
    });
    this.canvas.addEventListener("pointermove", (event) => {
      if (!from) return;
      look(event.clientX - from.clientX, event.clientY - from.clientY);
      from = event;
    });
    for (const end of ["pointerup", "pointercancel"]) this.canvas.addEventListener(end, () => { from = null; });
    const keys = { ArrowLeft: [-12, 0], ArrowRight: [12, 0], ArrowUp: [0, 12], ArrowDown: [0, -12] };
    this.canvas.addEventListener("keydown", (event) => {
      if (!keys[event.key]) return;
      event.preventDefault();
      event.stopPropagation();  // the player's keys are the same
      look(...keys[event.key]);
    });
  }
}

/** Lay a rod of length 1 from one point to another. */
function between(rod, from, to) {
  const way = to.clone().sub(from), length = way.length();
  rod.visible = length > 1e-3;
  if (!rod.visible) return;
  rod.position.copy(from).addScaledVector(way, 0.5);
  rod.scale.set(1, length, 1);
  rod.quaternion.setFromUnitVectors(UP, way.normalize());
}
