"""Between the coordinates of an array, (z, y, x) times the spacing, and those of the world, (x, y, z)."""
from __future__ import annotations

from typing import NamedTuple, Sequence

import numpy as np

from ._arguments import backwards


class Frame(NamedTuple):
    """Where an array lies in the world. The one place that knows how coordinates change."""

    origin: tuple[float, float, float]
    """World position of the first node, (x, y, z)."""

    def point_to_world(self, point: Sequence[float]) -> tuple[float, float, float]:
        """Of (z, y, x)."""
        x, y, z = (along + first for along, first in zip(backwards(point), self.origin))
        return x, y, z

    def plane_to_world(self, normal: Sequence[float], offset: float) -> tuple[tuple[float, float, float], float]:
        """Of the plane {normal . p = offset}."""
        direction = backwards(normal)
        return direction, offset + sum(n * first for n, first in zip(direction, self.origin))

    def points_to_array(self, points: np.ndarray) -> np.ndarray:
        """Of (n, 3) positions x, y, z; a view, if the origin is 0."""
        if not any(self.origin):
            return points[:, ::-1]
        return (points - np.array(self.origin)).astype(points.dtype)[:, ::-1]

    def vectors_to_array(self, vectors: np.ndarray) -> np.ndarray:
        """Of (n, 3) vectors x, y, z; a view."""
        return vectors[:, ::-1]
