// The name and colour of the label that is shown.
import { type Api, ServerError } from "../api";
import type { StoreInfo, Vector } from "../protocol";
import { setSurfaceColor } from "../shaders";
import type { Stage } from "../stage";
import { stepOf, type ViewStore } from "../state";
import type { Surface } from "../surface";

export class ShownLabel {
  /** Empty if it has none, or it is not known yet. */
  name = "";

  constructor(
    private readonly api: Api,
    private readonly views: ViewStore,
    private readonly store: StoreInfo,
    private readonly stage: Stage,
    private readonly surface: Surface,
    /** Of a label without a colour of its own; 0 to 255 each. */
    private readonly colorOf: (label: number) => Vector,
    private readonly changed: (name: string) => void,
    private readonly failed: (error: Error) => void,
  ) {
    views.subscribe((_state, keys) => {
      if (keys.has("iso") || keys.has("step")) void this.ask();
    });
  }

  private async ask(): Promise<void> {
    try {
      const { name, color } = await this.api.label(Math.round(this.views.state.iso), stepOf(this.store, this.views.state));
      this.name = name ?? "";
      const [red, green, blue] = color ?? this.colorOf(Math.round(this.views.state.iso));
      setSurfaceColor(this.surface.drawn.material, [red / 255, green / 255, blue / 255]);
      this.stage.invalidate();
      this.changed(this.name);
    } catch (error) {
      if (error instanceof ServerError && error.superseded) return;
      // The name of this label is unknown.
      this.name = "";
      setSurfaceColor(this.surface.drawn.material, null);
      this.stage.invalidate();
      this.changed(this.name);
      this.failed(error as Error);
    }
  }
}
