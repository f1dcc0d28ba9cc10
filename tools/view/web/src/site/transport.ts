// How requests reach what answers them: a server, or a worker in the page. api.ts only uses this interface.

export interface Answer {
  /** An HTTP status; PROTOCOL.md lists those that occur. */
  readonly status: number;
  readonly body: ArrayBuffer;
}

export interface Transport {
  /** Whether there is a server of isonest, which also makes files and command lines. */
  readonly hasServer: boolean;
  /**
   * `target`: the part of PROTOCOL.md's requests after `api/`. `progress` gets the bytes received so far. Rejects with Unanswered
   * if there is no answer, and with any error once `signal` is aborted; the work for the answer then ends.
   */
  ask(target: string, signal: AbortSignal, progress: (bytes: number) => void): Promise<Answer>;
  /** Ends a server's work for a stream. Never fails. */
  cancel(stream: string): void;
}

/** There is no answer; the message says what can be done. */
export class Unanswered extends Error {
  /** `final`: another try will not help; reloading the page may. */
  constructor(
    message: string,
    readonly final: boolean,
  ) {
    super(message);
  }
}
