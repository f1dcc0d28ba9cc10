"""Surfaces of labels, smooth and staircases, and interfaces."""
import numpy as np

from . import judges, volumes
from .tries import Seen, Wrong, ask, blurred, kind, near, require, store_of, topology
from .parts import kept_triangles
from .within_errors import own_full


def label_volume(one):
    """Difficult labels: many neighbours, single voxels, corners that touch, large and negative numbers."""
    sizes = tuple(int(one.random.integers(2, one.pick(4, 8, 12))) for _ in range(3))
    names = np.arange(one.pick(2, 3, 5, 40))
    how = one.random.integers(5)
    if how == 0:
        u = one.random.choice(names, sizes)
    elif how == 1:
        points = one.random.random((one.pick(3, 9, 30), 3)) * sizes
        at = np.stack(np.meshgrid(*map(np.arange, sizes), indexing="ij"), -1).reshape(-1, 1, 3)
        u = one.random.choice(names, len(points))[((at - points) ** 2).sum(-1).argmin(1)].reshape(sizes)
    elif how == 2:
        u = np.zeros(sizes, int)
        for _ in range(6):
            u[tuple(one.random.integers(0, n) for n in sizes)] = one.random.choice(names)
    elif how == 3:
        u = volumes.SHAPES[one.pick("shells", "tori", "sheets", "checkerboard", "blocks", "needle")](one, sizes) > 0.5
        u = u * 1
    else:
        u = np.arange(np.prod(sizes)).reshape(sizes) % one.pick(2, 7, 1000)
    dtype, large = one.pick(("u1", False), ("u2", False), ("i2", False), ("i4", False), ("f8", False), ("i8", True))
    u = u.astype(dtype) if dtype != "u1" else (u % 256).astype("u1")
    if large:
        u = np.where(u > 0, u + one.pick(2 ** 40, 2 ** 61), 0)
    elif dtype in ("i2", "i4", "f8") and one.chance(0.3):
        u = (u - 2).astype(dtype)
    elif dtype in ("u1", "u2", "i2", "i4", "f8") and one.chance(0.3):  # the largest possible numbers
        last = 2 ** 53 if dtype == "f8" else np.iinfo(dtype).max
        u = np.where(u > 0, last + 1 - u.astype(float), 0).astype(dtype)
    elif dtype == "f8" and one.chance(0.4):
        u[one.random.random(sizes) < 0.1] = np.nan
    spacing, origin, axes = volumes.place(one)
    if large:
        axes = np.eye(3)
    return volumes.Volume(u, spacing, origin, axes, "labels"), large


def staircase(u, label, border):
    """The voxel faces between a label and everything else, as triangles, in nodes; at the border only if requested."""
    mask = np.pad(u == label, 1)
    padded = np.pad(np.ones(u.shape, bool), 1)
    quads = []
    for axis in range(3):
        lower = tuple(slice(0, n - (a == axis)) for a, n in enumerate(mask.shape))
        upper = tuple(slice(int(a == axis), n) for a, n in enumerate(mask.shape))
        between = mask[lower] != mask[upper]
        if not border:
            between &= padded[lower] & padded[upper]
        at = np.argwhere(between)[:, ::-1] - 1.0
        normal = 2 - axis
        p, q = (np.eye(3)[(normal + k) % 3] / 2 for k in (1, 2))
        centre = at + np.eye(3)[normal] / 2
        quads += [np.stack([centre - p - q, centre + p - q, centre + p + q], 1),
                  np.stack([centre - p - q, centre + p + q, centre - p + q], 1)]
    return np.concatenate(quads)


def node_windings(one, volume, meshes, u, skip=None):
    """Every node is inside its own label's mesh and no other."""
    nodes = np.stack(np.meshgrid(*(np.arange(n) for n in u.shape[::-1]), indexing="ij"), -1).reshape(-1, 3)
    chosen = one.random.choice(len(nodes), min(len(nodes), 120), replace=False)
    own = u[nodes[chosen, 2], nodes[chosen, 1], nodes[chosen, 0]]
    for label, seen in meshes.items():
        found = judges.windings(nodes[chosen] * volume.scale, seen.t) if len(seen.t) else np.zeros(len(chosen))
        bad = np.abs(found - (own == label)) > 1e-3
        if skip is not None:
            bad &= ~skip(nodes[chosen])
        if bad.any():
            i = np.flatnonzero(bad)[0]
            raise Wrong(f"node {nodes[chosen[i]]} of label {own[i]}: winding number {found[i]} of label {label}")


