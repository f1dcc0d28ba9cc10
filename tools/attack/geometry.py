#!/usr/bin/python3
"""Attacks what is promised of surfaces, slices and labels: random hard volumes, random questions, judges of another kind.

The judges compute the data's function and its surface from the values alone (surfaces/function.py), and look at meshes with
VTK, scipy and brute force (surfaces/judges.py). Lengths are compared in the smallest distance between nodes.
"""
import functools
import json
import re
import struct
import sys
import traceback
import zipfile

import attack

np, _vtk, _scipy = attack.require("numpy", "vtk", "scipy")
from scipy.spatial import cKDTree  # noqa: E402
from surfaces import function, judges, volumes  # noqa: E402


class Refused(Exception):
    pass


class Wrong(Exception):
    pass


def require(good, *what):
    if not good:
        raise Wrong(" ".join(map(str, what)))


def kind(function_of_one):
    """A kind of tries: what it raises becomes the try's result."""
    @functools.wraps(function_of_one)
    def tried(one):
        one.isonest = attack.package(one.program)
        one.said = []
        try:
            function_of_one(one)
        except Refused as why:
            return attack.refused(str(why))
        except Wrong as what:
            return attack.wrong("\n".join([*map(str, one.said), str(what)]))
        except Exception:
            return attack.wrong("\n".join([*map(str, one.said), traceback.format_exc()]))
        return attack.SAME
    return tried


def ask(one, call, *arguments, **options):
    """What isonest answers. An error of isonest ends the try as refused."""
    words = [a for a in map(str, arguments) if len(a) < 200 and not a.startswith("<")]
    one.said.append(f"{call.__name__}({', '.join([*words, *(f'{k}={v!r}' for k, v in options.items())])})")
    try:
        return call(*arguments, **options)
    except one.isonest.Error as error:
        said = re.sub(r"'[^']*\.(isonest|nrrd)'", "STORE", str(error).replace(str(one.folder), ""))
        raise Refused(f"{type(error).__name__}: " + re.sub(r"[-+]?\d[\d.e+-]*", "N", said)[:240]) from error


def store_of(one, volume, name="v", **options):
    one.said.append(f"{volume.what} {volume.u.dtype} {volume.u.shape} spacing {volume.spacing.tolist()} "
                    f"origin {volume.origin.tolist()} axes {volume.axes.tolist()} {options}")
    np.save(one.folder / f"{name}.npy", volume.u)
    return ask(one, volume.save, one, one.isonest, name, **options)


def surface(one, store, iso, **options):
    return ask(one, store.isosurface, iso, coordinates="world", normals=False, **options)


class Seen:
    """A mesh beside its volume: vertices in nodes and in smallest spacings, triangles, rounding."""

    def __init__(self, mesh, volume):
        self.mesh, self.report, self.f = mesh, mesh.report, np.asarray(mesh.faces)
        require(np.isfinite(mesh.vertices).all(), "vertices that are not finite")
        self.nodes = volume.nodes(mesh.vertices)
        self.scaled = self.nodes * volume.scale
        self.f = self.f if self.f.shape[1] == 3 else np.column_stack([self.f, self.f[:, 1]])
        self.t = self.scaled[self.f]
        double = 1e-15 * np.abs(volume.world([[0, 0, 0], np.array(volume.u.shape[::-1])])).max()  # the judge's own rounding
        self.rounding = mesh.report.coordinate_rounding + 1e-12 + double / volume.spacing.min()
        self.blur = float(np.linalg.norm(self.rounding * volume.scale))


def blurred(seen):
    """Where float32 cannot tell nodes from each other, there is nothing to compare."""
    if seen.rounding > 0.1:
        raise Refused("coordinates are rounded by more than a tenth of a voxel")


def inside(volume, low=0, high=None):
    high = np.array(volume.u.shape[::-1]) - 1 if high is None else high
    return low, high


def some_box(one, volume):
    """A box in the volume or across its border, in nodes; sometimes with faces through nodes."""
    size = np.array(volume.u.shape[::-1]) - 1
    a, b = np.sort(one.random.uniform(-0.2, 1.2, (2, 3)) * size, axis=0)
    if one.chance(0.25):
        a, b = np.floor(a), np.ceil(b)
    if one.chance(0.2):
        a, b = np.zeros(3), size.astype(float)
    b = np.where(b - a < 1e-3 * (size + 1), a + 0.3, b)
    return a, b


def world_box(volume, a, b):
    return tuple(map(tuple, (volume.world([a, b])).tolist()))


def error_options(one, volume, store):
    """An error, asked for in one of the ways, and by one of the guarantees."""
    e = volumes.error(one, volume.u)
    kind = one.random.integers(6)
    if kind == 0:
        return {"error_relative": float(one.pick(0, 1e-3, 0.05, 0.3, 1, one.random.random()))}
    if kind == 1:
        return {"error": e, "guarantee": "plus"}
    if kind == 2:
        return {"stop": one.pick("linf_plus", "deviation_bar"), "threshold": e}
    return {"error": e}


def on_surface(one, volume, seen, iso, bound, count=400):
    """|f - iso| <= bound at many points of the mesh."""
    points = judges.samples(one.random, seen.nodes[seen.f], count)
    over, at = function.away(volume.u, function.Slopes(volume.u), points, iso, bound(points) if callable(bound) else bound,
                             seen.rounding)
    require(over <= 0, f"|f - {iso!r}| is {over} above its bound at node {at}")


def asked_error(options, volume, report):
    if "error_relative" in options:
        return options["error_relative"] * report.value_range
    return options.get("error", options.get("threshold", 0.0))


