"""Surfaces straight from a volume, without a store."""
from __future__ import annotations

import inspect
from typing import Any, Optional, Sequence, Union

import numpy as np

from . import _core, _queries, _sources
from ._arguments import Progress, reporting
from ._extracting import Extracting
from ._frame import Frame
from ._mesh import Mesh
from ._queries import Place

_OF_ANY_MESH = frozenset(("normals", "coordinates", "gradient_direction", "quality"))
"""Arguments of Store.isosurface that need no store."""
_OF_HEXAHEDRA = frozenset(("box", "close", "components", "min_component", "min_volume", "vertex_values"))
"""Those that need one, and go with hexahedra at full resolution."""


def asked_beside(query: "dict[str, Any]") -> "set[str]":
    """Which arguments of Store.isosurface are there, need a store, and are not as if nothing was said."""
    known = inspect.signature(Extracting.isosurface).parameters
    for name in query:
        if name not in known:
            raise TypeError(f"isosurface() got an unexpected keyword argument {name!r}")
    return {name for name, value in query.items()
            if name not in _OF_ANY_MESH and (np.ndim(value) > 0 or value != known[name].default)}


def cells_for(asked: "set[str]") -> Optional[str]:
    """Hexahedra, unless something is asked for of which a store has to say what goes with it."""
    return "hex" if asked <= _OF_HEXAHEDRA else None


def march(volume: Any, iso: "Union[None, float, Sequence[float]]", *, spacing: Optional[Sequence[float]],
          unit: Optional[str], missing: Optional[float], options: Any, progress: Progress, normals: bool = True,
          coordinates: str = "array", gradient_direction: str = "descent",
          **_as_nothing_was_said: Any) -> "Union[None, Mesh, list[Mesh]]":
    """The surface of hexahedra at full resolution, of several isovalues a list; None if that needs a store.

    ``options`` are those of an extraction.
    """
    def source() -> Any:
        return _sources.of_volume(volume, identified=False, memory=options.memory, spacing=spacing, unit=unit,
                                  missing=missing)

    flip = _queries.is_flipped(gradient_direction)
    first = source()
    if first.march_memory is None or first.march_memory > options.memory:
        return None
    place = Place(Frame(tuple(first.origin)), coordinates)
    place.require()

    def of_isovalue(read: Any, level: float) -> Mesh:
        with reporting(progress) as report:
            parts = _core.march(read, level, bool(normals), options, report)
        return Mesh(parts, coordinates=coordinates, frame=place.frame, flip=flip, level=level)

    if iso is None:
        with reporting(progress) as report:
            low, high = _core.finite_range(first, options, report) or (0.0, 0.0)
        return of_isovalue(source(), low + (high - low) / 2)
    if np.ndim(iso) == 0:
        return of_isovalue(first, float(iso))  # type: ignore[arg-type]
    return [of_isovalue(source(), float(level)) for level in iso]  # type: ignore[union-attr]
