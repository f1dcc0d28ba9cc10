// What the server says and is asked: tools/view/PROTOCOL.md.

export type Vector = readonly [number, number, number];
/** The smaller corner first; world units. */
export type Box = readonly [number, number, number, number, number, number];

export interface StoreInfo {
  readonly name: string;
  readonly nodes: Vector;
  readonly type: string;
  readonly spacing: Vector;
  readonly origin: Vector;
  readonly direction: readonly [Vector, Vector, Vector];
  /** Of length, of all coordinates; null where it is not known. */
  readonly unit: string | null;
  readonly frame: "RAS" | "LPS" | null;
  readonly box: Box;
  readonly min_value: number | null;
  readonly max_value: number | null;
  readonly integer: boolean;
  readonly has_missing: boolean;
  readonly levels: number;
  readonly labels: boolean;
  readonly dimension: number;
  readonly file_bytes: number;
  readonly largest_error: number;
  /** Of a store elsewhere: what is within this error is there soon after the opening. */
  readonly first_error: number | null;
  readonly most_triangles: number;
  readonly memory: number;
  readonly version: string;
}

export interface HistogramBin {
  readonly low: number;
  readonly nodes: number;
  /** Null where the store has no ranges of cubes. */
  readonly cubes: number | null;
}

export interface HistogramInfo {
  readonly level: number;
  readonly values: number;
  readonly missing: number;
  readonly cube_level: number | null;
  readonly bins: readonly HistogramBin[];
  /** Where the last bin ends; null if there is none. */
  readonly end: number | null;
  readonly suggested: readonly { readonly isovalue: number; readonly cubes: number }[];
}

export interface StatusInfo {
  readonly heap_bytes: number;
  readonly memory: number;
  readonly surface: number;
  readonly slice: number;
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

export interface ValueInfo {
  readonly world: Vector;
  readonly node: Vector;
  readonly inside: boolean;
  readonly value: number | null;
  readonly node_value: number | null;
  /** Of labels: its number as text, because numbers here are exact up to 2^53 only. */
  readonly label?: string | null;
  /** Of labels: what that one is called. */
  readonly name?: string | null;
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
  readonly distance_bound: number | null;
  readonly smooth_bound: number | null;
  readonly full_resolution: boolean;
  readonly position_rounding: number;
  readonly value_rounding?: number;
  readonly origin: Vector;
  readonly step: Vector;
  readonly value_origin?: number;
  readonly value_step?: number;
  readonly seconds: number;
  readonly chunks_read: number;
  readonly bytes_read: number;
  readonly sections: readonly Section[];
}

export interface ErrorBody {
  readonly kind: string;
  /** With the remedies. */
  readonly message: string;
}
