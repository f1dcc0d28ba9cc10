"""Type hints: the stub matches the compiled module, and the package type-checks."""
import ast
import json
import os
import pathlib
import re
import shutil
import subprocess
import sys

import pytest

from isonest import _core

PACKAGE = pathlib.Path(_core.__file__).resolve().parent
SOURCES = pathlib.Path(__file__).resolve().parents[2] / "tools" / "python"


def public(names):
    return {name for name in names if not name.startswith("_")}


def test_the_stub_matches_the_module():
    tree = ast.parse((PACKAGE / "_core.pyi").read_text(encoding="utf-8"))
    classes = {node.name: node for node in tree.body if isinstance(node, ast.ClassDef)}

    def members(node):
        own = {n.target.id if isinstance(n, ast.AnnAssign) else n.name for n in node.body
               if isinstance(n, (ast.AnnAssign, ast.FunctionDef))}
        return own.union(*(members(classes[base.id]) for base in node.bases))

    named = {n.name for n in tree.body if isinstance(n, (ast.ClassDef, ast.FunctionDef))}
    named |= {n.target.id for n in tree.body if isinstance(n, ast.AnnAssign)}
    assert public(named) == public(vars(_core))
    for name in public(classes):
        assert public(members(classes[name])) == public(vars(getattr(_core, name))), name


def parameters(documentation):
    """The names of the parameters, from the signature that pybind11 writes; none for overloaded functions."""
    signature = re.match(r"\w+\((.*)\) -> .*", documentation.split("\n")[0])
    if signature is None:
        return None
    text = signature[1]
    while re.search(r"[\[(][^][()]*[\])]", text):  # the types contain commas too
        text = re.sub(r"[\[(][^][()]*[\])]", "", text)
    return [part.split(":")[0].split("=")[0].strip() for part in text.split(",") if part.strip(" *")]


def test_the_stub_has_the_parameters_of_the_module():
    tree = ast.parse((PACKAGE / "_core.pyi").read_text(encoding="utf-8"))
    classes = {node.name: node for node in tree.body if isinstance(node, ast.ClassDef)}

    def methods(node):
        inherited = [method for base in node.bases for method in methods(classes[base.id])]
        return inherited + [n for n in node.body if isinstance(n, ast.FunctionDef) and not n.decorator_list]

    pairs = [(node, getattr(_core, node.name)) for node in tree.body if isinstance(node, ast.FunctionDef)]
    pairs += [(method, getattr(getattr(_core, name), method.name)) for name in public(classes)
              for method in methods(classes[name])]
    compared = 0
    for stub, function in pairs:
        ours = [argument.arg for argument in stub.args.args + stub.args.kwonlyargs]
        theirs = parameters(function.__doc__ or "")
        if theirs is not None:
            compared += 1
            named = [mine if re.fullmatch(r"arg\d+", name) else name for name, mine in zip(theirs, ours)]
            assert (len(theirs), named) == (len(ours), ours), f"{function}: {theirs}"
    assert compared > 50


@pytest.mark.parametrize("folder", [PACKAGE.parent, SOURCES], ids=["with the stubs", "with the code behind the stubs"])
def test_mypy_agrees(tmp_path, folder):
    pytest.importorskip("mypy")
    done = subprocess.run([sys.executable, "-m", "mypy", "--python-version", "3.9", "--ignore-missing-imports",
                           "--cache-dir", tmp_path, "-p", "isonest"], capture_output=True, text=True, check=False, cwd=folder,
                          env={**os.environ, "MYPYPATH": str(folder)})
    assert done.returncode == 0, done.stdout


RIGHT = ["isonest.isosurface(volume, 0.1, distance=0.5, spacing=(1, 1, 2)).save('m.ply')",
         "len(isonest.isosurface(volume, [0.1, 0.2], effort='fast'))",
         "isonest.isosurface(volume, level=0.1, mask=volume > 0, step_size=2, origin=(0, 0, 1)).vertices.sum()",
         "isonest.isosurface(volume, level=[0.1, 0.2])[0].faces.sum()",
         "store.isosurface(0.1, error=1, indicator='plus', components='largest').save('m.ply')",
         "store.isosurface(level=0.1)[0].sum() + store[1:2, :, 3].sum() + len(store)",
         "vertices, faces, normals, values = isonest.isosurface(volume)",
         "print(vertices.sum(), faces.max(), normals.min(), values.mean())"]
WRONG = ["isonest.isosurface(volume, 0.1, errr=3)", "store.isosurface(0.1, errr=3)",
         "isonest.isosurface(volume, 0.1, effort='fastest')", "store.isosurface(0.1, close='yes')",
         "isonest.isosurface(volume, 0.1, method='lewiner')", "isonest.isosurface(volume, 0.1, level=[0.1])",
         "store.isosurface(0.1).vertices.nothing", "isonest.isosurface(volume)[0].nothing", "store[0].nothing"]


def typed(folder):
    """A file with the right and the wrong lines, and the numbers of the wrong ones."""
    (folder / "typed.py").write_text("import numpy as np\nimport isonest\nvolume = np.zeros((4, 4, 4))\n"
                                     "store = isonest.open('x')\n" + "\n".join(RIGHT + WRONG) + "\n")
    return set(range(5 + len(RIGHT), 5 + len(RIGHT) + len(WRONG)))


def test_mypy_knows_the_keywords_and_their_values(tmp_path):
    pytest.importorskip("mypy")
    wrong = typed(tmp_path)
    done = subprocess.run([sys.executable, "-m", "mypy", "--ignore-missing-imports", "--cache-dir", tmp_path, "typed.py"],
                          capture_output=True, text=True, check=False, cwd=tmp_path,
                          env={**os.environ, "MYPYPATH": str(PACKAGE.parent)})
    lines = {int(line.split(":")[1]) for line in done.stdout.splitlines() if ": error:" in line}
    assert lines == wrong, done.stdout


def test_mypy_agrees_with_the_example(tmp_path):
    pytest.importorskip("mypy")
    done = subprocess.run([sys.executable, "-m", "mypy", "--strict", "--ignore-missing-imports", "--cache-dir", tmp_path,
                           SOURCES / "examples/first_surface.py"], capture_output=True, text=True, check=False,
                          cwd=tmp_path, env={**os.environ, "MYPYPATH": str(PACKAGE.parent)})
    assert done.returncode == 0, done.stdout


def test_pyright_agrees(tmp_path):
    """Pyright is no package of Debian's: npm install --global pyright, or PYRIGHT=..."""
    pyright = shutil.which(os.environ.get("PYRIGHT", "pyright"))
    if pyright is None:
        pytest.skip("pyright is not installed")
    wrong = typed(tmp_path)
    (tmp_path / "pyrightconfig.json").write_text(json.dumps({
        "extraPaths": [str(PACKAGE.parent)], "reportAttributeAccessIssue": "error", "reportUnusedExpression": "none",
        "pythonVersion": "3.9"}))
    (tmp_path / "example.py").write_bytes((SOURCES / "examples/first_surface.py").read_bytes())
    done = subprocess.run([pyright, "--outputjson", "--pythonpath", sys.executable, "-p", tmp_path], capture_output=True, text=True,
                          check=False)
    found = json.loads(done.stdout)["generalDiagnostics"]
    assert {(pathlib.Path(one["file"]).name, one["range"]["start"]["line"] + 1) for one in found
            if one["severity"] == "error"} == {("typed.py", line) for line in wrong}, found
