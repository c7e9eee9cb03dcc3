/** Command files in the browser become what they become in Python, or are refused in a line. */

import assert from "node:assert/strict";
import { test } from "node:test";

import { readCommand } from "../src/index.js";
import { farthest, flat, recorded } from "./recorded.js";

const bytes = (text: string): Uint8Array => new TextEncoder().encode(text);

test("files become the commands that Python makes of them", () => {
  for (const { content, position } of recorded.tables) {
    assert.ok(farthest(readCommand(bytes(content)).position, flat(position)) < 1e-12, content.slice(0, 40));
  }
});

test("what is no command is refused in words", () => {
  const wrong: [string | Uint8Array, RegExp][] = [
    ["", /empty/],
    ["hello", /no rows/],
    ["a,b\n1,2\n3,4\n", /line 1: missing column x among a, b/],
    ["1,2,3\n4,5,6\n", /no header/],
    ["t,x,y\n0,0,0\n1,zwei,0\n", /line 3, column x: zwei is not a finite number/],
    ["t,x,y\n0,0,0\n1,inf,0\n", /line 3, column x: inf is not a finite number/],
    ["t,x,y\n0,0,0\n1,0\n", /line 3: has 2 cells, the header has 3/],
    ["t,x,y\n0,0,0\n0,0.1,0\n", /t must increase: t\[1\] = 0 s \(line 3\)/],
    ["t,x,y\n0,0,0\n1,50,0\n", /goes 50 m from its first position/],
    ["t,x,y\n0,0,0\n0.002,0.4,0\n", /jumps/],
    ["t,x,y\n0,0,0\n9000,0.1,0\n", /spans 9000 s/],
    ["x,y\n0,0\n0.01,0\n0.02,0\n", /no times/],
    ["t,x_mm,y\n0,0,0\n1,1,1\n", /different units/],
    ["{", /no JSON/],
    ["[1, 2]", /keys "dt"/],
    ['{"position": [[0, 0], [0, 0.1]]}', /exactly one/],
    ['{"dt": 0, "position": [[0, 0], [0, 0.1]]}', /greater than 0/],
    ['{"dt": 1, "position": [[0, 0], [0, null]]}', /position\[1\]/],
    ['{"t": [0], "position": [[0, 0], [0, 0.1]]}', /list of 2/],
    ['{"dt": 1, "position": [[0, 0], [0, 0.1]], "colour": 1}', /unknown key colour/],
    ["<svg></svg>", /SVG drawing is read by slide-plan/],
    [Uint8Array.of(0x93, 78, 85, 77, 80, 89), /npy file/],
    [Uint8Array.of(0x89, 80, 78, 71, 13, 10), /picture/],
    [Uint8Array.of(200, 0, 200, 0, 13, 10), /no text/],
  ];
  for (const [content, words] of wrong) {
    assert.throws(() => readCommand(typeof content === "string" ? bytes(content) : content), { message: words });
  }
});
