// Random input, reproducible by its seed, while memory is watched.
import { idle } from "../../tools/view/web/drive.mjs";

const kKeys = [".", ",", ">", "<", "x", "y", "z", "o", "PageUp", "PageDown", "b", "p", "t", "m", "v", "+", "-", "0", "1", "4", "ArrowLeft", "ArrowUp", "Shift+ArrowRight", "Escape"];

/** Pseudo-random numbers from 0 to 1 (xorshift). */
function generator(seed) {
  let x = seed;
  return () => {
    x ^= x << 13;
    x ^= x >>> 17;
    x ^= x << 5;
    return (x >>> 0) / 2 ** 32;
  };
}

/**
 * Sends random input for some seconds, or longer if the machine is too busy for enough actions. Returns the number of
 * actions and the largest memory use.
 */
export async function wander(page, seconds, seed) {
  const random = generator(seed);
  const pick = (list) => list[Math.floor(random() * list.length)];
  const box = await page.locator("#canvas").boundingBox();
  const seen = { actions: 0, mostServer: 0, mostMeshes: 0, mostHeap: 0, longTasks: 0 };
  const actions = [
    () => page.keyboard.press(pick(kKeys)),
    () => page.mouse.move(box.x + random() * box.width, box.y + random() * box.height),
    async () => {
      const button = pick(["left", "right"]);
      await page.mouse.down({ button });
      for (let i = 0; i < 4; ++i) await page.mouse.move(box.x + random() * box.width, box.y + random() * box.height);
      await page.mouse.up({ button });
    },
    () => page.mouse.wheel(0, (random() - 0.5) * 600),
    () => page.$eval("#iso", (input, part) => {
      input.value = String(Number(input.min) + part * (Number(input.max) - Number(input.min)));
      input.dispatchEvent(new Event("input", { bubbles: true }));
    }, random()),
    () => page.$eval("#target", (input, choice) => {
      input.value = choice;
      input.dispatchEvent(new Event("change", { bubbles: true }));
    }, pick(["screen", "full", "error", "distance", "triangles"])),
    () => page.evaluate(() => {
      const entries = navigation.entries();
      const before = entries[navigation.currentEntry.index - 1]; // stays on the page
      if (before && new URL(before.url).pathname === location.pathname) history.back();
    }),
    () => page.waitForTimeout(random() * 500),
  ];
  const watch = async () => {
    const now = await page.evaluate(() => ({
      meshes: window.isonest.bytes().page + window.isonest.bytes().card,
      heap: performance.memory?.usedJSHeapSize ?? 0,
      server: window.isonest.status()?.heap_bytes ?? 0,
      longTasks: window.isonest.longTasks().length,
    }));
    seen.mostMeshes = Math.max(seen.mostMeshes, now.meshes);
    seen.mostHeap = Math.max(seen.mostHeap, now.heap);
    seen.mostServer = Math.max(seen.mostServer, now.server);
    seen.longTasks = now.longTasks;
  };
  for (const end = Date.now() + 1000 * seconds; Date.now() < end || seen.actions <= 5; ++seen.actions) {
    await pick(actions)();
    await watch();
  }
  await idle(page);
  await watch();
  return seen;
}
