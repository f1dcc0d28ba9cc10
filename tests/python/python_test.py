"""The Python package, from outside: runs tests/python with pytest against the package in the build tree.

usage: python_test.py ISONEST PLUGIN_FOLDER
"""
import os
import pathlib
import subprocess
import sys

ROOT = pathlib.Path(__file__).resolve().parents[2]
package = pathlib.Path(sys.argv[1]).resolve().parent.parent / "python"
if not list(package.glob("isonest/_core*.so")):
    print("this build tree has no Python package")
    sys.exit(77)
try:
    import numpy  # noqa: F401
    import pytest  # noqa: F401
except ImportError as error:
    print(f"{error} (Debian: python3-pytest, python3-numpy)")
    sys.exit(77)
environment = {**os.environ, "PYTHONPATH": str(package), "PYTHONDONTWRITEBYTECODE": "1",
               "ISONEST_PROGRAM": sys.argv[1], "ISONEST_PLUGIN": sys.argv[2]}
sys.exit(subprocess.run(
    [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", "-o", "python_files=test_*.py", "--rootdir",
     ROOT / "tests/python", ROOT / "tests/python", *sys.argv[3:]], env=environment).returncode)
