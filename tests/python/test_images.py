"""Volumes as objects of xarray, nibabel, SimpleITK, VTK and dask: the values and the place of the file that the library
writes, read by isonest itself or by another library."""
import os
import subprocess
import sys

import numpy as np
import pytest

import isonest
from conftest import ball

SHAPE = (12, 17, 23)
SPACING = (2.0, 1.0, 0.5)
ORIGIN = (30.0, 20.0, 10.0)


@pytest.fixture
def volume():
    rng = np.random.default_rng(3)
    return (ball(SHAPE, 7, spacing=SPACING) + rng.uniform(0, 0.2, SHAPE)).astype(np.float32)


def stored(volume, path, **options):
    isonest.preprocess(volume, path, replace=True, **options)
    return isonest.open(path)


def same_store(ours, theirs):
    """The same values at the same places."""
    np.testing.assert_array_equal(ours.values(), theirs.values())
    assert ours.dtype == theirs.dtype
    np.testing.assert_allclose(ours.spacing, theirs.spacing, rtol=1e-6)
    np.testing.assert_allclose(ours.origin, theirs.origin, rtol=1e-6, atol=1e-6)
    np.testing.assert_allclose(ours.direction, theirs.direction, atol=1e-6)
    assert (ours.unit, ours.frame) == (theirs.unit, theirs.frame)


AFFINES = {
    "spacing": np.diag([0.5, 1, 2, 1]),
    "backward": np.array([[-0.5, 0, 0, 90], [0, 1, 0, -60], [0, 0, 2, 5], [0, 0, 0, 1.0]]),
    "oblique": np.array([[0.4, -0.6, 0, 9], [0.3, 0.8, 0, 7], [0, 0, 2, 5], [0, 0, 0, 1.0]]),
    "left-handed": np.array([[0, 1, 0, 9], [0.5, 0, 0, 7], [0, 0, 2, 5], [0, 0, 0, 1.0]]),
}


@pytest.mark.parametrize("kind", AFFINES)
@pytest.mark.parametrize("way", ["in memory", "from its file", "compressed"])
def test_a_nibabel_image_is_its_file(volume, tmp_path, kind, way):
    nibabel = pytest.importorskip("nibabel")
    image = nibabel.Nifti1Image(volume.T, AFFINES[kind])
    image.header.set_xyzt_units("mm")
    path = tmp_path / ("a.nii.gz" if way == "compressed" else "a.nii")
    nibabel.save(image, path)
    given = image if way == "in memory" else nibabel.load(path)
    ours, theirs = stored(given, tmp_path / "ours"), stored(path, tmp_path / "theirs")
    same_store(ours, theirs)
    assert ours.frame == "RAS" and ours.unit == "mm"
    mesh = isonest.isosurface(given, 0.0, coordinates="world")
    # A vertex lies where the affine puts the values: interpolated at the inverse image, they are the isovalue.
    from scipy.ndimage import map_coordinates
    index = (np.linalg.inv(AFFINES[kind]) @ np.c_[mesh.vertices, np.ones(len(mesh.vertices))].T)[:3]
    np.testing.assert_allclose(map_coordinates(volume.T.astype(float), index, order=1), 0, atol=2e-3)


def test_scaled_numbers_of_nibabel_are_scaled(volume, tmp_path):
    nibabel = pytest.importorskip("nibabel")
    image = nibabel.Nifti1Image(np.round(volume.T * 50).astype(np.int16), np.eye(4))
    image.header.set_slope_inter(0.02, 3)
    nibabel.save(image, tmp_path / "a.nii")
    loaded = nibabel.load(tmp_path / "a.nii")
    np.testing.assert_array_equal(stored(loaded, tmp_path / "x").values(), np.asarray(loaded.dataobj).T)


def test_a_nibabel_image_with_times_is_refused_with_the_way(volume):
    nibabel = pytest.importorskip("nibabel")
    times = nibabel.Nifti1Image(np.stack([volume.T] * 2, axis=-1), np.eye(4))
    with pytest.raises(ValueError, match=r"image\.slicer\[\.\.\., 0\]"):
        isonest.isosurface(times, 0.0)
    assert len(isonest.isosurface(times.slicer[..., :1], 0.0).faces) > 100


