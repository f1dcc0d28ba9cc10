"""Queries for surfaces: components, stop tests, regions, kept analyses, contour lines, graphs, labels."""
import os
import subprocess

import numpy as np
import pytest

import isonest
from conftest import area, ball, signed_volume


@pytest.fixture(scope="module")
def store(tmp_path_factory, noise):
    path = tmp_path_factory.mktemp("store") / "x.isonest"
    isonest.preprocess(noise, path, indicators=["linf_bar", "linf_plus", "deviation_bar", "normal_turn_plus",
                                                "hex_linf", "hex_deviation"])
    return isonest.open(path)


@pytest.fixture(scope="module")
def specks(tmp_path_factory):
    """A large ball and two small ones that do not touch."""
    volume = np.maximum.reduce([np.roll(ball((40, 40, 60), radius), shift, axis=2)
                                for radius, shift in ((9.3, -14), (3.4, 4), (2.2, 18))])
    path = tmp_path_factory.mktemp("specks") / "x.isonest"
    isonest.preprocess(volume, path)
    return isonest.open(path)


def pieces_of(mesh):
    """The faces of each connected component, largest first, by SciPy."""
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import connected_components
    a, b = mesh.faces[:, [0, 1, 2]].ravel(), mesh.faces[:, [1, 2, 0]].ravel()
    count, of_vertex = connected_components(coo_matrix((np.ones(len(a)), (a, b)), (len(mesh.vertices),) * 2), False)
    of_face = of_vertex[mesh.faces[:, 0]]
    return sorted((mesh.faces[of_face == i] for i in range(count)), key=len, reverse=True)


def test_specks_are_dropped_by_number_triangles_or_volume(specks):
    full = specks.isosurface(0.0, coordinates="world")
    pieces = pieces_of(full)
    sizes = [len(piece) for piece in pieces]
    volumes = [abs(signed_volume(full.vertices, piece)) for piece in pieces]
    assert len(pieces) == 3 and volumes == sorted(volumes, reverse=True)
    for more, left in (({"components": "largest"}, 1), ({"components": 2}, 2), ({"components": "all"}, 3),
                       ({"min_component": sizes[1]}, 2), ({"min_component": sizes[1] + 1}, 1),
                       ({"min_volume": 0.99 * volumes[1]}, 2), ({"min_volume": 1.01 * volumes[1]}, 1)):
        mesh = specks.isosurface(0.0, coordinates="world", **more)
        assert [len(piece) for piece in pieces_of(mesh)] == sizes[:left], more
        report = mesh.report
        assert (report.components, report.dropped_components) == (3, 3 - left)
        assert report.dropped_triangles == sum(sizes[left:])
        assert report.largest_dropped == max(sizes[left:], default=0)
    small = specks.isosurface(0.0, distance="0.5voxel", components="largest")
    assert len(pieces_of(small)) == 1 and len(small.faces) < sizes[0] / 4


def test_cells_have_the_programs_names_or_full_names(store):
    for short, full in (("tet", "tetrahedra"), ("hex", "hexahedra")):
        np.testing.assert_array_equal(store.isosurface(0.3, cells=short).faces, store.isosurface(0.3, cells=full).faces)
    with pytest.raises(ValueError, match="'tet', 'hex'"):
        store.isosurface(0.3, cells="quad")


def test_exact_vertices_are_on_the_finest_surface(tmp_path):
    """For a field that is not linear along any edge of the lattice: the squared distance."""
    z, y, x = np.mgrid[:33, :33, :33] - 16.0
    isonest.preprocess(z**2 + y**2 + x**2, tmp_path / "x")
    store = isonest.open(tmp_path / "x")
    off = {}
    for vertices in ("linear", "exact"):
        mesh = store.isosurface(150.0, error=20, effort="none", vertices=vertices)
        off[vertices] = abs(np.linalg.norm(mesh.vertices - 16, axis=1) - np.sqrt(150)).max()
    full = store.isosurface(150.0, cells="tet")
    finest = abs(np.linalg.norm(full.vertices - 16, axis=1) - np.sqrt(150)).max()
    assert off["exact"] <= finest + 1e-5 < off["linear"] / 4


