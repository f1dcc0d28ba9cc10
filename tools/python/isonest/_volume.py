"""Functions for volumes: preprocess them to a store, or extract a surface in one call."""
from __future__ import annotations

import inspect
import operator
import os
import pathlib
import tempfile
from typing import Any, Mapping, Optional, Sequence, Union

import numpy as np

from . import _core, _images, _marching, _queries, _sources
from ._arguments import Bytes, Headers, Progress, per_axis, refuse_unknown, reporting, to_bytes
from ._core import PreprocessReport
from ._mesh import Mesh
from ._own import calling
from ._queries import Cells
from ._store import Store


def _tolerance(tolerance: Union[float, str]) -> "tuple[str, float]":
    """The kind of a tolerance ("values", "range", "bits" or "auto") and its number."""
    if not isinstance(tolerance, str):
        return "values", float(tolerance)
    text = tolerance.strip()
    try:
        if text == "auto":
            return "auto", 0.0
        if text.startswith("bits:"):
            return "bits", float(int(text[len("bits:"):]))
        return ("range", float(text[:-1]) / 100) if text.endswith("%") else ("values", float(text))
    except ValueError:
        raise ValueError(f"tolerance={tolerance!r}: give a number, a percentage of the range such as '0.5%', "
                         "'bits:N' or 'auto'") from None


