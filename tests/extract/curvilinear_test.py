#!/usr/bin/env python3
"""Curvilinear structured grids: every node has a position of its own, and surfaces are those of VTK.

usage: curvilinear_test.py ISONEST PLUGIN_FOLDER
"""
import itertools
import json
import os
import pathlib
import re
import sys
import unittest

TESTS = pathlib.Path(__file__).resolve().parents[1]
sys.path[:0] = [str(TESTS / "support"), str(TESTS / "sources")]
import served  # noqa: E402

os.environ["HDF5_PLUGIN_PATH"] = sys.argv[2]
try:
    import h5py
    import netCDF4
    import numpy as np
    import vtk
    from vtk.util import numpy_support
    from range_server import RangeServer
    from volume_inputs import ISONEST, Input
except ImportError as error:
    print(f"skipped: {error}")
    sys.exit(77)

RANDOM = np.random.default_rng(12)
ISO = 0.45
NODES = (35, 30, 27)  # x, y, z of the lattice


def twisted(nodes=NODES):
    """Nine tenths of a ring whose planes are bent and turned: positions [z, y, x, 3]."""
    k, j, i = np.meshgrid(*(np.arange(n, dtype="f8") for n in nodes[::-1]), indexing="ij")
    r = 6 + 0.25 * i + 0.004 * i**2
    angle = 0.19 * j + 0.02 * k
    z = 0.5 * k + 0.4 * np.sin(i / 6) + 0.02 * j
    return np.stack([r * np.cos(angle), r * np.sin(angle), z], -1)


def field(nodes=NODES):
    """Blobs and waves in the lattice, [z, y, x]."""
    k, j, i = np.meshgrid(*(np.linspace(0, 1, n) for n in nodes[::-1]), indexing="ij")
    a = np.exp(-((i - 0.35)**2 + (j - 0.4)**2 + (k - 0.5)**2) / 0.05)
    b = np.exp(-((i - 0.65)**2 + (j - 0.7)**2 + (k - 0.45)**2) / 0.03)
    return (a + b + 0.04 * np.sin(17 * i) * np.cos(13 * j)).astype("f4")


def structured(positions, values, name="t"):
    grid = vtk.vtkStructuredGrid()
    grid.SetDimensions(*values.shape[::-1])
    points = vtk.vtkPoints()
    points.SetData(numpy_support.numpy_to_vtk(np.ascontiguousarray(positions.reshape(-1, 3)), deep=1))
    grid.SetPoints(points)
    array = numpy_support.numpy_to_vtk(values.ravel(), deep=1)
    array.SetName(name)
    grid.GetPointData().SetScalars(array)
    return grid


def arrays(mesh):
    data = mesh.GetPointData()
    triangles = numpy_support.vtk_to_numpy(mesh.GetPolys().GetConnectivityArray()).reshape(-1, 3)
    return (numpy_support.vtk_to_numpy(mesh.GetPoints().GetData()).astype("f8"), triangles,
            {data.GetArrayName(i): numpy_support.vtk_to_numpy(data.GetArray(i)) for i in range(data.GetNumberOfArrays())})


def contour(grid, iso=ISO):
    maker = vtk.vtkContourFilter()
    maker.SetInputData(grid)
    maker.SetValue(0, iso)
    maker.Update()
    return arrays(maker.GetOutput())


def read_mesh(path):
    reader = vtk.vtkXMLPolyDataReader()
    reader.SetFileName(str(path))
    reader.Update()
    return arrays(reader.GetOutput())


def crossings(positions, values, iso=ISO):
    """Where the surface crosses the edges of the lattice, by the definition."""
    found = []
    for axis in range(3):
        low = [slice(None)] * 3
        high = [slice(None)] * 3
        low[axis], high[axis] = slice(None, -1), slice(1, None)
        a, b = values[tuple(low)].astype("f8"), values[tuple(high)].astype("f8")
        crosses = (a < iso) != (b < iso)
        crosses &= np.isfinite(a) & np.isfinite(b)
        t = ((iso - a[crosses]) / (b[crosses] - a[crosses]))[:, None]
        found.append(positions[tuple(low)][crosses] * (1 - t) + positions[tuple(high)][crosses] * t)
    return np.concatenate(found)


