"""Slices and contours."""
import numpy as np

from . import function, judges, volumes
from .tries import Seen, ask, blurred, kind, require, store_of


def plane_of(one, volume):
    """A plane through the volume in nodes: normal . p = offset; and in world coordinates."""
    size = np.array(volume.u.shape[::-1]) - 1
    normal = one.random.normal(size=3) if one.chance(0.6) else np.eye(3)[one.random.integers(3)]
    point = one.random.random(3) * size
    if one.chance(0.3):
        normal, point = np.rint(normal * 2), np.rint(point)
        normal = normal if normal.any() else np.array([1.0, 0, 0])
    world = volume.axes @ (normal / volume.scale) * one.pick(1, 1, 1e-12, 1e12)
    return normal, float(normal @ point), tuple(world.tolist()), float(world @ volume.world(point))


def own_plane(volume, normal, offset):
    """The plane clipped by the finest tetrahedra: triangles in smallest spacings, values at their corners."""
    corners, values = function.tetrahedra(volume.u)
    t, carried = function.march(corners, corners @ normal, offset, values)
    return t * volume.scale, carried


@kind
def slices(one):
    """A slice: its position, its area, and its values."""
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
        largest = np.abs(volume.u[np.isfinite(volume.u)].astype(float)).max()
        require(seen.report.error_bound <= asked * (1 + 1e-9) + 1e-6 * largest, f"error_bound {seen.report.error_bound} for {asked}")
    t, _ = own_plane(volume, normal, offset)
    size = (np.array(volume.u.shape[::-1]) - 1) * volume.scale
    # a plane in a face of cubes is output once; the judge has it only in the tetrahedra above it, or not at all
    flat = sum(normal != 0) == 1
    if not flat and np.isfinite(volume.u).all():
        mine, found = judges.areas(t).sum(), judges.areas(seen.t).sum()
        require(abs(mine - found) <= 1e-4 * (mine + 1) + 100 * seen.blur * size.sum(), f"area {found}, expected {mine}")


@kind
def contours(one):
    """Contour lines in a plane: their values, and their length at full resolution."""
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
            own = np.abs(values[mesh.faces[:, 0], None] - levels).argmin(1) == levels.index(level)
            ends = seen.scaled[mesh.faces[own]]
            found = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1).sum()
            require(abs(found - mine) <= 1e-3 * (mine + 1) + 100 * seen.blur * (len(ends) + 1),
                    f"contour {level!r} has the length {found}, expected {mine}")