def preprocess(volume: Any, store: "os.PathLike[str] | str", *, spacing: Optional[Sequence[float]] = None,
               origin: Optional[Sequence[float]] = None, unit: Optional[str] = None,
               frame: Optional[_sources.PatientFrame] = None,
               missing: Optional[float] = None, dataset: str = "", series: str = "", labels: bool = False,
               label_names: "os.PathLike[str] | str | None" = None, index: Any = None,
               crop: Optional[Sequence[slice]] = None, every: Union[int, Sequence[int]] = 1,
               periodic: str = "", repeat: Optional[Sequence[int]] = None,
               shape: Optional[Sequence[int]] = None, dtype: Any = None, offset: Optional[int] = None,
               indicators: Union[None, str, Sequence[str]] = None, own: "Optional[Mapping[str, Any]]" = None,
               tolerance: Union[float, str] = 0.0, exact: bool = False, chunk: int = 64,
               compression: int = 1, replace: bool = False, resume: bool = False, headers: Headers = None,
               cache: "os.PathLike[str] | str | None" = None, memory: Bytes = "1G", threads: int = 0, progress: Progress = None) -> PreprocessReport:
    """Converts a volume to the file ``store``, which appears only when it is complete.

    volume: an array [z, y, x], or [y, x] for data in a plane, of integers, bool, float16, float32 or float64; an object
        with shape, dtype and slices (such as a dataset of h5py, zarr or dask); an image of xarray, nibabel, SimpleITK, VTK
        or PyVista, which has its own place in the world; the name of a file or folder, or of several
        files that are slices of one volume; or a URL (https://, http://, s3://bucket/key), for some formats.
        A NumPy array with any strides, including a memory-mapped one, is read in place; of other objects, one slab is
        in memory at a time. 64-bit integers become float64 and must be within 2**53; float16 becomes float32. NaN and
        masked values are missing. The volume must not change during the call.
    spacing: distance between neighbouring nodes; origin: world position of the first node. Both in the order of the
        array's axes. None: as in the file or image, otherwise 1 and 0.
    unit: world unit of spacing and origin: "mm", "um", "nm", ...; None: as in the file, otherwise unknown.
    frame: the patient axes of the world, "RAS" (NIfTI, FreeSurfer) or "LPS" (DICOM, ITK); None: as in the file,
        otherwise unknown. Changes no coordinates.
    missing: a value that represents missing data.
    dataset: the array, for a file with several. series: the series, for DICOM.
    labels: the values are labels. 64-bit integers are kept (0 to 2**62 - 1), and so are the names and colours of labels
        in the file. label_names: a file with a table of names and colours (FreeSurfer, 3D Slicer, ITK-SNAP), which
        replaces those of the volume.
    index: for files with time steps or channels, the position on each axis, ``(5, None, None, None)``, or by name or
        number of the axis, ``{"time": 5}``, ``{0: 5}``. None takes a whole axis, even if it is not a spatial one.
    crop: part of the volume, ``np.s_[10:20, :, 5:]``. every: keep each n-th node of it; a number or (z, y, x).
    periodic: axes along which the last nodes are followed by the first, "x,y", so that surfaces close across the seam.
        repeat: number of periods, (z, y, x). For arrays: ``np.pad(a, [(0, 1)] * 3, "wrap")``.
    shape, dtype, offset: of raw files; ">u2" is a big-endian dtype. The offset is in bytes.
    indicators: names of the error indicators, as a list or separated by commas; "nodes" are all indicators for nodes,
        "all" also includes those for hexahedral cells. exact: do not round them up to 16 bits.
    own: own indicators by name, ``{"curvature": f}``, stored as own:curvature_bar and own:curvature_plus: a volume (an
        array or file as above) with a number >= 0 for every node, or a function that gets :class:`RefinementNodes` and
        returns an array with one number >= 0, or infinity, for each. It is called by several threads in any order, more
        than once for some nodes, and may depend on nothing but its argument. Nodes that touch missing values are left
        out, and always refined. ``resume`` refuses functions.
    tolerance: round all values first, by at most this much, which makes the store much smaller: a number; "0.5%" of the
        difference between the largest and the smallest value; "bits:4", for integers, drops the 4 lowest bits; "auto" is
        half the noise that the values show. Percentages and "auto" read the volume twice. Error bounds of meshes are for
        the given values, and include the tolerance. Not for labels.
    chunk: nodes per axis of a chunk, a power of two from 8 to 256. compression: zstd level, 1 to 19.
    replace: overwrite an existing store. resume: continue an interrupted run; if this run is interrupted, keep its
        files.
    headers, cache: for a volume at a URL, as in :func:`open`; otherwise ignored. A quarter of the memory is used for
        fetched data then.
    memory: largest heap in bytes, in addition to the volume. threads: 0 is all cores.
    progress: a function ``(phase, done, total, unit)``, or True for bars of tqdm. An exception that it raises cancels
        the work.

    Raises TypeError, ValueError, and subclasses of :class:`isonest.Error`.
    """
    options = _core.PreprocessOptions()
    options.memory = to_bytes(memory)
    options.threads = int(threads)
    options.chunk = int(chunk)
    options.compression = int(compression)
    options.exact = exact
    options.replace = replace
    options.resume = resume
    if indicators is not None:
        options.indicators = indicators.split(",") if isinstance(indicators, str) else list(indicators)
    for name, numbers in (own or {}).items():
        if callable(numbers):
            options.add_own_function(name, calling(numbers), "")
        else:
            own_source = _sources.of_volume(numbers, identified=resume, memory=options.memory)
            options.add_own_volume(name, own_source, os.path.dirname(os.fspath(store)) or ".")
    kind, number = _tolerance(tolerance)
    if labels and (kind != "values" or number != 0):
        raise ValueError("tolerance: labels cannot be rounded")

    def opened() -> _core.Source:
        return _sources.of_volume(volume, identified=resume, memory=options.memory, spacing=spacing, origin=origin,
                                  unit=unit, frame=frame, missing=missing, dataset=dataset, series=series, labels=labels,
                                  label_names=label_names, index=index, crop=crop, every=every, periodic=periodic, repeat=repeat,
                                  shape=shape, dtype=dtype, offset=offset, headers=headers, cache=cache)
    with reporting(progress) as report:
        if kind != "values" or number != 0:
            options.rounding = _core.rounding_of(opened(), kind, number, options.memory, report)
        source = opened()
        options.memory -= _sources.for_fetching(volume, options.memory)
        return _core.preprocess(source, os.fspath(store), options, report)


_WAYS = {"method": _queries.OF_MARCHING_CUBES["method"],
         **dict.fromkeys(("indicators", "own", "exact", "chunk", "compression"),
                         "it is for isonest.preprocess(), which makes a store"),
         **dict.fromkeys(("dataset", "series", "labels", "index", "crop", "shape", "dtype", "offset", "headers", "cache"),
                         "it is for isonest.preprocess(), which makes a store: isonest.open(path).isosurface(iso)")}


