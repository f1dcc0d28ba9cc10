// The page: asks for the description of the store, creates the parts and connects them.
import { Announcer } from "./announcer";
import { Api } from "./api";
import { Banner } from "./banner";
import { CameraMoves } from "./camera_moves";
import { ClippingPanel } from "./panels/clipping";
import { ColorPanel } from "./panels/color_panel";
import { button, byId, h } from "./dom";
import { ExportPanel } from "./panels/export_panel";
import { bindFragment, fromFragment } from "./fragment";
import { HistogramPanel } from "./panels/histogram";
import { Histograms } from "./histograms";
import { inspection } from "./inspection";
import { bindKeyboard } from "./keyboard";
import { LabelLayers } from "./labels/label_layers";
import { LabelPanel } from "./panels/label_panel";
import { MemoryPanel } from "./panels/memory_panel";
import { MeshDecoder } from "./mesh_decoder";
import { Overlay, readoutLine } from "./overlay";
import { Pointer } from "./pointer";
import { Player } from "./player";
import { Probe } from "./probe";
import type { HistogramInfo, StoreInfo } from "./protocol";
import { bindSheet } from "./panels/sheet";
import { ShownLabel } from "./labels/shown_label";
import { ServerTransport } from "./site/server_transport";
import { chosenStore, readSite, type Site, type SiteSeries, type SiteStore } from "./site/site";
import { aboutPanel, siteList } from "./site/site_list";
import { WorkerTransport } from "./site/worker_transport";
import { Slice } from "./slices";
import { SlicePanel } from "./panels/slice_panel";
import { Stage } from "./stage";
import { defaults, kSliceNames, rangeOf, type SliceName, ViewStore } from "./state";
import { Surface } from "./surface";
import { SurfacePanel } from "./panels/surface_panel";
import { bindTheme } from "./theme";
import { TimePanel } from "./panels/time_panel";
import { viewPanel } from "./panels/view_panel";
import { startingWindow } from "./windows";
import { timeText, whole } from "./words";

const banner = new Banner(byId("banner"), () => location.reload());

/** The source of answers: a server, or the page itself for a store of a published site. */
interface Origin {
  readonly api: Api;
  readonly server: ServerTransport | null;
  readonly published: { readonly site: Site; readonly store: SiteStore } | null;
}

/** Null if the user must first choose from the list, which is then shown. */
async function origin(): Promise<Origin | null> {
  const site = await readSite();
  if (!site) {
    const server = new ServerTransport();
    return { api: new Api(server, new MeshDecoder()), server, published: null };
  }
  let store: SiteStore | null = null;
  try {
    store = chosenStore(site);
  } catch (error) {
    banner.show(error as Error);
  }
  if (!store) {
    bindTheme(() => undefined)("auto");
    document.body.classList.add("list");
    byId("side").hidden = true;
    byId("stage").replaceChildren(siteList(site));
    document.title = site.title;
    return null;
  }
  const whole = (url: string): string => new URL(url, document.baseURI).href;
  const steps = store.series?.steps.map(({ url }) => whole(url)) ?? [];
  return { api: new Api(new WorkerTransport(whole(store.url), steps, site.memory), new MeshDecoder()), server: null, published: { site, store } };
}

async function start(): Promise<void> {
  const from = await origin();
  if (!from) return;
  const { api, published } = from;
  const store = withSeries(await api.store(), published?.store.series);
  const name = published?.store.title ?? store.name;
  byId("store").textContent = name;
  document.title = `${name} – isonest`;
  const histogram: Promise<HistogramInfo | null> = store.labels ? Promise.resolve(null) : api.histogram(store.first_error !== null, {});
  const wanted = new URLSearchParams(location.hash.slice(1)).has("iso");
  // The first surface is the suggested one, unless that takes long to compute, or the URL specifies another.
  const info = wanted || store.dimension === 2 ? null : await within(histogram, 1500);
  run(from, store, histogram, info);
}

