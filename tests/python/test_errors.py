"""Errors raise exceptions of the right kind, progress is reported, and Ctrl-C leaves no files."""
import os
import pathlib
import signal
import subprocess
import sys
import textwrap
import threading
import time
import types

import numpy as np
import pytest

import isonest


@pytest.fixture
def store(store_path, noise):
    isonest.preprocess(noise, store_path)
    return isonest.open(store_path)


def test_every_error_is_also_a_builtin_exception():
    for name in isonest.__all__:
        kind = getattr(isonest, name)
        if name.endswith("Error") and name != "Error":
            assert issubclass(kind, isonest.Error)
            assert len([base for base in kind.__mro__ if base.__module__ == "builtins"]) > 2, name


def test_too_little_memory_is_a_memory_error_with_the_minimum_required(store, store_path, noise):
    for call in (lambda **more: isonest.preprocess(noise, store_path.parent / "y", **more),
                 lambda **more: store.isosurface(0.3, **more), lambda **more: store.slice((1, 0, 0), 3, **more),
                 lambda **more: store.values(**more), lambda **more: store.histogram(**more)):
        with pytest.raises(MemoryError) as caught:
            call(memory="4M")
        assert isinstance(caught.value, isonest.MemoryLimitError)
        enough = next(text for text in caught.value.remedies if text.startswith("give memory="))
        call(memory=int(enough.split("=")[1].split()[0]))
    assert sorted(path.name for path in store_path.parent.iterdir()) == ["x.isonest", "y"]


def test_a_mesh_too_large_for_memory_raises_memory_error(tmp_path):
    """A surface of 200 MB in a process that may allocate 60 MB more."""
    script = textwrap.dedent(f"""
        import resource
        import numpy as np
        import isonest
        volume = np.random.default_rng(0).random((100, 100, 100), np.float32)
        isonest.preprocess(volume, {str(tmp_path / "x")!r})
        store = isonest.open({str(tmp_path / "x")!r})
        store.isosurface(0.5, box=((0, 0, 0), (9, 9, 9)), threads=1)
        used = int(open("/proc/self/status").read().split("VmData:")[1].split()[0]) * 1024
        resource.setrlimit(resource.RLIMIT_DATA, (used + (60 << 20), resource.RLIM_INFINITY))
        try:
            store.isosurface(0.5, threads=1, memory="50M")
        except MemoryError as error:
            print("MemoryError")
        resource.setrlimit(resource.RLIMIT_DATA, (resource.RLIM_INFINITY, resource.RLIM_INFINITY))
        print(len(store.isosurface(0.5).faces) > 1_000_000)
    """)
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout) == (0, "MemoryError\nTrue\n"), done.stderr


def test_missing_files_and_fields_raise_file_not_found_error(tmp_path):
    for call in (lambda: isonest.open(tmp_path / "none"),
                 lambda: isonest.preprocess(tmp_path / "none.h5", tmp_path / "x"),
                 lambda: isonest.preprocess(np.zeros((3, 4, 5)), tmp_path / "no" / "x")):
        with pytest.raises(FileNotFoundError) as caught:
            call()
        assert isinstance(caught.value, isonest.NotFoundError) and caught.value.file
        assert str(tmp_path) in str(caught.value)


