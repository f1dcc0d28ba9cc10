#!/usr/bin/env python3
"""Volumes whose nodes lie at uneven distances along an axis: every output is where the coordinates put it.

usage: uneven_test.py ISONEST PLUGIN_FOLDER
"""
import json
import os
import pathlib
import shutil
import sys
import unittest

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1] / "support"))
import served  # noqa: E402

os.environ["HDF5_PLUGIN_PATH"] = sys.argv[2]
try:
    import h5py
    import netCDF4
    import numpy as np
    import vtk
    from vtk.util import numpy_support
    from volume_inputs import ISONEST, Input
except ImportError as error:
    print(f"skipped: {error}")
    sys.exit(77)

RANDOM = np.random.default_rng(11)


def stretched(count, seed, most=3.0):
    """Increasing coordinates with steps from 1 to `most`, exact in float32."""
    steps = 1 + np.random.default_rng(seed).integers(0, 65, count - 1) / 64 * (most - 1)
    return np.concatenate([[0], np.cumsum(steps)])


X, Y, Z = stretched(33, 1) - 20, stretched(29, 2) + 7, stretched(26, 3, 8.0) + 100
GRID = {"z": Z, "y": Y, "x": X}


def field(x=X, y=Y, z=Z):
    """Two merged blobs with waves, [z, y, x]."""
    z, y, x = np.meshgrid(z, y, x, indexing="ij")
    a = np.exp(-((x - X[12])**2 + (y - Y[14])**2 + ((z - Z[12]) / 3)**2) / 180)
    b = np.exp(-((x - X[22])**2 + (y - Y[16])**2 + ((z - Z[16]) / 3)**2) / 120)
    return (a + b + 0.02 * np.sin(x / 3) * np.cos(y / 4)).astype("f4")


ISO = 0.5


def rectilinear(values, x=X, y=Y, z=Z):
    grid = vtk.vtkRectilinearGrid()
    grid.SetDimensions(len(x), len(y), len(z))
    for name, numbers in (("X", x), ("Y", y), ("Z", z)):
        getattr(grid, f"Set{name}Coordinates")(numpy_support.numpy_to_vtk(np.asarray(numbers, "f8"), deep=1))
    array = numpy_support.numpy_to_vtk(values.ravel(), deep=1)
    array.SetName("t")
    grid.GetPointData().SetScalars(array)
    return grid


def contour(grid, iso=ISO):
    maker = vtk.vtkContourFilter()
    maker.SetInputData(grid)
    maker.SetValue(0, iso)
    maker.Update()
    return arrays(maker.GetOutput())


def arrays(mesh):
    data = mesh.GetPointData()
    triangles = numpy_support.vtk_to_numpy(mesh.GetPolys().GetConnectivityArray()).reshape(-1, 3)
    return (numpy_support.vtk_to_numpy(mesh.GetPoints().GetData()).astype("f8"), triangles,
            {data.GetArrayName(i): numpy_support.vtk_to_numpy(data.GetArray(i)) for i in range(data.GetNumberOfArrays())})


def read_mesh(path):
    reader = vtk.vtkXMLPolyDataReader()
    reader.SetFileName(str(path))
    reader.Update()
    return arrays(reader.GetOutput())


def area(points, triangles):
    a, b, c = (points[triangles[:, i]] for i in range(3))
    return np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2


def volume(points, triangles):
    a, b, c = (points[triangles[:, i]] - points.mean(0) for i in range(3))
    return np.einsum("ij,ij->i", a, np.cross(b, c)).sum() / 6


def sorted_points(points):
    rounded = np.unique(np.round(points, 3), axis=0)
    return rounded[np.lexsort(rounded.T)]


def place_in(numbers, at):
    """The cell of each coordinate, and the place in it from 0 to 1."""
    cell = np.clip(np.searchsorted(numbers, at, "right") - 1, 0, len(numbers) - 2)
    return cell, (at - numbers[cell]) / (numbers[cell + 1] - numbers[cell])


