// Tests the page of `isonest view` in Chromium. usage: page_test.mjs ISONEST
//
// The store is a bucky ball of 65^3 nodes. The page is compared with the results of commands (`isonest extract` with
// the displayed command, `isonest picture`) and with the values of the volume.
// Exit code 77 with a message: no browser is available.
import assert from "node:assert/strict";
import { spawn } from "node:child_process";
import { once } from "node:events";
import { copyFile, readFile, rename, stat, writeFile } from "node:fs/promises";
import { join } from "node:path";
import { after, before, test as anyTest } from "node:test";
import { idle, lacks, openPage, readPng, run, startBrowser, startServer, temporaryFolder } from "../../tools/view/web/drive.mjs";
import { pictureView, readPly } from "./meshes.mjs";
import { canvas, commandOf, differing, header, open, setRange, state } from "./pages.mjs";
import { wander } from "./wander.mjs";

const [, , program] = process.argv;
const reason = lacks() ?? (/^ +view /m.test(await run(program, "--help")) ? null : "the program was built without isonest view");
if (reason) {
  console.log(`skipped: ${reason}`);
  process.exit(77);
}

const kNodes = 65;
const kWander = Number(process.env.ISONEST_VIEW_SECONDS ?? 5);
const kTimeout = 240_000; // milliseconds per test except the last, for a busy machine
const test = (name, body, timeout = kTimeout) => anyTest(name, { timeout }, body);
let folder, store, server, browser, values;

before(async () => {
  folder = await temporaryFolder();
  store = join(folder.path, "bucky.isonest");
  const volume = join(folder.path, "bucky.h5");
  await run(program, "make-volume", "bucky", "--size", String(kNodes), "-o", volume);
  await run(program, "preprocess", volume, "--unit", "um", "-o", store);
  await run(program, "export", store, "--field", "values", "-o", join(folder.path, "values.raw"));
  const bytes = await readFile(join(folder.path, "values.raw"));
  values = new Float32Array(bytes.buffer, bytes.byteOffset, kNodes ** 3);
  server = await startServer(program, store, "--port", "0");
  browser = await startBrowser();
});
after(async () => {
  await browser?.close();
  if (server) assert.equal((await server.end()).code, 0, "Ctrl-C ends the server cleanly");
  await folder?.end();
  // Ends this program even if a failed test has left something running.
  setTimeout(() => process.exit(process.exitCode ?? 1), 10_000).unref();
});

/** Runs `use` on a page with this fragment, then checks that no faults occurred. */
async function onPage(fragment, use, options) {
  const opened = await openPage(browser, `${server.url}#${fragment}`, options);
  try {
    await idle(opened.page);
    await use(opened.page);
    assert.deepEqual(opened.faults, []);
  } finally {
    await opened.close();
  }
}
test("the page starts with the surface of the suggested isovalue and its error bound", async () => {
  await onPage("", async (page) => {
    const { histogram } = JSON.parse(await run(program, "info", store, "--histogram", "--json"));
    assert.equal((await state(page)).iso, histogram.suggested[0].isovalue);
    const shown = await canvas(page);
    await page.keyboard.press("s");
    await idle(page);
    const without = await canvas(page);
    assert.ok(differing(shown, without) > 0.02, "the surface fills less than 2 % of the picture");
  });
});

test("for a remote store, the page first shows the levels fetched on opening", async (t) => {
  const script = new URL("../support/range_server.py", import.meta.url).pathname;
  const ranges = spawn("python3", [script, folder.path], { stdio: ["ignore", "pipe", "inherit"] });
  let far = null;
  try {
    const [line] = await once(ranges.stdout, "data");
    far = await startServer(program, `${String(line).trim()}bucky.isonest`, "--port", "0").catch((error) => {
      if (!/libcurl/.test(error.message)) throw error;
      t.skip("this build reads no URLs");
      return null;
    });
    if (far === null) return;
    const { page, faults, close } = await openPage(browser, far.url);
    await idle(page);
    assert.deepEqual(faults, []);
    const asked = await page.evaluate(() => performance.getEntriesByType("resource").map(({ name }) => name));
    const of = (path) => asked.filter((url) => url.includes(`/api/${path}?`)).map((url) => new URL(url).searchParams);
    const { first_error: error } = await page.evaluate(() => fetch("api/store").then((answer) => answer.json()));
    assert.ok(error > 0);
    assert.deepEqual(of("histogram").map((query) => query.get("coarse")), ["1"]);
    assert.equal(asked.filter((url) => url.endsWith("/api/histogram")).length, 0, "the whole histogram was asked for");
    const [first, ...finer] = of("surface");
    assert.equal(Number(first.get("error")), error);
    assert.ok(finer.length > 0, "the first surface was not refined");
    assert.ok((await header(page)).triangles > 1000);
    await close();
  } finally {
    ranges.kill();
    if (far !== null) assert.equal((await far.end()).code, 0);
  }
});

