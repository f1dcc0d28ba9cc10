// Numbers and bounds in plain words.
import type { Measure } from "./measure";
import type { MeshHeader, SeriesInfo, StoreInfo } from "./protocol";

const kWhole = new Intl.NumberFormat("en", { maximumFractionDigits: 0 });
const kShort = new Intl.NumberFormat("en", { maximumSignificantDigits: 4 });

export function whole(value: number): string {
  return kWhole.format(value);
}
export function short(value: number): string {
  const size = Math.abs(value);
  if (size !== 0 && (size < 1e-4 || size >= 1e7)) return value.toExponential(3).replace("e+", "e");
  return kShort.format(value);
}
/** Rounded up, so that it remains a bound. */
export function shortBound(value: number): string {
  if (!(value > 0)) return short(value);
  const digit = 10 ** (Math.floor(Math.log10(value)) - 2);
  return short(Number((Math.ceil(value / digit - 1e-9) * digit).toPrecision(3)));
}
export function bytes(count: number): string {
  const units = ["B", "kB", "MB", "GB", "TB"];
  let unit = 0;
  let value = count;
  for (; value >= 999.5 && unit < units.length - 1; ++unit) value /= 1000;
  return `${unit === 0 ? whole(value) : kShort.format(Number(value.toPrecision(3)))} ${units[unit]}`;
}
export function place(at: readonly number[]): string {
  return at.map(short).join(", ");
}

/** The unit of lengths: "mm", "µm", or "world units" if unknown. */
export function unitOf(store: StoreInfo): string {
  const letters: Readonly<Record<string, string>> = { um: "µm", angstrom: "Å" };
  return store.unit === null ? "world units" : letters[store.unit] ?? store.unit;
}

/** The time of a step with its unit, if that is known. */
export function timeText(series: SeriesInfo, step: number): string {
  return [String(series.times[step]), ...(series.time_unit === null ? [] : [series.time_unit])].join(" ");
}

/** What full resolution means for a store with rounded values. */
function roundedValues({ data_tolerance }: Pick<MeshHeader, "data_tolerance">): string {
  return data_tolerance > 0 ? ` of values rounded within ${shortBound(data_tolerance)}` : "";
}

/** The proven quality of a surface; `unit`: of lengths. */
export function surfaceBound(header: MeshHeader, unit: string): string {
  if (header.smooth_bound !== null) return `smooth, within ${shortBound(header.smooth_bound)} ${unit} of the faces of the voxels`;
  if (header.full_resolution) return `full resolution${roundedValues(header)}`;
  if (header.distance_bound !== null) {
    return `within ${shortBound(header.distance_bound)} ${unit} of the surface at full resolution${roundedValues(header)}`;
  }
  if (header.error_bound !== null) return `values on this surface are within ${shortBound(header.error_bound)} of the isovalue`;
  return "without a bound";
}

/** The proven quality of tiles, and how much that is on the screen. `full`: they are at full resolution. */
export function tilesBound(shown: { readonly error: number; readonly pixels: number; readonly full: boolean }, data_tolerance: number, unit: string): string {
  const error = `${shortBound(shown.error)} ${unit}`;
  const values = roundedValues({ data_tolerance });
  if (shown.full) return `Full resolution${values}, rounded by up to ${error}`;
  const pixels = shown.pixels <= 1 ? "at most a pixel" : `up to ${shortBound(shown.pixels)} pixels`;
  return `Within ${error} of the surface at full resolution${values}, ${pixels} on the screen`;
}

/** The size of the mesh that is shown; `unit`: of lengths. */
export function sizeText({ area, volume }: Measure, unit: string): string {
  const power = (digit: string, word: string): string => (/ /.test(unit) ? `${word} ${unit}` : `${unit}${digit}`);
  const enclosed = volume === null ? "it is open" : `volume ${short(volume)} ${power("³", "cubic")}`;
  return `Area ${short(area)} ${power("²", "square")}, ${enclosed}`;
}

/** The proven quality of a slice; the rounding of its values is added. */
export function sliceBound(header: MeshHeader): string {
  const rounding = header.value_rounding ?? 0;
  if (header.full_resolution) {
    const all = rounding + header.data_tolerance;
    return all > 0 ? `full resolution, values rounded by up to ${shortBound(all)}` : "full resolution";
  }
  if (header.error_bound === null) return "without a bound";
  return `values within ${shortBound(header.error_bound + rounding)} of the data`;
}

/** How far rounding moved the vertices; empty if it did not, or if the mesh's bound includes it. */
export function rounding(header: MeshHeader, unit: string): string {
  if (!(header.position_rounding > 0) || (header.distance_bound ?? header.smooth_bound) !== null) return "";
  return `Vertices are rounded by up to ${shortBound(header.position_rounding)} ${unit}.`;
}