def test_a_threshold_on_the_error_field_is_the_error(store):
    by_error = store.isosurface(0.3, error=0.2, effort="none")
    by_field = store.isosurface(0.3, stop="deviation_bar", threshold=0.2)
    np.testing.assert_array_equal(by_field.vertices, by_error.vertices)
    largest = max(array.max for array in store.arrays if array.field == "deviation_bar")
    relative = store.isosurface(0.3, stop="deviation_bar", threshold_relative=0.1)
    assert relative.report.tolerance == pytest.approx(0.1 * largest)
    assert relative.report.indicator == "deviation_bar"


def test_simplification_within_an_error_saves_triangles(store, noise):
    from scipy.ndimage import map_coordinates
    nested = store.isosurface(0.3, error=0.2, effort="none")
    fewer = store.isosurface(0.3, error=0.2, cells="tet")
    assert len(fewer.faces) < len(nested.faces)
    assert fewer.report.nested_triangles > len(fewer.faces) and fewer.report.error_bound <= 0.2
    middles = fewer.vertices[fewer.faces].mean(1)
    assert abs(map_coordinates(noise, middles.T, order=1) - 0.3).max() <= 0.2 + 0.05
    fast = store.isosurface(0.3, error=0.2, effort="fast", cells="hex")
    best = store.isosurface(0.3, error=0.2, effort="best", cells="hex")
    assert len(best.faces) < len(fast.faces) < fast.report.nested_triangles == best.report.nested_triangles
    assert fast.report.error_bound <= 0.2 and fast.report.full_error_bound > 0
    assert fewer.report.full_error_bound is None
    middles = fast.vertices[fast.faces].mean(1)
    most = max(fast.report.error_bound, fast.report.full_error_bound)
    assert abs(map_coordinates(noise, middles.T, order=1) - 0.3).max() <= most + 1e-4
    default = store.isosurface(0.3, error=0.2)
    same = fewer if default.report.full_error_bound is None else best
    np.testing.assert_array_equal(default.faces, same.faces)
    budget = store.isosurface(0.3, triangles=2000, by="error", effort="none")
    assert len(budget.faces) <= 2000 and budget.report.distance is None
    finer = store.isosurface(0.3, triangles=2000, by="error")
    few = store.isosurface(0.3, triangles=2000, by="error", effort="fast")
    assert len(few.faces) <= 2000 and few.report.within_budget
    assert len(finer.faces) <= 2000 and finer.report.error_bound < budget.report.error_bound


def test_a_distance_with_effort_none_gives_the_nested_grid(tmp_path):
    isonest.preprocess(ball((33, 33, 33), 12.3), tmp_path / "x")
    store = isonest.open(tmp_path / "x")
    nested = store.isosurface(0.0, distance="0.5voxel", effort="none")
    simplified = store.isosurface(0.0, distance="0.5voxel")
    full = store.isosurface(0.0)
    assert len(simplified.faces) < len(nested.faces) < len(full.faces)
    assert nested.report.distance_bound <= 0.5
    # Exact vertices: as far from the sphere as the finest grid.
    assert abs(np.linalg.norm(nested.vertices - 16, axis=1) - 12.3).max() < 0.03


def test_less_effort_gives_more_triangles_within_the_distance(tmp_path):
    isonest.preprocess(ball((33, 33, 33), 12.3), tmp_path / "x")
    store = isonest.open(tmp_path / "x")
    full, best = store.isosurface(0.0), store.isosurface(0.0, distance="0.5voxel")
    np.testing.assert_array_equal(store.isosurface(0.0, distance="0.5voxel", effort="best").faces, best.faces)
    fast = store.isosurface(0.0, distance="0.5voxel", effort="fast")
    assert len(best.faces) < len(fast.faces) < len(full.faces) / 4
    assert 0 < fast.report.distance_bound <= 0.5
    few = store.isosurface(0.0, triangles=500, effort="fast")
    assert 400 < len(few.faces) <= 500 and few.report.within_budget


