"""Difficult volumes of labels, and meshes of them as sets of triangles."""
import numpy as np


def cells(random, shape, count, most):
    """Every node has the label of the nearest of some random points. random: a numpy generator."""
    points = random.random((count, 3)) * shape
    nodes = np.stack(np.meshgrid(*map(np.arange, shape), indexing="ij"), -1).reshape(-1, 1, 3)
    return random.integers(0, most, count)[((nodes - points) ** 2).sum(-1).argmin(1)].reshape(shape)


def corner_nodes():
    """Nodes that touch at corners."""
    labels = np.zeros((9, 9, 9), int)
    for i in range(1, 8):
        labels[i, i, i] = 1 + i % 2
        labels[i, 8 - i, 4] = 3
    return labels


def single_nodes():
    """One node inside, one in a corner of the volume, one in a face of it."""
    labels = np.zeros((7, 7, 7), int)
    labels[3, 3, 3], labels[0, 0, 0], labels[6, 3, 0] = 1, 2, 3
    return labels


def cyclic(points, faces):
    """The triangles as bytes, each starting at its smallest corner."""
    keys = []
    for triangle in np.ascontiguousarray(points).view("V12")[:, 0][faces].tolist():
        k = min(range(3), key=lambda i: triangle[i])
        keys.append(triangle[k] + triangle[(k + 1) % 3] + triangle[(k + 2) % 3])
    return keys
