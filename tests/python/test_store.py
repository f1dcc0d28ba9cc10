"""Slices, histograms, and a store as an object."""
import gc
import pickle
import threading

import numpy as np
import pytest

import isonest
from conftest import area


@pytest.fixture
def store(store_path, noise):
    isonest.preprocess(noise, store_path)
    return isonest.open(store_path)


def test_a_slice_through_nodes_has_their_values(store, noise):
    mesh = store.slice((1, 0, 0), 17)
    assert (mesh.vertices[:, 0] == 17).all()
    assert area(mesh.vertices, mesh.faces) == pytest.approx(32 * 26)
    y, x = mesh.vertices[:, 1].astype(int), mesh.vertices[:, 2].astype(int)
    whole = (mesh.vertices[:, 1] == y) & (mesh.vertices[:, 2] == x)
    assert whole.sum() == 33 * 27
    np.testing.assert_array_equal(mesh.values[whole], noise[17, y[whole], x[whole]])


def test_an_oblique_slice_is_within_its_error(store, noise):
    from scipy.ndimage import map_coordinates
    full = store.slice((1, 2, 3), 80.5)
    coarse = store.slice((1, 2, 3), 80.5, error=0.2)
    assert len(coarse.faces) < len(full.faces) / 2
    assert coarse.report.error_bound <= 0.2
    np.testing.assert_allclose(coarse.vertices @ [1, 2, 3], 80.5, atol=1e-3)
    off = abs(coarse.values - map_coordinates(noise, coarse.vertices.T, order=1))
    assert off.max() <= 0.2 + 0.05
    assert area(coarse.vertices, coarse.faces) == pytest.approx(area(full.vertices, full.faces), rel=1e-4)


def test_slices_in_array_and_world_coordinates(tmp_path, noise):
    isonest.preprocess(noise, tmp_path / "x", spacing=(2, 1, 0.5), origin=(100, 200, 300))
    store = isonest.open(tmp_path / "x")
    array = store.slice((1, 0.5, 0), 40, normals=True)
    world = store.slice((0, 0.5, 1), 40 + 100 + 0.5 * 200, coordinates="world", normals=True)
    np.testing.assert_allclose(world.vertices, array.vertices[:, ::-1] + [300, 200, 100], atol=1e-3)
    np.testing.assert_array_equal(world.values, array.values)
    np.testing.assert_array_equal(world.normals, array.normals[:, ::-1])


def test_values_between_nodes_and_at_nodes(tmp_path, noise):
    from scipy.ndimage import map_coordinates
    isonest.preprocess(noise, tmp_path / "x", spacing=(2, 1, 0.5), origin=(100, 200, 300))
    store = isonest.open(tmp_path / "x")
    shape = np.array(noise.shape)
    index = np.random.default_rng(1).uniform(0, 1, (50, 20, 3)) * (shape - 1)
    steps = np.array([2, 1, 0.5])
    trilinear = store.sample(index * steps, cells="hex")
    assert trilinear.shape == (50, 20)
    np.testing.assert_allclose(trilinear, map_coordinates(noise.astype(float), index.reshape(-1, 3).T,
                                                          order=1).reshape(50, 20), atol=1e-6)
    world = (index * steps)[..., ::-1] + [300, 200, 100]
    linear = store.sample(index * steps)
    np.testing.assert_array_equal(store.sample(world, coordinates="world"), linear)
    assert abs(linear - trilinear).max() < np.ptp(noise) and (linear != trilinear).any()
    nodes = np.array([[0, 0, 0], shape - 1, [3, 4, 5]])
    np.testing.assert_array_equal(store.sample(nodes * steps), noise[tuple(nodes.T)])
    assert np.isnan(store.sample([-0.1, 3, 3])) and np.isnan(store.sample([[np.nan, 3, 3]])).all()
    for wrong in (dict(points=[1, 2]), dict(points=[1, 2, 3], cells="box"), dict(points=[1, 2, 3], coordinates="x")):
        with pytest.raises(ValueError):
            store.sample(**wrong)
    with pytest.raises(IndexError):
        store.sample([1, 2, 3], level=store.levels)