def data_array(volume, unit="mm", **more):
    xarray = pytest.importorskip("xarray")
    coords = {name: (name, first + step * np.arange(n), {"units": unit} if unit else {})
              for name, first, step, n in zip(("depth", "row", "column"), ORIGIN, SPACING, volume.shape)}
    return xarray.DataArray(volume, dims=list(coords), coords=coords, **more)


def test_coordinates_of_xarray_are_spacing_origin_and_unit(volume, tmp_path):
    array = data_array(volume)
    ours = stored(array, tmp_path / "x")
    same_store(ours, stored(volume, tmp_path / "y", spacing=SPACING, origin=ORIGIN, unit="mm"))
    same_store(stored(data_array(volume, "K"), tmp_path / "x"), stored(volume, tmp_path / "y", spacing=SPACING, origin=ORIGIN))
    same_store(stored(array, tmp_path / "x", spacing=(1, 1, 1), origin=(0, 0, 0), unit="um"),
               stored(volume, tmp_path / "y", unit="um"))
    plane = stored(array[3], tmp_path / "x")
    assert plane.spacing[1:] == SPACING[1:] and plane.origin[1:] == ORIGIN[1:]


def test_axes_of_xarray_that_run_backward_are_reversed(volume, tmp_path):
    same_store(stored(data_array(volume)[:, ::-1], tmp_path / "x"), stored(data_array(volume), tmp_path / "y"))


def test_axes_of_xarray_called_x_y_z_are_those_of_the_world(volume, tmp_path):
    named = data_array(volume).rename(depth="Z", row="Y", column="X")
    same_store(stored(named.transpose("X", "Z", "Y"), tmp_path / "x"), stored(named, tmp_path / "y"))


def test_a_dataarray_without_coordinates_is_an_array(volume, tmp_path):
    xarray = pytest.importorskip("xarray")
    same_store(stored(xarray.DataArray(volume), tmp_path / "x"), stored(volume, tmp_path / "y"))


def test_unevenly_spaced_coordinates_are_the_places_of_the_nodes(volume, tmp_path):
    array = data_array(volume)
    uneven = stored(array.assign_coords(row=100 - np.arange(17) ** 2.0), tmp_path / "x")
    depth, row, column = uneven.coordinates
    np.testing.assert_array_equal(row, np.sort(100 - np.arange(17) ** 2.0))
    np.testing.assert_allclose(depth, array.depth)
    np.testing.assert_array_equal(uneven.values(), volume[:, ::-1])
    moved = stored(array.assign_coords(row=100 - np.arange(17) ** 2.0), tmp_path / "z", origin=(1, 2, 3))
    np.testing.assert_array_equal(moved.coordinates[1], row - row[0] + 2)
    assert moved.origin == (1, 2, 3)
    even = stored(array, tmp_path / "y")
    np.testing.assert_allclose(even.coordinates[1], array.row)


def test_coordinates_out_of_order_and_containers_are_refused(volume):
    array = data_array(volume)
    with pytest.raises(isonest.Error, match="row.*neither increase nor decrease"):
        isonest.isosurface(array.assign_coords(row=np.arange(17) % 3), 0.0)
    with pytest.raises(ValueError, match=r"\.isel\(\)"):
        isonest.isosurface(array.expand_dims(time=2), 0.0)
    with pytest.raises(TypeError, match=r"a Dataset is no array.*'v', 'w'"):
        isonest.isosurface(array.to_dataset(name="v").assign(w=array), 0.0)


