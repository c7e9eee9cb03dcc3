/** The document of a plan, as `Plan.save` writes it in Python. */

import { assess } from "./assess.js";
import type { Asked, Planned } from "./decode.js";
import { DT } from "./law.js";
import type { Manifest } from "./network.js";

export function documentOf(
  manifest: Manifest, sha256: string, planned: Planned, position: Float64Array, asked: Asked,
): Record<string, unknown> {
  const samples = position.length / 2, { u, pan, sliding, stop } = planned;
  return {
    format: "slide-plan/2", dt: DT, model: { name: manifest.name, sha256 }, friction: asked.friction,
    command: { position: rows(position, 2, 0, 2, samples) },
    pan: {
      acceleration: rows(u, 3, 0, 3, samples), velocity: rows(pan, 6, 3, 3, samples),
      position: rows(pan, 6, 0, 3, samples),
    },
    stop: { acceleration: rows(stop, 3, 0, 3, stop.length / 3) },
    object: { velocity: rows(sliding, 4, 2, 2, samples), position: rows(sliding, 4, 0, 2, samples) },
    sizes: manifest.sizes,
    quality: assess(manifest, planned, position, asked, manifest.sizes),
  };
}

const rows = (values: Float64Array, width: number, first: number, axes: number, count: number): number[][] =>
  Array.from({ length: count }, (_, k) => [...values.subarray(width * k + first, width * k + first + axes)]);
