"""Saved meshes: byte for byte those of the program, and readable by other programs."""
import json
import os
import struct
import subprocess
import threading
import zipfile

import numpy as np
import pytest

import isonest

FORMATS = ["ply", "stl", "obj", "vtp", "vtkhdf", "glb", "3mf", "ngmesh"]


@pytest.fixture(scope="module")
def stores(tmp_path_factory, noise):
    folder = tmp_path_factory.mktemp("stores")
    isonest.preprocess(noise, folder / "v", spacing=(2, 1, 0.5), origin=(30, 20, -10), indicators="all")
    isonest.preprocess(noise.astype(float) * (1 + 1e-12), folder / "double", spacing=(2, 1, 0.5), origin=(30, 20, -10))
    isonest.preprocess(noise[20], folder / "map")
    return folder


def run(*arguments):
    program = os.environ.get("ISONEST_PROGRAM")
    if not program:
        pytest.skip("ISONEST_PROGRAM names no program")
    done = subprocess.run([program, *map(str, arguments), "--json"], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    return json.loads(done.stdout)


def check_bytes(stores, tmp_path, mesh, formats, *command):
    """Saved meshes have the same bytes as those of the command."""
    for form in formats:
        run(*command, "-o", tmp_path / f"theirs.{form}")
        mesh.save(tmp_path / f"ours.{form}")
        assert (tmp_path / f"ours.{form}").read_bytes() == (tmp_path / f"theirs.{form}").read_bytes(), form


def test_every_format_has_the_programs_bytes(stores, tmp_path):
    store = isonest.open(stores / "v")
    check_bytes(stores, tmp_path, store.isosurface(0.3, normals=False), FORMATS,
                "extract", stores / "v", "--iso", "0.3")
    mesh = store.isosurface(0.3, error=0.1, vertex_error="deviation_bar", vertex_values=isonest.open(stores / "double"))
    check_bytes(stores, tmp_path, mesh, FORMATS, "extract", stores / "v", "--iso", "0.3", "--error", "0.1",
                "--vertex-error", "deviation_bar", "--vertex-values", stores / "double", "--normals")


def test_other_queries_have_the_programs_bytes(stores, tmp_path):
    store, double, plane = (isonest.open(stores / name) for name in ("v", "double", "map"))
    extract = ("extract", stores / "v", "--iso", "0.3")
    both = ["ply", "glb"]
    check_bytes(stores, tmp_path, store.isosurface(0.3, distance="0.5voxel", components="largest"), both,
                *extract, "--distance", "0.5voxel", "--components", "largest", "--normals")
    check_bytes(stores, tmp_path, store.isosurface(0.3, cells="hex", normals=False), both, *extract, "--cells", "hex")
    check_bytes(stores, tmp_path, store.isosurface(0.3, close="above", min_component=30, normals=False), both,
                *extract, "--close=above", "--min-component", "30")
    check_bytes(stores, tmp_path, double.slice((1, 2, 0), 80), ["vtp", "ply", "vtkhdf", "glb"],
                "slice", stores / "double", "--plane", "0,2,1,150")
    check_bytes(stores, tmp_path, double.contours((1, 2, 0), 80, [-0.5, 0.3]), ["vtp", "obj"],
                "slice", stores / "double", "--plane", "0,2,1,150", "--contours", "-0.5,0.3")
    check_bytes(stores, tmp_path, plane.isosurface(0.3, normals=False), ["vtp", "obj"],
                "extract", stores / "map", "--iso", "0.3")
    check_bytes(stores, tmp_path, plane.graph(scale=3, error=0.1, normals=True), ["ply", "glb"],
                "extract", stores / "map", "--graph", "--scale", "3", "--error", "0.1", "--normals")


def test_saved_in_another_unit(tmp_path, noise):
    isonest.preprocess(noise, tmp_path / "v", spacing=(2, 1, 0.5), unit="mm")
    mesh = isonest.open(tmp_path / "v").isosurface(0.3, normals=False)
    for form in ("ply", "stl", "obj", "vtp", "vtkhdf"):
        run("extract", tmp_path / "v", "--iso", "0.3", "--mesh-unit", "um", "-o", tmp_path / f"theirs.{form}")
        mesh.save(tmp_path / f"ours.{form}", mesh_unit="micrometre")
        assert (tmp_path / f"ours.{form}").read_bytes() == (tmp_path / f"theirs.{form}").read_bytes(), form
    with pytest.raises(isonest.Error, match="unit of their own"):
        mesh.save(tmp_path / "no.glb", mesh_unit="m")
    with pytest.raises(ValueError, match="mesh_unit=.ell."):
        mesh.save(tmp_path / "no.ply", mesh_unit="ell")


def test_other_programs_read_saved_meshes(stores, tmp_path):
    """In world coordinates; the attributes are present, and faces are oriented as requested."""
    meshio = pytest.importorskip("meshio")
    mesh = isonest.open(stores / "v").isosurface(0.3, gradient_direction="ascent", vertex_error="deviation_bar")
    world = mesh.in_world()
    mesh.save(tmp_path / "m.ply")
    read = meshio.read(tmp_path / "m.ply")
    np.testing.assert_array_equal(read.points, world.vertices)
    np.testing.assert_array_equal(read.cells_dict["triangle"], world.faces)
    np.testing.assert_array_equal(read.point_data["error"], mesh.errors)
    np.testing.assert_array_equal(read.point_data["nz"], world.normals[:, 2])
    mesh.save(tmp_path / "m.ngmesh")
    content = (tmp_path / "m.ngmesh").read_bytes()
    count = struct.unpack_from("<I", content)[0]
    assert count == len(mesh.vertices)
    np.testing.assert_array_equal(np.frombuffer(content, "<u4", offset=4 + 12 * count).reshape(-1, 3), mesh.faces)
    mesh.save(tmp_path / "n.ngmesh", shift=(0.5, -2, 8))
    moved = np.frombuffer((tmp_path / "n.ngmesh").read_bytes(), "<f4", 3 * count, 4).reshape(-1, 3)
    there = np.frombuffer(content, "<f4", 3 * count, 4).reshape(-1, 3)
    np.testing.assert_allclose(moved - there, np.broadcast_to((0.5, -2, 8), moved.shape), atol=1e-4)
    with pytest.raises(isonest.InvalidArgumentError, match="ngmesh"):
        mesh.save(tmp_path / "n.ply", shift=(0, 0, 1))
    mesh.save(tmp_path / "m.3mf")
    with zipfile.ZipFile(tmp_path / "m.3mf") as archive:
        assert archive.testzip() is None
        assert archive.read("3D/3dmodel.model").count(b"<triangle ") == len(mesh.faces)


@pytest.mark.parametrize("form", ["vtp", "stl", "obj"])
def test_vtk_reads_saved_meshes(stores, tmp_path, form):
    io = {"vtp": ("vtkmodules.vtkIOXML", "vtkXMLPolyDataReader"), "stl": ("vtkmodules.vtkIOGeometry", "vtkSTLReader"),
          "obj": ("vtkmodules.vtkIOGeometry", "vtkOBJReader")}[form]
    reader = getattr(pytest.importorskip(io[0]), io[1])()
    from vtkmodules.util.numpy_support import vtk_to_numpy
    mesh = isonest.open(stores / "v").isosurface(0.3, coordinates="world")
    mesh.save(tmp_path / f"m.{form}")
    reader.SetFileName(str(tmp_path / f"m.{form}"))
    reader.Update()
    data = reader.GetOutput()
    points = vtk_to_numpy(data.GetPoints().GetData())
    corners = vtk_to_numpy(data.GetPolys().GetConnectivityArray()).reshape(-1, 3)
    # VTK 9.3 reads a float in an OBJ file with a wrong last digit.
    np.testing.assert_allclose(points[corners], mesh.vertices[mesh.faces], rtol=1e-7 if form == "obj" else 0, atol=1e-6 if form == "obj" else 0)


def test_saving_twice_and_from_threads_gives_the_same_bytes(stores, tmp_path):
    mesh = isonest.open(stores / "v").isosurface(0.3)
    threads = [threading.Thread(target=mesh.save, args=(tmp_path / f"{i}.vtp",)) for i in range(4)]
    [t.start() for t in threads]
    [t.join() for t in threads]
    mesh.in_world().save(tmp_path / "4.vtp")
    assert len({(tmp_path / f"{i}.vtp").read_bytes() for i in range(5)}) == 1


def test_a_file_appears_only_when_complete(stores, tmp_path):
    store = isonest.open(stores / "v")
    mesh = store.isosurface(0.3)
    with pytest.raises(isonest.InvalidArgumentError, match=r"\.ply, \.stl"):
        mesh.save(tmp_path / "m.txt")
    with pytest.raises(FileNotFoundError):
        mesh.save(tmp_path / "none" / "m.ply")
    with pytest.raises(isonest.InvalidArgumentError, match="lines can only be written as .vtp or .obj"):
        store.contours((1, 0, 0), 40, [0.3]).save(tmp_path / "m.ply")
    (tmp_path / "folder.ply").mkdir()
    with pytest.raises(isonest.Error):
        mesh.save(tmp_path / "folder.ply")

    def stop(*_):
        raise ZeroDivisionError
    with pytest.raises(ZeroDivisionError):
        mesh.save(tmp_path / "m.ply", progress=stop)
    # It was complete before the function was called, or does not exist.
    assert {path.name for path in tmp_path.iterdir()} <= {"folder.ply", "m.ply"}
    mesh.save(tmp_path / "m.ply")
    size = (tmp_path / "m.ply").stat().st_size
    store.isosurface(0.3, normals=False).save(tmp_path / "m.ply")
    assert size - (tmp_path / "m.ply").stat().st_size > 12 * len(mesh.vertices)


def test_a_mesh_cannot_overwrite_its_store(tmp_path, noise):
    isonest.preprocess(noise, tmp_path / "v.ply")
    mesh = isonest.open(tmp_path / "v.ply").isosurface(0.3)
    before = (tmp_path / "v.ply").read_bytes()
    with pytest.raises(isonest.Error):
        mesh.save(tmp_path / "v.ply")
    assert (tmp_path / "v.ply").read_bytes() == before


def test_values_beyond_float32_are_refused_by_float32_formats(tmp_path):
    volume = np.linspace(0, 1e300, 8 * 9 * 10).reshape(8, 9, 10)
    isonest.preprocess(volume, tmp_path / "x")
    mesh = isonest.open(tmp_path / "x").slice((1, 0, 0), 3)
    mesh.save(tmp_path / "m.vtp")
    with pytest.raises(isonest.LimitError):
        mesh.save(tmp_path / "m.glb")
    assert not (tmp_path / "m.glb").exists()


def test_a_mesh_is_saved_in_the_requested_space(tmp_path, noise):
    """By default in RAS if the axes are known. The program's bytes, with x and y negated from LPS to RAS."""
    isonest.preprocess(noise, tmp_path / "s", spacing=(2, 1, 0.5), origin=(30, 20, -10), frame="lps")
    store = isonest.open(tmp_path / "s")
    mesh = store.isosurface(0.3)
    stored = mesh.in_world().vertices
    for form in FORMATS:
        for space in (None, "ras", "lps", "as-stored"):
            given = [] if space is None else ["--space", space]
            run("extract", tmp_path / "s", "--iso", "0.3", "--normals", *given, "-o", tmp_path / f"theirs.{form}")
            mesh.save(tmp_path / f"ours.{form}", space=space)
            assert (tmp_path / f"ours.{form}").read_bytes() == (tmp_path / f"theirs.{form}").read_bytes(), (form, space)
    mesh.save(tmp_path / "ras.ngmesh", space="ras")
    positions = np.fromfile(tmp_path / "ras.ngmesh", "<f4", 3 * len(stored), offset=4).reshape(-1, 3)
    np.testing.assert_array_equal(positions, stored * np.float32([-1, -1, 1]))
    np.testing.assert_array_equal(mesh.in_world().vertices, stored)  # the mesh in memory is not changed
    with pytest.raises(ValueError, match="give 'ras', 'lps' or 'as-stored'"):
        mesh.save(tmp_path / "no.ply", space="lsa")
    isonest.preprocess(noise, tmp_path / "bare")
    with pytest.raises(isonest.InvalidArgumentError, match="the patient axes of the volume are unknown"):
        isonest.open(tmp_path / "bare").isosurface(0.3).save(tmp_path / "no.ply", space="ras")
    assert not (tmp_path / "no.ply").exists()
    # The same directly from an array.
    isonest.isosurface(noise, 0.3, frame="lps", spacing=(2, 1, 0.5)).save(tmp_path / "array.ply")
    assert b"comment SPACE=RAS\n" in (tmp_path / "array.ply").read_bytes()[:300]
