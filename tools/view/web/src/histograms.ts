// Reads the histogram; for a series, again whenever the slider of time rests at another step.
import { type Api, ServerError } from "./api";
import type { HistogramPanel } from "./panels/histogram";
import type { HistogramInfo, StoreInfo } from "./protocol";
import { stepOf, type ViewStore } from "./state";

/** All values of a step are read for it, so this is done only when the time rests. Milliseconds. */
const kRest = 500;

export class Histograms {
  /** Resolves when the histogram of what is shown is there, or failed. */
  loading: Promise<void>;
  private changes = 0;

  /** `first`: the histogram that has been requested; null for labels. */
  constructor(
    private readonly api: Api,
    private readonly views: ViewStore,
    private readonly store: StoreInfo,
    private readonly panel: HistogramPanel,
    /** Called with each histogram. */
    private readonly found: (info: HistogramInfo) => void,
    first: Promise<HistogramInfo | null>,
  ) {
    let shown = 0; // the step of `first`
    this.loading = this.show(first);
    if (!store.series || store.labels) return;
    views.subscribe(({ step }) => {
      if (step === shown) return;
      shown = step;
      this.api.cancel("histogram");
      this.loading = this.later(++this.changes);
    });
  }

  private async later(change: number): Promise<void> {
    await new Promise((resolve) => setTimeout(resolve, kRest));
    if (change === this.changes) await this.show(this.api.histogram(this.store.first_error !== null, stepOf(this.store, this.views.state)));
  }

  private async show(found: Promise<HistogramInfo | null>): Promise<void> {
    try {
      const info = await found;
      if (!info) return;
      this.panel.show(info);
      this.found(info);
    } catch (error) {
      if (!(error instanceof ServerError && error.superseded)) this.panel.fail((error as Error).message);
    }
  }
}
