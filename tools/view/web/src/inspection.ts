// What a test or a script may read of the page, as `window.isonest`. It changes nothing.
import type { Api } from "./api";
import type { Banner } from "./banner";
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
  /** Everything that is chosen. */
  state(): ViewState;
  /** Resolves when nothing is under way or waits for the user's rest, and the picture shows it. */
  idle(): Promise<void>;
  /** On the screen, of the surface; of a slice, if its name is given. */
  triangles(slice?: SliceName): number;
  /** In words, of the surface. */
  bound(): string;
  /** The header of what is shown: the surface's, or a slice's. */
  header(slice?: SliceName): unknown;
  /** Of the meshes' arrays in the page and on the graphics card, and received so far. */
  bytes(): { readonly page: number; readonly card: number; readonly received: number };
  /** Drawn so far. */
  frames(): number;
  /** Milliseconds, of the tasks that blocked the page for 50 or more, the latest last; at most 1000. */
  longTasks(): readonly number[];
  /** Milliseconds from each movement to the mesh that shows it, the latest last. */
  latencies(slice?: SliceName): readonly number[];
  /** What was last found under the cursor. */
  value(): ValueInfo | null;
  /** Ends of the measured line. */
  points(): readonly Vector[];
  /** What the server last said of itself. */
  status(): StatusInfo | null;
  /** Kind of the message that is shown, or null. */
  banner(): string | null;
  /** Pixels of the page from the canvas's corner; null behind the eye. */
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
  readonly loading: Promise<unknown>;
}

const kMostTasks = 1000;
const kPoll = 20; // milliseconds

export function inspection(parts: Parts): Inspection {
  const { views, api, stage, surface, slices, panel, memory, probe, banner } = parts;
  const tasks: number[] = [];
  if (PerformanceObserver.supportedEntryTypes.includes("longtask")) {
    new PerformanceObserver((list) => {
      for (const { duration } of list.getEntries()) tasks.push(duration);
      tasks.splice(0, tasks.length - kMostTasks);
    }).observe({ type: "longtask", buffered: true });
  }
  const shown = (slice?: SliceName): Surface | Slice => (slice === undefined ? surface : slices.get(slice)) ?? surface;
  const refiners: readonly Refiner[] = [surface.refiner, ...[...slices.values()].map((slice) => slice.refiner)];
  const busy = (): boolean => refiners.some((refiner) => refiner.busy) || probe.pending || stage.pending;
  return {
    state: () => views.state,
    async idle() {
      await parts.loading;
      do await new Promise((resolve) => setTimeout(resolve, kPoll));
      while (busy());
    },
    triangles: (slice) => shown(slice).drawn.triangles,
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
