"""What is done with a volume: made into a store, or extracted from in one call."""
from __future__ import annotations

import os
import pathlib
import tempfile
from typing import Any, Optional, Sequence, Union

from . import _core, _marching, _sources
from ._arguments import Bytes, Headers, Progress, reporting, to_bytes
from ._core import PreprocessReport
from ._mesh import Mesh
from ._queries import Cells
from ._store import Store


def preprocess(volume: Any, store: "os.PathLike[str] | str", *, spacing: Optional[Sequence[float]] = None,
               origin: Optional[Sequence[float]] = None, unit: Optional[str] = None,
               frame: Optional[_sources.PatientFrame] = None,
               missing: Optional[float] = None, dataset: str = "", series: str = "", labels: bool = False,
               label_names: "os.PathLike[str] | str | None" = None, index: Any = None,
               crop: Optional[Sequence[slice]] = None, every: Union[int, Sequence[int]] = 1,
               shape: Optional[Sequence[int]] = None, dtype: Any = None, offset: Optional[int] = None,
               indicators: Union[None, str, Sequence[str]] = None, exact: bool = False, chunk: int = 64,
               compression: int = 1, replace: bool = False, resume: bool = False, headers: Headers = None,
               cache: "os.PathLike[str] | str | None" = None, memory: Bytes = "1G", threads: int = 0, progress: Progress = None) -> PreprocessReport:
    """Turns a volume into the file ``store``, which appears whole or not at all.

    volume: an array [z, y, x], or [y, x] for a map, of integers, truth values, float16, float32 or float64; anything
        with shape, dtype and slices (a dataset of h5py, zarr); or the name of a file or folder, or the names of files
        that are slices of one volume; or a URL (https://, http://, s3://bucket/key), of some formats.
        A NumPy array of any strides, mapped ones among them, is read where it lies; of other things one slab is in
        memory at a time. 64-bit integers become float64 and have to be within 2**53, float16 becomes float32. NaN
        and what is masked are missing data. Nobody may change the volume meanwhile.
    spacing: distance of neighbouring nodes, origin: world position of the first node, both in the order of the
        array's axes. Without them 1 and 0, or what the file says.
    unit: of length, of both: "mm", "um", "nm", ...; without it what the file says, or not known.
    frame: what the world's axes are in a patient, "RAS" (NIfTI, FreeSurfer) or "LPS" (DICOM, ITK); without it what
        the file says, or not known. It changes no number.
    missing: this value stands for missing data.
    dataset: of a file of several, series: of DICOM. labels: the values are labels; integers of 64 bits are
        kept as they are (0 to 2**62 - 1), and so are names and colours that the file has for its labels; label_names:
        a table of them, as FreeSurfer, 3D Slicer and ITK-SNAP have it, in place of the file's. index: of files with
        time steps or channels what is taken of each axis, ``(5, None, None, None)``, or by the axis' name or number,
        ``{"time": 5}``, ``{0: 5}``; None takes a whole axis, also one that is no direction in space.
        crop: ``np.s_[10:20, :, 5:]``; every: of what is left, each so-many-th node, one number or (z, y, x).
    shape, dtype, offset: of raw numbers; ">u2" is a dtype of big-endian numbers.
    indicators: names of the error indicators, in a list or with commas; "nodes" are all of nodes, "all" those of
        hexahedral cells too; exact: not rounded up to 16 bits.
    chunk: nodes per axis, a power of two from 8 to 256. compression: zstd level, 1 to 19.
    replace: an existing store. resume: go on with what an interrupted run left, and leave what this one has done.
    headers, cache: of a volume at a URL, as in :func:`open`, and not used of others; a quarter of the memory is for
        what is fetched.
    memory: bytes of heap, at most, beside the volume. threads: 0 is all cores.
    progress: a function ``(phase, done, total, unit)``, or True for bars of tqdm. What it raises ends the work.
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
    source = _sources.of_volume(volume, identified=resume, memory=options.memory, spacing=spacing, origin=origin,
                                unit=unit, frame=frame, missing=missing, dataset=dataset, series=series, labels=labels,
                                label_names=label_names, index=index, crop=crop, every=every, shape=shape, dtype=dtype,
                                offset=offset, headers=headers, cache=cache)
    options.memory -= _sources.for_fetching(volume, options.memory)
    with reporting(progress) as report:
        return _core.preprocess(source, os.fspath(store), options, report)


def isosurface(volume: Any, iso: "Union[None, float, Sequence[float]]" = None, *,
               spacing: Optional[Sequence[float]] = None, unit: Optional[str] = None,
               frame: Optional[_sources.PatientFrame] = None, missing: Optional[float] = None, cells: Optional[Cells] = None, memory: Bytes = "1G",
               threads: int = 0, scratch: "os.PathLike[str] | str | None" = None, progress: Progress = None,
               **query: Any) -> "Union[Mesh, list[Mesh]]":
    """The surface of a volume in one call, for volumes that are looked at once.

    ``volume``, ``spacing``, ``unit``, ``frame`` and ``missing`` are those of :func:`preprocess`, the other arguments those of
    :meth:`Store.isosurface`. Without an isovalue it is the mean of the smallest and the largest value.

    The surface at full resolution, whole or cut by a ``box``, and what is made of it (``close``, ``distance``,
    ``triangles``, ``components``, ``min_component``, ``min_volume``), comes straight from the volume, which is read
    once for each isovalue. What else is asked for needs a store, which is made in the folder ``scratch`` and removed:
    an error or a threshold; ``focus``, ``camera``, ``view``, ``bound``; ``vertices``, ``vertex_values`` and
    ``vertex_error``; ``effort="none"``, ``by="error"``, ``keep_analysis``, ``volume_interval``.
    So do data in a plane, labels of 64 bits, and chunks of planes that are beyond ``memory``.

    memory: bytes, beside the volume and the mesh (at full resolution, twice the mesh). scratch: the folder for that
        store and for temporary files; without it, the system's.
    """
    mesh = _marching.march(volume, iso, spacing=spacing, unit=unit, frame=frame, missing=missing, cells=cells, memory=memory,
                           threads=threads, scratch=scratch or "", progress=progress, **query)
    if mesh is not None:
        return mesh
    indicators = None
    if cells in ("hex", "hexahedra") and (query.get("effort") == "none" or query.get("indicator") == "estimate"):
        indicators = ["deviation_bar", "hex_linf", "hex_deviation"]
    with tempfile.TemporaryDirectory(prefix="isonest-", dir=scratch) as folder:
        path = pathlib.Path(folder) / "volume.isonest"
        preprocess(volume, path, spacing=spacing, unit=unit, frame=frame, missing=missing, indicators=indicators, memory=memory,
                   threads=threads, progress=progress)
        with Store(path) as store:
            level: Any = iso
            if level is None:
                low, high = store.range or (0.0, 0.0)
                level = low + (high - low) / 2
            return store.isosurface(level, cells=cells, memory=memory, threads=threads, scratch=folder,
                                    progress=progress, **query)
