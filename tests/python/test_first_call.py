"""isonest.isosurface(): a volume's surface in one call, without a store unless one is needed."""
import zipfile

import numpy as np
import pytest

import isonest


def whole(mesh):
    """The triangles as a sorted array of corners with normals, each starting at its smallest corner."""
    corners = np.hstack([mesh.vertices, mesh.normals])[mesh.faces]
    first = [min(range(3), key=lambda k, t=t: tuple(t[k])) for t in corners]
    turned = np.array([np.roll(t, -k, axis=0) for t, k in zip(corners, first)]).reshape(len(corners), -1)
    return turned[np.lexsort(turned.T)]


def same_surface(ours, stored):
    assert len(ours.vertices) == len(stored.vertices) > 0
    np.testing.assert_array_equal(whole(ours), whole(stored))
    assert ours.report.area == stored.report.area


def from_store(volume, iso, path, *, spacing=None, missing=None, **query):
    isonest.preprocess(volume, path, spacing=spacing, missing=missing)
    with isonest.open(path) as store:
        return store.isosurface(iso, cells="hex", **query)


@pytest.mark.parametrize("dtype", ["u1", "i1", "u2", "i2", "u4", "i4", "f4", "f8", "f2", "i8", "?", ">f4", ">i2"])
def test_an_array_has_the_surface_of_its_store(store_path, noise, dtype):
    small = (noise[:21, :18, :15] * 12).astype("i1")
    volume = np.abs(small).astype(dtype) if dtype in ("u1", "u2", "u4") else small.astype(dtype)
    volume = small > 3 if dtype == "?" else volume
    for iso in ([0.5] if dtype == "?" else [3.0, 3.5]):
        same_surface(isonest.isosurface(volume, iso, spacing=(2, 1, 0.5)),
                     from_store(volume, iso, store_path.with_suffix(f".{iso}"), spacing=(2, 1, 0.5)))


LAYOUTS = {
    "Fortran": np.asfortranarray, "backwards": lambda v: v[::-1, ::-1, ::-1], "a part": lambda v: v[1::2, :, 2:-1],
    "turned": lambda v: v.transpose(2, 0, 1), "a view of one plane": lambda v: np.broadcast_to(v[5], v.shape),
    "masked": lambda v: np.ma.masked_greater(v, 1.0), "with holes": lambda v: np.where(v > 1.0, np.nan, v),
}


@pytest.mark.parametrize("layout", LAYOUTS)
def test_an_array_of_any_layout_has_the_surface_of_its_store(store_path, noise, layout):
    volume = LAYOUTS[layout](noise)
    ours = isonest.isosurface(volume, 0.3)
    same_surface(ours, from_store(volume, 0.3, store_path))
    again = isonest.isosurface(volume, 0.3, threads=1, memory="16M")
    np.testing.assert_array_equal(again.vertices, ours.vertices)
    np.testing.assert_array_equal(again.faces, ours.faces)
    np.testing.assert_array_equal(again.normals, ours.normals)


@pytest.mark.parametrize("layout", LAYOUTS)
def test_an_array_of_any_layout_is_simplified_like_a_contiguous_one(noise, no_store, layout):
    volume = LAYOUTS[layout](noise)
    before = np.ma.filled(volume, np.nan).copy()
    plain = before.copy()
    for query in ({"distance": 0.4, "effort": "fast"}, {"min_component": 30}):
        ours, expected = isonest.isosurface(volume, 0.3, **query), isonest.isosurface(plain, 0.3, **query)
        assert len(ours.faces) > 50
        np.testing.assert_array_equal(ours.vertices, expected.vertices)
        np.testing.assert_array_equal(ours.faces, expected.faces)
    np.testing.assert_array_equal(np.ma.filled(volume, np.nan), before)


