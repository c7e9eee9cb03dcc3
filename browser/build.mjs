/** Writes the page that plans by itself:  node browser/build.mjs FOLDER  (default out/site/plan). */

import { createHash } from "node:crypto";
import { cpSync, mkdirSync, readFileSync, readdirSync, rmSync, statSync, writeFileSync } from "node:fs";
import { dirname, join, relative } from "node:path";
import { fileURLToPath } from "node:url";
import { constants, gzipSync } from "node:zlib";

import { build } from "esbuild";

import { buildKernel } from "./kernel.mjs";

const here = dirname(fileURLToPath(import.meta.url));
const root = dirname(here);
const out = process.argv[2] ?? join(root, "out", "site", "plan");
const model = join(root, "runtime", "models", "default");

const sha256 = (bytes) => createHash("sha256").update(bytes).digest("hex");

/** Files of a folder and of those in it, by their paths from it. */
const filesIn = (folder) => readdirSync(folder, { recursive: true, withFileTypes: true })
  .filter((each) => each.isFile()).map((each) => relative(folder, join(each.parentPath, each.name))).sort();

rmSync(out, { recursive: true, force: true });
mkdirSync(join(out, "model"), { recursive: true });
cpSync(join(root, "server", "static"), out, { recursive: true });
cpSync(join(root, "runtime", "report", "viewer"), join(out, "viewer"), { recursive: true });
await buildKernel(join(out, "kernel.wasm"));

// The graphs are compressed here: hosts do not compress what they do not know. Weights have no patterns, only rare values.
const manifest = readFileSync(join(model, "manifest.json"));
writeFileSync(join(out, "model", "manifest.json"), manifest);
for (const { file, sha256: said } of Object.values(JSON.parse(manifest).graphs)) {
  const graph = readFileSync(join(model, file));
  if (sha256(graph) !== said) throw new Error(`${join(model, file)}: its sha256 is not the manifest's`);
  writeFileSync(join(out, "model", `${file}.packed`), gzipSync(graph, { level: 9, strategy: constants.Z_FILTERED }));
}
cpSync(join(root, "runtime", "arms", "shipped"), join(out, "arms"), { recursive: true });

const page = join(out, "index.html");
const marks = '<meta name="planner" content="local.js">\n<meta name="documents" content="../index.html">';
const marked = readFileSync(page, "utf8").replace("<head>", `<head>\n${marks}`);
writeFileSync(page, marked);

const options = { bundle: true, format: "esm", minify: true, target: "es2022", absWorkingDir: here, legalComments: "none" };
await build({ ...options, entryPoints: ["src/local.ts", "src/worker.ts"], outdir: out });

// The page's own licence, and that of each package that is part of it.
const packages = Object.entries(JSON.parse(readFileSync(join(here, "package-lock.json"), "utf8")).packages);
const shipped = packages.filter(([path, { dev }]) => path && !dev).map(([path, { version, license }]) => {
  const name = path.replace("node_modules/", ""), file = readdirSync(join(here, path)).find((each) => /^licen[cs]e/i.test(each));
  return `${name} ${version}: ${license}\n\n${file ? readFileSync(join(here, path, file), "utf8") : ""}`;
});
writeFileSync(join(out, "licences.txt"), [`slide-planner\n\n${readFileSync(join(root, "LICENSE"), "utf8")}`, ...shipped].join("\n\n"));

const loaded = ["kernel.wasm", ...filesIn(join(out, "model")).map((name) => `model/${name}`)];
const digest = createHash("sha256");
for (const name of filesIn(out)) digest.update(name).update(readFileSync(join(out, name)));
const version = `slide-planner-${digest.digest("hex").slice(0, 16)}`;
writeFileSync(join(out, "files.json"), JSON.stringify({
  version,
  sha256: sha256(manifest),
  sizes: Object.fromEntries(loaded.map((name) => [name, statSync(join(out, name)).size])),
}));
await build({
  ...options,
  entryPoints: ["src/sw.ts"],
  outdir: out,
  define: { VERSION: JSON.stringify(version), FILES: JSON.stringify(["./", ...filesIn(out)]) },
});
const sent = filesIn(out).reduce((sum, name) => sum + gzipSync(readFileSync(join(out, name))).length, 0);
console.log(`${out}: ${version}, ${(sent * 1e-6).toFixed(2)} MB compressed`);
