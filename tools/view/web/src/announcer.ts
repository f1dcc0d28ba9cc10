// Tells a screen reader what is shown, once it has come to rest.
const kRest = 600; // milliseconds

export class Announcer {
  private timer = 0;
  private last = "";

  /** `element` is a polite live region. */
  constructor(private readonly element: HTMLElement) {}

  /** Says what `text` gives when nothing else was to be said for a while. */
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
