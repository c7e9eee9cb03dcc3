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
  { name: "Non-stick, worn (μ 0.4, μ′ 0.3)", static: 0.4, kinetic: 0.3 },
  { name: "Rubber mat (μ 1.2, μ′ 0.8)", static: 1.2, kinetic: 0.8 },
];
