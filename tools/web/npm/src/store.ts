// What the package offers: a store, its queries, and their results. Independent of where it runs.

/** x, y, z, in world units. */
export type Vector = readonly [number, number, number];

/** Bytes in memory, a `Blob` or `File`, or the address of a store on a web server. In Node, a string without a scheme or a `file:` URL is a file. */
export type Source = string | URL | Blob | ArrayBuffer | Uint8Array;

export interface OpenOptions {
  /** Maximum number of bytes that WebAssembly may use for this store, 32 MiB to 2 GiB; default 256 MiB. Results and server responses are not included. */
  readonly memory?: number;
  /** The folder of `worker.js` and `isonest.wasm`, if the bundler does not find them. Not in Node. */
  readonly files?: string | URL;
}

export interface StoreInfo {
  readonly name: string;
  /** Number of sample points along x, y, z; 1 along z for data in a plane. */
  readonly dims: Vector;
  readonly spacing: Vector;
  /** The world position of the first node. */
  readonly origin: Vector;
  /** Unit vectors of the volume's axes x, y, z in the world. */
  readonly direction: readonly [Vector, Vector, Vector];
  /** The unit of all lengths: "mm", "um", ...; null if unknown. */
  readonly unit: string | null;
  /** The patient axes of the world; null if unknown. */
  readonly frame: "RAS" | "LPS" | null;
  /** The smallest and the largest value; null if all are missing. */
  readonly range: readonly [number, number] | null;
  /** Type of the values: "uint8", "float32", ... */
  readonly type: string;
  readonly hasMissing: boolean;
  /** Whether the values are labels. */
  readonly labels: boolean;
  readonly levels: number;
  /** Number of dimensions: 3, or 2 for data in a plane. */
  readonly dimension: number;
  readonly bytes: number;
  /** By how much values were rounded when the store was made; part of every error bound. */
  readonly tolerance: number;
  /** The library's version. */
  readonly version: string;
}

interface Choices {
  /** In world coordinates: the corner with the smallest coordinates, then the opposite one. */
  readonly box?: readonly [number, number, number, number, number, number];
  /** Patient axes of positions and normals. Default: as in the store (`info.frame`). */
  readonly space?: "ras" | "lps";
  /** Rejects the promise with the signal's reason. */
  readonly signal?: AbortSignal;
}

export interface SurfaceOptions extends Choices {
  /** The isovalue. */
  readonly iso?: number;
  /** Instead of `iso`: the surface around the nodes with this label. */
  readonly label?: number | bigint;
  /** The data on the mesh differ from `iso` by at most this; "1%" is a part of the range. 0, the default, is full resolution. */
  readonly error?: number | `${number}%`;
  /** Instead of `error`: maximum distance between the mesh and the surface at full resolution, in both directions; a plain number is in world units. */
  readonly distance?: number | `${number}voxel`;
  /** Instead of `error`: the smallest distance for which the mesh has at most this many triangles. */
  readonly triangles?: number;
  /** How a mesh within an error or a distance is simplified. Default: "fast". The bound is the same; "best" takes longer and gives fewer triangles. */
  readonly effort?: "none" | "fast" | "best";
  /** Default: true. */
  readonly normals?: boolean;
  /** "largest": only the component with the most triangles. */
  readonly components?: "all" | "largest";
  /** Closes the surface at the borders of the volume or the box; the space outside is treated as below or above `iso`. */
  readonly close?: "below" | "above";
  /** For a label: a smooth surface; the number of smoothing passes, 0 to 64. */
  readonly smooth?: number;
}

/** A plane: one of the volume's axes and a node along it, a world axis and a position, or nx x + ny y + nz z = d. Ignored for data in a plane. */
export type Plane =
  | { readonly axis: "x" | "y" | "z"; readonly index: number }
  | { readonly axis: "x" | "y" | "z"; readonly position: number }
  | { readonly plane: readonly [number, number, number, number] };

export type SliceOptions = Choices & Plane & {
  /** The values of the slice differ from the data by at most this; "1%" is a part of the range. 0, the default, is full resolution. */
  readonly error?: number | `${number}%`;
};

export type ImageOptions = SliceOptions & {
  /** In pixels. The height follows from it, as pixels are square. */
  readonly width: number;
};

