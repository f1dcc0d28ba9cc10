"""A mesh as its users treat it: as a tuple, in conditions, pickled, copied, and in a notebook."""
import base64
import copy
import pickle
import re
import zlib

import numpy as np
import pytest

import isonest
from conftest import ball


@pytest.fixture
def mesh(noise):
    return isonest.isosurface(noise, 0.3, spacing=(2, 1, 0.5), unit="mm", distance=0.5, quality=True)


def test_it_is_the_tuple_of_marching_cubes(mesh):
    assert len(mesh) == 4
    for i, array in enumerate((mesh.vertices, mesh.faces, mesh.normals, mesh.values)):
        np.testing.assert_array_equal(mesh[i], array)
        np.testing.assert_array_equal(mesh[i - 4], array)
        np.testing.assert_array_equal(list(mesh)[i], array)
    vertices, faces = mesh[:2]
    assert vertices.shape == mesh.vertices.shape and faces.shape == mesh.faces.shape
    with pytest.raises(IndexError):
        mesh[4]


def test_it_is_true_if_it_has_faces(noise):
    assert isonest.isosurface(noise, 0.3)
    assert not isonest.isosurface(noise, 1e9)


def test_it_is_no_array(mesh):
    with pytest.raises(TypeError, match="mesh.vertices"):
        np.asarray(mesh)


COPIES = {"pickled": lambda m: pickle.loads(pickle.dumps(m)), "with the oldest protocol": lambda m: pickle.loads(pickle.dumps(m, 2)),
          "copied": copy.copy, "deeply copied": copy.deepcopy,
          "twice": lambda m: pickle.loads(pickle.dumps(pickle.loads(pickle.dumps(m))))}


@pytest.mark.parametrize("way", COPIES)
@pytest.mark.parametrize("suffix", ["ply", "vtp", "3mf"])
def test_copies_are_the_same_mesh(mesh, tmp_path, way, suffix):
    other = COPIES[way](mesh)
    assert repr(other) == repr(mesh) and other.coordinates == mesh.coordinates
    for mine, theirs in zip(mesh, other):
        np.testing.assert_array_equal(mine, theirs)
    mesh.save(tmp_path / f"a.{suffix}")
    other.save(tmp_path / f"b.{suffix}")
    assert (tmp_path / f"a.{suffix}").read_bytes() == (tmp_path / f"b.{suffix}").read_bytes()
    assert isinstance(other.report, isonest.Report) and isinstance(other.report.quality, isonest.TriangleQuality)
    assert repr(other.report) == repr(mesh.report)
    for name in dir(isonest.Report):
        if not name.startswith("_") and name != "quality":
            assert getattr(other.report, name) == getattr(mesh.report, name), name
    assert other.report.distance_bound > 0 and other.report.quality.median == mesh.report.quality.median > 10


def test_interfaces_of_labels_and_lines_are_pickled(noise, tmp_path):
    isonest.preprocess((noise > 0).astype("u1") + (noise > 1), tmp_path / "x")
    between = isonest.open(tmp_path / "x").interfaces()
    other = pickle.loads(pickle.dumps(between))
    np.testing.assert_array_equal(other.labels, between.labels)
    assert other.areas == between.areas and other.report.outside == between.report.outside
    for one, name in ((between, "a.ply"), (other, "b.ply")):
        one.save(tmp_path / name)
    assert (tmp_path / "a.ply").read_bytes() == (tmp_path / "b.ply").read_bytes()
    lines = isonest.isosurface(noise[5], 0.3)
    np.testing.assert_array_equal(pickle.loads(pickle.dumps(lines)).faces, lines.faces)


def pixels(shown):
    """The picture in the HTML, as (rows, columns, 4), decoded here."""
    data = base64.b64decode(re.search(r'src="data:image/png;base64,([^"]+)"', shown)[1])
    assert data[:8] == b"\x89PNG\r\n\x1a\n" and data[12:16] == b"IHDR"
    width, height = (int.from_bytes(data[at:at + 4], "big") for at in (16, 20))
    at, packed = 33, b""
    while at < len(data):
        size, kind = int.from_bytes(data[at:at + 4], "big"), data[at + 4:at + 8]
        body = data[at + 8:at + 8 + size]
        assert zlib.crc32(kind + body) == int.from_bytes(data[at + 8 + size:at + 12 + size], "big")
        packed += body if kind == b"IDAT" else b""
        at += 12 + size
    rows = np.frombuffer(zlib.decompress(packed), np.uint8).reshape(height, 1 + 4 * width)
    assert not rows[:, 0].any()
    return rows[:, 1:].reshape(height, width, 4)


@pytest.mark.parametrize("size", [24, 90])
def test_a_notebook_shows_it_as_a_picture(size):
    """A ball is a disc, shaded, without holes, and brighter above."""
    sphere = isonest.isosurface(ball((size,) * 3, 0.4 * size), 0.0)
    shown = sphere._repr_html_()
    assert f"{len(sphere.faces)} faces" in shown and "<isonest" not in shown
    picture = pixels(shown)
    covered = picture[:, :, 3] > 0
    radius = np.hypot(*(np.indices(covered.shape) - (np.array(covered.shape) - 1)[:, None, None] / 2))
    expected = np.sqrt(covered.sum() / np.pi)
    assert 80 < expected < 160
    assert covered[radius < expected - 3].all() and not covered[radius > expected + 3].any()
    middle = len(picture) // 2
    assert picture[middle - 40, middle, :3].sum() > 1.2 * picture[middle + 40, middle, :3].sum()


def test_pictures_of_large_meshes_leave_faces_out_but_have_no_holes(monkeypatch):
    sphere = isonest.isosurface(ball((90,) * 3, 36), 0.0)
    whole = pixels(sphere._repr_html_())[:, :, 3] > 0
    monkeypatch.setattr(isonest._picture, "_MOST", 10_000)
    some = pixels(sphere._repr_html_())[:, :, 3] > 0
    assert (some != whole).sum() < 0.03 * whole.sum()


def test_empty_meshes_and_lines_are_shown_too(noise):
    assert "img" not in isonest.isosurface(noise, 1e9)._repr_html_()
    assert 200 < (pixels(isonest.isosurface(noise[5], 0.3)._repr_html_())[:, :, 3] > 0).sum() < 20_000
