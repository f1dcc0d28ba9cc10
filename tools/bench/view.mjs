// How fast `isonest view` is in a real Chromium, and what it uses.
// usage: node tools/bench/view.mjs ISONEST STORE [STORE...] [--moves N] [--memory SIZE]
//
// Prints a table with a column per store: seconds until the server answers, and from the page's start to the first picture
// with a surface; for N moves of the isovalue slider, each after the picture of the last one, milliseconds to the mesh
// and to the picture (median, 95 %); bytes and triangles of a mesh (at most 100,000 triangles; without further
// refinement); the largest heap that the server reported, its peak resident set, and the page's heap. Chromium renders
// in software here, on the same cores as the server, so a picture takes longer than with a graphics card.
import { readFile, stat } from "node:fs/promises";
import { basename } from "node:path";
import { idle, lacks, openPage, run, startBrowser, startServer } from "../view/web/drive.mjs";

const words = process.argv.slice(2);
const option = (name, standard) => {
  const at = words.indexOf(name);
  return at < 0 ? standard : words.splice(at, 2)[1];
};
const moves = Number(option("--moves", 60));
const memory = option("--memory", "1G");
const [program, ...stores] = words;
if (!program || stores.length === 0 || lacks()) {
  console.error(lacks() ?? "usage: node tools/bench/view.mjs ISONEST STORE [STORE...] [--moves N] [--memory SIZE]");
  process.exit(2);
}

const percentile = (list, part) => [...list].sort((a, b) => a - b)[Math.min(list.length - 1, Math.floor(part * list.length))];
const round = (value) => Number(value.toPrecision(3));

/** In the page: moves the slider once to each isovalue, waiting for the picture each time. */
async function slide(isovalues) {
  const { isonest } = window;
  const input = document.querySelector("#iso");
  const frame = () => new Promise((resolve) => requestAnimationFrame(resolve));
  const seen = { picture: [], triangles: [], bytes: [], server: [], heap: 0 };
  for (const iso of isovalues) {
    const meshes = isonest.latencies().length;
    const { received } = isonest.bytes();
    const start = performance.now();
    input.value = String(iso);
    input.dispatchEvent(new Event("input", { bubbles: true }));
    let frames = 0; // pictures drawn before the mesh arrived
    while (isonest.latencies().length === meshes) {
      frames = isonest.frames();
      await frame();
    }
    while (isonest.frames() === frames) await frame();
    seen.picture.push(performance.now() - start);
    seen.triangles.push(isonest.triangles());
    seen.bytes.push(isonest.bytes().received - received);
    seen.server.push(1000 * isonest.header().seconds);
    seen.heap = Math.max(seen.heap, performance.memory?.usedJSHeapSize ?? 0);
  }
  return { ...seen, mesh: isonest.latencies().slice(-isovalues.length) };
}

async function measure(store) {
  const { min_value: least, max_value: largest, nodes } = JSON.parse(await run(program, "info", store, "--json"));
  const started = performance.now();
  const server = await startServer(program, store, "--port", "0", "--memory", memory);
  const answers = (performance.now() - started) / 1000;
  const browser = await startBrowser();
  try {
    const middle = least + 0.5 * (largest - least);
    const { page } = await openPage(browser, `${server.url}#iso=${middle}&target=triangles&triangles=100000`, { viewport: { width: 1440, height: 900 } });
    const first = await page.evaluate(async () => {
      while (!(window.isonest.triangles() > 0)) await new Promise((resolve) => requestAnimationFrame(resolve));
      return new Promise((resolve) => requestAnimationFrame(() => resolve(performance.now() / 1000)));
    });
    await idle(page);
    // Back and forth around the middle of the range, where it begins; never the same value twice in a row.
    const isovalues = Array.from({ length: moves }, (_, i) => least + (largest - least) * (0.5 + 0.3 * Math.sin((i + 1) * 0.37)));
    const before = await page.evaluate(() => window.isonest.longTasks().length);
    const seen = await page.evaluate(slide, isovalues);
    const blocked = await page.evaluate((count) => window.isonest.longTasks().slice(count), before);
    const { heap_bytes: heap } = await (await fetch(new URL("api/status", server.url))).json();
    const peak = /VmHWM:\s+(\d+)/.exec(await readFile(`/proc/${server.pid}/status`, "utf8"))[1];
    const sum = (list) => list.reduce((a, b) => a + b, 0);
    return {
      store, nodes, store_bytes: (await stat(store)).size, memory,
      seconds_to_answer: round(answers), seconds_to_first_picture: round(first),
      slider_to_mesh_ms: { median: round(percentile(seen.mesh, 0.5)), p95: round(percentile(seen.mesh, 0.95)) },
      slider_to_picture_ms: { median: round(percentile(seen.picture, 0.5)), p95: round(percentile(seen.picture, 0.95)) },
      server_ms: { median: round(percentile(seen.server, 0.5)), p95: round(percentile(seen.server, 0.95)) },
      triangles: Math.round(sum(seen.triangles) / moves), bytes_per_mesh: Math.round(sum(seen.bytes) / moves),
      bytes_per_triangle: round(sum(seen.bytes) / sum(seen.triangles)),
      tasks_over_50_ms: blocked.length, longest_task_ms: blocked.length ? Math.max(...blocked) : 0,
      server_heap: heap, server_peak_resident: Number(peak) * 1024, page_heap: seen.heap,
    };
  } finally {
    await browser.close();
    await server.end();
  }
}

const columns = [];
for (const store of stores) columns.push(await measure(store));
const shown = (value) => (typeof value === "object" && "p95" in value ? `${value.median} (${value.p95})` : String(value));
console.log(`| store | ${columns.map(({ store }) => basename(store)).join(" | ")} |\n|---${"|---".repeat(columns.length)}|`);
for (const key of Object.keys(columns[0]).filter((key) => key !== "store"))
  console.log(`| ${key} | ${columns.map((column) => shown(column[key])).join(" | ")} |`);
