// The name and colour of the label that is shown.
import { type Api, ServerError } from "./api";
import { setSurfaceColor } from "./shaders";
import type { Stage } from "./stage";
import type { ViewStore } from "./state";
import type { Surface } from "./surface";

export class ShownLabel {
  /** Empty if it has none, or it is not known yet. */
  name = "";

  constructor(
    private readonly api: Api,
    private readonly views: ViewStore,
    private readonly stage: Stage,
    private readonly surface: Surface,
    private readonly changed: (name: string) => void,
    private readonly failed: (error: Error) => void,
  ) {
    views.subscribe((_state, keys) => {
      if (keys.has("iso")) void this.ask();
    });
  }

  private async ask(): Promise<void> {
    try {
      const { name, color } = await this.api.label(Math.round(this.views.state.iso));
      this.name = name ?? "";
      setSurfaceColor(this.surface.drawn.material, color && [color[0] / 255, color[1] / 255, color[2] / 255]);
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
