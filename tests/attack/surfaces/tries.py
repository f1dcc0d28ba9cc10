"""What the kinds share: tries that end as refused or wrong, stores, meshes as the judges see them, queries."""
import functools
import re
import traceback

import attack
import numpy as np

from . import judges


class Refused(Exception):
    pass


class Wrong(Exception):
    pass


def require(good, *what):
    if not good:
        raise Wrong(" ".join(map(str, what)))


def kind(function_of_one):
    """A kind of tries: an exception that it raises becomes the try's result."""
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
    """The answer of isonest. An error of isonest ends the try as refused."""
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
    """Makes tetrahedra and the nested grid the default, as the judges expect, unless the options say otherwise."""
    if "distance" not in options and (options.get("by") == "error" or "triangles" not in options):
        options = {"effort": "none", "cells": "tet"} | options
    return ask(one, store.isosurface, iso, coordinates="world", normals=False, **options)


class Seen:
    """A mesh and its volume: vertices in nodes and in smallest spacings, triangles, rounding."""

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
    """Nothing can be compared if float32 cannot distinguish neighbouring nodes."""
    if seen.rounding > 0.1:
        raise Refused("coordinates are rounded by more than a tenth of a voxel")


def whole(seen, volume, closed=False, box=None):
    """What every surface must satisfy: edges, fans, areas, positions; borders only in the faces of the volume or the
    box."""
    f, report = seen.f, seen.report
    missing = not np.isfinite(volume.u).all()
    said = judges.faults(f, closed and not missing)
    require(not said, said)
    used = len(np.unique(f))
    require(used == len(seen.nodes), f"{len(seen.nodes)} vertices, of which triangles have {used}")
    if not len(f):
        return
    # Around missing values, several borders may meet at a vertex.
    if not missing:
        require(judges.fans(f) == used, f"{judges.fans(f)} fans of triangles around {used} vertices")
    vertices = np.ascontiguousarray(seen.mesh.vertices)
    if not report.zero_area_triangles:
        none = judges.without_area(vertices, f)
        require(not none, f"{none} triangles without area")
    if not report.together_vertices:
        places = len(np.unique(vertices + np.float32(0), axis=0))
        require(places == used, f"{used} vertices in {places} places")
    if closed or missing:
        return
    low, high = np.zeros(3), np.array(volume.u.shape[::-1]) - 1.0
    if box:
        low, high = np.maximum(low, box[0]), np.minimum(high, box[1])
    both, uses, _ = judges.edges(f)
    ends = seen.nodes[both[uses == 1]]
    slack = 4 * seen.rounding + 1e-9 * np.abs(high).max()
    in_face = (np.abs(ends[..., None, :] - np.stack([low, high])) <= slack).all(1).any((1, 2))
    require(in_face.all(), f"{(~in_face).sum()} border edges inside of the volume, at {ends[~in_face][:1].tolist()}")


def some_box(one, volume):
    """A box inside the volume or across its border, in nodes; sometimes with faces through nodes."""
    size = np.array(volume.u.shape[::-1]) - 1
    a, b = np.sort(one.random.uniform(-0.2, 1.2, (2, 3)) * size, axis=0)
    if one.chance(0.25):
        a, b = np.floor(a), np.ceil(b)
    if one.chance(0.2):
        a, b = np.zeros(3), size.astype(float)
    b = np.where(b - a < 1e-3 * (size + 1), a + 0.3, b)
    if one.chance(0.1):
        b[one.random.integers(3)] = a.max() + 1e-4
        b = np.maximum(a + 1e-4, b)
    return a, b


def world_box(volume, a, b):
    return tuple(map(tuple, (volume.world([a, b])).tolist()))


def near(one, volume, seen, whole):
    """The two-sided distance is within what is reported."""
    bound = seen.report.distance_bound / volume.unit
    most = bound * (1 + 1e-9) + seen.blur + whole.blur
    require((len(seen.t) == 0) == (len(whole.t) == 0), f"{len(seen.t)} triangles of {len(whole.t)}")
    found = judges.apart(one.random, seen.t, whole.t, most, 200)
    require(found <= most, f"{found} voxels away, the bound is {bound}")


def topology(seen):
    both, uses, _ = judges.edges(seen.f)
    parts = len(np.unique(judges.components(seen.f, len(seen.nodes)))) if len(seen.f) else 0
    return parts, len(np.unique(seen.f)) - len(both) + len(seen.f), bool((uses == 1).any())


def full_options(options):
    """The options of the surface from which a distance is measured."""
    cells = options.get("cells") or ("tet" if options.get("effort") == "none" else "hex")
    kept = {k: v for k, v in options.items() if k in ("close", "box", "components", "min_component", "min_volume")}
    return kept | {"cells": cells}