def test_a_dataarray_in_a_file_is_that_of_the_file(volume, tmp_path):
    xarray = pytest.importorskip("xarray")
    pytest.importorskip("netCDF4")
    data_array(volume, name="v").to_netcdf(tmp_path / "v.nc")
    expected = stored(tmp_path / "v.nc", tmp_path / "y")
    with xarray.open_dataarray(tmp_path / "v.nc") as array:
        same_store(stored(array, tmp_path / "x"), expected)
        assert not isinstance(array.variable._data, np.ndarray), "the array was loaded as a whole"
    pytest.importorskip("dask.array")
    with xarray.open_dataarray(tmp_path / "v.nc", chunks={"depth": 5}) as array:
        same_store(stored(array, tmp_path / "x"), expected)


def vtk_image(volume, cells=False):
    vtk = pytest.importorskip("vtkmodules.vtkCommonDataModel")
    from vtkmodules.util.numpy_support import numpy_to_vtk
    image = vtk.vtkImageData()
    image.SetExtent(3, 2 + volume.shape[2] + cells, -4, -5 + volume.shape[1] + cells, 0, volume.shape[0] - 1 + cells)
    image.SetSpacing(SPACING[::-1])
    image.SetOrigin(ORIGIN[::-1])
    image.SetDirectionMatrix([0, -1, 0, 1, 0, 0, 0, 0, 1])
    scalars = numpy_to_vtk(volume.ravel(), deep=1)
    scalars.SetName("v")
    (image.GetCellData() if cells else image.GetPointData()).SetScalars(scalars)
    return image


def test_vtk_image_data_are_their_file(volume, tmp_path):
    image = vtk_image(volume)
    io = pytest.importorskip("vtkmodules.vtkIOXML")
    writer = io.vtkXMLImageDataWriter()
    writer.SetFileName(str(tmp_path / "a.vti"))
    writer.SetInputData(image)
    writer.Write()
    ours = stored(image, tmp_path / "x")
    same_store(ours, stored(tmp_path / "a.vti", tmp_path / "y"))
    first = np.zeros(3)
    image.TransformIndexToPhysicalPoint([3, -4, 0], first)
    np.testing.assert_allclose(ours.origin[::-1], first)
    image.GetPointData().SetActiveScalars(None)
    same_store(stored(image, tmp_path / "x"), ours)


def test_vtk_image_data_without_scalars_of_points_are_refused(volume):
    with pytest.raises(ValueError, match="vtkCellDataToPointData"):
        isonest.isosurface(vtk_image(volume, cells=True), 0.0)


class SimpleImage:
    """The methods of SimpleITK.Image that isonest uses, for where SimpleITK is not installed."""

    def __init__(self, array, spacing, origin, direction):
        self.array, self.place = array, (spacing, origin, direction)

    def GetDimension(self):
        return self.array.ndim

    def GetNumberOfComponentsPerPixel(self):
        return 1

    def GetSpacing(self):
        return self.place[0]

    def GetOrigin(self):
        return self.place[1]

    def GetDirection(self):
        return self.place[2]


TURN = (0.0, -1.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0)


def test_a_simple_itk_image_is_its_file(volume, tmp_path, monkeypatch):
    try:
        import SimpleITK
        image = SimpleITK.GetImageFromArray(volume)
        image.SetSpacing(SPACING[::-1])
        image.SetOrigin(ORIGIN[::-1])
        image.SetDirection(TURN)
    except ImportError:
        image = SimpleImage(volume, SPACING[::-1], ORIGIN[::-1], TURN)
        monkeypatch.setattr(sys.modules[__name__], "GetArrayViewFromImage", lambda image: image.array, raising=False)
    header = (f"ObjectType = Image\nNDims = 3\nBinaryData = True\nBinaryDataByteOrderMSB = False\nTransformMatrix = "
              f"{' '.join(str(TURN[3 * row + column]) for column in range(3) for row in range(3))}\n"
              f"Offset = {' '.join(map(str, ORIGIN[::-1]))}\nAnatomicalOrientation = RAI\n"
              f"ElementSpacing = {' '.join(map(str, SPACING[::-1]))}\n"
              f"DimSize = {' '.join(map(str, SHAPE[::-1]))}\nElementType = MET_FLOAT\nElementDataFile = LOCAL\n")
    (tmp_path / "a.mha").write_bytes(header.encode() + volume.tobytes())
    ours = stored(image, tmp_path / "x")
    same_store(ours, stored(tmp_path / "a.mha", tmp_path / "y"))
    assert ours.frame == "LPS"