def trilinear(values, points, grid=(X, Y, Z)):
    (i, u), (j, v), (k, w) = (place_in(np.asarray(numbers), points[:, a]) for a, numbers in enumerate(grid))
    total = np.zeros(len(points))
    for dx, dy, dz in np.ndindex(2, 2, 2):
        weight = (u if dx else 1 - u) * (v if dy else 1 - v) * (w if dz else 1 - w)
        total += weight * values[k + dz, j + dy, i + dx]
    return total


def piecewise_linear(values, points, grid=(X, Y, Z)):
    """On the six tetrahedra of each cell; cells with odd numbers are mirrored."""
    places = [place_in(np.asarray(numbers), points[:, a]) for a, numbers in enumerate(grid)]
    cell = np.stack([cell for cell, _ in places], 1)
    at = np.stack([at for _, at in places], 1)
    odd = cell % 2
    along = np.where(odd == 1, 1 - at, at)
    order = np.argsort(-along, axis=1, kind="stable")
    sorted_along = np.take_along_axis(along, order, 1)
    node = cell + odd
    rows = np.arange(len(points))
    value = values[node[:, 2], node[:, 1], node[:, 0]]
    total = value * (1 - sorted_along[:, 0])
    for i in range(3):
        node[rows, order[:, i]] += 1 - 2 * odd[rows, order[:, i]]
        after = sorted_along[:, i + 1] if i < 2 else 0
        total += values[node[:, 2], node[:, 1], node[:, 0]] * (sorted_along[:, i] - after)
    return total


def samples(points, triangles, each=10):
    weights = RANDOM.dirichlet((1, 1, 1), each)
    weights = np.concatenate([weights, np.eye(3)])
    return np.einsum("wk,tkd->twd", weights, points[triangles]).reshape(-1, 3)


def furthest(some, points, triangles):
    mesh = vtk.vtkPolyData()
    at = vtk.vtkPoints()
    at.SetData(numpy_support.numpy_to_vtk(points, deep=1))
    mesh.SetPoints(at)
    cells = vtk.vtkCellArray()
    cells.SetData(3, numpy_support.numpy_to_vtkIdTypeArray(np.ascontiguousarray(triangles, "i8").ravel(), deep=1))
    mesh.SetPolys(cells)
    locator = vtk.vtkStaticCellLocator()
    locator.SetDataSet(mesh)
    locator.BuildLocator()
    closest, cell, sub, square = [0.0] * 3, vtk.reference(0), vtk.reference(0), vtk.reference(0.0)
    most = 0.0
    for p in some:
        locator.FindClosestPoint(p, closest, cell, sub, square)
        most = max(most, float(square))
    return most**0.5


