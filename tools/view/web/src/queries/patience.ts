// When and how often to repeat a request that a server could not answer. The numbers are those of the program
// (store/remote).

const kBusy: readonly number[] = [408, 429, 500, 502, 503, 504];
const kMaxAttempts = 6;
const kFirstWait = 250; // milliseconds; each wait is twice the previous one
const kLongestWait = 8000;
const kTotal = 60_000; // from the first failure

/** The retry state of one request. */
export class Patience {
  private failures = 0;
  private firstAt = 0;

  /** `now`: milliseconds; `random`: from 0 to 1. */
  constructor(
    private readonly now: () => number = () => performance.now(),
    private readonly random: () => number = Math.random,
  ) {}

  /** Milliseconds until the next try; null: the answer is final. `retryAfter`: that header, if present. */
  wait(status: number, retryAfter: string | null): number | null {
    if (!kBusy.includes(status)) return null;
    const now = this.now();
    if (this.failures === 0) this.firstAt = now;
    this.failures += 1;
    if (this.failures >= kMaxAttempts) return null;
    const grown = Math.min(kFirstWait * 2 ** (this.failures - 1), kLongestWait) * (0.5 + 0.5 * this.random());
    const wait = Math.max(grown, askedFor(retryAfter));
    return now + wait > this.firstAt + kTotal ? null : wait;
  }

  /** For a message: the number of failed tries; "" for one. */
  get tried(): string {
    return this.failures > 1 ? ` (asked ${this.failures} times)` : "";
  }
}

/** In milliseconds; 0 if the header has no valid time. Source: RFC 9110, section 10.2.3. */
function askedFor(retryAfter: string | null): number {
  if (retryAfter === null) return 0;
  if (/^\d+$/.test(retryAfter.trim())) return 1000 * Number(retryAfter);
  const at = Date.parse(retryAfter);
  return Number.isNaN(at) ? 0 : Math.max(0, at - Date.now());
}

/** Blocks the worker for this time. */
export function waitNow(milliseconds: number): void {
  const end = performance.now() + milliseconds;
  try {
    // Shared memory that is also available to pages that are not isolated.
    const { buffer } = new WebAssembly.Memory({ initial: 1, maximum: 1, shared: true });
    Atomics.wait(new Int32Array(buffer), 0, 0, milliseconds);
  } catch {
    // busy-wait below
  }
  while (performance.now() < end);
}
