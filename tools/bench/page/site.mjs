// A published site in Chromium: the first picture over a slow connection, the slider compared with `isonest view`, and
// memory.
// usage: site.mjs ISONEST STORE [--iso VALUE] [--delay MS] [--rate MBIT/S] [--seconds N]
import { mkdtemp, rm } from "node:fs/promises";
import { tmpdir } from "node:os";
import { join } from "node:path";
import { parseArgs } from "node:util";
import { idle, openPage, run, startBrowser, startServer } from "../../view/web/drive.mjs";
import { serveFiles } from "../../../tests/view/static_server.mjs";
import { wander } from "../../../tests/view/wander.mjs";

const kBitsOfByte = 8;
const { positionals, values } = parseArgs({
  allowPositionals: true,
  options: {
    iso: { type: "string" },
    delay: { type: "string", default: "50" },
    rate: { type: "string", default: "50" },
    seconds: { type: "string", default: "60" },
  },
});
const [program, store] = positionals;
const folder = await mkdtemp(join(tmpdir(), "isonest-site-"));
const site = join(folder, "site");
await run(program, "publish", store, "-o", site);
const browser = await startBrowser();

async function firstPicture() {
  const server = await serveFiles(site, { compressed: true, delay: Number(values.delay), rate: (Number(values.rate) * 1e6) / kBitsOfByte });
  const context = await browser.newContext({ viewport: { width: 880, height: 560 } });
  const page = await context.newPage();
  const start = performance.now();
  await page.goto(`${server.url}#${values.iso ? `iso=${values.iso}` : ""}`, { waitUntil: "commit" });
  await page.waitForFunction(() => window.isonest && window.isonest.triangles() > 0, undefined, { timeout: 120_000 });
  const seconds = (performance.now() - start) / 1000;
  const bytes = (of) => of.reduce((sum, request) => sum + request.bytes, 0);
  const ofStore = server.requests.filter((request) => request.path.includes("stores/"));
  const code = server.requests.filter((request) => !request.path.includes("stores/"));
  const triangles = await page.evaluate(() => window.isonest.triangles());
  await context.close();
  await server.end();
  return { seconds, triangles, code_bytes: bytes(code), store_requests: ofStore.length, store_bytes: bytes(ofStore) };
}

/** Milliseconds from a move of the slider to the mesh. */
async function slider(url) {
  const { page, close } = await openPage(browser, url);
  await idle(page);
  const [least, most] = await page.$eval("#iso", (element) => [Number(element.min), Number(element.max)]);
  const kMoves = 24;
  for (let i = 0; i < kMoves; ++i) {
    const value = least + (most - least) * (0.25 + (0.5 * ((i * 7) % kMoves)) / kMoves);
    await page.$eval("#iso", (element, to) => { element.value = to; element.dispatchEvent(new Event("input", { bubbles: true })); }, String(value));
    await page.waitForTimeout(700);
  }
  await idle(page);
  const taken = (await page.evaluate(() => [...window.isonest.latencies()])).sort((a, b) => a - b);
  await close();
  return { meshes: taken.length, median_ms: taken[taken.length >> 1] };
}

for (let i = 0; i < 3; ++i) console.log("first picture", JSON.stringify(await firstPicture()));
const server = await serveFiles(site);
const view = await startServer(program, store, "--port", "0", "--threads", "1");
for (let i = 0; i < 2; ++i) {
  console.log("slider, view", JSON.stringify(await slider(view.url)));
  console.log("slider, site", JSON.stringify(await slider(server.url)));
}
const { page } = await openPage(browser, server.url);
await idle(page);
console.log("random use", JSON.stringify(await wander(page, Number(values.seconds), 31)));
await browser.close();
await server.end();
await view.end();
await rm(folder, { recursive: true });
