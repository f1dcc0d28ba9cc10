// The consumer project in a browser.
import * as isonest from "isonest";
import { problem, run, told } from "./queries.mjs";

window.consumer = {
  run: (source, options) => run(isonest.open, source, options),
  runBlob: async (url) => run(isonest.open, await (await fetch(url)).blob()),
  runBytes: async (url) => run(isonest.open, await (await fetch(url)).arrayBuffer()),
  image: async (url, asked) => {
    const store = await isonest.open(url);
    const image = told(await store.sliceImage(asked));
    store.close();
    return image;
  },
  problem: (source, options) => problem(isonest.open(source, options)),
};
