/** Writes the page that plans by itself:  node browser/build.mjs FOLDER  (default out/site/plan). */

import { createHash } from "node:crypto";
import { cpSync, mkdirSync, readFileSync, readdirSync, rmSync, statSync, writeFileSync } from "node:fs";
import { dirname, join, relative } from "node:path";
import { fileURLToPath } from "node:url";

import { build } from "esbuild";

const here = dirname(fileURLToPath(import.meta.url));
const root = dirname(here);
const out = process.argv[2] ?? join(root, "out", "site", "plan");
const model = join(root, "runtime", "models", "default");
const runtime = join(here, "node_modules", "onnxruntime-web", "dist", "ort-wasm-simd-threaded.wasm");

/** Files of a folder and of those in it, by their paths from it. */
const filesIn = (folder) => readdirSync(folder, { recursive: true, withFileTypes: true })
  .filter((each) => each.isFile()).map((each) => relative(folder, join(each.parentPath, each.name))).sort();

rmSync(out, { recursive: true, force: true });
mkdirSync(out, { recursive: true });
cpSync(join(root, "server", "static"), out, { recursive: true });
cpSync(join(root, "runtime", "report", "viewer"), join(out, "viewer"), { recursive: true });
cpSync(model, join(out, "model"), { recursive: true });
cpSync(runtime, join(out, "onnxruntime.wasm"));

const page = join(out, "index.html");
const marked = readFileSync(page, "utf8").replace("<head>", '<head>\n<meta name="planner" content="local.js">');
writeFileSync(page, marked);

const options = { bundle: true, format: "esm", minify: true, target: "es2022", absWorkingDir: here, legalComments: "none" };
await build({ ...options, entryPoints: ["src/local.ts", "src/worker.ts"], outdir: out });

// Each package that is part of the page, with its licence.
const lock = JSON.parse(readFileSync(join(here, "package-lock.json"), "utf8")).packages;
const shipped = ["onnxruntime-web", "onnxruntime-common"];
writeFileSync(join(out, "licences.txt"), shipped.map((name) => {
  const { version, license } = lock[`node_modules/${name}`];
  return `${name} ${version}: ${license}, https://www.npmjs.com/package/${name}\n`;
}).join(""));

const loaded = ["model/manifest.json", "model/encoder.onnx", "model/decoder_step.onnx", "onnxruntime.wasm"];
const digest = createHash("sha256");
for (const name of filesIn(out)) digest.update(name).update(readFileSync(join(out, name)));
const version = `slide-planner-${digest.digest("hex").slice(0, 16)}`;
writeFileSync(join(out, "files.json"), JSON.stringify({
  version,
  sha256: createHash("sha256").update(readFileSync(join(out, "model", "manifest.json"))).digest("hex"),
  sizes: Object.fromEntries(loaded.map((name) => [name, statSync(join(out, name)).size])),
}));
await build({
  ...options,
  entryPoints: ["src/sw.ts"],
  outdir: out,
  define: { VERSION: JSON.stringify(version), FILES: JSON.stringify(["./", ...filesIn(out)]) },
});
console.log(`${out}: version ${version}`);
