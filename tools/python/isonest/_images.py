"""Volumes as objects of xarray, nibabel, SimpleITK, VTK and PyVista: their numbers, and their place in the world.

None of these packages is imported: objects are recognised by their attributes. Each is placed as isonest places the
package's files.
"""
from __future__ import annotations

import sys
from typing import Any, NamedTuple, Optional, Sequence, Tuple

import numpy as np

from . import _core
from ._arguments import backwards
from ._frame import ALONG_WORLD, Directions

_Vector = Tuple[float, float, float]


class Image(NamedTuple):
    """The values of a volume, and what is known about its place in the world."""

    values: Any
    """An array, or an object with shape, dtype and slices."""
    spacing: Optional[Sequence[float]] = None
    """Per axis of the array."""
    origin: Optional[Sequence[float]] = None
    """In the order of the array's axes."""
    direction: Directions = ALONG_WORLD
    unit: Optional[str] = None
    frame: Optional[str] = None
    uneven: Sequence[Sequence[float]] = ((), (), ())
    """Coordinates of the nodes along x, y and z; empty for axes with even steps."""

    def every(self, step: int) -> "Image":
        """Every ``step``-th node along each axis, at its place."""
        spacing = self.spacing if self.spacing is not None else (1.0,) * len(self.values.shape)
        return self._replace(values=rearranged(self.values, steps=(step,) * len(self.values.shape)),
                             spacing=[step * length for length in spacing],
                             uneven=[_if_several(sorted(numbers)[::step]) for numbers in self.uneven])


def _if_several(numbers: Sequence[float]) -> Sequence[float]:
    """A single node has no distances; its place is the image's origin."""
    return numbers if len(numbers) > 1 else ()


