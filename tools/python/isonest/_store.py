"""Stores: what preprocess makes, and what is extracted from them."""
from __future__ import annotations

import os
import pathlib
from typing import Any, Literal, NamedTuple, Optional, Sequence, Union

import numpy as np

from . import _core, _view
from ._arguments import Box, Bytes, Point, Progress, backwards, reporting, to_bytes, to_distance, to_point
from ._frame import Directions, Frame
from ._mesh import Mesh

Coordinates = Literal["array", "world"]


class Histogram(NamedTuple):
    """How often values occur, and how much surface each isovalue has."""

    edges: np.ndarray
    """(n + 1,): where the bins begin, and where the last one ends."""
    counts: np.ndarray
    """(n,): nodes in each bin."""
    cubes: Optional[np.ndarray]
    """(n,): cubes that the isosurface at the bin's beginning passes through; None if the store does not say."""
    suggested: "list[tuple[float, int]]"
    """Isovalues that are worth a look, the one that stands out most first, and the cubes of their surfaces."""
    missing: int
    """Nodes without a value."""
    level: int
    """Of the nodes that were counted: every 2**level-th along each axis."""


class Label(NamedTuple):
    """A label of a segmentation, and where its nodes are."""

    id: int
    nodes: int
    """How many have it."""
    low: "tuple[int, int, int]"
    """Smallest indices (z, y, x)."""
    high: "tuple[int, int, int]"
    """Largest indices (z, y, x)."""


