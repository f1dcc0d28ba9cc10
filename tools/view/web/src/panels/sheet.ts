// On a narrow screen the panel is a collapsible sheet below the picture.
import { byId } from "../dom";

/** Connects the button that collapses the panel. */
export function bindSheet(): void {
  const toggle = byId("sheet-toggle");
  const narrow = matchMedia("(max-width: 700px)");
  const set = (open: boolean): void => {
    document.body.classList.toggle("folded", !open);
    toggle.setAttribute("aria-expanded", String(open));
  };
  toggle.addEventListener("click", () => set(document.body.classList.contains("folded")));
  narrow.addEventListener("change", () => set(!narrow.matches));
  set(!narrow.matches);
}

/** The line that is shown while the sheet is collapsed. */
bindSheet.summary = (text: string): void => {
  byId("sheet-summary").textContent = text;
};