def test_a_kept_analysis_is_made_once(tmp_path):
    isonest.preprocess(ball((33, 33, 33), 12.3), tmp_path / "x")
    store = isonest.open(tmp_path / "x")
    assert store.analyses == []
    first = store.isosurface(0.0, distance="0.5voxel", keep_analysis=True)
    assert first.report.analysis == "made" and first.report.analysis_file.parent == tmp_path
    again = store.isosurface(0.0, distance="0.5voxel", keep_analysis=True)
    assert again.report.analysis == "found"
    np.testing.assert_array_equal(again.faces, first.faces)
    (analysis,) = store.analyses
    assert analysis.state == "current" and analysis.path == first.report.analysis_file and analysis.problem is None
    bounds, triangles = zip(*analysis.steps)
    assert list(bounds) == sorted(bounds) and list(triangles) == sorted(triangles, reverse=True)
    folder = tmp_path / "analyses"
    folder.mkdir()
    elsewhere = store.isosurface(0.0, triangles=500, keep_analysis=folder).report
    assert elsewhere.analysis == "made" and elsewhere.analysis_file.parent == folder
    analysis.path.write_bytes(analysis.path.read_bytes()[:-100])
    assert store.analyses[0].state == "damaged" and store.analyses[0].problem and not store.check(quick=True).ok


def test_the_error_grows_with_the_distance_to_the_focus(store):
    plain = store.isosurface(0.3, error=0.05, effort="none")
    middle = (20.0, 16.0, 13.0)
    np.testing.assert_array_equal(store.isosurface(0.3, error=0.05, focus=middle).faces, plain.faces)
    focused = store.isosurface(0.3, error=0.05, focus=middle, falloff=0.5)
    assert len(focused.faces) < len(plain.faces) / 2
    box = (12.0, 9.0, 7.0), (27.0, 24.0, 19.0)
    inside = store.isosurface(0.3, error=0.05, focus=box, falloff=0.5)

    def within(mesh):
        places = mesh.vertices[((mesh.vertices > box[0]) & (mesh.vertices < box[1])).all(1)]
        return {tuple(place) for place in places}
    assert within(plain) <= within(inside) and len(inside.faces) < len(plain.faces)
    world = store.isosurface(0.3, error=0.05, focus=tuple(corner[::-1] for corner in box), falloff=0.5,
                             coordinates="world")
    np.testing.assert_array_equal(world.faces, inside.faces)


def test_parts_far_from_the_camera_are_coarse(store):
    sizes = [len(store.isosurface(0.3, camera=(away, 16, 13), pixels=20, height=600).faces)
             for away in (-30, -300, -3000)]
    assert sizes[0] > 2 * sizes[1] > 4 * sizes[2]
    near = store.isosurface(0.3, camera=(-300, 16, 13), pixels=20, height=600, fov=10)
    assert len(near.faces) > sizes[1]


def test_a_bound_changes_only_the_number_of_visited_cells(store):
    tight, loose = store.isosurface(0.3, bound="deviation_bar"), store.isosurface(0.3, bound="linf_plus")
    assert (tight.report.bound, loose.report.bound) == ("deviation_bar", "linf_plus")
    np.testing.assert_array_equal(tight.vertices, loose.vertices)


def test_parts_facing_away_are_left_out(store):
    full = store.isosurface(0.3, cells="tet")
    for coordinates, view in (("array", (1.0, 0.0, 0.0)), ("world", (0.0, 0.0, 1.0))):
        seen = store.isosurface(0.3, view=view, coordinates=coordinates, cull_by="normal_turn_plus")
        assert 0 < len(seen.faces) < len(full.faces) and seen.report.culled_by == "normal_turn_plus"
        mesh = seen.in_array()
        places = {tuple(sorted(map(tuple, corners))) for corners in mesh.vertices[mesh.faces].tolist()}
        corners = full.vertices[full.faces]
        # In (z, y, x) the cross product has the opposite sign.
        facing = -np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])[:, 0]
        size = area(full.vertices, full.faces) / len(full.faces)
        front = corners[facing < -0.5 * size]
        assert len(front) > 100
        assert all(tuple(sorted(map(tuple, face))) in places for face in front.tolist())


def test_incompatible_arguments_are_refused(store):
    calls = [dict(error=0.1, error_relative=0.1), dict(error=0.1, stop="linf_bar"), dict(threshold=0.1),
             dict(stop="linf_bar", threshold=0.1, threshold_relative=0.1), dict(stop="values"),
             dict(distance=1, stop="linf_bar"), dict(distance=1, error_relative=0.1), dict(by="error"),
             dict(triangles=9, by="size"), dict(triangles=9, distance=1, by="error"),
             dict(triangles=9, effort="none"), dict(effort="fast"), dict(effort="best"), dict(distance=1, effort=""),
             dict(distance=1, keep_analysis=True, effort="fast"), dict(keep_analysis=True),
             dict(stop="linf_bar", effort="best"), dict(error=0.1, indicator="estimate", effort="fast"),
             dict(distance=1, effort="none", keep_analysis=True), dict(falloff=1), dict(cull_by="normal_turn_plus"),
             dict(components=0), dict(components="most"), dict(components=-1), dict(min_component=-1),
             dict(vertices="moved"), dict(focus=(1, 2)), dict(distance=1, focus=(1, 2, 3)),
             dict(distance=1, indicator="plus"), dict(indicator="none"), dict(error_relative=2)]
    for more in calls:
        with pytest.raises(ValueError):
            store.isosurface(0.3, **more)
            pytest.fail(f"{more} was taken")


