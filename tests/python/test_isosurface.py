"""Surfaces compared with scikit-image's marching cubes, an independent implementation."""
import gc

import numpy as np
import pytest

import isonest
from conftest import area, ball, euler_number, signed_volume

measure = pytest.importorskip("skimage.measure")
spatial = pytest.importorskip("scipy.spatial")


def hausdorff(a, b):
    """Hausdorff distance between the vertices of two meshes."""
    return max(spatial.cKDTree(a).query(b)[0].max(), spatial.cKDTree(b).query(a)[0].max())


@pytest.mark.parametrize("cells", ["tetrahedra", "hexahedra"])
@pytest.mark.parametrize("spacing", [(1, 1, 1), (2.5, 1, 0.5)])
def test_full_resolution_is_the_surface_of_marching_cubes(store_path, noise, cells, spacing):
    isonest.preprocess(noise, store_path, spacing=spacing)
    store = isonest.open(store_path)
    verts, faces, normals, values = store.isosurface(0.3, cells=cells)
    v, f, n, _ = measure.marching_cubes(noise, 0.3, spacing=spacing)
    assert verts.dtype == np.float32 and faces.dtype == f.dtype and normals.dtype == n.dtype
    np.testing.assert_allclose(verts.min(0), v.min(0), atol=1e-5)
    np.testing.assert_allclose(verts.max(0), v.max(0), atol=1e-5)
    assert area(verts, faces) == pytest.approx(area(v, f), rel=0.01)
    # All vertices of marching cubes are on edges of the lattice, which are edges of both kinds of cells.
    assert spatial.cKDTree(verts).query(v)[0].max() < 1e-4
    assert hausdorff(verts, v) < max(spacing)
    assert values.shape == (len(verts),) and (values == 0.3).all()


@pytest.mark.parametrize("direction", ["descent", "ascent"])
def test_orientation_and_normals_are_those_of_scikit_image(direction):
    volume = ball((20, 22, 24), 8)
    verts, faces, normals, values = isonest.isosurface(volume, 0.0, gradient_direction=direction)
    v, f, n, _ = measure.marching_cubes(volume, 0.0, gradient_direction=direction)
    assert signed_volume(verts, faces) == pytest.approx(signed_volume(v, f), rel=0.01)
    assert euler_number(verts, faces) == euler_number(v, f) == 2
    middle = (np.array(volume.shape) - 1) / 2
    assert ((normals * (verts - middle)).sum(1) > 0).all() and ((n * (v - middle)).sum(1) > 0).all()
    np.testing.assert_allclose(np.linalg.norm(normals, axis=1), 1, atol=1e-5)


def test_the_default_isovalue_is_the_middle_as_in_scikit_image(noise):
    ours = isonest.isosurface(noise, cells="hexahedra").vertices
    theirs = measure.marching_cubes(noise)[0]
    assert hausdorff(ours, theirs) < 1e-4


def test_the_error_bound_holds_and_saves_triangles(store_path, noise):
    isonest.preprocess(noise, store_path)
    store = isonest.open(store_path)
    full = store.isosurface(0.3)
    coarse = store.isosurface(0.3, error=0.2)
    assert 0 < coarse.report.triangles < full.report.triangles / 2
    assert 0 < coarse.report.error_bound <= 0.2
    # The data at the vertices and at the triangles' centres, by an independent interpolation.
    from scipy.ndimage import map_coordinates
    middles = coarse.vertices[coarse.faces].mean(1)
    slack = 0.05  # between nodes scipy is trilinear, isonest linear in tetrahedra
    off = abs(map_coordinates(noise, middles.T, order=1) - 0.3)
    assert 0.02 < off.max() <= 0.2 + slack


def test_values_come_from_another_store(store_path, noise, tmp_path):
    isonest.preprocess(noise, store_path)
    isonest.preprocess(np.broadcast_to(np.arange(40, dtype=np.int16)[:, None, None], noise.shape), tmp_path / "z")
    store, other = isonest.open(store_path), isonest.open(tmp_path / "z")
    mesh = store.isosurface(0.3, vertex_values=other)
    other.close()
    np.testing.assert_allclose(mesh.values, mesh.vertices[:, 0], atol=1e-4)


def test_a_relative_error_is_that_fraction_of_the_range(store_path, noise):
    isonest.preprocess(noise, store_path)
    store = isonest.open(store_path)
    low, high = store.range
    relative = store.isosurface(0.3, error_relative=0.02)
    assert relative.report.tolerance == pytest.approx(0.02 * (high - low))
    np.testing.assert_array_equal(relative.faces, store.isosurface(0.3, error=0.02 * (high - low)).faces)


