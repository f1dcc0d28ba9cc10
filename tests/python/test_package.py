"""The installed component "python": complete, and importable from the folders that Debian and pip use."""
import os
import pathlib
import subprocess
import sys

import numpy as np
import pytest

import isonest
from isonest import _core

ROOT = pathlib.Path(__file__).resolve().parents[2]


def build_tree():
    program = os.environ.get("ISONEST_PROGRAM")
    tree = pathlib.Path(program).resolve().parent.parent if program else None
    if tree is None or not (tree / "cmake_install.cmake").exists():
        pytest.skip("ISONEST_PROGRAM names no program of a build tree")
    if "ISONEST_INSTALL:BOOL=ON" not in (tree / "CMakeCache.txt").read_text(encoding="utf-8"):
        pytest.skip("this build tree is not one that installs")
    return tree


def test_the_installed_component_can_be_imported_from_any_folder(tmp_path):
    subprocess.run(["cmake", "--install", build_tree(), "--component", "python", "--prefix", tmp_path / "prefix"],
                   check=True, capture_output=True)
    folder = tmp_path / "prefix" / "lib/python3/dist-packages"
    expected = {path.name for path in (ROOT / "tools/python/isonest").iterdir() if path.name != "__pycache__"}
    expected |= {pathlib.Path(_core.__file__).name, "_extracting.pyi", "_volume.pyi"}
    assert {path.name for path in (folder / "isonest").iterdir()} == expected
    assert not any(path.is_symlink() for path in (folder / "isonest").iterdir())
    assert {path.name for path in (tmp_path / "prefix").iterdir()} == {"lib", "share"}
    script = "import isonest, numpy; print(isonest.__file__, len(isonest.isosurface(numpy.eye(4)[None] + " \
             "numpy.zeros((4, 1, 1)), 0.5).faces) > 0)"
    done = subprocess.run([sys.executable, "-c", script], cwd=tmp_path, capture_output=True, text=True, check=True,
                          env={**os.environ, "PYTHONPATH": str(folder)})
    assert done.stdout.split() == [str(folder / "isonest/__init__.py"), "True"]


@pytest.mark.parametrize("way", ["built", "installed"])
def test_a_format_in_a_loadable_module_is_read(tmp_path, way):
    tree = build_tree()
    if not (tree / "lib/isonest/isonest_gdcm.so").exists():
        pytest.skip("this build has no GDCM")
    folder = tree / "python"
    if way == "installed":
        for component in ("isonest", "python"):
            subprocess.run(["cmake", "--install", tree, "--component", component, "--prefix", tmp_path / "prefix"],
                           check=True, capture_output=True)
        folder = tmp_path / "prefix/lib/python3/dist-packages"
    packed = ROOT / "tests/fuzz/corpus/volume/dicom_jpeg"
    subprocess.run([os.environ["ISONEST_PROGRAM"], "preprocess", packed, "-o", tmp_path / "own.isonest", "--chunk", "16"],
                   check=True, capture_output=True)
    done = subprocess.run([sys.executable, "-c", f"import isonest; isonest.preprocess({str(packed)!r}, 'x.isonest', "
                           "chunk=16); print(isonest.__file__)"], cwd=tmp_path, capture_output=True, text=True,
                          env={**os.environ, "PYTHONPATH": str(folder)})
    assert done.returncode == 0, done.stderr
    assert pathlib.Path(done.stdout.strip()).parent == folder / "isonest"
    own, found = (isonest.open(tmp_path / name).values() for name in ("own.isonest", "x.isonest"))
    np.testing.assert_array_equal(found, own)
    assert len(np.unique(found)) > 5


def test_the_version_is_that_of_the_project():
    """As the backend of pip reads it."""
    sys.path.insert(0, str(ROOT / "tools/package"))
    import sbom
    assert sbom.own_version() == isonest.__version__ == _core.version
