"""Series in time: their times and stores."""
import json
import os
import pathlib
import pickle
import subprocess

import numpy as np
import pytest

import isonest


@pytest.fixture
def series(tmp_path):
    program = os.environ.get("ISONEST_PROGRAM")
    if not program:
        pytest.skip("ISONEST_PROGRAM names no program")
    for i in range(4):
        np.save(tmp_path / f"v{i}.npy", np.full((5, 6, 7), i, np.float32) + np.arange(7, dtype=np.float32))
    subprocess.run([program, "preprocess", *sorted(tmp_path.glob("*.npy")), "--times", "0:0.3:0.1", "-o", tmp_path / "run"], check=True,
                   capture_output=True)
    return tmp_path / "run"


def test_the_stores_are_those_of_the_steps(series):
    opened = isonest.open_series(series)
    assert (len(opened), opened.path, opened.time_unit) == (4, series, None)
    np.testing.assert_allclose(opened.times, [0, 0.1, 0.2, 0.3], rtol=1e-15)
    assert opened.times.dtype == np.float64
    assert [store.path for store in opened] == opened.stores == [series / f"step_{i:06}.isonest" for i in range(4)]
    for i in range(4):
        assert isinstance(opened[i], isonest.Store)
        assert opened[i].range[0] == i and opened[i - 4].path == opened[i].path
    assert [store.range[1] for store in opened[1:3]] == [7, 8]
    with pytest.raises(IndexError):
        opened[4]
    assert "4 steps" in repr(opened)
    assert pickle.loads(pickle.dumps(opened)).path == series


def test_a_step_is_found_by_its_time(series):
    opened = isonest.open_series(series)
    assert opened.at(0.3).path.name == "step_000003.isonest"
    assert opened.at(0).path.name == "step_000000.isonest"
    for time in (0.15, 7, -1, float("nan"), float("inf")):
        with pytest.raises(isonest.NotFoundError, match="no step at"):
            opened.at(time)


def test_what_is_no_series_is_refused(series, tmp_path):
    with pytest.raises(isonest.NotFoundError):
        isonest.open_series(tmp_path / "none")
    with pytest.raises(isonest.InvalidArgumentError, match="series.json"):
        isonest.open_series(tmp_path)
    with pytest.raises(isonest.InvalidArgumentError, match="step_000003.isonest"):
        isonest.open(series)
    index = json.loads((series / "series.json").read_text())
    (series / "series.json").write_text(json.dumps({**index, "steps": [], "time_unit": "s"}))
    empty = isonest.open_series(series)
    assert (len(empty), list(empty), len(empty.times), empty.time_unit) == (0, [], 0, "s")
    with pytest.raises(isonest.NotFoundError):
        empty.at(0)
    (series / "series.json").write_text("{")
    with pytest.raises(isonest.CorruptError, match="JSON"):
        isonest.open_series(str(series))
    pathlib.Path(series / "series.json").unlink()