class Rearranged:
    """An array with reversed order of axes, steps and directions, without copying it.

    ``steps``: per axis of the result, 1, 2, ..., or -1 for an axis that runs backward.
    """

    def __init__(self, array: Any, *, transposed: bool = False, steps: Optional[Sequence[int]] = None) -> None:
        self._array = array
        self._transposed = transposed
        shape = tuple(array.shape)[::-1] if transposed else tuple(array.shape)
        self._lengths = shape
        self._steps = tuple(steps) if steps is not None else (1,) * len(shape)
        self.shape = tuple(-(-n // abs(step)) for n, step in zip(shape, self._steps))
        self.dtype = array.dtype
        self.is_masked = is_masked(array)
        chunks = getattr(array, "chunks", None)
        if isinstance(chunks, tuple) and len(chunks) == len(shape):
            longest = [int(np.max(lengths)) for lengths in chunks]
            self.chunks = tuple(max(1, length // abs(step)) for length, step in
                                zip(longest[::-1] if transposed else longest, self._steps))

    def __getitem__(self, places: "tuple[slice, ...]") -> Any:
        forward, flips = [], []
        for place, n, count, step in zip(places, self._lengths, self.shape, self._steps):
            start, stop, _ = place.indices(count)
            forward.append(slice(n - stop, n - start) if step < 0 else
                           slice(start * step, (stop - 1) * step + 1, step))
            flips.append(slice(None, None, -1 if step < 0 else 1))
        part = self._array[tuple(forward[::-1] if self._transposed else forward)]
        return (part.T if self._transposed else part)[tuple(flips)]


def rearranged(array: Any, *, transposed: bool = False, steps: Optional[Sequence[int]] = None) -> Any:
    """A view of a NumPy array; for other objects one that reads slices when asked."""
    if isinstance(array, np.ndarray):
        turned = array.T if transposed else array
        return turned[tuple(slice(None, None, step) for step in steps)] if steps is not None else turned
    return Rearranged(array, transposed=transposed, steps=steps)


def is_masked(volume: Any) -> bool:
    """Whether slices are masked arrays."""
    return isinstance(volume, np.ma.MaskedArray) or getattr(volume, "is_masked", False) is True


class Masked:
    """An array that has values only where a mask is True; ``volume[...]`` is a masked array."""

    is_masked = True

    def __init__(self, array: Any, mask: Any) -> None:
        if tuple(np.shape(mask)) != tuple(array.shape):
            raise ValueError(f"mask= of shape {tuple(np.shape(mask))}: give one of the volume's shape, {tuple(array.shape)}")
        self._array, self._mask = array, mask if hasattr(mask, "dtype") else np.asarray(mask, bool)
        self.shape, self.dtype = tuple(array.shape), array.dtype
        if getattr(array, "chunks", None) is not None:
            self.chunks = array.chunks

    def __getitem__(self, places: Any) -> np.ma.MaskedArray:
        part = self._array[places]
        part = part if isinstance(part, np.ma.MaskedArray) else np.asarray(part)
        return np.ma.masked_array(part, ~np.asarray(self._mask[places], bool))


def image_of(volume: Any) -> Image:
    """The numbers and the place of a volume of any library. Raises ValueError, TypeError if it is no scalar volume."""
    if isinstance(volume, Image):
        return volume
    for is_one, convert in _LIBRARIES:
        if is_one(volume):
            return convert(volume)
    _refuse_containers(volume)
    if not (hasattr(volume, "shape") and hasattr(volume, "__getitem__") and hasattr(volume, "dtype")):
        return Image(np.asarray(volume))
    try:
        np.dtype(volume.dtype)
    except TypeError:  # dtype of another library, such as a tensor's
        return Image(np.asarray(volume))
    return Image(volume)


def is_image(volume: Any) -> bool:
    """Whether this is an object with a place, rather than an array."""
    return any(is_one(volume) for is_one, _ in _LIBRARIES)


def _has(volume: Any, *names: str) -> bool:
    # Look at the type, so that no property is evaluated.
    return all(hasattr(type(volume), name) or name in getattr(volume, "__dict__", ()) for name in names)


def _refuse_containers(volume: Any) -> None:
    """Raises TypeError for a collection of arrays, such as an xarray.Dataset, an h5py.Group or a zarr.Group."""
    if _has(volume, "keys", "__getitem__") and not _has(volume, "shape"):
        names = ", ".join(repr(str(name)) for name in list(getattr(volume, "data_vars", volume).keys())[:20])
        raise TypeError(f"a {type(volume).__name__} is no array: give one of its arrays, volume[name]; the names are "
                        f"{names or 'none'}")


def _placed(values: Any, steps: Sequence[Sequence[float]], first: Sequence[float], unit: Optional[str],
            frame: Optional[str], name: str) -> Image:
    """``steps``: world vectors (x, y, z) from node to node along the axes x, y, z; ``first``: the first node."""
    ndim = len(values.shape)
    if ndim not in (2, 3):
        raise ValueError(f"{name} of shape {tuple(values.shape)}: give one with three axes, or two for data in a plane")
    nodes = backwards((1, *values.shape) if ndim == 2 else values.shape)
    spacing, origin, direction, reverse = _core.place_of_steps(nodes, steps, first, name)
    if any(reverse):
        values = rearranged(values, steps=[-1 if back else 1 for back in backwards(reverse)][-ndim:])
    rows = tuple((float(x), float(y), float(z)) for x, y, z in direction)
    return Image(values, backwards(spacing)[-ndim:], backwards(origin)[-ndim:], rows,  # type: ignore[arg-type]
                 unit, frame)


def _of_xarray(volume: Any) -> Image:
    names = [str(name) for name in volume.dims]
    if len(names) == 3 and sorted(name.lower() for name in names) == ["x", "y", "z"]:
        volume = volume.transpose(*sorted(volume.dims, key=lambda name: str(name).lower(), reverse=True))
        names = [str(name) for name in volume.dims]
    held = getattr(volume.variable, "_data", None)
    values = held if isinstance(held, np.ndarray) or _has(held, "dask") else _Values(volume)
    axes = [_coordinates(volume, name) for name in volume.dims]
    ndim = len(axes)
    if ndim not in (2, 3):
        raise ValueError(f"a DataArray with the dimensions {', '.join(names)}: choose positions with .isel() until there are "
                         "three, or two for data in a plane")
    shape = tuple(volume.shape)
    nodes = backwards((1, *shape) if ndim == 2 else shape)
    step, first, unit, uneven = _core.place_of_coordinates(nodes, backwards((None, *axes) if ndim == 2 else axes),
                                                   f"array {volume.name!r}" if volume.name is not None else "array")
    return _placed(values, np.diag(step).tolist(), first, unit, None, "a DataArray")._replace(uneven=uneven)


class _Values:
    """The slices of a DataArray, read from its file when asked."""

    def __init__(self, volume: Any) -> None:
        self._volume = volume
        self.shape, self.dtype, self.chunks = tuple(volume.shape), volume.dtype, volume.chunks

    def __getitem__(self, places: Any) -> np.ndarray:
        return np.asarray(self._volume[places])


def _coordinates(volume: Any, dim: Any) -> "Optional[tuple[str, list[float], str]]":
    """Name, numbers and unit of a dimension's coordinate; None if it has none, or if it is not a number."""
    if dim not in volume.coords:
        return None
    coordinate = volume.coords[dim]
    numbers = np.asarray(coordinate.values)
    if numbers.ndim != 1 or numbers.dtype.kind not in "iuf":
        return None
    attributes = coordinate.attrs
    unit = attributes.get("units", attributes.get("unit", ""))
    return str(dim), [float(number) for number in numbers], str(unit)


_NIFTI_UNITS = {"meter": "m", "mm": "mm", "micron": "um"}


def _of_nibabel(volume: Any) -> Image:
    data = volume.dataobj
    if len(data.shape) > 3 and all(n == 1 for n in data.shape[3:]):
        data = _Values4(data)
    if len(data.shape) != 3:
        raise ValueError(f"a nibabel image of shape {tuple(data.shape)}: choose one volume, image.slicer[..., 0]")
    if not isinstance(data, np.ndarray):
        data = _Scaled(data)
    header = volume.header
    unit = _NIFTI_UNITS.get(header.get_xyzt_units()[0]) if _has(header, "get_xyzt_units") else None
    # The affine that nibabel makes up for a NIfTI file without one is not used.
    known = not _has(header, "get_sform") or int(header["sform_code"]) > 0 or int(header["qform_code"]) > 0
    affine = np.diag([*header.get_zooms()[:3], 1.0])
    if known and volume.affine is not None:
        affine = np.asarray(volume.affine, float)
    return _placed(rearranged(data, transposed=True), affine[:3, :3].T.tolist(), affine[:3, 3].tolist(), unit,
                   "RAS" if known else None, "a nibabel image")


class _Values4:
    """An array whose axes after the third have one position, without these axes."""

    def __init__(self, array: Any) -> None:
        self._array = array
        self.shape, self.dtype = tuple(array.shape)[:3], getattr(array, "dtype", None)

    def __getitem__(self, places: Any) -> np.ndarray:
        part = np.asarray(self._array[tuple(places) + (slice(None),) * (len(self._array.shape) - 3)])
        return part.reshape(part.shape[:3])


class _Scaled:
    """Slices of a file's numbers as nibabel scales them; the type is that of its results, not that in the file."""

    def __init__(self, array: Any) -> None:
        self._array = array
        self.shape = tuple(array.shape)
        self.dtype = np.asarray(array[:1, :1, :1]).dtype

    def __getitem__(self, places: Any) -> np.ndarray:
        return np.asarray(self._array[places])


def _of_simple_itk(volume: Any) -> Image:
    ndim = volume.GetDimension()
    if ndim not in (2, 3) or volume.GetNumberOfComponentsPerPixel() != 1:
        raise ValueError("a SimpleITK image that is no scalar volume: extract one, with SimpleITK.Extract or "
                         "SimpleITK.VectorIndexSelectionCast")
    values = sys.modules[type(volume).__module__.partition(".")[0]].GetArrayViewFromImage(volume)
    columns = np.eye(3)
    columns[:ndim, :ndim] = np.reshape(volume.GetDirection(), (ndim, ndim))
    lengths, first = np.ones(3), np.zeros(3)
    lengths[:ndim], first[:ndim] = volume.GetSpacing(), volume.GetOrigin()
    return _placed(values, (columns * lengths).T.tolist(), first.tolist(), None, "LPS" if ndim == 3 else None,
                   "a SimpleITK image")


def _of_vtk(volume: Any) -> Image:
    from vtkmodules.util.numpy_support import vtk_to_numpy

    data = volume.GetPointData()
    scalars = data.GetScalars() or (data.GetArray(0) if data.GetNumberOfArrays() == 1 else None)
    if scalars is None or scalars.GetNumberOfComponents() != 1:
        names = [data.GetArrayName(i) for i in range(data.GetNumberOfArrays())]
        problem = f"choose an array of points as its scalars, GetPointData().SetActiveScalars(name): {names}" if names \
            else "its points have no numbers; vtkCellDataToPointData moves those of cells to points"
        raise ValueError(f"a {type(volume).__name__} without scalars: {problem}")
    shape = volume.GetDimensions()[::-1]
    values = vtk_to_numpy(scalars).reshape(shape)
    matrix = volume.GetDirectionMatrix()
    columns = np.array([[matrix.GetElement(row, column) for column in range(3)] for row in range(3)])
    steps = (columns * np.array(volume.GetSpacing())).T
    first = np.array(volume.GetOrigin()) + np.array(volume.GetExtent()[::2]) @ steps
    return _placed(values, steps.tolist(), first.tolist(), None, None, f"a {type(volume).__name__}")


_LIBRARIES = (
    (lambda v: _has(v, "dims", "coords", "variable", "transpose"), _of_xarray),
    (lambda v: _has(v, "dataobj", "affine", "header"), _of_nibabel),
    (lambda v: _has(v, "GetDirection", "GetSpacing", "GetNumberOfComponentsPerPixel"), _of_simple_itk),
    (lambda v: _has(v, "GetDirectionMatrix", "GetExtent", "GetPointData"), _of_vtk),
)
