"""Extraction directly from a volume, without a store."""
from __future__ import annotations

from typing import Any, Callable, Optional, Sequence, Union

from . import _core, _sources
from ._arguments import Bytes, Progress, reporting, to_bytes
from ._extracting import Extracting
from ._frame import Frame
from ._mesh import Mesh
from ._queries import Place


class NeedsStore(Exception):
    """Raised if the volume, the query or the memory budget requires a store, with the indicators that it must have."""

    def __init__(self, indicators: "list[str]") -> None:
        super().__init__("a store is needed")
        self.indicators = indicators


class _Volume(Extracting):
    """A volume with the method isosurface() of a store; raises NeedsStore if a query needs one.

    ``open_source`` opens the volume. Each surface needs its own source, because a source can be read only once. With
    ``in_the_middle`` the isovalue is the mean of the smallest and the largest value, whatever the query says.
    """

    def __init__(self, open_source: "Callable[[], Any]", in_the_middle: bool) -> None:
        self._open = open_source
        self._core = open_source()
        self._frame_of_source = Frame.of(self._core)
        self._in_the_middle = in_the_middle
        self._is_used = False

    @property
    def _frame(self) -> Frame:
        return self._frame_of_source

    def _source(self) -> Any:
        """A source that has not been read."""
        source = self._open() if self._is_used else self._core
        self._is_used = True
        return source

    def _require_no_store(self, query: Any, options: Any) -> None:
        least = self._core.march_memory(query)
        if least is None or least > options.memory:
            raise NeedsStore(_core.fields_needed(query))

    def _middle(self, options: Any, progress: Progress) -> float:
        with reporting(progress) as report:
            low, high = _core.finite_range(self._source(), options, report) or (0.0, 0.0)
        return low + (high - low) / 2

    def _march(self, query: Any, options: Any, progress: Progress, place: Place, level: float, flip: bool) -> Mesh:
        query.set_iso(level)
        with reporting(progress) as report:
            parts = _core.extract_volume(self._source(), query, options, report)
        return Mesh(parts, coordinates=place.coordinates, frame=place.frame, flip=flip, level=level)

    def _extract(self, query: Any, options: Any, progress: Progress, place: Place, *, level: Optional[float] = None,
                 flip: bool = False) -> Mesh:
        self._require_no_store(query, options)
        if self._in_the_middle or level is None:
            level = self._middle(options, progress)
        return self._march(query, options, progress, place, level, flip)

    def _extract_levels(self, levels: "list[float]", query: Any, options: Any, progress: Progress, place: Place, *,
                        flip: bool) -> "list[Mesh]":
        self._require_no_store(query, options)
        return [self._march(query, options, progress, place, level, flip) for level in levels]


def march(volume: Any, iso: "Union[None, float, Sequence[float]]", *, spacing: Optional[Sequence[float]],
          origin: Optional[Sequence[float]], every: int, unit: Optional[str], frame: Optional[_sources.PatientFrame], missing: Optional[float], memory: Bytes,
          **query: Any) -> "Union[Mesh, list[Mesh]]":
    """Extracts the surface, for several isovalues a list of surfaces; raises NeedsStore if that needs a store.

    The arguments are those of :func:`isonest.isosurface`.
    """
    budget = to_bytes(memory)

    def open_source() -> Any:
        return _sources.of_volume(volume, identified=False, memory=budget, spacing=spacing, origin=origin,
                                  every=every, unit=unit, frame=frame, missing=missing)

    return _Volume(open_source, iso is None).isosurface(
        0.0 if iso is None else iso, memory=budget - _sources.for_fetching(volume, budget), **query)