def test_a_damaged_store_raises_corrupt_error(store, store_path):
    content = bytearray(store_path.read_bytes())
    (store_path.parent / "cut").write_bytes(content[:len(content) // 2])
    with pytest.raises(isonest.CorruptError):
        isonest.open(store_path.parent / "cut")


def test_another_file_is_not_called_damaged(store_path):
    (store_path.parent / "text").write_text("no store" * 100)
    with pytest.raises(isonest.InvalidArgumentError) as caught:
        isonest.open(store_path.parent / "text")
    assert isinstance(caught.value, ValueError) and "isonest.preprocess" in caught.value.remedies[0]


def test_an_existing_store_is_kept_without_replace(store, store_path, noise):
    before = store_path.read_bytes()
    with pytest.raises(isonest.Error, match="replace=True"):
        isonest.preprocess(noise[::2], store_path)
    assert store_path.read_bytes() == before
    isonest.preprocess(noise[::2], store_path, replace=True)
    assert isonest.open(store_path).shape[0] == 20
    assert store.shape[0] == 40 and np.array_equal(store.values(), noise)  # the old file, which is still open


def test_invalid_arguments_raise_value_error(store, store_path, noise):
    calls = [lambda: store.isosurface(0.3, error=-1), lambda: store.isosurface(float("nan")),
             lambda: store.isosurface(0.3, distance="2 miles"), lambda: store.isosurface(0.3, error=1, distance=1),
             lambda: store.isosurface(0.3, indicator="none"), lambda: store.isosurface(0.3, cells="cubes"),
             lambda: store.isosurface(0.3, close="left"), lambda: store.isosurface(0.3, coordinates="image"),
             lambda: store.isosurface(0.3, gradient_direction="down"), lambda: store.isosurface(0.3, triangles=0),
             lambda: store.isosurface(0.3, box=((0, 0, 0), (0, 1, 1))),
             lambda: store.isosurface(0.3, box=((0, 0), (1, 1))),
             lambda: store.slice((0, 0, 0), 1), lambda: store.slice((1, 0), 1), lambda: store.values(memory="lots"),
             lambda: isonest.preprocess(noise, store_path.parent / "y", chunk=48),
             lambda: isonest.preprocess(noise, store_path.parent / "y", compression=30),
             lambda: isonest.preprocess(noise, store_path.parent / "y", spacing=(1, 1)),
             lambda: isonest.preprocess(noise, store_path.parent / "y", spacing=(1, 0, 1)),
             lambda: isonest.preprocess(noise, store_path.parent / "y", dtype="u1"),
             lambda: isonest.preprocess(noise, store_path.parent / "y", indicators=["none"])]
    for number, call in enumerate(calls):
        with pytest.raises(ValueError):
            call()
            pytest.fail(f"call {number} was taken")
    assert list(store_path.parent.iterdir()) == [store_path]


def test_the_error_for_a_missing_indicator_says_how_to_add_it(store):
    with pytest.raises(isonest.NotFoundError) as caught:
        store.isosurface(0.3, error=0.1, effort="none", cells="hexahedra")
    assert "indicators=" in str(caught.value) and "hex_deviation" in str(caught.value)
    assert all("--" not in text for text in caught.value.remedies)


def test_progress_reports_every_phase_to_its_end(store, store_path, noise):
    calls = []
    isonest.preprocess(np.tile(noise, (4, 4, 4)), store_path.parent / "y", progress=lambda *all: calls.append(all))
    assert all(isinstance(phase, str) and 0 <= done <= max(total, done) and unit for phase, done, total, unit in calls)
    phases = list(dict.fromkeys(phase for phase, *_ in calls))
    assert phases[0] == "levels 0-2" and len(phases) > 3
    ends = {phase: (done, total) for phase, done, total, _ in calls}
    assert all(done == total > 0 for done, total in ends.values()), ends
    calls.clear()
    store.values(progress=lambda *all: calls.append(all))
    assert calls == [("values", 1, 1, "chunks")]
    for call in (lambda **more: store.isosurface(0.3, **more), lambda **more: store.slice((1, 0, 0), 3, **more),
                 lambda **more: store.histogram(**more), lambda **more: isonest.isosurface(noise, 0.3, **more)):
        calls.clear()
        call(progress=lambda *all: calls.append(all))
        assert calls


def test_tqdm_bars(store, capsys):
    pytest.importorskip("tqdm")
    store.values(progress=True)
    assert "values: 100%" in capsys.readouterr().err
    with pytest.raises(TypeError):
        store.values(progress="bar")


def test_an_exception_from_progress_ends_the_work(store_path):
    class Enough(Exception):
        pass

    def stop(phase, done, total, unit):
        raise Enough(phase)

    volume = np.zeros((512, 512, 512), np.uint8)
    begin = time.monotonic()
    with pytest.raises(Enough):
        isonest.preprocess(volume, store_path, progress=stop)
    assert time.monotonic() - begin < 5
    assert not list(store_path.parent.iterdir())


INTERRUPTED = """
import sys, time
import numpy as np
import isonest

class Slow:
    shape, dtype, chunks = (100_000, 64, 64), np.dtype("u1"), (1, 64, 64)
    def __getitem__(self, place):
        time.sleep(0.01)
        return np.zeros((place[0].stop - place[0].start, 64, 64), "u1")


print("begins", flush=True)
volume = Slow() if sys.argv[2] == "slices" else np.lib.stride_tricks.as_strided(
    np.zeros(1 << 20, "u1"), (20_000, 1024, 1024), (0, 1024, 1))
try:
    {call}
except KeyboardInterrupt as error:
    print("KeyboardInterrupt", type(error).__module__, flush=True)
    sys.exit(5)
"""


@pytest.mark.parametrize("kind", ["slices", "array"])
@pytest.mark.parametrize("threads", [1, 2])
def test_ctrl_c_ends_preprocess_and_leaves_no_store(tmp_path, kind, threads):
    (tmp_path / "out").mkdir()
    call = f"isonest.preprocess(volume, sys.argv[1], threads={threads})"
    child = subprocess.Popen([sys.executable, "-c", INTERRUPTED.format(call=call), tmp_path / "out" / "x", kind],
                             stdout=subprocess.PIPE, text=True)
    assert child.stdout.readline() == "begins\n"
    deadline = time.monotonic() + 20
    while not list((tmp_path / "out").iterdir()) and time.monotonic() < deadline:
        time.sleep(0.05)  # until it has started working
    time.sleep(0.3)
    assert child.poll() is None and list((tmp_path / "out").iterdir())
    begin = time.monotonic()
    child.send_signal(signal.SIGINT)
    out, _ = child.communicate(timeout=30)
    assert (child.returncode, out) == (5, "KeyboardInterrupt builtins\n")
    assert time.monotonic() - begin < 5
    assert not list((tmp_path / "out").iterdir())


def test_ctrl_c_ends_isosurface_and_removes_its_temporary_store(tmp_path):
    call = "isonest.isosurface(volume, 0.5, scratch=sys.argv[1], error=0.01)"
    child = subprocess.Popen([sys.executable, "-c", INTERRUPTED.format(call=call), tmp_path, "array"],
                             stdout=subprocess.PIPE, text=True)
    deadline = time.monotonic() + 20
    while not list(tmp_path.glob("isonest-*/*")) and time.monotonic() < deadline:
        time.sleep(0.05)
    child.send_signal(signal.SIGINT)
    child.communicate(timeout=30)
    assert child.returncode == 5
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("kind", ["slices", "array"])
def test_ctrl_c_ends_a_surface_without_a_store_and_leaves_no_file(tmp_path, kind):
    call = "isonest.isosurface(volume, 0.5, scratch=sys.argv[1], distance=0.5, " \
           "progress=lambda *_: print('at work', flush=True))"
    child = subprocess.Popen([sys.executable, "-c", INTERRUPTED.format(call=call), tmp_path, kind],
                             stdout=subprocess.PIPE, text=True)
    lines = iter(child.stdout.readline, "")
    assert [next(lines), next(lines)] == ["begins\n", "at work\n"]
    begin = time.monotonic()
    child.send_signal(signal.SIGINT)
    out, _ = child.communicate(timeout=30)
    assert child.returncode == 5 and out.endswith("KeyboardInterrupt builtins\n")
    assert time.monotonic() - begin < 5
    assert not list(tmp_path.iterdir())


def test_an_exception_from_progress_ends_any_stage_of_a_surface(tmp_path):
    volume = np.random.default_rng(0).random((90, 90, 90), np.float32)
    seen = []

    def stop(phase, *_):
        seen.append(phase)
        if phase != seen[0]:
            raise Stop

    with pytest.raises(Stop):
        isonest.isosurface(volume, 0.5, distance=0.5, scratch=tmp_path, progress=stop)
    assert not list(tmp_path.iterdir())


class Stop(Exception):
    """An exception that ends a run."""


class Dataset:
    """Like a dataset of h5py: it is identified by its file, so a run on it can be resumed."""

    def __init__(self, volume, path, end):
        self.volume, self.shape, self.dtype, self.chunks = volume, volume.shape, volume.dtype, (16, 64, 64)
        self.file, self.name, self.end, self.asked = types.SimpleNamespace(filename=str(path)), "/data", end, []

    def __getitem__(self, place):
        if place[0].start >= self.end:
            raise Stop
        self.asked.append(place[0].start)
        return self.volume[place]


def test_an_interrupted_run_is_resumed(tmp_path):
    """The cause is raised, finished parts are kept, and the next run takes them over."""
    volume = np.random.default_rng(0).integers(0, 99, (256, 64, 64)).astype(np.uint8)
    (tmp_path / "file").touch()
    isonest.preprocess(volume, tmp_path / "whole", chunk=8)
    before = set(tmp_path.iterdir())
    with pytest.raises(Stop):
        isonest.preprocess(Dataset(volume, tmp_path / "file", 128), tmp_path / "x", chunk=8)
    assert set(tmp_path.iterdir()) == before  # no files are left without resume=True
    with pytest.raises(Stop):
        isonest.preprocess(Dataset(volume, tmp_path / "file", 128), tmp_path / "x", chunk=8, resume=True)
    assert set(tmp_path.iterdir()) > before and not (tmp_path / "x").exists()
    second = Dataset(volume, tmp_path / "file", 256)
    report = isonest.preprocess(second, tmp_path / "x", chunk=8, resume=True)
    assert report.resumed_chunks > 0 and len(second.asked) < 16
    assert (tmp_path / "x").read_bytes() == (tmp_path / "whole").read_bytes()


def test_only_identifiable_volumes_are_resumed(tmp_path):
    volume = Dataset(np.zeros((20, 64, 64), np.uint8), tmp_path / "none", 20)
    with pytest.raises(ValueError, match="resume"):
        isonest.preprocess(volume, tmp_path / "x", resume=True)
    isonest.preprocess(volume.volume, tmp_path / "x", resume=True)  # an array is identified by a digest


def test_the_temporary_folder_is_removed(tmp_path, noise):
    isonest.isosurface(noise, 0.3, scratch=tmp_path, cells="tet")
    with pytest.raises(isonest.Error):
        isonest.isosurface(noise, 0.3, scratch=tmp_path, error=-1)
    assert not list(tmp_path.iterdir())
    with pytest.raises(isonest.Error, match="none"):
        isonest.isosurface(noise, 0.3, scratch=tmp_path / "none", distance=0.5)


def test_other_threads_run_while_a_surface_is_simplified(noise):
    volume = np.tile(noise, (4, 4, 4))
    counted, ended = 0, threading.Event()

    def surface():
        isonest.isosurface(volume, 0.3, distance=0.5, effort="fast", threads=1)
        ended.set()

    worker = threading.Thread(target=surface)
    worker.start()
    begin = time.monotonic()
    while not ended.is_set():
        time.sleep(0.001)
        counted += 1
    seconds = time.monotonic() - begin
    worker.join()
    assert counted > 50 * seconds


def test_the_store_has_the_programs_bytes(tmp_path, noise):
    program = os.environ.get("ISONEST_PROGRAM")
    if not program or not pathlib.Path(program).exists():
        pytest.skip("the program isonest is not named by ISONEST_PROGRAM")
    noise.tofile(tmp_path / "raw")
    dims = ",".join(str(n) for n in noise.shape[::-1])
    subprocess.run([program, "preprocess", tmp_path / "raw", "--dims", dims, "--type", "float32", "-o",
                    tmp_path / "a"], check=True, capture_output=True)
    isonest.preprocess(noise, tmp_path / "b")
    assert (tmp_path / "a").read_bytes() == (tmp_path / "b").read_bytes()


def test_a_missing_temporary_folder_raises_an_isonest_error(store, monkeypatch):
    monkeypatch.setenv("TMPDIR", "/nowhere")
    with pytest.raises(isonest.InputOutputError, match="/nowhere.*TMPDIR"):
        store.isosurface(0.5, distance="0.5voxel")