class Uneven(Input):
    def setUp(self):
        super().setUp()
        self.path = self.here / "v.nc"
        self.store = self.here / "s.isonest"
        self.write(field())

    def write(self, data, dims=("z", "y", "x"), fmt="NETCDF4", **grid):
        grid = {**GRID, **grid}
        with netCDF4.Dataset(self.path, "w", format=fmt) as file:
            for dim, length in zip(dims, data.shape):
                file.createDimension(dim, length)
                file.createVariable(dim, "f8", (dim,))[:] = grid[dim]
            file.createVariable("t", "f4", dims)[:] = data

    def stored(self, *options):
        done = self.preprocess("--force", *options)
        self.assertEqual(done.returncode, 0, done.stderr)

    def run_isonest(self, command, *arguments, of=None):
        return served.run([ISONEST, command, str(of or self.store), *arguments], capture_output=True, text=True)

    def extracted(self, *options, of=None, iso=ISO, name="m.vtp"):
        done = self.run_isonest("extract", "--iso", str(iso), *options, "-o", self.here / name, "--json", of=of)
        self.assertEqual(done.returncode, 0, done.stderr)
        self.report = json.loads(done.stdout)
        return read_mesh(self.here / name)

    def test_the_header_says_where_the_nodes_lie(self):
        for fmt in ("NETCDF4", "NETCDF3_CLASSIC"):
            for reverse in (False, True):
                grid = {name: at[::-1] if reverse else at for name, at in GRID.items()}
                data = field()[::-1, ::-1, ::-1] if reverse else field()
                self.write(data, fmt=fmt, **grid)
                self.stored()
                with h5py.File(self.store) as store:
                    self.assertEqual(list(store.attrs["version"]), [2, 14])
                    self.assertEqual(store.attrs["flags"] & 8, 8)
                    self.assertNotIn("VTKHDF", store)
                    np.testing.assert_allclose(store.attrs["origin"], [X[0], Y[0], Z[0]])
                    for name, at in zip("xyz", (X, Y, Z)):
                        np.testing.assert_allclose(store.attrs[f"offsets_{name}"], at - at[0], rtol=1e-14)
                    np.testing.assert_array_equal(store["levels/0/values"], field())
                about = json.loads(self.run_isonest("info", "--json").stdout)
                np.testing.assert_allclose(about["uneven"]["z"], Z - Z[0])
                of_file = json.loads(self.run_isonest("info", "--json", of=self.path).stdout)
                self.assertEqual(of_file["uneven"], about["uneven"])
                self.assertEqual(self.run_isonest("check", "--source", self.path).returncode, 0)

    def test_some_axes_may_be_even(self):
        self.write(field(), x=np.arange(33) * 2.0)
        self.stored()
        with h5py.File(self.store) as store:
            self.assertNotIn("offsets_x", store.attrs)
            self.assertIn("offsets_z", store.attrs)
        points, _, _ = self.extracted()
        expected, _, _ = contour(rectilinear(field(), x=np.arange(33) * 2.0))
        np.testing.assert_allclose(sorted_points(points), sorted_points(expected), atol=2e-3)

    def test_the_surface_is_that_of_vtk(self):
        self.stored()
        expected, theirs, _ = contour(rectilinear(field()))
        for options in ((), ("--cells", "hex", "--threads", "1"), ("--memory", "64M")):
            points, triangles, _ = self.extracted(*options)
            np.testing.assert_allclose(sorted_points(points), sorted_points(expected), atol=2e-3)
            self.assertLess(abs(area(points, triangles) / area(expected, theirs) - 1), 2e-3)
            self.assertEqual(self.report["error_bound"], 0)
        # Tetrahedra have more vertices; all of the cells' edges are among theirs.
        points, triangles, _ = self.extracted("--cells", "tet")
        self.assertLess(abs(area(points, triangles) / area(expected, theirs) - 1), 2e-2)
        found = {tuple(p) for p in np.round(points, 3)}
        self.assertLessEqual({tuple(p) for p in np.round(expected, 3)}, found)

    def test_a_file_gives_the_surface_of_its_store(self):
        self.stored()
        # Marched from a file, the full surface has its vertices in the order of the file.
        np.testing.assert_array_equal(sorted_points(self.extracted()[0]), sorted_points(self.extracted(of=self.path)[0]))
        for options in (("--close",), ("--distance", "0.5"), ("--error", "0.02"), ("--cells", "tet"),
                        ("--box=-10,10,110,20,50,180",), ("--components", "1")):
            with self.subTest(options=options):
                self.extracted(*options, name="a.vtp")
                self.extracted(*options, of=self.path, name="b.vtp")
                self.assertEqual((self.here / "a.vtp").read_bytes(), (self.here / "b.vtp").read_bytes())

    def test_normals_are_those_of_the_world(self):
        self.stored()
        for options in (("--normals",), ("--normals", "--cells", "tet")):
            points, _, found = self.extracted(*options)
            normals = next(a for name, a in found.items() if name.lower().startswith("normal"))
            # The mean difference over both neighbours of a node, as VTK computes it.
            values = field().astype("f8")
            g = np.stack([np.gradient(values, axis=2), np.gradient(values, axis=1), np.gradient(values, axis=0)], -1)
            for a, at, axis in ((0, X, 2), (1, Y, 1), (2, Z, 0)):
                steps = np.gradient(at)
                g[..., a] /= steps.reshape([-1 if i == axis else 1 for i in range(3)])
            expected = -np.stack([trilinear(g[..., a], points) for a in range(3)], -1)
            cosine = (normals * expected).sum(1) / np.linalg.norm(expected, axis=1)
            # Trilinear between nodes; on the diagonals of tetrahedra, isonest's are linear.
            self.assertGreater(cosine.min(), 1 - (1e-2 if "tet" in options else 1e-6))

    def test_the_distance_holds_in_the_world(self):
        self.stored()
        full, full_triangles, _ = self.extracted()
        for options in (("--effort", "best"), ("--effort", "fast")):
            for limit in (0.3, 1.5):
                points, triangles, _ = self.extracted("--distance", str(limit), *options)
                self.assertLess(len(triangles), 0.6 * len(full_triangles))
                bound = self.report["distance"]["bound"] if isinstance(self.report["distance"], dict) else limit
                self.assertLessEqual(bound, limit)
                self.assertLessEqual(furthest(samples(points, triangles), full, full_triangles), bound * (1 + 1e-6))
                self.assertLessEqual(furthest(samples(full, full_triangles, 3), points, triangles), bound * (1 + 1e-6))

    def test_an_error_of_values_holds_on_every_triangle(self):
        self.stored()
        values = field().astype("f8")
        full = len(self.extracted()[1])
        for options in (("--effort", "fast"), ("--effort", "best", "--cells", "tet"), ("--effort", "best", "--cells", "hex")):
            for limit in (0.01, 0.05):
                points, triangles, _ = self.extracted("--error", str(limit), *options)
                self.assertLess(len(triangles), full)
                bound = self.report["error_bound"]
                self.assertLessEqual(bound, limit)
                u = trilinear if self.report["function"] == "trilinear" else piecewise_linear
                off = np.abs(u(values, samples(points, triangles)) - ISO)
                self.assertLessEqual(off.max(), bound * (1 + 1e-6) + 1e-6)
                self.assertGreater(off.max(), 0.3 * bound)

    def test_closed_surfaces_and_boxes(self):
        self.stored()
        points, triangles, _ = self.extracted("--close", iso=0.05)
        self.assertAlmostEqual(points[:, 2].min(), Z[0], 4)
        edges = np.sort(triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
        self.assertTrue((np.unique(edges, axis=0, return_counts=True)[1] == 2).all())
        fine = [np.linspace(at[0], at[-1], 160) for at in (X, Y, Z)]
        cell = np.prod([f[1] - f[0] for f in fine])
        grid = np.stack(np.meshgrid(*[(f[1:] + f[:-1]) / 2 for f in fine], indexing="ij"), -1).reshape(-1, 3)
        solid = (trilinear(field().astype("f8"), grid) > 0.05).sum() * cell
        self.assertLess(abs(abs(volume(points, triangles)) / solid - 1), 5e-3)
        lo, hi = np.array([-5.3, 12.1, 120.7]), np.array([21.2, 44.4, 190.1])
        box = ",".join(map(str, [*lo, *hi]))
        points, _, _ = self.extracted(f"--box={box}")
        self.assertTrue((points >= lo - 1e-4).all() and (points <= hi + 1e-4).all())
        whole, _, _ = self.extracted()
        inside = whole[((whole > lo + 1e-3) & (whole < hi - 1e-3)).all(1)]
        self.assertLessEqual({tuple(p) for p in np.round(inside, 3)}, {tuple(p) for p in np.round(points, 3)})

    def test_slices_across_an_axis(self):
        self.stored()
        for axis, at in ((2, 141.3), (1, 30.25), (0, 1.0)):
            normal = ["0", "0", "0"]
            normal[axis] = "1"
            done = self.run_isonest("slice", "--plane", f"{','.join(normal)},{at}", "-o", self.here / "c.vtp")
            self.assertEqual(done.returncode, 0, done.stderr)
            points, _, found = read_mesh(self.here / "c.vtp")
            np.testing.assert_allclose(points[:, axis], at, atol=1e-4)
            np.testing.assert_allclose(np.ptp(points, axis=0)[[a for a in range(3) if a != axis]],
                                       [np.ptp((X, Y, Z)[a]) for a in range(3) if a != axis], rtol=1e-6)
            values = next(iter(a for name, a in found.items() if name.lower() == "value"))
            # On the edges of cells, linear functions on tetrahedra are the trilinear one.
            others = [a for a in range(3) if a != axis]
            on_edge = np.all([np.abs(points[:, a, None] - (X, Y, Z)[a]).min(1) < 1e-3 for a in others], axis=0)
            self.assertGreater(on_edge.sum(), 500)
            expected = trilinear(field().astype("f8"), points)
            np.testing.assert_allclose(values[on_edge], expected[on_edge], atol=2e-5)
            np.testing.assert_allclose(values, expected, atol=2e-2)
        done = self.run_isonest("slice", "--plane", "1,1,0,20", "-o", self.here / "c.vtp")
        self.assertEqual(done.returncode, 5, done.stderr)
        self.assertIn("evenly spaced", done.stderr)

    def test_parts_of_the_volume_keep_their_places(self):
        self.stored("--crop", "3:31,2:28,4:25", "--every", "2,1,3")
        with h5py.File(self.store) as store:
            np.testing.assert_allclose(store.attrs["origin"], [X[3], Y[2], Z[4]])
            np.testing.assert_allclose(store.attrs["offsets_x"], X[3:31:2] - X[3])
            np.testing.assert_allclose(store.attrs["offsets_y"], Y[2:28] - Y[2])
            np.testing.assert_allclose(store.attrs["offsets_z"], Z[4:25:3] - Z[4])
        self.stored("--crop", ":,:,7:8")
        with h5py.File(self.store) as store:
            self.assertNotIn("offsets_z", store.attrs)
            self.assertAlmostEqual(store.attrs["origin"][2], Z[7])

    def test_another_quantity_is_read_where_it_is(self):
        self.stored()
        other = (field() * 3 + np.random.default_rng(5).normal(0, 0.05, field().shape)).astype("f4")
        self.path = self.here / "o.nc"
        self.write(other)
        for options in ((), ("--distance", "1")):
            points, triangles, found = self.extracted("--vertex-values", f"other={self.here / 'o.nc'}", *options)
            np.testing.assert_allclose(found["other"], trilinear(other.astype("f8"), points), atol=2e-3)
            weights = np.concatenate([RANDOM.dirichlet((1, 1, 1), 12), np.eye(3)])
            linear = np.einsum("wk,tk->tw", weights, found["other"][triangles].astype("f8")).ravel()
            inside = np.einsum("wk,tkd->twd", weights, points[triangles]).reshape(-1, 3)
            off = np.abs(trilinear(other.astype("f8"), inside) - linear).max()
            [about] = self.report["vertex_fields"]
            self.assertEqual(about["unbounded_triangles"], 0)
            self.assertLessEqual(off, about["linear_bound"])
            self.assertLess(about["linear_bound"], 6 * off)

    def test_what_needs_even_axes_says_so(self):
        self.stored()
        for command, options in (("study", ("--iso", "0.5", "-o", self.here / "study")), ("smooth", ("--steps", "2", "--tau", "1", "--lambda", "1", "-o", self.here / "n.nrrd")),
                                 ("export", ("--field", "values", "-o", self.here / "v.nrrd")),
                                 ("publish", ("-o", self.here / "site")), ("view", ("--port", "0")),
                                 ("extract", ("--iso", "0.5", "--distance", "1", "--effort", "none", "-o", self.here / "n.ply")),
                                 ("extract", ("--iso", "0.5", "--error", "0.1", "--effort", "none", "-o", self.here / "n.ply")),
                                 ("extract", ("--iso", "0.5", "--error", "0.1", "--focus", "1,2,3,4,5,6", "-o", self.here / "n.ply")),
                                 ("slice", ("--plane", "0,0,1,150", "--error", "0.1", "-o", self.here / "n.ply"))):
            with self.subTest(command=command):
                done = self.run_isonest(command, *options)
                self.assertIn(done.returncode, (2, 5), done.stderr)
                if command == "publish" and "this build cannot write sites" in done.stderr:
                    continue
                self.assertRegex(done.stderr, "even")
        for options in (("--indicators", "l2_bar"), ("--indicators", "all")):
            done = self.preprocess("--force", *options)
            self.assertIn(done.returncode, (2, 5))
            self.assertIn("even", done.stderr)
        self.path = self.here / "v.nc"
        done = self.preprocess("--force", "--periodic", "x")
        self.assertIn("uneven distances", done.stderr)
        self.assertEqual(done.returncode, 5)

    def test_a_kept_analysis_is_of_the_coordinates(self):
        self.stored()
        options = ("--distance", "1", "--keep-analysis")
        first = self.extracted(*options)[0]
        moved = Z.copy()
        moved[12] += 0.9
        self.write(field(), z=moved)
        self.stored()
        second = self.extracted(*options)[0]
        self.assertNotEqual(first.shape, second.shape)
        alone = self.here / "alone.isonest"
        shutil.copy(self.store, alone)
        np.testing.assert_array_equal(second, self.extracted(*options, of=alone)[0])

    def test_an_origin_of_an_hdf5_dataset_moves_the_coordinates(self):
        self.path = self.here / "v.h5"
        with h5py.File(self.path, "w") as file:
            data = file.create_dataset("t", data=field())
            for axis, (name, at) in enumerate(GRID.items()):
                file[name] = at[::-1] if name == "y" else at
                file[name].make_scale(name)
                data.dims[axis].attach_scale(file[name])
            data.attrs["origin"] = [1.0, 2.0, 3.0]
        self.stored("--dataset", "t")
        with h5py.File(self.store) as store:
            np.testing.assert_allclose(store.attrs["origin"], [1, 2, 3])
            np.testing.assert_allclose(store.attrs["offsets_y"], Y - Y[0], rtol=1e-12)
            np.testing.assert_allclose(store.attrs["offsets_z"], Z - Z[0], rtol=1e-12)

    def test_a_rectilinear_grid_of_vtk(self):
        expected, theirs, _ = contour(rectilinear(field()))
        for mode in ("Ascii", "Binary", "Appended"):
            for compressor in ("None", "ZLib"):
                writer = vtk.vtkXMLRectilinearGridWriter()
                writer.SetInputData(rectilinear(field()))
                writer.SetFileName(str(self.here / "v.vtr"))
                getattr(writer, f"SetDataModeTo{mode}")()
                getattr(writer, f"SetCompressorTypeTo{compressor}")()
                writer.Write()
                points, triangles, _ = self.extracted(of=self.here / "v.vtr")
                np.testing.assert_allclose(sorted_points(points), sorted_points(expected), atol=2e-3)
        for name, make in {"v.vtr": vtk.vtkXMLRectilinearGridWriter, "v.vtk": vtk.vtkRectilinearGridWriter}.items():
            with self.subTest("values of cells lie at their centres", file=name):
                grid = rectilinear(field())
                cells = numpy_support.numpy_to_vtk(field()[1:, 1:, 1:].ravel(), deep=1)
                cells.SetName("c")
                grid.GetCellData().AddArray(cells)
                writer = make()
                writer.SetInputData(grid)
                writer.SetFileName(str(self.here / name))
                writer.Write()
                self.path = self.here / name
                self.stored("--dataset", "c")
                with h5py.File(self.store) as store:
                    np.testing.assert_allclose(store.attrs["origin"], [(at[0] + at[1]) / 2 for at in (X, Y, Z)], rtol=1e-6)
                    middle = (Z[1:] + Z[:-1]) / 2
                    np.testing.assert_allclose(store.attrs["offsets_z"], middle - middle[0], rtol=1e-6)

    def test_a_legacy_rectilinear_grid_of_vtk(self):
        expected, _, _ = contour(rectilinear(field()))
        legacy = self.here / "v.vtk"
        for text in (True, False):
            writer = vtk.vtkRectilinearGridWriter()
            writer.SetInputData(rectilinear(field()))
            writer.SetFileName(str(legacy))
            writer.SetFileTypeToASCII() if text else writer.SetFileTypeToBinary()
            writer.Write()
            points, _, _ = self.extracted(of=legacy)
            np.testing.assert_allclose(sorted_points(points), sorted_points(expected), atol=2e-3)
        sound = legacy.read_bytes()
        start = sound.index(b"Z_COORDINATES")
        line = sound[start : sound.index(b"\n", start)]
        for damaged, word in {
            sound.replace(line, line.replace(str(len(Z)).encode(), str(len(Z) + 1).encode())): "DIMENSIONS",
            sound.replace(line, line.replace(str(len(Z)).encode(), b"9")): "DIMENSIONS",
            sound.replace(b"Z_COORDINATES", b"Y_COORDINATES"): "DIMENSIONS",
            sound.replace(line, line.replace(b" double", b" string").replace(b" float", b" string")): "Z_COORDINATES",
        }.items():
            legacy.write_bytes(damaged)
            done = self.run_isonest("extract", "--iso", "0.4", "-o", self.here / "x.ply", of=legacy)
            self.assertIn(done.returncode, (4, 5), done.stderr)
            self.assertIn(word, done.stderr)
            self.assertFalse((self.here / "x.ply").exists())

    def test_damaged_axes_are_refused(self):
        self.stored()
        sound = self.store.read_bytes()
        for change in ("value", "missing", "short", "flag", "sum"):
            self.store.write_bytes(sound)
            with h5py.File(self.store, "r+") as store:
                offsets = store.attrs["offsets_z"]
                if change == "value":
                    offsets[3] += 0.25
                    store.attrs.modify("offsets_z", offsets)
                elif change == "missing":
                    del store.attrs["offsets_z"]
                elif change == "sum":
                    del store.attrs["offsets_xxh64"]
                elif change == "short":
                    store.attrs["offsets_z"] = offsets[:-1]
                else:
                    store.attrs.modify("flags", store.attrs["flags"] & ~np.uint32(8))
            done = self.run_isonest("info")
            self.assertEqual(done.returncode, 4, (change, done.stderr))

    def test_planar_data(self):
        self.write(field()[12], dims=("y", "x"))
        self.stored()
        done = self.run_isonest("extract", "--iso", "0.4", "-o", self.here / "l.vtp")
        self.assertEqual(done.returncode, 0, done.stderr)
        reader = vtk.vtkXMLPolyDataReader()
        reader.SetFileName(str(self.here / "l.vtp"))
        reader.Update()
        points = numpy_support.vtk_to_numpy(reader.GetOutput().GetPoints().GetData()).astype("f8")
        values = trilinear(np.repeat(field()[12:13].astype("f8"), 2, 0), np.c_[points[:, :2], points[:, 2]], (X, Y, [0, 1]))
        on_edges = np.abs(values - 0.4)
        self.assertLess(np.median(on_edges), 1e-5)


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1])
