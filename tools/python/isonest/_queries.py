"""Converts arguments to queries: checks combinations, and converts to world coordinates."""
from __future__ import annotations

import functools
import inspect
import os
import warnings
from typing import Any, Callable, Literal, NamedTuple, Optional, TypeVar, Union, cast

import numpy as np

from . import _core
from ._arguments import Box, Bytes, Point, refuse_unknown, to_bytes, to_distance, to_point
from ._frame import Frame

ErrorIndicator = Literal["deviation", "plus", "estimate"]
Cells = Literal["tet", "hex", "tetrahedra", "hexahedra"]
"""The longer names are synonyms."""
PlaneCells = Literal["tet", "quad", "tetrahedra", "quadrilaterals"]
Vertices = Literal["linear", "exact"]
Close = Union[None, bool, Literal["below", "above"]]
"""True is "below"."""
Smooth = Union[None, bool, int]
"""The number of passes; True is the default number."""
Components = Union[None, int, Literal["largest", "all"]]
By = Literal["distance", "error"]
Effort = Literal["none", "fast", "best"]
Distance = Union[None, float, str]
Coordinates = Literal["array", "world"]


class Stop(NamedTuple):
    """The stop test: an error, or a field below a threshold."""

    error: float
    error_relative: Optional[float]
    indicator: str
    stop: Optional[str] = None
    threshold: Optional[float] = None
    threshold_relative: Optional[float] = None

    def given(self) -> "list[str]":
        """The names of arguments that differ from their defaults."""
        return [name for name, value in self._asdict().items() if value and (name, value) != ("indicator", "deviation")]

    def apply(self, query: Any) -> None:
        """Sets the stop of a query of any kind."""
        refuse_both(error=self.error or None, error_relative=self.error_relative, stop=self.stop)
        refuse_both(threshold=self.threshold, threshold_relative=self.threshold_relative)
        if self.stop is not None:
            relative = self.threshold_relative is not None
            value = self.threshold_relative if relative else self.threshold
            query.set_threshold(self.stop, float(value or 0.0), relative)
            return
        if self.threshold is not None or self.threshold_relative is not None:
            raise ValueError("threshold= needs stop=")
        query.set_error(*self.as_error())

    def as_error(self) -> "tuple[float, bool, str]":
        """The error, whether it is relative to the data's range, and the indicator."""
        if self.error_relative is not None:
            return float(self.error_relative), True, self.indicator
        return float(self.error), False, self.indicator


class SurfaceStop(NamedTuple):
    """The stops of surfaces that replace an error: a distance or a number of triangles."""

    distance: Distance
    triangles: Optional[int]
    by: str = "distance"
    keep_analysis: Union[bool, str, "os.PathLike[str]"] = False
    effort: Optional[str] = None

    def apply(self, query: Any, stop: Stop) -> None:
        """Sets the stop of a surface query; ``stop`` if no distance or number is given."""
        if self.by not in ("distance", "error"):
            raise ValueError(f"by={self.by!r}: give 'distance' or 'error'")
        if self.by == "error" and self.triangles is None:
            raise ValueError("by= needs triangles=")
        asked = self.distance is not None or self.triangles is not None
        if self.keep_analysis and not asked:
            raise ValueError("keep_analysis= needs distance= or triangles=")
        if self.effort is not None:
            query.set_effort(self.effort)
        if not asked:
            stop.apply(query)
            return
        if stop.given():
            raise ValueError(f"{stop.given()[0]}= cannot be combined with distance= or triangles=")
        self._apply_distance(query)
        if self.keep_analysis:
            query.set_kept_analysis("" if self.keep_analysis is True else self.keep_analysis)

    def _apply_distance(self, query: Any) -> None:
        if self.by == "error":
            if self.distance is not None:
                raise ValueError("by='error' and distance= cannot be combined")
            query.set_triangles_by_error(int(self.triangles or 0))
            return
        within, voxels = to_distance(self.distance) if self.distance is not None else (None, False)
        if self.triangles is not None:
            query.set_triangles(int(self.triangles), within, voxels)
        else:
            query.set_distance(within, voxels)