@kind
def labels(one):
    """Smooth labels: nodes are on the right side, near the staircase, neighbours share vertices, interfaces match."""
    volume, large = label_volume(one)
    store = store_of(one, volume, **({"labels": True} if large or one.chance(0.2) else {}))
    options = {"smooth": one.pick(True, True, 0, 1, 3, 64)}
    if one.chance(0.7):
        options["close"] = True
    if one.chance(0.5):
        options["distance"] = float(one.random.random() ** 2 * 3 * volume.unit)
        options["keep_nodes"] = one.pick(True, False)
    meshes = {k: Seen(m, volume) for k, m in
              ask(one, store.label_surfaces, coordinates="world", **options).items()}
    good = np.isfinite(volume.u.astype(float))
    present = {int(v) for v in np.unique(volume.u[good])} - {0}
    require(set(meshes) == present, f"meshes of {sorted(meshes)}, labels {sorted(present)}")
    if not meshes:
        return
    first = next(iter(meshes.values()))
    blurred(first)
    every, some = meshes, sorted(meshes)
    meshes = {k: meshes[k] for k in one.random.permutation(len(some))[:8].astype(int) for k in (some[k],)}
    if options.get("close"):
        for label, seen in meshes.items():
            directed = np.concatenate([seen.f[:, [0, 1]], seen.f[:, [1, 2]], seen.f[:, [2, 0]]])
            there, back = (sorted(map(tuple, d.tolist())) for d in (directed, directed[:, ::-1]))
            require(there == back, f"label {label} is not closed")
            enclosed = judges.volume(seen.t)
            said = seen.report.volume / volume.unit ** 3 if 1e-25 < volume.unit < 1e25 else enclosed
            require(abs(said - enclosed) <= 1e-6 * abs(enclosed) + 4 * seen.blur * judges.areas(seen.t).sum() + 1e-9,
                    f"volume {said} of label {label}, computed {enclosed}")
        skip = None
        if "distance" in options and not options["keep_nodes"]:
            # Nodes nearer than nodes_beyond to the space between labels may be on any side.
            whole = {k: Seen(m, volume) for k, m in ask(one, store.label_surfaces, coordinates="world",
                                                        smooth=options["smooth"], close=True).items()}
            require(set(whole) == set(every), "other labels within a distance")
            everything = np.concatenate([m.t for m in whole.values()])
            beyond = first.report.nodes_beyond / volume.unit * (1 + 1e-9) + 2 * first.blur
            def skip(nodes):  # noqa: E306
                return np.array([judges.farthest(p[None], everything, 0) <= beyond for p in nodes * volume.scale])
        node_windings(one, volume, meshes, volume.u, skip)
    label = one.pick(*sorted(meshes))
    seen, stairs = meshes[label], staircase(volume.u, label, bool(options.get("close"))) * volume.scale
    if not np.isfinite(volume.u.astype(float)).all() and not options.get("close"):
        stairs = staircase(volume.u, label, False) * volume.scale
    bound = seen.report.smooth_bound / volume.unit
    most = bound * (1 + 1e-9) + 2 * seen.blur
    require((len(stairs) == 0) == (len(seen.t) == 0), f"{len(seen.t)} triangles, {len(stairs)} of the staircase")
    if "distance" not in options:
        diagonal = np.linalg.norm(volume.scale)
        require(bound <= 0.5 * diagonal, f"smooth_bound {bound} of the diagonal {diagonal}")
    if len(stairs):
        found = judges.apart(one.random, seen.t, stairs, most, 150)
        require(found <= most, f"{found} from the staircase of label {label}, smooth_bound {bound}")
    interfaces(one, store, volume, meshes, options)


