"""Series: one store for each step in time."""
from __future__ import annotations

import os
import pathlib
from typing import Iterator, Optional, Union, overload

import numpy as np

from . import _core, _errors
from ._store import Store


class Series:
    """The stores of a series, in the order of their times; see :func:`isonest.open_series`. Thread-safe."""

    def __init__(self, path: "os.PathLike[str] | str") -> None:
        self._core = _core.Series(os.fspath(path))

    @property
    def path(self) -> pathlib.Path:
        """The folder."""
        return self._core.path

    @property
    def times(self) -> np.ndarray:
        """(n,) float64: the times, ascending."""
        return np.array(self._core.times, np.float64)

    @property
    def time_unit(self) -> Optional[str]:
        """The unit of the times as the input spells it, such as "s" or "hours since 2020-01-01"; None if unknown."""
        return self._core.time_unit

    @property
    def stores(self) -> "list[pathlib.Path]":
        """The files of the stores."""
        return self._core.stores

    def __len__(self) -> int:
        return len(self._core.times)

    @overload
    def __getitem__(self, step: int) -> Store: ...
    @overload
    def __getitem__(self, step: slice) -> "list[Store]": ...

    def __getitem__(self, step: Union[int, slice]) -> "Union[Store, list[Store]]":
        """Opens the store of a step, or of several. Negative numbers count from the end."""
        stores = self._core.stores
        return [Store(path) for path in stores[step]] if isinstance(step, slice) else Store(stores[step])

    def __iter__(self) -> Iterator[Store]:
        return (Store(path) for path in self._core.stores)

    def at(self, time: float) -> Store:
        """Opens the store of the step at this time. If there is none, raises :class:`isonest.NotFoundError`, which names the
        nearest time."""
        times = self.times
        nearest = int(np.argmin(np.abs(times - time))) if len(times) else 0
        slack = min([1e-9 * abs(time), *(1e-3 * np.diff(times))])  # far less than the distance between steps
        if not len(times) or not abs(times[nearest] - time) <= slack:
            raise _errors.made(_errors.NotFoundError, str(self.path), f"there is no step at {time}" +
                               (f"; the nearest is at {times[nearest]}" if len(times) else ""), [])
        return self[nearest]

    def __repr__(self) -> str:
        times = self.times
        between = f", times {times[0]} to {times[-1]}" if len(times) else ""
        return f"<isonest.Series {str(self.path)!r}: {len(times)} steps{between}>"

    def __reduce__(self) -> "tuple[type[Series], tuple[str]]":
        return Series, (str(self.path),)
