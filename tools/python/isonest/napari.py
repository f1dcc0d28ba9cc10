"""Stores as layers of napari, and the reader that napari.yaml names. Needs no napari: layers are tuples.

Source of the interface: https://napari.org/stable/plugins/building_a_plugin/guides.html#readers
"""
from __future__ import annotations

import math
import os
from typing import Any, Callable, Optional, Sequence, Union, cast

import numpy as np

from . import open as open_store
from ._frame import ALONG_WORLD
from ._mesh import Mesh
from ._store import Store

_Path = Union[str, "os.PathLike[str]"]

# In three dimensions napari shows only the coarsest level. This is its maximum number of nodes, about 256^3.
_MAX_NODES_IN_3D = 2**24


class Level:
    """A level of a store that looks like an array: an index reads what it selects. Data in a plane have two axes."""

    def __init__(self, store: Store, level: int) -> None:
        self._store, self._level = store, level
        shape = store.level_shape(level)
        self._is_plane = store.shape[0] == 1
        self.shape: "tuple[int, ...]" = shape[1:] if self._is_plane else shape
        self.dtype: np.dtype = store.dtype

    @property
    def ndim(self) -> int:
        return len(self.shape)

    @property
    def size(self) -> int:
        return math.prod(self.shape)

    def __len__(self) -> int:
        return self.shape[0]

    def __array__(self, dtype: Any = None, copy: Optional[bool] = None) -> np.ndarray:
        if copy is False:
            raise ValueError("the values of a store are always copied")
        values = self[...]
        return values if dtype is None else values.astype(dtype, copy=False)

    def __getitem__(self, index: Any) -> np.ndarray:
        places = list(index) if isinstance(index, tuple) else [index]
        if any(place is Ellipsis for place in places):
            at = next(i for i, place in enumerate(places) if place is Ellipsis)
            places[at:at + 1] = [slice(None)] * (self.ndim - len(places) + 1)
        places += [slice(None)] * (self.ndim - len(places))
        if len(places) > self.ndim or not all(isinstance(place, (slice, int, np.integer)) for place in places):
            return np.asarray(self)[index]  # lists and masks: NumPy interprets or refuses them
        read: "list[Union[slice, int]]" = [0] if self._is_plane else []
        then: "list[slice]" = []
        for place, length in zip(places, self.shape):
            if not isinstance(place, slice):
                read.append(range(length)[place])
                continue
            chosen = range(length)[place]
            first, last = (min(chosen), max(chosen)) if chosen else (0, -1)
            read.append(slice(first, last + 1))
            then.append(slice(None, None, chosen.step))
        return self._store.values(self._level, read)[tuple(then)]


def _placement(store: Store) -> "dict[str, Any]":
    """The transformation from indices of the finest level to the world, in the order (z, y, x)."""
    store.require_even_axes("a layer of napari")
    plane = slice(1, 3) if store.shape[0] == 1 else slice(0, 3)
    if store.direction == ALONG_WORLD or store.shape[0] == 1:
        return {"scale": store.spacing[plane], "translate": store.origin[plane]}
    affine = np.eye(4)
    affine[:3, :3] = (np.array(store.direction).T * store.spacing[::-1])[::-1, ::-1]
    affine[:3, 3] = store.origin
    return {"affine": affine}


def layers(store: Union[Store, _Path], *, kind: Optional[str] = None) -> "list[tuple[Any, dict[str, Any], str]]":
    """The volume as a list with one layer tuple of napari, in world coordinates (z, y, x).

    Levels are read when they are shown. napari shows the coarsest one in three dimensions; it has at most 2**24 nodes.

    kind: "image" or "labels". None: "labels" if the store has 64-bit labels or names of labels.

    Raises what :func:`isonest.open` raises, and ValueError for another kind.
    """
    if not isinstance(store, Store):
        store = open_store(store)
    if kind not in (None, "image", "labels"):
        raise ValueError(f"kind={kind!r}: give 'image' or 'labels'")
    names = dict(_names_of(store))
    if kind is None:
        kind = "labels" if names or store.dtype == np.int64 else "image"
    levels = [Level(store, 0)]
    while levels[-1].size > _MAX_NODES_IN_3D and len(levels) < store.levels:
        levels.append(Level(store, len(levels)))
    about: "dict[str, Any]" = {
        "name": os.path.splitext(os.path.basename(str(store.path)))[0],
        "multiscale": len(levels) > 1,
        "metadata": {"unit": store.unit, "frame": store.frame, "tolerance": store.tolerance, "label_names": names},
        **_placement(store),
    }
    if kind == "image" and store.range is not None and store.range[0] < store.range[1]:
        about["contrast_limits"] = store.range
    return [(levels if len(levels) > 1 else levels[0], about, kind)]


def _names_of(store: Store) -> "list[tuple[int, str]]":
    return [(label, name) for label, name, _ in store._core.label_names() if name is not None]


def surface_layer(store: Union[Store, _Path], iso: float, **options: Any) -> "tuple[Any, dict[str, Any], str]":
    """A surface as a layer tuple of napari, in the same world coordinates as :func:`layers`.

    options: those of :meth:`isonest.Store.isosurface`, such as ``distance="0.5voxel"``. The report, with the proven
    bounds, is in the layer's metadata.
    """
    if not isinstance(store, Store):
        store = open_store(store)
    given: "dict[str, Any]" = {"normals": False, **options, "coordinates": "world"}
    mesh = cast(Mesh, store.isosurface(iso, **given))
    if mesh.faces.shape[1] != 3:
        raise ValueError("data in a plane have isolines and no surface")
    about = {"name": f"{os.path.splitext(os.path.basename(str(store.path)))[0]} = {iso:g}",
             "metadata": {"unit": store.unit, "frame": store.frame, "report": mesh.report}}
    return (mesh.vertices[:, ::-1], mesh.faces, mesh.values.astype(np.float32)), about, "surface"


def napari_get_reader(path: "Union[_Path, Sequence[_Path]]") -> "Optional[Callable[[Any], list[tuple[Any, dict[str, Any], str]]]]":
    """The reader of napari's plugin: a function that returns layer tuples, or None if this is not a store."""
    paths = [path] if isinstance(path, (str, os.PathLike)) else list(path)
    if not paths or not all(os.fspath(one).endswith(".isonest") for one in paths):
        return None

    def read(given: "Union[_Path, Sequence[_Path]]") -> "list[tuple[Any, dict[str, Any], str]]":
        return [layer for one in ([given] if isinstance(given, (str, os.PathLike)) else given) for layer in layers(one)]

    return read