test("the slider changes the mesh, and all displayed numbers are the server's", async () => {
  await onPage("iso=0.5&target=triangles&triangles=20000&moving=20000", async (page) => {
    const before = await header(page);
    await setRange(page, "iso", 0.8);
    await idle(page);
    const now = await header(page);
    assert.equal((await state(page)).iso, 0.8);
    assert.notDeepEqual([before.vertices, before.triangles], [now.vertices, now.triangles]);
    assert.ok(now.triangles <= 20000 && now.triangles > 0);
    const told = await page.$eval("#surface-count", (element) => Number(element.textContent.replace(/[^0-9]/g, "")));
    assert.equal(told, now.triangles);
  });
});

for (const [aim, fragment, exact] of [
  ["full resolution", "target=full", true],
  ["an error", "target=error&error=0.02", false],
  ["less than a voxel on the screen", "target=screen&pixels=1", true],
]) {
  test(`at rest the surface is refined to ${aim}: as many triangles as isonest extract makes`, async () => {
    await onPage(`iso=0.5&moving=1000&${fragment}`, async (page) => {
      const shown = await header(page);
      assert.equal(shown.full_resolution, exact);
      const mesh = join(folder.path, "same.ply");
      const report = JSON.parse(await run(program, ...(await commandOf(page, mesh)), "--json"));
      assert.equal(shown.triangles, report.triangles);
      assert.equal(shown.error_bound, report.error_bound);
      const told = await page.$eval("#surface-bound", (element) => element.textContent);
      if (exact) assert.equal(told, "Full resolution");
      else assert.ok(Number(/within ([0-9.e-]+) of the isovalue/.exec(told)[1]) >= shown.error_bound, told);
    });
  });
}

test("at rest the camera determines the resolution: within an invisible distance, or by pixels when near", async () => {
  await onPage("iso=0.5&pixels=12&moving=1000", async (page) => {
    const far = await header(page);
    assert.equal(far.stop, "distance");
    const { eye } = await state(page);
    const { box } = await (await fetch(new URL("api/store", server.url))).json();
    const radius = Math.hypot(...[0, 1, 2].map((i) => box[i + 3] - box[i])) / 2;
    const away = Math.hypot(...[0, 1, 2].map((i) => eye[i] - (box[i] + box[i + 3]) / 2)) - radius;
    const pixel = (2 * away * Math.tan(Math.PI / 12)) / (await page.$eval("#canvas", (canvas) => canvas.height));
    assert.ok(far.distance_bound <= 6 * pixel && far.tolerance > 4.2 * pixel, `${far.tolerance} of ${pixel}`);
    const told = await page.$eval("#surface-bound", (element) => element.textContent);
    assert.ok(Number(/^Within ([0-9.e-]+) µm of the surface at full resolution$/.exec(told)[1]) >= far.distance_bound, told);
    assert.doesNotMatch(await page.$eval(".state", (element) => element.textContent), /needs more than/);
    await page.keyboard.press("ArrowRight");
    await idle(page);
    assert.deepEqual(await header(page), far, "turned a little, another mesh was made");
    for (let i = 0; i < 6; ++i) await page.keyboard.press("+");
    await idle(page);
    const near = await header(page);
    assert.ok(near.triangles > far.triangles, "nearer, but not finer");
    for (let i = 0; i < 14; ++i) await page.keyboard.press("+");
    await idle(page);
    assert.equal((await header(page)).stop, "camera");
    for (let i = 0; i < 20; ++i) await page.keyboard.press("-");
    await idle(page);
    assert.equal((await header(page)).stop, "distance");
  });
});

