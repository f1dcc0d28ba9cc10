// The view: all settings in one place. Code that shows them subscribes; code that changes them calls set().
import type { Parameters } from "./api";
import type { Box, Quantity, StoreInfo, Vector } from "./protocol";
import { allValues, namedWindows } from "./windows";
import { axisNormal, centreOf, dot, radiusOf } from "./geometry";

/** The goal to which the surface is refined while nothing moves. */
export type Target = "screen" | "full" | "error" | "distance" | "triangles";
export type SliceName = "x" | "y" | "z" | "o";
export const kSliceNames: readonly SliceName[] = ["x", "y", "z", "o"];

export interface SliceState {
  readonly on: boolean;
  /** World units along the normal: from the world's origin; for the oblique slice from the volume's centre. */
  readonly at: number;
}

export interface ViewState {
  readonly surface: boolean;
  /** Of a series: which of its times is shown; 0 for one store. */
  readonly step: number;
  /** For a volume of labels, the label. */
  readonly iso: number;
  /** Labels that are shown besides `iso`. */
  readonly shown: readonly number[];
  readonly target: Target;
  readonly pixels: number;
  readonly error: number;
  readonly distance: number;
  readonly triangles: number;
  /** Triangles of a surface whose isovalue or box is being moved. */
  readonly moving: number;
  /** Limit for the triangles of every requested mesh, except within a distance. */
  readonly most: number;
  readonly largest: boolean;
  /** The smooth surface of the label `iso`, instead of the isosurface or the one half way between nodes. */
  readonly smooth: boolean;
  readonly facets: boolean;
  /** Null: everything. */
  readonly box: Box | null;
  readonly slices: Readonly<Record<SliceName, SliceState>>;
  /** In degrees: of the oblique slice's normal, around z and above the x-y plane. */
  readonly turn: number;
  readonly tilt: number;
  /** Values of the first and the last colour. */
  readonly window: readonly [number, number];
  readonly map: string;
  /** The quantity that colours the surface; empty: none. */
  readonly color: string;
  /** Its values at the first and the last colour, and the colours. */
  readonly colorWindow: readonly [number, number];
  readonly colorMap: string;
  readonly eye: Vector;
  readonly lookAt: Vector;
  readonly projection: "perspective" | "orthographic";
  readonly outline: boolean;
  readonly theme: "auto" | "light" | "dark";
}

export type Key = keyof ViewState;
export type Listener = (state: ViewState, changed: ReadonlySet<Key>) => void;

/** In degrees, from the top of the picture to its bottom. */
export const kFieldOfView = 30;
const kHome: Vector = [1, -1.6, 0.9]; // like `isonest picture`

export class ViewStore {
  private listeners: Listener[] = [];
  constructor(private current: ViewState) {}

  get state(): ViewState {
    return this.current;
  }
  /** Called after each change, and once immediately with everything. */
  subscribe(listener: Listener): void {
    this.listeners.push(listener);
    listener(this.current, new Set(Object.keys(this.current) as Key[]));
  }
  set(patch: Partial<ViewState>): void {
    const changed = (Object.keys(patch) as Key[]).filter((key) => !same(this.current[key], patch[key]));
    if (changed.length === 0) return;
    this.current = { ...this.current, ...patch };
    for (const listener of this.listeners) listener(this.current, new Set(changed));
  }
  setSlice(name: SliceName, patch: Partial<SliceState>): void {
    this.set({ slices: { ...this.current.slices, [name]: { ...this.current.slices[name], ...patch } } });
  }
}

function same(a: unknown, b: unknown): boolean {
  return a === b || JSON.stringify(a) === JSON.stringify(b);
}

/** All values of a quantity, as a window. */
export function rangeOf(quantity: Quantity | undefined): readonly [number, number] {
  const least = quantity?.min_value ?? 0;
  const largest = quantity?.max_value ?? 1;
  return [least, largest > least ? largest : least + 1];
}

/** The parameter that selects a step of a series; none for one store. */
export function stepOf(store: StoreInfo, state: ViewState): Parameters {
  return store.series ? { step: state.step } : {};
}

/** All labels that are shown, if surfaces are. */
export function labelsShown({ iso, shown }: ViewState): readonly number[] {
  return [...new Set([...shown, Math.round(iso)])];
}

/** Integers in space may be labels, even if the store does not say so. */
export function mayBeLabels(store: StoreInfo): boolean {
  return store.dimension === 3 && (store.labels || store.integer);
}

/** A position from which the whole box is visible, looking against `toward`; `aspect`: width / height of the picture. */
export function eyeFor(box: Box, toward: Vector, aspect: number): Vector {
  const length = Math.hypot(...toward);
  const half = Math.atan(Math.tan((kFieldOfView / 2) * (Math.PI / 180)) * Math.min(aspect, 1));
  const distance = radiusOf(box) / Math.sin(half);
  const [x, y, z] = centreOf(box);
  return [x + (toward[0] / length) * distance, y + (toward[1] / length) * distance, z + (toward[2] / length) * distance];
}

/** The initial view of a page. */
export function defaults(store: StoreInfo, isovalue: number, aspect: number): ViewState {
  const middle = centreOf(store.box);
  const flat = store.dimension === 2;
  const least = store.min_value ?? 0;
  const largest = store.max_value ?? 1;
  const along = (axis: 0 | 1 | 2): number => dot(axisNormal(axis, store), middle);
  const flatAxis = store.nodes.indexOf(1);
  return {
    surface: !flat,
    step: 0,
    iso: isovalue,
    shown: [],
    target: store.labels ? "full" : "screen",
    pixels: 2, // of a diamond of tetrahedra: its triangles are about half as large
    error: (largest - least) / 100,
    distance: Math.hypot(...store.spacing) / 2,
    triangles: 1_000_000,
    moving: 100_000,
    most: Math.min(3_000_000, store.most_triangles),
    largest: false,
    smooth: store.labels,
    facets: false,
    box: null,
    slices: {
      x: { on: flat && flatAxis === 0, at: along(0) },
      y: { on: flat && flatAxis === 1, at: along(1) },
      z: { on: flat && flatAxis !== 0 && flatAxis !== 1, at: along(2) },
      o: { on: false, at: 0 },
    },
    turn: 45,
    tilt: 30,
    window: namedWindows(store)[0]?.[1] ?? allValues(store),
    map: "gray",
    color: store.quantities[0]?.name ?? "",
    colorWindow: rangeOf(store.quantities[0]),
    colorMap: "viridis",
    eye: eyeFor(store.box, flat ? (store.direction[flatAxis === -1 ? 2 : (flatAxis as 0 | 1 | 2)] ?? kHome) : kHome, aspect),
    lookAt: middle,
    projection: flat ? "orthographic" : "perspective",
    outline: !flat,
    theme: "auto",
  };
}

export function homeEye(store: StoreInfo, aspect: number): Vector {
  return eyeFor(store.box, kHome, aspect);
}
