"""check, export, study and smooth, and the description of a store."""
import csv
import json
import os
import subprocess
import warnings

import numpy as np
import pytest

import isonest
from conftest import ball


@pytest.fixture
def store(store_path, noise):
    isonest.preprocess(noise, store_path, spacing=(2, 1, 0.5), indicators="all")
    return isonest.open(store_path)


def run(*arguments):
    program = os.environ.get("ISONEST_PROGRAM")
    if not program:
        pytest.skip("ISONEST_PROGRAM names no program")
    done = subprocess.run([program, *map(str, arguments), "--json"], capture_output=True, text=True, check=False)
    return json.loads(done.stdout)


def test_a_store_has_the_properties_that_info_reports(store, store_path):
    said = run("info", store_path)
    assert (store.format, store.exact, store.chunk, store.compression, store.file_bytes) == tuple(
        said[name] for name in ("format", "exact", "chunk", "compression", "file_bytes"))
    ours = [(list(a.shape[::-1]), list(a.chunk[::-1]), a.level, a.field, a.chunks, a.raw_bytes, a.stored_bytes, a.min,
             a.max, a.alias) for a in store.arrays]
    names = ("nodes", "chunk", "level", "field", "chunks", "raw_bytes", "stored_bytes", "min", "max", "alias")
    assert ours == [tuple(a[name] for name in names) for a in said["arrays"]]
    assert len(ours) > 10 and store.analyses == []


def test_a_good_store_passes_check_also_against_its_volume(store, noise, tmp_path):
    for more in ({"quick": True}, {}, {"deep": True}, {"source": noise}):
        report = store.check(**more)
        assert report.ok and report.failures == 0 and report.findings == [] and report.chunks > 0, more
    other = noise.copy()
    other[7, 8, 9] += 1
    report = store.check(source=other)
    assert not report.ok and report.failures == 1
    (finding,) = report.findings
    assert (finding.test, finding.level, finding.node) == ("source", 0, (7, 8, 9))
    noise.tofile(tmp_path / "v.raw")
    assert store.check(source=tmp_path / "v.raw", shape=noise.shape, dtype="f4").ok
    with pytest.raises(ValueError):
        store.check(quick=True, deep=True)
    with pytest.raises(ValueError, match="source="):
        store.check(dtype="f4")
    with pytest.raises(isonest.InvalidArgumentError):
        store.check(source=noise[1:])


def test_a_damaged_chunk_is_found(store, store_path):
    content = bytearray(store_path.read_bytes())
    at = content.index(b"\x28\xb5\x2f\xfd") + 40  # within the first frame of zstd
    content[at] ^= 0x55
    (store_path.parent / "bad").write_bytes(content)
    report = isonest.open(store_path.parent / "bad").check()
    assert not report.ok and report.failures >= 1
    assert {finding.test for finding in report.findings} & {"checksum", "decode"}
    assert report.findings[0].message and len(report.findings[0].chunk) == 3


def test_exported_values_and_indicators(store, store_path, noise, tmp_path):
    store.export(tmp_path / "v.npy")
    np.testing.assert_array_equal(np.load(tmp_path / "v.npy"), noise)
    store.export(tmp_path / "half.npy", level=1)
    # The lattice of a level covers the volume, and its last node may lie outside the volume.
    half = np.load(tmp_path / "half.npy")
    assert half.shape == (21, 17, 14)
    np.testing.assert_array_equal(half[:20], noise[::2, ::2, ::2])
    with pytest.raises(isonest.Error, match="replace=True"):
        store.export(tmp_path / "v.npy", "deviation_bar")
    store.export(tmp_path / "v.npy", "deviation_bar", replace=True)
    deviation = np.load(tmp_path / "v.npy")
    assert deviation.shape == noise.shape and deviation.dtype == np.float32
    # At the midpoint of an edge between two nodes nothing is finer: the indicator is the offset itself.
    edge = noise[0, 0, 1] - (noise[0, 0, 0].astype(float) + noise[0, 0, 2]) / 2
    store.export(tmp_path / "o.npy", "lp:inf")
    assert np.load(tmp_path / "o.npy")[0, 0, 1] == pytest.approx(abs(edge), rel=1e-5)
    assert deviation[0, 0, 1] == pytest.approx(abs(edge), rel=1e-2)
    for field in ("deviation_bar", "grad_lp:1.5_bar"):
        run("export", store_path, "--field", field, "-o", tmp_path / "theirs.nrrd", "--force")
        store.export(tmp_path / "ours.nrrd", field, replace=True)
        assert (tmp_path / "ours.nrrd").read_bytes() == (tmp_path / "theirs.nrrd").read_bytes()
    with pytest.raises(isonest.InvalidArgumentError) as caught:
        store.export(tmp_path / "x.npy", "none")
    assert "deviation_bar" in caught.value.remedies[0] and not (tmp_path / "x.npy").exists()