test("a requested distance is kept and displayed", async () => {
  await onPage("iso=0.5&target=distance&distance=0.5", async (page) => {
    const shown = await header(page);
    assert.equal(shown.stop, "distance");
    const told = await page.$eval("#surface-bound", (element) => element.textContent);
    const bound = Number(/^Within ([0-9.e-]+) µm of the surface at full resolution$/.exec(told)[1]);
    assert.ok(bound >= shown.distance_bound && bound < 0.51, told);
  });
});

test("the clipped mesh is that of isonest extract in the box, and the URL contains the box", async () => {
  await onPage("iso=0.5&target=full", async (page) => {
    const whole = (await header(page)).triangles;
    await open(page, "clipping");
    await page.click("#box-on");
    await setRange(page, "box-0", 30);
    await setRange(page, "box-5", 40);
    await idle(page);
    const shown = await header(page);
    assert.ok(shown.triangles > 0 && shown.triangles < whole);
    const report = JSON.parse(await run(program, "extract", store, "--iso", "0.5", "--box", "30,0,0,64,64,40", "--json", "-o", join(folder.path, "box.ply")));
    assert.equal(shown.triangles, report.triangles);
    await page.waitForFunction(() => location.hash.includes("box=30,0,0,64,64,40"));
  });
});

test("slices show the data in their colours, and follow the mouse", async () => {
  await onPage("surface=0&slice-z=1,20&map=gray", async (page) => {
    const shown = await header(page, "z");
    assert.ok(shown.triangles > 0 && shown.error_bound <= 1.05 / 512 + 1e-9);
    const gray = await canvas(page);
    await open(page, "slices");
    await page.selectOption("#map", "viridis");
    await idle(page);
    assert.ok(differing(gray, await canvas(page)) > 0.05, "another colour map changes nothing");
    const [x, y] = await page.evaluate(() => window.isonest.project([32, 32, 20]));
    await page.locator("#canvas").hover({ position: { x, y } });
    await idle(page);
    await page.mouse.down();
    await page.mouse.move((await page.locator("#canvas").boundingBox()).x + x, (await page.locator("#canvas").boundingBox()).y + y - 60, { steps: 6 });
    await page.mouse.up();
    await idle(page);
    const { slices, eye } = await state(page);
    assert.ok(slices.z.at > 25 && slices.z.at <= 64, `dragged upward, the slice is at ${slices.z.at}`);
    await page.waitForFunction((at) => location.hash.includes(`slice-z=1,${at}`), slices.z.at);
    assert.deepEqual((await state(page)).eye, eye);
  });
});

test("dragging on a slice with the right button changes window and level", async () => {
  await onPage("surface=0&slice-z=1,32", async (page) => {
    const box = await page.locator("#canvas").boundingBox();
    const [x, y] = await page.evaluate(() => window.isonest.project([32, 32, 32]));
    await page.mouse.move(box.x + x, box.y + y);
    await idle(page);
    const { window: before } = await state(page);
    await page.mouse.down({ button: "right" });
    await page.mouse.move(box.x + x - 60, box.y + y, { steps: 4 });
    await page.mouse.up({ button: "right" });
    const { window: after, slices } = await state(page);
    assert.ok(after[1] - after[0] < before[1] - before[0] - 0.1, "to the left makes the window narrower");
    assert.equal(slices.z.at, 32);
  });
});

test("an oblique slice has the values of isonest slice", async () => {
  await onPage("surface=0&slice-o=1,3&turn=30&tilt=20", async (page) => {
    const shown = await header(page, "o");
    await open(page, "export");
    await page.selectOption("#export-subject", "o");
    const report = JSON.parse(await run(program, ...(await commandOf(page, join(folder.path, "slice.ply"))), "--json"));
    assert.ok(report.triangles > 0 && report.error_bound <= shown.error_bound + shown.value_rounding);
  });
});

test("the cursor shows isovalue, position and the nearest node's value", async () => {
  await onPage("iso=0.5&target=full", async (page) => {
    const mesh = join(folder.path, "full.ply");
    await run(program, ...(await commandOf(page, mesh)));
    const { eye, lookAt } = await state(page);
    const toEye = eye.map((part, i) => part - lookAt[i]);
    const place = (await readPly(mesh)).nearestTo(toEye); // the vertex nearest to the eye is visible
    const [x, y] = await page.evaluate((at) => window.isonest.project(at), place);
    await page.locator("#canvas").hover({ position: { x, y } });
    await page.waitForFunction(() => window.isonest.value() !== null);
    await idle(page);
    const found = await page.evaluate(() => window.isonest.value());
    assert.ok(Math.hypot(...found.world.map((part, i) => part - place[i])) < 1, `${found.world} in place of ${place}`);
    assert.ok(Math.abs(found.value - 0.5) < 0.01, `value ${found.value}`);
    const [i, j, k] = found.node;
    assert.equal(found.node_value, values[i + kNodes * (j + kNodes * k)]);
    assert.match(await page.$eval("#readout", (element) => element.textContent), /value 0\.(49|5)/);
  });
});

