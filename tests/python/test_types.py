"""The hints: those of the compiled module name what it has, and the package agrees with them."""
import ast
import pathlib
import subprocess
import sys

import pytest

from isonest import _core

PACKAGE = pathlib.Path(_core.__file__).resolve().parent


def public(names):
    return {name for name in names if not name.startswith("_")}


def test_the_stub_has_what_the_module_has():
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


def test_mypy_agrees(tmp_path):
    pytest.importorskip("mypy")
    done = subprocess.run([sys.executable, "-m", "mypy", "--python-version", "3.9", "--ignore-missing-imports",
                           "--cache-dir", tmp_path, "-p", "isonest"], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout
