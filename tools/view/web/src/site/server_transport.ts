// The server of `isonest view`, by HTTP.
import { type Answer, type Transport, Unanswered } from "./transport";

export class ServerTransport implements Transport {
  readonly hasServer = true;
  private readonly token = new URLSearchParams(location.search).get("token");

  /** Also for links: includes the token of the page's own URL. */
  url(target: string): string {
    if (this.token === null) return `api/${target}`;
    return `api/${target}${target.includes("?") ? "&" : "?"}${new URLSearchParams({ token: this.token })}`;
  }

  async ask(target: string, signal: AbortSignal, progress: (bytes: number) => void): Promise<Answer> {
    try {
      const response = await fetch(this.url(target), { signal, cache: "no-store" });
      return { status: response.status, body: await readAll(response, progress) };
    } catch (error) {
      if (!(error instanceof TypeError)) throw error;
      const hint = "Is isonest view still running? If it is restarted at the same address, this page continues.";
      throw new Unanswered(`The server does not answer. ${hint}`, false);
    }
  }

  cancel(stream: string): void {
    fetch(this.url(`cancel?${new URLSearchParams({ stream })}`), { method: "POST", keepalive: true }).catch(() => undefined);
  }
}

async function readAll(response: Response, progress: (bytes: number) => void): Promise<ArrayBuffer> {
  if (!response.body) return response.arrayBuffer();
  const parts: Uint8Array[] = [];
  let length = 0;
  for (const reader = response.body.getReader(); ; ) {
    const { done, value } = await reader.read();
    if (done) break;
    parts.push(value);
    length += value.length;
    progress(length);
  }
  const all = new Uint8Array(length);
  let at = 0;
  for (const part of parts) {
    all.set(part, at);
    at += part.length;
  }
  return all.buffer;
}
