"""Arguments of scikit-image's marching_cubes, origin=, and messages, which name the public function and argument."""
import pathlib

import numpy as np
import pytest

import isonest
from conftest import area, ball


@pytest.fixture
def store(store_path, noise):
    isonest.preprocess(noise, store_path)
    return isonest.open(store_path)


def same_mesh(a, b):
    assert len(a.faces) > 0
    np.testing.assert_array_equal(a.vertices, b.vertices)
    np.testing.assert_array_equal(a.faces, b.faces)


def test_level_is_another_name_of_iso(store, noise):
    for surface in (store.isosurface, lambda *a, **k: isonest.isosurface(noise, *a, **k)):
        same_mesh(surface(level=0.3), surface(0.3))
        first, second = surface(level=[0.3, -0.2])
        same_mesh(second, surface(-0.2))
        with pytest.raises(TypeError, match="iso= and level="):
            surface(0.3, level=0.3)
    same_mesh(isonest.isosurface(noise, level=0.3, error=0.1), isonest.isosurface(noise, 0.3, error=0.1))
    with pytest.raises(TypeError, match=r"isosurface\(\) needs iso="):
        store.isosurface()


@pytest.mark.parametrize("step", [2, 3, 50])
def test_a_step_size_takes_every_nth_node_at_its_place(noise, tmp_path, step):
    every = noise[::step, ::step, ::step]
    if 1 in every.shape:
        assert isonest.isosurface(noise, 0.3, step_size=step).report.triangles == 0
        return
    place = {"spacing": (2.0, 1.0, 0.5), "origin": (5, 6, 7), "coordinates": "world"}
    expected = isonest.isosurface(np.ascontiguousarray(every), 0.3,
                                  **{**place, "spacing": [step * s for s in place["spacing"]]})
    np.save(tmp_path / "v.npy", noise)
    h5py = pytest.importorskip("h5py")
    with h5py.File(tmp_path / "v.h5", "w") as file:
        file.create_dataset("v", data=noise, chunks=(8, 8, 8))
        for volume in (noise, noise[::-1][::-1], noise.tolist(), file["v"], tmp_path / "v.npy"):
            same_mesh(isonest.isosurface(volume, 0.3, step_size=step, **place), expected)
    for query in ({"error": 0.1}, {"distance": 0.5}):
        same_mesh(isonest.isosurface(noise, 0.3, step_size=step, **place, **query),
                  isonest.isosurface(every, 0.3, **{**place, "spacing": expected_spacing(place, step)}, **query))
    for wrong, error in ((0, ValueError), (-1, ValueError), (1.5, TypeError)):
        with pytest.raises(error, match="step_size|integer"):
            isonest.isosurface(noise, 0.3, step_size=wrong)


def expected_spacing(place, step):
    return [step * s for s in place["spacing"]]


@pytest.mark.parametrize("dtype", ["f4", "u1", "i4", "?"])
def test_where_the_mask_is_false_values_are_missing(noise, tmp_path, dtype):
    volume = (noise > 0.3) if dtype == "?" else (noise * 20 + 80).astype(dtype)
    iso = 0.5 if dtype == "?" else 86.5
    mask = np.random.default_rng(0).random(noise.shape) < 0.999
    mask[:9] = False
    expected = isonest.isosurface(np.where(mask, volume, np.nan), iso)
    assert expected.vertices[:, 0].min() >= 9
    h5py = pytest.importorskip("h5py")
    with h5py.File(tmp_path / "v.h5", "w") as file:
        file["v"], file["m"] = volume, mask
        for one, other in ((volume, mask), (file["v"], mask), (volume, file["m"]), (volume, mask.tolist())):
            same_mesh(isonest.isosurface(one, iso, mask=other), expected)
    half = isonest.isosurface(np.where(mask, volume, np.nan)[::2, ::2, ::2], iso, spacing=(2, 2, 2))
    same_mesh(isonest.isosurface(volume, iso, mask=mask, step_size=2), half)
    assert isonest.isosurface(volume, iso, mask=mask, error=1).vertices[:, 0].min() >= 9
    holes = np.ma.masked_array(volume, np.zeros(noise.shape, bool))
    holes[20:25, 5:9, 5:9] = np.ma.masked
    same_mesh(isonest.isosurface(holes, iso, mask=mask),
              isonest.isosurface(np.where(mask & ~holes.mask, volume, np.nan), iso))