/** What is proven about a result, and the work that it took. */
export interface Report {
  /** The bound of the requested kind: `errorBound`, `distanceBound` or `smoothBound`. */
  readonly bound: number;
  /** The largest difference between the data on the mesh and the isovalue; for a slice, between its values and the data. Null for a distance. */
  readonly errorBound: number | null;
  /** For a surface that is simplified within an error: the bound for triangles that are unchanged from full resolution. */
  readonly fullBound: number | null;
  /** The largest distance between the mesh and the surface at full resolution, world units. Null for an error. */
  readonly distanceBound: number | null;
  /** For a smooth label: the largest distance between the mesh and the faces of the voxels. */
  readonly smoothBound: number | null;
  /** Whether the mesh has at most `triangles`; null if none were requested. */
  readonly withinBudget: boolean | null;
  /** In square world units; null for lines. */
  readonly area: number | null;
  /** In cubic world units; null if the mesh is open. */
  readonly volume: number | null;
  readonly unit: string | null;
  /** Time in the library, without waiting for a server. */
  readonly seconds: number;
  /** What the query read from the store. */
  readonly bytesRead: number;
}

/** A mesh; its arrays belong to the caller. */
export interface Mesh extends Report {
  /** x, y, z of each vertex, world units. */
  readonly positions: Float32Array;
  /** Vertices of each triangle, counter-clockwise seen from smaller values; for data in a plane, of each line. */
  readonly indices: Uint32Array;
  /** Indices per element: 3, or 2 for lines. */
  readonly corners: 2 | 3;
}

export interface Surface extends Mesh {
  /** Unit vectors toward smaller values, from the data's gradient; null if not requested, and for smooth labels. */
  readonly normals: Float32Array | null;
}

export interface Slice extends Mesh {
  /** The data at each vertex. */
  readonly values: Float32Array;
}

/** Pixel (i, j), at index j * width + i, is the world point origin + i right + j down. */
export interface SliceImage extends Report {
  readonly width: number;
  readonly height: number;
  /** NaN outside the volume, and where a value is missing. */
  readonly values: Float32Array;
  readonly origin: Vector;
  readonly right: Vector;
  readonly down: Vector;
}

export interface Histogram {
  /** The level whose nodes were counted; 0 is the finest. */
  readonly level: number;
  readonly bins: readonly { readonly low: number; readonly nodes: number }[];
  /** The upper end of the last bin. */
  readonly end: number | null;
  /** Suggested isovalues, the most prominent one first. */
  readonly suggested: readonly number[];
}

/** An error reported by the library. `kind` is "invalid_argument", "not_found", "corrupt", "unsupported", "io" or "limit". */
export class IsonestError extends Error {
  override readonly name = "IsonestError";
  constructor(message: string, readonly kind: string) {
    super(message);
  }
}

/** @internal Messages to the worker. */
export type Order =
  | { readonly kind: "open"; readonly source: WorkerSource; readonly memory: number }
  | { readonly kind: "ask"; readonly id: number; readonly target: string }
  | { readonly kind: "cancel"; readonly id: number }
  | { readonly kind: "bytes"; readonly id: number; readonly bytes: Uint8Array<ArrayBuffer> | string };

/** @internal `served`: the bytes come from the thread that opened the store. */
export type WorkerSource =
  | { readonly url: string }
  | { readonly blob: Blob; readonly name: string }
  | { readonly bytes: Uint8Array; readonly name: string }
  | { readonly path: string }
  | { readonly served: { readonly name: string; readonly size: number; readonly roundTrip: number } };

/** @internal Messages from the worker. */
export type Message =
  | { readonly kind: "opened" }
  | { readonly kind: "failed"; readonly error: { readonly kind: string; readonly message: string } }
  | { readonly kind: "answer"; readonly id: number; readonly status: number; readonly body: ArrayBuffer; readonly arrays: ArrayBuffer[] }
  | { readonly kind: "read"; readonly id: number; readonly offset: number; readonly size: number; readonly shared?: SharedArrayBuffer };

/** @internal A worker. */
export interface Port {
  post(order: Order): void;
  /** Keeps the process alive while there is work; Node only. */
  busy(is: boolean): void;
  end(): void;
}

/** @internal Starts a worker. Calls `received` for each of its messages, and `broken` if it cannot run. */
export type Start = (received: (message: Message) => void, broken: (message: string) => void) => Port;

interface Answer {
  readonly json: unknown;
  readonly arrays: ArrayBuffer[];
}

interface Waiting {
  readonly resolve: (answer: Answer) => void;
  readonly reject: (reason: unknown) => void;
}

