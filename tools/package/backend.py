#!/usr/bin/env python3
"""What `pip install .` calls (PEP 517): builds the Python package with the CMake, compiler and libraries of this machine.

usage: backend.py sdist OUT   (writes the source archive into OUT)

The wheel needs the libraries of this machine (make_wheel.py --system-libraries), so it is for this machine alone;
tools/release makes those for others. The build folder, build-wheel, is kept, so that the next call compiles only what
has changed. Options for CMake: pip install . --config-settings cmake="-DISONEST_VIEW=OFF".
"""
import gzip
import io
import os
import pathlib
import shlex
import shutil
import subprocess
import sys
import tarfile
import tempfile

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent))
import make_wheel  # noqa: E402

ROOT = make_wheel.ROOT
# Python does not need the queries for pages without a server; building them takes minutes, emscripten and downloads.
OPTIONS = ["-DCMAKE_BUILD_TYPE=Release", "-DISONEST_PYTHON=ON", "-DISONEST_TOOLS=ON", "-DISONEST_TESTS=OFF",
           "-DISONEST_MPI=OFF", "-DISONEST_WASM=OFF", "-DBUILD_SHARED_LIBS=OFF"]


def run(*command):
    print("$", shlex.join(map(str, command)), flush=True)
    if subprocess.run([*map(str, command)]).returncode != 0:
        raise SystemExit(f"isonest: {command[0]} failed: see above")


def chosen(config_settings):
    """The options for CMake in pip's --config-settings, which may occur several times."""
    said = (config_settings or {}).get("cmake", [])
    return [option for text in ([said] if isinstance(said, str) else said) for option in shlex.split(text)]


def stem():
    of = make_wheel.project()
    return f"{of['name']}-{of['version']}"


def build_wheel(wheel_directory, config_settings=None, metadata_directory=None):
    if shutil.which("cmake") is None:
        raise SystemExit("isonest: cmake is missing; tools/install-deps --python installs what the build needs (Debian)")
    build = ROOT / "build-wheel"
    generator = ["-G", "Ninja"] if shutil.which("ninja") and not (build / "CMakeCache.txt").exists() else []
    run("cmake", "-S", ROOT, "-B", build, *generator, *OPTIONS, f"-DPython_EXECUTABLE={sys.executable}",
        *chosen(config_settings))
    if not (build / "tools/python/cmake_install.cmake").exists():
        raise SystemExit(f"isonest: CMake found no pybind11, or no headers of {sys.executable}; "
                         "tools/install-deps --python installs them (Debian)")
    run("cmake", "--build", build, "--parallel", os.cpu_count() or 1, "--target", "isonest_python", "isonest_program")
    with tempfile.TemporaryDirectory() as tree:
        run("cmake", "--install", build, "--component", "wheel", "--prefix", tree)
        return make_wheel.make(tree, wheel_directory, is_bundled=False)[0]


def prepare_metadata_for_build_wheel(metadata_directory, config_settings=None):
    folder = pathlib.Path(metadata_directory, f"{stem()}.dist-info")
    folder.mkdir()
    (folder / "METADATA").write_text(make_wheel.metadata_of(make_wheel.project()), encoding="utf-8")
    return folder.name


def build_sdist(sdist_directory, config_settings=None):
    """All files of the commit, or those of the working tree that git tracks; equal files give equal bytes."""
    name = f"{stem()}.tar.gz"
    epoch = int(os.environ.get("SOURCE_DATE_EPOCH", 0))
    listed = subprocess.run(["git", "-C", ROOT, "ls-files", "-z"], capture_output=True, check=True).stdout.decode()
    with open(pathlib.Path(sdist_directory, name), "wb") as file, \
            gzip.GzipFile("", "wb", 6, file, mtime=epoch) as packed, \
            tarfile.open(mode="w", fileobj=packed, format=tarfile.PAX_FORMAT) as archive:
        def add(path, data, mode):
            entry = tarfile.TarInfo(f"{stem()}/{path}")
            entry.size, entry.mode, entry.mtime = len(data), mode, epoch
            archive.addfile(entry, io.BytesIO(data))

        add("PKG-INFO", make_wheel.metadata_of(make_wheel.project()).encode(), 0o644)
        for path in sorted(filter(None, listed.split("\0"))):
            add(path, (ROOT / path).read_bytes(), 0o755 if os.access(ROOT / path, os.X_OK) else 0o644)
    return name


if __name__ == "__main__":
    if len(sys.argv) != 3 or sys.argv[1] != "sdist":
        sys.exit(next(line for line in __doc__.splitlines() if line.startswith("usage:")))
    print(build_sdist(sys.argv[2]))