def farthest_from(points, others):
    """The largest distance of a point to the nearest of the others."""
    mesh = vtk.vtkPolyData()
    at = vtk.vtkPoints()
    at.SetData(numpy_support.numpy_to_vtk(np.ascontiguousarray(others), deep=1))
    mesh.SetPoints(at)
    locator = vtk.vtkStaticPointLocator()
    locator.SetDataSet(mesh)
    locator.BuildLocator()
    nearest = others[[locator.FindClosestPoint(p) for p in points]]
    return np.linalg.norm(nearest - points, axis=1).max()


def furthest(some, points, triangles):
    """The largest distance of points from a mesh."""
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


def samples(points, triangles, each):
    weights = np.concatenate([RANDOM.dirichlet((1, 1, 1), each), np.eye(3)])
    return np.einsum("wk,tkd->twd", weights, points[triangles]).reshape(-1, 3)


def normals_of(points, triangles):
    a, b, c = (points[triangles[:, i]] for i in range(3))
    return np.cross(b - a, c - a)


def area(points, triangles):
    return np.linalg.norm(normals_of(points, triangles), axis=1).sum() / 2


def volume(points, triangles):
    a, b, c = (points[triangles[:, i]] - points.mean(0) for i in range(3))
    return np.einsum("ij,ij->i", a, np.cross(b, c)).sum() / 6


