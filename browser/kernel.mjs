/** Compiles the network's kernel:  node kernel.mjs FILE  (default out/kernel.wasm). */

import { mkdirSync } from "node:fs";
import { dirname, join, resolve } from "node:path";
import { argv } from "node:process";
import { fileURLToPath } from "node:url";

import asc from "assemblyscript/asc";

const here = dirname(fileURLToPath(import.meta.url));

export async function buildKernel(file) {
  mkdirSync(dirname(resolve(file)), { recursive: true });
  const options = ["-O3", "--noAssert", "--runtime", "stub", "--enable", "simd"];
  const { error, stderr } = await asc.main(
    ["kernel/kernel.ts", "--baseDir", here, "--outFile", resolve(file), ...options],
  );
  if (error) throw new Error(`${error.message}\n${stderr}`);
}

if (argv[1] === fileURLToPath(import.meta.url)) await buildKernel(argv[2] ?? join(here, "out", "kernel.wasm"));
