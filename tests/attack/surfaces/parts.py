"""Surfaces that are closed, clipped by a box, or reduced by components or by a view direction."""
import numpy as np

from . import judges, volumes
from .tries import Refused, Seen, Wrong, blurred, kind, require, some_box, store_of, surface, whole, world_box


@kind
def closed(one):
    """--close: each edge has two triangles; winding numbers of nodes, volume; the interval of the volume."""
    volume = volumes.volume(one, most=14)
    iso = volumes.isovalue(one, volume.u)
    store = store_of(one, volume)
    e, clear = 0.0, 0.0  # tolerances of values and places
    options = {"close": one.pick("below", "above")}
    way = one.random.integers(5)
    if way == 0:
        options["cells"] = "hex"
    elif way == 1:
        e = options["error"] = volumes.error(one, volume.u)
    elif way == 2:
        e = options["error"] = volumes.error(one, volume.u)
        options["effort"] = "best"
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
    whole(seen, volume, True)
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
        if len(seen.t):  # nodes that rounding or the distance may put on the other side are not tested
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
        v = judges.volume(Seen(surface(one, store, iso, close=options["close"]), volume).t) * sign
        require(least - slack <= v <= most + slack, f"full volume {v} outside of {least} to {most}")


@kind
def components(one):
    """The components that are kept, compared with scipy's, of the mesh without this option."""
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
    full = Seen(surface(one, store, iso, **base), volume)
    blurred(full)
    seen = Seen(surface(one, store, iso, **base, **chosen), volume)
    expected, dropped, count = kept_triangles(full, volume, chosen)
    require(sorted(judges.keys(seen.mesh.vertices, seen.mesh.faces)) == expected,
            f"{len(seen.f)} triangles are kept, expected {len(expected)} of {count} components")
    require(seen.report.dropped_components == dropped, f"dropped {seen.report.dropped_components}, not {dropped}")


def kept_triangles(whole, volume, chosen):
    """The names of the triangles that an option for components keeps of a whole mesh; the number dropped, and the
    total."""
    of = judges.components(whole.f, len(whole.nodes)) if len(whole.f) else np.zeros(0, int)
    counts = np.bincount(of)
    kept = counts >= chosen.get("min_component", 0)
    unsure = np.zeros(len(counts), bool)
    if "min_volume" in chosen:
        for c in np.flatnonzero(kept):
            f = whole.f[of == c]
            if (judges.edges(f)[1] == 1).any():
                continue
            least = chosen["min_volume"] / np.prod(volume.spacing) * np.prod(volume.scale)
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
    return expected, len(counts) - int(kept.sum()), len(counts)


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
    full = Seen(surface(one, store, iso, **options), volume)
    blurred(full)
    seen = Seen(surface(one, store, iso, box=world_box(volume, a, b), **options), volume)
    whole(seen, volume, box=(a, b))
    outside = np.maximum(a - seen.nodes, seen.nodes - b).max(initial=0)
    require(outside <= 2 * seen.rounding + 1e-9, f"{outside} outside of the box")
    a, b = a * volume.scale, b * volume.scale
    part = judges.clip(full.t, a, b)
    mine, found = judges.areas(part).sum(), judges.areas(seen.t).sum()
    most = 4 * (seen.blur + full.blur) + 3e-4 * volume.scale.max()
    flat = len(full.t) and (np.abs(full.t[:, :, None, :] - np.stack([a, b])[None, None]).max(1).min((1, 2)) < most).any()
    if flat or full.rounding > 1e-4:  # in a face of the box, which side counts is not defined
        return
    slack = most * 10 * (len(part) + 1) ** 0.5 * volume.scale.max() + 1e-4 * mine
    require(abs(mine - found) <= slack, f"area {found}, the whole one's part {mine}")
    if len(part) and len(seen.t):
        distance = judges.apart(one.random, seen.t, part, most)
        require(distance <= most, f"{distance} from the part of the whole mesh")


@kind
def view(one):
    """--view: only triangles of the whole mesh, and all of those that face the viewer."""
    volume = volumes.volume(one, most=16)
    iso = volumes.isovalue(one, volume.u)
    store = store_of(one, volume, indicators="nodes")
    options = {"error": volumes.error(one, volume.u)} if one.chance(0.6) else {}
    direction = one.random.normal(size=3) if one.chance(0.6) else np.eye(3)[one.random.integers(3)] * one.pick(1, -1)
    full = Seen(surface(one, store, iso, **options), volume)
    blurred(full)
    seen = Seen(surface(one, store, iso, view=tuple(direction.tolist()), **options,
                        **one.pick({}, {"cull_by": "normal_turn_plus"}, {"cull_by": "grad_linf_plus"})), volume)
    if any(m.report.mended_triangles or m.report.apart_vertices for m in (full, seen)):
        raise Refused("vertices that were moved may be others")
    have = set(judges.keys(seen.mesh.vertices, seen.mesh.faces))
    all_of_them = judges.keys(full.mesh.vertices, full.mesh.faces)
    require(have <= set(all_of_them), f"{len(have - set(all_of_them))} triangles that the whole mesh has not")
    t = full.t
    n = np.cross(t[:, 1] - t[:, 0], t[:, 2] - t[:, 0])
    look = volume.axes.T @ (direction / np.linalg.norm(direction))
    size = np.linalg.norm(n, axis=1)
    edge = np.linalg.norm(t - np.roll(t, 1, 1), axis=2).max(1, initial=0)
    facing = (n @ look < -1e-6 * size - 4 * edge * full.blur)
    lost = [k for k, faces in zip(all_of_them, facing) if faces and k not in have]
    require(not lost, f"{len(lost)} of {facing.sum()} triangles that face the viewer are left out")
