// A slider with a number field for one number.
import { h, numberField } from "../dom";
import { short } from "../words";

const kSteps = 1000;

export interface SliderOptions {
  readonly id: string;
  readonly label: string;
  readonly least: number;
  readonly largest: number;
  /** Step of the slider; the field accepts any number in the range. */
  readonly step?: number;
  /** The field may exceed the slider's range. */
  readonly open?: boolean;
}

export class Slider {
  readonly row: HTMLElement;
  readonly range: HTMLInputElement;
  private readonly field: ReturnType<typeof numberField>;

  /** `moved` is called for every change, by the slider or the field. */
  constructor(options: SliderOptions, moved: (value: number) => void) {
    const { id, label } = options;
    this.range = h("input", { type: "range", id, "aria-label": label });
    this.field = numberField("", moved, { id: `${id}-number`, "aria-label": `${label}, as a number` });
    this.row = h("div", { class: "slider", role: "group", "aria-label": label }, h("span", { class: "slider-label" }, label), this.range, this.field.input);
    this.setReach(options.least, options.largest, options.step, options.open);
    this.range.addEventListener("input", () => {
      this.field.set(this.range.valueAsNumber);
      this.say();
      moved(this.range.valueAsNumber);
    });
  }

  setReach(least: number, largest: number, step = niceStep(largest - least), open = false): void {
    this.range.min = String(least);
    this.range.max = String(largest);
    this.range.step = String(step);
    this.field.input.min = open ? "" : String(least);
    this.field.input.max = open ? "" : String(largest);
  }

  set(value: number): void {
    this.range.valueAsNumber = value;
    this.field.set(Number(value.toPrecision(7)));
    this.say();
  }

  set disabled(disabled: boolean) {
    this.range.disabled = disabled;
    this.field.input.disabled = disabled;
  }

  private say(): void {
    this.range.setAttribute("aria-valuetext", short(this.range.valueAsNumber));
  }
}

/** About a thousandth of the range: 1, 2 or 5 times a power of ten. */
export function niceStep(range: number): number {
  if (!(range > 0)) return 1;
  const rough = range / kSteps;
  const power = 10 ** Math.floor(Math.log10(rough));
  const digit = rough / power;
  return Number(((digit < 1.5 ? 1 : digit < 3.5 ? 2 : digit < 7.5 ? 5 : 10) * power).toPrecision(1));
}
