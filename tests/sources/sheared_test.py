#!/usr/bin/env python3
"""Volumes with axes that are not at right angles: every output is where the input's own readers place it.

usage: sheared_test.py ISONEST PLUGIN_FOLDER
"""
import json
import os
import pathlib
import sys
import unittest

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1] / "support"))
import served  # noqa: E402

os.environ["HDF5_PLUGIN_PATH"] = sys.argv[2]
try:
    import h5py
    import nibabel
    import numpy as np
    import scipy.ndimage
    import vtk
    from vtk.util import numpy_support
    from volume_inputs import ISONEST, Input
except ImportError as error:
    print(f"skipped: {error}")
    sys.exit(77)

SHAPE = (26, 29, 33)  # z, y, x
ORIGIN = np.array([-30.0, 12.0, 55.0])
TILT = np.tan(np.radians(18.5))
# Columns: the steps along x, y and z. A tilted gantry, whose axes are the volume's own axes already; a triclinic cell;
# the same, rotated; and a left-handed one, whose first axis is reversed.
GANTRY = np.array([[0.8, 0, 0], [0, 0.8, 1.5 * TILT], [0, 0, 1.5]])
CELL = np.array([[1.0, -0.35, 0.2], [0, 0.9, -0.3], [0, 0, 1.1]])


def rotation(seed):
    q, _ = np.linalg.qr(np.random.default_rng(seed).normal(size=(3, 3)))
    return q * np.linalg.det(q)


TURNED = rotation(1) @ CELL
LATTICES = {"gantry": GANTRY, "cell": CELL, "turned": TURNED}
# In world coordinates.
CENTRE = {name: ORIGIN + steps @ (np.array(SHAPE[::-1]) - 1) / 2 for name, steps in LATTICES.items()}
RADIUS = 8.0


def places(steps, shape=SHAPE, origin=ORIGIN):
    """Positions of all nodes, [z, y, x, 3]."""
    z, y, x = np.mgrid[:shape[0], :shape[1], :shape[2]]
    return np.stack((x, y, z), -1) @ steps.T + origin


def ball(name):
    return (RADIUS - np.linalg.norm(places(LATTICES[name]) - CENTRE[name], axis=-1)).astype("f4")


def read_mesh(path):
    reader = vtk.vtkXMLPolyDataReader()
    reader.SetFileName(str(path))
    reader.Update()
    mesh = reader.GetOutput()
    arrays = mesh.GetPointData()
    triangles = numpy_support.vtk_to_numpy(mesh.GetPolys().GetConnectivityArray()).reshape(-1, 3)
    return (numpy_support.vtk_to_numpy(mesh.GetPoints().GetData()).astype("f8"), triangles,
            {arrays.GetArrayName(i): numpy_support.vtk_to_numpy(arrays.GetArray(i))
             for i in range(arrays.GetNumberOfArrays())})


def volume_and_area(points, triangles):
    a, b, c = (points[triangles[:, i]] - points.mean(0) for i in range(3))
    return np.einsum("ij,ij->i", a, np.cross(b, c)).sum() / 6, np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2


def polydata(points, triangles):
    mesh = vtk.vtkPolyData()
    at = vtk.vtkPoints()
    at.SetData(numpy_support.numpy_to_vtk(points.astype("f8"), deep=1))
    mesh.SetPoints(at)
    cells = vtk.vtkCellArray()
    cells.SetData(3, numpy_support.numpy_to_vtkIdTypeArray(np.ascontiguousarray(triangles, "i8").ravel(), deep=1))
    mesh.SetPolys(cells)
    return mesh


def furthest(points, triangles):
    """Distances of points from the triangles, by VTK's search for the closest point."""
    def of(some):
        locator = vtk.vtkCellLocator()
        locator.SetDataSet(polydata(points, triangles))
        locator.BuildLocator()
        closest, cell, sub, square = [0.0] * 3, vtk.reference(0), vtk.reference(0), vtk.reference(0.0)
        most = 0.0
        for p in some:
            locator.FindClosestPoint(p, closest, cell, sub, square)
            most = max(most, float(square))
        return most**0.5
    return of