def test_indicators_are_those_that_export_writes(store, tmp_path):
    for field in ("deviation_bar", "linf_plus"):
        store.export(tmp_path / "eta.npy", field, replace=True)
        written = np.load(tmp_path / "eta.npy")
        eta = store.indicator(field)
        assert eta.dtype == np.float64 and eta.max() > 0
        np.testing.assert_allclose(eta, written, rtol=1e-6)
        np.testing.assert_array_equal(store.indicator(field, 1), eta[::2, ::2, ::2])
        np.testing.assert_array_equal(store.indicator(field, 2, np.s_[1:4, 2, :]), eta[4:16:4, 8, ::4])
    with pytest.raises(ValueError):
        store.indicator("no such")
    with pytest.raises(IndexError):
        store.indicator("linf_plus", 99)


def test_the_histogram_counts_every_value_once(store, noise, tmp_path):
    h = store.histogram()
    assert len(h.edges) == len(h.counts) + 1 == len(h.cubes) + 1
    np.testing.assert_array_equal(h.counts, np.histogram(noise.astype(float), h.edges)[0])
    assert h.level == 0 and h.missing == 0 and 1 <= len(h.suggested) <= 5
    assert store.histogram(1).counts.sum() == noise[::2, ::2, ::2].size
    isonest.preprocess((noise * 9).astype(np.int8), tmp_path / "i")
    h = isonest.open(tmp_path / "i").histogram()
    np.testing.assert_array_equal(h.counts, np.bincount((noise * 9).astype(np.int8).ravel() - int(h.edges[0])))


def test_the_cubes_of_the_histogram_are_those_of_the_surface(store, noise):
    h = store.histogram()
    k = len(h.cubes) // 2
    corners = [noise[a:noise.shape[0] - 1 + a, b:noise.shape[1] - 1 + b, c:noise.shape[2] - 1 + c]
               for a in (0, 1) for b in (0, 1) for c in (0, 1)]
    low, high = np.minimum.reduce(corners), np.maximum.reduce(corners)
    assert h.cubes[k] == pytest.approx(((low < h.edges[k]) & (high >= h.edges[k])).sum(), abs=2)


def test_properties_of_a_store(store, noise, store_path):
    assert store.path == store_path and store.file_bytes == store_path.stat().st_size
    assert store.range == (noise.min(), noise.max()) and not store.has_missing
    assert store.indicators == ["linf_plus", "deviation_bar"]
    assert "40, 33, 27" in repr(store) and "float32" in repr(store)
    isonest.preprocess(np.full((3, 4, 5), np.nan), store_path.parent / "nan")
    assert isonest.open(store_path.parent / "nan").range is None


def test_the_unit_is_stored_and_distances_are_converted_to_it(store, noise, tmp_path):
    assert store.unit is None
    with pytest.raises(isonest.Error, match="a plain number|a number alone"):
        store.isosurface(0.3, distance="0.5mm")
    isonest.preprocess(noise, tmp_path / "um", spacing=(500, 500, 500), unit="micrometer")
    np.save(tmp_path / "v.npy", noise)
    isonest.preprocess(tmp_path / "v.npy", tmp_path / "file", spacing=(500, 500, 500), unit="um")
    assert (tmp_path / "um").read_bytes() == (tmp_path / "file").read_bytes()
    scaled = isonest.open(tmp_path / "um")
    assert scaled.unit == "um"
    bare = scaled.isosurface(0.3, distance=200)
    for same in ("200", "0.2mm", "200 um", "200\u00b5m", "0.4voxel"):
        mesh = scaled.isosurface(0.3, distance=same)
        assert np.array_equal(mesh.vertices, bare.vertices) and np.array_equal(mesh.faces, bare.faces), same
    with pytest.raises(isonest.Error, match="no unit of length 'furlong'.*km, m, dm"):
        scaled.isosurface(0.3, distance="1furlong")
    for volume in (noise, tmp_path / "v.npy"):
        with pytest.raises(isonest.Error, match="no unit of length 'voxel'"):
            isonest.preprocess(volume, tmp_path / "none", unit="voxel")
    assert not (tmp_path / "none").exists()