def test_renamed_indicators_warn_where_they_are_named(noise, tmp_path):
    path = tmp_path / "x.isonest"
    with pytest.warns(FutureWarning, match="normal_bar is now the paper's eta_N.*normal_jump_bar"):
        isonest.preprocess(noise, path, indicators=["linf_bar", "normal_jump_bar", "normal_bar"])
    store = isonest.open(path)
    assert store.indicators == ["linf_bar", "normal_jump_bar", "normal_bar"]
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        store.export(tmp_path / "jump.npy", "normal_jump_bar")
        with pytest.raises(FutureWarning):
            store.study(["normal_bar"], steps=2)
    with pytest.warns(FutureWarning, match="normal_bar"):
        store.export(tmp_path / "new.npy", "normal_bar")
    with pytest.warns(FutureWarning, match="now called normal_bar"):
        store.export(tmp_path / "former.npy", "normal_component_bar")
    new, former, jump = (np.load(tmp_path / f"{name}.npy") for name in ("new", "former", "jump"))
    np.testing.assert_array_equal(new, former)
    assert (jump >= new * 0.95).all() and (jump > new * 1.1).any()


def test_a_study_has_the_programs_table(store, store_path, tmp_path):
    fields = ["linf_plus", "lp:3_bar", "deviation_grad_lp:2_bar"]
    study = store.study(fields, norm=2, graph_distance=True, steps=4, least=0.01)
    run("study", store_path, "--fields", ",".join(fields), "--norm", "2", "--graph-distance", "--steps", "4",
        "--least", "0.01", "--out", tmp_path / "study")
    with open(tmp_path / "study" / "study.csv", encoding="utf-8", newline="") as file:
        table = list(csv.DictReader(file))
    assert len(study.rows) == len(table) == 12
    for row, theirs in zip(study.rows, table):
        assert row.field == theirs["field"]
        for name in ("threshold", "visited", "leaves", "nodes", "l1", "l2", "linf", "value_lp", "gradient_lp",
                     "gradient_linf", "graph_distance"):
            assert getattr(row, name) == pytest.approx(float(theirs[name]), rel=1e-5), name
    assert all(row.leaves <= study.all_elements for row in study.rows)


def test_the_deviation_bounds_the_error_of_a_study(store):
    low, high = store.range
    largest = max(array.max for array in store.arrays if array.field == "deviation_bar")
    rows = store.study(["deviation_bar"], steps=6, least=0.01).rows
    assert [row.leaves for row in rows] == sorted(row.leaves for row in rows)
    assert all(row.linf * (high - low) <= row.threshold * largest * (1 + 1e-6) for row in rows)
    plane = store.study(["deviation_bar"], steps=3, plane=((1, 0, 0), 40.0))
    world = store.study(["deviation_bar"], steps=3, plane=((0, 0, 1), 40.0), coordinates="world")
    assert [row.leaves for row in plane.rows] == [row.leaves for row in world.rows]
    assert 0 < plane.rows[-1].leaves < rows[-1].leaves
    iso = store.study(["deviation_bar"], steps=3, iso=0.3).rows
    assert all(0 < row.iso_leaves <= row.iso_visited <= row.visited for row in iso)
    for wrong in (dict(steps=1), dict(fields=["none"]), dict(plane=((1, 0, 0), 1e6))):
        with pytest.raises(ValueError):
            store.study(**wrong)


def test_smoothing_without_edges_is_a_gaussian():
    """With lambda_ far above all gradients, N steps are a Gaussian of variance 2 N tau."""
    from scipy.ndimage import gaussian_filter
    volume = 100 * np.exp(-((ball((40, 42, 44), 0) / 5.0) ** 2) / 2)
    smoothed = isonest.smooth(volume, steps=20, tau=0.1, lambda_=1e6, snapshots=[0, 10])
    for values, variance in ((smoothed.values, 4.0), (smoothed.snapshots[10], 2.0), (smoothed.snapshots[0], 0.0)):
        expected = gaussian_filter(volume.astype(float), np.sqrt(variance), mode="nearest", truncate=8)
        assert values.dtype == np.float32 and abs(values - expected).max() < 0.7
    assert abs(smoothed.values - volume).max() > 15
    assert len(smoothed.steps) == 20 and all(step.unknowns == volume.size for step in smoothed.steps)
    assert smoothed.steps[-1].mean == pytest.approx(smoothed.steps[0].mean, rel=1e-4)
    assert smoothed.steps[-1].variance < smoothed.steps[0].variance and smoothed.grid is None