@pytest.mark.parametrize("dtype", ["u1", "i1", "u2", "i2", "u4", "i4", "f4", "f2", "i8", ">f4", ">i2"])
def test_an_array_of_any_type_is_simplified_like_float64(noise, no_store, dtype):
    volume = np.abs(noise * 12).astype("i1")
    ours = isonest.isosurface(volume.astype(dtype), 7.5, distance=0.5, effort="fast")
    expected = isonest.isosurface(volume.astype("f8"), 7.5, distance=0.5, effort="fast")
    assert len(ours.faces) > 50
    np.testing.assert_array_equal(ours.vertices, expected.vertices)
    np.testing.assert_array_equal(ours.faces, expected.faces)


@pytest.mark.parametrize("query", [{}, {"distance": 0.4, "effort": "fast"}], ids=str)
def test_files_and_datasets_give_the_surface_of_their_array(tmp_path, noise, no_store, query):
    ours = isonest.isosurface(noise, 0.3, missing=0.25, **query)
    np.save(tmp_path / "v.npy", noise)
    volumes = [np.load(tmp_path / "v.npy", mmap_mode="r"), tmp_path / "v.npy"]
    h5py = pytest.importorskip("h5py")
    with h5py.File(tmp_path / "v.h5", "w") as file:
        file.create_dataset("v", data=noise, chunks=(16, 16, 16))
        for volume in (*volumes, file["v"]):
            mesh = isonest.isosurface(volume, 0.3, missing=0.25, **query)
            np.testing.assert_array_equal(mesh.vertices, ours.vertices)
            np.testing.assert_array_equal(mesh.faces, ours.faces)


@pytest.fixture
def no_store(monkeypatch):
    """Makes it an error to make a store."""
    def refuse(*_, **__):
        raise AssertionError("a store is made")

    monkeypatch.setattr(isonest._volume, "preprocess", refuse)


def test_at_full_resolution_an_array_needs_no_store(tmp_path, noise, no_store):
    hexahedra = isonest.isosurface(noise, 0.3, scratch=tmp_path / "none")
    for query in ({"cells": "hex"}, {"cells": "hexahedra"}, {"error": 0}, {"close": None}, {"quality": True},
                  {"box": None}, {"threads": 1}, {"indicator": "plus"}, {"pixels": 2}):
        np.testing.assert_array_equal(isonest.isosurface(noise, 0.3, **query).faces, hexahedra.faces)
    assert isonest.isosurface(noise, 0.3, quality=True).report.quality.median > 20
    assert isonest.isosurface(noise, 0.3, normals=False).normals is None
    world = isonest.isosurface(noise, 0.3, coordinates="world", gradient_direction="ascent")
    np.testing.assert_array_equal(world.vertices, hexahedra.vertices[:, ::-1])
    np.testing.assert_array_equal(world.faces, hexahedra.faces[:, ::-1])
    several = isonest.isosurface(noise, [0.3, -0.2])
    np.testing.assert_array_equal(several[0].vertices, hexahedra.vertices)
    assert len(several) == 2 and len(several[1].faces) > 0
    for wrong, error in (({"cells": "cubes"}, ValueError), ({"errors": 1}, TypeError), ({"unit": "ell"}, ValueError),
                         ({"coordinates": "x"}, ValueError), ({"gradient_direction": "x"}, ValueError),
                         ({"distance": -1}, ValueError), ({"distance": "2 miles"}, ValueError),
                         ({"distance": "1mm"}, ValueError), ({"distance": float("nan")}, ValueError),
                         ({"triangles": 0}, ValueError), ({"effort": "fast"}, ValueError),
                         ({"distance": 1, "effort": "some"}, ValueError), ({"distance": 1, "error": 1}, ValueError),
                         ({"components": 0}, ValueError), ({"min_volume": -1}, ValueError),
                         ({"by": "error"}, ValueError),
                         ({"keep_analysis": True}, ValueError), ({"cull_by": "linf_bar"}, ValueError)):
        with pytest.raises(error):
            isonest.isosurface(noise, 0.3, **wrong)
            pytest.fail(f"{wrong} was taken")
    with pytest.raises(isonest.Error, match="unit='mm' with the volume"):
        isonest.isosurface(noise, 0.3, distance="1mm")
    with pytest.raises(ValueError):
        isonest.isosurface(noise, float("nan"), distance=0.5)


