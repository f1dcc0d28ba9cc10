// The slider of time for a series: its steps, with the time and its unit, and the buttons that play it.
import { button, h, setAttributes } from "../dom";
import type { Player } from "../player";
import type { SeriesInfo } from "../protocol";
import type { ViewStore } from "../state";
import { timeText } from "../words";

/** Longer units, such as "hours since 2020-01-01", are below the slider instead of beside the number. */
const kShortUnit = 6;

export class TimePanel {
  readonly element: HTMLElement;

  constructor(views: ViewStore, series: SeriesInfo, player: Player) {
    const { times, time_unit: unit } = series;
    const last = times.length - 1;
    const range = h("input", { type: "range", id: "time", min: 0, max: last, step: 1, "aria-label": "Time", "aria-describedby": "time-help" });
    const number = h("input", { type: "number", id: "time-number", step: "any", inputmode: "decimal", "aria-label": "Time, as a number" });
    const isShort = unit !== null && unit.length <= kShortUnit;
    const note = h("p", { class: "note", id: "time-help" });
    const back = button("‹", () => player.move(-1), { id: "time-back", "aria-label": "Back by one step", title: "back by one step (J)" });
    const forth = button("›", () => player.move(1), { id: "time-forth", "aria-label": "Forward by one step", title: "forward by one step (L)" });
    const play = button("▶ Play", () => player.toggle(), { id: "time-play", title: "play or pause (K)" });
    this.element = h(
      "div", { class: "time", role: "group", "aria-label": "Time" },
      h("div", { class: "iso-head" }, h("label", { class: "iso-label", for: "time-number" }, "Time"), h("span", { class: "time-field" }, number, ...(isShort ? [h("span", { class: "time-unit" }, unit)] : []))),
      range, h("div", { class: "buttons time-buttons" }, back, play, forth, note),
    );
    range.addEventListener("input", () => player.go(range.valueAsNumber));
    number.addEventListener("change", () => {
      const wanted = number.valueAsNumber;
      if (Number.isFinite(wanted)) player.go(nearest(times, wanted));
      number.valueAsNumber = times[views.state.step]!;
    });
    player.onChange(() => (play.textContent = player.playing ? "❚❚ Pause" : "▶ Play"));
    views.subscribe(({ step }, changed) => {
      if (!changed.has("step")) return;
      range.valueAsNumber = step;
      setAttributes(range, { "aria-valuetext": `${timeText(series, step)}, step ${step + 1} of ${times.length}` });
      number.valueAsNumber = times[step]!;
      note.textContent = `${unit === null || isShort ? "" : `${unit}; `}step ${step + 1} of ${times.length}`;
      back.disabled = step === 0;
      forth.disabled = step === last;
    });
  }
}

/** The number of the step with the time that is nearest. */
function nearest(times: readonly number[], wanted: number): number {
  let best = 0;
  times.forEach((time, step) => {
    if (Math.abs(time - wanted) < Math.abs(times[best]! - wanted)) best = step;
  });
  return best;
}
