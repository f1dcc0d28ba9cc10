"""Extraction of surfaces, slices, contour lines and graphs from a store."""
from __future__ import annotations

import os
from typing import Any, Optional, Sequence, Union

import numpy as np

from . import _core, _queries
from ._arguments import Box, Bytes, Point, Progress, in_own_unit, reporting
from ._frame import Frame
from ._mesh import Mesh
from ._queries import (By, Cells, Close, Components, Coordinates, Distance, Effort, ErrorIndicator, Place, PlaneCells, Smooth,
                       Stop, SurfaceStop, Vertices, Viewpoint)

_Path = Union[str, "os.PathLike[str]"]


class Extracting:
    """The methods that extract meshes; the base class of stores and of volumes without a store."""

    _core: Any

    @property
    def _frame(self) -> Frame:
        raise NotImplementedError

    @_queries.with_ways("isosurface")
    def isosurface(self, iso: "float | Sequence[float] | None" = None, *, level: "float | Sequence[float] | None" = None,
                   error: float = 0.0, error_relative: Optional[float] = None,
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
                   close: Close = None, manifold: bool = False, volume_interval: bool = False,
                   coordinates: Coordinates = "array",
                   gradient_direction: str = "descent", quality: bool = False, memory: Bytes = "1G", threads: int = 0,
                   scratch: _Path = "", progress: Progress = None) -> "Mesh | list[Mesh]":
        """Extracts the surface on which the data have the value ``iso``; for data in a plane, isolines.

        iso: a number; or several numbers, for which the store is read once and a list of meshes is returned, the same
            meshes as for each isovalue alone. level: another name of iso.
        error: largest difference between the data and ``iso`` anywhere on the mesh, in units of the data; 0 is full
            resolution. error_relative: the same as a fraction of the data's range.
        indicator: "deviation" and "plus" are bounds, "estimate" is not.
        stop, threshold, threshold_relative: in place of an error, refine while this field of the store is not below
            the threshold, in the field's units or as a fraction of its largest value.
        distance: in place of an error, the largest distance between the mesh and the surface at full resolution, in
            both directions, in units of the spacing; or a string such as "0.5voxel", or "0.5mm" if :attr:`unit` is
            known.
        triangles: in place of an error, the largest number of triangles; the mesh has the smallest distance that was
            found for it. With a distance, whichever is reached first. by: "error" minimises the error instead.
        effort: how a mesh within an error or a distance is simplified. "best" gives the fewest triangles, "fast" more
            in less time, "none" those of the nested grid. None: "best", but "none" with ``stop``, ``focus``,
            ``camera`` or "estimate", and for isolines within an error.
        keep_analysis: keep an analysis of the surface next to the store (True) or in a folder. The first extraction
            then takes several times as long, but later ones with other distances or numbers of triangles are fast.
        focus, falloff: the error holds at this point or in this box; at the distance d from it, 1 + falloff d times
            the error is allowed.
        camera, pixels, fov, height: also stop where a viewer at this position, with a vertical angle of view of
            ``fov`` degrees and a picture ``height`` pixels high, sees less than ``pixels``.
        box: extract only inside this box, ``((z0, y0, x0), (z1, y1, x1))``, in the coordinates of the result.
        bound: the field used to skip elements without surface; None: the tightest in the store.
        view, cull_by: leave out parts that face away from a viewer who looks in the direction ``view``, using the
            field ``cull_by``.
        normals: add vertex normals, from the data's gradient.
        vertex_values: another store of the same shape, whose values are given to the vertices; otherwise they have
            ``iso``.
        vertex_error: name of a field whose values are given to the vertices.
        vertices: "exact" puts them where the finest data have the value; the bound is then twice the error.
        cells: "hex" gives a third of the triangles. None: "hex" at full resolution, simplified or not, unless another
            argument needs "tet"; within an error, "hex" if that reads no more (``report.full_error_bound``), and
            "tet" with ``effort="none"``.
        components: keep the "largest" connected piece or this number of the largest; "all" only counts them.
        min_component: drop pieces with fewer triangles. min_volume: drop closed pieces that enclose a smaller volume.
        close: close the surface to a solid; the space outside the volume counts as "below" the isovalue (or True) or
            "above" it.
        manifold: give each sheet its own vertices where the surface touches itself, so that edges have two triangles.
        volume_interval: report an interval that contains the solid's volume at full resolution.
        coordinates: "array" is (z, y, x) times the spacing, "world" is (x, y, z) including the origin.
        gradient_direction: orientation of the faces, "descent" or "ascent", as in scikit-image.
        quality: report the angles of the triangles.
        memory: bytes, in addition to the mesh. threads: 0 is all cores. scratch: a folder for temporary files.
        progress: a function ``(phase, done, total, unit)``, or True for bars of tqdm.

        The mesh is empty if the value does not occur. Raises subclasses of :class:`isonest.Error`.
        """
        iso = _queries.isovalue(iso, level)
        if iso is None:
            raise TypeError("isosurface() needs iso=, the value at which the surface lies; Store.histogram() suggests some")
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
        query.set_manifold(manifold)
        query.set_volume_interval(volume_interval)
        options = _queries.options(memory, threads, scratch, quality)
        if np.ndim(iso) == 0:
            query.set_iso(float(iso))  # type: ignore[arg-type]
            return self._extract(query, options, progress, place, level=float(iso), flip=flip)  # type: ignore[arg-type]
        levels = [float(one) for one in iso]  # type: ignore[union-attr]
        return self._extract_levels(levels, query, options, progress, place, flip=flip)

    def label_surface(self, label: "int | str", *, distance: Distance = None, triangles: Optional[int] = None,
                      effort: Optional[Effort] = None, box: Optional[Box] = None, normals: bool = False,
                      vertex_values: "Optional[Extracting]" = None, cells: Optional[Cells] = None,
                      components: Components = None, min_component: int = 0, min_volume: float = 0.0,
                      close: Close = None, smooth: Smooth = None, keep_nodes: bool = False, manifold: bool = False,
                      coordinates: Coordinates = "array",
                      quality: bool = False, memory: Bytes = "1G", threads: int = 0, scratch: _Path = "",
                      progress: Progress = None) -> Mesh:
        """Extracts the surface around the nodes with this label, half-way to nodes with other labels.

        label: its number, or its name if the store has names. The other arguments are those of :meth:`isosurface`.
            The inside of the surface is "above", so ``close=True`` closes it where the label reaches the border of
            the volume.
        smooth: make a surface net in place of the staircase. True, or the number of smoothing passes, 0 to 64. Touching
            labels share its faces, and every node of the volume stays on its side. With a distance or a number of
            triangles (the total of all labels, shared ones counted once) it is simplified, whatever ``effort`` is;
            then only nodes further away than the distance are sure to stay on their sides.
        keep_nodes: keep all nodes on their sides, even within the distance.
        manifold: where the label touches itself, edges have four triangles (``report.nonmanifold_edges``); True
            separates them.
        """
        place = self._place(coordinates)
        query = self._label_query(place, distance, triangles, effort, box, normals, vertex_values, cells, components,
                                  min_component, min_volume, close, smooth, keep_nodes)
        query.set_manifold(manifold)
        number = self._label_id(label)
        query.set_label(number)
        options = _queries.options(memory, threads, scratch, quality)
        return self._extract(query, options, progress, place, level=float(number))

    def label_surfaces(self, labels: "Optional[Sequence[int | str]]" = None, *, distance: Distance = None,
                       triangles: Optional[int] = None, effort: Optional[Effort] = None, box: Optional[Box] = None,
                       normals: bool = False, vertex_values: "Optional[Extracting]" = None, cells: Optional[Cells] = None,
                       components: Components = None, min_component: int = 0, min_volume: float = 0.0,
                       close: Close = None, smooth: Smooth = None, keep_nodes: bool = False, manifold: bool = False,
                       coordinates: Coordinates = "array",
                       quality: bool = False, memory: Bytes = "1G", threads: int = 0, scratch: _Path = "",
                       progress: Progress = None) -> "dict[int, Mesh]":
        """Extracts the surfaces of several labels; None: of all labels but 0. Returns a mesh per label.

        The arguments are those of :meth:`label_surface`. Smooth surfaces are made in one traversal for all labels.
        """
        place = self._place(coordinates)
        query = self._label_query(place, distance, triangles, effort, box, normals, vertex_values, cells, components,
                                  min_component, min_volume, close, smooth, keep_nodes)
        query.set_manifold(manifold)
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
        """Extracts the interfaces between labels as one mesh that contains each vertex and face once.

        The meshes of :meth:`label_surfaces` with ``smooth`` and ``close`` consist of faces of this mesh.

        labels: extract interfaces with at least one of these labels on a side; None: with any label but 0.
        distance, triangles: simplify the mesh, including lines where three labels meet.
        smooth: True, or the number of smoothing passes, 0 to 64; 0 keeps the faces of the voxels.
        keep_nodes: as for :meth:`label_surface`.
        close: True adds interfaces between labels and the outside of the volume.

        The other arguments are those of :meth:`isosurface`. The mesh's ``labels`` are the labels on both sides of each
        face.
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

    @_queries.with_old_names
    def slice(self, normal: Point, offset: float, *, error: float = 0.0, error_relative: Optional[float] = None,
              indicator: ErrorIndicator = "deviation", stop: Optional[str] = None, threshold: Optional[float] = None,
              threshold_relative: Optional[float] = None, focus: Union[None, Point, Box] = None, falloff: float = 0.0,
              camera: Optional[Point] = None, pixels: float = 1.0, fov: float = 40.0, height: int = 1080,
              box: Optional[Box] = None, normals: bool = False, vertex_values: "Optional[Extracting]" = None,
              vertex_error: Optional[str] = None, cells: Cells = "tet", coordinates: Coordinates = "array",
              quality: bool = False, memory: Bytes = "1G", threads: int = 0, scratch: _Path = "",
              progress: Progress = None) -> Mesh:
        """Extracts the plane ``normal . p = offset`` as triangles that are as large as the error allows.

        The vertices have values. Linear interpolation between them differs from the data by at most ``error``. Normal
        and offset are in the coordinates of the result: with a spacing of 1, ``slice((1, 0, 0), 35)`` is plane 35 of
        the array. The other arguments are those of :meth:`isosurface`.
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

    @_queries.with_old_names
    def contours(self, normal: Point, offset: float, contours: Sequence[float], *, error: float = 0.0,
                 error_relative: Optional[float] = None, indicator: ErrorIndicator = "deviation",
                 stop: Optional[str] = None, threshold: Optional[float] = None,
                 threshold_relative: Optional[float] = None, focus: Union[None, Point, Box] = None,
                 falloff: float = 0.0, camera: Optional[Point] = None, pixels: float = 1.0, fov: float = 40.0,
                 height: int = 1080, box: Optional[Box] = None, coordinates: Coordinates = "array",
                 memory: Bytes = "1G", threads: int = 0, scratch: _Path = "", progress: Progress = None) -> Mesh:
        """Extracts the lines in a plane on which the data have one of the values ``contours``.

        These are the ``values`` of the mesh. The other arguments are those of :meth:`slice`.
        """
        place = self._place(coordinates)
        query = _core.ContourQuery()
        query.set_plane(*place.plane(normal, offset))
        query.set_values([float(value) for value in contours])
        Stop(error, error_relative, indicator, stop, threshold, threshold_relative).apply(query)
        Viewpoint(focus, falloff, camera, pixels, fov, height).apply(query, place)
        place.set_box(query, box)
        return self._extract(query, _queries.options(memory, threads, scratch), progress, place)

    @_queries.with_old_names
    def graph(self, *, scale: float = 1.0, error: float = 0.0, error_relative: Optional[float] = None,
              indicator: ErrorIndicator = "deviation", stop: Optional[str] = None, threshold: Optional[float] = None,
              threshold_relative: Optional[float] = None, focus: Union[None, Point, Box] = None, falloff: float = 0.0,
              camera: Optional[Point] = None, pixels: float = 1.0, fov: float = 40.0, height: int = 1080,
              box: Optional[Box] = None, normals: bool = False, vertex_values: "Optional[Extracting]" = None,
              vertex_error: Optional[str] = None, cells: PlaneCells = "tet", coordinates: Coordinates = "array",
              quality: bool = False, memory: Bytes = "1G", threads: int = 0, scratch: _Path = "",
              progress: Progress = None) -> Mesh:
        """Extracts the graph of data in a plane: a surface with the height (z in the world) ``scale`` times the value.

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