test("the distance between two points is measured", async () => {
  await onPage("surface=0&slice-z=1,32", async (page) => {
    await open(page, "measuring");
    await page.click("#measure");
    for (const at of [[10, 20, 32], [50, 20, 32]]) {
      const [x, y] = await page.evaluate((place) => window.isonest.project(place), at);
      await page.locator("#canvas").click({ position: { x, y } });
      await page.waitForFunction((count) => window.isonest.points().length === count, at[0] === 10 ? 1 : 2);
    }
    const [a, b] = await page.evaluate(() => window.isonest.points());
    assert.ok(Math.abs(Math.hypot(...a.map((part, i) => part - b[i])) - 40) < 0.5, `from ${a} to ${b}`);
    assert.match(await page.$eval("#measured", (element) => element.textContent), /^(39\.\d+|40(\.\d+)?) µm, from /);
  });
});

test("the saved mesh is byte for byte that of the displayed command", async () => {
  for (const [fragment, format] of [["target=error&error=0.03", "ply"], ["target=full&box=10,10,10,50,50,50", "stl"], ["target=screen&pixels=8", "obj"], ["target=screen&pixels=1", "ply"]]) {
    await onPage(`iso=0.6&${fragment}`, async (page) => {
      const mesh = join(folder.path, `command.${format}`);
      await run(program, ...(await commandOf(page, mesh)));
      await page.selectOption("#export-format", format);
      const [download] = await Promise.all([page.waitForEvent("download"), page.click("#export-mesh")]);
      assert.equal(await download.failure(), null);
      assert.deepEqual(await readFile(await download.path()), await readFile(mesh));
      assert.ok((await stat(mesh)).size > 1000);
    });
  }
});

test("the saved picture is the displayed one", async () => {
  await onPage("iso=0.5&slice-x=1,32", async (page) => {
    await open(page, "export");
    const [download] = await Promise.all([page.waitForEvent("download"), page.click("#export-picture")]);
    const saved = await readPng(await download.path());
    assert.ok(differing(saved, await canvas(page)) < 0.002);
  });
});

test("the picture matches isonest picture from the same viewpoint", async () => {
  const mesh = join(folder.path, "picture.ply");
  const png = join(folder.path, "picture.png");
  await run(program, "extract", store, "--iso", "0.5", "-o", mesh);
  const size = [640, 480];
  const { eye, lookAt } = pictureView(await readPly(mesh), [1, -1.6, 0.9], size);
  await run(program, "picture", mesh, "--view=1,-1.6,0.9", "--plain", "--size", size.join("x"), "-o", png);
  const fragment = `iso=0.5&target=full&projection=orthographic&outline=0&camera=${[...eye, ...lookAt].join(",")}`;
  // Resizes the window, because the panel takes part of its width.
  await onPage(fragment, async (page) => {
    const { width, height } = await page.locator("#canvas").boundingBox();
    const { width: w, height: h } = page.viewportSize();
    await page.setViewportSize({ width: Math.round(w + size[0] - width), height: Math.round(h + size[1] - height) });
    await idle(page);
    const shown = await canvas(page);
    const expected = await readPng(png);
    assert.ok(differing(shown, expected, 40) < 0.01, `${(100 * differing(shown, expected, 40)).toFixed(2)} % of the pixels differ much`);
    assert.ok(differing(shown, expected, 12) < 0.05, `${(100 * differing(shown, expected, 12)).toFixed(2)} % of the pixels differ`);
  });
});

