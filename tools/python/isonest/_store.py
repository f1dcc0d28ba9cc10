"""Stores: their metadata, values and histograms, and checks."""
from __future__ import annotations

import inspect
import math
import os
import pathlib
import warnings
from typing import Any, NamedTuple, Optional, Sequence, Union

import numpy as np

from . import _core, _errors, _sources, _view
from ._arguments import Bytes, Headers, Point, Progress, backwards, reporting, to_bytes, to_cache, to_header_lines
from ._core import Analysis, CheckReport, StoredArray, StudyRow
from ._extracting import Extracting
from ._frame import Directions, Frame
from ._queries import Cells, Coordinates, Place


class Histogram(NamedTuple):
    """Counts nodes per value, and cubes per isovalue."""

    edges: np.ndarray
    """(n + 1,): the lower ends of the bins, and the upper end of the last one."""
    counts: np.ndarray
    """(n,): nodes in each bin."""
    cubes: Optional[np.ndarray]
    """(n,): cubes intersected by the isosurface at the bin's lower end; None if the store has no ranges of cubes."""
    suggested: "list[tuple[float, int]]"
    """Suggested isovalues, most prominent first, each with the number of cubes of its surface."""
    missing: int
    """Nodes without a value."""
    level: int
    """The level whose nodes were counted: every 2**level-th along each axis."""


class Label(NamedTuple):
    """A label of a segmentation, and the extent of its nodes."""

    id: int
    nodes: int
    """Number of nodes with this label."""
    low: "tuple[int, int, int]"
    """Smallest indices (z, y, x)."""
    high: "tuple[int, int, int]"
    """Largest indices (z, y, x)."""
    name: Optional[str] = None
    """The label's name, if the store has one."""
    color: "Optional[tuple[int, int, int]]" = None
    """Red, green, blue from 0 to 255, if the store has a colour."""


class Study(NamedTuple):
    """Numbers of elements and errors, per indicator and threshold."""

    all_elements: int
    """Number of elements of the finest mesh of triangles or tetrahedra."""
    all_cells: int
    """Number of cells of the finest grid of quadrilaterals or hexahedra."""
    rows: "list[StudyRow]"
    """Grouped by field, with decreasing thresholds."""


def _open_again(location: str, access: "dict[str, Any]") -> "Store":
    return Store(location, **access)


def _saying_its_format(error: _errors.Error, location: str) -> _errors.Error:
    """The error, which for a file that is a volume says so. An HDF5 file may also be a damaged store."""
    if not any("isonest.preprocess" in remedy for remedy in error.remedies) or _sources.is_elsewhere(location):
        return error
    name = _core.input_format_of(location)
    if not name or name == "HDF5":
        return error
    return _errors.made(_errors.InvalidArgumentError, location, f"a volume ({name}), not a store",
                        ["make a store of it with isonest.preprocess(volume, store)",
                         "extract its surface with isonest.isosurface(volume, iso)"])