def test_the_distance_bound_holds(store_path):
    volume = ball((33, 33, 33), 12.3)
    isonest.preprocess(volume, store_path)
    store = isonest.open(store_path)
    full, small = store.isosurface(0.0, cells="hex"), store.isosurface(0.0, distance="0.5voxel")
    assert small.report.triangles < full.report.triangles / 4
    assert small.report.distance_bound <= small.report.distance == 0.5
    assert small.report.full_triangles == full.report.triangles
    assert (small.report.full_area, small.report.full_volume) == (full.report.area, full.report.volume)
    assert full.report.full_area is None and full.report.full_volume is None
    assert full.report.full_volume_interval is None
    near = store.isosurface(0.0, error=0.2, close=True, volume_interval=True).report
    least, most = near.full_volume_interval
    assert least < full.report.volume < most and most - least < 0.2 * full.report.volume
    radius = np.linalg.norm(small.vertices - 16, axis=1)
    assert abs(radius - 12.3).max() < 0.5 + 0.1
    np.testing.assert_array_equal(small.faces, store.isosurface(0.0, distance=0.5).faces)
    assert store.isosurface(0.0, triangles=300).report.triangles <= 300
    assert store.isosurface(0.0, triangles=300).report.within_budget is True


def test_a_box_is_in_the_coordinates_of_the_result(store_path, noise):
    isonest.preprocess(noise, store_path, spacing=(2, 1, 0.5), origin=(100, 200, 300))
    store = isonest.open(store_path)
    low, high = (10, 5, 2.25), (41, 20, 9.5)
    part = store.isosurface(0.3, box=(low, high))
    np.testing.assert_allclose(part.vertices.min(0), low, atol=1e-3)
    np.testing.assert_allclose(part.vertices.max(0), high, atol=1e-3)
    world = store.isosurface(0.3, coordinates="world", box=((302.25, 205, 110), (309.5, 220, 141)))
    np.testing.assert_array_equal(world.faces, part.faces)
    np.testing.assert_allclose(world.vertices, part.vertices[:, ::-1] + [300, 200, 100], atol=1e-3)
    np.testing.assert_array_equal(part.in_world().vertices, world.vertices)
    np.testing.assert_array_equal(world.in_array().vertices, part.vertices)


def test_closed_solids_and_components(store_path, noise):
    isonest.preprocess(noise, store_path)
    store = isonest.open(store_path)
    solid = store.isosurface(0.3, close="below")
    edges = np.sort(np.concatenate([solid.faces[:, [0, 1]], solid.faces[:, [1, 2]], solid.faces[:, [2, 0]]]), axis=1)
    assert (np.unique(edges, axis=0, return_counts=True)[1] % 2 == 0).all()
    one = store.isosurface(0.3, components="largest")
    assert one.report.components > 1 and one.report.dropped_components == one.report.components - 1
    assert len(one.faces) < len(store.isosurface(0.3).faces)


@pytest.mark.parametrize("coordinates, rounding", [("world", 1e-10), ("array", 1e-6)])
@pytest.mark.parametrize("more", [{}, {"distance": 0.4}, {"cells": "hex"}, {"cells": "hex", "error": 0.1}])
def test_the_report_measures_the_mesh(store_path, noise, more, coordinates, rounding):
    """The mesh in world coordinates; subtracting the origin rounds them once more."""
    isonest.preprocess(noise, store_path, spacing=(2.5, 1, 0.5), origin=(7, -40, 300),
                       indicators=["deviation_bar", "hex_deviation"])
    store = isonest.open(store_path)
    for closing in ({}, {"close": "below"}, {"close": "above"}):
        if closing and "cells" in more and "error" in more:  # these cells have no caps
            break
        mesh = store.isosurface(0.3, coordinates=coordinates, **more, **closing)
        assert mesh.report.area == pytest.approx(area(mesh.vertices, mesh.faces), rel=rounding)
        if closing:
            about_one_vertex = mesh.vertices.astype(float) - mesh.vertices[0]
            assert mesh.report.volume == pytest.approx(abs(signed_volume(about_one_vertex, mesh.faces)), rel=rounding)
        else:
            assert mesh.report.volume is None


def test_an_absent_isovalue_gives_an_empty_mesh(noise):
    mesh = isonest.isosurface(noise, 1000.0)
    assert mesh.vertices.shape == (0, 3) and mesh.faces.shape == (0, 3)
    assert mesh.report.area == 0 and mesh.report.volume == 0


def test_data_in_a_plane_have_isolines():
    volume = ball((30, 40), 10)
    mesh = isonest.isosurface(volume, 0.0, normals=False)
    assert mesh.faces.shape[1] == 2 and len(mesh.faces) == len(mesh.vertices) > 50
    assert mesh.report.area is None and mesh.report.volume is None
    np.testing.assert_allclose(np.linalg.norm(mesh.vertices[:, 1:] - [14.5, 19.5], axis=1), 10, atol=0.1)


def test_vertices_and_faces_are_not_copied_and_outlive_the_store(store_path, noise):
    isonest.preprocess(noise, store_path)
    store = isonest.open(store_path)
    mesh = store.isosurface(0.3)
    memory = mesh.vertices.__array_interface__["data"][0]
    assert mesh.in_world().vertices.__array_interface__["data"][0] == memory - 8  # reversed columns
    assert mesh.vertices is mesh.vertices
    vertices, faces = mesh.vertices, mesh.faces
    before = vertices.copy(), faces.copy()
    store.close()
    del store, mesh
    gc.collect()
    _ = [np.full(len(before[0]) * 3, 7, np.float32) for _ in range(8)]
    np.testing.assert_array_equal(vertices, before[0])
    np.testing.assert_array_equal(faces, before[1])