test("the URL's fragment restores the view, and the back button undoes a step", async () => {
  const fragment = "iso=0.62&target=error&error=0.04&slice-y=1,20&slice-o=1,-3&turn=10&tilt=60&window=0.1,0.7&map=magma&box=5,5,5,60,60,60&theme=dark&projection=orthographic";
  let seen;
  await onPage(fragment, async (page) => {
    for (const key of ["ArrowLeft", "ArrowUp", "+"]) await page.keyboard.press(key);
    await page.waitForFunction(() => location.hash.includes("camera="));
    await page.waitForTimeout(400); // until the URL follows
    seen = { url: await page.evaluate(() => location.hash.slice(1)), state: await state(page), header: await header(page) };
  });
  await onPage(seen.url, async (page) => {
    const rounded = (view) => ({ ...view, eye: view.eye.map((part) => Number(part.toPrecision(7))), lookAt: view.lookAt.map((part) => Number(part.toPrecision(7))) });
    assert.deepEqual(rounded(await state(page)), rounded(seen.state));
    assert.equal((await header(page)).triangles, seen.header.triangles);
    await page.keyboard.press(".");
    await page.waitForFunction(() => !location.hash.includes("iso=0.62&"));
    await page.goBack();
    await page.waitForFunction(() => window.isonest.state().iso === 0.62);
    await idle(page);
    assert.equal((await header(page)).triangles, seen.header.triangles);
  });
});

test("invalid entries in the fragment are ignored", async () => {
  await onPage("iso=NaN&box=3,2,1,0,0,0&camera=1,2&slice-z=1,x&triangles=-5&map=nothing&target=all&pixels=0&window=2,1", async (page) => {
    const view = await state(page);
    assert.equal(view.box, null);
    assert.ok(Number.isFinite(view.iso) && view.triangles > 0 && view.pixels > 0 && view.window[0] < view.window[1]);
    assert.equal(view.target, "screen");
    assert.ok((await header(page)).triangles > 0);
  });
});

test("everything can be done with the keyboard", async () => {
  await onPage("iso=0.5", async (page) => {
    const before = await state(page);
    const focused = () => page.evaluate(() => document.activeElement?.id ?? "");
    for (let i = 0; i < 8 && (await focused()) !== "canvas"; ++i) await page.keyboard.press("Tab");
    assert.equal(await focused(), "canvas");
    for (const key of ["ArrowRight", "Shift+ArrowUp", "-", ".", ">", "z", "PageUp", "b", "p", "t", "m"]) await page.keyboard.press(key);
    await idle(page);
    const now = await state(page);
    assert.ok(now.iso > before.iso + 0.1 && now.slices.z.on && now.slices.z.at > before.slices.z.at && now.box && now.facets);
    assert.equal(now.projection, "orthographic");
    assert.notDeepEqual(now.eye, before.eye);
    assert.notDeepEqual(now.lookAt, before.lookAt);
    await page.waitForFunction(() => window.isonest.points().length === 1);
    await page.keyboard.press("h");
    assert.ok(await page.$eval("#help", (dialog) => dialog.open));
    await page.keyboard.press("Escape");
    // Tab reaches every control of the panel, including collapsed sections.
    const reached = new Set();
    for (let i = 0; i < 120; ++i) {
      await page.keyboard.press("Tab");
      const id = await page.evaluate(() => (document.activeElement?.tagName === "SUMMARY" ? document.activeElement.parentElement.id : document.activeElement?.id));
      if (id === "canvas") break;
      reached.add(id);
      if (id === "export" || id === "clipping") await page.keyboard.press("Enter");
    }
    for (const id of ["iso", "iso-number", "target", "pixels", "largest", "slices", "box-0", "box-5-number", "export-format", "export-mesh", "copy-command", "view", "memory"]) {
      assert.ok(reached.has(id), `the Tab key does not lead to ${id}`);
    }
  });
});

test("screen readers get the names of controls and the state of the surface", async () => {
  await onPage("iso=0.5&target=full", async (page) => {
    const { triangles } = await header(page);
    // Coarser surfaces shown meanwhile are announced too; the last announcement is that of the final surface.
    const expected = `Full resolution. ${triangles.toLocaleString("en")} triangles.`;
    await page.waitForFunction((text) => document.querySelector("#live").textContent === text, expected);
    const unnamed = await page.$$eval("input, select, button", (all) =>
      all.filter((one) => !one.ariaLabel && !one.labels?.length && !one.textContent.trim()).map((one) => one.outerHTML));
    assert.deepEqual(unnamed, []);
    assert.equal(await page.$eval("#iso", (element) => element.getAttribute("aria-valuetext")), "0.5");
  });
});

