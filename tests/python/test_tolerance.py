"""Stores of rounded values."""
import gzip
import io

import numpy as np
import pytest

import isonest


def volume(dtype):
    z, y, x = np.mgrid[:20, :24, :28]
    u = 50 + 40 * np.sin(x * 0.3) * np.cos(y * 0.2) + z + np.random.default_rng(2).normal(0, 1, (20, 24, 28))
    return u.astype(dtype)


@pytest.mark.parametrize("dtype, tolerance, most", [
    ("f4", 0.5, 0.5), ("f8", "1%", 1.5), ("u2", "bits:3", 4), ("i2", 3, 3), ("f4", "auto", 0.55), ("f4", "0.25", 0.25)])
def test_values_change_by_at_most_the_tolerance(tmp_path, dtype, tolerance, most):
    u = volume(dtype)
    isonest.preprocess(u, tmp_path / "s.isonest", tolerance=tolerance)
    with isonest.open(tmp_path / "s.isonest") as store:
        assert most / 4 < store.tolerance <= most
        off = np.abs(store.values().astype("f8") - u).max()
        assert store.tolerance / 2 < off <= store.tolerance
        mesh = store.isosurface(50.0, error=2 * store.tolerance)
        assert mesh.report.data_tolerance == store.tolerance
        assert store.tolerance <= mesh.report.error_bound <= 2 * store.tolerance
        with pytest.raises(ValueError, match="rounded within"):
            store.isosurface(50.0, error=store.tolerance / 2)
        assert store.check(source=u).failures == 0


def test_a_file_that_is_read_only_forwards(tmp_path):
    u = volume("f4")
    data = io.BytesIO()
    np.save(data, u)
    (tmp_path / "v.npy.gz").write_bytes(gzip.compress(data.getvalue()))
    isonest.preprocess(tmp_path / "v.npy.gz", tmp_path / "s.isonest", tolerance="1%")
    isonest.preprocess(u, tmp_path / "t.isonest", tolerance="1%")
    assert (tmp_path / "s.isonest").read_bytes() == (tmp_path / "t.isonest").read_bytes()


def test_without_a_tolerance_nothing_is_rounded(tmp_path):
    u = volume("i2")
    isonest.preprocess(u, tmp_path / "s.isonest")
    isonest.preprocess(u, tmp_path / "t.isonest", tolerance=0)
    assert (tmp_path / "s.isonest").read_bytes() == (tmp_path / "t.isonest").read_bytes()
    with isonest.open(tmp_path / "s.isonest") as store:
        assert store.tolerance == 0
        assert store.isosurface(50.0).report.data_tolerance == 0


@pytest.mark.parametrize("tolerance", ["many", "bits:x", "-1", -1, "101%", float("nan"), "bits:3"])
def test_wrong_tolerances_are_refused(tmp_path, tolerance):
    with pytest.raises(ValueError, match="tolerance"):
        isonest.preprocess(volume("f4"), tmp_path / "s.isonest", tolerance=tolerance)
    assert not (tmp_path / "s.isonest").exists()


def test_labels_are_not_rounded(tmp_path):
    with pytest.raises(ValueError, match="labels"):
        isonest.preprocess(volume("u2"), tmp_path / "s.isonest", labels=True, tolerance=2)
