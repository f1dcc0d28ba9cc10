"""The installed package works for its users: tools/examples are configured and built with a copy of the installation,
run in empty folders and print the known numbers; every public header compiles on its own; and so does the C++
snippet of the manual, in a project like its reader's.

usage: examples_test.py ISONEST [PLUGIN_FOLDER]
"""
import math
import pathlib
import re
import subprocess
import sys
import tempfile

import numpy

ROOT = pathlib.Path(__file__).resolve().parents[2]
WARNINGS = ["-Wall", "-Wextra", "-Wpedantic", "-Werror"]
# The code around the manual's C++ snippet: where its data come from, and the result.
MANUAL_PROJECT = """cmake_minimum_required(VERSION 3.25)
project(x CXX)
find_package(isonest REQUIRED)
add_executable(x main.cpp)
target_link_libraries(x PRIVATE isonest::isonest)
"""
MANUAL_BEFORE = """#include <cmath>
#include <cstdio>
#include <vector>
int main() {
const int nx = 20, ny = 24, nz = 28;
std::vector<float> values;
for (int i = 0; i < nx * ny * nz; ++i) {
    const double x = i % nx - 9.5, y = i / nx % ny - 11.5, z = i / (nx * ny) - 13.5;
    values.push_back(static_cast<float>(std::sqrt(x * x + y * y + z * z) / 16));
}
"""
MANUAL_AFTER = """
std::printf("%zu vertices, %zu triangles\\n", mesh.vertices.size(), mesh.triangles.size());
}
"""
build_tree = pathlib.Path(sys.argv[1]).resolve().parent.parent


def cache(name):
    text = (build_tree / "CMakeCache.txt").read_text(encoding="utf-8")
    found = re.search(rf"^{name}:\w+=(.*)$", text, re.M)
    return found.group(1) if found else ""


def run(*command, **more):
    done = subprocess.run([str(c) for c in command], capture_output=True, text=True, **more)
    if done.returncode != 0:
        sys.exit(f"{' '.join(str(c) for c in command)}: exit {done.returncode}\n{done.stdout}{done.stderr}")
    return done.stdout


def check(condition, what):
    if not condition:
        sys.exit(what)


def check_grid(path, cells):
    """The tetrahedra of the example, by VTK: oriented, of the volume's size, with the function's values."""
    try:
        from vtkmodules.util.numpy_support import vtk_to_numpy
        from vtkmodules.vtkIOXML import vtkXMLUnstructuredGridReader
    except ImportError:
        print("layer.vtu: not read, because VTK is missing")
        return
    reader = vtkXMLUnstructuredGridReader()
    reader.SetFileName(str(path))
    reader.Update()
    grid = reader.GetOutput()
    check(grid.GetNumberOfCells() == cells, "layer.vtu: the number of cells")
    points = vtk_to_numpy(grid.GetPoints().GetData())
    corners = vtk_to_numpy(grid.GetCells().GetConnectivityArray()).reshape(-1, 4)
    a, b, c, d = (points[corners[:, i]] for i in range(4))
    volumes = ((b - a) * numpy.cross(c - a, d - a)).sum(axis=1) / 6
    check(volumes.min() > 0, "layer.vtu: a tetrahedron is turned")
    # 39 x 47 x 55 cells of 0.5 x 0.5 x 1; coarse tetrahedra extend beyond them.
    check(39 * 47 * 55 / 4 <= volumes.sum() <= 64 ** 3 / 4, "layer.vtu: the volume")
    values = vtk_to_numpy(grid.GetPointData().GetArray("value"))
    inside = ((points / [0.5, 0.5, 1]) <= [39, 47, 55]).all(axis=1)
    distance = numpy.linalg.norm(points / [0.5, 0.5, 1] - [18.5, 24.5, 30.5], axis=1)
    check(numpy.abs(values - numpy.tanh(15 - distance))[inside].max() < 1e-6, "layer.vtu: the values")
    levels = vtk_to_numpy(grid.GetCellData().GetArray("level"))
    check(levels.min() >= 0 and levels.max() < 7, "layer.vtu: the levels")


if not cache("CMAKE_HOME_DIRECTORY") or cache("ISONEST_INSTALL") in ("OFF", "FALSE", "0"):
    print("this build tree is not one that installs")
    sys.exit(77)
sanitizers = cache("ISONEST_SANITIZE")
flags = [f"-fsanitize={sanitizers}"] if sanitizers else []
compiler = cache("CMAKE_CXX_COMPILER")

