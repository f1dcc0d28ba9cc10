"""Counts and errors of the study, compared with an explicit bisection, element by element."""
import numpy as np

from . import volumes
from .tries import ask, kind, require, store_of


def bisected(u, field, threshold):
    """Leaves of the nested grid that refines where the field is at least `threshold`, and the largest offset in them.

    u [z, y, x]: each axis has 2^k + 1 nodes. The refinement edge is the longest one, in nodes: for the tetrahedra of a
    cube its diagonal, then a diagonal of a face, then an edge of the cube.
    """
    size = max(u.shape) - 1
    cell = np.array(u.shape[::-1]) - 1
    step = int(min(cell.min(), size))
    leaves, worst = 0, 0.0
    stack = []
    for corner in np.ndindex(*(cell // step)):
        first = (np.array(corner) + np.array(corner) % 2) * step
        sign = np.where(np.array(corner) % 2, -step, step)
        for order in ((0, 1, 2), (0, 2, 1), (1, 0, 2), (1, 2, 0), (2, 0, 1), (2, 1, 0)):
            path = [first]
            for axis in order:
                path.append(path[-1] + sign * np.eye(3, dtype=int)[axis])
            stack.append(np.array(path))
    while stack:
        t = stack.pop()
        a, b = max(((i, j) for i in range(4) for j in range(i)), key=lambda e: ((t[e[0]] - t[e[1]]) ** 2).sum())
        twice = t[a] + t[b]
        x, y, z = twice // 2
        if not (twice % 2).any() and field[z, y, x] >= threshold:
            for end in (a, b):
                child = t.copy()
                child[end] = twice // 2
                stack.append(child)
            continue
        leaves += 1
        worst = max(worst, offset(u, t))
    return leaves, worst


def offset(u, t):
    """The largest difference between the values at the nodes in a tetrahedron and its linear function."""
    low, high = t.min(0), t.max(0)
    p = np.stack(np.meshgrid(*(np.arange(a, b + 1) for a, b in zip(low, high)), indexing="ij"), -1).reshape(-1, 3)
    w = np.linalg.solve(np.vstack([t.T, np.ones(4)]).astype(float), np.vstack([p.T, np.ones(len(p))]))
    p, w = p[(w > -1e-9).all(0)], w[:, (w > -1e-9).all(0)]
    values = u[t[:, 2], t[:, 1], t[:, 0]].astype(float)
    return float(np.abs(u[p[:, 2], p[:, 1], p[:, 0]].astype(float) - values @ w).max())


@kind
def study(one):
    """Leaves and largest offsets for every threshold; bounds on those below it."""
    volume = volumes.volume(one, most=5, missing=False, turned=False)
    sizes = (one.pick(3, 3, 5, 5, 5, 9) if one.chance(0.3) else 3,) * 3
    base = volumes.SHAPES[volume.what](one, sizes)
    volume.u = np.rint(base * one.pick(1, 10, 100)).astype("i4") if one.chance(0.5) else base.astype("f4")
    store = store_of(one, volume, exact=True, indicators=["linf_bar", "linf_plus", "deviation_bar"])
    name = one.pick("deviation_bar", "linf_plus", "linf_bar")
    rows = [r for r in ask(one, store.study, [name], steps=int(one.random.integers(2, 6))).rows if r.field == name]
    path = one.folder / "field.npy"
    ask(one, store.export, path, name)
    field = np.load(path)
    largest = float(field.max())
    for row in rows:
        leaves, worst = bisected(volume.u, field, row.threshold * largest)
        size = np.abs(volume.u.astype(float)).max()
        extent = float(np.ptp(volume.u.astype(float))) or 1.0  # the study's errors are relative to it
        require(abs(row.linf * extent - worst) <= 1e-6 * size, f"{name} at {row.threshold}: linf {row.linf}, computed {worst}")
        require(row.leaves == leaves, f"{name} at {row.threshold}: {row.leaves} leaves, computed {leaves}")
        require(name == "linf_bar" or worst <= row.threshold * largest * (1 + 1e-6) + 1e-6 * size,
                f"{name} at {row.threshold}: {worst} above {row.threshold * largest}")
