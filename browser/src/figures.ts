/** Numbers of many rows, and how they are written. */

/** A number in so many digits, as Python's `:.4g` has it. */
export const g = (value: number, digits = 6): string => String(Number(value.toPrecision(digits)));

export const words = (name: string): string => name.replaceAll("_", " ");

export const distances = (a: Float64Array, b: Float64Array): Float64Array =>
  lengths(a.map((value, n) => value - b[n]!), 2, 0, 2, a.length / 2);

/** Euclidean lengths of `axes` columns of rows of so many numbers. */
export function lengths(rows: Float64Array, width: number, first: number, axes: number, count: number): Float64Array {
  return Float64Array.from({ length: count }, (_, k) =>
    Math.hypot(...rows.subarray(width * k + first, width * k + first + axes)));
}

export const largest = (values: Float64Array): number => values.reduce((a, b) => Math.max(a, b), -Infinity);

export const rootMeanSquare = (values: Float64Array): number =>
  Math.sqrt(values.reduce((sum, each) => sum + each * each, 0) / values.length);