def isosurface(volume: Any, iso: "float | Sequence[float] | None" = None, *,
               level: "float | Sequence[float] | None" = None,
               spacing: Optional[Sequence[float]] = None, origin: Optional[Sequence[float]] = None,
               unit: Optional[str] = None, frame: Optional[_sources.PatientFrame] = None,
               missing: Optional[float] = None, mask: Any = None, step_size: int = 1, allow_degenerate: bool = True,
               cells: Optional[Cells] = None, memory: Bytes = "1G",
               threads: int = 0, scratch: "os.PathLike[str] | str | None" = None, progress: Progress = None,
               **query: Any) -> "Union[Mesh, list[Mesh]]":
    """Extracts the surface of a volume in one call, for volumes that are used only once.

    ``volume``, ``spacing``, ``origin``, ``unit``, ``frame`` and ``missing`` are as for :func:`preprocess`, the other
    arguments as for :meth:`Store.isosurface`. Without ``iso``, or ``level``, its other name, the isovalue is the mean of
    the smallest and the largest value.

    mask: an array of the volume's shape; where it is False, values are missing. step_size: use every n-th node along
        each axis; the mesh stays at its place. Unlike ``error`` and ``distance``, it gives no bound. allow_degenerate:
        either value gives a mesh without triangles of area 0, except for ``report.zero_area_triangles``.

    The surface at full resolution, optionally with ``box``, ``close``, ``distance``, ``triangles``, ``components``,
    ``min_component`` and ``min_volume``, is extracted directly from the volume, which is read once per isovalue. A
    temporary store in the folder ``scratch`` is needed for an error or a threshold; ``focus``, ``camera``, ``view``,
    ``bound``; ``vertices``, ``vertex_values``, ``vertex_error``; ``effort="none"``, ``by="error"``, ``keep_analysis``,
    ``volume_interval``; and for data in a plane, 64-bit labels, and volumes whose chunks do not fit into ``memory``.

    memory: bytes, in addition to the volume and the mesh (at full resolution, twice the mesh). scratch: the folder for
        the store and temporary files; None: the system's.
    """
    query = _queries.renew(query)
    own = inspect.signature(isosurface).parameters.keys() - {"query"}
    refuse_unknown("isosurface", query, own | inspect.signature(Store.isosurface).parameters.keys() - {"self"}, _WAYS)
    iso = _queries.isovalue(iso, level)
    if not isinstance(allow_degenerate, (bool, np.bool_)):
        raise TypeError(f"allow_degenerate={allow_degenerate!r}: give True or False")
    volume, spacing, every = _thinned(volume, spacing, mask, step_size)
    place: "dict[str, Any]" = {"spacing": spacing, "origin": origin, "every": every, "unit": unit, "frame": frame,
                               "missing": missing}
    try:
        return _marching.march(volume, iso, cells=cells, memory=memory, threads=threads, scratch=scratch or "",
                               progress=progress, **place, **query)
    except _marching.NeedsStore as needed:
        indicators = needed.indicators
    with tempfile.TemporaryDirectory(prefix="isonest-", dir=scratch) as folder:
        path = pathlib.Path(folder) / "volume.isonest"
        preprocess(volume, path, indicators=indicators, memory=memory, threads=threads, progress=progress, **place)
        with Store(path) as store:
            found: Any = iso
            if found is None:
                low, high = store.range or (0.0, 0.0)
                found = low + (high - low) / 2
            return store.isosurface(found, cells=cells, memory=memory, threads=threads, scratch=folder,
                                    progress=progress, **query)


def _thinned(volume: Any, spacing: Optional[Sequence[float]], mask: Any, step_size: int
             ) -> "tuple[Any, Optional[Sequence[float]], int]":
    """The volume with missing values where the mask is False, of every ``step_size``-th node; its spacing; and ``every``
    for the volumes that have to be read with it."""
    step = operator.index(step_size)
    if step < 1:
        raise ValueError(f"step_size={step_size!r}: give 1 or more")
    if mask is not None:
        if _sources.is_files(volume) or _images.is_image(volume):
            raise TypeError(f"mask= is for arrays, and this is {'a file' if _sources.is_files(volume) else 'an image'}: "
                            "give its array, or NaN where values are missing")
        image = _images.image_of(volume)
        volume = image._replace(values=_images.Masked(image.values, mask))
    if step == 1 or _sources.is_files(volume):
        return volume, spacing, step
    ndim = len(_images.image_of(volume).values.shape)
    if spacing is not None:
        per_axis("spacing", spacing, ndim, 1.0)
        spacing = [step * float(length) for length in spacing]
    return _images.image_of(volume).every(step), spacing, 1
