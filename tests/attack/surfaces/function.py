"""The data as a function: piecewise linear on the finest tetrahedra of store/FORMAT.md, section 1.

A finest cube (i, j, k) is divided into six tetrahedra around the diagonal from its corner with even coordinates to the
one with odd coordinates, because this is the refinement edge that bisection gives; each tetrahedron is a path of three
edges between these two corners. Coordinates are node indices x, y, z.
"""
import itertools

import numpy as np
from scipy import ndimage


def evaluate(u, p):
    """The function at points (n, 3). NaN where a value that matters is missing; beyond the volume the value at the
    nearest place in it."""
    size = np.array(u.shape[::-1])
    p = np.clip(np.asarray(p, float), 0, size - 1)
    cell = np.minimum(np.floor(p).astype(int), np.maximum(size - 2, 0))
    odd = cell % 2
    t = np.where(odd, 1 - (p - cell), p - cell)
    t = np.where(size == 1, 0, t)
    step = 1 - 2 * odd
    at = cell + odd
    order = np.argsort(-t, axis=1, kind="stable")
    sorted_t = np.take_along_axis(t, order, 1)
    weights = np.column_stack([1 - sorted_t[:, 0], sorted_t[:, 0] - sorted_t[:, 1], sorted_t[:, 1] - sorted_t[:, 2],
                               sorted_t[:, 2]])
    result = np.zeros(len(p))
    rows = np.arange(len(p))
    for k in range(4):
        if k:
            at = at.copy()
            axis = order[:, k - 1]
            at[rows, axis] += step[rows, axis]
        inside = np.clip(at, 0, size - 1)
        value = u[inside[:, 2], inside[:, 1], inside[:, 0]].astype(float)
        used = weights[:, k] > 0
        with np.errstate(invalid="ignore"):
            result[used] += weights[used, k] * value[used]
    return np.where(np.isfinite(result), result, np.nan)


class Slopes:
    """How much the function may change within a given distance along each axis, near points; from finite values
    alone."""

    def __init__(self, u):
        self.size = np.array(u.shape[::-1])
        sums = np.zeros(np.maximum(np.array(u.shape) - 1, 1))
        for axis in range(3):
            if u.shape[axis] == 1:
                continue
            with np.errstate(invalid="ignore"):
                change = np.abs(np.diff(u.astype(float), axis=axis))
            change = np.where(np.isfinite(change), change, 0)
            change = ndimage.maximum_filter(change, 5, mode="nearest")
            sums += change[tuple(slice(0, n) for n in sums.shape)]
        self.sums = sums

    def near(self, p):
        at = np.clip(np.floor(p).astype(int), 0, np.array(self.sums.shape[::-1]) - 1)
        return self.sums[at[:, 2], at[:, 1], at[:, 0]]


def away(u, slopes, p, value, bound, rounding, noise=0.0):
    """The maximum over points of |f - value| minus its allowed size, and the point. Not above 0 if the promise holds.

    bound: of the function. rounding: of the points, in nodes along each axis. noise: of float64 arithmetic.
    """
    p = np.asarray(p, float).reshape(-1, 3)
    if not len(p):
        return -np.inf, None
    f = evaluate(u, p)
    lost = ~np.isfinite(f)
    if lost.any():  # at the border of missing values, a place within the rounding counts
        for shift in itertools.product((-1, 0, 1), repeat=3):
            q = p[lost] + np.array(shift) * (2 * rounding + 1e-9)
            g = evaluate(u, q)
            some = np.flatnonzero(lost)
            f[some] = np.where(np.isfinite(f[some]), f[some], g)
        lost = ~np.isfinite(f)
        if lost.any():
            return np.inf, p[lost][0]
    largest = np.abs(u[np.isfinite(u)].astype(float)).max() if u.size else 0
    over = np.abs(f - value) - bound - (3 * rounding + 1e-12) * slopes.near(p) - 1e-14 * largest - noise
    worst = int(np.argmax(over))
    return float(over[worst]), p[worst]


def tetrahedra(u):
    """Corners (n, 4, 3) and values (n, 4) of all finest tetrahedra without a missing value; no axis may be flat."""
    nz, ny, nx = (n - 1 for n in u.shape)
    k, j, i = np.meshgrid(np.arange(nz), np.arange(ny), np.arange(nx), indexing="ij")
    cell = np.column_stack([i.ravel(), j.ravel(), k.ravel()])
    first, step = cell + cell % 2, 1 - 2 * (cell % 2)
    corners = []
    for order in itertools.permutations(range(3)):
        path = [first]
        for axis in order:
            path.append(path[-1] + step * np.eye(3, dtype=int)[axis])
        corners.append(np.stack(path, 1))
    corners = np.concatenate(corners)
    values = u[corners[..., 2], corners[..., 1], corners[..., 0]].astype(float)
    good = np.isfinite(values).all(1)
    return corners[good].astype(float), values[good]


def march(corners, values, level, carried=None):
    """Triangles (m, 3, 3) on which the linear function of each tetrahedron is `level`; `carried` at their corners.

    A value equal to the level counts as above. Triangles are not oriented.
    """
    above = values >= level
    count = above.sum(1)
    parts, carry = [], []

    def cut(rows, a, b):
        r = np.arange(len(rows))
        va, vb = values[rows][r, a], values[rows][r, b]
        t = ((level - va) / (vb - va))[:, None]
        pa, pb = corners[rows][r, a], corners[rows][r, b]
        point = pa + t * (pb - pa)
        if carried is None:
            return point, np.zeros(len(rows))
        ca, cb = carried[rows][r, a], carried[rows][r, b]
        return point, ca + t[:, 0] * (cb - ca)

    def put(*cuts):
        parts.append(np.stack([c[0] for c in cuts], 1))
        carry.append(np.stack([c[1] for c in cuts], 1))

    order = np.argsort(~above, axis=1, kind="stable")  # those above come first
    for n in (1, 3):
        rows = np.flatnonzero(count == n)
        o = order[rows]
        lone, others = (o[:, 0], (o[:, 1], o[:, 2], o[:, 3])) if n == 1 else (o[:, 3], (o[:, 0], o[:, 1], o[:, 2]))
        put(*(cut(rows, lone, other) for other in others))
    rows = np.flatnonzero(count == 2)
    o = order[rows]
    ac, ad, bd, bc = (cut(rows, o[:, a], o[:, b]) for a, b in ((0, 2), (0, 3), (1, 3), (1, 2)))
    put(ac, ad, bd)
    put(ac, bd, bc)
    return np.concatenate(parts), np.concatenate(carry)


def lines(triangles, values, level):
    """Segments (m, 2, 3) on which the linear function of each triangle is `level`."""
    above = values >= level
    parts = []
    for n in (1, 2):
        rows = np.flatnonzero(above.sum(1) == n)
        order = np.argsort(~above[rows] if n == 1 else above[rows], axis=1, kind="stable")
        r = np.arange(len(rows))
        ends = []
        for other in (1, 2):
            va, vb = values[rows][r, order[:, 0]], values[rows][r, order[:, other]]
            t = ((level - va) / (vb - va))[:, None]
            pa, pb = triangles[rows][r, order[:, 0]], triangles[rows][r, order[:, other]]
            ends.append(pa + t * (pb - pa))
        parts.append(np.stack(ends, 1))
    return np.concatenate(parts)