def test_contours_are_those_of_scikit_image(store, noise):
    measure = pytest.importorskip("skimage.measure")
    values = [-0.5, 0.25, 0.875]
    mesh = store.contours((1, 0, 0), 17, values)
    assert mesh.faces.shape[1] == 2 and set(mesh.values) == set(values) and (mesh.vertices[:, 0] == 17).all()
    for value in values:
        ends = mesh.vertices[mesh.faces[(mesh.values[mesh.faces] == value).all(1)]][:, :, 1:].astype(float)
        length = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1).sum()
        lines = measure.find_contours(noise[17], value)
        theirs = sum(np.linalg.norm(np.diff(line, axis=0), axis=1).sum() for line in lines)
        assert length == pytest.approx(theirs, rel=0.01)
        # Their points are on edges of squares, which are edges of our triangles.
        ours = ends.reshape(-1, 2)
        assert all(abs(ours - point).max(1).min() < 1e-3 for line in lines for point in line)
    world = store.contours((0, 0, 1), 17, values, coordinates="world")
    np.testing.assert_array_equal(world.vertices, mesh.vertices[:, ::-1])
    assert len(store.contours((1, 0, 0), 17, values, error=0.2).faces) < 0.7 * len(mesh.faces)
    with pytest.raises(isonest.InvalidArgumentError):
        store.contours((1, 0, 0), 17, [])


def test_the_graph_of_a_map_is_its_values(tmp_path, noise):
    plane = noise[20]
    isonest.preprocess(plane, tmp_path / "map", indicators=["deviation_bar", "linf_bar", "hex_linf", "hex_deviation"])
    store = isonest.open(tmp_path / "map")
    mesh = store.graph(scale=3)
    assert len(mesh.vertices) == plane.size and len(mesh.faces) == 2 * (plane.shape[0] - 1) * (plane.shape[1] - 1)
    y, x = mesh.vertices[:, 1].astype(int), mesh.vertices[:, 2].astype(int)
    np.testing.assert_allclose(mesh.vertices[:, 0], 3 * plane[y, x], rtol=1e-6)
    coarse = store.graph(error=0.1, cells="quad")
    assert len(coarse.faces) < len(mesh.faces) / 2 and coarse.report.error_bound <= 0.1
    with pytest.raises(isonest.Error) as caught:
        store.slice((1, 0, 0), 0)
    assert "draw its graph with Store.graph" in caught.value.remedies
    with pytest.raises(ValueError, match="'quad'"):
        store.graph(cells="hex")


def test_several_labels_give_the_meshes_of_single_ones(tmp_path):
    data = np.zeros((12, 13, 14), "u2")
    data[2:5, 2:6, 2:7], data[6:10, 6:10, 6:12], data[0:3, 9:13, 10:14] = 3, 700, 9
    isonest.preprocess(data, tmp_path / "s")
    store = isonest.open(tmp_path / "s")
    for more in ({}, {"distance": "0.5voxel", "close": True}):
        found = store.label_surfaces(**more)
        assert list(found) == [3, 9, 700]
        for label, mesh in found.items():
            one = store.label_surface(label, **more)
            if not more:
                np.testing.assert_array_equal(mesh.vertices, one.vertices)
                np.testing.assert_array_equal(mesh.faces, one.faces)
            assert area(mesh.vertices, mesh.faces) == pytest.approx(area(one.vertices, one.faces), rel=0.1)
            assert (mesh.values == label).all() and mesh.report.triangles == len(mesh.faces)
    assert list(store.label_surfaces([700, 3, 3])) == [3, 700]
    assert store.label_surfaces([]) == {}
    with pytest.raises(isonest.NotFoundError, match="no label 4"):
        store.label_surfaces([3, 4])


