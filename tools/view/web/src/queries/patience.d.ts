/** The retry state of one request. */
export declare class Patience {
    private readonly now;
    private readonly random;
    private failures;
    private firstAt;
    /** `now`: milliseconds; `random`: from 0 to 1. */
    constructor(now?: () => number, random?: () => number);
    /** Milliseconds until the next try; null: the answer is final. `retryAfter`: that header, if present. */
    wait(status: number, retryAfter: string | null): number | null;
    /** For a message: the number of failed tries; "" for one. */
    get tried(): string;
}
/** Blocks the worker for this time. */
export declare function waitNow(milliseconds: number): void;