def test_the_patient_axes_are_stored(store, noise, tmp_path):
    assert store.frame is None
    np.save(tmp_path / "v.npy", noise)
    for word, frame in (("ras", "RAS"), ("lps", "LPS"), ("LPS", "LPS")):
        isonest.preprocess(noise, tmp_path / "array", frame=word, replace=True)
        isonest.preprocess(tmp_path / "v.npy", tmp_path / "file", frame=word, replace=True)
        isonest.preprocess(np.ma.masked_invalid(noise), tmp_path / "masked", frame=word, replace=True)
        assert (tmp_path / "array").read_bytes() == (tmp_path / "file").read_bytes()
        assert isonest.open(tmp_path / "array").frame == isonest.open(tmp_path / "masked").frame == frame
    for volume in (noise, tmp_path / "v.npy"):
        with pytest.raises(ValueError, match="give 'RAS' or 'LPS'"):
            isonest.preprocess(volume, tmp_path / "none", frame="axial")
    assert not (tmp_path / "none").exists()


def test_a_store_can_be_closed_and_pickled(store):
    other = pickle.loads(pickle.dumps(store))
    with store:
        pass
    with pytest.raises(ValueError, match="closed"):
        store.values()
    with pytest.raises(ValueError, match="closed"):
        store.isosurface(0.3)
    assert "closed" in repr(store)
    assert len(other.isosurface(0.3).faces) > 0


def test_indicators_are_chosen_by_name(tmp_path, noise):
    isonest.preprocess(noise, tmp_path / "x", indicators=["hex_deviation", "linf_bar", "deviation_bar", "linf_bar"])
    store = isonest.open(tmp_path / "x")
    assert store.indicators == ["linf_bar", "deviation_bar", "hex_deviation"]
    assert len(store.isosurface(0.3, error=0.2, cells="hexahedra").faces) < len(
        store.isosurface(0.3, cells="hexahedra").faces)
    errors = store.isosurface(0.3, vertex_error="linf_bar", error=0.2, indicator="estimate").errors
    assert errors.dtype == np.float32 and errors.max() > 0


def test_sets_of_indicators_have_names(tmp_path, noise):
    stores = {}
    for name, chosen in (("all", "all"), ("nodes", ["nodes"]), ("some", "linf_bar,hex_linf")):
        isonest.preprocess(noise, tmp_path / name, indicators=chosen)
        stores[name] = isonest.open(tmp_path / name).indicators
    assert len(stores["nodes"]) == 24 and not any(name.startswith("hex") for name in stores["nodes"])
    assert stores["all"] == stores["nodes"] + ["hex_linf", "hex_deviation"]
    assert stores["some"] == ["linf_bar", "hex_linf"]


def test_many_threads_may_use_a_store(store):
    expected = store.isosurface(0.3).faces
    found = []

    def work():
        for _ in range(5):
            found.append(np.array_equal(store.isosurface(0.3, threads=1).faces, expected))
            store.values(1)

    threads = [threading.Thread(target=work) for _ in range(4)]
    [t.start() for t in threads]
    [t.join() for t in threads]
    assert found == [True] * 20


def test_the_gil_is_released(store_path):
    """While one thread preprocesses, this one continues."""
    volume = np.random.default_rng(0).integers(0, 255, (256, 256, 256), dtype=np.uint8)
    thread = threading.Thread(target=isonest.preprocess, args=(volume, store_path), kwargs={"threads": 1})
    thread.start()
    steps = 0
    while thread.is_alive():
        steps += 1
    assert steps > 1000


def test_memory_does_not_grow_with_calls(store):
    def resident():
        gc.collect()
        with open("/proc/self/statm", encoding="ascii") as file:
            return int(file.read().split()[1]) * 4096

    def work():
        for _ in range(50):
            store.isosurface(0.3, vertex_values=store)
            store.values()
            store.slice((1, 0, 0), 3)

    work()
    before = resident()
    for _ in range(4):
        work()
    # Its mesh takes 1.5 MB: 200 of them would take 300 MB.
    assert resident() - before < 30e6
