"""Which nodes of a lattice are inside a closed mesh."""
import numpy as np


def windings(points, faces, shape):
    """How often a closed mesh goes round each node, by the triangles that lattice lines along x cross beyond it.

    points: in distances of neighbouring nodes from the first one, x, y, z; such that products of their differences
    are exact.
    """
    at = points.astype(float)[faces]
    crossings = np.zeros((shape[0], shape[1], shape[2] + 2), int)
    first = np.ceil(at[:, :, 1:].min(1)).astype(int)
    last = np.floor(at[:, :, 1:].max(1)).astype(int)
    for dy in range(int((last - first).max(initial=0)[()]) + 1):
        for dz in range(int((last - first).max(initial=0)[()]) + 1):
            y, z = first[:, 0] + dy, first[:, 1] + dz
            near = (y <= last[:, 0]) & (z <= last[:, 1]) & (y >= 0) & (z >= 0) & (y < shape[1]) & (z < shape[0])
            t, line = at[near], np.stack([y, z], 1)[near]
            sides = []
            for i in range(3):
                p, q = t[:, i, 1:] - line, t[:, (i + 1) % 3, 1:] - line
                cross = p[:, 0] * q[:, 1] - p[:, 1] * q[:, 0]
                # A line through an edge counts as beside it, on the side that the edge itself says.
                forward = (p[:, 0] < q[:, 0]) | ((p[:, 0] == q[:, 0]) & (p[:, 1] < q[:, 1]))
                sides.append(np.where(cross == 0, np.where(forward, 1.0, -1.0), cross))
            sides = np.stack(sides, 1)
            inside = (sides > 0).all(1) | (sides < 0).all(1)
            sides, t, line = sides[inside], t[inside], line[inside]
            # The side of an edge weighs the corner that is not on it.
            weight = sides / sides.sum(1)[:, None]
            x = weight[:, 1] * t[:, 0, 0] + weight[:, 2] * t[:, 1, 0] + weight[:, 0] * t[:, 2, 0]
            np.add.at(crossings, (line[:, 1], line[:, 0], np.floor(x).astype(int) + 1), np.sign(sides[:, 0]).astype(int))
    return crossings[:, :, ::-1].cumsum(2)[:, :, ::-1][:, :, 1:-1]
