"""Conversion between array coordinates, (z, y, x) times the spacing, and world coordinates, (x, y, z)."""
from __future__ import annotations

from typing import Any, NamedTuple, Sequence

import numpy as np

from ._arguments import backwards

_Vector = tuple[float, float, float]
Directions = tuple[_Vector, _Vector, _Vector]
ALONG_WORLD = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))


class Frame(NamedTuple):
    """Placement of an array in the world; converts coordinates."""

    origin: _Vector
    """World position of the first node, (x, y, z)."""
    direction: Directions = ALONG_WORLD
    """World directions of the axes x, y and z."""

    @classmethod
    def of(cls, core: Any) -> "Frame":
        """The frame of a store or a source of _core."""
        x, y, z = core.origin
        (xx, xy, xz), (yx, yy, yz), (zx, zy, zz) = core.direction
        return cls((x, y, z), ((xx, xy, xz), (yx, yy, yz), (zx, zy, zz)))

    @property
    def _turned(self) -> bool:
        return self.direction != ALONG_WORLD

    @property
    def _sheared(self) -> bool:
        """Whether the axes are not at right angles."""
        rows = np.array(self.direction)
        return bool(np.abs(rows @ rows.T - np.eye(3)).max() > 1e-9)

    @property
    def _inverse(self) -> np.ndarray:
        """The matrix M such that ``world @ M`` are the components along the axes x, y, z."""
        rows = np.array(self.direction)
        return np.linalg.inv(rows) if self._sheared else rows.T

    def _vector_to_world(self, vector: Sequence[float]) -> np.ndarray:
        """World components of a vector (z, y, x)."""
        return np.array(backwards(vector)) @ np.array(self.direction)

    def point_to_world(self, point: Sequence[float]) -> _Vector:
        """World position (x, y, z) of an array position (z, y, x)."""
        x, y, z = (float(v) for v in self._vector_to_world(point) + np.array(self.origin))
        return x, y, z

    def vector_to_world(self, vector: Sequence[float]) -> _Vector:
        """World components (x, y, z) of a vector (z, y, x)."""
        x, y, z = (float(v) for v in self._vector_to_world(vector))
        return x, y, z

    def plane_to_world(self, normal: Sequence[float], offset: float) -> tuple[_Vector, float]:
        """Normal and offset in the world of the plane ``normal . p = offset`` of the array."""
        x, y, z = (float(v) for v in self._inverse @ np.array(backwards(normal)))
        return (x, y, z), offset + sum(n * first for n, first in zip((x, y, z), self.origin))

    def points_to_array(self, points: np.ndarray) -> np.ndarray:
        """Array positions of (n, 3) world positions; a view if the origin is 0 and the axes are those of the world."""
        if self._turned:
            return ((points - np.array(self.origin)) @ self._inverse).astype(points.dtype)[:, ::-1]
        if not any(self.origin):
            return points[:, ::-1]
        return (points - np.array(self.origin)).astype(points.dtype)[:, ::-1]

    def normals_to_array(self, normals: np.ndarray) -> np.ndarray:
        """Array components of (n, 3) unit vectors in the world; a view if the axes are those of the world."""
        if not self._turned:
            return normals[:, ::-1]
        turned = normals @ np.array(self.direction).T
        if self._sheared:
            turned /= np.linalg.norm(turned, axis=1, keepdims=True)
        return turned.astype(normals.dtype)[:, ::-1]