def samples(points, triangles):
    """Corners, and points inside the triangles."""
    weights = np.array([(i, j, 4 - i - j) for i in range(5) for j in range(5 - i)]) / 4
    return np.einsum("wk,tkd->twd", weights, points[triangles]).reshape(-1, 3)


def gradient(corners, values):
    return np.linalg.solve(corners[1:] - corners[0], values[1:] - values[0])


def unit(vector):
    size = np.linalg.norm(vector)
    return vector / size if size > 0 else vector * 0


def indicators_of_finest(values, steps):
    """The maximum for each refinement node of level 1 and finer, by its coordinates (x, y, z): from explicit bisection
    of the longest edge, and the formulas of FORMAT.md, section 4."""
    found = {}
    last = np.array(values.shape[::-1]) - 1

    def number(p):
        return float(values[tuple(p[::-1])])

    def refine(t):
        edges = [(((a - b)**2).sum(), i, j) for i, a in enumerate(t) for j, b in enumerate(t) if i < j]
        longest, i, j = max(edges, key=lambda e: e[0])
        if longest <= 3:  # an element of the finest cubes
            return
        x = (t[i] + t[j]) // 2
        rest = [t[k] for k in range(4) if k not in (i, j)]
        halves = [[x, t[i], *rest], [x, t[j], *rest]]
        # Level 1: cubes with an edge of 2, whose refinement nodes have an odd coordinate.
        if (x % 2).any():
            eta = found.setdefault(tuple(map(int, x)), dict.fromkeys(("l1", "grad_linf", "grad_l1", "grad_l2", "grad_edge",
                                                                      "normal_jump", "normal_turn"), 0.0))
            d = abs(number(x) - (number(t[i]) + number(t[j])) / 2)
            world = [np.array(h) @ steps.T for h in halves]
            sizes = [abs(np.linalg.det(w[1:] - w[0])) / 6 for w in world]
            hats = [np.linalg.norm(gradient(w, np.array([1.0, 0, 0, 0]))) for w in world]
            own = unit(gradient(np.array(t) @ steps.T, np.array([number(p) for p in t])))
            normals = [unit(gradient(w, np.array([number(p) for p in h]))) for w, h in zip(world, halves)]
            eta["l1"] += d * sum(sizes) / 4
            eta["grad_linf"] = max(eta["grad_linf"], d * max(hats))
            eta["grad_l1"] += d * np.dot(sizes, hats)
            eta["grad_l2"] += np.dot(sizes, np.square(hats)) * d * d
            eta["grad_edge"] = 2 * d / np.linalg.norm((t[i] - t[j]) @ steps.T)
            eta["normal_jump"] = max(eta["normal_jump"], np.linalg.norm(normals[0] - normals[1]))
            eta["normal_turn"] = max(eta["normal_turn"], *(np.linalg.norm(n - own) for n in normals))
        for h in halves:
            refine(h)

    for order in ((0, 1, 2), (0, 2, 1), (1, 0, 2), (1, 2, 0), (2, 0, 1), (2, 1, 0)):
        corners = [np.zeros(3, int)]
        for axis in order:
            corners.append(corners[-1] + np.eye(3, dtype=int)[axis] * last)
        refine(corners)
    for eta in found.values():
        eta["grad_l2"] = eta["grad_l2"]**0.5
    # Saturated: a face covers the midpoints of its edges, a cube's centre its faces.
    for odd in (2, 3):
        for x, eta in found.items():
            axes = [a for a in range(3) if x[a] % 2]
            for axis in axes if len(axes) == odd else ():
                for step in (-1, 1):
                    child = found[tuple(n + step * (a == axis) for a, n in enumerate(x))]
                    eta.update({name: max(number, child[name]) for name, number in eta.items()})
    return found


