// Windows of values for slices: those of CT, and one from the histogram.
import type { HistogramInfo, StoreInfo } from "./protocol";

export type Window = readonly [number, number];

/** In Hounsfield units: the middle and the width that radiology uses, as in isonest slice --range. The first one is where a CT starts. */
const kOfCt: readonly (readonly [string, number, number])[] = [["Soft tissue", 50, 400], ["Lung", -600, 1500], ["Bone", 400, 1800], ["Brain", 40, 80]];
/** Fraction of the values left out at each end of the histogram's window. */
const kLeftOut = 0.005;
/** A histogram's window is where slices start if it is narrower than this fraction of all values. */
const kNarrow = 0.5;

/** Whether the values are probably Hounsfield units: from air, -1000, or below, to more than soft tissue. */
function mayBeCt({ dimension, labels, integer, frame, min_value: least, max_value: largest }: StoreInfo): boolean {
  return dimension === 3 && !labels && (integer || frame !== null) && least !== null && largest !== null && least <= -900 && least >= -5000 && largest >= 200 && largest <= 100_000;
}

/** The named windows for these values; none unless they are probably those of a CT. */
export function namedWindows(store: StoreInfo): readonly (readonly [string, Window])[] {
  return mayBeCt(store) ? kOfCt.map(([name, middle, width]) => [name, [middle - width / 2, middle + width / 2]]) : [];
}

export function allValues(store: StoreInfo): Window {
  const least = store.min_value ?? 0;
  const largest = store.max_value ?? 1;
  return [least, largest > least ? largest : least + 1];
}

/** From what nearly all values exceed to what they fall below; null if there are no values. */
export function windowOf({ bins, end, values }: HistogramInfo): Window | null {
  if (end === null || values === 0) return null;
  const all = bins.reduce((sum, bin) => sum + bin.nodes, 0);
  let below = 0;
  let low: number | null = null;
  for (const [i, { nodes, low: from }] of bins.entries()) {
    below += nodes;
    const to = bins[i + 1]?.low ?? end;
    if (low === null && below > kLeftOut * all) low = from;
    if (low !== null && below >= (1 - kLeftOut) * all) return to > low ? [low, to] : null;
  }
  return null;
}

/** The histogram's window if slices should start with it: few values, far from all others, would leave no contrast. */
export function startingWindow(store: StoreInfo, info: HistogramInfo): Window | null {
  const window = windowOf(info);
  const [least, largest] = allValues(store);
  return window !== null && namedWindows(store).length === 0 && window[1] - window[0] < kNarrow * (largest - least) ? window : null;
}