def is_closed(triangles):
    edges = np.sort(triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    return bool((np.unique(edges, axis=0, return_counts=True)[1] == 2).all())


def gradients(positions, values):
    """Of the values in the world, at the nodes, [z, y, x, 3]: central differences, one-sided at borders."""
    lattice = np.stack([np.gradient(values.astype("f8"), axis=a) for a in (2, 1, 0)], -1)
    derivative = np.stack([np.gradient(positions, axis=a) for a in (2, 1, 0)], -1)  # [..., world, axis]
    return np.linalg.solve(np.swapaxes(derivative, -1, -2), lattice[..., None])[..., 0]


class Curvilinear(Input):
    def setUp(self):
        super().setUp()
        self.path = self.here / "v.vts"
        self.store = self.here / "s.isonest"
        self.write(twisted(), field())

    def write(self, positions, values, mode="appended", compressed=True, encode=False, words=32):
        writer = vtk.vtkXMLStructuredGridWriter()
        writer.SetInputData(structured(positions, values))
        writer.SetFileName(str(self.path))
        getattr(writer, {"appended": "SetDataModeToAppended", "binary": "SetDataModeToBinary", "ascii": "SetDataModeToAscii"}[mode])()
        writer.SetEncodeAppendedData(encode)
        writer.SetHeaderTypeToUInt64() if words == 64 else writer.SetHeaderTypeToUInt32()
        if not compressed:
            writer.SetCompressorTypeToNone()
        self.assertTrue(writer.Write())

    def stored(self, *options):
        done = self.preprocess(*options)
        self.assertEqual(done.returncode, 0, done.stderr)
        return done

    def run_isonest(self, command, *arguments, of=None):
        return served.run([ISONEST, command, str(of or self.store), *map(str, arguments)], capture_output=True, text=True)

    def extracted(self, *options, iso=ISO, name="m.vtp"):
        done = self.run_isonest("extract", "--iso", iso, *options, "-o", self.here / name, "--json")
        self.assertEqual(done.returncode, 0, done.stderr)
        self.report = json.loads(done.stdout)
        return read_mesh(self.here / name)

    def same_points(self, points, expected, tolerance=3e-6):
        self.assertLess(farthest_from(points, expected), tolerance)
        self.assertLess(farthest_from(expected, points), tolerance)

    def test_the_store_has_the_positions(self):
        self.stored("--threads", "2")
        with h5py.File(self.store) as store:
            self.assertEqual(list(store.attrs["version"]), [2, 15])
            self.assertEqual(store.attrs["flags"] & 16, 16)
            self.assertNotIn("VTKHDF", store)
            for a, name in enumerate("xyz"):
                positions = store["positions"][name]
                self.assertEqual(positions.chunks, (8, 8, 8))
                np.testing.assert_array_equal(positions, twisted()[..., a])
            np.testing.assert_array_equal(store["levels/0/values"], field())
            low = store.attrs["position_numbers"][:3]
            np.testing.assert_array_equal(low, twisted().reshape(-1, 3).min(0))
        about = json.loads(self.run_isonest("info", "--json").stdout)
        self.assertEqual(about["curvilinear"]["folded_cells"], 0)
        self.assertFalse(about["curvilinear"]["mirrored"])
        np.testing.assert_array_equal(about["curvilinear"]["high"], twisted().reshape(-1, 3).max(0))
        steps = [np.linalg.norm(np.diff(twisted(), axis=a), axis=-1).mean() for a in (2, 1, 0)]
        np.testing.assert_allclose(about["curvilinear"]["step"], steps, rtol=1e-12)
        self.assertIn("no folded cells", self.run_isonest("info").stdout)
        self.assertTrue(json.loads(self.run_isonest("info", "--json", of=self.path).stdout)["curvilinear"])
        self.assertEqual(self.run_isonest("check", "--source", self.path, "--deep").returncode, 0)

    def test_every_encoding_of_vtk(self):
        self.stored()
        whole = self.store.read_bytes()
        for mode, compressed, encode, words in itertools.product(
                ("appended", "binary", "ascii"), (True, False), (True, False), (32, 64)):
            if mode != "appended" and encode or mode == "ascii" and (compressed or words == 64):
                continue
            with self.subTest(mode=mode, compressed=compressed, encode=encode, words=words):
                self.write(twisted(), field(), mode, compressed, encode, words)
                self.stored()
                if mode != "ascii":  # VTK writes fewer digits
                    self.assertEqual(self.store.read_bytes(), whole)
                else:
                    with h5py.File(self.store) as store:
                        np.testing.assert_allclose(store["positions/x"], twisted()[..., 0], rtol=1e-9, atol=1e-9)

    def test_the_surface_is_that_of_vtk(self):
        for kind in ("f8", "f4"):
            positions = twisted().astype(kind)
            self.write(positions, field())
            self.stored()
            expected, theirs, _ = contour(structured(positions, field()))
            self.same_points(crossings(positions.astype("f8"), field()), expected)
            for options in ((), ("--cells", "hex", "--threads", "1"), ("--memory", "64M")):
                points, triangles, _ = self.extracted(*options)
                self.same_points(points, expected)
                self.assertLess(abs(area(points, triangles) / area(expected, theirs) - 1), 1e-3)
                self.assertAlmostEqual(self.report["area"], area(points, triangles), 3)
            # Tetrahedra have more vertices; those on the edges of cells are among theirs.
            points, triangles, _ = self.extracted("--cells", "tet")
            self.assertLess(farthest_from(expected, points), 3e-6)
            self.assertLess(abs(area(points, triangles) / area(expected, theirs) - 1), 1e-2)

    def test_diagonals_of_tetrahedra_are_straight(self):
        self.stored()
        points, _, _ = self.extracted("--cells", "tet")
        positions, values = twisted(), field().astype("f8")
        found = [crossings(positions, values)]
        # The edges of the six tetrahedra of each cell, which go from its corner with even coordinates.
        for step in itertools.product((0, 1), repeat=3):
            if sum(step) < 2:
                continue
            for node in itertools.product(*(range(0, n, 2) for n in values.shape)):
                for signs in itertools.product(*((-1, 1) if s else (1,) for s in step)):
                    to = tuple(n + s * d for n, s, d in zip(node, signs, step))
                    if all(0 <= t < n for t, n in zip(to, values.shape)) and (values[node] < ISO) != (values[to] < ISO):
                        t = (ISO - values[node]) / (values[to] - values[node])
                        found.append(((1 - t) * positions[node] + t * positions[to])[None])
        # Diagonals of faces start at other nodes too: every vertex found here is one of the surface's.
        self.assertLess(farthest_from(np.concatenate(found), points), 3e-6)

    def test_values_that_are_missing(self):
        values = field()
        values[RANDOM.random(values.shape) < 0.02] = np.nan
        self.write(twisted(), values)
        self.stored()
        points, triangles, _ = self.extracted()
        self.assertGreater(len(points), 1000)
        self.assertLess(farthest_from(points, crossings(twisted(), values)), 3e-6)

    def test_mirrored_grids_face_the_same_side(self):
        self.stored()
        points, triangles, found = self.extracted("--normals")
        mirrored = twisted()[:, :, ::-1], field()[:, :, ::-1]
        self.write(*mirrored)
        self.stored()
        self.assertTrue(json.loads(self.run_isonest("info", "--json").stdout)["curvilinear"]["mirrored"])
        others, their_triangles, their_arrays = self.extracted("--normals")
        self.same_points(others, points)
        self.assertGreater(volume(points, triangles) * volume(others, their_triangles), 0)
        for at, faces, data in ((points, triangles, found), (others, their_triangles, their_arrays)):
            normals = next(a for name, a in data.items() if name.lower().startswith("normal"))
            mean = normals[faces].sum(1)
            self.assertGreater((np.einsum("ij,ij->i", mean, normals_of(at, faces)) > 0).mean(), 0.999)

    def test_normals_are_those_of_the_world(self):
        self.stored()
        points, _, found = self.extracted("--normals")
        normals = next(a for name, a in found.items() if name.lower().startswith("normal"))
        at_nodes = gradients(twisted(), field())
        values = field().astype("f8")
        # Of each vertex: between which nodes it lies, by the places where the surface crosses edges.
        places, expected = [], []
        for axis in range(3):
            low, high = [slice(None)] * 3, [slice(None)] * 3
            low[axis], high[axis] = slice(None, -1), slice(1, None)
            low, high = tuple(low), tuple(high)
            a, b = values[low], values[high]
            crosses = (a < ISO) != (b < ISO)
            t = ((ISO - a[crosses]) / (b[crosses] - a[crosses]))[:, None]
            places.append(twisted()[low][crosses] * (1 - t) + twisted()[high][crosses] * t)
            expected.append(-(at_nodes[low][crosses] * (1 - t) + at_nodes[high][crosses] * t))
        places, expected = np.concatenate(places), np.concatenate(expected)
        mesh = vtk.vtkPolyData()
        at = vtk.vtkPoints()
        at.SetData(numpy_support.numpy_to_vtk(places, deep=1))
        mesh.SetPoints(at)
        locator = vtk.vtkStaticPointLocator()
        locator.SetDataSet(mesh)
        locator.BuildLocator()
        expected = expected[[locator.FindClosestPoint(p) for p in points]]
        cosine = (normals * expected).sum(1) / np.linalg.norm(expected, axis=1)
        # isonest interpolates gradient and derivative, the formula above their quotient.
        self.assertGreater(cosine.min(), 1 - 1e-2)
        self.assertGreater(np.median(cosine), 1 - 1e-5)

    def test_the_distance_holds_in_the_world(self):
        self.stored()
        full, full_triangles, _ = self.extracted()
        for effort in ("best", "fast"):
            for limit in (0.05, 0.3):
                points, triangles, _ = self.extracted("--distance", limit, "--effort", effort)
                self.assertLess(len(triangles), 0.7 * len(full_triangles))
                bound = self.report["distance"]["bound"] if isinstance(self.report["distance"], dict) else limit
                self.assertLessEqual(bound, limit)
                self.assertLessEqual(furthest(samples(points, triangles, 8), full, full_triangles), bound * (1 + 1e-6))
                self.assertLessEqual(furthest(samples(full, full_triangles, 2), points, triangles), bound * (1 + 1e-6))

    def test_closed_surfaces_and_components(self):
        self.stored()
        points, triangles, _ = self.extracted("--close", iso=0.1)
        self.assertTrue(is_closed(triangles))
        # The solid, by the volumes of small pieces of the cells.
        each = 6
        positions, values = twisted(), field().astype("f8")
        total = 0.0
        lattice = [np.arange(n - 1) for n in values.shape]
        for offset in itertools.product((np.arange(each) + 0.5) / each, repeat=3):
            weights = [(corner, np.prod([o if c else 1 - o for c, o in zip(corner, offset)]))
                       for corner in itertools.product((0, 1), repeat=3)]
            part = {c: tuple(slice(d, n - 1 + d) for d, n in zip(c, values.shape)) for c, _ in weights}
            u = sum(w * values[part[c]] for c, w in weights)
            along = []
            for axis in range(3):
                slope = [np.prod([(1 if c[axis] else -1) if a == axis else (offset[a] if c[a] else 1 - offset[a])
                                  for a in range(3)]) for c, _ in weights]
                along.append(sum(s * positions[part[c]] for s, (c, _) in zip(slope, weights)))
            det = np.einsum("...i,...i", along[2], np.cross(along[1], along[0]))
            total += det[u > 0.1].sum() / each**3
        self.assertLess(abs(abs(volume(points, triangles)) / abs(total) - 1), 1e-2)
        parts = self.extracted("--components", "1", iso=0.8)[1]
        self.assertLess(len(parts), len(self.extracted(iso=0.8)[1]))

    def test_mesh_formats(self):
        self.stored()
        points, _, found = self.extracted()
        for name in ("m.ply", "m.stl", "m.obj", "m.vtkhdf", "m.glb", "m.3mf"):
            done = self.run_isonest("extract", "--iso", ISO, "-o", self.here / name)
            self.assertEqual(done.returncode, 0, done.stderr)
        reader = vtk.vtkPLYReader()
        reader.SetFileName(str(self.here / "m.ply"))
        reader.Update()
        self.same_points(arrays(reader.GetOutput())[0], points)

    def test_bytes_do_not_depend_on_threads_memory_and_chunks(self):
        stores, meshes = set(), set()
        for options in (("--threads", "1"), ("--threads", "3"), ("--memory", "64M")):
            self.stored(*options)
            stores.add(self.store.read_bytes())
            for more in (("--threads", "1"), ("--threads", "3"), ("--memory", "48M")):
                self.extracted("--normals", *more)
                meshes.add((self.here / "m.vtp").read_bytes())
        self.assertEqual(len(stores), 1)
        done = self.run_isonest("preprocess", "-o", self.store, "--force", "--chunk", 32, of=self.path)
        self.assertEqual(done.returncode, 0, done.stderr)
        self.extracted("--normals")
        meshes.add((self.here / "m.vtp").read_bytes())
        self.assertEqual(len(meshes), 1)

    def test_folded_cells_are_reported(self):
        positions = twisted()
        positions[10, 12, 20] += 3 * (positions[10, 12, 23] - positions[10, 12, 20])
        self.write(positions, field())
        done = self.stored()
        found = re.search(r"note: (\d+) cells .* first at node (\d+) (\d+) (\d+)", done.stdout)
        self.assertIsNotNone(found, done.stdout)
        folded = json.loads(self.run_isonest("info", "--json").stdout)["curvilinear"]
        # By the definition: the determinants at the corners of each cell.
        expected = []
        for k, j, i in np.ndindex(*(n - 1 for n in positions.shape[:3])):
            signs = []
            for c in itertools.product((0, 1), repeat=3):
                along = []
                for axis in (2, 1, 0):
                    low, high = list(c), list(c)
                    low[axis], high[axis] = 0, 1
                    along.append(positions[k + high[0], j + high[1], i + high[2]] - positions[k + low[0], j + low[1], i + low[2]])
                signs.append(np.dot(np.cross(along[0], along[1]), along[2]) > 0)
            if not all(signs):
                expected.append([i, j, k])
        self.assertGreater(len(expected), 3)
        self.assertEqual(folded["folded_cells"], len(expected))
        self.assertEqual(folded["first_folded"], expected[0])
        self.assertEqual([int(g) for g in found.groups()], [len(expected), *expected[0]])
        self.assertIn(f"{len(expected)} folded cells, the first at node", self.run_isonest("info").stdout)
        # A pole: the cells around it have an edge without extent.
        k, j, i = np.meshgrid(np.arange(6.0), np.arange(9.0), np.arange(7.0), indexing="ij")
        self.write(np.stack([i * np.cos(j / 5), i * np.sin(j / 5), k], -1), np.cos(i - 3).astype("f4"))
        self.stored()
        self.assertEqual(json.loads(self.run_isonest("info", "--json").stdout)["curvilinear"]["folded_cells"], 8 * 5)
        points, _, _ = self.extracted("--normals", "--close", iso=0.5)
        self.assertTrue(np.isfinite(points).all())

    def test_parts_of_the_grid(self):
        self.stored("--crop", "3:31,2:28,4:25", "--every", "2,1,3")
        part = (slice(4, 25, 3), slice(2, 28), slice(3, 31, 2))
        with h5py.File(self.store) as store:
            for a, name in enumerate("xyz"):
                np.testing.assert_array_equal(store["positions"][name], twisted()[part][..., a])
        self.same_points(self.extracted()[0], crossings(twisted()[part], field()[part]))

    def test_a_spacing_gives_the_lattice(self):
        self.stored("--spacing", "1,2,3")
        with h5py.File(self.store) as store:
            self.assertNotIn("positions", store)
            self.assertLess(store.attrs["version"][1], 15)
        self.refuses(5, "an origin needs straight axes", options=("--origin", "1,2,3"))

    def test_what_is_refused(self):
        self.stored()
        for command, options in (
                ("extract", ("--iso", ISO, "--box=0,0,0,1,1,1")), ("extract", ("--iso", ISO, "--error", "0.01")),
                ("extract", ("--iso", ISO, "--error", "0.01", "--effort", "none")),
                ("extract", ("--iso", ISO, "--triangles", "100", "--error", "0.1")),
                ("extract", ("--iso", ISO, "--distance", "1", "--effort", "none")),
                ("extract", ("--iso", ISO, "--vertex-values", f"a={self.store}")),
                ("slice", ("--plane", "0,0,1,3"))):
            with self.subTest(command=command, options=options):
                done = self.run_isonest(command, *options, "-o", self.here / "r.vtp")
                self.assertNotEqual(done.returncode, 0)
                self.assertRegex(done.stderr, "curvilinear|cannot be combined|together")
                self.assertFalse((self.here / "r.vtp").exists())
        done = self.run_isonest("export", "--field", "values", "-o", self.here / "r.nrrd")
        self.assertIn("cannot store the positions", done.stderr)
        done = self.run_isonest("extract", "--iso", ISO, "-o", self.here / "r.vtp", of=self.path)
        self.assertIn("curvilinear", done.stderr)
        self.refuses(5, "straight axes", options=("--indicators", "normal_bar"))

    def test_broken_files(self):
        self.write(twisted(), field(), compressed=False)
        whole = self.path.read_bytes()
        for old, new, code, words in (
                (b'NumberOfComponents="3"', b'NumberOfComponents="2"', None, ""),
                (b"Points>", b"Poinds>", 4, "points with three components"),
                (b'WholeExtent="0 34', b'WholeExtent="0 33', None, "")):
            with self.subTest(new=new):
                self.assertIn(old, whole)
                self.path.write_bytes(whole.replace(old, new))
                done = self.preprocess()
                self.assertIn(done.returncode, (code,) if code else (3, 4, 5), done.stderr)
                self.assertIn(words, done.stderr)
                self.assertIn("v.vts", done.stderr)
        for size in (len(whole) - 20000, len(whole) // 2, 700):
            self.path.write_bytes(whole[:size])
            done = self.preprocess()
            self.assertIn(done.returncode, (2, 3, 4), done.stderr)
            self.assertIn("v.vts", done.stderr)
        positions = twisted()
        positions[3, 4, 5, 1] = np.nan
        self.write(positions, field())
        self.refuses(2, "the y coordinate of node 5 4 3 is nan")
        self.write(twisted((9, 7, 1)), field((9, 7, 1)))
        self.refuses(5, "at least two along each axis")

    def test_damaged_stores(self):
        self.stored()
        with h5py.File(self.store) as store:
            row = int(store["positions/y"].attrs["first_chunk_row"])
            offset = int(store["chunks"][row]["offset"])
        whole = bytearray(self.store.read_bytes())
        whole[offset + 30] ^= 1
        self.store.write_bytes(whole)
        done = self.run_isonest("check")
        self.assertIn("positions y, chunk 0 0 0", done.stdout + done.stderr)
        done = self.run_isonest("extract", "--iso", ISO, "-o", self.here / "d.vtp")
        if done.returncode != 0:
            self.assertIn("positions, y, chunk", done.stderr)

    def test_from_a_url(self):
        self.stored()
        for options in ((), ("--normals", "--cells", "tet"), ("--close", "--distance", "0.1")):
            self.extracted(*options)
            local = (self.here / "m.vtp").read_bytes()
            with RangeServer(self.here) as server:
                done = self.run_isonest("extract", "--iso", ISO, *options, "-o", self.here / "r.vtp",
                                        of=server.url("s.isonest"))
                if "built without" in done.stderr or "libcurl" in done.stderr:
                    self.skipTest("no URLs in this build")
                self.assertEqual(done.returncode, 0, done.stderr)
                self.assertEqual((self.here / "r.vtp").read_bytes(), local)

    def test_series_and_several_isovalues(self):
        for step in range(2):
            self.path = self.here / f"v_{step}.vts"
            self.write(twisted() * (1 + step), field())
        series = self.here / "run.isonest"
        done = served.run([ISONEST, "preprocess", str(self.here / "v_0.vts"), str(self.here / "v_1.vts"), "-o", str(series),
                           "--chunk", "8"], capture_output=True, text=True)
        self.assertEqual(done.returncode, 0, done.stderr)
        done = self.run_isonest("extract", "--iso", f"{ISO},0.7", "-o", self.here / "m_{step}_{iso}.vtp", of=series)
        self.assertEqual(done.returncode, 0, done.stderr)
        meshes = sorted(self.here.glob("m_*.vtp"))
        self.assertEqual(len(meshes), 4)
        for path in meshes:
            step, iso = re.fullmatch(r"m_0*(\d)_(.*)", path.stem).groups()
            self.same_points(read_mesh(path)[0], crossings(twisted() * (1 + int(step)), field(), float(iso)), 1e-5)
        plain = self.here / "p.npy"
        np.save(plain, field())
        done = served.run([ISONEST, "preprocess", str(plain), "-o", str(series), "--append"], capture_output=True, text=True)
        self.assertNotEqual(done.returncode, 0)
        self.assertIn("curvilinear", done.stderr)

    def test_surfaces_of_labels(self):
        labels = (field() > 0.6).astype("u1")
        self.write(twisted(), labels)
        self.stored()
        done = self.run_isonest("extract", "--label", 1, "-o", self.here / "l.vtp")
        self.assertEqual(done.returncode, 0, done.stderr)
        points, triangles, _ = read_mesh(self.here / "l.vtp")
        self.same_points(points, crossings(twisted(), labels, 0.5))
        done = self.run_isonest("extract", "--label", 1, "--smooth", "-o", self.here / "s.vtp")
        self.assertIn("curvilinear", done.stderr)
        self.assertFalse((self.here / "s.vtp").exists())

    def test_ocean_grids(self):
        """2-D longitude and latitude, as ROMS and NEMO write them."""
        eta, xi, levels = 22, 30, 9
        j, i = np.meshgrid(np.arange(eta), np.arange(xi), indexing="ij")
        lon = (-20 + 0.5 * i + 0.1 * j).astype("f4")
        lat = (40 + 0.3 * j - 0.05 * i).astype("f4")
        depth = np.array([0, 5, 12, 25, 50, 100, 200, 400, 800.0])
        values = field((xi, eta, levels))
        for fmt, vertical in itertools.product(("NETCDF4", "NETCDF3_CLASSIC"), ("scale", "none", "volume")):
            with self.subTest(fmt=fmt, vertical=vertical):
                self.path = self.here / "v.nc"
                with netCDF4.Dataset(self.path, "w", format=fmt) as file:
                    for name, length in (("time", 2), ("s", levels), ("eta", eta), ("xi", xi)):
                        file.createDimension(name, length)
                    for name, data, units in (("lon", lon, "degrees_east"), ("lat", lat, "degrees_north")):
                        made = file.createVariable(name, "f4", ("eta", "xi"))
                        made[:] = data
                        made.units = units
                    if vertical == "scale":
                        made = file.createVariable("s", "f8", ("s",))
                        made[:] = depth
                    z = np.broadcast_to(depth[:, None, None], values.shape)
                    if vertical == "volume":
                        z = depth[:, None, None] * (1 + 0.01 * i)
                        made = file.createVariable("z_rho", "f8", ("s", "eta", "xi"))
                        made[:] = z
                        made.positive = "up"
                    if vertical == "none":
                        z = np.broadcast_to(np.arange(levels)[:, None, None], values.shape)
                    made = file.createVariable("temp", "f4", ("time", "s", "eta", "xi"))
                    made[:] = np.stack([values, values * 0])
                    made.coordinates = "lon lat z_rho time" if vertical == "volume" else "time lat lon"
                done = self.stored("--dataset", "temp", "--index", "time=0")
                positions = np.stack([np.broadcast_to(lon, values.shape), np.broadcast_to(lat, values.shape), z], -1)
                with h5py.File(self.store) as store:
                    for a, name in enumerate("xyz"):
                        np.testing.assert_array_equal(store["positions"][name], positions[..., a])
                self.assertEqual("z is their number" in done.stdout, vertical == "none")
                self.same_points(self.extracted()[0], crossings(positions.astype("f8"), values), 1e-4)
                # Data in a plane stay what they were.
                self.assertEqual(self.preprocess("--dataset", "temp", "--index", "time=0,s=2").returncode, 0)


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1])