const kMiB = 2 ** 20;
const kLeast = 32 * kMiB;
const kMost = 2048 * kMiB;

const kAxes = { x: 0, y: 1, z: 2 } as const;

/** An open store. Queries are answered one after the other. */
export class Store {
  /** The store's properties. */
  readonly info: StoreInfo;
  readonly #calls: Calls;

  private constructor(calls: Calls, info: StoreInfo) {
    this.#calls = calls;
    this.info = info;
  }

  /** @internal */
  static async _open(start: Start, source: WorkerSource, memory = 256 * kMiB): Promise<Store> {
    if (!(memory >= kLeast && memory <= kMost)) throw new RangeError(`memory ${memory}: give a number of bytes from ${kLeast} to ${kMost}`);
    const calls = new Calls(start);
    try {
      await calls.open(source, Math.floor(memory));
      return new Store(calls, infoOf((await calls.ask("/api/store")).json));
    } catch (error) {
      calls.end();
      throw error;
    }
  }

  /** The surface where the data have the value `iso`. For data in a plane: lines. */
  async surface(options: SurfaceOptions): Promise<Surface> {
    const { iso, label, error, distance, triangles, normals = true, components, close, smooth } = options;
    // "fast", because a page waits for its meshes. At full resolution there is nothing to simplify.
    const { effort = error || distance || triangles ? "fast" : undefined } = options;
    const { json, arrays } = await this.#query("surface", options, {
      iso, label, distance: this.#length(distance), triangles, components, close, smooth, effort, normals: normals ? 1 : 0,
    });
    const mesh = this.#mesh(json, arrays, options);
    return { ...mesh, normals: arrays[1]?.byteLength ? this.#inSpace(new Float32Array(arrays[1]), options) : null };
  }

  /** The data in a plane, as triangles with values. */
  async slice(options: SliceOptions): Promise<Slice> {
    const { json, arrays } = await this.#query("slice", options, { plane: this.#plane(options).join(",") });
    return { ...this.#mesh(json, arrays, options), values: new Float32Array(arrays[2] ?? new ArrayBuffer(0)) };
  }

  /** The data in a plane, as pixels. */
  async sliceImage(options: ImageOptions): Promise<SliceImage> {
    if (!Number.isInteger(options.width) || options.width < 1) throw new RangeError(`width ${options.width}: give a number of pixels`);
    const plane = this.#plane(options);
    const { origin, right, down, width, height } = this.#pixels(plane, options);
    const { json, arrays } = await this.#query("image", options, {
      plane: plane.join(","), origin: origin.join(","), right: right.join(","), down: down.join(","), width, height,
    });
    const [first, along, below] = [origin, right, down].map((v) => vector(this.#inSpace(v, options)));
    if (!first || !along || !below) throw new Error("unreachable");
    return { ...reportOf(json), width, height, values: new Float32Array(arrays[2] ?? new ArrayBuffer(0)), origin: first, right: along, down: below };
  }

  /** The value at a world point, linear between the nodes; for labels, the nearest node's. Null outside, and if it is missing. */
  async value(at: Vector): Promise<number | null> {
    const { json } = await this.#calls.ask(`/api/value?at=${at.map(String).join(",")}`);
    const { value, node_value: ofNode, inside } = json as { value: number | null; node_value: number | null; inside: boolean };
    return this.info.labels ? (inside ? ofNode : null) : value;
  }

  /** Counts of the values, and suggested isovalues. */
  async histogram(): Promise<Histogram> {
    const json = (await this.#calls.ask("/api/histogram")).json as {
      level: number; bins: { low: number; nodes: number }[]; end: number | null; suggested: { isovalue: number }[];
    };
    return {
      level: json.level,
      bins: json.bins.map(({ low, nodes }) => ({ low, nodes })),
      end: json.end,
      suggested: json.suggested.map(({ isovalue }) => isovalue),
    };
  }

  /** Frees the memory. Waiting queries are rejected; results stay valid. */
  close(): void {
    this.#calls.end();
  }

  #query(what: string, options: SurfaceOptions | SliceOptions, rest: Record<string, string | number | bigint | undefined>): Promise<Answer> {
    const given = { ...rest, error: this.#error(options.error), box: options.box?.join(",") };
    const parameters = new URLSearchParams();
    for (const [name, value] of Object.entries(given)) if (value !== undefined) parameters.set(name, String(value));
    if (options.space !== undefined && this.info.frame === null) throw new IsonestError(`${this.info.name}: space "${options.space}": the patient axes of the store are unknown`, "invalid_argument");
    return this.#calls.ask(`/arrays/${what}?${parameters}`, options.signal);
  }

  /** The error in units of the data, from a percentage of the range. */
  #error(error: number | string | undefined): number | undefined {
    if (typeof error !== "string") return error;
    const [low, high] = this.info.range ?? [0, 0];
    return (measured("error", error, "%") / 100) * (high - low);
  }

  #length(distance: number | string | undefined): number | undefined {
    if (typeof distance !== "string") return distance;
    const steps = this.info.spacing.filter((_, axis) => (this.info.dims[axis] ?? 0) > 1);
    return measured("distance", distance, "voxel") * Math.min(...steps);
  }

  #mesh(json: unknown, arrays: ArrayBuffer[], options: Choices): Mesh {
    return {
      ...reportOf(json),
      positions: this.#inSpace(new Float32Array(arrays[0] ?? new ArrayBuffer(0)), options),
      indices: new Uint32Array(arrays[3] ?? new ArrayBuffer(0)),
      corners: (json as { corners: 2 | 3 }).corners,
    };
  }

  /** RAS and LPS differ by the signs of x and y. */
  #inSpace<T extends Float32Array | number[]>(vectors: T, { space }: Choices): T {
    if (space === undefined || space.toUpperCase() === this.info.frame) return vectors;
    for (let i = 0; i < vectors.length; i += 3) {
      vectors[i] = -(vectors[i] ?? 0);
      vectors[i + 1] = -(vectors[i + 1] ?? 0);
    }
    return vectors;
  }

  #plane(options: Plane): readonly [number, number, number, number] {
    if ("plane" in options) return options.plane;
    const axis = kAxes[options.axis];
    if (axis === undefined) throw new RangeError(`axis ${String(options.axis)}: give "x", "y" or "z"`);
    if ("position" in options) {
      const normal: [number, number, number] = [0, 0, 0];
      normal[axis] = 1;
      return [...normal, options.position];
    }
    const { origin, spacing, direction } = this.info;
    const normal = unit(cross(at(direction, axis + 1), at(direction, axis + 2)));
    const along = at(direction, axis);
    const place = vector(origin.map((x, i) => x + (along[i] ?? 0) * (spacing[axis] ?? 0) * options.index));
    return [...normal, dot(normal, place)];
  }

  /** The pixels of an image of the part of the plane that is in the volume and the box. */
  #pixels(plane: readonly [number, number, number, number], options: ImageOptions): { origin: number[]; right: number[]; down: number[]; width: number; height: number } {
    const { origin, spacing, direction, dims } = this.info;
    const flat = this.info.dimension === 2;
    const length = Math.hypot(plane[0], plane[1], plane[2]);
    const normal: Vector = flat ? [0, 0, 1] : [plane[0] / length, plane[1] / length, plane[2] / length];
    const offset = flat ? origin[2] : plane[3] / length;
    // A row runs along the volume's axis that is nearest to the plane, x if there are several.
    const steep = direction.map((one) => Math.abs(dot(one, normal)));
    const along = at(direction, steep.findIndex((one) => one <= Math.min(...steep) + 1e-9));
    const right = unit(minus(along, normal, dot(along, normal)));
    let down = unit(cross(normal, right));
    // Rows follow each other in the direction of the axes, whatever the direction of the normal.
    if (direction.reduce((sum, one) => sum + dot(one, down), 0) < 0) down = [-down[0], -down[1], -down[2]];
    const edges = direction.map((one, axis) => vector(one.map((x) => x * (spacing[axis] ?? 0) * ((dims[axis] ?? 1) - 1))));
    let [low, high] = extentOf(cut(origin, edges, normal, offset), right, down);
    if (options.box) {
      const [x0, y0, z0, x1, y1, z1] = options.box;
      const [l, h] = extentOf(cut([x0, y0, z0], [[x1 - x0, 0, 0], [0, y1 - y0, 0], [0, 0, z1 - z0]], normal, offset), right, down);
      low = [Math.max(low[0], l[0]), Math.max(low[1], l[1])];
      high = [Math.min(high[0], h[0]), Math.min(high[1], h[1])];
    }
    if (!(high[0] > low[0] && high[1] > low[1])) throw new IsonestError(`${this.info.name}: the plane does not cross the volume${options.box ? " in this box" : ""}`, "invalid_argument");
    const { width } = options;
    const step = (high[0] - low[0]) / width;
    const height = Math.max(1, Math.round((high[1] - low[1]) / step));
    const first = normal.map((n, i) => n * offset + (right[i] ?? 0) * (low[0] + step / 2) + (down[i] ?? 0) * (low[1] + (high[1] - low[1] - (height - 1) * step) / 2));
    return { origin: first, right: right.map((x) => x * step), down: down.map((x) => x * step), width, height };
  }
}

