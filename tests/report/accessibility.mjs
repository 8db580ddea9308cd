// A report, or a page of the served site, in a real browser, judged by axe-core; not part of
// pytest, as it needs npm.
//
//   npm install --prefix FOLDER axe-core playwright-core
//   NODE_PATH=FOLDER/node_modules node tests/report/accessibility.mjs build/go1/report/index.html
//
// Prints violations and console errors of the light and the dark page; exit 1 when any violation
// is serious or critical, or the console has an error.
import { createRequire } from "node:module";
import { resolve } from "node:path";

const require = createRequire(`${process.env.NODE_PATH}/x.js`);
const { chromium } = require("playwright-core");
const axe = require.resolve("axe-core/axe.min.js");
const given = process.argv[2];
const page_file = given.startsWith("http") ? given : `file://${resolve(given)}`;

const browser = await chromium.launch({
  executablePath: process.env.CHROMIUM || "/usr/bin/chromium",
  args: ["--no-sandbox", "--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"],
});
let bad = 0;
for (const colorScheme of ["light", "dark"]) {
  const page = await browser.newPage({ colorScheme });
  page.on("console", (m) => {
    if (m.type() === "error") bad += console.log("console:", m.text()) || 1;
  });
  page.on("pageerror", (e) => { bad += console.log("error:", e.message) || 1; });
  const began = Date.now();
  await page.goto(page_file);
  await page.waitForFunction(() => {
    const view = document.getElementById("viewer");
    return !view || view.dataset.frames;
  }, null, { timeout: 60000 });
  const seconds = ((Date.now() - began) / 1000).toFixed(1);
  await page.evaluate(() => document.querySelectorAll("details").forEach((d) => { d.open = true; }));
  await page.addScriptTag({ path: axe });
  const { violations, passes } = await page.evaluate(() => window.axe.run());
  console.log(`${colorScheme}: first view after ${seconds} s, ${passes.length} rules passed`);
  for (const v of violations) {
    console.log(`  ${v.impact}: ${v.id}: ${v.help} (${v.nodes.length}): ${v.nodes[0].target}`);
    if (["serious", "critical"].includes(v.impact)) bad += 1;
  }
  await page.close();
}
await browser.close();
process.exit(bad ? 1 : 0);
