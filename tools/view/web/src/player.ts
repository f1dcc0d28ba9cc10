// Moves through the steps of a series, and plays it.
import type { Api, Parameters } from "./api";
import type { StoreInfo } from "./protocol";
import { type Key, type ViewStore } from "./state";

/** A step is shown at least this long while the series plays, and until its meshes have come. Milliseconds. */
const kFrame = 200;
const kPoll = 15;
const kStream = "ahead";

export interface Shown {
  /** Something that is to be shown has not come yet, at any resolution. */
  behind(): boolean;
  /** Something is being refined, or about to be. */
  busy(): boolean;
  /** The first meshes of what is shown now, as they would be requested for another step. */
  meshes(): readonly { readonly kind: "surface" | "slice"; readonly parameters: Parameters }[];
}

export class Player {
  playing = false;
  readonly count: number;
  /** 1 or -1: the direction of the last move. */
  private direction = 1;
  private prepared = "";
  private generation = 0;
  private runs = 0;
  private readonly listeners: (() => void)[] = [];

  constructor(
    private readonly api: Api,
    private readonly views: ViewStore,
    store: StoreInfo,
    private readonly shown: Shown,
  ) {
    this.count = store.series?.times.length ?? 1;
    const cameras: readonly Key[] = ["eye", "lookAt", "projection", "theme", "outline", "facets"];
    views.subscribe((_state, keys) => {
      if (![...keys].some((key) => !cameras.includes(key))) return;
      ++this.generation;
      api.cancel(kStream);
    });
  }

  /** `listener` is called when `playing` changes. */
  onChange(listener: () => void): void {
    this.listeners.push(listener);
  }

  /** Stops playing, and shows the step. */
  go(step: number): void {
    this.stop();
    this.show(step);
  }
  /** Stops playing, and shows the next step or the one before. */
  move(by: number): void {
    this.go(Math.min(Math.max(this.views.state.step + by, 0), this.count - 1));
  }
  toggle(): void {
    if (this.playing) this.stop();
    else void this.play();
  }
  stop(): void {
    if (!this.playing) return;
    this.playing = false;
    this.tell();
  }

  /**
   * Called when something else is shown or in progress. A page that reads the stores itself prepares the next step, and the
   * one before, while it has nothing else to do.
   */
  refresh(): void {
    if (this.count < 2 || this.api.hasServer || this.shown.behind() || (this.shown.busy() && !this.playing)) return;
    const { step } = this.views.state;
    const key = JSON.stringify([step, this.direction, this.shown.meshes()]);
    if (key === this.prepared) return;
    this.prepared = key;
    const next = step + this.direction;
    void this.prepare(this.playing ? [next % this.count] : [next, step - this.direction]);
  }

  private async prepare(steps: readonly number[]): Promise<void> {
    const generation = ++this.generation;
    for (const step of steps) {
      if (step < 0 || step >= this.count) continue;
      for (const { kind, parameters } of this.shown.meshes()) {
        await this.api.prepare(kind, kStream, { ...parameters, step });
        if (generation !== this.generation) return;
      }
    }
  }

  private show(step: number): void {
    if (step === this.views.state.step) return;
    this.direction = step > this.views.state.step ? 1 : -1;
    this.views.set({ step });
  }

  /** From the last step, continues with the first. */
  private async play(): Promise<void> {
    this.playing = true;
    this.tell();
    // Ends if it was stopped, even if another one has started since.
    const run = ++this.runs;
    const goesOn = () => this.playing && run === this.runs;
    while (goesOn()) {
      const start = performance.now();
      this.show((this.views.state.step + 1) % this.count);
      this.direction = 1;
      do await pause(kPoll);
      while (goesOn() && this.shown.behind());
      await pause(Math.max(kFrame - (performance.now() - start), 0));
    }
  }

  private tell(): void {
    for (const listener of this.listeners) listener();
  }
}

function pause(time: number): Promise<void> {
  return new Promise((resolve) => setTimeout(resolve, time));
}