with tempfile.TemporaryDirectory() as temporary:
    work = pathlib.Path(temporary)
    prefix = work / "prefix"
    run("cmake", "--install", build_tree, "--prefix", prefix)

    # Each header alone, without internal headers.
    headers = sorted((prefix / "include").rglob("*.h"))
    check(len(headers) >= 12, f"only {len(headers)} headers are installed")
    for header in headers:
        name = header.relative_to(prefix / "include").as_posix()
        check(name.startswith("isonest/") and name.count("/") == 1, f"{name} is installed")
        run(compiler, "-std=c++20", *WARNINGS, "-I", prefix / "include", "-fsyntax-only", "-x", "c++", "-",
            input=f"#include <{name}>\n#include <{name}>\n")

    run("cmake", "-S", ROOT / "tools" / "examples", "-B", work / "build", f"-DCMAKE_PREFIX_PATH={prefix}",
        f"-DCMAKE_CXX_COMPILER={compiler}", "-DCMAKE_BUILD_TYPE=Release",
        f"-DCMAKE_CXX_FLAGS={' '.join(WARNINGS + flags)}")
    run("cmake", "--build", work / "build", "--parallel", "2")
    # Like a reader of the manual, in C++ only.
    snippets = re.findall(r"^```cpp\n(.*?)^```", (ROOT / "tools" / "MANUAL.md").read_text(encoding="utf-8"), re.M | re.S)
    check(len(snippets) == 1, f"MANUAL.md has {len(snippets)} pieces of C++")
    includes = "".join(re.findall(r"^#include.*\n", snippets[0], re.M))
    body = re.sub(r"^#include.*\n", "", snippets[0], flags=re.M)
    manual = work / "manual"
    manual.mkdir()
    (manual / "CMakeLists.txt").write_text(MANUAL_PROJECT)
    (manual / "main.cpp").write_text(includes + MANUAL_BEFORE + body + MANUAL_AFTER)
    run("cmake", "-S", manual, "-B", manual / "build", f"-DCMAKE_PREFIX_PATH={prefix}",
        f"-DCMAKE_CXX_COMPILER={compiler}", f"-DCMAKE_CXX_FLAGS={' '.join(flags)}")
    run("cmake", "--build", manual / "build")
    shown = run(manual / "build" / "x", cwd=manual)
    print(f"MANUAL.md: {shown.strip()}")
    vertices, triangles = map(int, re.match(r"(\d+) vertices, (\d+) triangles$", shown).groups())
    check(vertices > 100 and 2 * vertices - triangles == 4, "MANUAL.md: the ball is not closed")

    programs = sorted(source.stem for source in (ROOT / "tools" / "examples").glob("*.cpp"))
    check(len(programs) >= 3, f"examples: {programs}")
    printed = {}
    for program in programs:
        empty = work / program
        empty.mkdir()
        printed[program] = run(work / "build" / program, cwd=empty)
        print(f"{program}: {printed[program].strip()}")

    # A closed surface of genus 0 satisfies 2 V - T = 4.
    vertices, triangles, error = map(float, re.match(
        r"(\d+) vertices, (\d+) triangles, error at most ([\d.e+-]+)$", printed["volume_in_memory"]).groups())
    check(vertices > 100 and 2 * vertices - triangles == 4, "volume_in_memory: the ball is not closed")
    check(0 < error <= 0.5, "volume_in_memory: the error is not within what was asked for")

    # 19.5 x 14.5 world units. u is linear, but continued as a constant beyond the volume, where coarse elements reach:
    # the mean deviates by no more than the requested error.
    triangles, area, mean = map(float, re.match(
        r"(\d+) triangles, area ([\d.]+), mean value ([\d.]+)$", printed["slice_callback"]).groups())
    check(math.isclose(area, 19.5 * 14.5, abs_tol=1e-3), "slice_callback: the area")
    check(math.isclose(mean, 19.5 / 2 + 2 * 14.5 / 2 + 3 * 4.25, abs_tol=1), "slice_callback: the mean")
    check(triangles < 39 * 29, "slice_callback: a linear function needs few triangles")

    # The gyroid on 70 x 80 x 90 nodes, 0.1 apart: the length stored in the file, and the refusal.
    glb = (work / "own_source" / "gyroid.glb").read_bytes()
    check(glb[:4] == b"glTF" and int.from_bytes(glb[8:12], "little") == len(glb), "own_source: gyroid.glb")
    triangles = int(re.search(r"gyroid.glb: (\d+) triangles", printed["own_source"]).group(1))
    check(f'"count":{3 * triangles},' .encode() in glb, "own_source: the number of triangles")
    check("refused: gyroid.glb: " in printed["own_source"], "own_source: the file was replaced")

    # The integral of the function, 8 / pi^3, up to the error asked for, and by far fewer nodes than the volume's 65^3.
    tetrahedra, nodes, integral = map(float, re.match(
        r"(\d+) tetrahedra with (\d+) nodes, integral ([\d.]+)$", printed["adapt_traverse"]).groups())
    check(math.isclose(integral, 8 / math.pi ** 3, abs_tol=0.01), "adapt_traverse: the integral")
    check(1000 < tetrahedra < 6 * 64 ** 3 / 4 and nodes < 65 ** 3 / 4, "adapt_traverse: the size of the grid")

    # The histogram, the file and what another reader finds in it.
    shown = printed["grid_statistics"]
    leaves = sum(int(count) for count in re.findall(r"^level \d+: (\d+) leaves$", shown, re.M))
    cells = int(re.search(r"^layer.vtu: (\d+) tetrahedra$", shown, re.M).group(1))
    check(leaves == cells > 10000, "grid_statistics: the histogram and the file differ")
    ranges = [tuple(map(float, r)) for r in re.findall(r"^eighth \d: ([-\d.]+) to ([-\d.]+)$", shown, re.M)]
    check(len(ranges) == 8 and all(low < -0.9 and high > 0.9 for low, high in ranges), "grid_statistics: the eighths")
    check_grid(work / "grid_statistics" / "layer.vtu", cells)
print(f"{len(headers)} headers, {len(programs)} programs")
