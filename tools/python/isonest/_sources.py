"""Input volumes: files, NumPy arrays, and objects that return NumPy arrays when sliced."""
from __future__ import annotations

import inspect
import operator
import os
import re
import warnings
from typing import Any, List, Literal, Optional, Sequence, Tuple, Union

import numpy as np

from . import _core, _images
from ._arguments import Headers, per_axis, refuse_unknown, to_cache, to_header_lines
from ._frame import ALONG_WORLD

PatientFrame = Literal["ras", "lps"]
"""The patient axes of the world; upper case is accepted too."""
_TYPES = frozenset("uint8 int8 uint16 int16 uint32 int32 float32 float64".split())
_EXACT = 2**53
"""The largest n such that all integers up to n are exact in float64."""
_URL = re.compile("(https?|s3)://", re.IGNORECASE)
_PIECE = 8 << 20
"""Preferred size of a slice in bytes; whole chunks of the input may be larger."""


def _type_in_store(dtype: np.dtype, masked: bool) -> np.dtype:
    """The type in which a store keeps values of ``dtype``. Raises TypeError if there is none."""
    if dtype == np.bool_:
        dtype = np.dtype(np.uint8)
    if masked and dtype.kind in "iu":
        return np.dtype(np.float32 if dtype.itemsize <= 2 else np.float64)
    if dtype == np.float16:
        return np.dtype(np.float32)
    if dtype in (np.dtype(np.int64), np.dtype(np.uint64)):
        return np.dtype(np.float64)
    if dtype.name not in _TYPES:
        raise TypeError(f"a volume of {dtype}: give integers, booleans, float16, float32 or float64")
    return np.dtype(dtype.name)


class _Reader:
    """Reads slices of an array as dense arrays of the store's type."""

    def __init__(self, volume: Any, name: str) -> None:
        self.volume = volume
        self.name = name
        self.source_type = np.dtype(volume.dtype)
        self.dtype = _type_in_store(self.source_type.newbyteorder("="), _images.is_masked(volume))

    def read(self, z0: int, z1: int, y0: int, y1: int) -> np.ndarray:
        """Rows [y0, y1) of planes [z0, z1)."""
        if len(self.volume.shape) == 2:
            slab = self.volume[y0:y1, :]
        else:
            slab = self.volume[z0:z1, y0:y1, :]
        expected = (z1 - z0, y1 - y0, self.volume.shape[-1])
        mask = np.ma.getmask(slab) if isinstance(slab, np.ma.MaskedArray) else np.ma.nomask
        slab = np.asarray(slab)
        if slab.size != expected[0] * expected[1] * expected[2]:
            raise ValueError(f"{self.name}: a slice has the shape {slab.shape}, not {expected}")
        if self.source_type.kind in "iu" and self.source_type.itemsize == 8:
            if mask is not np.ma.nomask:
                slab = np.where(mask, 0, slab)
            if slab.size and (slab.max() > _EXACT or slab.min() < -_EXACT):
                raise ValueError(f"{self.name}: integers beyond 2**53, which float64 does not hold; "
                                 "scale them or subtract an offset first")
        dense = np.ascontiguousarray(slab, dtype=self.dtype)
        if mask is not np.ma.nomask and np.any(mask):
            dense = np.where(mask, np.array(np.nan, self.dtype), dense)
        return dense


def _files_of(volume: Any) -> list[str]:
    """The file from which an array is mapped, or that contains a dataset."""
    name = getattr(volume, "filename", None) if isinstance(volume, np.memmap) else None
    if name is None:
        name = getattr(getattr(volume, "file", None), "filename", None)
    return [os.fspath(name)] if isinstance(name, (str, os.PathLike)) and os.path.exists(name) else []


def _name_of(volume: Any, files: Sequence[str]) -> str:
    if not files:
        return "array"
    inside = getattr(volume, "name", None)
    return f"{files[0]}:{inside}" if isinstance(inside, str) else files[0]


def _identity_of(volume: Any, name: str, files: Sequence[str]) -> str:
    """Identifies the contents of a dataset in a file, for ``resume``; "" if that is not possible."""
    if isinstance(volume, np.ndarray) or not files:
        return ""
    status = os.stat(files[0])
    return f"{name}\nsize {status.st_size}\ntime {status.st_mtime_ns}\n"


def _chunks_of(volume: Any) -> tuple[int, ...]:
    """The shape of the chunks, of the largest ones if they differ (dask); all 1 without chunks."""
    chunks = getattr(volume, "chunks", None)
    if not isinstance(chunks, tuple) or len(chunks) != len(volume.shape):
        return (1,) * len(volume.shape)
    return tuple(int(np.max(lengths)) for lengths in chunks)


