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

    @property
    def _sheared(self) -> bool:
        """Whether the axes are not at right angles: then lengths are those of the world alone."""
        rows = np.array(self.direction)
        return bool(np.abs(rows @ rows.T - np.eye(3)).max() > 1e-9)

    @property
    def _inverse(self) -> np.ndarray:
        """A row of world components times it has those along the axes."""
        rows = np.array(self.direction)
        return np.linalg.inv(rows) if self._sheared else rows.T

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
        x, y, z = (float(v) for v in self._inverse @ np.array(backwards(normal)))
        return (x, y, z), offset + sum(n * first for n, first in zip((x, y, z), self.origin))

    def points_to_array(self, points: np.ndarray) -> np.ndarray:
        """Of (n, 3) positions x, y, z; a view, if the origin is 0 and the axes are along the world's."""
        if self._turned:
            return ((points - np.array(self.origin)) @ self._inverse).astype(points.dtype)[:, ::-1]
        if not any(self.origin):
            return points[:, ::-1]
        return (points - np.array(self.origin)).astype(points.dtype)[:, ::-1]

    def normals_to_array(self, normals: np.ndarray) -> np.ndarray:
        """Of (n, 3) unit vectors x, y, z; a view, if the axes are along the world's."""
        if not self._turned:
            return normals[:, ::-1]
        turned = normals @ np.array(self.direction).T
        if self._sheared:
            turned /= np.linalg.norm(turned, axis=1, keepdims=True)
        return turned.astype(normals.dtype)[:, ::-1]
