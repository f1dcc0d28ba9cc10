"""Judges of meshes: points on them, distances (VTK's locator), edges, winding numbers, clipping, components."""
from fractions import Fraction

import numpy as np
import vtk
from scipy import sparse
from vtk.util.numpy_support import numpy_to_vtk, numpy_to_vtkIdTypeArray


def areas(t):
    return np.linalg.norm(np.cross(t[:, 1] - t[:, 0], t[:, 2] - t[:, 0]), axis=1) / 2


def volume(t):
    """The enclosed volume, by the divergence theorem, relative to a point of the mesh."""
    if not len(t):
        return 0.0
    t = t - t[0, 0]
    return float(np.einsum("ij,ij->", t[:, 0], np.cross(t[:, 1], t[:, 2]))) / 6


def samples(random, t, count):
    """Points on triangles (n, 3, 3): some corners, midpoints, and places all over them."""
    if not len(t):
        return np.zeros((0, 3))
    rows = random.integers(len(t), size=count)
    w = random.dirichlet((1, 1, 1), count)
    some = t[random.integers(len(t), size=min(count, len(t)))]
    return np.concatenate([np.einsum("ij,ijk->ik", w, t[rows]), some.mean(1), some.reshape(-1, 3)[:count],
                           (some[:, 0] + some[:, 1]) / 2])


def polydata(v, f):
    data, points, cells = vtk.vtkPolyData(), vtk.vtkPoints(), vtk.vtkCellArray()
    points.SetData(numpy_to_vtk(np.ascontiguousarray(v, float), deep=1))
    cells.SetCells(len(f), numpy_to_vtkIdTypeArray(
        np.column_stack([np.full(len(f), f.shape[1]), f]).ravel().astype(np.int64), deep=1))
    data.SetPoints(points)
    data.SetPolys(cells)
    return data


def to_triangles(p, t):
    """Distances of points (n, 3) from the nearest of all triangles, by brute force."""
    best = np.full(len(p), np.inf)
    for start in range(0, len(p), 16):
        q = p[start:start + 16, None]
        a, b, c = t[None, :, 0], t[None, :, 1], t[None, :, 2]
        least = np.full((q.shape[0], len(t)), np.inf)
        for x, y in ((a, b), (b, c), (c, a)):
            d = y - x
            with np.errstate(invalid="ignore", divide="ignore"):
                s = np.clip(np.nan_to_num(((q - x) * d).sum(-1) / (d * d).sum(-1)), 0, 1)
            least = np.minimum(least, np.linalg.norm(q - x - s[..., None] * d, axis=-1))
        n = np.cross(b - a, c - a)
        with np.errstate(invalid="ignore", divide="ignore"):
            n = n / np.linalg.norm(n, axis=-1)[..., None]
        height = ((q - a) * n).sum(-1)
        foot = q - height[..., None] * n
        inside = np.ones(height.shape, bool)
        for x, y in ((a, b), (b, c), (c, a)):
            inside &= (np.cross(y - x, foot - x) * n).sum(-1) >= 0
        least = np.where(inside, np.minimum(least, np.abs(height)), least)
        best[start:start + 16] = least.min(1)
    return best


def farthest(p, t, most):
    """The maximum distance of points from triangles; distances by VTK above `most` are computed again by brute
    force."""
    if not len(p):
        return 0.0
    if not len(t):
        return np.inf
    locator = vtk.vtkStaticCellLocator()
    locator.SetDataSet(polydata(t.reshape(-1, 3), np.arange(3 * len(t)).reshape(-1, 3)))
    locator.BuildLocator()
    cell, number, sub, d2 = vtk.vtkGenericCell(), vtk.mutable(0), vtk.mutable(0), vtk.mutable(0.0)
    found, at = np.zeros(len(p)), [0.0, 0.0, 0.0]
    for i, q in enumerate(p):
        number.set(-1)
        locator.FindClosestPoint(q, at, cell, number, sub, d2)
        found[i] = np.sqrt(d2.get()) if number.get() >= 0 else np.inf
    over = np.flatnonzero(~(found <= most))
    over = over[np.argsort(-found[over])][:64]
    if len(over):
        exact = to_triangles(p[over], t)
        return float(max(exact.max(), found[found <= most].max(initial=0)))
    return float(found.max())


def apart(random, a, b, most, count=300):
    """The two-sided distance of two sets of triangles, sampled at points of both.

    Triangles of b without area are places where a may be but need not be: isonest omits them, except in thin tubes
    around nodes and lines of nodes, whose vertices it moves so that no two have the same position.
    """
    return max(farthest(samples(random, a, count), b, most),
               farthest(samples(random, b[areas(b) > 0], count), a, most))


def edges(f):
    """Undirected edges, the number of faces at each, and how often an edge is traversed again in the same direction."""
    directed = np.concatenate([f[:, [0, 1]], f[:, [1, 2]], f[:, [2, 0]]]).astype(np.int64)
    both, uses = np.unique(np.sort(directed, 1), axis=0, return_counts=True)
    return both, uses, len(directed) - len(np.unique(directed, axis=0))


