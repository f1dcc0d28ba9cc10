// When and how often a server is asked again that answers that it cannot now. The numbers are those of the program (store/remote).

const kBusy: readonly number[] = [408, 429, 500, 502, 503, 504];
const kMostAttempts = 6;
const kFirstWait = 250; // milliseconds; each wait is twice the one before
const kLongestWait = 8000;
const kTotal = 60_000; // from the first failure on

/** Of one request. */
export class Patience {
  private failures = 0;
  private firstAt = 0;

  /** `now`: milliseconds; `random`: from 0 to 1. */
  constructor(
    private readonly now: () => number = () => performance.now(),
    private readonly random: () => number = Math.random,
  ) {}

  /** Milliseconds after which to ask again; null: what has come is the answer. `retryAfter`: that header, if it is there. */
  wait(status: number, retryAfter: string | null): number | null {
    if (!kBusy.includes(status)) return null;
    const now = this.now();
    if (this.failures === 0) this.firstAt = now;
    this.failures += 1;
    if (this.failures >= kMostAttempts) return null;
    const grown = Math.min(kFirstWait * 2 ** (this.failures - 1), kLongestWait) * (0.5 + 0.5 * this.random());
    const wait = Math.max(grown, askedFor(retryAfter));
    return now + wait > this.firstAt + kTotal ? null : wait;
  }

  /** For a message: how often it was asked in vain; "" for once. */
  get tried(): string {
    return this.failures > 1 ? ` (asked ${this.failures} times)` : "";
  }
}

/** Milliseconds; 0 if it says nothing. Source: RFC 9110, section 10.2.3. */
function askedFor(retryAfter: string | null): number {
  if (retryAfter === null) return 0;
  if (/^\d+$/.test(retryAfter.trim())) return 1000 * Number(retryAfter);
  const at = Date.parse(retryAfter);
  return Number.isNaN(at) ? 0 : Math.max(0, at - Date.now());
}

/** A worker that has to wait: nothing else is done meanwhile. */
export function waitNow(milliseconds: number): void {
  const end = performance.now() + milliseconds;
  try {
    // Shared memory that pages have without being isolated from others.
    const { buffer } = new WebAssembly.Memory({ initial: 1, maximum: 1, shared: true });
    Atomics.wait(new Int32Array(buffer), 0, 0, milliseconds);
  } catch {
    // then the time passes below
  }
  while (performance.now() < end);
}
