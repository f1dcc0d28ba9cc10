// What a test or a script can read from the page, as `window.isonest`. Read-only.
import type { Api } from "./api";
import type { Banner } from "./banner";
import type { LabelLayers } from "./labels/label_layers";
import type { MemoryPanel } from "./panels/memory_panel";
import type { Probe } from "./probe";
import type { StatusInfo, ValueInfo, Vector } from "./protocol";
import type { Refiner } from "./refiner";
import type { Slice } from "./slices";
import type { Stage } from "./stage";
import type { SliceName, ViewState, ViewStore } from "./state";
import type { Surface } from "./surface";
import type { SurfacePanel } from "./panels/surface_panel";

export interface Inspection {
  /** All settings. */
  state(): ViewState;
  /** Resolves when nothing is in progress or waiting for the user to stop, and the picture is up to date. */
  idle(): Promise<void>;
  /** Triangles on the screen, of the surface or of the named slice. */
  triangles(slice?: SliceName): number;
  /** Labels shown besides the selected one, and their triangles. */
  layers(): readonly (readonly [number | null, number])[];
  /** How the surface is shown by tiles; null: it never is. */
  tiles(): {
    readonly state: string;
    /** Of the largest geometricError that is shown, in world units; and the largest error in pixels. */
    readonly error: number;
    readonly pixels: number;
    readonly shown: number;
    readonly loads: number;
    readonly limited: boolean;
    readonly full: boolean;
    /** Errors of the tiles that are shown. */
    readonly errors: readonly number[];
    readonly tileset: string | null;
  } | null;
  /** The surface's quality in words. */
  bound(): string;
  /** The header of the mesh that is shown: the surface's, or a slice's. */
  header(slice?: SliceName): unknown;
  /** Bytes of the meshes' arrays in the page and on the graphics card, and received so far. */
  bytes(): { readonly page: number; readonly card: number; readonly received: number };
  /** Frames drawn so far. */
  frames(): number;
  /** Milliseconds of the tasks that blocked the page for 50 or more, the latest last; at most 1000. */
  longTasks(): readonly number[];
  /** Milliseconds from each movement to the mesh that shows it, the latest last. */
  latencies(slice?: SliceName): readonly number[];
  /** The last result under the cursor. */
  value(): ValueInfo | null;
  /** Ends of the measured line. */
  points(): readonly Vector[];
  /** The server's last status. */
  status(): StatusInfo | null;
  /** Kind of the message that is shown, or null. */
  banner(): string | null;
  /** Position on the canvas in CSS pixels; null behind the eye. */
  project(at: Vector): readonly [number, number] | null;
}

export interface Parts {
  readonly views: ViewStore;
  readonly api: Api;
  readonly stage: Stage;
  readonly surface: Surface;
  readonly slices: ReadonlyMap<SliceName, Slice>;
  readonly panel: SurfacePanel;
  readonly memory: MemoryPanel;
  readonly probe: Probe;
  readonly banner: Banner;
  readonly layers: LabelLayers | null;
  /** Of the histogram. */
  readonly loading: () => Promise<unknown>;
}

const kMaxTasks = 1000;
const kPoll = 20; // milliseconds

export function inspection(parts: Parts): Inspection {
  const { views, api, stage, surface, slices, panel, memory, probe, banner } = parts;
  const tasks: number[] = [];
  if (PerformanceObserver.supportedEntryTypes.includes("longtask")) {
    new PerformanceObserver((list) => {
      for (const { duration } of list.getEntries()) tasks.push(duration);
      tasks.splice(0, tasks.length - kMaxTasks);
    }).observe({ type: "longtask", buffered: true });
  }
  const shown = (slice?: SliceName): Surface | Slice => (slice === undefined ? surface : slices.get(slice)) ?? surface;
  const refiners: readonly Refiner[] = [surface.refiner, ...[...slices.values()].map((slice) => slice.refiner)];
  const busy = (): boolean => refiners.some((refiner) => refiner.busy) || probe.pending || stage.pending || (parts.layers?.busy ?? false) || (surface.tiled?.busy ?? false);
  return {
    state: () => views.state,
    async idle() {
      await parts.loading();
      do await new Promise((resolve) => setTimeout(resolve, kPoll));
      while (busy());
    },
    triangles: (slice) => (slice === undefined ? surface.triangles : shown(slice).drawn.triangles),
    layers: () => parts.layers?.drawn.map(({ id, triangles }) => [parts.layers!.labelOf(id), triangles] as const) ?? [],
    tiles: () => {
      const { tiled } = surface;
      if (!tiled) return null;
      const { selection, state, loads, info } = tiled;
      const errors = selection?.drawn.map(({ error }) => error) ?? [];
      return {
        state, loads, errors, shown: errors.length, error: selection?.error ?? 0, pixels: selection?.pixels ?? 0, limited: selection?.limited ?? false,
        full: selection?.full ?? false,
        tileset: info?.tileset ?? null,
      };
    },
    bound: () => panel.sentence(),
    header: (slice) => shown(slice).drawn.header,
    bytes: () => ({ page: memory.held.page, card: memory.held.card, received: api.received }),
    frames: () => stage.frames,
    longTasks: () => tasks,
    latencies: (slice) => shown(slice).refiner.latencies,
    value: () => probe.value,
    points: () => probe.points,
    status: () => memory.status,
    banner: () => banner.kind,
    project: (at) => stage.project(at),
  };
}

declare global {
  interface Window {
    isonest?: Inspection;
  }
}
