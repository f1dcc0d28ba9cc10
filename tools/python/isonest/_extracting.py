"""Surfaces, slices, contour lines and graphs of a store."""
from __future__ import annotations

import os
from typing import Any, Optional, Sequence, Union, overload

import numpy as np

from . import _core, _queries
from ._arguments import Box, Bytes, Point, Progress, in_own_unit, reporting
from ._frame import Frame
from ._mesh import Mesh
from ._queries import (By, Cells, Close, Components, Coordinates, Distance, Effort, ErrorIndicator, Place, PlaneCells, Smooth,
                       Stop, SurfaceStop, Vertices, Viewpoint)

_Path = Union[str, "os.PathLike[str]"]


class Extracting:
    """What is extracted from a store."""

    _core: Any

    @property
    def _frame(self) -> Frame:
        raise NotImplementedError

    @overload
    def isosurface(self, iso: float, *, error: float = 0.0, error_relative: Optional[float] = None,
                   indicator: ErrorIndicator = "deviation", stop: Optional[str] = None,
                   threshold: Optional[float] = None, threshold_relative: Optional[float] = None,
                   distance: Distance = None, triangles: Optional[int] = None, by: By = "distance",
                   effort: Optional[Effort] = None, keep_analysis: "bool | _Path" = False,
                   focus: Union[None, Point, Box] = None, falloff: float = 0.0, camera: Optional[Point] = None,
                   pixels: float = 1.0, fov: float = 40.0, height: int = 1080, box: Optional[Box] = None,
                   bound: Optional[str] = None, view: Optional[Point] = None, cull_by: Optional[str] = None,
                   normals: bool = True, vertex_values: "Optional[Extracting]" = None,
                   vertex_error: Optional[str] = None, vertices: Vertices = "linear", cells: Optional[Cells] = None,
                   components: Components = None, min_component: int = 0, min_volume: float = 0.0,
                   close: Close = None, volume_interval: bool = False, coordinates: Coordinates = "array",
                   gradient_direction: str = "descent", quality: bool = False, memory: Bytes = "1G", threads: int = 0,
                   scratch: _Path = "", progress: Progress = None) -> Mesh: ...

    @overload
    def isosurface(self, iso: Sequence[float], *, error: float = 0.0, error_relative: Optional[float] = None,
                   indicator: ErrorIndicator = "deviation", stop: Optional[str] = None,
                   threshold: Optional[float] = None, threshold_relative: Optional[float] = None,
                   distance: Distance = None, triangles: Optional[int] = None, by: By = "distance",
                   effort: Optional[Effort] = None, keep_analysis: "bool | _Path" = False,
                   focus: Union[None, Point, Box] = None, falloff: float = 0.0, camera: Optional[Point] = None,
                   pixels: float = 1.0, fov: float = 40.0, height: int = 1080, box: Optional[Box] = None,
                   bound: Optional[str] = None, view: Optional[Point] = None, cull_by: Optional[str] = None,
                   normals: bool = True, vertex_values: "Optional[Extracting]" = None,
                   vertex_error: Optional[str] = None, vertices: Vertices = "linear", cells: Optional[Cells] = None,
                   components: Components = None, min_component: int = 0, min_volume: float = 0.0,
                   close: Close = None, volume_interval: bool = False, coordinates: Coordinates = "array",
                   gradient_direction: str = "descent", quality: bool = False, memory: Bytes = "1G", threads: int = 0,
                   scratch: _Path = "", progress: Progress = None) -> "list[Mesh]": ...

    def isosurface(self, iso: "float | Sequence[float]", *, error: float = 0.0, error_relative: Optional[float] = None,
                   indicator: ErrorIndicator = "deviation", stop: Optional[str] = None,
                   threshold: Optional[float] = None, threshold_relative: Optional[float] = None,
                   distance: Distance = None, triangles: Optional[int] = None, by: By = "distance",
                   effort: Optional[Effort] = None, keep_analysis: "bool | _Path" = False,
                   focus: Union[None, Point, Box] = None, falloff: float = 0.0, camera: Optional[Point] = None,
                   pixels: float = 1.0, fov: float = 40.0, height: int = 1080, box: Optional[Box] = None,
                   bound: Optional[str] = None, view: Optional[Point] = None, cull_by: Optional[str] = None,
                   normals: bool = True, vertex_values: "Optional[Extracting]" = None,
                   vertex_error: Optional[str] = None, vertices: Vertices = "linear", cells: Optional[Cells] = None,
                   components: Components = None, min_component: int = 0, min_volume: float = 0.0,
                   close: Close = None, volume_interval: bool = False, coordinates: Coordinates = "array",
                   gradient_direction: str = "descent", quality: bool = False, memory: Bytes = "1G", threads: int = 0,
                   scratch: _Path = "", progress: Progress = None) -> "Mesh | list[Mesh]":
        """The surface on which the data have the value ``iso``; of data in a plane, the lines.

        iso: a number; or several, for which the store is read once, and a list of their meshes is returned, each as
            of its isovalue alone.
        error: how far the data may be from ``iso``, anywhere on the mesh, in units of the data; 0 is full
            resolution. error_relative: the same as a fraction of the data's range.
        indicator: "deviation" and "plus" are bounds, "estimate" is none.
        stop, threshold, threshold_relative: in place of an error, refine while this field of the store is not below
            the threshold, in the field's units or as a fraction of its largest value.
        distance: in place of an error, how far the mesh may be from the surface at full resolution and the other
            way round, in the units of the spacing; or a text such as "0.5voxel", or "0.5mm" if :attr:`unit` is known.
        triangles: in place of an error, at most so many, at the smallest distance that is found; with a distance,
            whichever is reached first. by: "error" makes the error small in place of the distance.
        effort: how a mesh within an error or a distance is simplified. "best" leaves the fewest triangles, "fast" more
            in less time, "none" those of the nested grid. None: "best", or "none" with ``stop``, ``focus``,
            ``camera``, an "estimate" and for isolines within an error.
        keep_analysis: True keeps an analysis of the surface beside the store, or give a folder: made once, in several
            times the time; other distances and numbers of triangles then take little.
        focus, falloff: the error holds at this point or in this box, and is 1 + falloff d times as large at the
            distance d.
        camera, pixels, fov, height: stop as well where a viewer at this place, with an angle of ``fov`` degrees from
            top to bottom and a picture ``height`` pixels high, sees less than so many pixels.
        box: only what is inside, ``((z0, y0, x0), (z1, y1, x1))`` in the coordinates of the result.
        bound: the field by which elements without surface are left out; the tightest that the store has.
        view, cull_by: leave out what faces away from a viewer who looks in this direction, by this field.
        normals: at the vertices, from the data's gradient.
        vertex_values: another store of the same shape whose values the vertices get; without one they have ``iso``.
        vertex_error: a field at the vertices, by its name.
        vertices: "exact" is where the finest data have the value, whatever the error; the bound is then twice it.
        cells: "hex" gives a third of the triangles. None: "hex" at full resolution, simplified or not, unless another
            argument needs "tet"; within an error "hex" where that reads no more (``report.full_error_bound``), and
            "tet" with ``effort="none"``.
        components: of the connected pieces the "largest", so many of the largest, or "all", which counts them.
        min_component: drop pieces of fewer triangles; min_volume: drop closed pieces around less than this volume.
        close: a solid, of what is "below" the value outside of the volume (or True), or "above".
        volume_interval: the report says between which volumes that of the solid at full resolution lies.
        coordinates: "array" is (z, y, x) times the spacing, "world" is (x, y, z) with the origin.
        gradient_direction: of the faces' corners, "descent" or "ascent", as scikit-image means it.
        quality: the report says which angles the triangles have.
        memory: bytes, beside the mesh. threads: 0 is all cores. scratch: a folder for temporary files.

        A value that does not occur gives an empty mesh. Raises subclasses of :class:`isonest.Error`.
        """
        flip = _queries.is_flipped(gradient_direction)
        place = self._place(coordinates)
        query = _core.SurfaceQuery()
        within = in_own_unit(distance, self._core)
        SurfaceStop(within, triangles, by, keep_analysis, effort).apply(
            query, Stop(error, error_relative, indicator, stop, threshold, threshold_relative))
        Viewpoint(focus, falloff, camera, pixels, fov, height).apply(query, place)
        place.set_box(query, box)
        if bound is not None:
            query.set_bound(bound)
        if view is not None:
            query.set_view(place.direction("view", view), cull_by)
        elif cull_by is not None:
            raise ValueError("cull_by= needs view=")
        _queries.set_attributes(query, normals=normals, vertex_values=vertex_values, vertex_error=vertex_error,
                                cells=cells)
        query.set_vertices(vertices)
        _queries.set_components(query, components, min_component, min_volume)
        _queries.set_close(query, close)
        query.set_volume_interval(volume_interval)
        options = _queries.options(memory, threads, scratch, quality)
        if np.ndim(iso) == 0:
            level = float(iso)  # type: ignore[arg-type]
            query.set_iso(level)
            return self._extract(query, options, progress, place, level=level, flip=flip)
        levels = [float(level) for level in iso]  # type: ignore[union-attr]
        return self._extract_levels(levels, query, options, progress, place, flip=flip)

    def label_surface(self, label: "int | str", *, distance: Distance = None, triangles: Optional[int] = None,
                      effort: Optional[Effort] = None, box: Optional[Box] = None, normals: bool = False,
                      vertex_values: "Optional[Extracting]" = None, cells: Optional[Cells] = None,
                      components: Components = None, min_component: int = 0, min_volume: float = 0.0,
                      close: Close = None, smooth: Smooth = None, keep_nodes: bool = False,
                      coordinates: Coordinates = "array",
                      quality: bool = False, memory: Bytes = "1G", threads: int = 0, scratch: _Path = "",
                      progress: Progress = None) -> Mesh:
        """The surface around the nodes with this label, half way to the others, whatever their labels are. A label is
        given by its number, or by its name where the store has it.

        The arguments are those of :meth:`isosurface`; inside the surface is "above", so ``close=True`` closes it
        where the label reaches the border of the volume.

        smooth: True, or how often vertices are moved, 0 to 64: a surface net in place of the staircase, which labels
            that touch share, and which keeps every node of the volume on its side. With a distance or a number of
            triangles (of all labels that are asked for together, each shared one once) it is simplified by one effort
            alone, and nodes further than that distance stay on their sides.
        keep_nodes: all nodes do, also within the distance.
        """
        place = self._place(coordinates)
        query = self._label_query(place, distance, triangles, effort, box, normals, vertex_values, cells, components,
                                  min_component, min_volume, close, smooth, keep_nodes)
        number = self._label_id(label)
        query.set_label(number)
        options = _queries.options(memory, threads, scratch, quality)
        return self._extract(query, options, progress, place, level=float(number))

    def label_surfaces(self, labels: "Optional[Sequence[int | str]]" = None, *, distance: Distance = None,
                       triangles: Optional[int] = None, effort: Optional[Effort] = None, box: Optional[Box] = None,
                       normals: bool = False, vertex_values: "Optional[Extracting]" = None, cells: Optional[Cells] = None,
                       components: Components = None, min_component: int = 0, min_volume: float = 0.0,
                       close: Close = None, smooth: Smooth = None, keep_nodes: bool = False,
                       coordinates: Coordinates = "array",
                       quality: bool = False, memory: Bytes = "1G", threads: int = 0, scratch: _Path = "",
                       progress: Progress = None) -> "dict[int, Mesh]":
        """The surfaces of these labels, several at a time; without labels those of all but 0.

        The arguments are those of :meth:`label_surface`. Smooth ones come out of one traversal for all labels.
        """
        place = self._place(coordinates)
        query = self._label_query(place, distance, triangles, effort, box, normals, vertex_values, cells, components,
                                  min_component, min_volume, close, smooth, keep_nodes)
        options = _queries.options(memory, threads, scratch, quality)
        ids = None if labels is None else [self._label_id(label) for label in labels]
        with reporting(progress) as report:
            meshes = _core.extract_labels(self._core, ids, query, options, report)
        return {label: Mesh(parts, coordinates=coordinates, frame=self._frame, flip=False, level=float(label))
                for label, parts in meshes}

    def interfaces(self, labels: "Optional[Sequence[int | str]]" = None, *, distance: Distance = None,
                   triangles: Optional[int] = None, smooth: Smooth = True, keep_nodes: bool = False, close: Close = None,
                   coordinates: Coordinates = "array", quality: bool = False, memory: Bytes = "1G", threads: int = 0,
                   scratch: _Path = "", progress: Progress = None) -> Mesh:
        """All that lies between labels as one mesh, each vertex and face once: what the meshes of
        :meth:`label_surfaces` with ``smooth`` and ``close`` share, and are cut from.

        labels: interfaces with at least one of them beside; None: with any label but 0.
        distance, triangles: the mesh is simplified; lines where three labels meet, too.
        smooth: True, or how often vertices are moved, 0 to 64; 0 leaves the faces of the voxels.
        keep_nodes: as for :meth:`label_surface`.
        close: True adds what lies between labels and the outside of the volume.

        The labels on both sides of each face are the mesh's ``labels``. The other arguments are those of
        :meth:`isosurface`.
        """
        place = self._place(coordinates)
        query = self._label_query(place, distance, triangles, None, None, False, None, None, None, 0, 0.0, close, smooth,
                                  keep_nodes)
        options = _queries.options(memory, threads, scratch, quality)
        ids = None if labels is None else [self._label_id(label) for label in labels]
        with reporting(progress) as report:
            parts, sides, areas = _core.extract_interfaces(self._core, ids, query, options, report)
        return Mesh(parts, coordinates=coordinates, frame=self._frame, flip=False, level=None, labels=sides,
                    areas=areas)

    def slice(self, normal: Point, offset: float, *, error: float = 0.0, error_relative: Optional[float] = None,
              indicator: ErrorIndicator = "deviation", stop: Optional[str] = None, threshold: Optional[float] = None,
              threshold_relative: Optional[float] = None, focus: Union[None, Point, Box] = None, falloff: float = 0.0,
              camera: Optional[Point] = None, pixels: float = 1.0, fov: float = 40.0, height: int = 1080,
              box: Optional[Box] = None, normals: bool = False, vertex_values: "Optional[Extracting]" = None,
              vertex_error: Optional[str] = None, cells: Cells = "tet", coordinates: Coordinates = "array",
              quality: bool = False, memory: Bytes = "1G", threads: int = 0, scratch: _Path = "",
              progress: Progress = None) -> Mesh:
        """The plane of the points p with ``normal . p = offset`` as triangles that are as large as the error allows.

        The vertices have values; between them they are linear, and at most ``error`` off the data anywhere. Normal
        and offset are in the coordinates of the result: ``slice((1, 0, 0), 35)`` is the plane number 35 of the
        array, times the spacing. The other arguments are those of :meth:`isosurface`.
        """
        place = self._place(coordinates)
        query = _core.SliceQuery()
        query.set_plane(*place.plane(normal, offset))
        Stop(error, error_relative, indicator, stop, threshold, threshold_relative).apply(query)
        Viewpoint(focus, falloff, camera, pixels, fov, height).apply(query, place)
        place.set_box(query, box)
        _queries.set_attributes(query, normals=normals, vertex_values=vertex_values, vertex_error=vertex_error,
                                cells=cells)
        return self._extract(query, _queries.options(memory, threads, scratch, quality), progress, place)

    def contours(self, normal: Point, offset: float, contours: Sequence[float], *, error: float = 0.0,
                 error_relative: Optional[float] = None, indicator: ErrorIndicator = "deviation",
                 stop: Optional[str] = None, threshold: Optional[float] = None,
                 threshold_relative: Optional[float] = None, focus: Union[None, Point, Box] = None,
                 falloff: float = 0.0, camera: Optional[Point] = None, pixels: float = 1.0, fov: float = 40.0,
                 height: int = 1080, box: Optional[Box] = None, coordinates: Coordinates = "array",
                 memory: Bytes = "1G", threads: int = 0, scratch: _Path = "", progress: Progress = None) -> Mesh:
        """The lines in a plane on which the data have one of the values ``contours``; they are the vertices' values.

        The other arguments are those of :meth:`slice`.
        """
        place = self._place(coordinates)
        query = _core.ContourQuery()
        query.set_plane(*place.plane(normal, offset))
        query.set_values([float(value) for value in contours])
        Stop(error, error_relative, indicator, stop, threshold, threshold_relative).apply(query)
        Viewpoint(focus, falloff, camera, pixels, fov, height).apply(query, place)
        place.set_box(query, box)
        return self._extract(query, _queries.options(memory, threads, scratch), progress, place)

    def graph(self, *, scale: float = 1.0, error: float = 0.0, error_relative: Optional[float] = None,
              indicator: ErrorIndicator = "deviation", stop: Optional[str] = None, threshold: Optional[float] = None,
              threshold_relative: Optional[float] = None, focus: Union[None, Point, Box] = None, falloff: float = 0.0,
              camera: Optional[Point] = None, pixels: float = 1.0, fov: float = 40.0, height: int = 1080,
              box: Optional[Box] = None, normals: bool = False, vertex_values: "Optional[Extracting]" = None,
              vertex_error: Optional[str] = None, cells: PlaneCells = "tet", coordinates: Coordinates = "array",
              quality: bool = False, memory: Bytes = "1G", threads: int = 0, scratch: _Path = "",
              progress: Progress = None) -> Mesh:
        """Of data in a plane, a map: the surface whose height, z in world coordinates, is ``scale`` times the value.

        The other arguments are those of :meth:`isosurface`; cells are "tet" or "quad".
        """
        place = self._place(coordinates)
        query = _core.GraphQuery()
        query.set_scale(float(scale))
        Stop(error, error_relative, indicator, stop, threshold, threshold_relative).apply(query)
        Viewpoint(focus, falloff, camera, pixels, fov, height).apply(query, place)
        place.set_box(query, box)
        _queries.set_attributes(query, normals=normals, vertex_values=vertex_values, vertex_error=vertex_error,
                                cells=cells)
        return self._extract(query, _queries.options(memory, threads, scratch, quality), progress, place)

    def _place(self, coordinates: str) -> Place:
        place = Place(self._frame, coordinates)
        place.require()
        return place

    def _label_id(self, label: "int | str") -> int:
        return self._core.label_named(label) if isinstance(label, str) else int(label)

    def _label_query(self, place: Place, distance: Distance, triangles: Optional[int], effort: Optional[str],
                     box: Optional[Box], normals: bool, vertex_values: Any, cells: Optional[str], components: Components,
                     min_component: int, min_volume: float, close: Close, smooth: Smooth, keep_nodes: bool) -> Any:
        query = _core.SurfaceQuery()
        SurfaceStop(in_own_unit(distance, self._core), triangles, effort=effort).apply(
            query, Stop(0.0, None, "deviation"))
        place.set_box(query, box)
        _queries.set_attributes(query, normals=normals, vertex_values=vertex_values, vertex_error=None, cells=cells)
        _queries.set_components(query, components, min_component, min_volume)
        _queries.set_close(query, close)
        _queries.set_smooth(query, smooth, keep_nodes)
        return query

    def _extract(self, query: Any, options: Any, progress: Progress, place: Place, *, level: Optional[float] = None,
                 flip: bool = False) -> Mesh:
        with reporting(progress) as report:
            parts = _core.extract(self._core, query, options, report)
        return Mesh(parts, coordinates=place.coordinates, frame=place.frame, flip=flip, level=level)

    def _extract_levels(self, levels: "list[float]", query: Any, options: Any, progress: Progress, place: Place, *,
                        flip: bool) -> "list[Mesh]":
        with reporting(progress) as report:
            meshes = _core.extract_isovalues(self._core, levels, query, options, report)
        return [Mesh(parts, coordinates=place.coordinates, frame=place.frame, flip=flip, level=level)
                for level, parts in zip(levels, meshes)]
