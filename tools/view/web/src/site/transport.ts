// How questions reach whoever answers them: a server, or a worker in the page. api.ts knows no more than this.

export interface Answer {
  /** As of HTTP: PROTOCOL.md has those that come. */
  readonly status: number;
  readonly body: ArrayBuffer;
}

export interface Transport {
  /** Whether a server of isonest answers: only then are there files and command lines of its making. */
  readonly hasServer: boolean;
  /**
   * `target`: what PROTOCOL.md has behind `api/`. `progress` is told the bytes received so far. Rejects with Unanswered if nobody
   * answers, and with anything once `signal` is aborted; the work for the answer then ends.
   */
  ask(target: string, signal: AbortSignal, progress: (bytes: number) => void): Promise<Answer>;
}

/** Nobody answers; the message says what can be done. */
export class Unanswered extends Error {
  /** `final`: asking once more gives nothing else; only loading the page anew may. */
  constructor(
    message: string,
    readonly final: boolean,
  ) {
    super(message);
  }
}
