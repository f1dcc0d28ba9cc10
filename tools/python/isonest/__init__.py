"""Isosurfaces and slices from volumes of any size, with an error that you choose and that is kept.

    isonest.preprocess(array, "x.isonest")
    store = isonest.open("x.isonest")
    vertices, faces, normals, values = store.isosurface(120, error=5)

Arrays are [z, y, x], as scikit-image has them, and so are the coordinates of meshes unless
``coordinates="world"`` asks for (x, y, z).
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
from ._smooth import Smoothed, smooth
from ._store import Histogram, Label, Store, Study
from ._view import View
from ._volume import isosurface, preprocess

__version__ = _core.version
__all__ = ["preprocess", "open", "view", "isosurface", "smooth", "Store", "View", "Mesh", "Histogram", "Label", "Study",
           "StudyRow", "Smoothed", "SmoothStep", "CheckReport", "Finding", "Analysis", "StoredArray", "Report",
           "PreprocessReport", "TriangleQuality", "Error", "InvalidArgumentError", "NotFoundError", "CorruptError",
           "UnsupportedError", "InputOutputError", "LimitError", "MemoryLimitError", "CancelledError"]


def open(path: "os.PathLike[str] | str", *, headers: Headers = None,
         cache: "os.PathLike[str] | str | None" = None, memory: Bytes = "64M") -> Store:
    """Opens a store, a file or a URL (https://, http://, s3://bucket/key). A file is mapped, not read: only what is
    asked for is read from it. Of an object at a URL only what is asked for is fetched.

    Of a store at a URL: headers are sent with each request, to its own server alone. cache: a folder that keeps what
    was fetched for other runs, "FOLDER:SIZE" with its largest size (else 1G). memory: bytes of what was fetched that
    are kept, beside the memory of queries. :attr:`Store.fetched` says what was fetched. Of a file, none of these
    three is used.
    """
    return Store(path, headers=headers, cache=cache, memory=memory)


def view(path: "os.PathLike[str] | str", *, headers: Headers = None,
         cache: "os.PathLike[str] | str | None" = None, port: int = 0, memory: Bytes = "1G", threads: int = 0,
         open: Optional[bool] = None, height: int = 600, program: "os.PathLike[str] | str | None" = None) -> View:
    """Shows a store in a window of the browser; the arguments are those of :func:`open` and :meth:`Store.view`."""
    with Store(path, headers=headers, cache=cache) as store:
        return store.view(port=port, memory=memory, threads=threads, open=open, height=height, program=program)