def test_any_number_of_threads_gives_the_same_mesh(store_path, noise):
    isonest.preprocess(noise, store_path)
    store = isonest.open(store_path)
    one, two = store.isosurface(0.3, threads=1), store.isosurface(0.3, threads=2)
    np.testing.assert_array_equal(one.vertices, two.vertices)
    np.testing.assert_array_equal(one.faces, two.faces)


def test_a_rotated_volume_is_the_same_in_array_coordinates(tmp_path, monkeypatch):
    """The corners of the world's mesh are those of the array's, rotated about the origin."""
    matrix, _ = np.linalg.qr(np.random.default_rng(3).normal(size=(3, 3)))
    matrix *= np.linalg.det(matrix)
    z, y, x = np.mgrid[:14, :17, :20]
    data = np.hypot(np.hypot(x - 9, y - 8), 1.5 * (z - 6)).astype("f4")
    header = ["NRRD0005", "type: float", "dimension: 3", "space dimension: 3", "sizes: 20 17 14", "encoding: raw",
              "endian: little", "space origin: (10,20,30)", "space directions: " + " ".join(
                  "(" + ",".join(map(repr, map(float, column))) + ")" for column in matrix.T)]
    (tmp_path / "v.nrrd").write_bytes("\n".join(header).encode() + b"\n\n" + data.tobytes())
    isonest.preprocess(tmp_path / "v.nrrd", tmp_path / "v.isonest")
    store = isonest.open(tmp_path / "v.isonest")
    np.testing.assert_allclose(np.array(store.direction).T, matrix, atol=1e-12)
    plain = isonest.isosurface(data, 6.05, normals=True, cells="tet")
    found = store.isosurface(6.05, normals=True, cells="tet")
    np.testing.assert_array_equal(found.faces, plain.faces)
    np.testing.assert_allclose(found.vertices, plain.vertices, atol=1e-5)
    np.testing.assert_allclose(found.normals, plain.normals, atol=1e-5)
    world = store.isosurface(6.05, coordinates="world", cells="tet").vertices
    np.testing.assert_allclose(world, plain.vertices[:, ::-1] @ matrix.T + (10, 20, 30), atol=1e-4)
    with pytest.raises(isonest.Error):
        store.isosurface(6.05, box=((0, 0, 0), (5, 5, 5)))
    cut = store.slice((1, 0, 0), 6, coordinates="array")
    np.testing.assert_allclose(cut.vertices[:, 0], 6, atol=1e-5)
    with monkeypatch.context() as without:  # without a store
        without.delattr(isonest, "preprocess")
        found, plain = isonest.isosurface(tmp_path / "v.nrrd", 6.05), isonest.isosurface(data, 6.05)
        np.testing.assert_array_equal(found.faces, plain.faces)
        np.testing.assert_allclose(found.vertices, plain.vertices, atol=1e-5)
        np.testing.assert_allclose(found.normals, plain.normals, atol=1e-5)
        np.testing.assert_allclose(found.in_world().vertices, plain.vertices[:, ::-1] @ matrix.T + (10, 20, 30),
                                   atol=1e-4)
        near = isonest.isosurface(tmp_path / "v.nrrd", 6.05, distance=0.3)
        assert 0 < len(near.faces) < len(found.faces) / 4
        assert spatial.cKDTree(plain.vertices).query(near.vertices)[0].max() < 0.3 + 1


def test_the_list_of_labels_and_the_surface_of_one(tmp_path):
    rng = np.random.default_rng(4)
    data = rng.choice(np.array([0, 3, 9], "u2"), (8, 9, 10))
    data[3:6, 2:5, 4:8] = 700
    isonest.preprocess(data, tmp_path / "s.isonest")
    store = isonest.open(tmp_path / "s.isonest")
    found = store.labels()
    ids, counts = np.unique(data, return_counts=True)
    assert [label.id for label in found] == ids.tolist()
    assert [label.nodes for label in found] == counts.tolist()
    assert found[-1].low == (3, 2, 4) and found[-1].high == (5, 4, 7)
    for label in ids:
        binary = isonest.isosurface((data == label).astype("u2"), 0.5, cells="tet")
        surface = store.label_surface(label, cells="tet")
        np.testing.assert_array_equal(surface.vertices, binary.vertices)
        np.testing.assert_array_equal(surface.faces, binary.faces)
    assert len(store.label_surface(700, distance="1voxel").faces) < len(store.label_surface(700).faces)
    with pytest.raises(isonest.Error):
        isonest.preprocess(rng.normal(size=(5, 5, 5)), tmp_path / "f.isonest")
        isonest.open(tmp_path / "f.isonest").labels()
