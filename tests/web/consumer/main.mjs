// The consumer project in Node. usage: main.mjs SOURCE...; prints one JSON object per source.
import { open } from "isonest";
import { readFile } from "node:fs/promises";
import { run } from "./queries.mjs";

for (const source of process.argv.slice(2)) {
  const [, how, where] = /^(bytes|blob|source):(.*)$/.exec(source);
  const given = how === "source" ? where : how === "bytes" ? await readFile(where) : new Blob([await readFile(where)]);
  console.log(JSON.stringify(await run(open, given)));
}