class Store(Extracting):
    """A store, open for reading; see :func:`isonest.open`. Thread-safe."""

    def __init__(self, path: "os.PathLike[str] | str", *, headers: Headers = None,
                 cache: "os.PathLike[str] | str | None" = None, memory: Bytes = "64M") -> None:
        lines = to_header_lines(headers)
        location = os.fspath(path)
        try:
            self._core = _core.Store(location, lines, *to_cache(cache), to_bytes(memory))
        except (_errors.InvalidArgumentError, _errors.CorruptError) as error:
            raise _saying_its_format(error, location) from None
        if self._core.cache_warning:
            warnings.warn(self._core.cache_warning, RuntimeWarning, stacklevel=3)
        self._location = os.fspath(path)
        self._access: "dict[str, Any]" = {"headers": lines, "cache": cache, "memory": memory}

    def close(self) -> None:
        """Closes the file. Meshes and arrays extracted from it remain valid."""
        self._core.close()

    def __enter__(self) -> "Store":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def __reduce__(self) -> Any:
        # For a remote store this includes the headers, which may contain credentials.
        return (_open_again, (self._location, self._access)) if self._core.is_remote else (Store, (str(self.path),))

    def __repr__(self) -> str:
        if self._core.closed:
            return "<isonest.Store, closed>"
        return f"<isonest.Store {str(self.path)!r}: {self.shape} {self.dtype}, {self.levels} levels>"

    @property
    def path(self) -> "Union[pathlib.Path, str]":
        """The file; for a remote store the URL without credentials and query."""
        return self._core.name if self._core.is_remote else pathlib.Path(self._core.name)

    @property
    def fetched(self) -> "dict[str, int]":
        """Counts what all queries together have fetched so far: ``remote_bytes``, ``requests``, ``round_trips``
        (sequential waits for the network), and ``cache_bytes`` (read from the cache on disk instead). All 0 for a
        file."""
        return self._core.fetched

    @property
    def shape(self) -> tuple[int, int, int]:
        """Nodes per axis, (z, y, x). Data in a plane have one node along z."""
        return self._core.shape

    @property
    def ndim(self) -> int:
        """3: all stores have three axes."""
        return 3

    @property
    def size(self) -> int:
        """Number of nodes."""
        return math.prod(self.shape)

    def __len__(self) -> int:
        return self.shape[0]

    def __getitem__(self, box: Any) -> np.ndarray:
        """The values at full resolution, as from an array: ``store[10:20, :, 40]`` is ``store.values(0, np.s_[10:20, :, 40])``."""
        if isinstance(box, tuple) and any(place is Ellipsis for place in box):
            at = next(i for i, place in enumerate(box) if place is Ellipsis)
            box = box[:at] + (slice(None),) * (4 - len(box)) + box[at + 1:]
        return self.values(0, None if box is Ellipsis else box)

    def __array__(self, dtype: Any = None, copy: Optional[bool] = None) -> np.ndarray:
        """All values at full resolution, for ``np.asarray(store)``; read them in parts with ``store[...]``."""
        if copy is False:
            raise ValueError("the values of a store are always copied: np.asarray(store)")
        values = self.values()
        return values if dtype is None else values.astype(dtype, copy=False)

    @property
    def dtype(self) -> np.dtype:
        """Type of the values."""
        return self._core.dtype

    @property
    def spacing(self) -> tuple[float, float, float]:
        """Distance between neighbouring nodes in world units, (z, y, x); the mean where :attr:`coordinates` are uneven."""
        return backwards(self._core.spacing)

    def require_even_axes(self, what: str) -> None:
        """Raises ValueError, naming ``what`` needs it, if nodes lie at uneven distances: :attr:`spacing` is then a mean."""
        if self.curvilinear:
            raise ValueError(f"{what} needs straight axes, but the grid of {self.path} is curvilinear; resample the volume, or "
                             "preprocess it with spacing=")
        if any(self._core.uneven):
            raise ValueError(f"{what} needs evenly spaced axes, but the nodes of {self.path} lie at uneven distances; resample "
                             "the volume, or preprocess it with spacing=")

    @property
    def curvilinear(self) -> bool:
        """Whether each node has a position of its own: :meth:`positions`. Then :attr:`spacing` is 1 and :attr:`origin` 0."""
        return self._core.curved is not None

    @property
    def folded_cells(self) -> int:
        """The number of cells of a curvilinear grid that are turned over, or have an edge or a face without extent."""
        return self._core.curved["folded"] if self.curvilinear else 0

    def positions(self, box: Optional[tuple[slice, ...]] = None) -> np.ndarray:
        """The world positions of the nodes, [z, y, x, 3], with x, y and z in the last axis; of the nodes in ``box``, three
        slices (z, y, x) with steps of 1, or of all."""
        ranges = [s.indices(n) for s, n in zip(box or (slice(None),) * 3, self.shape)]
        if len(ranges) != 3 or any(step != 1 for _, _, step in ranges):
            raise ValueError("positions takes three slices with steps of 1")
        first = [start for start, _, _ in ranges]
        size = [max(stop - start, 0) for start, stop, _ in ranges]
        return self._core.positions(first=first[::-1], size=size[::-1])

    @property
    def coordinates(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """The coordinates of the nodes along each axis, (z, y, x), in world units. Along an axis whose nodes lie at uneven
        distances, :attr:`spacing` is their mean. Of a rotated or sheared volume: the distances along the axes from the
        first node. A curvilinear grid has none (ValueError)."""
        if self.curvilinear:
            raise ValueError(f"the grid of {self.path} is curvilinear: use positions()")
        straight = self._core.direction == [[1, 0, 0], [0, 1, 0], [0, 0, 1]]
        along = []
        for count, step, first, offsets in zip(self.shape, self.spacing, self.origin, backwards(self._core.uneven)):
            from_first = np.array(offsets) if offsets else step * np.arange(count)
            along.append(from_first + first if straight else from_first)
        return tuple(along)  # type: ignore[return-value]

    @property
    def origin(self) -> tuple[float, float, float]:
        """World position of the first node, (z, y, x)."""
        return backwards(self._core.origin)

    @property
    def unit(self) -> Optional[str]:
        """The world unit, in which all lengths are given: "mm", "um", ...; None if unknown."""
        return self._core.unit

    @property
    def frame(self) -> Optional[str]:
        """The patient axes of the world, "RAS" or "LPS"; None if unknown."""
        return self._core.frame

    @property
    def tolerance(self) -> float:
        """The largest amount by which values were rounded when the store was made; 0: none were. The store's values are
        the rounded ones. Error bounds of meshes are for the given values, and include this."""
        return self._core.tolerance

    @property
    def direction(self) -> Directions:
        """Unit vectors (x, y, z) of the volume's axes x, y, z in the world; at right angles unless it is sheared."""
        return self._frame.direction

    @property
    def _frame(self) -> Frame:
        return Frame.of(self._core)

    @property
    def range(self) -> Optional[tuple[float, float]]:
        """The smallest and the largest finite value; None if there is none. 64-bit labels are ints."""
        low, high = self._core.min, self._core.max
        return (low, high) if low <= high else None

    @property
    def has_missing(self) -> bool:
        """Whether any value is missing (not finite)."""
        return self._core.has_missing

    @property
    def levels(self) -> int:
        """Number of levels. Level 0 is the data; level L has every 2**L-th node."""
        return self._core.levels

    def level_shape(self, level: int) -> tuple[int, int, int]:
        """Shape of ``values(level)``."""
        return self._core.level_shape(level)

    @property
    def indicators(self) -> list[str]:
        """Names of the error indicators in the store."""
        return self._core.indicators

    @property
    def file_bytes(self) -> int:
        """Size of the file in bytes."""
        return self._core.file_bytes

    @property
    def format(self) -> str:
        """The version of the file's format."""
        return self._core.format

    @property
    def exact(self) -> bool:
        """Whether the indicators are exact rather than rounded up to 16 bits."""
        return self._core.exact

    @property
    def chunk(self) -> int:
        """Nodes per axis of a chunk."""
        return self._core.chunk

    @property
    def compression(self) -> int:
        """The zstd level."""
        return self._core.compression

    @property
    def arrays(self) -> "list[StoredArray]":
        """All arrays of all levels, with their compressed and uncompressed sizes and ranges."""
        return _core.stored_arrays(self._core)

    @property
    def analyses(self) -> "list[Analysis]":
        """The analyses of surfaces kept next to the store (``keep_analysis=True``)."""
        return _core.analyses(self._core)

    def values(self, level: int = 0, box: Union[None, slice, int, Sequence[Union[slice, int]]] = None, *, memory: Bytes = "256M",
               threads: int = 0, progress: Progress = None) -> np.ndarray:
        """Reads the values of a level: ``array[::2**level, ::2**level, ::2**level]``. 64-bit labels are int64.

        box: slices of that array, such as ``np.s_[10:20, :, 5:]``; only their chunks are read. None: all.
        memory: bytes, in addition to the returned array.

        Raises ValueError for a slice with a step, IndexError for an index out of range, and subclasses of
        :class:`isonest.Error`.
        """
        low, high, drop = self._corners(level, box)
        with reporting(progress) as report:
            array = self._core.values(level, backwards(low), backwards(high), to_bytes(memory), threads, report)
        return array.squeeze(axis=drop) if drop else array

    def _corners(self, level: int, box: Union[None, slice, int, Sequence[Union[slice, int]]]
                 ) -> "tuple[list[int], list[int], tuple[int, ...]]":
        """The first indices of a box, those behind its last ones, and the axes with an index in place of a slice."""
        shape = self.level_shape(level)
        low, high, drop = [], [], []
        places = () if box is None else (box,) if isinstance(box, (slice, int, np.integer)) else tuple(box)
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
        return low, high, tuple(drop)

    def indicator(self, field: str, level: int = 0, box: Union[None, slice, int, Sequence[Union[slice, int]]] = None, *,
                  memory: Bytes = "256M", threads: int = 0, progress: Progress = None) -> np.ndarray:
        """Reads a stored indicator at the nodes of a level, as float64: inf where a value is missing, 0 at nodes that
        refine no element.

        field: one of :attr:`indicators`. box, memory: as for :meth:`values`.

        Raises the same, and ValueError for an unknown field or one of cells.
        """
        low, high, drop = self._corners(level, box)
        with reporting(progress) as report:
            array = self._core.indicator(field, level, backwards(low), backwards(high), to_bytes(memory), threads,
                                         report)
        return array.squeeze(axis=drop) if drop else array

    def sample(self, points: Any, *, level: int = 0, cells: Cells = "tet", coordinates: Coordinates = "array",
               memory: Bytes = "256M", threads: int = 0, progress: Progress = None) -> np.ndarray:
        """Interpolates the values at points, as float64. NaN outside the volume, and where a node with a weight other
        than 0 is missing.

        points: (..., 3) coordinates; the result has the shape (...). coordinates: "array", (z, y, x) times the
            spacing, or "world", (x, y, z).
        cells: "tet", linear on the tetrahedra of the nested grid, or "hex", trilinear.
        memory: bytes, in addition to points and result.

        Raises ValueError, IndexError for a level out of range, and subclasses of :class:`isonest.Error`.
        """
        given = np.asarray(points, dtype=np.float64)
        if given.ndim == 0 or given.shape[-1] != 3:
            raise ValueError(f"points of shape {given.shape}: the last axis must have 3 coordinates")
        if cells not in ("tet", "hex", "tetrahedra", "hexahedra"):
            raise ValueError(f"cells={cells!r}: give 'tet' or 'hex'")
        Place(self._frame, coordinates).require()
        rows = given.reshape(-1, 3)
        if coordinates == "array":
            rows = rows[:, ::-1] @ np.array(self._frame.direction) + np.array(self._frame.origin)
        with reporting(progress) as report:
            numbers = self._core.sample(np.ascontiguousarray(rows), level, cells.startswith("hex"), to_bytes(memory),
                                        threads, report)
        return numbers.reshape(given.shape[:-1])

    def histogram(self, level: Optional[int] = None, *, memory: Bytes = "512M", threads: int = 0,
                  progress: Progress = None) -> Histogram:
        """Counts the values of a level; None: of the finest level with at most 2**28 nodes."""
        with reporting(progress) as report:
            h = self._core.histogram(level, to_bytes(memory), threads, report)
        edges = np.append(h.low, h.end) if len(h.low) else np.empty(0)
        return Histogram(edges, h.nodes, h.cubes if h.cube_level is not None else None, h.suggested, h.missing,
                         h.level)

    def labels(self, *, memory: Bytes = "1G", threads: int = 0, progress: Progress = None) -> "list[Label]":
        """Lists the labels of a segmentation by increasing id, with the extent of each, and its name and colour if the
        store has them.

        Raises isonest.UnsupportedError if a value is not an integer up to 2**53, unless the store was made with
        ``labels=True``.
        """
        with reporting(progress) as report:
            rows = self._core.labels(to_bytes(memory), int(threads), report)
        said = {label: about for label, *about in self._core.label_names()}
        return [Label(row[0], row[1], (row[4], row[3], row[2]), (row[7], row[6], row[5]), *said.get(row[0], ()))
                for row in rows]

    def check(self, *, quick: bool = False, deep: bool = False, source: Any = None, memory: Bytes = "512M",
              threads: int = 0, progress: Progress = None, **reading: Any) -> CheckReport:
        """Checks the consistency of the store. Problems are listed in the report; they raise no exception.

        quick: check only the chunk table and a sample of the checksums; takes seconds for any size.
        deep: check everything, including that HDF5 finds the same chunks through its own index.
        source: the volume from which the store was made, as for :func:`isonest.preprocess`; compare its values.
            reading: how to read it; the arguments of :func:`isonest.preprocess` from ``spacing`` to ``offset``,
            ``headers`` and ``cache``.

        Raises ValueError if both ``quick`` and ``deep`` are given.
        """
        if quick and deep:
            raise ValueError("give one of quick= and deep=, not both")
        if source is None and reading:
            raise ValueError(f"{next(iter(reading))}= needs source=")
        _sources.refuse_unknown_reading("check", reading)
        budget = to_bytes(memory)
        volume = None if source is None else _sources.of_volume(source, identified=False, memory=budget, **reading)
        budget -= 0 if source is None else _sources.for_fetching(source, budget)
        with reporting(progress) as report:
            return _core.check(self._core, quick, deep, volume, budget, int(threads), report)

    def export(self, output: "os.PathLike[str] | str", field: str = "values", *, level: int = 0,
               replace: bool = False, memory: Bytes = "256M", progress: Progress = None) -> None:
        """Writes a field as a volume file: .h5, .nrrd, .nii, .vti, .npy, .mha or .raw.

        field: "values" in their type, or an indicator as float32 on the finest lattice, 0 at the macro vertices.
            Indicators that are never stored, such as "lp:3", "grad_lp:1.5_bar", "curvature_plus", "graph_curvature"
            or "deviation_lp:2", are computed in memory, which takes 20 bytes per node.
        level: for values, as in :meth:`values`; for an indicator, only nodes of this level and coarser.
        replace: overwrite an existing file.
        """
        with reporting(progress) as report:
            _core.export_field(self._core, os.fspath(output), field, int(level), replace, to_bytes(memory), report)

    def study(self, fields: Optional[Sequence[str]] = None, *, iso: Optional[float] = None,
              plane: "Optional[tuple[Point, float]]" = None, norm: Optional[float] = None,
              graph_distance: bool = False, steps: int = 25, least: float = 1e-4, coordinates: Coordinates = "array",
              memory: Bytes = "1G", threads: int = 0, progress: Progress = None) -> Study:
        """Compares indicators by adaptive meshes of the whole volume: their numbers of elements and their errors.

        The thresholds decrease from 1 and are relative to the largest value of each indicator.

        fields: names of indicators, as for :meth:`export`; None: all in the store.
        iso: also count the elements visited when extracting this isosurface.
        plane: normal and offset as for :meth:`slice`; restrict the mesh and its error to this plane.
        norm: p; also integrate the errors of value and gradient in L^p, exactly.
        graph_distance: also compute the distance between the graphs of data and mesh; slow if the error is large.
        steps: number of thresholds, at least 2. least: the smallest threshold.
        memory: bytes; must hold the volume with 20 bytes per node.
        """
        if steps < 2:
            raise ValueError(f"steps={steps!r}: give 2 or more")
        options = _core.StudyOptions()
        options.iso, options.norm, options.graph_distance = iso, norm, graph_distance
        options.steps, options.least = int(steps), float(least)
        options.memory, options.threads = to_bytes(memory), int(threads)
        if plane is not None:
            place = Place(self._frame, coordinates)
            place.require()
            options.set_plane(*place.plane(*plane))
        names = None if fields is None else list(fields)
        with reporting(progress) as report:
            return Study(*_core.study(self._core, names, options, report))

    def view(self, *, port: int = 0, memory: Bytes = "1G", threads: int = 0, open: Optional[bool] = None,
             height: int = 600, program: "os.PathLike[str] | str | None" = None) -> _view.View:
        """Shows the store in the browser: surface, slices, histogram, and the error bound of the mesh shown.

        Runs the program ``isonest view`` until the returned :class:`isonest.View` is closed or garbage-collected. In a
        notebook, a view that is the last expression of a cell is shown below it. The page is accessible only from this
        machine, and only with the full URL of the view.

        port: port to listen on; 0 is any free one.
        memory: largest heap of the program in bytes; at least 512M. threads: 0 is all cores.
        open: open a tab of the browser; None: unless in a notebook.
        height: height of the frame in a notebook, in pixels.
        program: path of ``isonest``. None: the environment variable ISONEST, otherwise the program installed with
            this package, otherwise the one on the PATH.

        Raises FileNotFoundError if the program is not found, ValueError for a number out of range, and errors of the
        program as subclasses of :class:`isonest.Error`.
        """
        return _view.start(self._location if self._core.is_remote else self.path, shown=str(self.path), port=port,
                           memory=memory, threads=threads, open=open, height=height, program=program,
                           **({"headers": self._access["headers"], "cache": self._access["cache"]}
                              if self._core.is_remote else {}))


for _function in vars(Extracting).values():
    while inspect.isfunction(_function):
        # The name in messages, of a class that its users know, also below decorators.
        _function.__qualname__ = f"Store.{_function.__name__}"
        _function = getattr(_function, "__wrapped__", None)