def test_smoothing_keeps_an_edge_and_drops_noise():
    rng = np.random.default_rng(2)
    step = np.where(np.arange(48)[None, :] < 24, 0.0, 100.0) + np.zeros((40, 1))
    noisy = step + rng.normal(0, 3, step.shape)
    smoothed = isonest.smooth(noisy, steps=8, tau=1, lambda_=12, sigma=1).values
    assert smoothed.shape == noisy.shape
    flat = np.s_[:, 4:18]
    assert smoothed[flat].std() < noisy[flat].std() / 3
    assert np.median(smoothed[:, 26] - smoothed[:, 21]) > 85


def test_smoothing_arrays_files_and_stores_gives_the_programs_result(store, store_path, noise, tmp_path):
    settings = dict(steps=2, tau=0.5, lambda_=1.0, threshold=0.05)
    np.save(tmp_path / "v.npy", noise)
    run("smooth", tmp_path / "v.npy", "--spacing", "0.5,1,2", "--steps", "2", "--tau", "0.5", "--lambda", "1",
        "--threshold", "0.05", "-o", tmp_path / "theirs.nrrd", "--grid", tmp_path / "grid.raw")
    ours = isonest.smooth(noise, spacing=(2, 1, 0.5), output=tmp_path / "ours.nrrd", grid=True, **settings)
    assert (tmp_path / "ours.nrrd").read_bytes() == (tmp_path / "theirs.nrrd").read_bytes()
    assert ours.grid.dtype == bool and 0 < ours.grid.sum() < noise.size
    np.testing.assert_array_equal(ours.grid.ravel(), np.fromfile(tmp_path / "grid.raw", np.uint8))
    for volume, more in ((tmp_path / "v.npy", {"spacing": (2, 1, 0.5)}), (store, {}),
                         (np.asfortranarray(noise), {"spacing": (2, 1, 0.5), "threads": 1})):
        np.testing.assert_array_equal(isonest.smooth(volume, **settings, **more).values, ours.values)
    with pytest.raises(isonest.Error, match="replace=True"):
        isonest.smooth(noise, output=tmp_path / "ours.nrrd", **settings)
    isonest.smooth(noise, output=tmp_path / "ours.nrrd", replace=True, **settings)


def test_invalid_smoothing_is_refused_before_any_work(noise, store, tmp_path):
    good = dict(steps=1, tau=1.0, lambda_=1.0)
    for wrong in (dict(steps=-1), dict(tau=0), dict(lambda_=0), dict(sigma=-1), dict(threshold=-1),
                  dict(snapshots=[2])):
        with pytest.raises(ValueError):
            isonest.smooth(noise, **{**good, **wrong})
    with pytest.raises(NotImplementedError, match="numbers"):
        isonest.smooth(np.where(noise > 1, np.nan, noise), **good)
    with pytest.raises(MemoryError) as caught:
        isonest.smooth(noise, memory="1M", **good)
    assert "give memory=" in caught.value.remedies[0]
    with pytest.raises(FileNotFoundError):
        isonest.smooth(noise, output=tmp_path / "none" / "x.nrrd", **good)
    with pytest.raises(ValueError, match="spacing="):
        isonest.smooth(store, spacing=(1, 1, 1), **good)


def test_an_exception_ends_each_kind_of_work(store, noise, tmp_path):
    def stop(*_):
        raise ZeroDivisionError
    for call in (lambda: store.check(progress=stop), lambda: store.export(tmp_path / "x.npy", progress=stop),
                 lambda: store.study(progress=stop), lambda: store.contours((1, 0, 0), 40, [0.3], progress=stop),
                 lambda: isonest.smooth(noise, steps=2, tau=1, lambda_=1, output=tmp_path / "x.nrrd", progress=stop)):
        with pytest.raises(ZeroDivisionError):
            call()
    # Small files may have been complete before the function was called.
    assert {path.name for path in tmp_path.iterdir()} <= {"x.isonest", "x.npy", "x.nrrd"}