def of_array(volume: Any, spacing: Optional[Sequence[float]], origin: Optional[Sequence[float]],
             unit: Optional[str], frame: Optional[PatientFrame], missing: Optional[float], identified: bool) -> Any:
    """A source for an array or an object of another library. Raises ValueError, TypeError."""
    image = _images.image_of(volume)
    volume = image.values
    ndim = len(volume.shape)
    if ndim not in (2, 3):
        raise ValueError(f"an array of shape {tuple(volume.shape)}: give an array with three axes, or with two for data in a plane")
    if 0 in volume.shape:
        raise ValueError(f"an array of shape {tuple(volume.shape)} has no values")
    files = _files_of(volume)
    name = _name_of(volume, files)
    lengths = image.spacing if spacing is None else spacing
    first = image.origin if origin is None else origin
    place: dict[str, Any] = {
        "spacing": per_axis("spacing", lengths if lengths is not None else (1.0,) * ndim, ndim, 1.0),
        "origin": per_axis("origin", first if first is not None else (0.0,) * ndim, ndim, 0.0),
        # As for files, a spacing replaces the directions.
        "direction": image.direction if spacing is None else ALONG_WORLD,
        "unit": unit if unit is not None else image.unit, "name": name, "files": files, "missing": missing,
        "frame": frame if frame is not None else image.frame if spacing is None else None,
        "uneven": _uneven(image, origin, ndim) if spacing is None else ((), (), ())}
    reader = _Reader(volume, name)
    if isinstance(volume, np.ndarray) and not isinstance(volume, np.ma.MaskedArray):
        plain = volume.view(np.uint8) if volume.dtype == np.bool_ else volume
        if plain.dtype == reader.dtype and plain.dtype.isnative:
            return _core.source_of_array(np.asarray(plain if ndim == 3 else plain[None]), identified=identified,
                                         **place)
    chunks = _chunks_of(volume)
    nz, ny, nx = (1, *volume.shape) if ndim == 2 else volume.shape
    planes, rows = (1, chunks[0]) if ndim == 2 else chunks[:2]
    each = nx * (reader.source_type.itemsize + 2 * reader.dtype.itemsize)
    rows = min(ny, max(rows, _PIECE // (planes * each) // rows * rows))
    identity = _identity_of(volume, name, files) if identified else ""
    return _core.source_of_reader(
        reader, nodes=(nx, ny, nz), dtype=reader.dtype, planes=planes, rows=rows,
        heap=planes * rows * each + (2 << 20), identity=identity, **place)


def _uneven(image: _images.Image, origin: Optional[Sequence[float]], ndim: int) -> Sequence[Sequence[float]]:
    """The coordinates of uneven axes, x, y and z, moved to where the caller wants the first node."""
    if origin is None:
        return image.uneven
    return [[x - min(at) + first for x in at] for at, first in zip(image.uneven, per_axis("origin", origin, ndim, 0.0))]


def of_volume(volume: Any, *, identified: bool, memory: int, spacing: Optional[Sequence[float]] = None,
              origin: Optional[Sequence[float]] = None, unit: Optional[str] = None, frame: Optional[PatientFrame] = None,
              missing: Optional[float] = None, dataset: str = "", series: str = "", labels: bool = False,
              label_names: Any = None, index: Any = None, crop: Optional[Sequence[slice]] = None,
              every: Union[int, Sequence[int]] = 1, periodic: str = "", repeat: Optional[Sequence[int]] = None,
              shape: Optional[Sequence[int]] = None, dtype: Any = None, offset: Optional[int] = None,
              headers: Headers = None, cache: "os.PathLike[str] | str | None" = None) -> Any:
    """A source for an array or files. ``memory``: of the work that reads it, including :func:`for_fetching`."""
    if is_files(volume):
        return of_files(volume, spacing=spacing, origin=origin, unit=unit, frame=frame, missing=missing, dataset=dataset,
                        series=series, labels=labels, label_names=label_names, index=index, shape=shape, dtype=dtype,
                        offset=offset, crop=crop, every=every, periodic=periodic, repeat=repeat,
                        max_heap=(memory - for_fetching(volume, memory)) // 4, headers=headers, cache=cache,
                        fetching=for_fetching(volume, memory))
    of_files_alone = {"dataset": dataset or None, "series": series or None, "labels": labels or None,
                      "label_names": label_names, "index": index,
                      "shape": shape, "dtype": dtype, "offset": offset, "crop": crop,
                      "every": None if every == 1 else every, "periodic": periodic or None, "repeat": repeat,
                      "headers": headers, "cache": cache}
    given = [name for name, value in of_files_alone.items() if value is not None]
    if given:
        raise ValueError(f"{given[0]}= is for files; this volume is an array, which can be sliced")
    return of_array(volume, spacing, origin, unit, frame, missing, identified)


def refuse_unknown_reading(function: str, reading: "dict[str, Any]") -> None:
    """Raises TypeError for a keyword that is none of the arguments of preprocess that say how to read a volume."""
    known = inspect.signature(of_volume).parameters.keys() - {"volume", "identified", "memory"}
    refuse_unknown(function, reading, known, {})


def index_entries(index: Any) -> List[Tuple[str, Optional[int]]]:
    """Pairs of axis and position for an ``index`` argument; "" is the next axis, position None the whole axis."""
    if index is None:
        return []
    if isinstance(index, dict):
        named = [(axis if isinstance(axis, str) else str(operator.index(axis)), at) for axis, at in index.items()]
    elif isinstance(index, (list, tuple)):
        named = [("", at) for at in index]
    else:
        raise ValueError(f"index={index!r}: give an entry for each axis, (5, None, None, None), or a dict by name or "
                         "number, {'time': 5}")
    return [(axis, None if at is None or at == slice(None) else operator.index(at)) for axis, at in named]


def is_files(volume: Any) -> bool:
    """Whether this is the name of a file or folder, or a list of such names."""
    if isinstance(volume, (list, tuple)):
        return len(volume) > 0 and all(isinstance(name, (str, os.PathLike)) for name in volume)
    return isinstance(volume, (str, os.PathLike))


def is_elsewhere(volume: Any) -> bool:
    """Whether ``volume`` is a URL."""
    names = volume if isinstance(volume, (list, tuple)) else [volume]
    return is_files(volume) and any(_URL.match(os.fspath(name)) for name in names)


def for_fetching(volume: Any, memory: int) -> int:
    """Bytes of the memory that are set aside for fetched data; 0 unless the volume is remote."""
    return min(memory, max(memory // 4, 16 << 20), 256 << 20) if is_elsewhere(volume) else 0


def of_files(paths: Any, *, spacing: Optional[Sequence[float]], origin: Optional[Sequence[float]],
             unit: Optional[str], frame: Optional[PatientFrame], missing: Optional[float], dataset: str, series: str, labels: bool,
             label_names: Any, index: Any, shape: Optional[Sequence[int]], dtype: Any, offset: Optional[int],
             crop: Optional[Sequence[slice]], every: Union[int, Sequence[int]], periodic: str,
             repeat: Optional[Sequence[int]], max_heap: int,
             headers: Headers, cache: "os.PathLike[str] | str | None", fetching: int) -> Any:
    """A source for a file, a folder, several files, or a URL."""
    options = _core.SourceOptions()
    lines, folder = to_header_lines(headers), to_cache(cache)
    if fetching > 0:
        options.set_remote(lines, *folder, fetching)
    options.dataset, options.series, options.labels = dataset, series, labels
    options.label_names = os.fspath(label_names or "")
    options.offset, options.missing, options.max_heap = offset, missing, max_heap
    ndim = next((len(numbers) for numbers in (shape, spacing, origin) if numbers is not None), 3)
    if ndim not in (2, 3):
        raise ValueError(f"shape={shape!r}: give three numbers, or two for data in a plane")
    if shape is not None:
        options.set_dims(per_axis("shape", [int(n) for n in shape], ndim, 1))
    if dtype is not None:
        kind = np.dtype(dtype)
        options.set_dtype(kind.newbyteorder("="))
        if kind.itemsize > 1:
            options.big_endian = kind.newbyteorder("=").str[0] != kind.str[0]
    if spacing is not None:
        options.spacing = per_axis("spacing", spacing, ndim, 1.0)
    if origin is not None:
        options.origin = per_axis("origin", origin, ndim, 0.0)
    if unit is not None:
        options.set_unit(unit)
    if frame is not None:
        options.set_frame(frame)
    for axis, at in index_entries(index):
        options.add_index(axis, at)
    if crop is not None:
        if any(not isinstance(part, slice) or part.step not in (None, 1) for part in crop):
            raise ValueError(f"crop={crop!r}: give slices without a step, such as np.s_[10:20, :, 5:]; "
                             "a step is every=")
        options.set_crop(per_axis("crop", [(part.start, part.stop) for part in crop], len(crop), (None, None)))
    if isinstance(every, (int, np.integer)):
        every = (int(every),) * ndim
    options.set_every(per_axis("every", every, len(every), 1))
    if set(periodic) - set("xyz,"):
        raise ValueError(f"periodic={periodic!r}: give names of axes, such as 'x,y'")
    repeat = [1] * ndim if repeat is None else list(repeat)
    options.set_periodic([axis in periodic for axis in "xyz"], per_axis("repeat", repeat, len(repeat), 1))
    source = _core.source_of_files([paths] if isinstance(paths, (str, os.PathLike)) else list(paths), options)
    if fetching > 0 and source.cache_warning:
        warnings.warn(source.cache_warning, RuntimeWarning, stacklevel=4)
    return source
