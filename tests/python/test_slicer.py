"""tools/slicer: what the module of 3D Slicer makes of a store, without Slicer, which was not run."""
import importlib.util
import pathlib
import sys
import types

import numpy as np
import pytest

import isonest
from conftest import signed_volume

pytest.importorskip("vtkmodules.vtkCommonDataModel")
from vtkmodules.util.numpy_support import vtk_to_numpy  # noqa: E402

MODULE = pathlib.Path(__file__).resolve().parents[2] / "tools/slicer/IsonestExtract.py"


def loaded():
    spec = importlib.util.spec_from_file_location("IsonestExtract", MODULE)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture
def module():
    return loaded()


def nrrd_store(folder, values, space, unit=None):
    """A store of a volume turned by a quarter around z; steps 0.5, 1 and 2 along x, y and z."""
    header = (f"NRRD0005\ntype: float\ndimension: 3\nspace: {space}\nsizes: {' '.join(map(str, values.shape[::-1]))}\n"
              "space directions: (0,0.5,0) (-1,0,0) (0,0,2)\nspace origin: (10,20,30)\nencoding: raw\nendian: little\n\n")
    (folder / "v.nrrd").write_bytes(header.encode() + values.astype("<f4").tobytes())
    isonest.preprocess(folder / "v.nrrd", folder / "v.isonest", unit=unit, replace=True)
    return isonest.open(folder / "v.isonest")


def world_of(i, j, k):
    return np.array([10 - 1.0 * j, 20 + 0.5 * i, 30 + 2.0 * k])


@pytest.mark.parametrize("space, signs", [("right-anterior-superior", (1, 1, 1)), ("left-posterior-superior", (-1, -1, 1))])
@pytest.mark.parametrize("unit, factor", [(None, 1.0), ("um", 1e-3), ("cm", 10.0)])
def test_the_surface_lies_in_ras_and_millimetres(tmp_path, noise, module, space, signs, unit, factor):
    store = nrrd_store(tmp_path, noise, space, unit)
    mesh = store.isosurface(0.3, distance="0.5voxel", coordinates="world")
    data, report = module.surface_polydata(store, 0.3, distance="0.5voxel")
    points, scale = vtk_to_numpy(data.GetPoints().GetData()), factor * np.array(signs)
    np.testing.assert_allclose(points, mesh.vertices * scale, rtol=1e-6)
    np.testing.assert_allclose(vtk_to_numpy(data.GetPointData().GetNormals()), mesh.normals * signs, rtol=1e-6)
    faces = vtk_to_numpy(data.GetPolys().GetConnectivityArray()).reshape(-1, 3)
    np.testing.assert_array_equal(faces, mesh.faces)
    assert report.triangles == len(mesh.faces) > 100
    bound = data.GetFieldData().GetArray("distance bound")
    np.testing.assert_allclose(bound.GetValue(0), mesh.report.distance_bound * factor)
    # Turning by half a circle keeps the orientation.
    np.testing.assert_allclose(signed_volume(points, faces), signed_volume(mesh.vertices, mesh.faces) * factor**3, rtol=1e-4)


def test_an_error_is_in_units_of_the_data(tmp_path, noise, module):
    store = nrrd_store(tmp_path, noise, "left-posterior-superior", "um")
    data, report = module.surface_polydata(store, 0.3, error=0.05)
    assert data.GetFieldData().GetArray("distance bound") is None
    assert 0 < data.GetFieldData().GetArray("error bound").GetValue(0) == report.error_bound <= 0.05


def test_units_are_those_of_the_library(tmp_path, noise, module):
    for unit, factor in module.MILLIMETRES.items():
        store = nrrd_store(tmp_path, noise[:9, :9, :9], "right-anterior-superior", unit)
        assert store.unit == unit
        assert store._core.world_units(1.0, "mm") == pytest.approx(1 / factor)


@pytest.mark.parametrize("level", [0, 1])
@pytest.mark.parametrize("space, signs", [("right-anterior-superior", (1, 1, 1)), ("left-posterior-superior", (-1, -1, 1))])
def test_an_image_has_the_nodes_in_their_places(tmp_path, noise, module, level, space, signs):
    store = nrrd_store(tmp_path, noise, space, "cm")
    image, matrix = module.volume_image(store, level)
    step = 2**level
    assert image.GetDimensions() == noise[::step, ::step, ::step].shape[::-1]
    assert image.GetSpacing() == (1, 1, 1) and image.GetOrigin() == (0, 0, 0)
    i, j, k = 5, 9, 4
    assert image.GetScalarComponentAsDouble(i, j, k, 0) == noise[k * step, j * step, i * step]
    np.testing.assert_allclose(matrix.MultiplyPoint((i, j, k, 1))[:3], world_of(i * step, j * step, k * step) * 10 * np.array(signs))


def test_without_a_level_the_volume_fits(tmp_path, noise, module, monkeypatch):
    store = nrrd_store(tmp_path, noise, "right-anterior-superior")
    assert module.volume_image(store)[0].GetNumberOfPoints() == noise.size
    monkeypatch.setattr(module, "MAX_NODES", 1000)
    assert 0 < module.volume_image(store)[0].GetNumberOfPoints() <= 1000


class Node:
    """A stand-in for a node of Slicer's scene: remembers what was set."""

    def __init__(self, kind, name):
        self.kind, self.name, self.set = kind, name, {}

    def __getattr__(self, method):
        return lambda *given: self.set.update({method: given})


class Scene:
    def __init__(self):
        self.nodes = []

    def GenerateUniqueName(self, name):
        return name

    def AddNewNodeByClass(self, kind, name):
        self.nodes.append(Node(kind, name))
        return self.nodes[-1]


def test_the_logic_adds_nodes_to_the_scene(tmp_path, noise, monkeypatch):
    slicer, base = types.ModuleType("slicer"), types.ModuleType("slicer.ScriptedLoadableModule")
    slicer.mrmlScene = Scene()
    for name in ("ScriptedLoadableModule", "ScriptedLoadableModuleLogic", "ScriptedLoadableModuleWidget"):
        setattr(base, name, type(name, (), {}))
    for name, stand_in in {"slicer": slicer, "slicer.ScriptedLoadableModule": base, "qt": types.ModuleType("qt"),
                           "ctk": types.ModuleType("ctk")}.items():
        monkeypatch.setitem(sys.modules, name, stand_in)
    logic = loaded().IsonestExtractLogic()
    store = nrrd_store(tmp_path, noise, "right-anterior-superior")
    path = str(tmp_path / "v.isonest")
    assert logic.suggested(path) == store.histogram().suggested[0][0]
    node, report = logic.add_surface(path, 0.3, distance="0.5voxel")
    assert (node.kind, node.name) == ("vtkMRMLModelNode", "v 0.3")
    assert node.set["SetAndObservePolyData"][0].GetNumberOfPolys() == report.triangles and "CreateDefaultDisplayNodes" in node.set
    volume = logic.add_volume(path, 1)
    assert (volume.kind, volume.name) == ("vtkMRMLScalarVolumeNode", "v")
    assert volume.set["SetAndObserveImageData"][0].GetNumberOfPoints() == noise[::2, ::2, ::2].size
    np.testing.assert_allclose(volume.set["SetIJKToRASMatrix"][0].MultiplyPoint((0, 0, 0, 1))[:3], [10, 20, 30])
    assert len(slicer.mrmlScene.nodes) == 2
