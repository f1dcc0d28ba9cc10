// Light and dark: the system's preference, or the user's choice. The picture's background follows.
import type { ViewState } from "./state";

const kDark = matchMedia("(prefers-color-scheme: dark)");

export type Rgb = readonly [number, number, number];

/** Calls `paint` with the background and line colours, 0 to 1, now and at every change. Returns the handler for state changes. */
export function bindTheme(paint: (background: Rgb, lines: Rgb) => void): (theme: ViewState["theme"]) => void {
  let chosen: ViewState["theme"] = "auto";
  const apply = (): void => {
    const dark = chosen === "dark" || (chosen === "auto" && kDark.matches);
    document.documentElement.dataset.theme = dark ? "dark" : "light";
    const style = getComputedStyle(document.documentElement);
    paint(parse(style.getPropertyValue("--stage")), parse(style.getPropertyValue("--outline")));
  };
  kDark.addEventListener("change", apply);
  return (theme) => {
    chosen = theme;
    apply();
  };
}

/** Parses #rrggbb. */
function parse(color: string): Rgb {
  const digits = color.trim().slice(1);
  const part = (i: number): number => parseInt(digits.slice(2 * i, 2 * i + 2), 16) / 255;
  return [part(0), part(1), part(2)];
}
