"""isonest.napari: what napari gets of a store. napari itself is not needed, and was not run."""
import importlib
import pathlib
import re

import numpy as np
import pytest

import isonest
import isonest.napari as plugin

PACKAGE = pathlib.Path(isonest.napari.__file__).resolve().parent
SPACING, ORIGIN = (2.0, 1.0, 0.5), (30.0, 20.0, 10.0)


@pytest.fixture
def path(noise, store_path):
    isonest.preprocess(noise, store_path, spacing=SPACING, origin=ORIGIN, unit="mm", chunk=16)
    return store_path


def read(path):
    reader = plugin.napari_get_reader(str(path))
    assert reader is not None
    return reader(str(path))


def test_other_files_are_left_to_other_readers():
    assert plugin.napari_get_reader("x.tif") is None
    assert plugin.napari_get_reader(["x.isonest", "y.tif"]) is None
    assert plugin.napari_get_reader([]) is None


def test_an_image_has_its_values_place_and_range(path, noise):
    (data, about, kind), = read(path)
    assert kind == "image" and not about["multiscale"]
    assert data.shape == noise.shape and data.dtype == noise.dtype and data.ndim == 3 and len(data) == len(noise)
    assert data.size == noise.size
    np.testing.assert_array_equal(np.asarray(data), noise)
    assert np.asarray(data, np.float64).dtype == np.float64
    assert about["name"] == "x" and about["scale"] == SPACING and about["translate"] == ORIGIN
    assert about["contrast_limits"] == (noise.min(), noise.max())
    assert about["metadata"]["unit"] == "mm" and about["metadata"]["frame"] is None
    assert len(plugin.napari_get_reader([path, path])([path, path])) == 2


@pytest.mark.parametrize("index", [
    np.s_[5], np.s_[-1, 3:9], np.s_[:, 4], np.s_[..., 7], np.s_[2:30:3, ::2, 1:20], np.s_[::-1, 3, 20:2:-4], np.s_[3, 4, 5],
    np.s_[7:7], np.s_[...], (np.int64(4), slice(None)), ([1, 5, 2],), np.s_[1, ..., 2], np.s_[50:60]])
def test_a_level_is_indexed_like_an_array(path, noise, index):
    (data, _, _), = read(path)
    np.testing.assert_array_equal(data[index], noise[index])


def test_wrong_indices_are_refused(path):
    (data, _, _), = read(path)
    for wrong in ((0, 0, 0, 0), (100,), "x"):
        with pytest.raises(IndexError):
            data[wrong]


def test_a_slice_reads_only_its_chunks(path, monkeypatch):
    (data, _, _), = read(path)
    boxes = []
    values = isonest.Store.values
    monkeypatch.setattr(isonest.Store, "values", lambda self, level, box: boxes.append(box) or values(self, level, box))
    data[10, 4:8]
    assert boxes == [[10, slice(4, 8), slice(0, 27)]]


def test_large_volumes_are_multiscale(path, noise, monkeypatch):
    monkeypatch.setattr(plugin, "_MAX_NODES_IN_3D", 1000)
    (levels, about, _), = read(path)
    assert about["multiscale"] and levels[-1].size <= 1000 < levels[-2].size
    for number, level in enumerate(levels):
        step = 2**number
        np.testing.assert_array_equal(np.asarray(level), noise[::step, ::step, ::step])


def test_labels_are_labels(tmp_path, noise):
    values = (noise > 0).astype(np.int64) * 2**40
    np.save(tmp_path / "l.npy", values)
    isonest.preprocess(tmp_path / "l.npy", tmp_path / "l.isonest", labels=True)
    (data, about, kind), = plugin.layers(tmp_path / "l.isonest")
    assert kind == "labels" and "contrast_limits" not in about
    np.testing.assert_array_equal(np.asarray(data), values)
    isonest.preprocess((noise > 0).astype(np.uint8), tmp_path / "u.isonest")
    assert plugin.layers(tmp_path / "u.isonest")[0][2] == "image"
    (data, _, kind), = plugin.layers(tmp_path / "u.isonest", kind="labels")
    assert kind == "labels" and data.dtype == np.uint8
    with pytest.raises(ValueError, match="kind="):
        plugin.layers(tmp_path / "u.isonest", kind="points")