def interfaces(one, store, volume, meshes, options):
    """The labels' meshes from the interfaces, and the area of each pair."""
    mesh = ask(one, store.interfaces, coordinates="world", **options)
    of = np.asarray(mesh.labels)
    keys = np.array(judges.keys(mesh.vertices, mesh.faces), object)
    back = np.array(judges.keys(mesh.vertices, mesh.faces[:, ::-1]), object)
    require(len(set(keys)) == len(keys), "a triangle stands twice")
    if len(of):
        outside = mesh.report.outside
        require((of[:, 0] != of[:, 1]).all(), "a triangle between one label")
        require(((of[:, 0] < of[:, 1]) | (of[:, 1] == outside)).all() and (of[:, 0] != outside).all(), "labels in another order")
    for label, seen in meshes.items():
        mine = sorted([*keys[of[:, 0] == label], *back[of[:, 1] == label]]) if len(of) else []
        require(mine == sorted(judges.keys(seen.mesh.vertices, seen.mesh.faces)),
                f"label {label} is not what is cut from the interfaces")
    t, unit = Seen(mesh, volume).t, volume.unit
    if 1e-25 < unit < 1e25:
        for pair, area in mesh.areas.items():
            mine = judges.areas(t[(of == pair).all(1)]).sum()
            require(abs(area / unit ** 2 - mine) <= 1e-5 * mine + 1e-9 + 100 * Seen(mesh, volume).blur * len(t),
                    f"area {area} between {pair}, computed {mine}")


@kind
def stepped_labels(one):
    """Labels without --smooth: the isosurface 1/2 of the label's nodes; closed, simplified, its components."""
    volume, large = label_volume(one)
    store = store_of(one, volume, **({"labels": True} if large else {}))
    names = [int(v) for v in np.unique(volume.u[np.isfinite(volume.u.astype(float))])]
    if not names:
        return
    label = one.pick(*names)
    options = {"cells": one.pick("tet", "hex")}
    if one.chance(0.5):
        options["close"] = True
    base = Seen(ask(one, store.label_surface, label, coordinates="world", **options), volume)
    blurred(base)
    mask = (volume.u == label).astype(float)
    if "close" not in options and options["cells"] == "tet":
        mine = own_full(volumes.Volume(mask, volume.spacing, volume.origin, volume.axes, ""), 0.5)
        a, b = judges.areas(base.t).sum(), judges.areas(mine).sum()
        require(abs(a - b) <= 1e-4 * b + 100 * base.blur * (len(mine) + 1), f"area {a}, expected {b}")
    require(not judges.faults(base.f, "close" in options), judges.faults(base.f, "close" in options))
    if "close" in options:
        node_windings(one, volume, {label: base}, volume.u, skip=lambda p: border(p, volume))
    if one.chance(0.6):
        d = float(one.random.random() * 2 * volume.unit)
        small = Seen(ask(one, store.label_surface, label, coordinates="world", distance=d, **options,
                         **one.pick({}, {"effort": "fast"})), volume)
        require(small.report.distance_bound <= d * (1 + 1e-12), "beyond the distance")
        near(one, volume, small, base)
        require(topology(small) == topology(base), f"topology {topology(base)} -> {topology(small)}")


@kind
def label_parts(one):
    """Components of smooth labels, compared with scipy's components of the complete meshes."""
    volume, large = label_volume(one)
    store = store_of(one, volume, **({"labels": True} if large else {}))
    options = {"smooth": one.pick(True, 0, 3), "close": one.pick(True, None)}
    chosen = {}
    if one.chance(0.6):
        chosen["components"] = one.pick("largest", "all", 2, 5)
    if one.chance(0.4) or not chosen:
        chosen["min_component"] = int(one.pick(2, 12, 13, 30, 100))
    if one.chance(0.3):
        chosen["min_volume"] = float(one.random.random() ** 2 * 20 * np.prod(volume.spacing))
    whole = ask(one, store.label_surfaces, coordinates="world", **options)
    parts = ask(one, store.label_surfaces, coordinates="world", **options, **chosen)
    require(set(whole) == set(parts), f"labels {sorted(parts)}, not {sorted(whole)}")
    for label, mesh in whole.items():
        seen = Seen(mesh, volume)
        expected, dropped, count = kept_triangles(seen, volume, chosen)
        found = parts[label]
        require(sorted(judges.keys(found.vertices, found.faces)) == expected,
                f"{len(found.faces)} triangles of label {label} are kept, expected {len(expected)} of {count} components")
        require(found.report.dropped_components == dropped, f"dropped {found.report.dropped_components}, not {dropped}")


def border(p, volume):
    """Nodes in the faces of the volume, where a closed staircase has its caps."""
    return ((p == 0) | (p == np.array(volume.u.shape[::-1]) - 1)).any(1)