def test_a_mask_needs_the_shape_of_an_array(noise, tmp_path):
    with pytest.raises(ValueError, match=r"mask= of shape \(2, 2, 2\).*\(40, 33, 27\)"):
        isonest.isosurface(noise, 0.3, mask=np.ones((2, 2, 2), bool))
    np.save(tmp_path / "v.npy", noise)
    with pytest.raises(TypeError, match="mask= is for arrays, and this is a file"):
        isonest.isosurface(tmp_path / "v.npy", 0.3, mask=noise > 0)


def test_no_triangle_is_degenerate_whatever_is_allowed():
    """A surface through nodes, where scikit-image makes triangles without area."""
    volume = np.round(ball((20, 20, 20), 6))
    for allowed in (True, False):
        mesh = isonest.isosurface(volume, 0.0, allow_degenerate=allowed)
        corners = mesh.vertices[mesh.faces].astype(float)
        areas = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1) / 2
        assert areas.min() > 0 and mesh.report.zero_area_triangles == 0
    assert area(mesh.vertices, mesh.faces) == pytest.approx(4 * np.pi * 36, rel=0.2)
    with pytest.raises(TypeError, match="allow_degenerate='no'"):
        isonest.isosurface(volume, 0.0, allow_degenerate="no")


def test_an_origin_is_that_of_the_world(noise, tmp_path):
    isonest.preprocess(noise, tmp_path / "x", spacing=(2, 1, 0.5), origin=(30, 20, 10))
    stored = isonest.open(tmp_path / "x").isosurface(0.3, cells="hex", coordinates="world")
    for volume in (noise, noise.astype(">f4")):
        for query in ({}, {"vertex_error": "deviation_bar"}):
            mesh = isonest.isosurface(volume, 0.3, spacing=(2, 1, 0.5), origin=(30, 20, 10), coordinates="world", **query)
            np.testing.assert_allclose(sorted(mesh.vertices.tolist()), sorted(stored.vertices.tolist()), atol=1e-5)
            np.testing.assert_allclose(mesh.in_array().vertices, mesh.vertices[:, ::-1] - [30, 20, 10], atol=1e-5)


def test_a_store_is_like_an_array(store, noise):
    np.testing.assert_array_equal(np.asarray(store), noise)
    np.testing.assert_array_equal(np.asarray(store, "f8"), noise.astype("f8"))
    for place in (np.s_[3], np.s_[3:5], np.s_[..., 4], np.s_[2, ..., 1:3], np.s_[:, 2, 3], np.s_[...], np.s_[-1, :, 5:]):
        np.testing.assert_array_equal(store[place], noise[place])
    assert (store.ndim, store.size, len(store)) == (3, noise.size, len(noise))
    with pytest.raises(IndexError):
        store[40]
    dask = pytest.importorskip("dask.array")
    assert dask.from_array(store, chunks=16).max().compute() == noise.max()


UNKNOWN = [
    ({"errr": 3}, r"isosurface\(\) got an unexpected keyword argument 'errr'; did you mean error=\?"),
    ({"zzz": 3}, r"isosurface\(\) got an unexpected keyword argument 'zzz'$"),
    ({"method": "lewiner"}, r"isosurface\(\) .*'method'; there is one method: leave it out"),
]


@pytest.mark.parametrize("wrong, message", UNKNOWN, ids=str)
def test_an_unknown_keyword_is_named_as_its_caller_wrote_it(store, noise, wrong, message):
    for surface in (store.isosurface, lambda *a, **k: isonest.isosurface(noise, *a, **k)):
        with pytest.raises(TypeError, match=message) as caught:
            surface(0.3, **wrong)
        assert "Extracting" not in str(caught.value)


@pytest.mark.parametrize("name, way", [("mask", "isonest.isosurface() with an array"), ("step_size", "error= and distance="),
                                       ("allow_degenerate", "leave it out"), ("spacing", "isonest.preprocess()"),
                                       ("origin", "isonest.preprocess()")])
def test_what_a_store_does_not_take_has_a_way(store, name, way):
    with pytest.raises(TypeError) as caught:
        store.isosurface(0.3, **{name: 2})
    assert way in str(caught.value)


