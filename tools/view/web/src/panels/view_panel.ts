// The direction of view, and the page's appearance.
import type { CameraMoves } from "../camera_moves";
import { kDirections } from "../camera_moves";
import { button, checkbox, h, section, select } from "../dom";
import type { StoreInfo } from "../protocol";
import type { ViewState, ViewStore } from "../state";

export function viewPanel(views: ViewStore, store: StoreInfo, moves: CameraMoves): HTMLElement {
  const directions = Object.keys(kDirections).map((name) => button(name[0]!.toUpperCase() + name.slice(1), () => moves.from(name)));
  const home = button("Home", () => moves.home(), { id: "home" });
  const projection = select<ViewState["projection"]>(
    "Projection", [["perspective", "perspective"], ["orthographic", "without perspective"]], (choice) => views.set({ projection: choice }), { id: "projection" },
  );
  const theme = select<ViewState["theme"]>(
    "Theme", [["auto", "as the system"], ["light", "light"], ["dark", "dark"]], (choice) => views.set({ theme: choice }), { id: "theme" },
  );
  const outline = checkbox("Show the volume's outline", (on) => views.set({ outline: on }), { id: "outline" });
  views.subscribe((state) => {
    projection.input.value = state.projection;
    theme.input.value = state.theme;
    outline.set(state.outline);
  });
  const buttons = h("div", { class: "buttons", role: "group", "aria-label": "Look from" }, home, ...directions);
  buttons.hidden = store.dimension === 2;
  return section("view", "View", false, buttons, projection.row, outline.row, theme.row);
}