/** On a published site, only the list knows that the store is the first step of a series. */
function withSeries(store: StoreInfo, series: SiteSeries | undefined): StoreInfo {
  if (!series) return store;
  const { time_unit, min_value, max_value, steps } = series;
  const bytes = steps.reduce((sum, step) => sum + step.bytes, 0);
  return { ...store, min_value, max_value, file_bytes: bytes, series: { time_unit, times: steps.map(({ time }) => time) } };
}

/** Null if it takes longer than this many milliseconds, or fails. */
function within<T>(promise: Promise<T>, time: number): Promise<T | null> {
  const late = new Promise<null>((resolve) => setTimeout(() => resolve(null), time));
  return Promise.race([promise.catch(() => null), late]);
}

function run({ api, server, published }: Origin, store: StoreInfo, histogram: Promise<HistogramInfo | null>, info: HistogramInfo | null): void {
  // Between integers: if many nodes have the isovalue, the normals at them need the finest level.
  const half = ((store.min_value ?? 0) + (store.max_value ?? 1)) / 2;
  const middle = store.integer && !store.labels && half < (store.max_value ?? 1) ? Math.floor(half) + 0.5 : half;
  const isovalue = store.labels ? 1 : (info?.suggested[0]?.isovalue ?? middle);
  const steps = store.series?.times.length ?? 1;
  const canvas = byId("canvas") as HTMLCanvasElement;
  const initial = defaults(store, isovalue, canvas.clientWidth / Math.max(canvas.clientHeight, 1));
  const views = new ViewStore(fromFragment(location.hash, initial, steps));
  const query = new URLSearchParams(location.hash.slice(1));
  if (query.has("color") && !query.has("colorWindow")) views.set({ colorWindow: rangeOf(store.quantities.find(({ name }) => name === views.state.color)) });
  let stage: Stage;
  try {
    stage = new Stage(canvas, store);
  } catch {
    return noWebGl();
  }
  let player: Player | null = null;
  const failed = (error: Error): void => {
    player?.stop();
    banner.show(error);
  };
  const readout = readoutLine();
  byId("stage").append(readout);
  const probe = new Probe(api, views, stage, store, readout, failed);
  new Overlay(byId("stage"), stage, probe, store);
  new Pointer(views, store, stage, probe);
  let refresh = (): void => undefined; // until the panels exist
  const changed = (): void => refresh();
  const surface = new Surface(api, views, store, stage, changed, failed);
  const slices = new Map<SliceName, Slice>();
  for (const name of kSliceNames) slices.set(name, new Slice(name, api, views, store, stage, changed, failed));
  const refiners = [surface.refiner, ...[...slices.values()].map((slice) => slice.refiner)];
  player = new Player(api, views, store, {
    behind: () => refiners.some((refiner) => refiner.behind),
    busy: () => refiners.some((refiner) => refiner.busy),
    meshes: () => {
      const surfaces = [surface.coarse()].map((parameters) => ({ kind: "surface" as const, parameters }));
      const cuts = [...slices.values()].map((slice) => ({ kind: "slice" as const, parameters: slice.coarse() }));
      return [...surfaces, ...cuts].flatMap(({ kind, parameters }) => (parameters ? [{ kind, parameters }] : []));
    },
  });
  const moves = new CameraMoves(views, store, stage);
  const histogramPanel = new HistogramPanel(views, store);
  const layers = store.labels ? new LabelLayers(api, views, stage, surface, changed, failed) : null;
  const labelPanel = layers && new LabelPanel(api, views, store, layers, failed);
  if (layers) new ShownLabel(api, views, store, stage, surface, (label) => layers.colorOf(label), (name) => histogramPanel.showLabel(name), failed);
  const surfacePanel = new SurfacePanel(views, store, surface);
  const slicePanel = new SlicePanel(views, store, slices, moves);
  const clipping = new ClippingPanel(views, store, stage);
  const colorPanel = store.quantities.length > 0 && store.dimension === 3 ? new ColorPanel(views, store, () => surface.drawn.header) : null;
  const exporting = new ExportPanel(views, store, api, server, stage, surface, slices, failed);
  const memory = new MemoryPanel(
    api, store, () => [surface.drawn, ...(surface.tiled ? [surface.tiled.drawn] : []), ...(layers?.drawn ?? []), ...[...slices.values()].map((slice) => slice.drawn)], failed,
    (how) => banner.storeLost(how), () => banner.serverThere(),
  );
  const flat = store.dimension === 2;
  byId("panel").append(
    ...(published ? [aboutPanel(published.site, published.store)] : []), ...(labelPanel ? [labelPanel.element] : []), ...(flat ? [] : [surfacePanel.choices]), ...(colorPanel ? [colorPanel.element] : []), ...(store.labels ? [] : [slicePanel.element]), ...(flat ? [] : [clipping.element]),
    probe.element, exporting.element, viewPanel(views, store, moves), memory.element,
  );
  if (!flat) byId("dock").append(surfacePanel.state);
  if (store.series) byId("dock").append(new TimePanel(views, store.series, player).element);
  if (!flat) byId("dock").append(histogramPanel.element);
  const announcer = new Announcer(byId("live"));
  const describe = (): string => {
    const bound = surfacePanel.sentence();
    const time = store.series ? `Time ${timeText(store.series, views.state.step)}. ` : "";
    return bound === "" ? "" : `${time}${bound}. ${whole(surface.triangles)} triangles.`;
  };
  refresh = () => {
    surfacePanel.refresh();
    slicePanel.refresh();
    memory.refresh();
    exporting.refresh();
    player?.refresh();
    labelPanel?.refresh();
    colorPanel?.refresh();
    bindSheet.summary(describe());
    announcer.later(describe);
  };
  refresh();
  const setTheme = bindTheme((background, lines) => {
    stage.setBackground(background);
    clipping.setColor(lines);
  });
  views.subscribe((state, keys) => {
    if (keys.has("theme")) setTheme(state.theme);
    refresh();
  });
  const again = (): void => {
    surface.again();
    for (const slice of slices.values()) slice.refiner.again();
    layers?.again();
  };
  banner.retry = again;
  stage.onResize(() => {
    surface.resized();
    for (const slice of slices.values()) slice.refiner.look();
  });
  canvas.addEventListener("webglcontextlost", (event) => event.preventDefault());
  canvas.addEventListener("webglcontextrestored", again);
  for (const event of ["focus", "blur"]) canvas.addEventListener(event, () => stage.invalidate());
  const dialog = byId("help") as HTMLDialogElement;
  bindKeyboard({ views, store, moves, histogram: histogramPanel, probe, player, dialog, savePicture: () => exporting.savePicture() });
  byId("tools").append(
    button("Theme", () => views.set({ theme: document.documentElement.dataset.theme === "dark" ? "light" : "dark" }), { id: "theme-switch", "aria-label": "Switch between light and dark" }),
    button("Help", () => dialog.showModal(), { id: "help-button" }),
  );
  let isFirst = true;
  const histograms = new Histograms(api, views, store, histogramPanel, (info) => {
    slicePanel.showHistogram(info);
    surface.know(info);
    const window = isFirst && !query.has("window") && views.state.window === initial.window ? startingWindow(store, info) : null;
    isFirst = false;
    if (window) views.set({ window });
  }, histogram);
  bindFragment(views, initial, steps);
  window.isonest = inspection({ views, api, stage, surface, slices, panel: surfacePanel, memory, probe, banner, layers, loading: () => Promise.all([histograms.loading, labelPanel?.loading]) });
}

function noWebGl(): void {
  byId("stage").replaceChildren(
    h("div", { class: "empty", id: "no-webgl" }, h("h2", {}, "No picture: this browser has no WebGL 2"),
      h("p", {}, "Turn on hardware acceleration in the browser's settings, or use another browser. The commands isonest extract, picture and slice work without one.")),
  );
  byId("panel").hidden = true;
}

bindSheet();
start().catch((error: unknown) => banner.show(error as Error));
