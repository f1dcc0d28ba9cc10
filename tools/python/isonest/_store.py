"""Stores: what preprocess makes, and what is extracted from them."""
from __future__ import annotations

import os
import pathlib
import warnings
from typing import Any, NamedTuple, Optional, Sequence, Union

import numpy as np

from . import _core, _sources, _view
from ._arguments import Bytes, Headers, Point, Progress, backwards, reporting, to_bytes, to_cache, to_header_lines
from ._core import Analysis, CheckReport, StoredArray, StudyRow
from ._extracting import Extracting
from ._frame import Directions, Frame
from ._queries import Coordinates, Place


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
    name: Optional[str] = None
    """What it is called, if the store says so."""
    color: "Optional[tuple[int, int, int]]" = None
    """Red, green, blue from 0 to 255, if the store says so."""


class Study(NamedTuple):
    """How many elements each indicator needs for how much error."""

    all_elements: int
    """Of the finest mesh of triangles or tetrahedra."""
    all_cells: int
    """Of the finest grid of quadrilaterals or hexahedra."""
    rows: "list[StudyRow]"
    """Field by field, thresholds falling."""


def _open_again(location: str, access: "dict[str, Any]") -> "Store":
    return Store(location, **access)


class Store(Extracting):
    """A store, open for reading; see :func:`isonest.open`. Any number of threads may use it at once."""

    def __init__(self, path: "os.PathLike[str] | str", *, headers: Headers = None,
                 cache: "os.PathLike[str] | str | None" = None, memory: Bytes = "64M") -> None:
        lines = to_header_lines(headers)
        self._core = _core.Store(os.fspath(path), lines, *to_cache(cache), to_bytes(memory))
        if self._core.cache_warning:
            warnings.warn(self._core.cache_warning, RuntimeWarning, stacklevel=3)
        self._location = os.fspath(path)
        self._access: "dict[str, Any]" = {"headers": lines, "cache": cache, "memory": memory}

    def close(self) -> None:
        """Closes the file. Meshes and arrays that came from it stay."""
        self._core.close()

    def __enter__(self) -> "Store":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def __reduce__(self) -> Any:
        # Of a store elsewhere with all that opens it, credentials among it.
        return (_open_again, (self._location, self._access)) if self._core.is_remote else (Store, (str(self.path),))

    def __repr__(self) -> str:
        if self._core.closed:
            return "<isonest.Store, closed>"
        return f"<isonest.Store {str(self.path)!r}: {self.shape} {self.dtype}, {self.levels} levels>"

    @property
    def path(self) -> "Union[pathlib.Path, str]":
        """The file; of a store elsewhere the URL, without credentials and query."""
        return self._core.name if self._core.is_remote else pathlib.Path(self._core.name)

    @property
    def fetched(self) -> "dict[str, int]":
        """What was fetched over a network until now, by all queries together: ``remote_bytes``, ``requests``,
        ``round_trips`` (times that somebody had to wait), and ``cache_bytes``, which came from the cache on disk
        instead. All 0 for a file."""
        return self._core.fetched

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
    def frame(self) -> Optional[str]:
        """What the world's axes are in a patient: "RAS" or "LPS"; None where it is not known."""
        return self._core.frame

    @property
    def direction(self) -> Directions:
        """World directions (x, y, z) of the axes x, y and z: unit vectors, at right angles unless the volume is sheared."""
        return self._frame.direction

    @property
    def _frame(self) -> Frame:
        return Frame.of(self._core)

    @property
    def range(self) -> Optional[tuple[float, float]]:
        """The smallest and the largest finite value; None if there is none. Labels of 64 bits are ints."""
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

    @property
    def format(self) -> str:
        """The version of the file's format."""
        return self._core.format

    @property
    def exact(self) -> bool:
        """Whether the indicators were not rounded up to 16 bits."""
        return self._core.exact

    @property
    def chunk(self) -> int:
        """Nodes of a chunk along each axis."""
        return self._core.chunk

    @property
    def compression(self) -> int:
        """The zstd level."""
        return self._core.compression

    @property
    def arrays(self) -> "list[StoredArray]":
        """All arrays of all levels: their sizes, compressed and not, and ranges."""
        return _core.stored_arrays(self._core)

    @property
    def analyses(self) -> "list[Analysis]":
        """The analyses of surfaces that are kept beside the store (``keep_analysis=True``)."""
        return _core.analyses(self._core)

    def values(self, level: int = 0, box: Optional[Sequence[Union[slice, int]]] = None, *, memory: Bytes = "256M",
               threads: int = 0, progress: Progress = None) -> np.ndarray:
        """The values of a level: those of ``array[::2**level, ::2**level, ::2**level]``. Labels of 64 bits come as int64.

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

    def labels(self, *, memory: Bytes = "1G", threads: int = 0, progress: Progress = None) -> "list[Label]":
        """The labels of a segmentation, by their ids: what values there are, and where; with the names and colours
        that the store has.

        Raises isonest.UnsupportedError for values that are no whole numbers up to 2**53, unless the store was made with
        ``labels=True``.
        """
        with reporting(progress) as report:
            rows = self._core.labels(to_bytes(memory), int(threads), report)
        said = {label: about for label, *about in self._core.label_names()}
        return [Label(row[0], row[1], (row[4], row[3], row[2]), (row[7], row[6], row[5]), *said.get(row[0], ()))
                for row in rows]

    def check(self, *, quick: bool = False, deep: bool = False, source: Any = None, memory: Bytes = "512M",
              threads: int = 0, progress: Progress = None, **reading: Any) -> CheckReport:
        """Tests the store, from checksums to brute force. What is wrong is in the report: nothing is raised for it.

        quick: seconds for any size, the chunk table and a sample of the checksums.
        deep: everything, also that HDF5 finds the same chunks by its own index.
        source: the volume that the store was made from, as of :func:`isonest.preprocess`: the values are compared
            with it. reading: how it is read, the arguments of :func:`isonest.preprocess` from ``spacing`` to
            ``offset``, ``headers`` and ``cache``.
        """
        if quick and deep:
            raise ValueError("give one of quick= and deep=, not both")
        if source is None and reading:
            raise ValueError(f"{next(iter(reading))}= needs source=")
        budget = to_bytes(memory)
        volume = None if source is None else _sources.of_volume(source, identified=False, memory=budget, **reading)
        budget -= 0 if source is None else _sources.for_fetching(source, budget)
        with reporting(progress) as report:
            return _core.check(self._core, quick, deep, volume, budget, int(threads), report)

    def export(self, output: "os.PathLike[str] | str", field: str = "values", *, level: int = 0,
               replace: bool = False, memory: Bytes = "256M", progress: Progress = None) -> None:
        """Writes a field as a volume file: .h5, .nrrd, .nii, .vti, .npy, .mha or .raw.

        field: "values" in their type, or an indicator as float32 on the finest lattice, 0 at the macro vertices.
            Indicators that no store holds are computed in memory, which takes 20 bytes a node: "lp:3",
            "grad_lp:1.5_bar", "gradient", "curvature_plus".
        level: of values, of :meth:`values`; of an indicator, only nodes of this level and coarser.
        replace: an existing file.
        """
        with reporting(progress) as report:
            _core.export_field(self._core, os.fspath(output), field, int(level), replace, to_bytes(memory), report)

    def study(self, fields: Optional[Sequence[str]] = None, *, iso: Optional[float] = None,
              plane: "Optional[tuple[Point, float]]" = None, norm: Optional[float] = None,
              graph_distance: bool = False, steps: int = 25, least: float = 1e-4, coordinates: Coordinates = "array",
              memory: Bytes = "1G", threads: int = 0, progress: Progress = None) -> Study:
        """Compares indicators: at thresholds from 1 down, as fractions of each one's largest value, the elements of the
        adaptive mesh of the whole volume, and the error of the function on it.

        fields: their names, those of :meth:`export` among them; without them all of the store.
        iso: also count what extracting this isosurface visits.
        plane: normal and offset as of :meth:`slice`; the mesh and its error on this plane alone.
        norm: p, also the errors of value and gradient in L^p, integrated exactly.
        graph_distance: also the distance of the graphs of data and mesh; takes long where the error is large.
        steps, least: how many thresholds, and the least one.
        memory: the volume has to fit into it, 20 bytes a node.
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
        return _view.start(self._location if self._core.is_remote else self.path, shown=str(self.path), port=port,
                           memory=memory, threads=threads, open=open, height=height, program=program,
                           **({"headers": self._access["headers"], "cache": self._access["cache"]}
                              if self._core.is_remote else {}))