def test_what_only_a_store_takes_has_a_way(noise):
    for name, way in (("dataset", "isonest.preprocess()"), ("indicators", "isonest.preprocess()")):
        with pytest.raises(TypeError) as caught:
            isonest.isosurface(noise, 0.3, **{name: "x"})
        assert way in str(caught.value)


def test_messages_name_public_functions(store, noise):
    for call, name in ((lambda: store.slice((1, 0, 0), 3, bx=1), "Store.slice()"),
                       (lambda: store.label_surface(1, bx=1), "Store.label_surface()"),
                       (lambda: store.values(bx=1), "Store.values()"),
                       (lambda: isonest.smooth(noise, steps=1, tau=1, lambda_=1, spacng=1), "smooth()"),
                       (lambda: store.check(source=noise, spacng=1), "check()"),
                       (lambda: isonest.preprocess(noise, "x", spacng=1), "preprocess()")):
        with pytest.raises(TypeError) as caught:
            call()
        assert str(caught.value).startswith(f"{name} got an unexpected keyword argument"), caught.value
    assert isonest.Store.isosurface.__qualname__ == "Store.isosurface"


@pytest.mark.parametrize("name, kind", [("v.npy", "NumPy"), ("v.nrrd", "NRRD")])
def test_opening_a_volume_says_what_it_is(tmp_path, name, kind, noise):
    path = tmp_path / name
    if kind == "NumPy":
        np.save(path, noise)
    else:
        path.write_bytes(b"NRRD0004\ntype: uint8\ndimension: 3\nsizes: 2 2 2\nencoding: raw\n\n" + bytes(8))
    for call in (isonest.open, isonest.view):
        with pytest.raises(isonest.InvalidArgumentError) as caught:
            call(path)
        assert f"{path}: a volume ({kind}" in str(caught.value) and "not a store" in str(caught.value)
        assert "isonest.isosurface(volume, iso)" in caught.value.remedies[1] and caught.value.file == str(path)


def test_a_dataset_that_is_not_there_is_not_asked_for_again(tmp_path, noise):
    h5py = pytest.importorskip("h5py")
    np.savez(tmp_path / "a.npz", one=noise, two=noise)
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file["one"], file["two"] = noise, noise
    vtk = pathlib.Path(tmp_path / "a.vtk")
    vtk.write_text("# vtk DataFile Version 3.0\nx\nASCII\nDATASET STRUCTURED_POINTS\nDIMENSIONS 2 2 2\nORIGIN 0 0 0\n"
                   "SPACING 1 1 1\nPOINT_DATA 8\nSCALARS one float 1\nLOOKUP_TABLE default\n1 2 3 4 5 6 7 8\n")
    for path in (tmp_path / "a.npz", tmp_path / "a.h5", vtk):
        with pytest.raises(isonest.Error) as caught:
            isonest.preprocess(path, tmp_path / "x", dataset="three")
        assert "one" in str(caught.value) and "dataset=" not in str(caught.value), caught.value


def test_keywords_of_0_4_give_the_same_mesh_with_a_warning(store, noise):
    for surface in (store.isosurface, lambda *a, **k: isonest.isosurface(noise, *a, **k)):
        for old, new in (({"guarantee": "plus", "error": 0.2}, {"indicator": "plus", "error": 0.2}),
                         ({"simplify": True, "error": 0.2}, {"error": 0.2}),
                         ({"simplify": False, "error": 0.2}, {"effort": "none", "error": 0.2}),
                         ({"simplify": False, "distance": 0.5}, {"distance": 0.5}),
                         ({"no_simplify": True, "distance": 0.5}, {"effort": "none", "distance": 0.5}),
                         ({"no_simplify": False, "distance": 0.5}, {"distance": 0.5})):
            with pytest.deprecated_call(match=f"{next(iter(old))}= is deprecated"):
                mesh = surface(0.3, **old)
            same_mesh(mesh, surface(0.3, **new))
    with pytest.deprecated_call():
        mesh = store.slice((1, 0, 0), 4.0, error=0.2, guarantee="plus")
    same_mesh(mesh, store.slice((1, 0, 0), 4.0, error=0.2, indicator="plus"))
