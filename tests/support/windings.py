"""Which nodes of a lattice are inside a closed mesh."""
import numpy as np


def windings(points, faces, shape):
    """The winding number of a closed mesh around each node, by the triangles that lattice lines along x cross beyond
    it.

    points: in units of the node distance relative to the first node, x, y, z; such that products of their differences
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
            sides, signs = [], []
            for i in range(3):
                p, q = t[:, i, 1:] - line, t[:, (i + 1) % 3, 1:] - line
                cross = p[:, 0] * q[:, 1] - p[:, 1] * q[:, 0]
                # A line through an edge counts as beside it, on a side that depends on the edge alone.
                forward = (p[:, 0] < q[:, 0]) | ((p[:, 0] == q[:, 0]) & (p[:, 1] < q[:, 1]))
                sides.append(cross)
                signs.append(np.where(cross == 0, np.where(forward, 1, -1), np.sign(cross)).astype(int))
            sides, signs = np.stack(sides, 1), np.stack(signs, 1)
            inside = (np.abs(signs.sum(1)) == 3) & (sides != 0).any(1)
            sides, signs, t, line = sides[inside], signs[inside], t[inside], line[inside]
            # The signed area at an edge is the weight of the opposite corner.
            weight = sides / sides.sum(1)[:, None]
            x = weight[:, 1] * t[:, 0, 0] + weight[:, 2] * t[:, 1, 0] + weight[:, 0] * t[:, 2, 0]
            # If the crossing is next to a node, the side of the triangle's plane on which the node lies decides.
            normal = np.cross(t[:, 1] - t[:, 0], t[:, 2] - t[:, 0])
            node = np.round(x)
            beyond = np.einsum("ij,ij->i", normal, np.column_stack([node, line]) - t[:, 0]) * normal[:, 0] < 0
            x = np.where(np.abs(x - node) < 1e-3, np.where(beyond, node + 0.5, node - 0.5), x)
            np.add.at(crossings, (line[:, 1], line[:, 0], np.floor(x).astype(int) + 1), signs[:, 0])
    return crossings[:, :, ::-1].cumsum(2)[:, :, ::-1][:, :, 1:-1]
