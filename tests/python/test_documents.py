"""The snippets of README.md and tools/python/README.md run, and the example works."""
import os
import pathlib
import re
import subprocess
import sys

import numpy as np
import pytest

import isonest

PYTHON = pathlib.Path(__file__).resolve().parents[2] / "tools" / "python"
TEXT = (PYTHON / "README.md").read_text(encoding="utf-8")


def snippets(section):
    part = TEXT[TEXT.index(f"\n## {section}"):] + "\n## "
    return re.findall(r"```python\n(.*?)```", part[:part.index("\n## ", 1)], re.S)


@pytest.fixture(scope="module")
def ten_minutes(tmp_path_factory):
    """The folder and the variables after running the snippets of "Ten minutes"."""
    pytest.importorskip("meshio")
    pytest.importorskip("vtkmodules.vtkFiltersCore")
    folder = tmp_path_factory.mktemp("documents")
    names = {}
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        for code in snippets("Ten minutes"):
            exec(code, names)  # noqa: S102
    return folder, names


@pytest.fixture
def names(ten_minutes, monkeypatch):
    monkeypatch.chdir(ten_minutes[0])
    return dict(ten_minutes[1])


def test_the_snippets_run(names, capsys):
    volume = names["volume"]
    np.testing.assert_array_equal(names["quarter"], volume[::4, ::4, ::4])
    np.testing.assert_array_equal(names["part"], volume[10:20, :, 40])
    assert names["small"].report.distance_bound <= 0.5 and len(names["fewer"].faces) <= 3000
    assert pathlib.Path("gyroid.vtu").stat().st_size > 10_000 and pathlib.Path("gyroid.glb").stat().st_size > 10_000
    assert names["polydata"].GetNumberOfPolys() == len(names["surface"].faces)
    capsys.readouterr()
    for section, count in (("What the program does, from Python", 2), ("What goes in", 2),
                           ("Errors, progress, Ctrl-C", 2), ("In napari and 3D Slicer", 1)):
        assert len(snippets(section)) == count
        for code in snippets(section):
            exec(code, names)  # noqa: S102
    np.testing.assert_array_equal(isonest.open("mapped.isonest").values(), volume)
    np.testing.assert_array_equal(isonest.open("raw.isonest").values(), volume)
    np.testing.assert_array_equal(isonest.open("second.isonest").values(), -volume[8:40, :, -64:][::2, ::2, ::2])
    np.testing.assert_array_equal(isonest.open("masked.isonest").values(), np.where(volume > 1.4, np.nan, volume))
    out = capsys.readouterr().out
    assert "1 liver (221, 130, 101) 196\n2 spleen (157, 108, 162) 196\n" in out
    assert re.search(r"give memory=\d+ or more", out) and "levels 0-2 1474560 of 1474560 B" in out


def test_the_snippet_in_the_main_readme_runs(names, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (code,) = re.findall(r"```python\n(.*?)```", (PYTHON.parents[1] / "README.md").read_text(encoding="utf-8"), re.S)
    exec(code, names)  # noqa: S102
    assert len(names["vertices"]) == len(names["normals"]) and names["mesh"].report.distance_bound <= 0.5
    assert (tmp_path / "surface.glb").stat().st_size > 1000


def test_the_snippet_for_view_runs(names, capsys, monkeypatch):
    program = os.environ.get("ISONEST_PROGRAM", "")
    if not program or subprocess.run([program, "view", "--help"], capture_output=True, check=False).returncode != 0:
        pytest.skip("ISONEST_PROGRAM names no program that has the command view")
    monkeypatch.setenv("ISONEST", program)
    (code,) = snippets("In a window of the browser")
    exec(code, names)  # noqa: S102
    assert re.fullmatch(r"http://127\.0\.0\.1:\d+/\?token=\w+\n", capsys.readouterr().out)
    assert names["view"].closed


def test_the_example_runs(tmp_path):
    done = subprocess.run([sys.executable, PYTHON / "examples" / "first_surface.py", tmp_path], check=True,
                          capture_output=True, text=True)
    full, coarse = map(int, re.search(r"full resolution: (\d+) triangles; within [\d.]+: (\d+)", done.stdout).groups())
    space, less = map(float, re.search(r"space within: ([\d.]+), coarse: ([\d.]+)", done.stdout).groups())
    assert coarse < full / 2 and space == pytest.approx(less, rel=0.05) and space > 10_000
    with np.load(tmp_path / "balls.npz") as kept:
        assert len(kept["faces"]) < full / 4
    assert (tmp_path / "balls.isonest").exists()


def test_the_table_of_errors_is_true():
    table = re.findall(r"^\| `(\w+Error)`(?:, a `LimitError`)? \| `(\w+)` \|", TEXT, re.M)
    assert {name for name, _ in table} == {name for name in isonest.__all__ if name.endswith("Error")} - {
        "Error", "CancelledError"}
    for name, python in table:
        assert issubclass(getattr(isonest, name), getattr(__builtins__, python, None) or __builtins__[python])


def test_everything_public_has_a_docstring():
    for name in isonest.__all__:
        assert getattr(isonest, name).__doc__, name
    for kind in (isonest.Store, isonest.Mesh, isonest.View):
        for name in dir(kind):
            if not name.startswith("_"):
                assert getattr(kind, name).__doc__, f"{kind.__name__}.{name}"
