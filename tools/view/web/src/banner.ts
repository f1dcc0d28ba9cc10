// Shows an error and how to resolve it; one message at a time.
import { ServerError } from "./api";
import { button, h } from "./dom";
import { Unanswered } from "./site/transport";

const kForbidden = 403;
const kGone = 410;

export class Banner {
  /** The message that is shown: "server" if there is no answer, "store", "request", or none. */
  kind: "server" | "store" | "request" | null = null;
  private message = "";
  /** Requests again what is to be shown; set by the page's parts. */
  retry: () => void;

  constructor(
    private readonly element: HTMLElement,
    again: () => void,
  ) {
    this.retry = again;
  }

  show(error: Error): void {
    const status = error instanceof ServerError ? error.status : -1;
    if (error instanceof Unanswered) {
      this.tell("server", error.message, !error.final);
    } else if (status === kGone) {
      this.tell("store", error.message, false);
    } else if (status === kForbidden) {
      this.tell("request", `${error.message}. Open the complete URL that isonest view printed.`, false);
    } else {
      this.tell("request", error.message, true);
    }
  }

  /** Called with the state in the server's status. */
  storeLost(how: string): void {
    const what = how === "replaced" ? "was replaced by another file" : how === "cut off" ? "was cut off: the file is shorter than it was" : `is ${how}`;
    this.tell("store", `The store ${what}. Restart isonest view, then reload this page.`, false);
  }

  /** The server answers: after an outage, everything that is shown is requested again. */
  serverThere(): void {
    if (this.kind !== "server") return;
    this.hide();
    this.retry();
  }

  private hide(): void {
    this.kind = null;
    this.message = "";
    this.element.hidden = true;
    this.element.replaceChildren();
  }

  private tell(kind: NonNullable<Banner["kind"]>, message: string, retry: boolean): void {
    if (this.kind === "store" && kind !== "store") return; // takes precedence over all other messages
    if (this.message === message) return;
    this.kind = kind;
    this.message = message;
    const actions = h("div", { class: "buttons" });
    if (retry) actions.append(button("Try again", () => (this.hide(), this.retry()), { id: "try-again" }));
    else actions.append(button("Reload the page", () => location.reload(), { id: "reload" }));
    if (kind === "request") actions.append(button("Close", () => this.hide()));
    const text = message[0]!.toUpperCase() + message.slice(1);
    this.element.replaceChildren(h("p", {}, text), actions);
    this.element.hidden = false;
  }
}