class Store:
    """A store, open for reading; see :func:`isonest.open`. Any number of threads may use it at once."""

    def __init__(self, path: "os.PathLike[str] | str") -> None:
        self._core = _core.Store(os.fspath(path))

    def close(self) -> None:
        """Closes the file. Meshes and arrays that came from it stay."""
        self._core.close()

    def __enter__(self) -> "Store":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def __reduce__(self) -> Any:
        return Store, (str(self.path),)

    def __repr__(self) -> str:
        if self._core.closed:
            return "<isonest.Store, closed>"
        return f"<isonest.Store {str(self.path)!r}: {self.shape} {self.dtype}, {self.levels} levels>"

    @property
    def path(self) -> pathlib.Path:
        """The file."""
        return pathlib.Path(self._core.path)

    @property
    def shape(self) -> tuple[int, int, int]:
        """Nodes per axis, (z, y, x), as of the array. Data in a plane have one node along z."""
        return self._core.shape

    @property
    def dtype(self) -> np.dtype:
        """Of the values."""
        return self._core.dtype

    @property
    def spacing(self) -> tuple[float, float, float]:
        """Distance of neighbouring nodes along the array's axes (z, y, x)."""
        return backwards(self._core.spacing)

    @property
    def origin(self) -> tuple[float, float, float]:
        """World position of the first node, (z, y, x)."""
        return backwards(self._core.origin)

    @property
    def unit(self) -> Optional[str]:
        """Of length, of spacing and origin and all that is made from them: "mm", "um", ...; None if not known."""
        return self._core.unit

    @property
    def direction(self) -> Directions:
        """World directions (x, y, z) of the axes x, y and z: unit vectors at right angles."""
        (xx, xy, xz), (yx, yy, yz), (zx, zy, zz) = self._core.direction
        return (xx, xy, xz), (yx, yy, yz), (zx, zy, zz)

    @property
    def _frame(self) -> Frame:
        x, y, z = self._core.origin
        return Frame((x, y, z), self.direction)

    @property
    def range(self) -> Optional[tuple[float, float]]:
        """The smallest and the largest finite value; None if there is none."""
        low, high = self._core.min, self._core.max
        return (low, high) if low <= high else None

    @property
    def has_missing(self) -> bool:
        """Whether values are missing: not finite."""
        return self._core.has_missing

    @property
    def levels(self) -> int:
        """How many there are. Level 0 is the data; level L has every 2**L-th node."""
        return self._core.levels

    def level_shape(self, level: int) -> tuple[int, int, int]:
        """Of ``values(level)``."""
        return self._core.level_shape(level)

    @property
    def indicators(self) -> list[str]:
        """The error indicators that the store holds."""
        return self._core.indicators

    @property
    def file_bytes(self) -> int:
        """The file's size."""
        return self._core.file_bytes

    def values(self, level: int = 0, box: Optional[Sequence[Union[slice, int]]] = None, *, memory: Bytes = "256M",
               threads: int = 0, progress: Progress = None) -> np.ndarray:
        """The values of a level: those of ``array[::2**level, ::2**level, ::2**level]``.

        box: slices of that array, such as ``np.s_[10:20, :, 5:]``; only their chunks are read. Without it all.
        memory: beside the array that is returned.
        """
        shape = self.level_shape(level)
        low, high, drop = [], [], []
        places = tuple(box) if isinstance(box, (tuple, list)) else () if box is None else (box,)
        if len(places) > 3:
            raise ValueError(f"box={box!r}: give three slices")
        for axis, place in enumerate(places + (slice(None),) * (3 - len(places))):
            if isinstance(place, slice):
                start, stop, step = place.indices(shape[axis])
                if step != 1:
                    raise ValueError(f"box={box!r}: slices without a step; levels have every 2**level-th node")
            else:
                start = range(shape[axis])[place]
                stop = start + 1
                drop.append(axis)
            low.append(start)
            high.append(max(start, stop))
        with reporting(progress) as report:
            array = self._core.values(level, backwards(low), backwards(high), to_bytes(memory), threads, report)
        return array.squeeze(axis=tuple(drop)) if drop else array

    def histogram(self, level: Optional[int] = None, *, memory: Bytes = "512M", threads: int = 0,
                  progress: Progress = None) -> Histogram:
        """Counts the values of a level; without one, of the finest with at most 2**28 nodes."""
        with reporting(progress) as report:
            h = self._core.histogram(level, to_bytes(memory), threads, report)
        edges = np.append(h.low, h.end) if len(h.low) else np.empty(0)
        return Histogram(edges, h.nodes, h.cubes if h.cube_level is not None else None, h.suggested, h.missing,
                         h.level)

    def isosurface(self, level: float, *, error: float = 0.0, relative: bool = False, guarantee: str = "deviation",
                   simplify: bool = False, distance: Union[None, float, str] = None, triangles: Optional[int] = None,
                   box: Optional[Box] = None, normals: bool = True, values: "Optional[Store]" = None,
                   vertex_error: Optional[str] = None, exact: bool = False,
                   cells: Literal["tetrahedra", "hexahedra"] = "tetrahedra",
                   close: Optional[Literal["below", "above"]] = None, largest: int = 0, least_triangles: int = 0,
                   least_volume: float = 0.0, coordinates: Coordinates = "array",
                   gradient_direction: Literal["descent", "ascent"] = "descent", quality: bool = False,
                   memory: Bytes = "1G", threads: int = 0, scratch: "os.PathLike[str] | str" = "",
                   progress: Progress = None) -> Mesh:
        """The surface on which the data have the value ``level``; of data in a plane, the lines.

        error: how far the data may be from ``level``, anywhere on the mesh, in units of the data; 0 is full
            resolution. With ``relative=True`` a fraction of the data's range.
        guarantee: "deviation" and "plus" are bounds, "estimate" is none.
        simplify: keep the error by fewer triangles; takes longer.
        distance: in place of an error, how far the mesh may be from the surface at full resolution and the other
            way round, in the units of the spacing; or a text such as "0.5voxel", or "0.5mm" if :attr:`unit` is known.
        triangles: in place of an error, at most so many, at the smallest distance that is found; with a distance,
            whichever is reached first.
        box: only what is inside, ``((z0, y0, x0), (z1, y1, x1))`` in the coordinates of the result.
        normals: at the vertices, from the data's gradient.
        values: another store of the same shape whose values the vertices get; without one they have ``level``.
        vertex_error: an indicator at the vertices, by its name.
        exact: vertices where the finest data have the value, whatever the error.
        cells: hexahedra give a third of the triangles.
        close: a solid, of what is "above" or "below" the level outside of the volume.
        largest, least_triangles, least_volume: which connected components are kept; 0 is all.
        coordinates: "array" is (z, y, x) times the spacing, "world" is (x, y, z) with the origin.
        gradient_direction: of the faces' corners, as scikit-image means it.
        quality: the report says which angles the triangles have.
        memory: bytes, beside the mesh. threads: 0 is all cores. scratch: a folder for temporary files.

        A level that does not occur gives an empty mesh. Raises subclasses of :class:`isonest.Error`.
        """
        query = _core.SurfaceQuery()
        query.level = float(level)
        if distance is not None or triangles is not None:
            if error or simplify:
                raise ValueError("error= and simplify= do not go with distance= or triangles=")
            within, voxels = to_distance(distance, self._core) if distance is not None else (0.0, False)
            if triangles is not None:
                query.set_triangles(int(triangles), within if distance is not None else None, voxels)
            else:
                query.set_distance(within, voxels)
        elif simplify:
            query.set_simplified_error(float(error), relative, guarantee)
        else:
            query.set_error(float(error), relative, guarantee)
        if exact:
            query.set_exact_vertices()
        query.set_close(close)
        if largest or least_triangles or least_volume:
            query.set_components(largest, least_triangles, least_volume)
        if gradient_direction not in ("descent", "ascent"):
            raise ValueError(f"gradient_direction={gradient_direction!r}: give 'descent' or 'ascent'")
        return self._extract(query, box=box, normals=normals, values=values, vertex_error=vertex_error, cells=cells,
                             coordinates=coordinates, flip=gradient_direction == "ascent",
                             level=float(level), quality=quality,
                             memory=memory, threads=threads, scratch=scratch, progress=progress)

    def labels(self, *, memory: Bytes = "1G", threads: int = 0, progress: Progress = None) -> "list[Label]":
        """The labels of a segmentation, by their ids: what values there are, and where.

        Raises isonest.UnsupportedError for values that are no whole numbers up to 2**53, unless the store was made with
        ``labels=True``.
        """
        with reporting(progress) as report:
            rows = self._core.labels(to_bytes(memory), int(threads), report)
        return [Label(row[0], row[1], (row[4], row[3], row[2]), (row[7], row[6], row[5])) for row in rows]

    def label_surface(self, label: int, *, distance: Union[None, float, str] = None, triangles: Optional[int] = None,
                      box: Optional[Box] = None, normals: bool = False,
                      cells: Literal["tetrahedra", "hexahedra"] = "tetrahedra",
                      close: Optional[Literal["below", "above"]] = None, largest: int = 0, least_triangles: int = 0,
                      least_volume: float = 0.0, coordinates: Coordinates = "array", quality: bool = False,
                      memory: Bytes = "1G", threads: int = 0, scratch: "os.PathLike[str] | str" = "",
                      progress: Progress = None) -> Mesh:
        """The surface around the nodes with this label, half way to the others, whatever their labels are.

        The arguments are those of :meth:`isosurface`; inside the surface is "above", so ``close="below"`` closes it
        where the label reaches the border of the volume.
        """
        query = _core.SurfaceQuery()
        query.set_label(int(label))
        query.set_error(0.0, False, "deviation")
        if distance is not None or triangles is not None:
            within, voxels = to_distance(distance, self._core) if distance is not None else (0.0, False)
            if triangles is not None:
                query.set_triangles(int(triangles), within if distance is not None else None, voxels)
            else:
                query.set_distance(within, voxels)
        query.set_close(close)
        if largest or least_triangles or least_volume:
            query.set_components(largest, least_triangles, least_volume)
        return self._extract(query, box=box, normals=normals, values=None, vertex_error=None, cells=cells,
                             coordinates=coordinates, flip=False, level=float(label), quality=quality, memory=memory,
                             threads=threads, scratch=scratch, progress=progress)

    def slice(self, normal: Point, offset: float, *, error: float = 0.0, relative: bool = False,
              guarantee: str = "deviation", box: Optional[Box] = None, normals: bool = False,
              values: "Optional[Store]" = None, vertex_error: Optional[str] = None,
              cells: Literal["tetrahedra", "hexahedra"] = "tetrahedra", coordinates: Coordinates = "array",
              quality: bool = False, memory: Bytes = "1G", threads: int = 0, scratch: "os.PathLike[str] | str" = "",
              progress: Progress = None) -> Mesh:
        """The plane of the points p with ``normal . p = offset`` as triangles that are as large as the error allows.

        The vertices have values; between them they are linear, and at most ``error`` off the data anywhere. Normal
        and offset are in the coordinates of the result: ``slice((1, 0, 0), 35)`` is the plane number 35 of the
        array, times the spacing. The other arguments are those of :meth:`isosurface`.
        """
        query = _core.SliceQuery()
        direction = to_point("normal", normal)
        place = float(offset)
        if coordinates == "array":
            direction, place = self._frame.plane_to_world(direction, place)
        query.set_plane(direction, place)
        query.set_error(float(error), relative, guarantee)
        return self._extract(query, box=box, normals=normals, values=values,
                             vertex_error=vertex_error, cells=cells, coordinates=coordinates, flip=False, level=None,
                             quality=quality, memory=memory, threads=threads, scratch=scratch, progress=progress)

    def view(self, *, port: int = 0, memory: Bytes = "1G", threads: int = 0, open: Optional[bool] = None,
             height: int = 600, program: "os.PathLike[str] | str | None" = None) -> _view.View:
        """Shows the store in a window of the browser: surface, slices, histogram, and the bound of what is seen.

        It runs the program ``isonest view`` until the :class:`isonest.View` that is returned is closed or nothing
        refers to it any more. In a notebook a cell whose last line is the view shows it. Only this machine reaches
        the page, and only with the view's whole URL.

        port: to listen on; 0 is any that is free.
        memory: bytes of heap that the program stays within; at least 512M. threads: 0 is all cores.
        open: a tab of the browser; None is True outside of a notebook, and False inside.
        height: of the frame in a notebook, in pixels.
        program: where ``isonest`` is. Without it the environment variable ISONEST says so, else it is the one that
            was installed with this package, else the one on the PATH.

        Raises FileNotFoundError if there is no program, and what the program says as subclasses of
        :class:`isonest.Error`.
        """
        return _view.start(self.path, port=port, memory=memory, threads=threads, open=open, height=height,
                           program=program)

    def _extract(self, query: Any, *, box: Optional[Box], normals: bool, values: "Optional[Store]",
                 vertex_error: Optional[str], cells: str, coordinates: str, flip: bool, level: Optional[float],
                 quality: bool, memory: Bytes, threads: int, scratch: "os.PathLike[str] | str",
                 progress: Progress) -> Mesh:
        if coordinates not in ("array", "world"):
            raise ValueError(f"coordinates={coordinates!r}: give 'array' or 'world'")
        if box is not None:
            low, high = (to_point("box", corner) for corner in box)
            if coordinates == "array":
                low, high = (self._frame.point_to_world(corner) for corner in (low, high))
            query.set_box(low, high)
        query.normals = bool(normals)
        query.set_cells(cells)
        if values is not None:
            query.set_values(values._core)
        if vertex_error is not None:
            query.set_vertex_error(vertex_error)
        options = _core.ExtractOptions()
        options.memory = to_bytes(memory)
        options.threads = int(threads)
        options.scratch = os.fspath(scratch)
        options.quality = quality
        with reporting(progress) as report:
            parts = _core.extract(self._core, query, options, report)
        return Mesh(parts, coordinates=coordinates, frame=self._frame, flip=flip, level=level)
