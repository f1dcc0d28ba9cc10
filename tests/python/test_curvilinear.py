"""Grids whose nodes each have a position of their own."""
import h5py
import numpy as np
import pytest

import isonest

NODES = (9, 21, 24)  # z, y, x


@pytest.fixture
def grid(tmp_path):
    """A file with longitude and latitude of two axes, and the positions [z, y, x, 3]."""
    k, j, i = np.meshgrid(*map(np.arange, NODES), indexing="ij")
    lon, lat = (10 + 0.5 * i + 0.1 * j)[0], (50 + 0.4 * j - 0.05 * i)[0]
    values = (8 - np.sqrt((i - 12)**2 + (j - 10)**2 + 4 * (k - 4)**2)).astype("f4")
    with h5py.File(tmp_path / "v.h5", "w") as file:
        for name, data, units in (("lon", lon, "degrees_east"), ("lat", lat, "degrees_north")):
            file[name] = data
            file[name].attrs["units"] = units
        file["t"] = values
        file["t"].attrs["coordinates"] = "lat lon"
    positions = np.stack(np.broadcast_arrays(lon, lat, k), -1).astype(float)
    isonest.preprocess(tmp_path / "v.h5", tmp_path / "s.isonest", dataset="t", chunk=8)
    return isonest.open(tmp_path / "s.isonest"), positions, values


def test_a_store_has_the_positions_of_its_nodes(grid):
    store, positions, _ = grid
    assert store.curvilinear and store.folded_cells == 0
    np.testing.assert_array_equal(store.positions(), positions)
    box = (slice(2, 7), slice(3, None), slice(-5, -1))
    np.testing.assert_array_equal(store.positions(box), positions[box])
    assert store.positions((slice(3, 3),) * 3).size == 0
    with pytest.raises(ValueError):
        store.positions((slice(0, 9, 2), slice(None), slice(None)))
    with pytest.raises(ValueError, match="curvilinear"):
        store.coordinates


def test_other_stores_have_positions_too(tmp_path):
    values = np.zeros((4, 5, 6), "f4")
    isonest.preprocess(values, tmp_path / "s.isonest", spacing=(3, 2, 1), origin=(7, 8, 9))
    store = isonest.open(tmp_path / "s.isonest")
    assert not store.curvilinear and store.folded_cells == 0
    z, y, x = np.meshgrid(7 + 3 * np.arange(4), 8 + 2 * np.arange(5), 9 + np.arange(6), indexing="ij")
    np.testing.assert_allclose(store.positions(), np.stack([x, y, z], -1))


def test_vertices_are_between_the_positions_of_nodes(grid):
    store, positions, values = grid
    mesh = store.isosurface(2.0, coordinates="world")
    expected = []
    for axis in range(3):
        low, high = [slice(None)] * 3, [slice(None)] * 3
        low[axis], high[axis] = slice(None, -1), slice(1, None)
        a, b = values[tuple(low)].astype(float), values[tuple(high)].astype(float)
        cut = (a < 2) != (b < 2)
        t = ((2 - a[cut]) / (b[cut] - a[cut]))[:, None]
        expected.append((1 - t) * positions[tuple(low)][cut] + t * positions[tuple(high)][cut])
    expected = np.concatenate(expected)
    distances = np.linalg.norm(expected[None] - np.asarray(mesh.vertices, float)[:, None], axis=2)
    assert distances.min(0).max() < 1e-5 and distances.min(1).max() < 1e-5
    with pytest.raises(isonest.Error, match="curvilinear"):
        store.isosurface(2.0, error=0.1)