class Viewpoint(NamedTuple):
    """Focus and camera, away from which the error may be larger."""

    focus: Union[None, Point, Box]
    falloff: float
    camera: Optional[Point]
    pixels: float
    fov: float
    height: int

    def apply(self, query: Any, place: "Place") -> None:
        """Sets focus and camera of a query of any kind."""
        if self.focus is not None:
            ends: Any = (self.focus, self.focus) if np.ndim(self.focus) == 1 else self.focus
            low, high = (place.point("focus", corner) for corner in ends)
            query.set_focus(low, high, float(self.falloff))
        elif self.falloff:
            raise ValueError("falloff= needs focus=")
        if self.camera is not None:
            query.set_camera(place.point("camera", self.camera), float(self.fov), int(self.height), float(self.pixels))


class Place(NamedTuple):
    """Converts positions from the coordinates of the result to world coordinates."""

    frame: Frame
    coordinates: str

    def require(self) -> None:
        """Raises ValueError unless the coordinates are "array" or "world"."""
        if self.coordinates not in ("array", "world"):
            raise ValueError(f"coordinates={self.coordinates!r}: give 'array' or 'world'")

    def point(self, name: str, point: Point) -> "tuple[float, float, float]":
        """World coordinates of the argument ``name``. Raises ValueError unless it has three numbers."""
        numbers = to_point(name, point)
        return self.frame.point_to_world(numbers) if self.coordinates == "array" else numbers

    def plane(self, normal: Point, offset: float) -> "tuple[tuple[float, float, float], float]":
        """Normal and offset in world coordinates."""
        direction = to_point("normal", normal)
        return self.frame.plane_to_world(direction, float(offset)) if self.coordinates == "array" else (
            direction, float(offset))

    def direction(self, name: str, direction: Point) -> "tuple[float, float, float]":
        """World components of the argument ``name``. Raises ValueError unless it has three numbers."""
        numbers = to_point(name, direction)
        return self.frame.vector_to_world(numbers) if self.coordinates == "array" else numbers

    def set_box(self, query: Any, box: Optional[Box]) -> None:
        """Restricts a query of any kind to a box, if there is one."""
        if box is not None:
            low, high = box
            query.set_box(self.point("box", low), self.point("box", high))


def set_components(query: Any, components: Components, min_component: int, min_volume: float) -> None:
    """Sets the choice of connected pieces of a surface. Raises ValueError for invalid choices."""
    named = {"largest": 1, "all": 0}
    if isinstance(components, str) and components not in named:
        raise ValueError(f"components={components!r}: give 'largest', 'all', or how many of the largest to keep")
    largest = named[components] if isinstance(components, str) else int(components or 0)
    if min_component < 0 or largest < 0 or (largest == 0 and isinstance(components, int)):
        raise ValueError("components= must be at least 1, min_component= at least 0")
    if components is not None or min_component or min_volume:
        query.set_components(largest, int(min_component), float(min_volume))


def isovalue(iso: Any, level: Any) -> Any:
    """The value given by either name; None if there is none. Raises TypeError for both."""
    if level is None:
        return iso
    if iso is not None:
        raise TypeError("isosurface() got both iso= and level=, which are two names of one argument")
    return level


OF_MARCHING_CUBES = {
    "method": "there is one method: leave it out",
    "mask": "it is for isonest.isosurface() with an array; a store can be made from np.ma.masked_array(volume, ~mask)",
    "step_size": "it is for isonest.isosurface(); of a store, error= and distance= make smaller meshes, within a bound",
    "allow_degenerate": "leave it out: no triangle has an area of 0, except for report.zero_area_triangles",
    "spacing": "it is given to isonest.preprocess()",
    "origin": "it is given to isonest.preprocess()",
}
"""What to do in place of an argument of scikit-image's marching_cubes, or of isonest.isosurface, for a store."""

