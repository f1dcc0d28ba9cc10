// Light and dark: as the system wants it, or as chosen. The picture's background follows.
import type { ViewState } from "./state";

const kDark = matchMedia("(prefers-color-scheme: dark)");

export type Rgb = readonly [number, number, number];

/** Calls `paint` with the background and the lines' colour, 0 to 1 each, now and whenever they change. Returns what a change of the state calls. */
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

/** Of #rrggbb. */
function parse(color: string): Rgb {
  const digits = color.trim().slice(1);
  const part = (i: number): number => parseInt(digits.slice(2 * i, 2 * i + 2), 16) / 255;
  return [part(0), part(1), part(2)];
}
