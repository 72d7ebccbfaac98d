// Writes the bundle that the package holds; the same sources and lock file give the same bytes.

import { build } from "esbuild";
import { readFileSync, writeFileSync } from "node:fs";
import { readFile } from "node:fs/promises";

const out = "../core/modalmotion/viewer/bundle";

// Texts of three.js's own materials, 160 kB: the viewer has one shader, which includes two of them.
const KEPT = ["colorspace_pars_fragment", "tonemapping_pars_fragment"];
const withoutMaterials = {
  name: "without-materials",
  setup(builder) {
    builder.onLoad({ filter: /three\.module\.js$/ }, async ({ path }) => {
      const text = await readFile(path, "utf8");
      const chunk = /^(var|const) (\w+) = "(?:[^"\\]|\\.)*";$/gm;
      return { contents: text.replace(chunk, (all, kind, name) => (all.length > 90 && !KEPT.includes(name) ? `${kind} ${name} = "";` : all)) };
    });
  },
};

const common = { bundle: true, minify: true, charset: "utf8", legalComments: "none", external: ["node:*"], plugins: [withoutMaterials], target: "es2022" };

await build({ ...common, entryPoints: ["src/page.js"], format: "esm", outfile: `${out}/viewer.js` });
await build({ ...common, entryPoints: ["src/style.css"], outfile: `${out}/viewer.css` });
const licence = readFileSync("node_modules/three/LICENSE", "utf8").trim();
const { version } = JSON.parse(readFileSync("node_modules/three/package.json", "utf8"));
writeFileSync(`${out}/LICENSES.txt`, `viewer.js holds three.js ${version}:\n\n${licence}\n`);
