"""Meshes as objects of VTK, meshio and trimesh: the same triangles, in world coordinates, facing outward."""
import gc
import sys
import types

import numpy as np
import pytest

import isonest
from conftest import area, ball, signed_volume

SPACING = (2.0, 1.0, 0.5)
ORIGIN = (30.0, 20.0, 10.0)


@pytest.fixture
def store(store_path):
    isonest.preprocess(ball((16, 30, 60), 12, spacing=SPACING), store_path, spacing=SPACING, origin=ORIGIN)
    return isonest.open(store_path)


def vtk_arrays(data):
    from vtkmodules.util.numpy_support import vtk_to_numpy
    return vtk_to_numpy(data.GetPoints().GetData()), vtk_to_numpy(data.GetPolys().GetConnectivityArray()).reshape(-1, 3)


@pytest.mark.parametrize("direction, sign", [("descent", 1), ("ascent", -1)])
def test_vtk(store, direction, sign):
    pytest.importorskip("vtkmodules.vtkFiltersCore")
    from vtkmodules.util.numpy_support import vtk_to_numpy
    from vtkmodules.vtkFiltersCore import vtkMassProperties
    mesh = store.isosurface(0.0, gradient_direction=direction, vertex_values=store)
    data = mesh.to_vtk()
    points, corners = vtk_arrays(data)
    world = mesh.in_world()
    np.testing.assert_array_equal(points, world.vertices)
    np.testing.assert_array_equal(corners, mesh.faces)
    np.testing.assert_array_equal(vtk_to_numpy(data.GetPointData().GetNormals()), world.normals)
    np.testing.assert_array_equal(vtk_to_numpy(data.GetPointData().GetScalars()), mesh.values)
    assert points.__array_interface__["data"] == world.vertices.__array_interface__["data"]
    assert sign * signed_volume(points, corners) == pytest.approx(4 / 3 * np.pi * 12**3, rel=0.02)
    measured = vtkMassProperties()
    measured.SetInputData(data)
    measured.Update()
    assert measured.GetSurfaceArea() == pytest.approx(area(mesh.vertices, mesh.faces), rel=1e-5)


def test_vtk_objects_keep_the_memory_alive(store):
    pytest.importorskip("vtkmodules.vtkFiltersCore")
    mesh = store.isosurface(0.0, vertex_values=store)
    from vtkmodules.vtkCommonDataModel import vtkPolyData
    before = [array.copy() for array in vtk_arrays(mesh.to_vtk())]
    data = vtkPolyData()
    data.ShallowCopy(mesh.to_vtk())
    del mesh
    gc.collect()
    _ = [np.full(before[0].size, 7, np.float32) for _ in range(20)]
    for old, new in zip(before, vtk_arrays(data)):
        np.testing.assert_array_equal(old, new)


def test_vtk_has_the_same_surface(store):
    """The migration table's example: vtkFlyingEdges3D, and the replacement by this package."""
    filters = pytest.importorskip("vtkmodules.vtkFiltersCore")
    from vtkmodules.util.numpy_support import numpy_to_vtk
    from vtkmodules.vtkCommonDataModel import vtkImageData
    volume = store.values()
    image = vtkImageData()
    image.SetDimensions(volume.shape[::-1])
    image.SetSpacing(SPACING[::-1])
    image.SetOrigin(ORIGIN[::-1])
    image.GetPointData().SetScalars(numpy_to_vtk(volume.ravel()))
    edges = filters.vtkFlyingEdges3D()
    edges.SetInputData(image)
    edges.SetValue(0, 0.0)
    edges.Update()
    theirs = vtk_arrays(edges.GetOutput())
    ours = vtk_arrays(store.isosurface(0.0, cells="hexahedra").to_vtk())
    assert len(ours[1]) == len(theirs[1])
    np.testing.assert_allclose(np.sort(ours[0].round(3), 0), np.sort(theirs[0].round(3), 0), atol=2e-3)
    assert area(*ours) == pytest.approx(area(*theirs), rel=1e-3)


def test_meshio(store, tmp_path):
    meshio = pytest.importorskip("meshio")
    mesh = store.slice((1, 0, 0), 14.0)
    mesh.to_meshio().write(tmp_path / "a.vtu")
    back = meshio.read(tmp_path / "a.vtu")
    np.testing.assert_array_equal(back.points, mesh.in_world().vertices)
    np.testing.assert_array_equal(back.cells[0].data, mesh.faces)
    np.testing.assert_array_equal(back.point_data["value"], mesh.values)


def test_lines(tmp_path, monkeypatch):
    isonest.preprocess(ball((30, 40), 10), tmp_path / "x")
    lines = isonest.open(tmp_path / "x").isosurface(0.0, normals=False)
    pytest.importorskip("vtkmodules.vtkFiltersCore")
    assert lines.to_vtk().GetNumberOfLines() == len(lines.faces)
    pytest.importorskip("meshio")
    assert lines.to_meshio().cells[0].type == "line"
    monkeypatch.setitem(sys.modules, "trimesh", types.SimpleNamespace())
    with pytest.raises(ValueError, match="lines"):
        lines.to_trimesh()


def test_trimesh(store, monkeypatch):
    """With trimesh if it is installed; otherwise with an object that takes the same arguments."""
    try:
        import trimesh  # noqa: F401
    except ImportError:
        def taken(vertices, faces, vertex_normals, vertex_attributes, process):
            assert process is False and set(vertex_attributes) == {"value"} and len(vertex_normals) == len(vertices)
            return types.SimpleNamespace(vertices=vertices, faces=faces, volume=signed_volume(vertices, faces))
        monkeypatch.setitem(sys.modules, "trimesh", types.SimpleNamespace(Trimesh=taken))
    mesh = store.isosurface(0.0, vertex_values=store)
    other = mesh.to_trimesh()
    np.testing.assert_array_equal(other.vertices, mesh.in_world().vertices)
    np.testing.assert_array_equal(other.faces, mesh.faces)
    assert other.volume == pytest.approx(4 / 3 * np.pi * 12**3, rel=0.02)