@pytest.mark.parametrize("query", [
    {"error": 0.1}, {"error_relative": 0.1}, {"effort": "none", "error": 0.1},
    {"stop": "deviation_bar", "threshold": 0.1},
    {"focus": (1, 2, 3)}, {"camera": (-9, 0, 0)}, {"view": (1, 0, 0)}, {"bound": "deviation_bar"},
    {"vertices": "exact"}, {"vertex_error": "deviation_bar"},
    {"distance": 0.5, "effort": "none"}, {"distance": 0.5, "keep_analysis": True},
    {"triangles": 100, "by": "error"}, {"error": 0.1, "close": True, "volume_interval": True}], ids=str)
def test_queries_that_need_a_store_get_one(noise, no_store, query):
    for iso in (0.3, None, [0.1, 0.3]):
        with pytest.raises(AssertionError, match="a store is made"):
            isonest.isosurface(noise, iso, **query)


@pytest.mark.parametrize("query", [
    {"stop": "grad_l2_bar", "threshold": 0.1}, {"vertex_error": "grad_linf_bar"}, {"bound": "grad_linf_plus"},
    {"view": (1, 0, 0)}, {"view": (1, 0, 0), "cull_by": "grad_linf_plus"}, {"error": 0.1, "indicator": "plus"},
    {"error": 0.1, "cells": "hex", "effort": "none"}, {"error": 0.1, "cells": "hex", "indicator": "estimate"},
    {"stop": "hex_linf", "threshold": 0.1, "cells": "hex"}], ids=str)
def test_a_temporary_store_has_the_fields_of_the_query(noise, tmp_path, query):
    isonest.preprocess(noise, tmp_path / "s.isonest", indicators="all")
    # Without a bound the store's tightest is used, and the mesh is the same.
    with isonest.open(tmp_path / "s.isonest") as store:
        expected = store.isosurface(0.3, **query)
    made = isonest.isosurface(noise, 0.3, **query)
    assert len(expected.faces) > 0
    np.testing.assert_array_equal(made.vertices, expected.vertices)
    np.testing.assert_array_equal(made.faces, expected.faces)


@pytest.mark.parametrize("query", [
    {"cells": "tet"}, {"close": True}, {"box": ((1, 1, 1), (7.5, 9, 9))}, {"distance": 0.5, "close": True},
    {"cells": "tet", "close": True, "box": ((1, 1, 1), (7.5, 9, 9))}, {"cells": "tet", "distance": 0.5}], ids=str)
def test_surfaces_at_full_resolution_without_a_store_are_those_of_the_store(noise, tmp_path, monkeypatch, query):
    isonest.preprocess(noise, tmp_path / "s.isonest")
    with isonest.open(tmp_path / "s.isonest") as store:
        expected = store.isosurface(0.3, **query)

    def refuse(*arguments, **options):
        raise AssertionError("a store is made")

    monkeypatch.setattr(isonest._volume, "preprocess", refuse)
    made = isonest.isosurface(noise, 0.3, **query)
    assert np.array_equal(made.vertices, expected.vertices)
    assert np.array_equal(made.faces, expected.faces)


def test_volumes_that_need_a_store_get_one(noise, no_store):
    for volume, more in ((noise[:1], {}), (noise[0], {}), (noise, {"memory": "4M"})):
        with pytest.raises(AssertionError, match="a store is made"):
            isonest.isosurface(volume, 0.3, distance=0.5, **more)


SIMPLIFIED = [{"distance": 0.4}, {"distance": "0.5voxel", "effort": "fast"}, {"triangles": 400},
              {"triangles": 300, "distance": 1.5, "effort": "fast"}, {"distance": 0.0}, {"components": "largest"},
              {"components": 2, "distance": 0.3}, {"min_component": 40}, {"min_volume": 5.0, "distance": 0.4}]