_F = TypeVar("_F", bound=Callable[..., Any])


def renew(keywords: "dict[str, Any]") -> "dict[str, Any]":
    """Converts keywords of isonest 0.4 to their current names, with a DeprecationWarning for each."""
    renewed = dict(keywords)

    def old(name: str, instead: str) -> Any:
        warnings.warn(f"{name}= is deprecated: {instead}", DeprecationWarning, stacklevel=4)
        return renewed.pop(name)
    if "guarantee" in renewed:
        renewed["indicator"] = old("guarantee", "it is called indicator=")
    if "no_simplify" in renewed and old("no_simplify", 'use effort="none"'):
        renewed["effort"] = "none"
    if "simplify" in renewed:
        # It was about errors alone.
        is_of_error = keywords.get("distance") is None and (
            keywords.get("triangles") is None or keywords.get("by") == "error")
        if not old("simplify", 'use effort="none" for a mesh that is not simplified') and is_of_error:
            renewed["effort"] = "none"
    return renewed


def with_old_names(method: _F) -> _F:
    """Makes a method accept keywords of isonest 0.4 that were renamed."""
    @functools.wraps(method)
    def renewed(*arguments: Any, **keywords: Any) -> Any:
        return method(*arguments, **renew(keywords))

    return cast(_F, renewed)


def with_ways(name: str) -> Callable[[_F], _F]:
    """Makes a method suggest alternatives to unknown keywords; `name` is the name that its callers know."""
    def wrap(method: _F) -> _F:
        known = inspect.signature(method).parameters.keys() - {"self"}

        @functools.wraps(method)
        def checked(*arguments: Any, **keywords: Any) -> Any:
            keywords = renew(keywords)
            if not keywords.keys() <= known:
                refuse_unknown(name, keywords, known, OF_MARCHING_CUBES)
            return method(*arguments, **keywords)

        return cast(_F, checked)

    return wrap


def set_close(query: Any, close: Close) -> None:
    """Sets whether a surface is closed, and by what the outside counts as."""
    if close is not None and close is not False:
        query.set_close("below" if close is True else close)


def set_smooth(query: Any, smooth: Smooth, keep_nodes: bool) -> None:
    """Sets the smoothing of labels' surfaces, and whether simplification keeps all nodes on their sides."""
    if smooth is not None and smooth is not False:
        query.set_smooth(None if smooth is True else int(smooth), bool(keep_nodes))
    elif keep_nodes:
        raise ValueError("keep_nodes= needs smooth=")


def set_attributes(query: Any, *, normals: bool, vertex_values: Any, vertex_error: Optional[str],
                   cells: Optional[str]) -> None:
    """Sets cells and vertex attributes; not for contour lines."""
    query.set_normals(bool(normals))
    if cells is not None:
        query.set_cells(cells)
    if vertex_values is not None:
        query.set_vertex_values(vertex_values._core)
    if vertex_error is not None:
        query.set_vertex_error(vertex_error)


def is_flipped(gradient_direction: str) -> bool:
    """Whether the orientation of faces is reversed. Raises ValueError for an unknown name."""
    if gradient_direction not in ("descent", "ascent"):
        raise ValueError(f"gradient_direction={gradient_direction!r}: give 'descent' or 'ascent'")
    return gradient_direction == "ascent"


def options(memory: Bytes, threads: int, scratch: "os.PathLike[str] | str", quality: bool = False) -> Any:
    """Options of an extraction."""
    chosen = _core.ExtractOptions()
    chosen.memory = to_bytes(memory)
    chosen.threads = int(threads)
    chosen.scratch = os.fspath(scratch)
    chosen.quality = quality
    return chosen


def refuse_both(**given: Any) -> None:
    """Raises ValueError if more than one of the arguments is not None."""
    names = [f"{name}=" for name, value in given.items() if value is not None]
    if len(names) > 1:
        raise ValueError(f"give one of {' and '.join(names)}, not both")
