"""The installed package works for its users: tools/examples are configured and built with a copy of the installation,
run in empty folders and print the known numbers, built with CMake and one of them with pkg-config; every public header
compiles on its own; and so does the C++ snippet of the manual, in a project like its reader's.

usage: examples_test.py ISONEST [PLUGIN_FOLDER]
"""
import itertools
import math
import os
import pathlib
import re
import subprocess
import sys
import tempfile

import numpy
import scipy.sparse
import scipy.sparse.linalg

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
PHASE_STEPS = 25


def phases(u, cells, dimension):
    """The steps of tools/examples/cahn_hilliard.cpp on all nodes, by matrices that are assembled element by element."""
    shape = (cells + 1,) * dimension
    strides = (cells + 1) ** numpy.arange(dimension)
    corners = numpy.stack(numpy.meshgrid(*[numpy.arange(cells)] * dimension), -1).reshape(-1, dimension)
    even, odd = corners + corners % 2, corners + 1 - corners % 2
    mass = numpy.zeros(u.size)
    rows, columns, entries = [], [], []
    for order in itertools.permutations(range(dimension)):
        # A walk along the axes from the even corner of each cell to the odd one.
        vertices = [even.copy()]
        for axis in order:
            vertices.append(vertices[-1].copy())
            vertices[-1][:, axis] = odd[:, axis]
        edges = numpy.stack([v - vertices[0] for v in vertices[1:]], 1).astype(float)
        gradients = numpy.swapaxes(numpy.linalg.inv(edges), 1, 2)
        gradients = numpy.concatenate([-gradients.sum(1, keepdims=True), gradients], 1)
        size = numpy.abs(numpy.linalg.det(edges)) / math.factorial(dimension)
        local = size[:, None, None] * numpy.einsum("eia,eja->eij", gradients, gradients)
        numbers = numpy.stack([v @ strides for v in vertices], 1)
        for i in range(dimension + 1):
            numpy.add.at(mass, numbers[:, i], size / (dimension + 1))
            for j in range(dimension + 1):
                rows.append(numbers[:, i])
                columns.append(numbers[:, j])
                entries.append(local[:, i, j])
    stiffness = scipy.sparse.csc_matrix((numpy.concatenate(entries), (numpy.concatenate(rows), numpy.concatenate(columns))),
                                        shape=(u.size, u.size))
    check(math.isclose(mass.sum(), cells ** dimension) and math.prod(shape) == u.size, "the reference's masses")
    eps, tau = 2, 8
    of_masses = scipy.sparse.diags
    matrix = of_masses(mass) + 2 * tau * stiffness + tau * eps**2 * stiffness @ of_masses(1 / mass) @ stiffness
    solve = scipy.sparse.linalg.splu(matrix.tocsc()).solve
    for _ in range(PHASE_STEPS):
        u = solve(mass * u - tau * (stiffness @ (u**3 - 3 * u)))
    return u


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
    # With pkg-config. The prefix is another than the one that was configured, so the paths are relative to the file.
    libraries = prefix / (cache("CMAKE_INSTALL_LIBDIR") or "lib")
    environment = {**os.environ, "PKG_CONFIG_PATH": str(libraries / "pkgconfig"), "LD_LIBRARY_PATH": str(libraries)}
    version = run("pkg-config", "--modversion", "isonest", env=environment).strip()
    check(version == cache("CMAKE_PROJECT_VERSION"), f"isonest.pc: version {version}")
    asked = run("pkg-config", "--cflags", "--libs", "isonest", env=environment).split()
    (work / "plain").mkdir()
    run(compiler, "-std=c++20", "-O1", *WARNINGS, *flags, ROOT / "tools" / "examples" / "volume_in_memory.cpp", *asked,
        "-o", work / "plain" / "x")
    plain = run(work / "plain" / "x", cwd=work / "plain", env=environment)
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

    # A program with old names: each is a warning that gives the new one, and the results are those of the new ones.
    old = ROOT / "tests" / "program" / "written_for_0_4.cpp"
    warned = subprocess.run([compiler, "-std=c++20", "-Wall", "-fsyntax-only", "-I", prefix / "include", old],
                            capture_output=True, text=True, check=True).stderr
    names = set(re.findall(r"now called (\w+)", warned))
    check(names == {"ErrorIndicator", "TriangleBudgetByDistance", "TriangleBudgetByError", "kMaxBytes", "kMaxOfStore",
                    "kMaxRows", "kMaxPasses", "kMaxIsovalues", "kMinMemory", "normal_bar"}, f"{old.name}: {names}")
    run(compiler, "-std=c++20", "-O1", *WARNINGS, "-Wno-deprecated-declarations", *flags, old, *asked,
        "-o", work / "plain" / "old")
    field, is_plus, few, fewer = run(work / "plain" / "old", cwd=work / "plain", env=environment).split()
    check(field == "normal_bar" and is_plus == "1" and 0 < int(fewer) <= 300 < int(few) <= 600, f"{old.name}: results")

    programs = sorted(source.stem for source in (ROOT / "tools" / "examples").glob("*.cpp"))
    check(len(programs) >= 3, f"examples: {programs}")
    printed = {}
    for program in programs:
        empty = work / program
        empty.mkdir()
        printed[program] = run(work / "build" / program, cwd=empty)
        print(f"{program}: {printed[program].strip()}")

    check(plain == printed["volume_in_memory"], "volume_in_memory: another result when built with pkg-config")

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

    # u = x + 2 y + 3 z: at (2, 2, 4) + (2 i, 2 j, 0), without any error, and exact between nodes.
    check(printed["values_and_points"] == "level 2: 18 20 22 22 24 26\nlargest indicator of 35937 nodes: 0\n"
          "points: 1.4 41 nan\nhistogram: 256 bins, 35937 nodes\n", "values_and_points")

    shown = printed["check_and_study"]
    check(shown.startswith("check: 0 findings\n") and shown.endswith("check: checksum\n"), "check_and_study: findings")
    rows = [(field, int(leaves), float(error)) for field, leaves, error in
            re.findall(r"study: (\w+) [\d.]+: (\d+) elements, error ([\d.e-]+)\n", shown)]
    check(len(rows) == 10, f"check_and_study: {len(rows)} rows")
    for (field, leaves, error), (other, more, less) in zip(rows, rows[1:]):
        check(field != other or (leaves < more and error > less), f"check_and_study: errors and elements: {shown}")
    steps = re.findall(r"smooth: step \d, mean ([\d.]+), variance ([\d.]+)\n", shown)
    check(len({mean for mean, _ in steps}) == 1 and [v for _, v in steps] == sorted((v for _, v in steps), reverse=True)
          and len({v for _, v in steps}) == 3, "check_and_study: the mean is kept, and the variance falls")
    left, right = map(float, re.search(r"smooth: (-?[\d.]+) at the left of the step, ([\d.]+) at", shown).groups())
    check(abs(left) < 0.1 and abs(right - 1) < 0.1, "check_and_study: the step is smoothed away")
    check("export: 17 x 17 x 17 nodes\n" in shown, "check_and_study: export")
    half = (work / "check_and_study" / "half.npy").read_bytes()
    check(half.startswith(b"\x93NUMPY") and len(half) >= 4 * 17**3, "check_and_study: half.npy")

    # The gyroid on 70 x 80 x 90 nodes, 0.1 apart: the length stored in the file, and the refusal.
    glb = (work / "own_source" / "gyroid.glb").read_bytes()
    check(glb[:4] == b"glTF" and int.from_bytes(glb[8:12], "little") == len(glb), "own_source: gyroid.glb")
    triangles = int(re.search(r"gyroid.glb: (\d+) triangles", printed["own_source"]).group(1))
    check(f'"count":{3 * triangles},' .encode() in glb, "own_source: the number of triangles")
    check("refused: gyroid.glb: " in printed["own_source"], "own_source: the file was replaced")

    # Both preconditioners solve the same system; a(u, u) = (f, u) for the discrete solution.
    jacobi, multilevel, count, energy, work_of_f = map(float, re.search(
        r"Jacobi: (\d+) iterations\nmultilevel: (\d+) iterations\n(\d+) of 274625 nodes, energy ([\d.]+), work ([\d.]+)",
        printed["poisson"]).groups())
    check(1 < multilevel < jacobi, "poisson: iterations")
    check(count < 274625 / 2, "poisson: the grid is not adaptive")
    check(0 < energy and math.isclose(energy, work_of_f, rel_tol=1e-6), "poisson: the energy is not the work")

    # The steps of Cahn-Hilliard on all nodes are those of assembled matrices; an adaptive grid stays near them with fewer
    # nodes. In all cases the integral is preserved and the energy decreases.
    for dimension, cells, threshold in ((2, 64, 0), (2, 64, 0.01), (3, 16, 0), (3, 16, 0.01)):
        name = f"cahn_hilliard {dimension} {cells} {threshold}"
        folder = work / name.replace(" ", "-")
        folder.mkdir()
        text = run(work / "build" / "cahn_hilliard", dimension, cells, PHASE_STEPS, threshold, cwd=folder)
        steps = re.findall(r"^step \d+: (\d+) nodes .*, energy (\S+) -> (\S+), total changed by (\S+), ", text, re.M)
        check(len(steps) == PHASE_STEPS, f"{name}: {text}")
        first, last = (numpy.fromfile(folder / f"{which}.raw") for which in ("first", "last"))
        expected = phases(first, cells, dimension)
        check(numpy.abs(expected - first).max() > 0.3, f"{name}: nothing happened")
        worst = numpy.abs(last - expected).max()
        print(f"{name}: {min(int(s[0]) for s in steps)} of {first.size} nodes, differs by {worst:.2g}")
        check(worst < (1e-7 if threshold == 0 else 0.1), f"{name}: differs by {worst}")
        check(all(float(s[2]) < float(s[1]) for s in steps), f"{name}: the energy rose")
        check(all(abs(float(s[3])) < 1e-11 * first.size for s in steps), f"{name}: the integral changed")
        check(int(steps[0][0]) == first.size and (int(steps[-1][0]) < first.size) == (threshold > 0), f"{name}: nodes")

    # Fewer triangles for a larger threshold; the same formula gives the same mesh.
    spread = [int(n) for n in re.findall(r"^spread below .*: (\d+) triangles$", printed["own_indicator"], re.M)]
    check(len(spread) == 3 and spread[0] > spread[1] > spread[2] > 0, "own_indicator: the thresholds")
    offset, linf = map(int, re.search(r"^offset: (\d+) triangles, linf: (\d+)$", printed["own_indicator"], re.M).groups())
    check(offset == linf > 0, "own_indicator: the formula of linf")

    # The integral of the function, 8 / pi^3, within the requested error, and with far fewer nodes than the volume's 65^3.
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