def test_smooth_labels_share_their_triangles(tmp_path):
    data = np.ones((10, 11, 12), "u2")
    data[:, 4:, :] = 2
    data[4:7, 2:8, 3:9] = 7
    isonest.preprocess(data, tmp_path / "s", spacing=(1, 2, 0.5))
    store = isonest.open(tmp_path / "s")
    found = store.label_surfaces(smooth=True, close=True)
    volumes = [signed_volume(mesh.vertices, mesh.faces) for mesh in found.values()]
    assert np.sum(np.abs(volumes)) == pytest.approx(10 * 11 * 12)  # no gap, no overlap
    for label, mesh in found.items():
        one = store.label_surface(label, smooth=16, close=True)
        np.testing.assert_array_equal(mesh.vertices, one.vertices)
        np.testing.assert_array_equal(mesh.faces, one.faces)
        assert set(mesh.report.neighbours) == set(found) - {label}
        for other, shared in mesh.report.neighbours.items():
            assert shared == pytest.approx(found[other].report.neighbours[label], rel=1e-12)
        assert mesh.report.smooth_passes == 16 and 0 < mesh.report.smooth_bound < np.linalg.norm((1, 2, 0.5)) / 2
        assert mesh.report.volume == pytest.approx(abs(signed_volume(mesh.vertices, mesh.faces)), rel=1e-5)
        others = np.concatenate([np.sort(m.vertices[m.faces].reshape(-1, 9).view("V12").reshape(-1, 3), 1)
                                 for other, m in found.items() if other != label])
        mine = np.sort(mesh.vertices[mesh.faces].reshape(-1, 9).view("V12").reshape(-1, 3), 1)
        assert len(set(map(bytes, mine)) & set(map(bytes, others))) > 100
    assert store.label_surface(7, smooth=False).report.smooth_passes is None
    assert store.label_surface(7, smooth=0).report.smooth_passes == 0
    with pytest.raises(isonest.Error, match="smooth 65"):
        store.label_surface(7, smooth=65)
    with pytest.raises(isonest.Error, match="smooth labels"):
        store.label_surfaces(smooth=True, normals=True)


def edges_with_more_than_two(faces):
    sides = np.sort(np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]), 1)
    return int((np.unique(sides, axis=0, return_counts=True)[1] > 2).sum())


def test_meshes_of_labels_are_made_manifold(tmp_path):
    data = (np.random.default_rng(5).random((9, 10, 11)) < 0.5).astype("u1") + 1
    isonest.preprocess(data, tmp_path / "s")
    store = isonest.open(tmp_path / "s")
    for label, mesh in store.label_surfaces(smooth=True).items():
        assert mesh.report.nonmanifold_edges == edges_with_more_than_two(mesh.faces) > 0
        assert mesh.report.split_vertices == 0
        apart = store.label_surface(label, smooth=True, manifold=True)
        assert edges_with_more_than_two(apart.faces) == 0
        assert (apart.report.nonmanifold_edges, apart.report.nonmanifold_vertices) == (0, 0)
        assert len(apart.vertices) == len(mesh.vertices) + apart.report.split_vertices == apart.report.vertices
        np.testing.assert_array_equal(mesh.vertices[mesh.faces], apart.vertices[apart.faces])
        together = store.label_surfaces(smooth=True, manifold=True)[label]
        np.testing.assert_array_equal(together.faces, apart.faces)
    # Surfaces of values are manifold anyway; they are counted with quality=True.
    values = np.random.default_rng(6).integers(0, 4, (8, 9, 10)).astype("u1")
    whole = isonest.isosurface(values, 2, quality=True)
    assert (whole.report.nonmanifold_edges, whole.report.nonmanifold_vertices) == (0, 0)
    assert isonest.isosurface(values, 2).report.nonmanifold_edges is None
    same = isonest.isosurface(values, 2, manifold=True)
    np.testing.assert_array_equal(np.sort(whole.vertices[whole.faces].reshape(-1)), np.sort(same.vertices[same.faces].reshape(-1)))
    assert same.report.split_vertices == 0