def test_data_in_a_plane_have_two_axes(tmp_path, noise):
    isonest.preprocess(noise[5], tmp_path / "p.isonest", spacing=(1.0, 0.5))
    (data, about, _), = plugin.layers(tmp_path / "p.isonest")
    assert data.shape == noise[5].shape and about["scale"] == (1.0, 0.5) and len(about["translate"]) == 2
    np.testing.assert_array_equal(data[3:9, ::2], noise[5, 3:9, ::2])
    with pytest.raises(ValueError, match="no surface"):
        plugin.surface_layer(tmp_path / "p.isonest", 0.0)


def rotated(tmp_path, noise):
    sitk_like = np.array([[0.0, -1.0, 0.0], [0.6, 0.0, -0.8], [0.8, 0.0, 0.6]])  # rows: the axes x, y, z
    header = ("NRRD0005\ntype: float\ndimension: 3\nspace: left-posterior-superior\nsizes: {2} {1} {0}\n"
              "space directions: {3}\nspace origin: (10,20,30)\nencoding: raw\nendian: little\nkinds: domain domain domain\n\n")
    directions = " ".join("(" + ",".join(str(v) for v in axis * step) + ")" for axis, step in zip(sitk_like, (0.5, 1.0, 2.0)))
    (tmp_path / "r.nrrd").write_bytes(header.format(*noise.shape, directions).encode() + noise.astype("<f4").tobytes())
    isonest.preprocess(tmp_path / "r.nrrd", tmp_path / "r.isonest")
    return isonest.open(tmp_path / "r.isonest"), sitk_like


def test_a_rotated_volume_is_placed_by_a_matrix(tmp_path, noise):
    store, axes = rotated(tmp_path, noise)
    (_, about, _), = plugin.layers(store)
    assert "scale" not in about and about["metadata"]["frame"] == "LPS"
    k, j, i = 3, 7, 11
    x, y, z = np.array([10, 20, 30]) + axes[0] * 0.5 * i + axes[1] * j + axes[2] * 2.0 * k
    np.testing.assert_allclose((about["affine"] @ [k, j, i, 1])[:3], [z, y, x], atol=1e-9)


@pytest.mark.parametrize("turned", [False, True])
def test_a_surface_lies_where_the_image_has_its_value(path, tmp_path, noise, turned):
    store = rotated(tmp_path, noise)[0] if turned else isonest.open(path)
    (vertices, faces, values), about, kind = plugin.surface_layer(store, 0.3, distance="0.5voxel")
    (_, image, _), = plugin.layers(store)
    matrix = image["affine"] if turned else np.diag([*image["scale"], 1.0])
    if not turned:
        matrix[:3, 3] = image["translate"]
    assert kind == "surface" and len(faces) > 100 and faces.max() < len(vertices) and (values == np.float32(0.3)).all()
    assert 0 < about["metadata"]["report"].distance_bound <= 0.5 * min(SPACING)
    whole = plugin.surface_layer(store, 0.3, cells="tet")[0][0]
    indices = (np.c_[whole, np.ones(len(whole))] @ np.linalg.inv(matrix).T)[:, :3]
    sampled = store.sample(indices * np.array(store.spacing))
    inside = np.isfinite(sampled)  # rounding puts points of the border outside
    assert inside.mean() > 0.8
    np.testing.assert_allclose(sampled[inside], 0.3, atol=1e-3)


def test_the_manifest_names_what_there_is():
    yaml = pytest.importorskip("yaml")
    manifest = yaml.safe_load((PACKAGE / "napari.yaml").read_text())
    project = (pathlib.Path(__file__).resolve().parents[2] / "pyproject.toml").read_text()
    # npe2 takes a manifest only if its name is that of the distribution.
    assert manifest["name"] == re.search(r'^name = "(\w+)"', project, re.M)[1]
    assert re.search(r'^\[project.entry-points."napari.manifest"\]\nisonest = "isonest:napari.yaml"$', project, re.M)
    commands = {command["id"]: command for command in manifest["contributions"]["commands"]}
    assert all(name.startswith("isonest.") and command["title"] for name, command in commands.items())
    for reader in manifest["contributions"]["readers"]:
        assert reader["filename_patterns"] == ["*.isonest"]
        module, function = commands[reader["command"]]["python_name"].split(":")
        assert getattr(importlib.import_module(module), function) is plugin.napari_get_reader
