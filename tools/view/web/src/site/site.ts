// A published site and its stores. Its page names the list, site.json, in a <meta>; the page of `isonest view` has
// none.

/** The steps of a series: all that the page needs to know of them before they are opened. */
export interface SiteSeries {
  readonly time_unit: string | null;
  /** Of all steps; null if there are no values. */
  readonly min_value: number | null;
  readonly max_value: number | null;
  readonly steps: readonly { readonly time: number; readonly url: string; readonly bytes: number }[];
}

/** Written by `isonest publish`. Properties of a series are those of its first step, and `bytes` is the sum. */
export interface SiteStore {
  /** Its name in links. */
  readonly name: string;
  readonly url: string;
  readonly title: string;
  readonly description: string;
  readonly license: string;
  readonly bytes: number;
  readonly nodes: readonly number[];
  readonly type: string;
  /** Of length; null if unknown. */
  readonly unit: string | null;
  readonly series?: SiteSeries;
}

export interface Site {
  readonly title: string;
  readonly description: string;
  readonly license: string;
  /** Memory budget in bytes of the library in the page. */
  readonly memory: number;
  readonly stores: readonly SiteStore[];
}

const kVersion = 1;

/** Null on a page with a server. Rejects with Error if the list cannot be read. */
export async function readSite(): Promise<Site | null> {
  const list = document.querySelector<HTMLMetaElement>('meta[name="isonest-site"]')?.content;
  if (list === undefined) return null;
  if (location.protocol === "file:") {
    throw new Error("This page works only from a web server. Put the folder on a server that supports range requests, and open its URL.");
  }
  const response = await fetch(list, { cache: "no-cache" }).catch(() => null);
  if (!response?.ok) throw new Error(`The list of stores, ${list}, cannot be read${response ? `: the server answers ${response.status}` : ""}.`);
  const site = (await response.json().catch(() => null)) as { isonest_site?: unknown } | null;
  if (!site || site.isonest_site !== kVersion) throw new Error(`${list} is not a list of stores that this page can read: publish the folder again.`);
  return checked(site as unknown as Site, list);
}

function checked(site: Site, list: string): Site {
  const text = (...values: readonly unknown[]): boolean => values.every((value) => typeof value === "string");
  const isUrl = (url: string): boolean => /^https?:$/.test(new URL(url, document.baseURI).protocol);
  const rightSeries = ({ steps }: SiteSeries): boolean =>
    Array.isArray(steps) && steps.length > 0 && steps.every(({ time, url, bytes }) => Number.isFinite(time) && text(url) && isUrl(url) && Number.isFinite(bytes));
  const right = (store: SiteStore): boolean =>
    text(store.name, store.url, store.title, store.description, store.license, store.type) && Number.isFinite(store.bytes) &&
    Array.isArray(store.nodes) && isUrl(store.url) && (store.series === undefined || rightSeries(store.series));
  const whole = text(site.title, site.description, site.license) && Number.isFinite(site.memory) && Array.isArray(site.stores) && site.stores.length > 0;
  if (!whole || !site.stores.every(right)) throw new Error(`${list} is damaged: publish the folder again.`);
  return site;
}

/** The store in `?store=` of the page's URL, or the only one; null: none is named. Throws Error if it does not exist. */
export function chosenStore(site: Site): SiteStore | null {
  const name = new URLSearchParams(location.search).get("store");
  if (name === null) return site.stores.length === 1 ? site.stores[0]! : null;
  const store = site.stores.find((one) => one.name === name);
  if (!store) throw new Error(`This site has no store "${name}".`);
  return store;
}

/** The URL of the page with this store and its initial view. */
export function pageOf(store: SiteStore): string {
  return `?${new URLSearchParams({ store: store.name })}`;
}