@kind
def error(one):
    """Tetrahedra within an error: the values, by all guarantees, in boxes, near a focus, with exact vertices."""
    volume = volumes.volume(one, least=1)
    iso = volumes.isovalue(one, volume.u)
    store = store_of(one, volume, chunk=one.pick(8, 16, 64))
    options = error_options(one, volume, store)
    focus = None
    if one.chance(0.2) and not volume.turned:
        options["box"] = world_box(volume, *some_box(one, volume))
    if one.chance(0.2) and "stop" not in options:
        focus = some_box(one, volume)
        options["focus"], options["falloff"] = world_box(volume, *focus), float(one.random.random() / volume.unit)
    if one.chance(0.2):
        options["vertices"] = "exact"
    seen = Seen(surface(one, store, iso, **options), volume)
    blurred(seen)
    asked = asked_error(options, volume, seen.report) * (2 if options.get("vertices") == "exact" else 1)
    bound = seen.report.error_bound
    if focus:
        low, high = focus
        def bound(p):  # noqa: E306
            d = np.linalg.norm((p - np.clip(p, low, high)) * volume.spacing, axis=1)
            return asked * (1 + options["falloff"] * d) * (1 + 1e-9)
    else:
        require(bound <= asked, f"error_bound {bound!r} above {asked!r}")
    on_surface(one, volume, seen, iso, bound)
    require(not judges.faults(seen.f, False) or seen.mesh.faces.shape[1] == 2, judges.faults(seen.f, False))


@kind
def simplify_error(one):
    """--simplify within an error: the values again."""
    volume = volumes.volume(one, most=14)
    iso = volumes.isovalue(one, volume.u)
    store = store_of(one, volume)
    options = {"error": volumes.error(one, volume.u), "simplify": True}
    if one.chance(0.3):
        options["guarantee"] = "plus"
    if one.chance(0.2):
        options["vertices"] = "exact"
    if one.chance(0.2) and not volume.turned:
        options["box"] = world_box(volume, *some_box(one, volume))
    if one.chance(0.2):
        options |= {"triangles": int(one.random.integers(1, 2000)), "by": "error"}
        del options["error"]
        options.pop("guarantee", None)
    seen = Seen(surface(one, store, iso, **options), volume)
    blurred(seen)
    if "error" in options:
        require(seen.report.error_bound <= options["error"] * (1 if options.get("vertices") != "exact" else 2),
                f"error_bound {seen.report.error_bound!r} above {options['error']!r}")
    else:
        require(len(seen.f) <= options["triangles"], f"{len(seen.f)} of {options['triangles']} triangles")
    on_surface(one, volume, seen, iso, seen.report.error_bound)
    require(not judges.faults(seen.f, False), judges.faults(seen.f, False))


def own_full(volume, iso):
    """The surface of the finest tetrahedra, in smallest spacings."""
    corners, values = function.tetrahedra(volume.u)
    triangles, _ = function.march(corners, values, iso)
    return triangles * volume.scale


def crossings(u, iso):
    """Where edges of the finest lattice cross the isovalue, in nodes; only those of a cube without missing values."""
    good = np.isfinite(u)
    cubes = np.ones(np.array(u.shape) - 1, bool)
    for z in (0, 1):
        for y in (0, 1):
            for x in (0, 1):
                cubes &= good[tuple(slice(o, n - 1 + o) for o, n in zip((z, y, x), u.shape))]
    padded = np.pad(cubes, 1)
    points = []
    for axis in range(3):
        lower = [slice(0, n - (a == axis)) for a, n in enumerate(u.shape)]
        upper = [slice(int(a == axis), n) for a, n in enumerate(u.shape)]
        a, b = (u[tuple(s)].astype(float) for s in (lower, upper))
        beside = np.zeros(a.shape, bool)
        others = [o for o in range(3) if o != axis]
        for p in (0, 1):
            for q in (0, 1):
                window = [None] * 3
                window[axis] = slice(1, 1 + a.shape[axis])
                window[others[0]] = slice(p, p + a.shape[others[0]])
                window[others[1]] = slice(q, q + a.shape[others[1]])
                beside |= padded[tuple(window)]
        at = np.argwhere(beside & ((a >= iso) != (b >= iso)))
        va, vb = a[tuple(at.T)], b[tuple(at.T)]
        p = at[:, ::-1].astype(float)
        p[:, 2 - axis] += (iso - va) / (vb - va)
        points.append(p)
    return np.concatenate(points)


def nearest(points, places):
    """How far points are from the nearest of some places, at most."""
    if not len(points):
        return 0.0
    return cKDTree(places).query(points)[0].max() if len(places) else np.inf


