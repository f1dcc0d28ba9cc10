// The memory used by the page and the server, and whether the server and its store are still available.
import type { Api } from "../api";
import { h, section } from "../dom";
import type { StatusInfo, StoreInfo } from "../protocol";
import { bytes, whole } from "../words";

const kPause = 2000; // milliseconds

/** What is on the screen, and the bytes of its arrays. */
export interface Held {
  readonly triangles: number;
  readonly bytes: { readonly page: number; readonly card: number };
}

export class MemoryPanel {
  readonly element: HTMLElement;
  status: StatusInfo | null = null;
  private readonly values = new Map<string, HTMLElement>();

  constructor(
    private readonly api: Api,
    private readonly store: StoreInfo,
    private readonly meshes: () => readonly Held[],
    private readonly failed: (error: Error) => void,
    private readonly lost: (how: string) => void,
    private readonly there: () => void,
  ) {
    const list = h("dl", { class: "figures" });
    const names: readonly (readonly [string, string])[] = [
      ["triangles", "Triangles held"], ["card", "Meshes on the graphics card"], ["page", "Meshes in the page"],
      ["heap", "Page's JavaScript"], ["received", api.hasServer ? "Received so far" : "Meshes made so far"], ["server", api.hasServer ? "Server's heap" : "Library in the page"], ["file", store.series ? "Series" : "Store"],
    ];
    for (const [key, name] of names) {
      const value = h("dd", { id: `memory-${key}` }, "–");
      this.values.set(key, value);
      list.append(h("dt", {}, name), value);
    }
    this.element = section("memory", "Memory", false, list);
    const steps = store.series ? `${whole(store.series.times.length)} steps, ` : "";
    this.set("file", `${steps}${bytes(store.file_bytes)}, ${store.nodes.join(" × ")} ${store.type}`);
    void this.watch();
  }

  get held(): { readonly page: number; readonly card: number; readonly triangles: number } {
    const sum = { page: 0, card: 0, triangles: 0 };
    for (const mesh of this.meshes()) {
      sum.page += mesh.bytes.page;
      sum.card += mesh.bytes.card;
      sum.triangles += mesh.triangles;
    }
    return sum;
  }

  refresh(): void {
    const { page, card, triangles } = this.held;
    this.set("triangles", whole(triangles));
    this.set("card", bytes(card));
    this.set("page", bytes(page));
    const heap = (performance as { memory?: { usedJSHeapSize: number } }).memory?.usedJSHeapSize;
    this.set("heap", heap === undefined ? "not reported by this browser" : bytes(heap));
    this.set("received", bytes(this.api.received));
    if (this.status) this.set("server", `${bytes(this.status.heap_bytes)} of ${bytes(this.store.memory)} allowed`);
  }

  private set(key: string, text: string): void {
    const value = this.values.get(key);
    if (value && value.textContent !== text) value.textContent = text;
  }

  /** Never ends; pauses while the page is hidden. */
  private async watch(): Promise<void> {
    for (;;) {
      if (!document.hidden) {
        try {
          this.status = await this.api.status();
          if (this.status.store === "ok") this.there();
          else this.lost(this.status.store);
        } catch (error) {
          this.failed(error as Error);
        }
        this.refresh();
      }
      await new Promise((resolve) => setTimeout(resolve, kPause));
    }
  }
}
