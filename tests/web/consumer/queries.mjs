// Part of the consumer project: the same queries in Node and in a browser. Results are JSON; arrays are in base64.

export const kSurfaces = [
  { iso: 0.5 },
  { iso: 0.5, error: "2%" },
  { iso: 0.5, error: "2%", effort: "none" },
  { iso: 0.5, distance: "0.5voxel", effort: "fast" },
  { iso: 0.5, distance: "1voxel", effort: "best", normals: false },
  { iso: 0.5, error: "1%", box: [10, 10, 10, 45, 40, 50], close: "below" },
  { iso: 0.5, triangles: 2000, components: "largest" },
];
export const kSlices = [
  { axis: "z", index: 32 },
  { axis: "x", position: 20.25, error: "3%" },
  { plane: [1, 2, 3, 190], error: "1%" },
];

export function base64(array) {
  const bytes = new Uint8Array(array.buffer, array.byteOffset, array.byteLength);
  let text = "";
  for (let at = 0; at < bytes.length; at += 8192) text += String.fromCharCode(...bytes.subarray(at, at + 8192));
  return btoa(text);
}

/** A result with its arrays in base64. */
export function told(result) {
  return Object.fromEntries(Object.entries(result).map(([name, value]) => [name, ArrayBuffer.isView(value) ? base64(value) : value]));
}

/** The message and kind of the error that a promise ends with. */
export function problem(promise) {
  return promise.then(() => null, (error) => ({ name: error.name, kind: error.kind, message: error.message }));
}

/** All queries of a store, and the milliseconds from nothing to the first surface. */
export async function run(open, source, options) {
  const start = performance.now();
  const store = await open(source, options);
  const surfaces = [told(await store.surface(kSurfaces[3]))];
  const first = performance.now() - start;
  surfaces.pop();
  for (const asked of kSurfaces) surfaces.push(told(await store.surface(asked)));
  const slices = [];
  for (const asked of kSlices) slices.push(told(await store.slice(asked)));
  const { info } = store;
  const histogram = await store.histogram();
  store.close();
  return { first, info, surfaces, slices, histogram };
}