/** Triangles (or lines) in the form of vtk.js: each preceded by its number of corners. */
export function vtkCells({ indices, corners }: Pick<Mesh, "indices" | "corners">): Uint32Array {
  const count = indices.length / corners;
  const cells = new Uint32Array(count * (corners + 1));
  for (let i = 0; i < count; ++i) {
    cells[i * (corners + 1)] = corners;
    cells.set(indices.subarray(i * corners, (i + 1) * corners), i * (corners + 1) + 1);
  }
  return cells;
}

/** Calls to a worker; answers arrive in any order. */
class Calls {
  readonly #port: Port;
  readonly #waiting = new Map<number, Waiting>();
  #opening: { resolve: () => void; reject: (reason: unknown) => void } | null = null;
  #last = 0;
  #ended: Error | null = null;

  constructor(start: Start) {
    this.#port = start((message) => this.#received(message), (message) => this.#fail(new IsonestError(message, "io")));
  }

  open(source: WorkerSource, memory: number): Promise<void> {
    return new Promise((resolve, reject) => {
      if (this.#ended) return reject(this.#ended);
      this.#opening = { resolve, reject };
      this.#port.busy(true);
      this.#port.post({ kind: "open", source, memory });
    });
  }

  ask(target: string, signal?: AbortSignal): Promise<Answer> {
    return new Promise((resolve, reject) => {
      if (this.#ended) return reject(this.#ended);
      if (signal?.aborted) return reject(signal.reason);
      const id = ++this.#last;
      const cancel = (): void => {
        if (!this.#take(id)) return;
        this.#port.post({ kind: "cancel", id });
        reject(signal?.reason);
      };
      const without = <T>(use: (value: T) => void) => (value: T): void => {
        signal?.removeEventListener("abort", cancel);
        use(value);
      };
      this.#waiting.set(id, { resolve: without(resolve), reject: without(reject) });
      signal?.addEventListener("abort", cancel);
      this.#port.busy(true);
      this.#port.post({ kind: "ask", id, target });
    });
  }

  end(): void {
    this.#fail(new Error("the store is closed"));
  }

  #take(id: number): Waiting | undefined {
    const one = this.#waiting.get(id);
    this.#waiting.delete(id);
    this.#port.busy(this.#waiting.size > 0);
    return one;
  }

  #received(message: Message): void {
    if (message.kind === "opened") {
      this.#opening?.resolve();
      this.#opening = null;
      this.#port.busy(this.#waiting.size > 0);
    } else if (message.kind === "failed") {
      this.#fail(new IsonestError(message.error.message, message.error.kind));
    } else if (message.kind === "answer") {
      const one = this.#take(message.id);
      const text = new TextDecoder().decode(message.body);
      if (message.status === 200) {
        one?.resolve({ json: JSON.parse(text), arrays: message.arrays });
      } else {
        const { error } = JSON.parse(text) as { error: Problem };
        one?.reject(new IsonestError(messageOf(error), error.kind));
      }
    }
  }

  #fail(error: Error): void {
    if (this.#ended) return;
    this.#ended = error;
    this.#opening?.reject(error);
    this.#opening = null;
    for (const { reject } of this.#waiting.values()) reject(error);
    this.#waiting.clear();
    this.#port.end();
  }
}

/** An error of the library. */
interface Problem {
  readonly kind: string;
  /** Includes the remedies. */
  readonly message: string;
  readonly remedies?: readonly { readonly kind: string; readonly value: string; readonly text: string }[];
}

/** The share of the memory for a query: MemoryShares::of_page in tools/view/store_answers.cpp. */
const kShare = 6 / 16;

/** The library's message, with this package's option in place of the program's. */
function messageOf({ message, remedies = [] }: Problem): string {
  return remedies.reduce((said, { kind, value, text }) => {
    if (!text.includes("--memory")) return said;
    const needed = Math.ceil(Number(value) / kShare / kMiB);
    const more = needed > 0 ? `open the store with memory: ${needed} * 2 ** 20, or more` : "open the store with more memory";
    return said.replace(text, kind === "more_memory" ? more : "open the store with less memory");
  }, message);
}

function infoOf(json: unknown): StoreInfo {
  const given = json as {
    name: string; nodes: Vector; spacing: Vector; origin: Vector; direction: [Vector, Vector, Vector]; unit: string | null; frame: "RAS" | "LPS" | null;
    min_value: number | null; max_value: number | null; type: string; has_missing: boolean; labels: boolean; levels: number; dimension: number;
    file_bytes: number; tolerance: number; version: string;
  };
  const { name, nodes, spacing, origin, direction, unit: unitOf, frame, type, labels, levels, dimension, tolerance, version } = given;
  return {
    name, dims: nodes, spacing, origin, direction, unit: unitOf, frame,
    range: given.min_value === null || given.max_value === null ? null : [given.min_value, given.max_value],
    type, hasMissing: given.has_missing, labels, levels, dimension, bytes: given.file_bytes, tolerance, version,
  };
}

function reportOf(json: unknown): Report {
  const given = json as {
    error_bound: number | null; full_bound: number | null; distance_bound: number | null; smooth_bound: number | null; within_budget: boolean | null;
    area: number | null; volume: number | null; unit: string | null; seconds: number; bytes_read: number;
  };
  return {
    bound: given.error_bound ?? given.smooth_bound ?? given.distance_bound ?? Infinity,
    errorBound: given.error_bound,
    fullBound: given.full_bound,
    distanceBound: given.distance_bound,
    smoothBound: given.smooth_bound,
    withinBudget: given.within_budget,
    area: given.area,
    volume: given.volume,
    unit: given.unit,
    seconds: given.seconds,
    bytesRead: given.bytes_read,
  };
}

function measured(name: string, text: string, ending: string): number {
  const number = text.endsWith(ending) ? Number(text.slice(0, -ending.length).trim() || Number.NaN) : Number.NaN;
  if (!(number >= 0 && Number.isFinite(number))) throw new RangeError(`${name} "${text}": give a number, or a text such as "1${ending}"`);
  return number;
}

// Vectors.

function vector(of: readonly number[]): Vector {
  return [of[0] ?? 0, of[1] ?? 0, of[2] ?? 0];
}
function at(axes: readonly Vector[], number: number): Vector {
  return axes[number % 3] ?? [0, 0, 0];
}
function dot(a: Vector, b: Vector): number {
  return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}
function cross(a: Vector, b: Vector): Vector {
  return [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
}
function unit(a: Vector): Vector {
  const length = Math.hypot(...a);
  return [a[0] / length, a[1] / length, a[2] / length];
}
/** a - factor b */
function minus(a: Vector, b: Vector, factor: number): Vector {
  return [a[0] - factor * b[0], a[1] - factor * b[1], a[2] - factor * b[2]];
}

/** The corners of the polygon in which a plane cuts a parallelepiped with this first corner and these edges. */
function cut(first: Vector, edges: readonly Vector[], normal: Vector, offset: number): Vector[] {
  const corner = (bits: number): Vector => vector(first.map((x, i) => x + edges.reduce((sum, edge, axis) => sum + ((bits >> axis) & 1 ? (edge[i] ?? 0) : 0), 0)));
  const size = Math.hypot(...edges.flat()) + Math.hypot(...first);
  const points: Vector[] = [];
  for (let a = 0; a < 8; ++a) {
    for (let axis = 0; axis < 3; ++axis) {
      const b = a | (1 << axis);
      if (b === a) continue;
      const [p, q] = [corner(a), corner(b)];
      const [from, to] = [dot(normal, p) - offset, dot(normal, q) - offset];
      // A face in the plane counts, although coordinates are rounded.
      if (Math.abs(from) <= 1e-12 * size) points.push(p);
      if (Math.abs(to) <= 1e-12 * size) points.push(q);
      if (from * to < 0) points.push(vector(p.map((x, i) => x + ((q[i] ?? 0) - x) * (from / (from - to)))));
    }
  }
  return points;
}

/** The smallest and the largest coordinates along two directions. */
function extentOf(points: readonly Vector[], right: Vector, down: Vector): [[number, number], [number, number]] {
  const [across, along] = [points.map((p) => dot(p, right)), points.map((p) => dot(p, down))];
  return [[Math.min(...across), Math.min(...along)], [Math.max(...across), Math.max(...along)]];
}
