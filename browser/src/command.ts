/**
 * A command from a file, as `slide-plan FILE` reads it: of its kinds, tables and JSON with `position`.
 *
 * A table has a header that names x and y, and t unless it is at 1 kHz; their units may stand behind, as in time_ms and
 * x [mm]. JSON is {"dt", "position"} or {"t", "position"}. Whatever else `slide-plan` reads is refused here by its name.
 */

import { DT } from "./law.js";
import { deviation, resample } from "./resample.js";

export interface Command {
  /** (K * 2) positions relative to the pan's centre (m), at 1 kHz. */
  readonly position: Float64Array;
  /** What was made of the file, for whoever chose it. */
  readonly notes: readonly string[];
}

type Point = readonly [number, number];

interface Points {
  readonly position: readonly Point[];
  readonly t: readonly number[] | null;
  readonly lines: readonly number[] | null;
  readonly notes: readonly string[];
}

const CLOCK_RESOLUTION = 1e-6;  // s
const MAX_DURATION = 600;  // s
const MAX_JUMP = 0.05;  // m from one sample to the next
const MAX_REACH = 0.5;  // m from the first position
const USUAL_SPEED = 1.1;  // m/s
const STEADY = 10;  // samples over which a speed is taken
const MAX_DEVIATION = 1e-3;  // m

/** @throws Error, in words to be shown */
export function readCommand(bytes: Uint8Array): Command {
  if (!bytes.length) throw new Error("the file is empty");
  const text = textOf(bytes), first = text.trimStart()[0];
  if (first === "<") throw new Error(`an SVG drawing ${ELSEWHERE}`);
  return commandOf(first === "{" || first === "[" ? fromJson(text) : fromTable(text));
}

const ELSEWHERE = "is read by slide-plan and by a server, not by this page alone: it reads tables as text, and JSON";

const KINDS: readonly (readonly [string, string])[] = [
  ["\x93NUMPY", `an npy file ${ELSEWHERE}`], ["PK\x03\x04", `an npz file or an Office document ${ELSEWHERE}`],
  ["PAR1", `a Parquet file ${ELSEWHERE}`],
  ["\x89PNG", "a picture is no command"], ["\xff\xd8\xff", "a picture is no command"],
  ["%PDF", "a PDF is no command"], ["\x1f\x8b", "a gzip file is packed: unpack it first"],
];

function textOf(bytes: Uint8Array): string {
  const begin = String.fromCharCode(...bytes.subarray(0, 8));
  for (const [mark, message] of KINDS) if (begin.startsWith(mark)) throw new Error(message);
  const wide = begin.startsWith("\xff\xfe") ? "utf-16le" : begin.startsWith("\xfe\xff") ? "utf-16be" : "utf-8";
  try {
    const text = new TextDecoder(wide, { fatal: true }).decode(bytes);
    if (!text.includes("\0")) return text;
  } catch {
    // said below
  }
  throw new Error("this is no text, and no command that this page can read");
}

function fromJson(text: string): Points {
  let document: unknown;
  try {
    document = JSON.parse(text);
  } catch (error) {
    throw new Error(`this is no JSON: ${(error as Error).message}`);
  }
  const { dt, t, position, ...others } = (Array.isArray(document) ? {} : document) as Record<string, unknown>;
  if (!Array.isArray(position)) throw new Error('JSON must be an object with the keys "dt" (or "t") and "position"');
  const [unknown] = Object.keys(others);
  if (unknown !== undefined) throw new Error(`unknown key ${unknown}, expected t or dt, and position`);
  if ((dt === undefined) === (t === undefined)) throw new Error("exactly one of the keys t and dt is needed");
  const points = position.map((point, row): Point => {
    if (!Array.isArray(point) || point.length !== 2 || !point.every(Number.isFinite)) {
      throw new Error(`position[${row}] must be two finite numbers`);
    }
    return [point[0], point[1]];
  });
  if (dt !== undefined && !(typeof dt === "number" && dt > 0)) throw new Error(`dt must be greater than 0 s, got ${dt}`);
  const times = dt === undefined ? t : points.map((_, k) => k * (dt as number));
  if (!Array.isArray(times) || times.length !== points.length || !times.every(Number.isFinite)) {
    throw new Error(`t must be a list of ${points.length} finite numbers, as there are positions`);
  }
  return { position: points, t: times, lines: null, notes: [] };
}