for (const [what, width, height, deviceScaleFactor] of [["a phone's width", 360, 740, 2], ["200 % of a small screen", 640, 400, 2]]) {
  test(`at ${what} nothing is cut off, and the isovalue is reachable`, async () => {
    await onPage("iso=0.5", async (page) => {
      assert.ok((await page.evaluate(() => document.documentElement.scrollWidth)) <= width);
      const box = await page.locator("#iso").boundingBox();
      assert.ok(box.x >= 0 && box.x + box.width <= width && box.y + box.height <= height);
      await page.click("#sheet-toggle");
      await idle(page);
      for (const id of ["slices", "clipping", "measuring", "export", "view", "memory"]) await open(page, id);
      const wide = await page.$$eval("#side *", (all) => all.filter((one) => one.getBoundingClientRect().right > innerWidth + 1).map((one) => one.outerHTML.slice(0, 100)));
      assert.deepEqual(wide, []);
    }, { viewport: { width, height }, deviceScaleFactor });
  });
}

for (const scheme of ["light", "dark"]) {
  test(`in the system's ${scheme} theme, text has a contrast of 4.5`, async () => {
    await onPage("iso=0.5&slice-z=1,32", async (page) => {
      assert.equal(await page.evaluate(() => document.documentElement.dataset.theme), scheme);
      for (const id of ["slices", "clipping", "measuring", "export", "view", "memory"]) await open(page, id);
      assert.deepEqual(await page.evaluate(faintTexts), []);
      await page.click("#theme-switch");
      assert.notEqual(await page.evaluate(() => document.documentElement.dataset.theme), scheme);
    }, { colorScheme: scheme });
  });
}

/** Runs in the page: the WCAG contrast of each text with its background. */
function faintTexts() {
  const context = new OffscreenCanvas(1, 1).getContext("2d", { willReadFrequently: true });
  const over = (color, below) => {
    context.globalCompositeOperation = "copy";
    context.fillStyle = `rgb(${below.join(" ")})`;
    context.fillRect(0, 0, 1, 1);
    context.globalCompositeOperation = "source-over";
    context.fillStyle = color;
    context.fillRect(0, 0, 1, 1);
    return [...context.getImageData(0, 0, 1, 1).data.slice(0, 3)];
  };
  const light = (color) => {
    const [r, g, b] = color.map((part) => (part / 255 <= 0.04045 ? part / 255 / 12.92 : ((part / 255 + 0.055) / 1.055) ** 2.4));
    return 0.2126 * r + 0.7152 * g + 0.0722 * b;
  };
  const background = (element) => {
    if (!element) return [255, 255, 255];
    return over(getComputedStyle(element).backgroundColor, background(element.parentElement));
  };
  const faint = [];
  const walker = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT);
  for (let node = walker.nextNode(); node; node = walker.nextNode()) {
    const element = node.parentElement;
    if (!node.textContent.trim() || !element.checkVisibility() || element.closest("svg")) continue;
    const behind = background(element);
    const [low, high] = [light(behind), light(over(getComputedStyle(element).color, behind))].sort((a, b) => a - b);
    if ((high + 0.05) / (low + 0.05) < 4.5) faint.push(`${node.textContent}: ${((high + 0.05) / (low + 0.05)).toFixed(2)}`);
  }
  return faint;
}

test("data in a plane are shown with their bound and without a surface", async () => {
  const volume = join(folder.path, "plane.raw");
  const plane = join(folder.path, "plane.isonest");
  await writeFile(volume, Buffer.from(Uint8Array.from({ length: 40 * 30 }, (_, i) => 100 + 90 * Math.sin(i % 40) * Math.cos(i / 40))));
  await run(program, "preprocess", volume, "--dims", "40,30", "--type", "uint8", "-o", plane);
  const its = await startServer(program, plane, "--port", "0");
  const { page, faults, close } = await openPage(browser, its.url);
  await idle(page);
  const shown = await header(page, "z");
  assert.ok(shown.triangles > 39 * 29 && shown.triangles <= 2 * 39 * 29, `${shown.triangles} triangles`);
  assert.ok(shown.error_bound + shown.value_rounding < 1, "coarser than a whole number");
  assert.match(await page.$eval("#slice-z-bound", (element) => element.textContent), /^(full resolution|values within 0\.)/);
  assert.equal(await page.locator("#surface").count(), 0);
  assert.deepEqual(faults, []);
  await close();
  await its.end();
});