@pytest.mark.parametrize("query", SIMPLIFIED, ids=str)
def test_stages_on_the_whole_surface_need_no_store(noise, no_store, tmp_path, query):
    made = isonest.isosurface(noise, 0.3, spacing=(2, 1, 0.5), scratch=tmp_path, **query)
    full = isonest.isosurface(noise, 0.3, spacing=(2, 1, 0.5))
    assert 0 < len(made.faces) <= len(full.faces)
    np.testing.assert_allclose(np.linalg.norm(made.normals, axis=1), 1, atol=1e-5)
    if query.get("distance") or "triangles" in query:
        assert made.report.distance_bound <= made.report.distance
        assert made.report.full_triangles == len(full.faces)
        if made.report.dropped_triangles == 0:
            assert made.report.full_area == pytest.approx(full.report.area)
    assert len(made.faces) <= query.get("triangles", len(full.faces))
    if len(made.faces) == query.get("triangles"):
        assert made.report.within_budget
    # Any threads, little memory, other coordinates.
    again = isonest.isosurface(noise, 0.3, spacing=(2, 1, 0.5), threads=1, memory="48M", coordinates="world",
                               gradient_direction="ascent", **query)
    np.testing.assert_array_equal(again.vertices, made.vertices[:, ::-1])
    np.testing.assert_array_equal(again.faces, made.faces[:, ::-1])
    assert isonest.isosurface(noise, 0.3, normals=False, **query).normals is None
    several = isonest.isosurface(noise, [0.3, -0.2], spacing=(2, 1, 0.5), **query)
    np.testing.assert_array_equal(several[0].vertices, made.vertices)
    np.testing.assert_array_equal(several[0].faces, made.faces)
    assert len(several) == 2 and several[1].values[0] == -0.2
    middle = float(noise.min()) + (float(noise.max()) - float(noise.min())) / 2
    np.testing.assert_array_equal(isonest.isosurface(noise, **query).faces,
                                  isonest.isosurface(noise, middle, **query).faces)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("query", SIMPLIFIED, ids=str)
def test_stages_on_the_whole_surface_give_the_result_of_a_store(noise, store_path, query):
    ours = isonest.isosurface(noise, 0.3, spacing=(2, 1, 0.5), **query)
    stored = from_store(noise, 0.3, store_path, spacing=(2, 1, 0.5), **query)
    for what in ("full_triangles", "components", "dropped_triangles", "largest_dropped", "value_range",
                 "coordinate_rounding", "within_budget", "mended_triangles", "border_vertices"):
        assert getattr(ours.report, what) == getattr(stored.report, what), what
    assert ours.report.full_area == pytest.approx(stored.report.full_area)
    # The requested distance; for a number of triangles, the distance that was found.
    assert ours.report.distance == pytest.approx(stored.report.distance, rel=0.02 if "triangles" in query else 0)
    if query.get("distance") or "triangles" in query:
        # The order in which edges of similar cost are collapsed depends on the order of the mesh, which differs.
        assert len(ours.faces) == pytest.approx(len(stored.faces), rel=0.02)
        assert ours.report.area == pytest.approx(stored.report.area, rel=0.002)
    else:
        same_surface(ours, stored)


def test_cells_are_hexahedra_where_possible(noise, store_path):
    isonest.preprocess(noise, store_path)
    store = isonest.open(store_path)
    for query in ({"box": ((0, 0, 0), (20, 20, 20))}, {"close": True}, {"close": True, "components": "largest"},
                  {"close": "above", "distance": 0.4, "box": ((0, 0, 0), (20, 20.5, 20))}):
        np.testing.assert_array_equal(isonest.isosurface(noise, 0.3, **query).faces,
                                      store.isosurface(0.3, cells="hex", **query).faces)
    for query in ({"error": 0.2}, {"close": True, "error": 0.2}):
        np.testing.assert_array_equal(isonest.isosurface(noise, 0.3, **query).faces,
                                      store.isosurface(0.3, cells="tet", **query).faces)


def test_the_unit_of_the_file_is_used(tmp_path, noise):
    isonest.isosurface(noise, 0.3, unit="mm", spacing=(2, 1, 0.5)).save(tmp_path / "a.3mf")
    with zipfile.ZipFile(tmp_path / "a.3mf") as archive:
        assert b'unit="millimeter"' in archive.read("3D/3dmodel.model")
    assert isonest.isosurface(noise, 0.3, unit="um", distance="500nm").report.distance == 0.5
