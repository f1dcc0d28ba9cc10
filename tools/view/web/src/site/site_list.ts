// The list of a site's stores, and the description of the one that is shown.
import { h, section } from "../dom";
import { bytes } from "../words";
import { pageOf, type Site, type SiteStore } from "./site";

/** The known properties of a store that is not open: "512 × 512 × 512 float32, mm, 1.2 GB". */
function figures(store: SiteStore): string {
  const steps = store.series ? [`${store.series.steps.length} steps`] : [];
  return [...steps, `${store.nodes.join(" × ")} ${store.type}`, store.unit ?? "unit of length not known", bytes(store.bytes)].join(", ");
}

function licence(text: string): HTMLElement[] {
  return text === "" ? [] : [h("p", { class: "note" }, `Licence: ${text}`)];
}

function paragraphs(text: string): HTMLElement[] {
  return text.split(/\n\s*\n/).filter((part) => part.trim() !== "").map((part) => h("p", {}, part));
}

/** Shown instead of the picture. */
export function siteList(site: Site): HTMLElement {
  const entry = (store: SiteStore): HTMLElement =>
    h("li", {}, h("h3", {}, h("a", { href: pageOf(store) }, store.title)), ...paragraphs(store.description), h("p", { class: "note" }, figures(store)), ...licence(store.license));
  return h(
    "div", { id: "stores", class: "stores" },
    h("h2", {}, site.title), ...paragraphs(site.description), ...licence(site.license), h("ul", {}, ...site.stores.map(entry)),
  );
}

/** A section of the panel. */
export function aboutPanel(site: Site, store: SiteStore): HTMLElement {
  const others = site.stores.length > 1 ? [h("p", {}, h("a", { href: location.pathname, id: "all-stores" }, `All ${site.stores.length} stores of this site`))] : [];
  return section("about", "About", store.description !== "", ...paragraphs(store.description), h("p", { class: "note" }, figures(store)), ...licence(store.license), ...others);
}
