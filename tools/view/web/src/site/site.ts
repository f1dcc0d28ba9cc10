// A published site: which stores it shows. Its page names its list, site.json, in a <meta>; the page of `isonest view` names none.

/** `isonest publish` writes it. */
export interface SiteStore {
  /** What a link calls it by. */
  readonly name: string;
  readonly url: string;
  readonly title: string;
  readonly description: string;
  readonly license: string;
  readonly bytes: number;
  readonly nodes: readonly number[];
  readonly type: string;
  /** Of length; null where it is not known. */
  readonly unit: string | null;
}

export interface Site {
  readonly title: string;
  readonly description: string;
  readonly license: string;
  /** Bytes that the library in the page may hold. */
  readonly memory: number;
  readonly stores: readonly SiteStore[];
}

const kVersion = 1;

/** Null on a page that has a server. Rejects with Error if the list cannot be read. */
export async function readSite(): Promise<Site | null> {
  const list = document.querySelector<HTMLMetaElement>('meta[name="isonest-site"]')?.content;
  if (list === undefined) return null;
  if (location.protocol === "file:") {
    throw new Error("A browser shows this page only from a web server. Put the folder on one that answers ranges, and open its address.");
  }
  const response = await fetch(list, { cache: "no-cache" }).catch(() => null);
  if (!response?.ok) throw new Error(`The list of stores, ${list}, cannot be read${response ? `: the server answers ${response.status}` : ""}.`);
  const site = (await response.json().catch(() => null)) as { isonest_site?: unknown } | null;
  if (!site || site.isonest_site !== kVersion) throw new Error(`${list} is no list of stores that this page knows: publish the folder anew.`);
  return checked(site as unknown as Site, list);
}

function checked(site: Site, list: string): Site {
  const text = (...values: readonly unknown[]): boolean => values.every((value) => typeof value === "string");
  const right = (store: SiteStore): boolean =>
    text(store.name, store.url, store.title, store.description, store.license, store.type) && Number.isFinite(store.bytes) &&
    Array.isArray(store.nodes) && /^https?:$/.test(new URL(store.url, document.baseURI).protocol);
  const whole = text(site.title, site.description, site.license) && Number.isFinite(site.memory) && Array.isArray(site.stores) && site.stores.length > 0;
  if (!whole || !site.stores.every(right)) throw new Error(`${list} is damaged: publish the folder anew.`);
  return site;
}

/** The store that the page's URL names by `?store=`, or the only one; null: none is named. Throws Error if there is none of that name. */
export function chosenStore(site: Site): SiteStore | null {
  const name = new URLSearchParams(location.search).get("store");
  if (name === null) return site.stores.length === 1 ? site.stores[0]! : null;
  const store = site.stores.find((one) => one.name === name);
  if (!store) throw new Error(`This site has no store "${name}".`);
  return store;
}

/** Of the page with this store, and the view that it begins with. */
export function pageOf(store: SiteStore): string {
  return `?${new URLSearchParams({ store: store.name })}`;
}
