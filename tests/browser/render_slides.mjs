// Writes the slides of a Marp deck as one HTML page. Usage: render_slides.mjs MODULES DECK PAGE
import { readFileSync, writeFileSync } from "node:fs";
import { createRequire } from "node:module";
import { pathToFileURL } from "node:url";

const [modules, deck, page] = process.argv.slice(2);
const { Marp } = createRequire(`${modules}/`)("@marp-team/marp-core");
const { html, css } = new Marp({ script: false }).render(readFileSync(deck, "utf8"));
const base = pathToFileURL(deck);
writeFileSync(page, `<!doctype html><title>Slides</title><base href="${base}">
<style>body { margin: 0 } ${css}</style>${html}`);
