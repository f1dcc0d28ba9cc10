// One mesh on the screen: coarse while something moves, then refined step by step while nothing does.
import { type Api, type Parameters, ServerError } from "./api";
import type { Mesh } from "./decode";
import type { MeshHeader } from "./protocol";

const kRest = 250; // milliseconds
const kFewest = 500; // triangles

export interface Step {
  readonly parameters: Parameters;
  /** In words, after "refining": for example "to the screen's resolution". */
  readonly aim: string;
}

export interface Plan {
  readonly kind: "surface" | "slice";
  readonly stream: string;
  /** While something moves; null: nothing is shown. */
  coarse(): Parameters | null;
  /** While nothing moves, coarsest first. */
  steps(): readonly Step[];
  /** Replaces a request that exceeded the memory: fewer triangles; null if there is nothing coarser. */
  coarser(tooLarge: Parameters): Parameters | null;
  /** Whether no step could improve the mesh that is shown. */
  enough(shown: MeshHeader): boolean;
  show(mesh: Mesh, parameters: Parameters): void;
  clear(): void;
  /** Called when one of the three members below has changed. */
  changed(): void;
  failed(error: Error): void;
}

export class Refiner {
  /** The aim of the current request; null if there is none. */
  aim: string | null = null;
  /** Bytes received of it. */
  received = 0;
  /** The current or next step, and the number of steps; 0 of 0 while something moves. */
  step: readonly [number, number] = [0, 0];
  /** There was not enough memory for the wanted resolution. */
  shortOfMemory = false;
  /** Milliseconds from recent moves to the pictures that show them. */
  readonly latencies: number[] = [];

  private wanted: Parameters | null = null;
  private steps: readonly Step[] = [];
  private shown: MeshHeader | null = null;
  /** The mesh that is shown came from a step. */
  private refined = false;
  /** Requests for the same surface that exceeded the memory. */
  private readonly tooLarge = new Set<string>();
  private running: "coarse" | "step" | null = null;
  private generation = 0;
  private rest = 0;
  private movedAt = 0;

  constructor(
    private readonly api: Api,
    private readonly plan: Plan,
  ) {}

  get busy(): boolean {
    return this.running !== null || this.rest !== 0 || this.wanted !== null;
  }

  /** What is shown is not yet what was last asked for, at any resolution. */
  get behind(): boolean {
    return this.running === "coarse" || this.wanted !== null;
  }

  /** Shows something else. A coarse answer in progress is still shown, a finer one is cancelled. */
  move(): void {
    this.stopSteps();
    this.tooLarge.clear();
    this.shortOfMemory = false;
    this.wanted = this.plan.coarse();
    this.refined = false;
    this.movedAt = performance.now();
    if (this.wanted === null) {
      this.stop();
      return;
    }
    this.restLater();
    this.pump();
  }

  /** Shows the same surface at the resolution that is wanted now, for example with another camera. */
  look(): void {
    if (this.plan.coarse() === null || this.wanted !== null || this.shown === null) return;
    this.stopSteps();
    if (this.plan.enough(this.shown)) this.shortOfMemory = false;
    else this.restLater();
    this.plan.changed();
  }

  /** Something else shows the surface: what is in progress ends. */
  pause(): void {
    this.stopSteps();
    clearTimeout(this.rest);
    this.rest = 0;
    this.plan.changed();
  }

  /** Starts again after an error. */
  again(): void {
    this.move();
  }

  private stop(): void {
    ++this.generation;
    this.api.cancel(this.plan.stream);
    clearTimeout(this.rest);
    this.rest = 0;
    this.running = this.aim = this.shown = null;
    this.plan.clear();
    this.plan.changed();
  }

  private stopSteps(): void {
    this.steps = [];
    this.step = [0, 0];
    if (this.running !== "step") return;
    ++this.generation;
    this.api.cancel(this.plan.stream);
    this.running = this.aim = null;
  }

  private restLater(): void {
    clearTimeout(this.rest);
    this.rest = setTimeout(() => {
      this.rest = 0;
      // A finer mesh is never replaced by a coarser one of the same surface.
      const steps = this.plan.steps().slice(this.refined ? -1 : 0);
      this.steps = steps.filter(({ parameters }) => !this.tooLarge.has(keyOf(parameters)));
      this.shortOfMemory = steps.length > 0 && this.steps.length === 0;
      this.step = [0, this.steps.length];
      this.pump();
    }, kRest);
  }

  private pump(): void {
    if (this.running !== null) return;
    if (this.wanted !== null) {
      const parameters = this.wanted;
      this.wanted = null;
      void this.run("coarse", parameters, "a first mesh", this.movedAt);
      return;
    }
    const [next] = this.steps;
    if (next && !(this.shown && this.plan.enough(this.shown))) {
      this.steps = this.steps.slice(1);
      this.step = [this.step[0] + 1, this.step[1]];
      void this.run("step", next.parameters, next.aim, 0);
      return;
    }
    this.steps = [];
    this.step = [0, 0];
    this.plan.changed();
  }

  private async run(running: "coarse" | "step", parameters: Parameters, aim: string, movedAt: number): Promise<void> {
    const generation = ++this.generation;
    this.running = running;
    this.aim = aim;
    this.received = 0;
    this.plan.changed();
    const current = (): boolean => generation === this.generation;
    try {
      const mesh = await this.api.mesh(this.plan.kind, this.plan.stream, parameters, (bytes) => {
        this.received = bytes;
        if (current()) this.plan.changed();
      });
      if (!current()) return;
      this.shown = mesh.header;
      this.refined = running === "step";
      this.plan.show(mesh, parameters);
      if (movedAt > 0) this.latencies.push(performance.now() - movedAt);
    } catch (error) {
      if (!current()) return;
      if (this.wanted !== null) {
        // Something else is wanted by now, so messages about the old request no longer apply.
        this.running = this.aim = null;
        this.pump();
        return;
      }
      this.steps = [];
      if (error instanceof ServerError && error.tooLarge) {
        this.tooLarge.add(keyOf(parameters));
        this.shortOfMemory = true;
        const coarser = this.plan.coarser(parameters);
        const isShown = running === "step" && this.shown !== null;
        if (coarser !== null && !(isShown && Number(coarser.triangles) <= (this.shown?.triangles ?? 0))) {
          void this.run(running, coarser, "as far as the memory allows", movedAt);
          return;
        }
        if (!isShown) this.plan.failed(error);
      } else if (!(error instanceof ServerError && error.superseded)) this.plan.failed(error as Error);
    }
    this.running = this.aim = null;
    this.pump();
  }
}

/** Independent of the camera: a mesh that is too large from one position is too large from others. */
function keyOf({ camera, ...parameters }: Parameters): string {
  return JSON.stringify({ ...parameters, camera: camera !== undefined });
}

/** A quarter of the triangles; null if that is too coarse to be useful. `most`: the limit of `tooLarge` if it has none itself. */
export function withFewerTriangles(tooLarge: Parameters, basis: Parameters, most: number): Parameters | null {
  const triangles = Math.floor(Number(tooLarge.triangles ?? tooLarge.limit ?? most) / 4);
  return triangles < kFewest ? null : { ...basis, triangles };
}
