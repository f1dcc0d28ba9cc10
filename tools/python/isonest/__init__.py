"""Isosurfaces and slices from volumes of any size, within an error bound that you choose.

    isonest.preprocess(array, "x.isonest")
    store = isonest.open("x.isonest")
    vertices, faces, normals, values = store.isosurface(120, error=5)

The axes of arrays and the coordinates of meshes are in the order (z, y, x), as in scikit-image;
``coordinates="world"`` selects (x, y, z).
"""
from __future__ import annotations

import os
from typing import Optional

from . import _core
from ._arguments import Bytes, Headers
from ._core import (Analysis, CheckReport, Finding, PreprocessReport, Report, SmoothStep, StoredArray, StudyRow,
                    TriangleQuality)
from ._errors import (CancelledError, CorruptError, Error, InputOutputError, InvalidArgumentError, LimitError,
                      MemoryLimitError, NotFoundError, UnsupportedError)
from ._mesh import Mesh
from ._own import RefinementNodes
from ._series import Series
from ._smooth import Smoothed, smooth
from ._store import Histogram, Label, Store, Study
from ._view import View
from ._volume import isosurface, preprocess

__version__ = _core.version
__all__ = ["preprocess", "RefinementNodes", "open", "open_series", "view", "isosurface", "smooth", "Store", "Series", "View", "Mesh", "Histogram", "Label", "Study",
           "StudyRow", "Smoothed", "SmoothStep", "CheckReport", "Finding", "Analysis", "StoredArray", "Report",
           "PreprocessReport", "TriangleQuality", "Error", "InvalidArgumentError", "NotFoundError", "CorruptError",
           "UnsupportedError", "InputOutputError", "LimitError", "MemoryLimitError", "CancelledError"]


def open(path: "os.PathLike[str] | str", *, headers: Headers = None,
         cache: "os.PathLike[str] | str | None" = None, memory: Bytes = "64M") -> Store:
    """Opens a store in a file or at a URL (https://, http://, s3://bucket/key).

    A file is memory-mapped; from a URL, only the data needed are fetched. The keyword arguments apply to URLs and are
    ignored for files:

    headers: sent with each request, but only to the store's own server.
    cache: a folder that keeps fetched data for later runs; "FOLDER:SIZE" limits its size (default 1G).
    memory: bytes of fetched data kept in memory, in addition to the memory of queries.

    :attr:`Store.fetched` counts what was fetched. Raises subclasses of :class:`isonest.Error`.
    """
    return Store(path, headers=headers, cache=cache, memory=memory)


def open_series(path: "os.PathLike[str] | str") -> Series:
    """Opens the folder of a series, which `isonest preprocess --times` makes: a store for each step in time.

    ``series[3]`` and ``series.at(0.5)`` open a store, iterating over the series opens one store after the other, and
    ``series.times`` has the times. Steps that are added later are seen by opening the series again. Raises subclasses of
    :class:`isonest.Error`.
    """
    return Series(path)


def view(path: "os.PathLike[str] | str", *, headers: Headers = None,
         cache: "os.PathLike[str] | str | None" = None, port: int = 0, memory: Bytes = "1G", threads: int = 0,
         open: Optional[bool] = None, height: int = 600, program: "os.PathLike[str] | str | None" = None) -> View:
    """Shows a store in the browser. The arguments are those of :func:`open` and :meth:`Store.view`."""
    with Store(path, headers=headers, cache=cache) as store:
        return store.view(port=port, memory=memory, threads=threads, open=open, height=height, program=program)