def test_a_dask_array_is_read_block_by_block(volume, tmp_path):
    dask = pytest.importorskip("dask.array")
    read = []

    def block(block_info=None):
        place = block_info[None]["array-location"]
        read.append(place)
        return volume[tuple(slice(*one) for one in place)]

    array = dask.map_blocks(block, chunks=((5, 5, 2), (9, 8), (23,)), dtype=np.float32, meta=np.empty((0,) * 3, np.float32))
    read.clear()
    same_store(stored(array, tmp_path / "x"), stored(volume, tmp_path / "y"))
    # Each block once, not all of them at once.
    assert sorted(map(str, read)) == sorted(set(map(str, read))) and len(read) == 6
    np.testing.assert_array_equal(isonest.isosurface(array, 0.0).vertices, isonest.isosurface(volume, 0.0).vertices)


def test_lazy_arrays_need_the_memory_of_a_block(tmp_path):
    pytest.importorskip("dask.array")
    code = """
import resource, sys
import dask.array, numpy, isonest
dask.config.set(scheduler="synchronous")
array = dask.array.ones((400, 320, 320), chunks=(16, 320, 320), dtype="f4") * dask.array.arange(320, dtype="f4")
def most(): return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss // 1024
before = most()
report = isonest.preprocess(array, sys.argv[1], memory="72M", indicators="deviation_bar")
print(most() - before, array.nbytes >> 20, report.max)
"""
    done = subprocess.run([sys.executable, "-c", code, tmp_path / "x"], capture_output=True, text=True, check=True,
                          env={**os.environ, "MALLOC_ARENA_MAX": "1"})
    grown, whole, largest = map(float, done.stdout.split())
    assert largest == 319 and whole == 156
    assert grown < 72 + 40, done.stdout  # memory=, and a few blocks of 6.5 MB in dask


def test_containers_are_refused_with_their_names(volume, tmp_path):
    h5py = pytest.importorskip("h5py")
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file["one"], file["two"] = volume, volume
        with pytest.raises(TypeError, match=r"a File is no array.*'one', 'two'"):
            isonest.isosurface(file, 0.0)
    np.savez(tmp_path / "a.npz", one=volume)
    with np.load(tmp_path / "a.npz") as several, pytest.raises(TypeError, match="'one'"):
        isonest.preprocess(several, tmp_path / "x")
    zarr = pytest.importorskip("zarr")
    group = zarr.group()
    group["level"] = volume
    with pytest.raises(TypeError, match="a Group is no array.*'level'"):
        isonest.isosurface(group, 0.0)


def test_a_tensor_is_converted(volume):
    class Tensor:
        dtype, shape = "torch.float32", volume.shape

        def __getitem__(self, place):
            raise AssertionError("its slices are not read")

        def __array__(self, *_, **__):
            return volume

    np.testing.assert_array_equal(isonest.isosurface(Tensor(), 0.0).vertices, isonest.isosurface(volume, 0.0).vertices)


def test_smoothing_takes_images(volume):
    nibabel = pytest.importorskip("nibabel")
    options = {"steps": 1, "tau": 0.1, "lambda_": 1.0}
    image = nibabel.Nifti1Image(volume.T, np.diag([0.5, 1, 2, 1]))
    np.testing.assert_array_equal(isonest.smooth(image, **options).values,
                                  isonest.smooth(volume, spacing=SPACING, **options).values)


def test_no_library_is_imported_for_an_array():
    code = "import sys, numpy, isonest; isonest.isosurface(numpy.eye(5)[None] + numpy.zeros((5, 1, 1)), 0.5);" \
           "print({'xarray', 'nibabel', 'SimpleITK', 'vtkmodules', 'pyvista', 'dask', 'zarr'} & set(sys.modules))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "set()"
