"""Types of arguments, and their conversion."""
from __future__ import annotations

import contextlib
import difflib
import os
import re
from typing import Any, Callable, Iterable, Iterator, Mapping, Optional, Sequence, Tuple, Union

Point = Sequence[float]
"""Three numbers, in the order of the array's axes (z, y, x) or, in world coordinates, (x, y, z)."""
Box = Tuple[Point, Point]
"""The corners with the smallest and the largest coordinates."""
Bytes = Union[int, str]
"""A number of bytes, or a string such as "512M"; K, M, G and T are powers of 1024."""
ProgressFunction = Callable[[str, int, int, str], Any]
"""Called as ``function(phase, done, total, unit)`` ; the unit is "B" for bytes, otherwise a plural noun."""
Progress = Union[None, bool, ProgressFunction]
Headers = Union[None, Mapping[str, str], Sequence[str]]
"""A dict of names and values, or strings "Name: value"."""

_BYTES = re.compile(r"\s*([0-9]+(?:\.[0-9]*)?)\s*([KMGT]?)(?:I?B)?\s*", re.IGNORECASE)
_HEADER = re.compile(r"[-!#$%&'*+.^_`|~0-9A-Za-z]+:[^\x00-\x08\x0a-\x1f\x7f]*")
_LENGTH = re.compile(r"\s*([0-9.]+(?:[eE][-+]?[0-9]+)?)\s*(\D+?)\s*")
_DISTANCE = re.compile(r"\s*([0-9.]+(?:[eE][-+]?[0-9]+)?)\s*(voxels?)?\s*")


def to_bytes(memory: Bytes) -> int:
    """The number of bytes. Raises ValueError for a malformed or negative argument."""
    if isinstance(memory, str):
        found = _BYTES.fullmatch(memory)
        if not found:
            raise ValueError(f"memory={memory!r}: give bytes, or a text such as '512M'")
        return int(float(found[1]) * 1024 ** " KMGT".index(found[2].upper() or " "))
    if memory < 0:
        raise ValueError(f"memory={memory!r}: give a number of bytes")
    return int(memory)


def to_cache(cache: "os.PathLike[str] | str | None") -> "tuple[str, int]":
    """The folder (empty if None) and its largest size in bytes. Only a str may have the form "FOLDER:SIZE"."""
    most = 2**30
    folder = os.fspath(cache) if cache is not None else ""
    if isinstance(cache, str):
        name, colon, size = cache.rpartition(":")
        if colon and _BYTES.fullmatch(size):
            folder, most = name, to_bytes(size)
        folder = os.path.expanduser(folder)
    if cache is not None and (not folder or most == 0):
        raise ValueError(f"cache={cache!r}: give a folder, or a text such as 'FOLDER:2G'")
    return folder, most


def to_header_lines(headers: Headers) -> "list[str]":
    """The headers as "Name: value". Messages do not quote malformed headers, as they may be secret."""
    if isinstance(headers, str):
        raise TypeError("headers: give a dict of names and values, or a list of texts 'Name: value'")
    lines = [f"{name}: {value}" for name, value in headers.items()] if isinstance(headers, Mapping) \
        else list(headers or ())
    if not all(isinstance(line, str) and _HEADER.fullmatch(line) for line in lines):
        raise ValueError("headers: give a dict of names and values, or a list of texts 'Name: value'")
    return lines


def in_own_unit(distance: Union[None, float, str], store: Any) -> Union[None, float, str]:
    """A distance with a unit of length, converted to the unit of ``store`` (of _core); other distances unchanged."""
    found = _LENGTH.fullmatch(distance) if isinstance(distance, str) else None
    if not found or found[2] in ("voxel", "voxels"):
        return distance
    return store.world_units(float(found[1]), found[2])


def to_distance(distance: Union[float, str]) -> tuple[float, bool]:
    """The number, and whether its unit is voxels."""
    if not isinstance(distance, str):
        return float(distance), False
    found = _DISTANCE.fullmatch(distance)
    if not found:
        raise ValueError(f"distance={distance!r}: give a number, or a text such as '0.5voxel' or '0.5mm'")
    return float(found[1]), found[2] is not None


def to_point(name: str, point: Point) -> tuple[float, float, float]:
    """The coordinates as floats. Raises ValueError unless there are three."""
    numbers = tuple(float(number) for number in point)
    if len(numbers) != 3:
        raise ValueError(f"{name}={point!r}: give three numbers")
    return numbers  # type: ignore[return-value]


def backwards(numbers: Sequence[Any]) -> tuple[Any, Any, Any]:
    """Reverses the order of the axes: (z, y, x) to (x, y, z) and back."""
    z, y, x = numbers
    return x, y, z


def per_axis(name: str, numbers: Sequence[Any], ndim: int, along_z: Any) -> tuple[Any, Any, Any]:
    """Numbers for the axes of an array with ``ndim`` axes as (x, y, z); ``along_z`` is inserted for two axes."""
    if not hasattr(numbers, "__len__") or len(numbers) != ndim:
        raise ValueError(f"{name}={numbers!r}: give {ndim} numbers, in the order of the array's axes")
    return backwards((along_z, *numbers) if ndim == 2 else numbers)


@contextlib.contextmanager
def reporting(progress: Progress) -> Iterator[Optional[ProgressFunction]]:
    """Yields the function to call with progress, or None. For ``True``, it draws bars with tqdm."""
    if progress is None or progress is False:
        yield None
        return
    if progress is not True:
        if not callable(progress):
            raise TypeError("progress: give a function, or True for bars of tqdm")
        yield progress
        return
    try:
        from tqdm.auto import tqdm
    except ImportError as error:
        raise ImportError("progress=True needs tqdm (Debian: python3-tqdm); or give a function instead") from error
    bar: Any = None
    shown: Optional[str] = None

    def draw(phase: str, done: int, total: int, unit: str) -> None:
        nonlocal bar, shown
        if phase != shown:
            if bar is not None:
                bar.close()
            bar = tqdm(desc=phase, total=total or None, unit=unit if unit == "B" else " " + unit, unit_scale=True)
            shown = phase
        bar.update(done - bar.n)

    try:
        yield draw
    finally:
        if bar is not None:
            bar.close()


def refuse_unknown(function: str, given: Iterable[str], known: Iterable[str], ways: Mapping[str, str]) -> None:
    """Raises TypeError for an unknown keyword of a public function, and suggests an alternative or a similar name."""
    names = list(known)
    for name in given:
        if name not in names:
            near = difflib.get_close_matches(name, names, 1)
            advice = ways.get(name) or (f"did you mean {near[0]}=?" if near else "")
            raise TypeError(f"{function}() got an unexpected keyword argument {name!r}" + (f"; {advice}" if advice else ""))
