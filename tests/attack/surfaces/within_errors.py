"""Surfaces whose values are within a promised error, at full resolution, isolines and graphs."""
import numpy as np
from scipy.spatial import cKDTree

from . import function, judges, volumes
from .tries import Seen, ask, blurred, kind, near, require, some_box, store_of, surface, whole, world_box


def error_options(one, volume, store):
    """An error, requested in one of the possible ways and by one of the guarantees."""
    e = volumes.error(one, volume.u)
    kind = one.random.integers(6)
    if kind == 0:
        return {"error_relative": float(one.pick(0, 1e-3, 0.05, 0.3, 1, one.random.random()))}
    if kind == 1:
        return {"error": e, "indicator": "plus"}
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
    focus = box = None
    if one.chance(0.2) and not volume.turned:
        box = some_box(one, volume)
        options["box"] = world_box(volume, *box)
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
    if seen.mesh.faces.shape[1] == 3:
        whole(seen, volume, box=box)


@kind
def simplify_error(one):
    """Simplified within an error: the values again."""
    volume = volumes.volume(one, most=14)
    iso = volumes.isovalue(one, volume.u)
    store = store_of(one, volume)
    options = {"error": volumes.error(one, volume.u), "effort": "best"}
    if one.chance(0.3):
        options["indicator"] = "plus"
    if one.chance(0.2):
        options["vertices"] = "exact"
    box = some_box(one, volume) if one.chance(0.2) and not volume.turned else None
    if box:
        options["box"] = world_box(volume, *box)
    if one.chance(0.2):
        options |= {"triangles": int(one.random.integers(1, 2000)), "by": "error"}
        del options["error"]
        options.pop("indicator", None)
    seen = Seen(surface(one, store, iso, **options), volume)
    blurred(seen)
    if "error" in options:
        require(seen.report.error_bound <= options["error"] * (1 if options.get("vertices") != "exact" else 2),
                f"error_bound {seen.report.error_bound!r} above {options['error']!r}")
    else:
        require(len(seen.f) <= options["triangles"], f"{len(seen.f)} of {options['triangles']} triangles")
    on_surface(one, volume, seen, iso, seen.report.error_bound)
    whole(seen, volume, box=box)


def own_full(volume, iso):
    """The surface of the finest tetrahedra, in smallest spacings."""
    corners, values = function.tetrahedra(volume.u)
    triangles, _ = function.march(corners, values, iso)
    return triangles * volume.scale


def crossings(u, iso):
    """Where edges of the finest lattice cross the isovalue, in nodes; only edges of a cube without missing values."""
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
    """The largest distance of points from the nearest of some places."""
    if not len(points):
        return 0.0
    return cKDTree(places).query(points)[0].max() if len(places) else np.inf


