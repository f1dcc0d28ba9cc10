"""Between the coordinates of an array, (z, y, x) times the spacing, and those of the world, (x, y, z)."""
from __future__ import annotations

from typing import Any, NamedTuple, Sequence

import numpy as np

from ._arguments import backwards

_Vector = tuple[float, float, float]
Directions = tuple[_Vector, _Vector, _Vector]
_ALONG_WORLD = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))


class Frame(NamedTuple):
    """Where an array lies in the world. The one place that knows how coordinates change."""

    origin: _Vector
    """World position of the first node, (x, y, z)."""
    direction: Directions = _ALONG_WORLD
    """World directions of the axes x, y and z."""

    @classmethod
    def of(cls, core: Any) -> "Frame":
        """That of a store or a source of _core."""
        x, y, z = core.origin
        (xx, xy, xz), (yx, yy, yz), (zx, zy, zz) = core.direction
        return cls((x, y, z), ((xx, xy, xz), (yx, yy, yz), (zx, zy, zz)))

    @property
    def _turned(self) -> bool:
        return self.direction != _ALONG_WORLD

    def _vector_to_world(self, vector: Sequence[float]) -> np.ndarray:
        """Of (z, y, x)."""
        return np.array(backwards(vector)) @ np.array(self.direction)

    def point_to_world(self, point: Sequence[float]) -> _Vector:
        """Of (z, y, x)."""
        x, y, z = (float(v) for v in self._vector_to_world(point) + np.array(self.origin))
        return x, y, z

    def vector_to_world(self, vector: Sequence[float]) -> _Vector:
        """Of (z, y, x)."""
        x, y, z = (float(v) for v in self._vector_to_world(vector))
        return x, y, z

    def plane_to_world(self, normal: Sequence[float], offset: float) -> tuple[_Vector, float]:
        """Of the plane {normal . p = offset}."""
        x, y, z = (float(v) for v in self._vector_to_world(normal))
        return (x, y, z), offset + sum(n * first for n, first in zip((x, y, z), self.origin))

    def points_to_array(self, points: np.ndarray) -> np.ndarray:
        """Of (n, 3) positions x, y, z; a view, if the origin is 0 and the axes are along the world's."""
        if self._turned:
            return ((points - np.array(self.origin)) @ np.array(self.direction).T).astype(points.dtype)[:, ::-1]
        if not any(self.origin):
            return points[:, ::-1]
        return (points - np.array(self.origin)).astype(points.dtype)[:, ::-1]

    def vectors_to_array(self, vectors: np.ndarray) -> np.ndarray:
        """Of (n, 3) vectors x, y, z; a view, if the axes are along the world's."""
        if self._turned:
            return (vectors @ np.array(self.direction).T).astype(vectors.dtype)[:, ::-1]
        return vectors[:, ::-1]
