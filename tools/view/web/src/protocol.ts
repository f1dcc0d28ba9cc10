// Requests to the server and its answers: tools/view/PROTOCOL.md.

export type Vector = readonly [number, number, number];
/** The smaller corner first; in world units. */
export type Box = readonly [number, number, number, number, number, number];

export interface StoreInfo {
  readonly name: string;
  readonly nodes: Vector;
  readonly type: string;
  readonly spacing: Vector;
  readonly origin: Vector;
  readonly direction: readonly [Vector, Vector, Vector];
  /** Of length, for all coordinates; null if unknown. */
  readonly unit: string | null;
  readonly frame: "RAS" | "LPS" | null;
  readonly box: Box;
  readonly min_value: number | null;
  readonly max_value: number | null;
  readonly integer: boolean;
  readonly has_missing: boolean;
  readonly levels: number;
  readonly labels: boolean;
  /** The store is at a URL. */
  readonly remote: boolean;
  readonly dimension: number;
  readonly file_bytes: number;
  readonly largest_error: number;
  /** For a remote store: meshes within this error are available soon after the opening. */
  readonly first_error: number | null;
  readonly most_triangles: number;
  readonly memory: number;
  readonly version: string;
  /** Null for one store. For a series, values and bytes above are those of all steps. */
  readonly series: SeriesInfo | null;
  /** By which surfaces can be coloured. */
  readonly quantities: readonly Quantity[];
}

export interface Quantity {
  readonly name: string;
  readonly min_value: number | null;
  readonly max_value: number | null;
}

export interface SeriesInfo {
  readonly time_unit: string | null;
  /** Of the steps, ascending. */
  readonly times: readonly number[];
}

export interface HistogramBin {
  readonly low: number;
  readonly nodes: number;
  /** Null if the store has no ranges of cubes. */
  readonly cubes: number | null;
}

export interface HistogramInfo {
  readonly level: number;
  readonly values: number;
  readonly missing: number;
  readonly cube_level: number | null;
  readonly bins: readonly HistogramBin[];
  /** The end of the last bin; null if there are none. */
  readonly end: number | null;
  readonly suggested: readonly { readonly isovalue: number; readonly cubes: number }[];
}

export interface StatusInfo {
  readonly heap_bytes: number;
  readonly memory: number;
  readonly surface: number;
  readonly slice: number;
  readonly file: number;
  readonly waiting: number;
  readonly served: number;
  readonly cancelled: number;
  readonly connections: number;
  readonly store: string;
}

export interface LabelInfo {
  readonly id: number;
  readonly name: string | null;
  /** Red, green, blue, 0 to 255. */
  readonly color: Vector | null;
}

export interface ListedLabel extends LabelInfo {
  /** With this label; null: not counted. */
  readonly nodes: number | null;
}

export interface ValueInfo {
  readonly world: Vector;
  readonly node: Vector;
  readonly inside: boolean;
  readonly value: number | null;
  readonly node_value: number | null;
  /** For labels: the number as text, because JavaScript numbers are only exact up to 2^53. */
  readonly label?: string | null;
  /** For labels: the name. */
  readonly name?: string | null;
  /** The other quantities there, by their names; null: missing. */
  readonly quantities?: Readonly<Record<string, number | null>>;
}

export interface Section {
  readonly name: string;
  readonly encoding: string;
  readonly bytes: number;
  readonly stride: number;
  readonly count: number;
}

export interface MeshHeader {
  readonly vertices: number;
  readonly triangles: number;
  readonly stop: "error" | "distance" | "camera" | "smooth";
  readonly tolerance: number;
  readonly error_bound: number | null;
  /** By how much the store's values were rounded; part of error_bound, not of distance_bound. */
  readonly data_tolerance: number;
  readonly distance_bound: number | null;
  readonly smooth_bound: number | null;
  readonly full_resolution: boolean;
  readonly position_rounding: number;
  readonly value_rounding?: number;
  readonly origin: Vector;
  readonly step: Vector;
  readonly value_origin?: number;
  readonly value_step?: number;
  /** The step that stands for a missing value. */
  readonly value_missing?: number;
  /** The quantity whose values the vertices of a surface have. */
  readonly color?: string;
  /** Proven, between vertices; null: no triangle has values everywhere. */
  readonly color_bound?: number | null;
  /** Triangles without the bound, next to missing values. */
  readonly uncolored_triangles?: number;
  readonly seconds: number;
  readonly chunks_read: number;
  readonly bytes_read: number;
  readonly sections: readonly Section[];
}

/** Of the tiles of a surface. */
export interface TilesInfo {
  readonly state: "waiting" | "making" | "ready" | "unneeded";
  /** Of a tileset in the making: what is being done, and which part of it is done, 0 to 1. */
  readonly phase?: string | null;
  readonly part?: number;
  /** When it is ready: its name in requests. */
  readonly tileset?: string;
  /** Of the surface at full resolution. */
  readonly triangles?: number;
  readonly data_tolerance?: number;
}

export interface ErrorBody {
  readonly kind: string;
  /** Includes the remedies. */
  readonly message: string;
}