@kind
def full(one):
    """Full resolution: tetrahedra beside the judge's own surface; the vertices of hexahedra beside the edges crossed."""
    volume = volumes.volume(one, most=16)
    iso = volumes.isovalue(one, volume.u)
    hexahedra = one.chance(0.5)
    if hexahedra and one.chance(0.4) and not volume.turned:
        mesh = ask(one, one.isonest.isosurface, volume.u, iso, spacing=tuple(volume.spacing[::-1]), normals=False)
        volume.origin = np.zeros(3)
        np.save(one.folder / "v.npy", volume.u)
        mesh = mesh.in_world()
    else:
        mesh = surface(one, store_of(one, volume), iso, cells="hex" if hexahedra else "tet")
    seen = Seen(mesh, volume)
    blurred(seen)
    require(not judges.faults(seen.f, False), judges.faults(seen.f, False))
    on_surface(one, volume, seen, iso, 0.0) if not hexahedra else None
    most = 4 * seen.blur + 3e-4 * volume.scale.max()
    if hexahedra:
        expected = crossings(volume.u, iso)
        # Crossings at a node are left out where they leave a triangle no area; larger polygons may have a middle in their cell.
        certain = expected[np.abs(expected - np.rint(expected)).max(1) > 1e-3] * volume.scale
        beside = (np.abs(seen.nodes - np.rint(seen.nodes)) > 8 * seen.rounding + 3e-4).sum(1) > 1
        found = max(nearest(certain, seen.scaled), nearest(seen.scaled[~beside], expected * volume.scale))
        require(found <= most, f"a vertex {found} from the crossings, or the other way round")
        require(not beside.any() or len(certain), "middles of cells without crossings")
        return
    mine = own_full(volume, iso)
    a, b = judges.areas(seen.t).sum(), judges.areas(mine).sum()
    slack = most * 10 * (len(mine) + 1) ** 0.5 * volume.scale.max() + 1e-5 * a
    require(abs(a - b) <= slack or seen.rounding > 1e-4, f"area {a}, expected {b}")
    mine = mine[judges.areas(mine) > 0]
    if len(mine) or len(seen.t):
        found = judges.apart(one.random, seen.t, mine, most) if len(mine) and len(seen.t) else np.inf
        require(found <= most or b < slack, f"{found} from the judge's surface")


def ordinary(one, volume, distances=True):
    """Options of a surface within a distance."""
    options = {"distance": float(one.pick(0, 0.01, 0.3, 0.5, 1, 3, one.random.random() * 4) * volume.unit)}
    how = one.random.integers(4)
    if how == 0:
        options["effort"] = "fast"
    elif how == 1:
        options["no_simplify"] = True
    if one.chance(0.4):
        options["cells"] = "tet" if options.get("no_simplify") else one.pick("tet", "hex")
    if one.chance(0.2) and not options.get("no_simplify"):
        options["close"] = one.pick("below", "above")
    if one.chance(0.2) and not volume.turned:
        options["box"] = world_box(volume, *some_box(one, volume))
    if one.chance(0.15) and not options.get("no_simplify"):
        options |= one.pick({"components": 2}, {"min_component": 30}, {"min_volume": 3 * float(np.prod(volume.spacing))})
    return options


def full_options(options):
    """Those of the surface that a distance is measured from."""
    cells = options.get("cells") or ("tet" if options.get("no_simplify") else "hex")
    return {k: v for k, v in options.items() if k in ("close", "box", "components", "min_component", "min_volume")} | {"cells": cells}


def near(one, volume, seen, whole):
    """The two-sided distance within what the report says."""
    bound = seen.report.distance_bound / volume.unit
    most = bound * (1 + 1e-9) + seen.blur + whole.blur
    require((len(seen.t) == 0) == (len(whole.t) == 0), f"{len(seen.t)} triangles of {len(whole.t)}")
    found = judges.apart(one.random, seen.t, whole.t, most, 200)
    require(found <= most, f"{found} voxels away, the bound is {bound}")


def topology(seen):
    both, uses, _ = judges.edges(seen.f)
    parts = len(np.unique(judges.components(seen.f, len(seen.nodes)))) if len(seen.f) else 0
    return parts, len(np.unique(seen.f)) - len(both) + len(seen.f), bool((uses == 1).any())


@kind
def distance(one):
    """Within a distance: near to the full surface both ways, and of its topology."""
    volume = volumes.volume(one, most=14)
    iso = volumes.isovalue(one, volume.u)
    store = store_of(one, volume)
    options = ordinary(one, volume)
    whole = Seen(surface(one, store, iso, **full_options(options)), volume)
    blurred(whole)
    seen = Seen(surface(one, store, iso, **options), volume)
    require(seen.report.distance_bound <= options["distance"] * (1 + 1e-12),
            f"distance_bound {seen.report.distance_bound} above {options['distance']}")
    near(one, volume, seen, whole)
    require(not judges.faults(seen.f, "close" in options and not volume.what.endswith("missing")),
            judges.faults(seen.f, "close" in options))
    if not options.get("no_simplify"):
        require(topology(seen) == topology(whole), f"topology {topology(whole)} -> {topology(seen)}")


@kind
def triangles(one):
    """A number of triangles: no more than that, within the distance that the report says."""
    volume = volumes.volume(one, most=12)
    iso = volumes.isovalue(one, volume.u)
    store = store_of(one, volume)
    options = {"triangles": int(one.pick(0, 1, 4, 20, int(one.random.integers(1, 3000)), int(one.random.integers(1, 3000))))}
    way = one.random.integers(5)
    if way == 0:
        options |= {"by": "error"}
    elif way == 1:
        options |= {"effort": "fast"}
    elif way == 2:
        options |= {"distance": one.random.random() * 3 * volume.unit}
    if way and one.chance(0.2):
        options["close"] = True
    if way and one.chance(0.3):
        options["cells"] = one.pick("tet", "hex")
    seen = Seen(surface(one, store, iso, **options), volume)
    blurred(seen)
    if way != 2 or seen.report.within_budget:
        require(len(seen.f) <= options["triangles"], f"{len(seen.f)} of {options['triangles']} triangles")
    if way == 2:
        require(seen.report.distance_bound <= options["distance"] * (1 + 1e-12), "beyond the distance")
    if way == 0:
        on_surface(one, volume, seen, iso, seen.report.error_bound)
    else:
        near(one, volume, seen, Seen(surface(one, store, iso, **full_options(options)), volume))
    require(not judges.faults(seen.f, "close" in options and not volume.what.endswith("missing")), "edges")


