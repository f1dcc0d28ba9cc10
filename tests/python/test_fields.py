"""Mesh.with_values(): the same values, files and bounds as `isonest extract --vertex-values NAME=STORE`."""
import json
import os
import pickle
import subprocess

import numpy as np
import pytest

import isonest


def run_program(*words):
    program = os.environ.get("ISONEST_PROGRAM")
    if not program:
        pytest.skip("ISONEST_PROGRAM names no program")
    return json.loads(subprocess.run([program, *map(str, words), "--json"], capture_output=True, text=True, check=True).stdout)


@pytest.fixture(scope="module")
def fields(tmp_path_factory):
    folder = tmp_path_factory.mktemp("fields")
    z, y, x = np.meshgrid(*(np.arange(n, dtype="f4") for n in (20, 24, 28)), indexing="ij")
    arrays = {"ball": np.hypot(np.hypot(x - 13.6, y - 12.2), z - 9.1), "wave": np.sin(x / 4).astype("f8") * y, "u": x, "v": y, "w": z}
    arrays["wave"][:, :, :9] = np.nan
    for name, array in arrays.items():
        isonest.preprocess(array, folder / f"{name}.isonest")
    return folder


def test_a_mesh_has_the_values_the_bounds_and_the_files_of_the_program(fields, tmp_path):
    at = {name: isonest.open(fields / f"{name}.isonest") for name in ("ball", "wave", "u", "v", "w")}
    mesh = at["ball"].isosurface(7.5, normals=True).with_values({"wave": at["wave"], "wind": (at["u"], at["v"], at["w"])})
    for end in ("glb", "ply", "vtp"):
        done = run_program("extract", fields / "ball.isonest", "--iso", "7.5", "--normals", "--vertex-values",
                           f"wave={fields}/wave.isonest", "--vertex-values",
                           f"wind={fields}/u.isonest,{fields}/v.isonest,{fields}/w.isonest", "-o", tmp_path / f"p.{end}")
        mesh.save(tmp_path / f"m.{end}")
        assert (tmp_path / f"m.{end}").read_bytes() == (tmp_path / f"p.{end}").read_bytes(), end
    reports = {one["name"]: one for one in done["vertex_fields"]}
    assert mesh.field_bounds == {name: one["linear_bound"] for name, one in reports.items()}
    assert np.isnan(mesh.fields["wave"]).sum() == reports["wave"]["missing_vertices"] > 0
    np.testing.assert_allclose(mesh.fields["wind"], mesh.in_world().vertices, atol=1e-5)
    assert mesh.fields["wave"].dtype == np.float64 and mesh.fields["wind"].dtype == np.float32


def test_values_survive_other_coordinates_pickling_and_conversion(fields):
    ball, wave = (isonest.open(fields / f"{name}.isonest") for name in ("ball", "wave"))
    mesh = ball.isosurface(7.5).with_values({"wave": wave})
    for other in (mesh.in_world(), pickle.loads(pickle.dumps(mesh)), mesh.with_values({"again": wave})):
        np.testing.assert_array_equal(other.fields["wave"], mesh.fields["wave"])
    assert list(mesh.with_values({"again": wave}).fields) == ["wave", "again"]
    data = mesh.to_vtk().GetPointData()
    assert data.GetArray("wave").GetNumberOfTuples() == len(mesh.vertices)
    assert mesh.fields["wave"].shape == (len(mesh.vertices),) and not ball.isosurface(7.5).fields


def test_names_and_numbers_of_components_are_checked(fields):
    ball = isonest.open(fields / "ball.isonest")
    mesh = ball.isosurface(7.5).with_values({"a": ball})
    with pytest.raises(ValueError, match="'a'"):
        mesh.with_values({"a": ball})
    for names in ({"A": ball}, {"a_x": ball}):  # the same as a, or as a component of it, in some formats
        vector = ball.isosurface(7.5).with_values({"a": (ball, ball, ball)}).with_values(names)
        with pytest.raises(isonest.InvalidArgumentError, match="A"):
            vector.save(fields / "never.ply")
    with pytest.raises(isonest.InvalidArgumentError, match="something else"):
        mesh.with_values({"normal": ball})
    with pytest.raises(isonest.InvalidArgumentError, match="components"):
        mesh.with_values({"b": (ball, ball)})
    with pytest.raises(isonest.Error, match=".vtp"):
        mesh.save(fields / "never.stl")