@kind
def full(one):
    """Full resolution, or elements that give the same: tetrahedra compared with the judge's own surface; the vertices
    of hexahedra compared with the crossed edges."""
    volume = volumes.volume(one, most=16)
    iso = volumes.isovalue(one, volume.u)
    hexahedra = one.chance(0.5)
    if hexahedra and one.chance(0.4) and not volume.turned and volume.raw is None:
        mesh = ask(one, one.isonest.isosurface, volume.u, iso, spacing=tuple(volume.spacing[::-1]), normals=False)
        volume.origin = np.zeros(3)
        np.save(one.folder / "v.npy", volume.u)
        mesh = mesh.in_world()
    else:
        options = {"cells": "hex" if hexahedra else "tet"}
        good = volume.u[np.isfinite(volume.u)].astype(float)
        if not hexahedra and one.chance(0.5) and (good == np.rint(good)).all():
            options["error"] = 0.1  # of integers: larger elements where the data are linear, the same surface
        mesh = surface(one, store_of(one, volume), iso, **options)
    seen = Seen(mesh, volume)
    blurred(seen)
    whole(seen, volume)
    on_surface(one, volume, seen, iso, 0.0) if not hexahedra else None
    most = 4 * seen.blur + 3e-4 * volume.scale.max()
    if hexahedra:
        expected = crossings(volume.u, iso)
        # Crossings at a node are omitted where they leave a triangle without area; larger polygons may have a centre in
        # their cell.
        certain = expected[np.abs(expected - np.rint(expected)).max(1) > 1e-3] * volume.scale
        beside = (np.abs(seen.nodes - np.rint(seen.nodes)) > 8 * seen.rounding + 3e-4).sum(1) > 1
        found = nearest(certain, seen.scaled)
        if not (volume.u == iso).any():  # flat pieces through nodes have their own vertices
            found = max(found, nearest(seen.scaled[~beside], expected * volume.scale))
        require(found <= most, f"a vertex {found} from the crossings, or the other way round")
        return
    mine = own_full(volume, iso)
    a, b = judges.areas(seen.t).sum(), judges.areas(mine).sum()
    slack = most * 10 * (len(mine) + 1) ** 0.5 * volume.scale.max() + 1e-5 * a
    require(abs(a - b) <= slack or seen.rounding > 1e-4, f"area {a}, expected {b}")
    if (judges.areas(mine) > 0).any() or len(seen.t):
        found = judges.apart(one.random, seen.t, mine, most) if len(mine) and len(seen.t) else np.inf
        require(found <= most or b < slack, f"{found} from the judge's surface")


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
    whole(seen, volume)
    if not len(seen.f):
        return
    points = seen.nodes[one.random.integers(len(seen.nodes), size=min(600, len(seen.nodes)))]
    # Vertices that are not on an edge of the lattice are centres of polygons in a cell; nothing is promised for them.
    # Where the data are regular, such a centre may lie on an edge.
    if volume.u.dtype.kind != "f" or volume.what.split(",")[0] not in ("noise", "noisy gyroid", "smooth", "tori", "ball", "gyroid"):
        return
    # Nothing is promised either for vertices in an upper face of the volume, which may clip a cell.
    edge = (np.abs(points - np.rint(points)) > 8 * seen.rounding + 1e-4).sum(1) <= 1
    edge &= (points < np.array(volume.u.shape[::-1]) - 1 - 8 * seen.rounding - 1e-4).all(1)
    over, at = function.away(volume.u, function.Slopes(volume.u), points[edge], iso, seen.report.error_bound, seen.rounding)
    require(over <= 0, f"|f - {iso!r}| is {over} above its bound at node {at}")


@kind
def several(one):
    """Several isovalues at once: each mesh is the same as for its isovalue alone."""
    volume = volumes.volume(one, most=14)
    levels = sorted({volumes.isovalue(one, volume.u) for _ in range(4)})
    store = store_of(one, volume)
    options = one.pick({"error": volumes.error(one, volume.u)}, {"cells": "hex"}, {"close": True}, {"components": "largest"},
                       {"distance": 0.5 * volume.unit, "effort": "fast"})
    meshes = ask(one, store.isosurface, levels, coordinates="world", normals=False, **options)
    own = ask(one, store.isosurface, levels[0], coordinates="array", normals=False, **options)
    seen = Seen(meshes[0], volume)
    blurred(seen)
    require(len(own.faces) == len(seen.f), "other triangles in the coordinates of the array")
    if len(own.faces):
        nodes = np.asarray(own.vertices, float)[:, ::-1] / volume.spacing
        off = np.abs(nodes - seen.nodes).max()
        require(off <= 4 * seen.rounding + 1e-5, f"{off} nodes between the coordinates of the array and of the world")
    for level, mesh in zip(levels, meshes):
        alone = ask(one, store.isosurface, level, coordinates="world", normals=False, **options)
        require(alone.vertices.tobytes() == mesh.vertices.tobytes() and alone.faces.tobytes() == mesh.faces.tobytes(),
                f"the mesh of {level!r} is another one alone")


@kind
def plane_data(one):
    """Data in a plane: isolines, simplified isolines and graphs."""
    volume = volumes.volume(one, most=24, turned=False, extremes=False)
    volume.u = np.ascontiguousarray(volume.u[:1])
    volume.raw = None if volume.raw is None else np.ascontiguousarray(volume.raw[:1])
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
    scale = float(one.random.uniform(0.1, 3) / (low or 1)) * one.pick(1, -1)
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