def faults(f, closed):
    """What is wrong with the edges of a manifold, in words; empty if nothing is."""
    if not len(f):
        return ""
    _, uses, twice = edges(f)
    said = []
    if (uses > 2).any():
        said.append(f"{(uses > 2).sum()} edges of more than two triangles")
    if closed and (uses == 1).any():
        said.append(f"{(uses == 1).sum()} border edges")
    if twice:
        said.append(f"{twice} edges run through twice in one direction")
    if (f[:, 0] == f[:, 1]).any() or (f[:, 1] == f[:, 2]).any() or (f[:, 0] == f[:, 2]).any():
        said.append("a triangle with one corner twice")
    return ", ".join(said)


def fans(f):
    """The total number of fans of triangles at the vertices: the number of vertices if each has one."""
    corner = np.arange(f.size).reshape(f.shape)
    ends = np.concatenate([f[:, [0, 1]], f[:, [1, 2]], f[:, [2, 0]]])
    corners = np.concatenate([corner[:, [0, 1]], corner[:, [1, 2]], corner[:, [2, 0]]])
    turned = ends[:, 0] > ends[:, 1]
    ends[turned], corners[turned] = ends[turned, ::-1], corners[turned, ::-1]
    order = np.lexsort((ends[:, 1], ends[:, 0]))
    same = (ends[order][1:] == ends[order][:-1]).all(1)
    a, b = corners[order][:-1][same], corners[order][1:][same]
    graph = sparse.coo_matrix((np.ones(2 * len(a)), (a.T.ravel(), b.T.ravel())), shape=(f.size, f.size))
    return sparse.csgraph.connected_components(graph, directed=False)[0]


def without_area(v, f):
    """The number of triangles without area, exactly; v: float32."""
    t = v.astype(float)[f]
    sides = np.linalg.norm(t - np.roll(t, 1, 1), axis=2).max(1)
    doubtful = np.flatnonzero(areas(t) <= 1e-6 * np.abs(t).max(initial=0) * sides)
    count = 0
    for triangle in t[doubtful]:
        a, b, c = ([Fraction(float(x)) for x in corner] for corner in triangle)
        p, q = ([y - x for x, y in zip(a, e)] for e in (b, c))
        count += all(p[i] * q[j] == p[j] * q[i] for i, j in ((0, 1), (1, 2), (2, 0)))
    return count


def windings(p, t):
    """Winding numbers of closed triangles around each point: solid angles (Van Oosterom and Strackee)."""
    result = np.zeros(len(p))
    for start in range(0, len(p), 32):
        a, b, c = (t[None, :, i] - p[start:start + 32, None] for i in range(3))
        la, lb, lc = (np.linalg.norm(v, axis=-1) for v in (a, b, c))
        det = (a * np.cross(b, c)).sum(-1)
        den = la * lb * lc + (a * b).sum(-1) * lc + (b * c).sum(-1) * la + (c * a).sum(-1) * lb
        result[start:start + 32] = np.arctan2(det, den).sum(1) / (2 * np.pi)
    return result


def clip(t, low, high):
    """Triangles (n, 3, 3) clipped at the faces of a box."""
    for axis in range(3):
        for sign, bound in ((1, low[axis]), (-1, -high[axis])):
            d = sign * t[:, :, axis] - bound
            inside = d >= 0
            count = inside.sum(1)
            parts = [t[count == 3]]
            for n in (1, 2):
                rows = np.flatnonzero(count == n)
                which = inside[rows] if n == 1 else ~inside[rows]
                first = which.argmax(1)
                r = np.arange(len(rows))
                p = [t[rows][r, (first + k) % 3] for k in range(3)]
                e = [d[rows][r, (first + k) % 3] for k in range(3)]
                q1 = p[0] + (e[0] / (e[0] - e[1]))[:, None] * (p[1] - p[0])
                q2 = p[0] + (e[0] / (e[0] - e[2]))[:, None] * (p[2] - p[0])
                if n == 1:
                    parts.append(np.stack([p[0], q1, q2], 1))
                else:
                    parts += [np.stack([q1, p[1], p[2]], 1), np.stack([q1, p[2], q2], 1)]
            t = np.concatenate(parts)
    return t


def components(f, count):
    """The component number of each face, by scipy: components are connected by vertices and numbered by their first
    face."""
    rows = np.concatenate([f[:, 0], f[:, 1]])
    graph = sparse.coo_matrix((np.ones(len(rows)), (rows, np.concatenate([f[:, 1], f[:, 2]]))), shape=(count, count))
    _, of = sparse.csgraph.connected_components(graph, directed=False)
    of = of[f[:, 0]]
    _, first, inverse = np.unique(of, return_index=True, return_inverse=True)
    rank = np.empty(len(first), int)
    rank[np.argsort(first)] = np.arange(len(first))
    return rank[inverse.ravel()]


def keys(v, f):
    """Each triangle as a tuple of bytes, starting at its smallest corner: equal triangles have equal keys."""
    names = np.ascontiguousarray(v, "<f4").view("V12")[:, 0][f].tolist()
    return [t[k] + t[(k + 1) % 3] + t[(k + 2) % 3] for t in names for k in (min(range(3), key=lambda i: t[i]),)]
