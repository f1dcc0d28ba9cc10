"""Checks what a benchmark needs before it starts, and says what is missing and how to get it.

Each function returns None, or a sentence that says what is missing; require() ends the program with all of
those sentences. Only uses the standard library.
"""
import ctypes
import ctypes.util
import importlib.util
import os
import pathlib
import shutil
import subprocess
import sys

ROOT = pathlib.Path(__file__).resolve().parents[2]
INSTALL = f"run {ROOT / 'tools/install-deps'} --bench"
PLUGIN = "set HDF5_PLUGIN_PATH to the build's folder plugin"


def require(*missing):
    """Ends the program, with exit code 1, if anything is missing."""
    found = [sentence for sentence in missing if sentence]
    if found:
        sys.exit("\n".join(f"{pathlib.Path(sys.argv[0]).name}: {sentence}" for sentence in found))


def arguments(least, usage, most=None):
    """The program's arguments; prints only the usage if there are too few or too many, or with --help."""
    given = sys.argv[1:]
    if given and given[0] in ("-h", "--help"):
        print(usage)
        sys.exit(0)
    if len(given) < least or (most is not None and len(given) > most):
        sys.exit(usage)
    return given


def module(name):
    """A Python module, for this interpreter."""
    try:
        found = importlib.util.find_spec(name) is not None
    except (ImportError, ValueError):
        found = False
    return None if found else (
        f"Python's module {name} is missing for {sys.executable}: {INSTALL}, which installs it for "
        "/usr/bin/python3")


def library(name, *names):
    """The shared library `name` (as in -lNAME), or one of the file names."""
    for candidate in (ctypes.util.find_library(name), *names):
        try:
            if candidate:
                ctypes.CDLL(candidate)
                return None
        except OSError:
            pass
    return f"the library {name} is missing: {INSTALL}"


def tool(name):
    return None if shutil.which(name) else f"{name} is missing: {INSTALL}"


def program(path, target="isonest"):
    """A program of this project."""
    if os.path.isfile(path) and os.access(path, os.X_OK):
        return None
    return f"{path} is no program: build it, {build_command('BUILD', target)}, and name BUILD/bin/{target}"


def file(path, what):
    return None if os.path.isfile(path) else f"{path} is missing: give {what}"


def folder(path):
    """A folder that exists or can be created."""
    try:
        pathlib.Path(path).mkdir(parents=True, exist_ok=True)
        return None
    except OSError as error:
        return f"{path}: {error.strerror}: give a folder that can be written"


def space(path, bytes_needed):
    free = shutil.disk_usage(path).free
    return None if free >= bytes_needed else (
        f"{path} has {free / 1e9:.1f} GB free, and {bytes_needed / 1e9:.1f} GB are needed: give another "
        "folder, or smaller volumes")


def zstd_filter():
    """REQUIRES: module("h5py") is available."""
    import h5py
    return None if h5py.h5z.filter_avail(32015) else f"HDF5's zstd filter is missing: {PLUGIN}"


def build_command(build, *targets):
    return (f"cmake -S {ROOT} -B {build} -G Ninja -DISONEST_BENCH=ON && cmake --build {build} --target "
            f"{' '.join(targets)}")


def built(build, *targets):
    """Builds the targets of this tree in `build`, so that they are up to date."""
    missing = [sentence for sentence in (tool("cmake"), tool("ninja")) if sentence]
    if missing:
        return "\n".join(missing)
    cache = pathlib.Path(build, "CMakeCache.txt")
    new = not cache.exists()
    if not new and f"CMAKE_HOME_DIRECTORY:INTERNAL={ROOT}\n" not in cache.read_text(errors="replace"):
        return f"{build} is a build of another tree: give one of {ROOT}, or a folder that does not exist yet"
    for command in (["cmake", "-S", ROOT, "-B", build, *(["-G", "Ninja"] if new else []),
                     "-DISONEST_BENCH=ON"],
                    ["cmake", "--build", build, "--target", *targets]):
        if subprocess.run(command, stdout=sys.stderr).returncode != 0:
            return f"the build failed, see above; for packages that it lacks {INSTALL}"
    return None