class Sheared(Input):
    def nifti(self, steps, data, name="v.nii"):
        affine = np.eye(4)
        affine[:3, :3] = steps
        affine[:3, 3] = ORIGIN
        self.path = self.here / name
        nibabel.save(nibabel.Nifti2Image(data.T, affine), self.path)
        return self.path

    def run_it(self, *arguments, code=0):
        done = served.run([ISONEST, *map(str, arguments)], capture_output=True, text=True)
        self.assertEqual(done.returncode, code, (arguments, done.stderr))
        return done

    def store(self, steps, data, name="s", *options):
        self.nifti(steps, data)
        self.run_it("preprocess", self.path, "-o", self.here / name, "--chunk", "8", "--force", *options)
        return self.here / name

    def extract(self, source, *options):
        """The mesh, and the report."""
        out = self.here / "m.vtp"
        done = self.run_it("extract", source, "--json", "-q", *options, "-o", out)
        mesh = read_mesh(out)
        out.unlink()
        return (*mesh, json.loads(done.stdout))

    def test_the_store_says_how_its_axes_lie(self):
        store = self.store(GANTRY, ball("gantry"))
        info = json.loads(self.run_it("info", store, "--json").stdout)
        self.assertTrue(info["sheared"])
        lengths = np.linalg.norm(GANTRY, axis=0)
        np.testing.assert_allclose(info["spacing"], lengths)
        np.testing.assert_allclose(info["origin"], ORIGIN)
        np.testing.assert_allclose(np.array(info["direction"]).T * lengths, GANTRY, atol=1e-12)
        self.assertIn("sheared, y and z meet at 71.5 degrees", self.run_it("info", store).stdout)
        self.assertIn("sheared, y and z meet at 71.5 degrees", self.run_it("info", self.path).stdout)
        self.run_it("check", store, "--deep")
        self.run_it("check", store, "--source", self.path)
        with h5py.File(store) as file:
            self.assertEqual(file.attrs["flags"], 0b101)
            self.assertEqual(list(file.attrs["version"]), [2, 11])
            np.testing.assert_allclose(file["VTKHDF"].attrs["Direction"].reshape(3, 3) * lengths, GANTRY, atol=1e-12)
        # A volume without shear keeps the version that older readers open, which does not have this bit.
        upright = self.store(np.diag([0.8, 0.8, 1.5]), ball("gantry"), "u")
        with h5py.File(upright) as file:
            self.assertEqual(list(file.attrs["version"]), [2, 10])
            self.assertEqual(file.attrs["flags"], 0)
        self.assertFalse(json.loads(self.run_it("info", upright, "--json").stdout)["sheared"])
        with h5py.File(store, "r+") as file:
            file.attrs.modify("version", np.array([2, 10], "u4"))
        self.assertIn("flags", self.run_it("info", store, code=5).stderr)

    def test_directions_and_the_bit_have_to_agree(self):
        store = self.store(GANTRY, ball("gantry"))
        whole = store.read_bytes()
        with h5py.File(store, "r+") as file:
            file.attrs.modify("flags", np.uint32(4))
        self.assertEqual(served.run([ISONEST, "info", store], capture_output=True).returncode, 4)
        store.write_bytes(whole)
        with h5py.File(store, "r+") as file:
            file.attrs.modify("direction", np.eye(3).ravel()[[3, 4, 5, 6, 7, 8, 0, 1, 2]])
        self.assertIn("directions", self.run_it("info", store, code=4).stderr)

    def test_vertices_of_a_linear_function_lie_in_a_plane_and_normals_across_it(self):
        across = np.array([0.48, -0.6, 0.64])
        for name, steps in LATTICES.items():
            data = (places(steps) - CENTRE[name]) @ across
            source = self.store(steps, data.astype("f4"))
            for given in (source, self.path):
                for options in (("--cells", "hex"), ("--cells", "tet"), ("--distance", "0.3"), ("--error", "0.01", "--effort", "none"), ("--close",),
                                ("--error", "0.2"), ("--error", "0.2", "--cells", "tet", "--effort", "fast")):
                    with self.subTest(lattice=name, options=options, store=given is source):
                        points, triangles, arrays, report = self.extract(given, "--iso", "0.25", "--normals", *options)
                        self.assertGreater(len(triangles), 1)
                        on = np.abs((points - CENTRE[name]) @ across - 0.25)
                        if "--close" not in options:
                            self.assertLess(on.max(), 2e-5)
                            # Coarse differences at the border reach beyond the volume, where the function differs.
                            loose = "--error" in options
                            np.testing.assert_allclose(arrays["normal"] @ across, -1, atol=8e-2 if loose else 1e-4)
                            a, b, c = (points[triangles[:, i]] for i in range(3))
                            facing = np.cross(b - a, c - a) @ across
                            self.assertLess(facing.max(), 1e-4)
                            self.assertLess(np.median(facing), -1e-3)
                        else:
                            # Half of a parallelepiped, possibly minus a slice: exact volumes.
                            volume, area = volume_and_area(points, triangles)
                            self.assertAlmostEqual(report["volume"] / volume, 1, 4)
                            self.assertAlmostEqual(report["area"] / area, 1, 4)

    def test_a_closed_box_has_the_volume_of_the_cell(self):
        """All values are above the isovalue: the caps are the volume's faces, with all options."""
        for name, steps in LATTICES.items():
            data = np.full(SHAPE, 3, "f4")
            data[SHAPE[0] // 2] = 4
            cells = np.array(SHAPE[::-1]) - 1
            expected = np.linalg.det(steps) * cells.prod()
            sides = steps * cells
            area = 2 * sum(np.linalg.norm(np.cross(sides[:, i], sides[:, (i + 1) % 3])) for i in range(3))
            store = self.store(steps, data)
            for options in (("--cells", "hex"), ("--cells", "tet"), ("--distance", "0.05"), ("--error", "0.5", "--effort", "none"),
                            ("--error", "0.5", "--effort", "fast", "--cells", "tet"), ("--error", "0.5", "--cells", "tet"),
                            ("--triangles", "60")):
                with self.subTest(lattice=name, options=options):
                    points, triangles, _, report = self.extract(store, "--iso", "1", "--close", *options)
                    self.assertAlmostEqual(report["volume"] / expected, 1, 4)
                    if "--triangles" not in options:
                        self.assertAlmostEqual(report["area"] / area, 1, 4)

    def test_a_ball_is_a_ball(self):
        for name, steps in LATTICES.items():
            data = ball(name)
            store = self.store(steps, data)
            for options in ((), ("--cells", "tet"), ("--error", "0.05", "--effort", "none"), ("--distance", "0.1"),
                            ("--distance", "0.1", "--cells", "tet"), ("--vertices", "exact", "--error", "0.05"),
                            ("--distance", "0.4", "--effort", "none")):
                with self.subTest(lattice=name, options=options):
                    points, triangles, arrays, report = self.extract(store, "--iso", "0", "--normals", *options)
                    off = 0.45 if "none" in options and "--distance" in options else 0.22
                    radial = points - CENTRE[name]
                    self.assertLess(np.abs(np.linalg.norm(radial, axis=1) - RADIUS).max(), off)
                    # Toward smaller values: outward.
                    cosine = np.einsum("ij,ij->i", radial, arrays["normal"]) / np.linalg.norm(radial, axis=1)
                    self.assertGreater(cosine.min(), 0.97)
                    volume, area = volume_and_area(points, triangles)
                    self.assertAlmostEqual(report["volume"] / volume, 1, 4)
                    self.assertAlmostEqual(report["area"] / area, 1, 4)
                    share = 0.1 if "none" in options and "--distance" in options else 0.03
                    self.assertLess(abs(volume / (4 / 3 * np.pi * RADIUS**3) - 1), share)
                    self.assertLess(abs(area / (4 * np.pi * RADIUS**2) - 1), share)

    def test_values_and_topology_do_not_know_of_the_shear(self):
        """At full resolution, and on the nested grid, vertices are those of the unsheared lattice, transformed."""
        for name, steps in LATTICES.items():
            data = ball(name)
            fields = ("--indicators", "deviation_bar,hex_deviation")
            sheared = self.store(steps, data, "s", *fields)
            plain = self.store(np.eye(3), data, "p", *fields)
            for options in (("--cells", "hex"), ("--cells", "tet"), ("--error", "0.3", "--cells", "tet", "--effort", "none"),
                            ("--error", "0.3", "--cells", "hex", "--effort", "none")):
                with self.subTest(lattice=name, options=options):
                    a = self.extract(sheared, "--iso", "0.1", *options)
                    b = self.extract(plain, "--iso", "0.1", *options)
                    np.testing.assert_array_equal(a[1], b[1])
                    np.testing.assert_allclose(a[0], (b[0] - ORIGIN) @ steps.T + ORIGIN, atol=3e-5)
                    self.assertEqual(a[3].get("error_bound"), b[3].get("error_bound"))

    def test_a_distance_is_one_of_the_world(self):
        for name, steps in LATTICES.items():
            data = ball(name) + 0.4 * np.sin(places(steps) @ [0.9, 0.5, 0.7]).astype("f4")
            store = self.store(steps, data)
            for options in (("--cells", "hex"), ("--cells", "hex", "--effort", "fast"), ("--cells", "tet", "--effort", "none")):
                full = self.extract(store, "--iso", "0", *options[:2])
                for within in (0.05, 0.2, 0.6):
                    with self.subTest(lattice=name, options=options, within=within):
                        points, triangles, _, report = self.extract(store, "--iso", "0", "--distance", within, *options)
                        self.assertLess(len(triangles), len(full[1]))
                        bound = report["distance_bound"]
                        self.assertLessEqual(bound, within)
                        most = max(furthest(full[0], full[1])(samples(points, triangles)),
                                   furthest(points, triangles)(samples(full[0], full[1])))
                        self.assertLessEqual(most, bound + 1e-5)
                        self.assertGreater(most, 0.05 * within)

    def test_a_resampled_volume_has_the_same_surface(self):
        for name, steps in LATTICES.items():
            data = ball(name)
            low = CENTRE[name] - 12
            step, count = 0.5, 49
            # The lattice coordinates of the new nodes, in the order of the array: z, y, x.
            inverse = np.linalg.inv(steps)[::-1, ::-1] * step
            first = (np.linalg.inv(steps) @ (low - ORIGIN))[::-1]
            even = scipy.ndimage.affine_transform(data.astype("f8"), inverse, first, (count,) * 3, order=3, mode="nearest")
            affine = np.diag([step, step, step, 1])
            affine[:3, 3] = low
            nibabel.save(nibabel.Nifti2Image(even.astype("f4").T, affine), self.here / "even.nii")
            a = self.extract(self.nifti(steps, data), "--iso", "2")
            b = self.extract(self.here / "even.nii", "--iso", "2")
            with self.subTest(lattice=name):
                self.assertLess(furthest(a[0], a[1])(b[0]), 0.15)
                self.assertLess(furthest(b[0], b[1])(a[0]), 0.15)
                for x, y in zip(volume_and_area(*a[:2]), volume_and_area(*b[:2])):
                    self.assertLess(abs(x / y - 1), 0.02)

    def test_nodes_lie_where_nibabel_puts_them(self):
        for name, steps in {**LATTICES, "left-handed": TURNED * [-1, 1, 1], "reversed": CELL * [1, 1, -1]}.items():
            with self.subTest(lattice=name):
                data = np.arange(np.prod(SHAPE), dtype="f4").reshape(SHAPE)
                store = self.store(steps, data)
                info = json.loads(self.run_it("info", store, "--json").stdout)
                own = np.array(info["direction"]).T * info["spacing"]
                self.assertGreater(np.linalg.det(own), 0)
                self.run_it("export", store, "--field", "values", "-o", self.here / "e.raw", "--force")
                found = np.fromfile(self.here / "e.raw", "f4").reshape(SHAPE)
                at = places(own, origin=np.array(info["origin"])).reshape(-1, 3)
                i = np.random.default_rng(3).integers(0, len(at), 300)
                z, y, x = np.unravel_index(found.ravel()[i].astype(int), SHAPE)
                expected = nibabel.affines.apply_affine(nibabel.load(self.path).affine, np.stack((x, y, z), -1))
                np.testing.assert_allclose(at[i], expected, atol=1e-5)

    def test_slices_and_contours_are_in_the_world(self):
        across = np.array([0.2, -0.5, 0.84])
        across /= np.linalg.norm(across)
        values = np.array([0.3, 0.2, -0.6])
        for name, steps in LATTICES.items():
            store = self.store(steps, (places(steps) @ values).astype("f4"))
            plane = ",".join(map(repr, [*map(float, across), float(across @ CENTRE[name])]))
            with self.subTest(lattice=name):
                out = self.here / "m.vtp"
                self.run_it("slice", store, "--plane=" + plane, "-o", out)
                points, triangles, arrays = read_mesh(out)
                out.unlink()
                self.assertGreater(len(triangles), 100)
                np.testing.assert_allclose(points @ across, across @ CENTRE[name], atol=1e-4)
                np.testing.assert_allclose(arrays["value"], points @ values, atol=1e-4)
                a, b, c = (points[triangles[:, i]] for i in range(3))
                turned = np.cross(b - a, c - a) @ across
                self.assertTrue((turned > -1e-9).all() or (turned < 1e-9).all())
                self.run_it("slice", store, "--plane=" + plane, "-o", self.here / "p.png")
                (self.here / "p.png").unlink()
                self.assertIn("misses", self.run_it("slice", store, "--plane=1,0,0,-4000", "-o", out).stdout)

    def test_indicators_take_gradients_of_the_world(self):
        """For level 1, where explicit bisection gives them."""
        values = np.random.default_rng(5).normal(size=(9, 9, 9)).astype("f4")
        for name, steps in LATTICES.items():
            wanted = indicators_of_finest(values, steps)
            names = tuple(next(iter(wanted.values())))
            store = self.store(steps, values, "s", "--exact", "--indicators", "deviation_bar," + ",".join(n + "_bar" for n in names))
            with h5py.File(store) as file:
                for indicator in names:
                    with self.subTest(lattice=name, indicator=indicator):
                        on_disk = "normal" if indicator == "normal_jump" else indicator
                        stored = file[f"levels/1/{on_disk}_bar"][...]
                        at = np.array(list(wanted))
                        slot = (at % 2) @ [1, 2, 4] - 1
                        i, j, k = (at // 2).T
                        expected = np.array([eta[indicator] for eta in wanted.values()])
                        found = stored[k, j, i, slot]
                        np.testing.assert_allclose(found, expected, rtol=2e-5, atol=1e-6)
                        self.assertGreaterEqual((found - expected * (1 - 1e-6)).min(), -1e-6)

    def test_backfaces_alone_are_left_out(self):
        for name, steps in LATTICES.items():
            data = ball(name)
            store = self.store(steps, data, "s", "--indicators", "deviation_bar,grad_linf_plus,normal_turn_plus")
            view = np.array([0.3, -0.5, 0.8])
            whole = self.extract(store, "--iso", "0", "--cells", "tet")
            for field in ("grad_linf_plus", "normal_turn_plus"):
                with self.subTest(lattice=name, field=field):
                    seen = self.extract(store, "--iso", "0", "--cells", "tet", "--view=0.3,-0.5,0.8", "--cull-by", field)

                    def front(points, triangles):
                        a, b, c = (points[triangles[:, i]] for i in range(3))
                        facing = np.cross(b - a, c - a) @ view < -1e-6
                        return {tuple(np.round((a + b + c)[i], 2)) for i in np.flatnonzero(facing)}
                    self.assertLess(len(seen[1]), 0.9 * len(whole[1]))
                    self.assertEqual(front(*seen[:2]), front(*whole[:2]))

    def test_focus_and_camera_are_in_the_world(self):
        for name, steps in LATTICES.items():
            store = self.store(steps, ball(name))
            towards = CENTRE[name] + [0, 0, RADIUS]
            text = ",".join(map(repr, map(float, towards)))
            for options in (("--error", "0.02", "--focus=" + text, "--falloff", "4"),
                            ("--error", "0.0001", "--camera=" + ",".join(map(repr, map(float, towards + [0, 0, 3]))), "--pixels", "1500")):
                with self.subTest(lattice=name, options=options):
                    points, triangles, *_ = self.extract(store, "--iso", "0", "--cells", "tet", *options)
                    middle = points[triangles].mean(1)
                    sizes = np.linalg.norm(points[triangles[:, 0]] - points[triangles[:, 1]], axis=1)
                    near = np.linalg.norm(middle - towards, axis=1) < 4
                    away = np.linalg.norm(middle - towards, axis=1) > 12
                    self.assertLess(np.median(sizes[near]), 0.9 * np.median(sizes[away]))

    def test_labels(self):
        for name, steps in LATTICES.items():
            labels = (ball(name) > 0).astype("u1")
            store = self.store(steps, labels, "s", "--labels")
            expected = np.linalg.det(steps) * labels.sum()
            for options in ((), ("--smooth",), ("--smooth", "--distance", "0.4"), ("--smooth", "--keep-nodes", "--distance", "0.4")):
                with self.subTest(lattice=name, options=options):
                    points, triangles, _, report = self.extract(store, "--label", "1", *options)
                    volume, area = volume_and_area(points, triangles)
                    self.assertAlmostEqual(report["volume"] / volume, 1, 4)
                    self.assertAlmostEqual(report["area"] / area, 1, 4)
                    self.assertLess(abs(volume / expected - 1), 0.12)
                    self.assertLess(np.abs(np.linalg.norm(points - CENTRE[name], axis=1) - RADIUS).max(), 2)

    def test_exported_volumes_lie_there_too(self):
        for name, steps in LATTICES.items():
            store = self.store(steps, ball(name))
            for out in ("e.nrrd", "e.nii", "e.vti", "e.h5"):
                with self.subTest(lattice=name, out=out):
                    self.run_it("export", store, "--field", "values", "-o", self.here / out, "--force")
                    self.run_it("preprocess", self.here / out, "-o", self.here / "again", "--force")
                    info = json.loads(self.run_it("info", self.here / "again", "--json").stdout)
                    self.assertTrue(info["sheared"])
                    np.testing.assert_allclose(np.array(info["direction"]).T * info["spacing"], steps, atol=1e-6)
                    np.testing.assert_allclose(info["origin"], ORIGIN, atol=1e-5)
            image = nibabel.load(self.here / "e.nii")
            np.testing.assert_allclose(image.affine[:3, :3], steps, atol=1e-6)
            self.assertEqual(int(image.header["qform_code"]), 0)
            reader = vtk.vtkXMLImageDataReader()
            reader.SetFileName(str(self.here / "e.vti"))
            reader.Update()
            place = [0.0] * 3
            reader.GetOutput().TransformContinuousIndexToPhysicalPoint((3.0, 5.0, 7.0), place)
            np.testing.assert_allclose(place, ORIGIN + steps @ [3, 5, 7], atol=1e-6)
            done = self.run_it("export", store, "--field", "values", "-o", self.here / "e.mha", code=5)
            self.assertIn(".nrrd", done.stderr)
            self.assertFalse((self.here / "e.mha").exists())

    def test_nrrd_and_its_spacing_of_ones_own(self):
        data = ball("cell")
        text = " ".join("(" + ",".join(map(repr, map(float, CELL[:, a]))) + ")" for a in range(3))
        self.path = self.here / "v.nrrd"
        self.path.write_bytes(b"NRRD0004\ntype: float\nendian: little\nencoding: raw\ndimension: 3\nspace dimension: 3\n"
                              b"sizes: " + " ".join(map(str, SHAPE[::-1])).encode() + b"\nspace directions: " + text.encode()
                              + b"\n\n" + data.tobytes())
        self.reads(data)
        info = self.info()
        np.testing.assert_allclose(np.array(info["direction"]).T * info["spacing"], CELL, atol=1e-12)
        done = self.reads(data, "--spacing", "1,1,1")
        self.assertIn("a shear (", done.stdout + done.stderr)
        self.assertFalse(self.info()["sheared"])

    def test_a_plane_with_axes_that_are_not_at_right_angles(self):
        steps = np.array([[1, 0.4, 0.3], [0, 0.9, 0.2], [0, 0, 1.0]])
        for axis in range(3):
            shape = tuple(1 if 2 - axis == k else n for k, n in enumerate(SHAPE))
            at = places(steps, shape)
            middle = at.reshape(-1, 3).mean(0)
            data = (6 - np.linalg.norm(at - middle, axis=-1)).astype("f4")
            with self.subTest(flat="xyz"[axis]):
                store = self.store(steps, data)
                out = self.here / "m.vtp"
                self.run_it("extract", store, "--iso", "0", "-o", out)
                reader = vtk.vtkXMLPolyDataReader()
                reader.SetFileName(str(out))
                reader.Update()
                points = numpy_support.vtk_to_numpy(reader.GetOutput().GetPoints().GetData())
                out.unlink()
                self.assertGreater(len(points), 30)
                self.assertLess(np.abs(np.linalg.norm(points - middle, axis=1) - 6).max(), 0.1)

    def test_a_part_with_one_plane_lies_where_its_nodes_do(self):
        """The axis of one node is perpendicular to the others, which are not changed."""
        for name, steps in LATTICES.items():
            data = ball(name)
            self.nifti(steps, data)
            for axis, word in enumerate(("7:8,:,:", ":,7:8,:", ":,:,7:8")):
                with self.subTest(lattice=name, flat="xyz"[axis]):
                    part = self.here / "part"
                    self.run_it("preprocess", self.path, "--crop", word, "-o", part, "--force")
                    index = [slice(None)] * 3
                    index[2 - axis] = slice(7, 8)
                    expected = places(steps)[tuple(index)].reshape(-1, 3)
                    out = self.here / "m.vtp"
                    self.run_it("extract", part, "--iso", repr(float(np.median(data[tuple(index)]))), "-o", out)
                    reader = vtk.vtkXMLPolyDataReader()
                    reader.SetFileName(str(out))
                    reader.Update()
                    points = numpy_support.vtk_to_numpy(reader.GetOutput().GetPoints().GetData())
                    out.unlink()
                    self.assertGreater(len(points), 10)
                    # In the plane of its nodes, and among them.
                    a, b = (np.array(steps, "f8")[:, k] for k in range(3) if k != axis)
                    normal = np.cross(a, b) / np.linalg.norm(np.cross(a, b))
                    self.assertLess(np.abs((points - expected[0]) @ normal).max(), 1e-4)
                    self.assertTrue((points > expected.min(0) - 1e-4).all() and (points < expected.max(0) + 1e-4).all())

    def test_what_needs_axes_at_right_angles_is_refused(self):
        store = self.store(CELL, ball("cell"))
        self.assertIn("crop", self.run_it("extract", store, "--iso", "0", "--box=-30,12,55,-20,20,60", "-o",
                                          self.here / "m.ply", code=5).stderr)
        for command in (("smooth", store, "--steps", "1", "--tau", "0.1", "--lambda", "1", "-o", self.here / "f.nrrd"),
                        ("study", store, "--graph-distance", "-o", self.here / "t.csv"),
                        ("study", store, "--plane=0,0,1,60", "-o", self.here / "t.csv")):
            done = served.run([ISONEST, *map(str, command)], capture_output=True, text=True)
            self.assertEqual(done.returncode, 5, done.stderr)
            self.assertIn("right angles", done.stderr)
        flat = np.array([[1, 0.9999, 0], [0, 1e-4, 0], [0, 0, 1.0]])
        self.nifti(flat, ball("cell"))
        self.refuses(5, "nearly in one plane", "x and y meet at", "--spacing")


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1])