const DELIMITERS = [";", "\t", ",", "|", null] as const;
const SECONDS: Readonly<Record<string, number>> = {
  s: 1, sec: 1, seconds: 1, ms: 1e-3, milliseconds: 1e-3, us: 1e-6, microseconds: 1e-6, ns: 1e-9, nanoseconds: 1e-9,
};
const METRES: Readonly<Record<string, number>> = {
  m: 1, metres: 1, meters: 1, cm: 1e-2, mm: 1e-3, in: 0.0254, inch: 0.0254, inches: 0.0254,
};
const TIMES = ["t", "time", "timestamp", "sec", "seconds", "stamp"];

interface Row {
  readonly number: number;
  readonly cells: readonly string[];
}

function fromTable(text: string): Points {
  const lines = text.split(/\r\n|\n|\r/).map((line, n) => ({ number: n + 1, line }))
    .filter(({ line }) => line.trim() && !/^\s*(#|%|\/\/)/.test(line));
  if (lines.length < 2) throw new Error("there are no rows: a table has a header, t,x,y, and a row for each position");
  const sample = lines.slice(1, 11).map(({ line }) => line);
  const delimiter = DELIMITERS.reduce((best, each) => (share(sample, each) > share(sample, best) ? each : best));
  const [header, ...rows] = lines.map(({ number, line }): Row => ({ number, cells: split(line, delimiter) }));
  if (header!.cells.some((cell) => Number.isFinite(numberOf(cell, delimiter)))) {
    throw new Error("there is no header: name the columns in a first line, as in t,x,y");
  }
  const names = header!.cells, x = columnOf(names, ["x"], METRES), y = columnOf(names, ["y"], METRES);
  for (const [axis, found] of [["x", x], ["y", y]] as const) {
    if (!found) throw new Error(`line ${header!.number}: missing column ${axis} among ${names.join(", ")}`);
  }
  if (x!.unit !== y!.unit) throw new Error(`${names[x!.index]} and ${names[y!.index]} are in different units`);
  const time = columnOf(names, TIMES, SECONDS);
  const column = (index: number): number[] => rows.map(({ number, cells }) => {
    if (cells.length !== names.length) {
      throw new Error(`line ${number}: has ${cells.length} cells, the header has ${names.length}`);
    }
    const value = numberOf(cells[index]!, delimiter);
    if (!Number.isFinite(value)) {
      throw new Error(`line ${number}, column ${names[index]}: ${cells[index]} is not a finite number`);
    }
    return value;
  });
  const ys = column(y!.index), unit = x!.unit ?? 1, clock = time?.unit ?? 1;
  const inverse = 1 / clock, scaled = (t: number): number => (Number.isInteger(inverse) ? t / inverse : t * clock);
  return {
    position: column(x!.index).map((value, k): Point => [value * unit, ys[k]! * unit]),
    t: time ? column(time.index).map(scaled) : null,
    lines: rows.map(({ number }) => number),
    notes: [...(unit === 1 ? [] : [`scaled by ${unit}`]), ...(clock === 1 ? [] : [`scaled times by ${clock}`])],
  };
}

function columnOf(
  names: readonly string[], wanted: readonly string[], units: Readonly<Record<string, number>>,
): { index: number; unit: number | null } | null {
  const found = names.flatMap((name, index) => {
    const words = name.toLowerCase().split(/[^a-z0-9]+/).filter(Boolean), last = words.at(-1) ?? "";
    const unit = words.length > 1 ? units[last] ?? null : null;
    const plain = unit === null ? words : words.slice(0, -1);
    return plain.length === 1 && wanted.includes(plain[0]!) ? [{ index, unit, rank: wanted.indexOf(plain[0]!) }] : [];
  }).sort((a, b) => a.rank - b.rank);
  return found[0] ?? null;
}

const split = (line: string, delimiter: string | null): string[] => {
  const cells = delimiter === null ? line.trim().split(/\s+/) : line.split(delimiter);
  const plain = cells.map((cell) => cell.trim().replace(/^"(.*)"$/, "$1"));
  return plain.length > 2 && plain.at(-1) === "" ? plain.slice(0, -1) : plain;
};

function share(sample: readonly string[], delimiter: string | null): number {
  const rows = sample.map((line) => split(line, delimiter)), cells = rows.flat();
  if (rows.some((row) => row.length < 2)) return -1;
  return cells.filter((cell) => Number.isFinite(numberOf(cell, delimiter))).length / cells.length;
}

function numberOf(cell: string, delimiter: string | null): number {
  const plain = cell.replace("\u2212", "-");
  const text = delimiter === "," ? plain : plain.replace(",", ".");
  return /^[-+]?(\d+\.?\d*|\.\d+)(e[-+]?\d+)?$/i.test(text.trim()) ? Number(text) : NaN;
}

/** The command at 1 kHz through what was read. */
function commandOf({ position, t, lines, notes: found }: Points): Command {
  const notes = [...found];
  if (position.length < 2) throw new Error(`position has ${position.length} samples, at least 2 are needed`);
  askUnit(position);
  if (t === null) {
    askRate(position);
    notes.push("found no times, and took 1 kHz");
    return { position: checked(Float64Array.from(position.flat())), notes };
  }
  const place = (row: number): string => (lines ? ` (line ${lines[row]})` : "");
  const wrong = t.findIndex((each, k) => k > 0 && !(each - t[k - 1]! >= CLOCK_RESOLUTION));
  if (wrong > 0) {
    throw new Error(`t must increase: t[${wrong}] = ${t[wrong]} s${place(wrong)} does not come after t[${wrong - 1}] = ` +
      `${t[wrong - 1]} s${place(wrong - 1)}`);
  }
  const elapsed = t.map((each) => each - t[0]!), duration = elapsed.at(-1)!;
  if (duration > MAX_DURATION) {
    throw new Error(`t spans ${duration} s, at most ${MAX_DURATION} s are allowed (is it in seconds?)`);
  }
  const grid = Array.from({ length: Math.floor((duration + CLOCK_RESOLUTION) / DT) + 1 }, (_, k) => k * DT);
  if (grid.length < 2) throw new Error(`t spans ${duration} s, at least ${DT} s are needed`);
  const onGrid = grid.length === t.length && grid.every((each, k) => Math.abs(elapsed[k]! - each) <= CLOCK_RESOLUTION);
  if (onGrid) return { position: checked(Float64Array.from(position.flat())), notes };
  const at = grid.map((each) => Math.min(each, duration)), made = resample(elapsed, position, at);
  const left = deviation(elapsed, position, at, made);
  if (left > MAX_DEVIATION) {
    notes.push(`the command leaves the straight lines between its waypoints by ${(left * 1e3).toFixed(1)} mm`);
  }
  return { position: checked(made), notes };
}

function askUnit(position: readonly Point[]): void {
  const [x, y] = position[0]!, far = position.reduce((most, [a, b]) => Math.max(most, Math.hypot(a - x, b - y)), 0);
  if (far <= MAX_REACH) return;
  throw new Error(`the command goes ${Number(far.toPrecision(4))} m from its first position, a pan is 0.4 m wide: are ` +
    "these metres? Write the unit behind the names, as in x_mm, y_mm");
}

function askRate(position: readonly Point[]): void {
  const span = Math.min(STEADY, position.length - 1);
  const steps = position.slice(span).map(([x, y], k) => Math.hypot(x - position[k]![0], y - position[k]![1]) / span);
  const fastest = steps.reduce((a, b) => Math.max(a, b)) / DT;
  if (fastest <= USUAL_SPEED) return;
  throw new Error(`there are no times, and at 1 kHz the command moves at ${Number(fastest.toPrecision(3))} m/s, above ` +
    `the usual ${USUAL_SPEED}: add a column t, in seconds`);
}

function checked(position: Float64Array): Float64Array {
  for (let n = 2; n < position.length; n += 2) {
    const jump = Math.hypot(position[n]! - position[n - 2]!, position[n + 1]! - position[n - 1]!);
    if (jump > MAX_JUMP) {
      throw new Error(`position jumps by ${Number(jump.toPrecision(4))} m at t = ${((n / 2) * DT).toFixed(3)} s, at most ` +
        `${MAX_JUMP / DT} m/s is allowed`);
    }
  }
  return position;
}
