/** Paths to begin with, as somebody might draw them: [[x, y], ...] in metres on the pan; and pans. */

const curve = (count, pointAt) => Array.from({ length: count + 1 }, (_, k) => pointAt(k / count));
const turn = (share) => 2 * Math.PI * share;

export const EXAMPLES = [
  { name: "Circle", points: curve(90, (s) => [-0.055 * Math.cos(turn(s)), 0.055 * Math.sin(turn(s))]) },
  { name: "Eight", points: curve(120, (s) => [0.07 * Math.sin(turn(s)), 0.035 * Math.sin(turn(2 * s))]) },
  { name: "Strokes", points: [[-0.06, 0.04], [0.055, 0.04], [-0.055, -0.04], [0.06, -0.04]] },
  {
    name: "Signature",
    points: curve(240, (s) => [
      -0.056 + 0.11 * s + 0.018 * Math.sin(turn(3 * s)),
      (0.009 + 0.027 * (1 - s)) * (1 - Math.cos(turn(3 * s))) - 0.022 + 0.012 * s,
    ]),
  },
];

/** Friction at rest and while sliding on pans that people have, roughly: `slide-identify` finds that of yours. */
export const PANS = [
  { name: "Iron, as in the paper (μ 1.0, μ′ 0.5)", static: 1, kinetic: 0.5 },
  { name: "Iron, seasoned (μ 0.6, μ′ 0.4)", static: 0.6, kinetic: 0.4 },
  { name: "Steel (μ 0.8, μ′ 0.6)", static: 0.8, kinetic: 0.6 },
  { name: "Rubber mat (μ 1.2, μ′ 0.8)", static: 1.2, kinetic: 0.8 },
  { name: "Non-stick, worn (μ 0.4, μ′ 0.3)", static: 0.4, kinetic: 0.3 },
  { name: "Non-stick, new (μ 0.3, μ′ 0.25)", static: 0.3, kinetic: 0.25 },
  { name: "PTFE, polished (μ 0.15, μ′ 0.1)", static: 0.15, kinetic: 0.1 },
];

/**
 * Limits of a pan that an arm holds (m, m/s, m/s^2, m/s^3; no speed is no limit on it): of Franka's arms those that are
 * published of their hand, of the others what their joints allow in every direction.
 */
const LEVEL = { pan_reach: 0.2, height: 0, speed: null, acceleration: 30, jerk: 10_000 };
const PANDA = { ...LEVEL, speed: 1.7, acceleration: 13, jerk: 6500 };
const FR3 = { ...LEVEL, speed: 3, acceleration: 9, jerk: 4500 };
export const ARMS = [
  { name: "The planner’s own, level", limits: LEVEL },
  { name: "The planner’s own, lifting", limits: { ...LEVEL, height: 0.1 } },
  { name: "Franka Panda, level", arm: "panda", limits: PANDA },
  { name: "Franka Panda, lifting", arm: "panda", limits: { ...PANDA, height: 0.1 } },
  { name: "Franka FR3, level", arm: "fr3", limits: FR3 },
  { name: "Franka FR3, lifting", arm: "fr3", limits: { ...FR3, height: 0.1 } },
  { name: "UR5e, level", arm: "ur5e", limits: { ...LEVEL, speed: 0.9 } },
  { name: "UR10e, level", arm: "ur10e", limits: { ...LEVEL, speed: 1.2 } },
  { name: "xArm 6, level", arm: "xarm6", limits: { ...LEVEL, speed: 0.8, acceleration: 19 } },
  { name: "LBR iiwa 14, level", arm: "iiwa14", limits: { ...LEVEL, speed: 0.7 } },
];