@kind
def closed(one):
    """--close: each edge twice, winding numbers of nodes, volume; the interval of the volume."""
    volume = volumes.volume(one, most=14)
    iso = volumes.isovalue(one, volume.u)
    store = store_of(one, volume)
    e, clear = 0.0, 0.0  # how far values and places may be off
    options = {"close": one.pick("below", "above")}
    way = one.random.integers(5)
    if way == 0:
        options["cells"] = "hex"
    elif way == 1:
        e = options["error"] = volumes.error(one, volume.u)
    elif way == 2:
        e = options["error"] = volumes.error(one, volume.u)
        options["simplify"] = True
    elif way == 3:
        options |= {"distance": one.random.random() * 2 * volume.unit, "effort": one.pick("fast", "best")}
        clear = options["distance"] / volume.unit
    low, high = np.zeros(3), np.array(volume.u.shape[::-1]) - 1.0
    if one.chance(0.3) and not volume.turned:
        a, b = some_box(one, volume)
        options["box"] = world_box(volume, a, b)
        low, high = np.maximum(low, a), np.minimum(high, b)
    elif way in (1, 4) and one.chance(0.5):
        options["volume_interval"] = True
    seen = Seen(surface(one, store, iso, **options), volume)
    blurred(seen)
    missing = not np.isfinite(volume.u).all()
    require(not judges.faults(seen.f, not missing), judges.faults(seen.f, not missing))
    _, uses, _ = judges.edges(seen.f) if len(seen.f) else (0, np.zeros(0), 0)
    require(bool(seen.report.border_vertices) == bool((uses == 1).any()), f"border_vertices {seen.report.border_vertices}")
    if missing:
        return
    enclosed = judges.volume(seen.t)
    slack = judges.areas(seen.t).sum() * (seen.blur + 1e-9) * 4 + 1e-9
    sign = 1 if options["close"] == "below" else -1
    enclosed *= sign
    said = seen.report.volume / volume.unit ** 3 if 1e-90 < volume.unit ** 3 < 1e90 else enclosed
    require(abs(said - enclosed) <= slack + 1e-6 * abs(enclosed), f"volume {said}, computed {enclosed}")
    nodes = np.stack(np.meshgrid(*(np.arange(n) for n in volume.u.shape[::-1]), indexing="ij"), -1).reshape(-1, 3)
    values = volume.u[nodes[:, 2], nodes[:, 1], nodes[:, 0]].astype(float)
    margin = (np.minimum(nodes - low, high - nodes) * volume.scale).min(1)
    chosen = np.flatnonzero((np.abs(values - iso) > e * (1 + 1e-9)) & ((margin > clear + 1e-3) | (margin < -clear - 1e-3)))
    if len(chosen):
        chosen = one.random.choice(chosen, min(len(chosen), 60, 1 + 2_000_000 // (len(seen.f) + 1)), replace=False)
        p = nodes[chosen] * volume.scale
        if len(seen.t):  # those that rounding or the distance may put on the other side are left out
            far = np.array([judges.farthest(q[None], seen.t, 0) for q in p]) > clear + 4 * seen.blur + 1e-6
        else:
            far = np.ones(len(p), bool)
        expected = np.where(margin[chosen] < 0, 0, (values[chosen] >= iso) if sign > 0 else -(values[chosen] < iso).astype(int))
        found = judges.windings(p[far], seen.t) if len(seen.t) else np.zeros(far.sum())
        bad = np.flatnonzero(np.abs(found - expected[far]) > 1e-3)
        if len(bad):
            i = np.flatnonzero(far)[bad[0]]
            raise Wrong(f"node {nodes[chosen[i]]} with {values[chosen[i]]!r}: winding number {found[bad[0]]}")
    if options.get("volume_interval"):
        least, most = (v / volume.unit ** 3 for v in seen.report.full_volume_interval)
        whole = Seen(surface(one, store, iso, close=options["close"]), volume)
        v = judges.volume(whole.t) * sign
        require(least - slack <= v <= most + slack, f"full volume {v} outside of {least} to {most}")


@kind
def components(one):
    """The components that are kept, beside scipy's, of the mesh without the choice."""
    volume = volumes.volume(one, most=16, missing=one.chance(0.3))
    iso = volumes.isovalue(one, volume.u)
    store = store_of(one, volume)
    base = {"cells": one.pick("tet", "hex")}
    if one.chance(0.3):
        base["close"] = True
    if base["cells"] == "tet" and one.chance(0.4):
        base["error"] = volumes.error(one, volume.u)
    chosen = {}
    if one.chance(0.6):
        chosen["components"] = one.pick("largest", "all", 2, 5, 1000)
    if one.chance(0.4) or not chosen:
        chosen["min_component"] = int(one.pick(1, 2, 8, 9, 20, 100))
    if one.chance(0.3):
        chosen["min_volume"] = float(one.random.random() ** 3 * 20 * np.prod(volume.spacing))
    whole = Seen(surface(one, store, iso, **base), volume)
    blurred(whole)
    seen = Seen(surface(one, store, iso, **base, **chosen), volume)
    if whole.report.mended_triangles:
        raise Refused("mended triangles may differ")
    of = judges.components(whole.f, len(whole.nodes)) if len(whole.f) else np.zeros(0, int)
    counts = np.bincount(of)
    kept = counts >= chosen.get("min_component", 0)
    unsure = np.zeros(len(counts), bool)
    if "min_volume" in chosen:
        for c in np.flatnonzero(kept):
            f = whole.f[of == c]
            if (judges.edges(f)[1] == 1).any():
                continue
            least = chosen["min_volume"] / volume.unit ** 3 if volume.unit > 1e-25 else chosen["min_volume"] / np.prod(volume.spacing) * np.prod(volume.scale)
            v = abs(judges.volume(whole.scaled[f]))
            unsure[c] = abs(v - least) <= 1e-4 * least + judges.areas(whole.scaled[f]).sum() * whole.blur
            kept[c] = v >= least
    if unsure.any():
        raise Refused("a component's volume is the least one, within rounding")
    wanted = chosen.get("components", "all")
    if wanted != "all":
        order = sorted(np.flatnonzero(kept), key=lambda c: (-counts[c], c))[:1 if wanted == "largest" else wanted]
        kept = np.isin(np.arange(len(counts)), order)
    expected = sorted(judges.keys(whole.mesh.vertices, whole.mesh.faces[kept[of]] if len(of) else whole.mesh.faces))
    require(sorted(judges.keys(seen.mesh.vertices, seen.mesh.faces)) == expected,
            f"{len(seen.f)} triangles are kept, expected {len(expected)} of {len(counts)} components")
    dropped = len(counts) - int(kept.sum())
    require(seen.report.dropped_components == dropped, f"dropped {seen.report.dropped_components}, not {dropped}")


@kind
def box(one):
    """A box of tetrahedra: the part of the whole mesh within it."""
    volume = volumes.volume(one, most=16, turned=False)
    iso = volumes.isovalue(one, volume.u)
    store = store_of(one, volume)
    options = {"error": volumes.error(one, volume.u)} if one.chance(0.6) else {}
    if one.chance(0.2):
        options["vertices"] = "exact"
    a, b = some_box(one, volume)
    whole = Seen(surface(one, store, iso, **options), volume)
    blurred(whole)
    seen = Seen(surface(one, store, iso, box=world_box(volume, a, b), **options), volume)
    outside = np.maximum(a - seen.nodes, seen.nodes - b).max(initial=0)
    require(outside <= 2 * seen.rounding + 1e-9, f"{outside} outside of the box")
    a, b = a * volume.scale, b * volume.scale
    part = judges.clip(whole.t, a, b)
    mine, found = judges.areas(part).sum(), judges.areas(seen.t).sum()
    most = 4 * (seen.blur + whole.blur) + 3e-4 * volume.scale.max()
    flat = np.abs(part[:, :, None, :] - np.stack([a, b])[None, None]).max(1).min(1).min(1) < most if len(part) else np.zeros(0, bool)
    if flat.any() or whole.rounding > 1e-4:  # in a face of the box: of which side it is nothing says
        return
    slack = most * 10 * (len(part) + 1) ** 0.5 * volume.scale.max() + 1e-4 * mine
    require(abs(mine - found) <= slack, f"area {found}, the whole one's part {mine}")
    part = part[judges.areas(part) > 0]
    if len(part) and len(seen.t):
        distance = judges.apart(one.random, seen.t, part, most)
        require(distance <= most, f"{distance} from the part of the whole mesh")


def plane_of(one, volume):
    """A plane through the volume in nodes: normal . p = offset; and in the world."""
    size = np.array(volume.u.shape[::-1]) - 1
    normal = one.random.normal(size=3) if one.chance(0.6) else np.eye(3)[one.random.integers(3)]
    point = one.random.random(3) * size
    if one.chance(0.3):
        normal, point = np.rint(normal * 2), np.rint(point)
        normal = normal if normal.any() else np.array([1.0, 0, 0])
    world = volume.axes @ (normal / volume.scale)
    return normal, float(normal @ point), tuple(world.tolist()), float(world @ volume.world(point))


def own_plane(volume, normal, offset):
    """The plane cut out of the finest tetrahedra: triangles in smallest spacings, values at their corners."""
    corners, values = function.tetrahedra(volume.u)
    t, carried = function.march(corners, corners @ normal, offset, values)
    return t * volume.scale, carried


@kind
def slices(one):
    """A plane: where it is, how much of it, and its values."""
    volume = volumes.volume(one, most=14, missing=one.chance(0.3), extremes=False)
    store = store_of(one, volume)
    normal, offset, world_normal, world_offset = plane_of(one, volume)
    options = {"error": volumes.error(one, volume.u)} if one.chance(0.7) else {}
    mesh = ask(one, store.slice, world_normal, world_offset, coordinates="world", **options)
    seen = Seen(mesh, volume)
    blurred(seen)
    length = np.linalg.norm(normal / volume.scale)
    if len(seen.nodes):
        off = np.abs((seen.nodes @ normal - offset) / length).max()
        require(off <= 4 * seen.blur + 1e-9 * (1 + np.abs(offset) / length), f"{off} beside the plane")
    corners = np.asarray(mesh.values, float)[seen.f]
    w = one.random.dirichlet((1, 1, 1), 400)
    if len(seen.f):
        rows = one.random.integers(len(seen.f), size=400)
        p = np.einsum("ij,ijk->ik", w, seen.nodes[seen.f][rows])
        values = np.einsum("ij,ij->i", w, corners[rows])
        over, at = function.away(volume.u, function.Slopes(volume.u), p, values, seen.report.error_bound, seen.rounding)
        require(over <= 0, f"a value {over} beyond the bound {seen.report.error_bound} at {at}")
        asked = options.get("error", 0) + 2 * seen.report.value_rounding
        require(seen.report.error_bound <= asked * (1 + 1e-9) + 1e-6 * np.nanmax(np.abs(np.where(np.isfinite(volume.u), volume.u, 0).astype(float))),
                f"error_bound {seen.report.error_bound} for {asked}")
    t, _ = own_plane(volume, normal, offset)
    size = (np.array(volume.u.shape[::-1]) - 1) * volume.scale
    # in a face of cubes the plane is there once, in the judge's tetrahedra above it alone or not at all
    flat = sum(normal != 0) == 1
    if not flat and np.isfinite(volume.u).all():
        mine, found = judges.areas(t).sum(), judges.areas(seen.t).sum()
        require(abs(mine - found) <= 1e-4 * (mine + 1) + 100 * seen.blur * size.sum(), f"area {found}, expected {mine}")


@kind
def contours(one):
    """Contour lines in a plane: their values, and how long they are at full resolution."""
    volume = volumes.volume(one, most=14, extremes=False)
    store = store_of(one, volume)
    normal, offset, world_normal, world_offset = plane_of(one, volume)
    levels = sorted({volumes.isovalue(one, volume.u) for _ in range(one.pick(1, 2, 3))})
    options = {"error": volumes.error(one, volume.u)} if one.chance(0.5) else {}
    mesh = ask(one, store.contours, world_normal, world_offset, levels, coordinates="world", **options)
    seen = Seen(mesh, volume)
    blurred(seen)
    values = np.asarray(mesh.values, float)
    require(set(values) <= set(levels) | {float(np.float32(v)) for v in levels}, f"values {set(values) - set(levels)}")
    if len(mesh.faces):
        length = np.linalg.norm(normal / volume.scale)
        off = np.abs((seen.nodes @ normal - offset) / length).max()
        require(off <= 4 * seen.blur + 1e-9 * (1 + np.abs(offset) / length), f"{off} beside the plane")
        rows, w = one.random.integers(len(mesh.faces), size=400), one.random.random((400, 1))
        ends = seen.nodes[mesh.faces][rows]
        over, at = function.away(volume.u, function.Slopes(volume.u), ends[:, 0] + w * (ends[:, 1] - ends[:, 0]),
                                 values[mesh.faces[rows, 0]], seen.report.error_bound, seen.rounding)
        require(over <= 0, f"{over} beyond the bound {seen.report.error_bound} at {at}")
    if not options and sum(normal != 0) > 1:
        t, carried = own_plane(volume, normal, offset)
        for level in levels:
            if (volume.u == level).any():
                continue
            mine = function.lines(t, carried, level)
            mine = np.linalg.norm(mine[:, 1] - mine[:, 0], axis=1).sum()
            ends = seen.scaled[mesh.faces[np.abs(values[mesh.faces[:, 0]] - level) <= 1e-7 * abs(level)]]
            found = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1).sum()
            require(abs(found - mine) <= 1e-3 * (mine + 1) + 100 * seen.blur * (len(ends) + 1),
                    f"contour {level!r} has the length {found}, expected {mine}")


def label_volume(one):
    """Labels that are hard: many neighbours, one voxel, corners that touch, large and negative numbers."""
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
    elif dtype in ("i2", "i4") and one.chance(0.3):
        u = (u - 2).astype(dtype)
    elif dtype == "f8" and one.chance(0.4):
        u[one.random.random(sizes) < 0.1] = np.nan
    spacing, origin, axes = volumes.place(one)
    if large:
        axes = np.eye(3)
    return volumes.Volume(u, spacing, origin, axes, "labels"), large


def staircase(u, label, border):
    """The faces of voxels between a label and all else, as triangles, in nodes; at the border where that is asked."""
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
    """Every node is inside of its own label's mesh and of no other."""
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
    """Smooth labels: nodes on their sides, near the staircase, shared by neighbours, interfaces."""
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
            # Nodes nearer than nodes_beyond to what lies between labels may be on any side.
            whole = {k: Seen(m, volume) for k, m in ask(one, store.label_surfaces, coordinates="world",
                                                        smooth=options["smooth"], close=True).items()}
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
        require(bound <= 0.5 * np.linalg.norm(volume.scale), f"smooth_bound {bound} of the diagonal {np.linalg.norm(volume.scale)}")
    if len(stairs):
        found = judges.apart(one.random, seen.t, stairs, most, 150)
        require(found <= most, f"{found} from the staircase of label {label}, smooth_bound {bound}")
    interfaces(one, store, volume, meshes, options)


def interfaces(one, store, volume, meshes, options):
    """The labels' meshes cut from the interfaces, and the area of each pair."""
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
    """Labels without --smooth: the surface 1/2 of the label's nodes; closed, simplified, its components."""
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


def border(p, volume):
    """Nodes in the faces of the volume: a closed stepped label has its caps there."""
    return ((p == 0) | (p == np.array(volume.u.shape[::-1]) - 1)).any(1)


READERS = {"ply": "vtkPLYReader", "stl": "vtkSTLReader", "obj": "vtkOBJReader", "vtp": "vtkXMLPolyDataReader"}


def read_mesh(path):
    """Vertices and triangles of a file, by VTK, h5py or, for 3MF and glTF, what their specifications say."""
    import vtk
    from vtk.util.numpy_support import vtk_to_numpy
    ending = path.suffix[1:]
    if ending in READERS:
        reader = getattr(vtk, READERS[ending])()
        reader.SetFileName(str(path))
        if ending == "stl":
            reader.MergingOff()
        reader.Update()
        data = reader.GetOutput()
        if not data.GetNumberOfPoints():
            return np.zeros((0, 3)), np.zeros((0, 3), int)
        f = vtk_to_numpy(data.GetPolys().GetConnectivityArray()).reshape(-1, 3) if data.GetNumberOfPolys() else np.zeros((0, 3), int)
        return vtk_to_numpy(data.GetPoints().GetData()), f
    if ending == "vtkhdf":
        import h5py
        with h5py.File(path) as file:
            root = file["VTKHDF"]
            return root["Points"][:], root["Polygons/Connectivity"][:].reshape(-1, 3)
    if ending == "3mf":
        import xml.etree.ElementTree as tree
        with zipfile.ZipFile(path) as archive:
            require(archive.testzip() is None, "a damaged archive")
            root = tree.fromstring(archive.read("3D/3dmodel.model"))
        name = "{http://schemas.microsoft.com/3dmanufacturing/core/2015/02}"
        v = [[float(e.get(c)) for c in "xyz"] for e in root.iter(name + "vertex")]
        f = [[int(e.get(c)) for c in ("v1", "v2", "v3")] for e in root.iter(name + "triangle")]
        return np.array(v, float).reshape(-1, 3), np.array(f, int).reshape(-1, 3)
    raw = path.read_bytes()
    magic, version, length, size, chunk = struct.unpack("<4sII I4s", raw[:20])
    require((magic, version, length, chunk) == (b"glTF", 2, len(raw), b"JSON"), "a header that is not glTF's")
    head, body = json.loads(raw[20:20 + size]), raw[28 + size:]
    if not head.get("meshes"):
        return np.zeros((0, 3)), np.zeros((0, 3), int)

    def array(number, dtype, columns):
        accessor = head["accessors"][number]
        view = head["bufferViews"][accessor["bufferView"]]
        at = view.get("byteOffset", 0) + accessor.get("byteOffset", 0)
        return np.frombuffer(body, dtype, accessor["count"] * columns, at).reshape(-1, columns)

    primitive = head["meshes"][0]["primitives"][0]
    kinds = {5123: "<u2", 5125: "<u4"}
    v = array(primitive["attributes"]["POSITION"], "<f4", 3)
    f = array(primitive["indices"], kinds[head["accessors"][primitive["indices"]]["componentType"]], 1).reshape(-1, 3)
    for node in head.get("nodes", []):
        v = v * np.array(node.get("scale", (1, 1, 1))) + np.array(node.get("translation", (0, 0, 0)))
    return v, f


@kind
def formats(one):
    """The same mesh in every format, by other programs' readers."""
    volume = volumes.volume(one, most=12)
    iso = volumes.isovalue(one, volume.u)
    store = store_of(one, volume)
    options = one.pick({}, {"error": volumes.error(one, volume.u)}, {"cells": "hex"}, {"close": True})
    mesh = surface(one, store, iso, **options)
    for ending in one.random.permutation([*READERS, "vtkhdf", "3mf", "glb"])[:4]:
        path = one.folder / f"m.{ending}"
        ask(one, mesh.save, path)
        v, f = read_mesh(path)
        require(len(f) == len(mesh.faces), f"{ending}: {len(f)} triangles, not {len(mesh.faces)}")
        if not len(f):
            continue
        if ending == "glb":  # turned to y up and moved, perhaps
            a, b = (np.sort(np.linalg.norm(p[q] - p[np.roll(q, 1, 1)], axis=2), 1) for p, q in
                    ((v, f), (np.asarray(mesh.vertices, float), mesh.faces)))
            size = np.abs(mesh.vertices).max()
            require(np.abs(a - b).max() <= 1e-5 * size, f"glb: an edge of another length, by {np.abs(a - b).max()}")
            continue
        a, b = np.asarray(v, "f4")[f], np.asarray(mesh.vertices)[mesh.faces]
        if ending == "stl":
            a = np.asarray(v, "f4").reshape(-1, 3)[f]
        require(np.array_equal(a, b), f"{ending}: other triangles, by {np.abs(a.astype(float) - b).max()}")


@kind
def determinism(one):
    """Threads, memory and chunks do not change a byte."""
    volume = volumes.volume(one, most=16)
    iso = volumes.isovalue(one, volume.u)
    options = one.pick({"error": volumes.error(one, volume.u)}, {"error": volumes.error(one, volume.u), "close": True},
                       {"cells": "hex"}, {"distance": 0.5 * volume.unit}, {"distance": volume.unit, "effort": "fast"},
                       {"error": volumes.error(one, volume.u), "simplify": True}, {"components": 3, "close": True},
                       {"distance": 0.7 * volume.unit, "no_simplify": True},
                       {"triangles": int(one.random.integers(200, 3000))})
    if one.chance(0.2) and not volume.turned:
        options["box"] = world_box(volume, *some_box(one, volume))
    made = {}
    for chunk in (8, 64):
        store = store_of(one, volume, f"c{chunk}", chunk=chunk)
        for extra in ({"threads": 1}, {"threads": 4}, {"threads": 4, "memory": "96M"}):
            mesh = ask(one, store.isosurface, iso, coordinates="world", normals=True, **options, **extra)
            made[chunk, str(extra)] = (mesh.vertices.tobytes(), mesh.faces.tobytes(), np.asarray(mesh.normals).tobytes(),
                                       repr(mesh.report.area), mesh.report.error_bound, mesh.report.distance_bound)
    first = next(iter(made.values()))
    for how, one_of in made.items():
        require(one_of == first, f"{how}: other bytes, of {[a == b for a, b in zip(one_of, first)]}")


@kind
def view(one):
    """--view: triangles of the whole mesh alone, and all of those that face the viewer."""
    volume = volumes.volume(one, most=16)
    iso = volumes.isovalue(one, volume.u)
    store = store_of(one, volume, indicators="nodes")
    options = {"error": volumes.error(one, volume.u)} if one.chance(0.6) else {}
    direction = one.random.normal(size=3) if one.chance(0.6) else np.eye(3)[one.random.integers(3)] * one.pick(1, -1)
    whole = Seen(surface(one, store, iso, **options), volume)
    blurred(whole)
    seen = Seen(surface(one, store, iso, view=tuple(direction.tolist()), **options,
                        **one.pick({}, {"cull_by": "normal_turn_plus"}, {"cull_by": "grad_linf_plus"})), volume)
    if whole.report.mended_triangles or whole.report.apart_vertices:
        raise Refused("vertices that were moved may be others")
    have = set(judges.keys(seen.mesh.vertices, seen.mesh.faces))
    all_of_them = judges.keys(whole.mesh.vertices, whole.mesh.faces)
    require(have <= set(all_of_them), f"{len(have - set(all_of_them))} triangles that the whole mesh has not")
    t = whole.t
    n = np.cross(t[:, 1] - t[:, 0], t[:, 2] - t[:, 0])
    look = volume.axes.T @ (direction / np.linalg.norm(direction))
    size = np.linalg.norm(n, axis=1)
    edge = np.linalg.norm(t - np.roll(t, 1, 1), axis=2).max(1, initial=0)
    facing = (n @ look < -1e-6 * size - 4 * edge * whole.blur)
    lost = [k for k, faces in zip(all_of_them, facing) if faces and k not in have]
    require(not lost, f"{len(lost)} of {facing.sum()} triangles that face the viewer are left out")


@kind
def plane_data(one):
    """Data in a plane: isolines, simplified isolines and graphs."""
    volume = volumes.volume(one, most=24, turned=False, extremes=False)
    volume.u = np.ascontiguousarray(volume.u[:1])
    store = store_of(one, volume)
    if min(volume.u.shape[1:]) < 2:
        return
    if one.chance(0.5):
        iso = volumes.isovalue(one, volume.u)
        options = one.pick({"error": volumes.error(one, volume.u)}, {"error": volumes.error(one, volume.u)},
                           {"distance": float(one.random.random() * 2 * volume.unit)})
        mesh = surface(one, store, iso, **options)
        seen = Seen(mesh, volume)
        blurred(seen)
        require(not len(mesh.faces) or mesh.faces.shape[1] == 2, "no lines")
        if "error" in options:
            on_surface(one, volume, seen, iso, seen.report.error_bound)
            require(seen.report.error_bound <= options["error"], "error_bound above the error")
        else:
            whole = Seen(surface(one, store, iso), volume)
            near(one, volume, seen, whole)
        return
    low = np.abs(np.where(np.isfinite(volume.u), volume.u, 0).astype(float)).max()
    scale = float(one.random.uniform(0.1, 3) / (low or 1))
    options = {"error": volumes.error(one, volume.u)}
    mesh = ask(one, store.graph, scale=scale, coordinates="world", **options)
    seen = Seen(mesh, volume)
    blurred(seen)
    if len(seen.f):
        p = judges.samples(one.random, np.asarray(mesh.vertices, float)[seen.f], 400)
        height = p[:, 2] / scale
        p[:, 2] = volume.origin[2]
        over, at = function.away(volume.u, function.Slopes(volume.u), volume.nodes(p), height, seen.report.error_bound,
                                 seen.rounding)
        require(over <= 0, f"a height {over} beyond {seen.report.error_bound} at {at}")


@kind
def several(one):
    """Several isovalues at once: each mesh as of its isovalue alone."""
    volume = volumes.volume(one, most=14)
    levels = sorted({volumes.isovalue(one, volume.u) for _ in range(4)})
    store = store_of(one, volume)
    options = one.pick({"error": volumes.error(one, volume.u)}, {"cells": "hex"}, {"close": True}, {"components": "largest"},
                       {"distance": 0.5 * volume.unit, "effort": "fast"})
    meshes = ask(one, store.isosurface, levels, coordinates="world", normals=False, **options)
    for level, mesh in zip(levels, meshes):
        alone = surface(one, store, level, **options)
        require(alone.vertices.tobytes() == mesh.vertices.tobytes() and alone.faces.tobytes() == mesh.faces.tobytes(),
                f"the mesh of {level!r} is another one alone")


@kind
def exact_hexahedra(one):
    """Hexahedra within an error: the data at the mesh's vertices."""
    volume = volumes.volume(one, most=16)
    iso = volumes.isovalue(one, volume.u)
    store = store_of(one, volume, indicators=["deviation_bar", "hex_deviation"])
    options = {"cells": "hex", "error": volumes.error(one, volume.u)}
    seen = Seen(surface(one, store, iso, **options), volume)
    blurred(seen)
    require(seen.report.error_bound <= options["error"], f"error_bound {seen.report.error_bound!r}")
    if not len(seen.f):
        return
    points = seen.nodes[one.random.integers(len(seen.nodes), size=min(600, len(seen.nodes)))]
    # Vertices beside an edge of the lattice are centres of cells, of which nothing is said.
    # Of those in an upper face of the volume, which may cut a cell, nothing either.
    edge = (np.abs(points - np.rint(points)) > 8 * seen.rounding + 1e-4).sum(1) <= 1
    edge &= (points < np.array(volume.u.shape[::-1]) - 1 - 8 * seen.rounding - 1e-4).all(1)
    over, at = function.away(volume.u, function.Slopes(volume.u), points[edge], iso, seen.report.error_bound, seen.rounding)
    require(over <= 0, f"|f - {iso!r}| is {over} above its bound at node {at}")
    require(not judges.faults(seen.f, False), judges.faults(seen.f, False))


KINDS = {f.__name__: f for f in (error, simplify_error, full, distance, triangles, closed, components, box, slices, contours,
                                 labels, stepped_labels, formats, determinism, view, plane_data, several, exact_hexahedra)}

if __name__ == "__main__":
    sys.exit(attack.main(__doc__, KINDS))
