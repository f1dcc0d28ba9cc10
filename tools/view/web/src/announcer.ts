// Tells a screen reader what is shown, when it no longer changes.
const kRest = 600; // milliseconds

export class Announcer {
  private timer = 0;
  private last = "";

  /** `element` is a polite live region. */
  constructor(private readonly element: HTMLElement) {}

  /** Announces the result of `text` after a while without another announcement. */
  later(text: () => string): void {
    clearTimeout(this.timer);
    this.timer = setTimeout(() => {
      const now = text();
      if (now === this.last) return;
      this.last = now;
      this.element.textContent = now;
    }, kRest);
  }
}
