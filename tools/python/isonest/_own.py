"""Own indicators: what the functions of :func:`isonest.preprocess` get."""
from __future__ import annotations

from typing import Any, Callable, NamedTuple

import numpy as np


class RefinementNodes(NamedTuple):
    """Nodes at which elements (tetrahedra; triangles or edges of maps) are bisected, for the functions of
    :func:`isonest.preprocess`. All n of them have one level, one kind and the same number m of elements; an element has k
    vertices (4 in a volume, 3 in a map). Coordinates are indices [z, y, x] of the volume; the last node of a level may
    lie outside and has the value of the nearest node."""

    level: int
    """Level of the elements; 1 is the finest."""
    odd_axes: int
    """1: midpoints of edges, 2: centres of faces, 3: centres of cubes."""
    node: np.ndarray
    """The nodes x: (n, 3) integers."""
    value: np.ndarray
    """U(x): (n,)."""
    ends: np.ndarray
    """The ends x1, x2 of the refinement edges: (n, 2, 3) integers."""
    end_values: np.ndarray
    """U(x1), U(x2): (n, 2)."""
    vertices: np.ndarray
    """Vertices of the elements that are bisected, x1 and x2 first: (n, m, k, 3) integers."""
    values: np.ndarray
    """The values there: (n, m, k)."""

    @property
    def offset(self) -> np.ndarray:
        """U(x) - (U(x1) + U(x2)) / 2: (n,)."""
        return self.value - self.end_values.mean(axis=1)


def calling(function: Callable[[RefinementNodes], Any]) -> Callable[..., Any]:
    """The function as the compiled part calls it: with the arrays as separate arguments."""
    return lambda *arrays: function(RefinementNodes(*arrays))
