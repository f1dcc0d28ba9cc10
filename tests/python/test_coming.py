"""tools/python/COMING.md: every snippet of scikit-image, VTK and PyVista, and ours, have the same result."""
import pathlib
import re
import sys
import types

import numpy as np
import pytest

import isonest
from conftest import area

TEXT = (pathlib.Path(__file__).resolve().parents[2] / "tools/python/COMING.md").read_text(encoding="utf-8")
COUNT = 10


def part(section):
    if section is None:
        return TEXT[:TEXT.index("\n## ")]
    text = TEXT[TEXT.index(f"\n## {section}"):] + "\n## "
    return text[:text.index("\n## ", 1)]


def snippet(section):
    (code,) = re.findall(r"```python\n(.*?)```", part(section), re.S)
    return code


def rows(section):
    """The two code columns of the section's table, each cell as lines of code."""
    cells = [[re.findall(r"`([^`]+)`", cell) for cell in line.strip("|").split(" | ")]
             for line in part(section).splitlines() if line.startswith("| `")]
    assert len(cells) == COUNT and all(len(row) == 2 and all(row) for row in cells)
    return cells


def run(lines, names):
    """Runs the lines; returns the value of the last one."""
    for line in lines[:-1]:
        exec(line, names)  # noqa: S102
    return eval(lines[-1], names)  # noqa: S307


@pytest.fixture
def names(tmp_path, monkeypatch):
    """The variables of the page, in a folder of its own."""
    monkeypatch.chdir(tmp_path)
    found = {}
    exec(snippet(None), found)  # noqa: S102
    return found


def facts(result):
    """(what kind of thing, its size, its lowest and its highest corner)."""
    if isinstance(result, list):
        several = [facts(one) for one in result]
        return (several[0][0], sum(one[1] for one in several), np.min([one[2] for one in several], axis=0),
                np.max([one[3] for one in several], axis=0))
    if hasattr(result, "GetPolys"):
        from vtkmodules.util.numpy_support import vtk_to_numpy
        from vtkmodules.vtkFiltersCore import vtkTriangleFilter
        filter_ = vtkTriangleFilter()
        filter_.SetInputData(result)
        filter_.Update()
        done = filter_.GetOutput()
        points = vtk_to_numpy(done.GetPoints().GetData())
        corners = vtk_to_numpy(done.GetPolys().GetConnectivityArray()).reshape(-1, 3)
        return "surface", area(points, corners), points[np.unique(corners)].min(0), points[np.unique(corners)].max(0)
    if isinstance(result, np.ndarray) and result.ndim == 2 and result.shape[1] == 2:  # a line of scikit-image
        return "lines", np.linalg.norm(np.diff(result, axis=0), axis=1).sum(), result.min(0), result.max(0)
    if isinstance(result, isonest.Mesh) and result.faces.shape[1] == 2:
        plane = result.vertices[:, 1:]
        ends = plane[result.faces]
        return "lines", np.linalg.norm(ends[:, 0] - ends[:, 1], axis=1).sum(), plane.min(0), plane.max(0)
    if isinstance(result, (tuple, isonest.Mesh)):
        return "surface", area(result[0], result[1]), result[0].min(0), result[0].max(0)
    numbers = np.asarray(result, float)
    return "numbers", numbers, numbers, numbers


def same(theirs, ours, size, place):
    """Compares the facts; `size`: relative, `place`: absolute difference."""
    (kind, a, low, high), (our_kind, b, our_low, our_high) = facts(theirs), facts(ours)
    assert kind == our_kind
    np.testing.assert_allclose(b, a, rtol=size)
    if kind != "numbers":
        np.testing.assert_allclose([our_low, our_high], [low, high], atol=place)


@pytest.mark.parametrize("row", range(COUNT))
def test_scikit_image(names, row):
    pytest.importorskip("skimage.measure")
    exec(snippet("From scikit-image"), names)  # noqa: S102
    lines, our_lines = rows("From scikit-image")[row]
    theirs, ours = run(lines, names), run(our_lines, names)
    assert any(name in lines[-1] for name in ("marching_cubes(", "mesh_surface_area(", "find_contours("))
    # A mask ends at cells in one package and nodes in the other, and the middle of the range is rounded differently.
    edge = "mask=" in lines[-1]
    same(theirs, ours, 0.05 if edge else 0.01, 1.01 if edge else 1e-3)
    if isinstance(theirs, tuple):
        assert edge or len(theirs[1]) == len(ours[1])
        turn = [np.cross(p[t[:, 1]] - p[t[:, 0]], p[t[:, 2]] - p[t[:, 0]]) for p, t in (theirs[:2], ours[:2])]
        sides = [np.sign((t * m[2][m[1][:, 0]]).sum(1).sum()) for t, m in zip(turn, (theirs, ours))]
        assert sides[0] == sides[1]


def stl_of(path):
    io = pytest.importorskip("vtkmodules.vtkIOGeometry")
    reader = io.vtkSTLReader()
    reader.SetFileName(str(path))
    reader.Update()
    return reader.GetOutput()


def compared(lines, our_lines, names, theirs):
    """Runs our lines; compares with the result of theirs."""
    ours = run(our_lines, names)
    if ".stl" in our_lines[-1]:
        theirs, ours = stl_of("theirs.stl"), stl_of("ours.stl")
    if "triangles=" in our_lines[-1]:
        assert ours.GetNumberOfPolys() <= 1.01 * theirs.GetNumberOfPolys()
    # Theirs is no longer on the surface, nor at the faces of the volume.
    fewer = "triangles=" in our_lines[-1]
    same(theirs, ours, 0.02 if fewer else 0.01, 1.0 if fewer else 0.01)


@pytest.mark.parametrize("row", range(COUNT))
def test_vtk(names, row):
    pytest.importorskip("vtkmodules.vtkFiltersCore")
    exec(snippet("From VTK"), names)  # noqa: S102
    lines, our_lines = rows("From VTK")[row]
    assert "isonest" not in "".join(lines) and ("isonest." in our_lines[-1] or "store." in our_lines[-1])
    compared(lines, our_lines, names, run(lines, names))


@pytest.mark.parametrize("row", range(COUNT))
def test_pyvista(names, row, monkeypatch):
    """The rows are those of VTK. Where PyVista is not installed, ours are compared with the results of VTK's."""
    pytest.importorskip("vtkmodules.vtkFiltersCore")
    lines, our_lines = rows("From PyVista")[row]
    try:
        import pyvista  # noqa: F401
        exec(snippet("From PyVista"), names)  # noqa: S102
        theirs = run(lines, names)
    except ImportError:
        exec(snippet("From VTK"), names)  # noqa: S102
        theirs = run(rows("From VTK")[row][0], names)
        monkeypatch.setitem(sys.modules, "pyvista", types.SimpleNamespace(wrap=lambda data: data))
        names["grid"] = names["image"]
        names["surface"] = types.SimpleNamespace(n_cells=names["edges"].GetOutput().GetNumberOfPolys())
    compared(lines, our_lines, names, theirs)