def test_interfaces_contain_all_faces_of_the_labels_meshes(tmp_path):
    data = np.ones((10, 11, 12), "u2")
    data[:, 4:, :] = 2
    data[4:7, 2:8, 3:9] = 7
    isonest.preprocess(data, tmp_path / "s", spacing=(1, 2, 0.5))
    store = isonest.open(tmp_path / "s")
    for coordinates in ("array", "world"):
        mesh = store.interfaces(close=True, coordinates=coordinates)
        assert mesh.labels.shape == mesh.faces.shape[:1] + (2,) and mesh.labels.dtype == np.int64
        assert mesh.report.outside == -1 and mesh.report.volume is None and mesh.report.smooth_passes == 16
        found = store.label_surfaces(smooth=True, close=True, coordinates=coordinates)
        assert set(map(tuple, mesh.labels.tolist())) == {(1, 2), (1, 7), (2, 7), (1, -1), (2, -1)} == set(mesh.areas)
        for label, one in found.items():
            cut = np.concatenate([mesh.faces[mesh.labels[:, 0] == label],
                                  mesh.faces[mesh.labels[:, 1] == label][:, [0, 2, 1]]])
            assert sorted(mesh.vertices[cut].reshape(-1, 9).tolist()) == \
                sorted(one.vertices[one.faces].reshape(-1, 9).tolist())
    for pair, size in mesh.areas.items():
        assert size == pytest.approx(area(mesh.vertices, mesh.faces[(mesh.labels == pair).all(1)]), rel=1e-5)
    assert mesh.report.area == pytest.approx(sum(mesh.areas.values()), rel=1e-12)
    for end in ("vtp", "ply", "vtkhdf"):
        mesh.save(tmp_path / f"m.{end}")
    if program := os.environ.get("ISONEST_PROGRAM"):
        for end in ("vtp", "ply"):
            subprocess.run([program, "extract", tmp_path / "s", "--labels", "all", "--smooth", "--interfaces", "--close",
                            "-o", tmp_path / f"p.{end}"], check=True, capture_output=True)
            assert (tmp_path / f"m.{end}").read_bytes() == (tmp_path / f"p.{end}").read_bytes()
    with pytest.raises(isonest.Error, match=".vtp, .vtkhdf or .ply"):
        mesh.save(tmp_path / "m.stl")
    seven = store.interfaces([7])
    assert set(map(tuple, np.unique(seven.labels, axis=0).tolist())) == {(1, 7), (2, 7)}
    assert len(store.interfaces([]).faces) == 0 and mesh.in_array().labels is mesh.labels
    assert store.label_surface(7, smooth=True).labels is None
    with pytest.raises(isonest.Error, match="smooth"):
        store.interfaces(smooth=False)
    with pytest.raises(isonest.NotFoundError, match="no label 4"):
        store.interfaces([2, 4])


def test_components_of_smooth_labels_are_dropped(tmp_path):
    from scipy.ndimage import label as filled
    data = np.zeros((20, 22, 24), "u1")
    data[2:9, 2:9, 2:9], data[12:15, 12:15, 12:20], data[17, 3, 5], data[3, 18, 20] = 5, 5, 5, 8
    isonest.preprocess(data, tmp_path / "s")
    store = isonest.open(tmp_path / "s")
    whole = store.label_surface(5, smooth=True)
    assert whole.report.components == 0  # components were not computed
    found = store.label_surfaces(smooth=True, components=2)
    assert found[5].report.components == filled(data == 5, np.ones((3, 3, 3)))[1] == 3
    assert found[5].report.dropped_components == 1 and found[5].report.largest_dropped == 12
    assert len(found[5].faces) == len(whole.faces) - 12 and len(found[8].faces) == 12
    corners = {face.tobytes() for face in whole.vertices[whole.faces]}
    assert {face.tobytes() for face in found[5].vertices[found[5].faces]} < corners
    all_parts = store.label_surface(5, smooth=True, components="all")
    np.testing.assert_array_equal(all_parts.vertices, whole.vertices)
    assert len(store.label_surface(5, smooth=True, min_component=10 ** 6).faces) == 0
    assert store.label_surface(5, smooth=0, min_volume=73).report.volume == 7 ** 3
    with pytest.raises(isonest.Error, match="least volume"):
        store.label_surface(5, smooth=True, min_volume=float("nan"))


@pytest.mark.parametrize("more", [{}, {"error": 0.1, "cells": "hex"}, {"distance": "0.5voxel"},
                                  {"close": True, "coordinates": "world", "gradient_direction": "ascent"}])