test("without WebGL the page says so", async () => {
  const other = await startBrowser("--disable-3d-apis");
  try {
    const { page } = await openPage(other, server.url);
    assert.match(await page.$eval("#no-webgl", (element) => element.textContent), /no WebGL 2.*isonest extract/s);
  } finally {
    await other.close();
  }
});

test("the page reports a lost server and continues when it is back", async () => {
  const first = await startServer(program, store, "--port", "0");
  const { port } = new URL(first.url);
  const { page, close } = await openPage(browser, `${first.url}#iso=0.5`);
  await idle(page);
  await first.end();
  await page.waitForFunction(() => window.isonest.banner() === "server");
  assert.match(await page.$eval("#banner", (element) => element.textContent), /does not answer/);
  const second = await startServer(program, store, "--port", port);
  await page.waitForFunction(() => window.isonest.banner() === null);
  await idle(page);
  await setRange(page, "iso", 0.7);
  await idle(page);
  assert.equal(await page.evaluate(() => window.isonest.banner()), null);
  assert.ok((await header(page)).triangles > 0);
  await close();
  await second.end();
});

test("the page reports a replaced or truncated store with a remedy", async () => {
  for (const how of ["replaced", "cut off"]) {
    const copy = join(folder.path, "copy.isonest");
    await copyFile(store, copy);
    const its = await startServer(program, copy, "--port", "0");
    const { page, close } = await openPage(browser, `${its.url}#iso=0.5`);
    await idle(page);
    if (how === "replaced") {
      await copyFile(store, `${copy}.new`);
      await rename(`${copy}.new`, copy);
    } else {
      await writeFile(copy, (await readFile(store)).subarray(0, 100_000));
    }
    await page.waitForFunction(() => window.isonest.banner() === "store");
    const told = await page.$eval("#banner", (element) => element.textContent);
    assert.match(told, /start isonest view/i);
    assert.match(told, new RegExp(how));
    await close();
    await its.end();
  }
});

test("the page shows the server's error messages with their remedies", async () => {
  const { page, close } = await openPage(browser, `${server.url}#iso=0.5`);
  await idle(page);
  const body = JSON.stringify({ error: { kind: "limit", message: "the mesh is too large; allow a larger error", remedies: [{ kind: "larger_error", value: "", text: "allow a larger error" }] } });
  await page.route("**/api/surface?**", (route) => route.fulfill({ status: 413, contentType: "application/json", body }));
  await setRange(page, "iso", 0.7);
  await page.waitForFunction(() => window.isonest.banner() === "request");
  assert.equal(await page.$eval("#banner p", (element) => element.textContent), "The mesh is too large; allow a larger error");
  assert.equal(await page.$$eval("#banner p", (all) => all.length), 1);
  await page.unroute("**/api/surface?**");
  await page.click("#try-again");
  await idle(page);
  assert.equal(await page.evaluate(() => window.isonest.banner()), null);
  await close();
});

test("requests without a token are refused with instructions", async () => {
  const its = await startServer(program, store, "--port", "0", "--token");
  const { page, faults, close } = await openPage(browser, `${its.url}#iso=0.5`);
  await idle(page);
  assert.ok((await header(page)).triangles > 0);
  assert.deepEqual(faults, []);
  await close();
  const without = await openPage(browser, its.url.replace(/\?.*/, ""));
  assert.match(await without.page.$eval("#banner", (element) => element.textContent), /complete URL/);
  await without.close();
  await its.end();
});

test(`${kWander} seconds of random input leave memory bounded and nothing broken`, async () => {
  await onPage("iso=0.5&most=400000", async (page) => {
    const seen = await wander(page, kWander, 23);
    const { memory } = await (await fetch(new URL("api/store", server.url))).json();
    console.log(JSON.stringify(seen));
    assert.ok(seen.actions > 5, `only ${seen.actions} actions`);
    assert.ok(seen.mostServer <= memory, `the server's heap has grown to ${seen.mostServer} bytes`);
    // A triangle takes 12 bytes of indices and half a vertex of 12 bytes, so less than 24; there are five meshes.
    assert.ok(seen.mostMeshes <= 5 * 400_000 * 24, `the page's meshes have grown to ${seen.mostMeshes} bytes`);
    assert.ok(seen.mostHeap <= 300e6, `the page's heap has grown to ${seen.mostHeap} bytes`);
    assert.equal(await page.evaluate(() => window.isonest.banner()), null);
  });
}, kTimeout + 2000 * kWander);
