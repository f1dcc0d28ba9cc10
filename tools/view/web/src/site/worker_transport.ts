// Answers requests on a published site: the library in a worker of the page, which reads the store itself.
import { type Answer, type Transport, Unanswered } from "./transport";

/** From the worker. */
type Message =
  | { readonly kind: "opened" }
  | { readonly kind: "failed"; readonly message: string }
  | { readonly kind: "answer"; readonly id: number; readonly status: number; readonly type: string; readonly body: ArrayBuffer }
  | { readonly kind: "progress"; readonly id: number; readonly bytes: number };

interface Waiting {
  readonly resolve: (answer: Answer) => void;
  readonly reject: (error: Error) => void;
  readonly progress: (bytes: number) => void;
}

const kScript = "worker.js";

export class WorkerTransport implements Transport {
  readonly hasServer = false;
  private readonly worker = new Worker(kScript);
  private readonly waiting = new Map<number, Waiting>();
  private next = 1;
  private failure: Unanswered | null = null;

  /**
   * `url`: of the store; `steps`: of the steps of a series, or empty; `memory`: the worker's memory budget in bytes. Errors
   * are reported with the first answer.
   */
  constructor(url: string, steps: readonly string[], memory: number) {
    this.worker.onmessage = (event: MessageEvent<Message>) => this.take(event.data);
    this.worker.onmessageerror = () => this.fail("The page's worker, which reads the store, sent an invalid message.");
    this.worker.onerror = (event) => {
      event.preventDefault(); // shown on the page
      this.fail(event.message ? `The page's worker, which reads the store, failed: ${event.message}` : `The page's worker, which reads the store, cannot be loaded: ${kScript}`);
    };
    this.worker.postMessage({ kind: "open", url, steps, memory });
  }

  ask(target: string, signal: AbortSignal, progress: (bytes: number) => void): Promise<Answer> {
    const id = this.next++;
    return new Promise((resolve, reject) => {
      if (this.failure) return reject(this.failure);
      if (signal.aborted) return reject(new Error("aborted"));
      const cancel = (): void => {
        if (!this.waiting.delete(id)) return;
        this.worker.postMessage({ kind: "cancel", id });
        reject(new Error("aborted"));
      };
      const done = (): void => signal.removeEventListener("abort", cancel);
      signal.addEventListener("abort", cancel);
      this.waiting.set(id, {
        resolve: (answer) => (done(), resolve(answer)),
        reject: (error) => (done(), reject(error)),
        progress,
      });
      this.worker.postMessage({ kind: "request", id, target });
    });
  }

  /** There is no work that goes on without a request. */
  cancel(): void {}

  private take(message: Message): void {
    switch (message.kind) {
      case "opened":
        return;
      case "failed":
        return this.fail(message.message);
      case "progress":
        return this.waiting.get(message.id)?.progress(message.bytes);
      case "answer": {
        const waiting = this.waiting.get(message.id);
        this.waiting.delete(message.id);
        return waiting?.resolve({ status: message.status, body: message.body });
      }
    }
  }

  /** Permanently: after a failure, the worker's state is unknown. */
  private fail(message: string): void {
    this.failure ??= new Unanswered(message, true);
    this.worker.terminate();
    const all = [...this.waiting.values()];
    this.waiting.clear();
    for (const { reject } of all) reject(this.failure);
  }
}