def test_several_isovalues_give_the_mesh_of_each(store_path, noise, more):
    indicators = ["deviation_bar", "hex_linf", "hex_deviation"]
    isonest.preprocess(noise, store_path, spacing=(2, 1, 1), indicators=indicators)
    with isonest.open(store_path) as store:
        levels = [0.3, -0.5, 99.0]
        meshes = store.isosurface(levels, **more)
        assert isinstance(meshes, list) and len(meshes) == 3
        for level, mesh in zip(levels, meshes):
            own = store.isosurface(level, **more)
            for ours, theirs in zip(mesh, own):
                np.testing.assert_array_equal(ours, theirs)
            assert mesh.report.triangles == own.report.triangles
        assert len(store.isosurface(np.array([0.3]))) == 1
        with pytest.raises(ValueError, match="given twice"):
            store.isosurface([0.3, 0.3])
        with pytest.raises(ValueError, match="no isovalues"):
            store.isosurface([])


def test_labels_have_the_names_and_colours_of_the_table(tmp_path):
    data = np.zeros((12, 11, 10), "u1")
    data[2:9, 2:9, 2:5], data[2:9, 2:9, 5:9] = 7, 2
    np.save(tmp_path / "v.npy", data)
    (tmp_path / "t.txt").write_text("7 Übergang 255 0 10 255\n2 twice\n9 twice 1 2 3\n", encoding="utf-8")
    with pytest.raises(ValueError, match="label_names= is for files"):
        isonest.preprocess(data, tmp_path / "n.isonest", label_names=tmp_path / "t.txt")
    isonest.preprocess(tmp_path / "v.npy", tmp_path / "n.isonest", labels=True, label_names=tmp_path / "t.txt")
    store = isonest.open(tmp_path / "n.isonest")
    assert [(label.id, label.name, label.color) for label in store.labels()] == [
        (0, None, None), (2, "twice", None), (7, "Übergang", (255, 0, 10))]
    by_name, by_number = store.label_surface("Übergang"), store.label_surface(7)
    assert np.array_equal(by_name.vertices, by_number.vertices) and np.array_equal(by_name.faces, by_number.faces)
    assert list(store.label_surfaces(["Übergang", 2])) == [2, 7]
    with pytest.raises(isonest.NotFoundError, match="there is no label 'none'"):
        store.label_surface("none")
    with pytest.raises(isonest.InvalidArgumentError, match="2 labels .*'twice'"):
        store.label_surface("twice")
    # Saved files have names and colours, like those that the program writes.
    program = os.environ.get("ISONEST_PROGRAM")
    for end in ("glb", "3mf", "vtp"):
        for number, mesh in enumerate((by_name, store.label_surfaces([7])[7])):
            mesh.save(tmp_path / f"{number}.{end}")
            assert end != "glb" or b'"name":"\xc3\x9cbergang"' in (tmp_path / f"{number}.{end}").read_bytes()
            if program:
                subprocess.run([program, "extract", tmp_path / "n.isonest", "--label", "7", "-q", "-o", tmp_path / f"p.{end}"],
                               check=True)
                assert (tmp_path / f"{number}.{end}").read_bytes() == (tmp_path / f"p.{end}").read_bytes()


def test_labels_of_64_bits_are_ints_everywhere(tmp_path):
    ids = np.array([0, 3, 2**53 + 1, 720575940627185911, 2**62 - 1])
    labels = np.tile(ids, 24).reshape(4, 5, 6)
    np.save(tmp_path / "v.npy", labels)
    report = isonest.preprocess(tmp_path / "v.npy", tmp_path / "s", labels=True)
    assert (report.min, report.max) == (0, 2**62 - 1)
    with isonest.open(tmp_path / "s") as store:
        assert store.dtype == store.values().dtype == np.int64
        np.testing.assert_array_equal(store.values(), labels)
        np.testing.assert_array_equal(store.values(box=np.s_[1:3, :, 2]), labels[1:3, :, 2])
        assert store.range == (0, 2**62 - 1)
        values, *indicators = store.arrays[:2]
        assert (values.min, values.max) == (0, 2**62 - 1)
        edges = store.histogram().edges
        assert (edges.dtype, edges[0]) == (np.int64, 0) and edges[-1] > 2**62 - 1
        with pytest.raises(isonest.UnsupportedError, match="labels of 64 bits|64-bit labels"):
            store.slice((0, 0, 1), 1)
