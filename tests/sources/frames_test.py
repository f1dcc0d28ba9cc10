#!/usr/bin/env python3
"""Patient axes: what files say about them, from the store to exports and meshes, compared with nibabel, VTK and teem.

A position in RAS is the same position in LPS with x and y negated. The expected positions are computed here, with
NumPy, from each format's documentation: NIfTI uses RAS; MetaImage, as ITK defines it, LPS; NRRD says which.

usage: frames_test.py ISONEST PLUGIN_FOLDER
"""
import json
import pathlib
import re
import shutil
import struct
import subprocess
import sys
import zipfile

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1] / "support"))
import served  # noqa: E402

try:
    import h5py
    import nibabel
    import numpy as np
    import unittest
    import vtk
    from vtk.util.numpy_support import vtk_to_numpy
    from volume_inputs import ISONEST, Input
except ImportError as error:
    print(f"skipped: {error}")
    sys.exit(77)

HALF_TURN = np.diag([-1.0, -1.0, 1.0, 1.0])  # LPS <-> RAS
SHAPE = (7, 9, 11)  # [z, y, x]
TEEM = shutil.which("teem-unu") or shutil.which("unu")


def ball():
    z, y, x = np.mgrid[:SHAPE[0], :SHAPE[1], :SHAPE[2]]
    return np.hypot(np.hypot(x - 4.3, y - 5.1), 1.3 * (z - 2.8)).astype("f4")


def affine(turned, spacing=(0.7, 1.2, 2.5), origin=(-31.0, 12.5, 40.25)):
    """From indices (i, j, k) to positions."""
    matrix = np.eye(4)
    rotation = np.eye(3)
    if turned:
        rotation, _ = np.linalg.qr(np.random.default_rng(3).normal(size=(3, 3)))
        rotation *= np.linalg.det(rotation)
    matrix[:3, :3] = rotation * spacing
    matrix[:3, 3] = origin
    return matrix


def nrrd_text(matrix, space, kind="float"):
    vectors = " ".join("({:.17g},{:.17g},{:.17g})".format(*matrix[:3, a]) for a in range(3))
    return (f"NRRD0004\ntype: {kind}\ndimension: 3\n{space}\nsizes: {SHAPE[2]} {SHAPE[1]} {SHAPE[0]}\n"
            f"space directions: {vectors}\nspace origin: ({matrix[0, 3]:.17g},{matrix[1, 3]:.17g},{matrix[2, 3]:.17g})\n"
            "endian: little\nencoding: raw\n\n")


def write_nrrd(path, matrix, space, data):
    path.write_bytes(nrrd_text(matrix, space).encode() + data.tobytes())


def write_mha(path, matrix, data, orientation="AnatomicalOrientation = RAI\n"):
    spacing = np.linalg.norm(matrix[:3, :3], axis=0)
    rows = " ".join(f"{c:.17g}" for a in range(3) for c in matrix[:3, a] / spacing[a])
    path.write_bytes((
        f"ObjectType = Image\nNDims = 3\nBinaryData = True\nBinaryDataByteOrderMSB = False\nCompressedData = False\n"
        f"TransformMatrix = {rows}\nOffset = {' '.join(f'{c:.17g}' for c in matrix[:3, 3])}\nCenterOfRotation = 0 0 0\n"
        f"{orientation}ElementSpacing = {' '.join(f'{s:.17g}' for s in spacing)}\n"
        f"DimSize = {SHAPE[2]} {SHAPE[1]} {SHAPE[0]}\nElementType = MET_FLOAT\nElementDataFile = LOCAL\n").encode() + data.tobytes())


def nrrd_fields(path):
    text = path.read_bytes().split(b"\n\n")[0].decode()
    return dict(line.split(": ", 1) for line in text.splitlines()[1:] if ": " in line and line[0] != "#")


def nrrd_affine(path):
    fields, matrix = nrrd_fields(path), np.eye(4)
    vectors = [[float(c) for c in v.split(",")] for v in re.findall(r"\(([^)]*)\)", fields["space directions"])]
    matrix[:3, :3] = np.array(vectors).T
    matrix[:3, 3] = [float(c) for c in fields["space origin"].strip("()").split(",")]
    return matrix


def mha_fields(path):
    return dict(re.findall(r"(?m)^(\w+) = (.*)$", path.read_bytes().split(b"LOCAL")[0].decode("latin-1")))


def mha_affine(path):
    fields, matrix = mha_fields(path), np.eye(4)
    numbers = {name: np.array([float(c) for c in fields[name].split()])
               for name in ("TransformMatrix", "Offset", "ElementSpacing")}
    matrix[:3, :3] = numbers["TransformMatrix"].reshape(3, 3).T * numbers["ElementSpacing"]
    matrix[:3, 3] = numbers["Offset"]
    return matrix


class Frames(Input):
    def setUp(self):
        super().setUp()
        self.data = ball()

    def run_it(self, *arguments, code=0):
        done = served.run([ISONEST, *map(str, arguments)], capture_output=True, text=True)
        self.assertEqual(done.returncode, code, done.stdout + done.stderr)
        return done

    def ask(self, *arguments, code=0):
        return json.loads(self.run_it(*arguments, "--json", code=code).stdout)

    def store(self, path, *options):
        out = path.with_suffix(".isonest")
        report = self.ask("preprocess", path, "-o", out, "--chunk", "8", "--force", *options)
        info = self.ask("info", out)
        self.assertEqual(report["frame"], info["frame"])
        return out, info

    def inputs(self, ras):
        """The same volume at the same positions, in four formats; `ras`: its affine in RAS."""
        lps, las = HALF_TURN @ ras, np.diag([-1.0, 1, 1, 1]) @ ras
        paths = {name: self.here / name for name in ("nii.nii", "ras.nrrd", "lps.nrrd", "las.nrrd", "itk.mha")}
        nibabel.save(nibabel.Nifti2Image(self.data.T, ras), paths["nii.nii"])
        write_nrrd(paths["ras.nrrd"], ras, "space: RAS", self.data)
        write_nrrd(paths["lps.nrrd"], lps, "space: left-posterior-superior", self.data)
        write_nrrd(paths["las.nrrd"], las, "space: LAS", self.data)
        write_mha(paths["itk.mha"], lps, self.data)
        return paths

    def as_in_ras(self, info):
        """The positions of the store's low and high corner, in RAS."""
        d = np.array(info["direction"])
        corners = []
        for corner in np.ndindex(2, 2, 2):
            p = np.array(info["origin"]) + sum(
                d[a] * info["spacing"][a] * corner[a] * (info["nodes"][a] - 1) for a in range(3))
            corners.append(HALF_TURN[:3, :3] @ p if info["frame"] == "LPS" else p)
        return np.array(sorted(corners, key=lambda p: tuple(np.round(p, 6))))


class Sources(Frames):
    def test_each_format_says_the_same_places_in_its_frame(self):
        for turned in (False, True):
            ras, corners = affine(turned), []
            for name, path in self.inputs(ras).items():
                with self.subTest(name, turned=turned):
                    _, info = self.store(path)
                    self.assertEqual(info["frame"], "LPS" if name in ("lps.nrrd", "itk.mha") else "RAS")
                    corners.append(self.as_in_ras(info))
                    np.testing.assert_allclose(corners[-1], corners[0], atol=1e-5)
            i, j, k = np.array(SHAPE[::-1]) - 1
            ends = [(ras @ (*np.multiply(c, (i, j, k)), 1))[:3] for c in np.ndindex(2, 2, 2)]
            np.testing.assert_allclose(corners[0], sorted(ends, key=lambda p: tuple(np.round(p, 6))), atol=1e-5)

    def test_nrrd_spaces_with_other_names_cases_and_time(self):
        path = self.here / "s.nrrd"
        spaces = {"right-anterior-superior": "RAS", "Left-Posterior-Superior": "LPS", "lps": "LPS", "RAS": "RAS",
                  "right anterior superior": "RAS", "left-anterior-superior": "RAS", "las": "RAS",
                  "scanner-xyz": None, "3D-right-handed": None, "3D-left-handed": None}
        for space, frame in spaces.items():
            with self.subTest(space):
                write_nrrd(path, affine(False), f"space: {space}", self.data)
                self.assertEqual(self.store(path)[1]["frame"], frame)
        text = nrrd_text(affine(False), "space: left-posterior-superior-time")
        text = re.sub(r"\(([^)]*)\)", r"(\1,0)", text)
        path.write_bytes(text.encode() + self.data.tobytes())
        self.assertEqual(self.store(path)[1]["frame"], "LPS")
        # Without directions, no position is in the space.
        text = re.sub("space directions: .*\nspace origin: .*\n", "", nrrd_text(affine(False), "space: LPS"))
        path.write_bytes(text.encode() + self.data.tobytes())
        self.assertIsNone(self.store(path)[1]["frame"])
        write_nrrd(path, affine(False), "space dimension: 3", self.data)
        self.assertIsNone(self.store(path)[1]["frame"])

    def test_nifti_without_codes_and_meta_image_of_no_patient(self):
        path = self.here / "n.nii"
        image = nibabel.Nifti1Image(self.data.T, None)
        for qform, sform in ((0, 0), (1, 0), (0, 4), (2, 3)):
            image.header["qform_code"], image.header["sform_code"] = qform, sform
            image.header["srow_x"], image.header["srow_y"], image.header["srow_z"] = np.eye(4)[:3]
            image.header["quatern_d"] = 0
            path.write_bytes(image.header.binaryblock + bytes(4) + self.data.tobytes())
            data = bytearray(path.read_bytes())
            struct.pack_into("<f", data, 108, 352)
            data[344:348] = b"n+1\0"
            path.write_bytes(data)
            self.assertEqual(self.store(path)[1]["frame"], "RAS" if qform or sform else None)
        path = self.here / "m.mha"
        for line, frame in (("", "LPS"), ("AnatomicalOrientation = LPI\n", "LPS"), ("AnatomicalOrientation = ???\n", None)):
            write_mha(path, affine(False), self.data, line)
            self.assertEqual(self.store(path)[1]["frame"], frame)

    def test_what_takes_a_part_keeps_the_frame_and_what_drops_directions_drops_it(self):
        path = self.here / "t.nrrd"
        write_nrrd(path, affine(False), "space: LPS", self.data)
        for options in ((), ("--origin", "1,2,3"), ("--crop", "1:5,:,2:"), ("--every", "2,1,1"), ("--spacing", "1,1,2"),
                        ("--missing", "3"), ("--unit", "mm")):
            self.assertEqual(self.store(path, *options)[1]["frame"], "LPS", options)
        self.assertEqual(self.store(path, "--frame", "ras")[1]["frame"], "RAS")
        self.assertEqual(self.store(path, "--frame", "ras")[1]["origin"], self.store(path)[1]["origin"])
        write_nrrd(path, affine(True), "space: LPS", self.data)
        self.assertEqual(self.store(path)[1]["frame"], "LPS")
        _, info = self.store(path, "--spacing", "1,1,2")
        self.assertEqual((info["frame"], info["direction"]), (None, np.eye(3).tolist()))
        error = self.ask("preprocess", path, "-o", self.here / "x.isonest", "--frame", "lsa", code=2)["error"]
        self.assertIn("give ras or lps", error["message"])


class Exports(Frames):
    def values_at(self, matrix, data):
        """The values by position, rounded, so that reversed volumes can be compared."""
        k, j, i = np.mgrid[:data.shape[0], :data.shape[1], :data.shape[2]]
        places = np.stack([i, j, k, np.ones_like(i)], -1).reshape(-1, 4) @ matrix.T
        order = np.lexsort(np.round(places[:, :3], 3).T)
        return places[order, :3], data.reshape(-1)[order]

    def same(self, matrix, data, ras):
        places, values = self.values_at(matrix, data)
        expected_places, expected = self.values_at(ras, self.data)
        np.testing.assert_allclose(places, expected_places, atol=2e-4)
        np.testing.assert_array_equal(values, expected)

    def test_every_source_lies_in_nibabel_and_vtk_where_it_was(self):
        for turned in (False, True):
            ras = affine(turned)
            for name, path in self.inputs(ras).items():
                with self.subTest(name, turned=turned):
                    store, info = self.store(path)
                    out = self.here / "e.nii"
                    self.run_it("export", store, "--field", "values", "-o", out, "--force")
                    image = nibabel.load(out)
                    self.same(image.affine, np.asarray(image.dataobj).T, ras)
                    self.assertEqual([int(image.header[f"{c}form_code"]) for c in "qs"], [1, 1])
                    np.testing.assert_allclose(image.get_qform(), image.get_sform(), atol=3e-3)
                    reader = vtk.vtkNIFTIImageReader()
                    reader.SetFileName(str(out))
                    reader.Update()
                    of_vtk = np.array([[reader.GetSFormMatrix().GetElement(r, c) for c in range(4)] for r in range(4)])
                    of_vtk[:3, :3] *= reader.GetOutput().GetSpacing()  # VTK's matrix only has the directions
                    np.testing.assert_allclose(of_vtk, image.affine, atol=1e-4)
                    out = self.here / "e.nrrd"
                    self.run_it("export", store, "--field", "values", "-o", out, "--force")
                    space = {"RAS": "right-anterior-superior", "LPS": "left-posterior-superior"}[info["frame"]]
                    self.assertEqual(nrrd_fields(out)["space"], space)
                    data = np.frombuffer(out.read_bytes()[-self.data.nbytes:], "<f4").reshape(SHAPE)
                    turn = HALF_TURN if info["frame"] == "LPS" else np.eye(4)
                    self.same(turn @ nrrd_affine(out), data, ras)
                    out = self.here / "e.mha"
                    self.run_it("export", store, "--field", "values", "-o", out, "--force")
                    data = np.frombuffer(out.read_bytes()[-self.data.nbytes:], "<f4").reshape(SHAPE)
                    self.same(HALF_TURN @ mha_affine(out), data, ras)

    @unittest.skipIf(TEEM is None, "teem-apps is not installed")
    def test_teem_reads_the_space_that_was_written(self):
        write_nrrd(self.here / "t.nrrd", affine(True), "space: LPS", self.data)
        store, _ = self.store(self.here / "t.nrrd")
        self.run_it("export", store, "--field", "values", "-o", self.here / "e.nrrd")
        head = subprocess.run([TEEM, "head", self.here / "e.nrrd"], capture_output=True, text=True, check=True).stdout
        self.assertRegex(head, "(?m)^space: left-posterior-superior$")
        # teem reads all of it, and keeps the space.
        done = subprocess.run([TEEM, "crop", "-i", self.here / "e.nrrd", "-min", "0", "0", "0", "-max", "M", "M", "M", "-o",
                               self.here / "c.nrrd"], capture_output=True, text=True)
        self.assertEqual(done.returncode, 0, done.stderr)
        self.assertEqual(nrrd_fields(self.here / "c.nrrd")["space"], "left-posterior-superior")
        np.testing.assert_allclose(nrrd_affine(self.here / "c.nrrd"), affine(True), rtol=1e-12)

    def test_the_letters_of_meta_image_are_those_that_itk_derives(self):
        # ITK's letters say from which side each axis comes: with the identity in LPS they are RAI.
        for matrix, letters in (((1, 0, 0), (0, 1, 0), (0, 0, 1)), "RAI"), (((-1, 0, 0), (0, -1, 0), (0, 0, 1)), "LPI"), \
                (((0, 1, 0), (0, 0, 1), (1, 0, 0)), "AIR"), (((0, 0, -1), (1, 0, 0), (0, -1, 0)), "SRP"):
            lps = np.eye(4)
            lps[:3, :3] = np.array(matrix, float).T
            write_nrrd(self.here / "l.nrrd", lps, "space: LPS", self.data)
            store, info = self.store(self.here / "l.nrrd")
            self.run_it("export", store, "--field", "values", "-o", self.here / "l.mha", "--force")
            written = np.array(info["direction"])
            expected = "".join("RL"[int(v[0] < 0)] if abs(v[0]) > 0.5 else "AP"[int(v[1] < 0)] if abs(v[1]) > 0.5
                               else "IS"[int(v[2] < 0)] for v in written)
            self.assertEqual(mha_fields(self.here / "l.mha")["AnatomicalOrientation"], expected)
            if np.allclose(written, np.array(matrix)):  # otherwise axes were reversed
                self.assertEqual(expected, letters)

    def test_round_trips_leave_the_volume_where_it_was(self):
        for turned in (False, True):
            ras = affine(turned)
            path = self.inputs(ras)["nii.nii"]
            for ending in (".mha", ".nrrd", ".h5", ".nii", ".mha", ".nii"):
                store, info = self.store(path)
                frame = {".mha": "LPS", ".nii": "RAS"}.get(path.suffix, info["frame"])  # others have the store's frame
                self.assertEqual(info["frame"], frame)
                path = self.here / f"trip{'x' if path.stem == 'trip' else ''}{ending}"
                self.run_it("export", store, "--field", "values", "-o", path, "--force")
            image = nibabel.load(path)
            self.same(image.affine, np.asarray(image.dataobj).T, ras)

    def test_an_unknown_frame_is_exported_as_stored_and_claims_none(self):
        write_nrrd(self.here / "u.nrrd", affine(True), "space dimension: 3", self.data)
        store, info = self.store(self.here / "u.nrrd")
        self.assertIsNone(info["frame"])
        for ending in (".nii", ".nrrd", ".mha", ".h5"):
            self.run_it("export", store, "--field", "values", "-o", self.here / f"o{ending}")
        np.testing.assert_allclose(nibabel.load(self.here / "o.nii").affine, affine(True), atol=1e-5)
        self.assertEqual(int(nibabel.load(self.here / "o.nii").header["qform_code"]), 0)
        self.assertNotIn("space", nrrd_fields(self.here / "o.nrrd"))
        np.testing.assert_allclose(nrrd_affine(self.here / "o.nrrd"), affine(True), rtol=1e-12)
        np.testing.assert_allclose(mha_affine(self.here / "o.mha"), affine(True), rtol=1e-12)
        self.assertEqual(mha_fields(self.here / "o.mha")["AnatomicalOrientation"], "???")
        with h5py.File(self.here / "o.h5") as f:
            self.assertNotIn("frame", f["data"].attrs)
        for ending in (".nrrd", ".mha", ".h5"):  # it is still unknown when read again
            self.assertIsNone(self.store(self.here / f"o{ending}")[1]["frame"])

    def test_large_axes_and_smooth_have_the_frame_too(self):
        long = self.here / "long.nrrd"
        long.write_bytes((f"NRRD0004\ntype: uint8\ndimension: 3\nspace: LPS\nsizes: 40000 2 2\n"
                          "space directions: (1,0,0) (0,1,0) (0,0,1)\nspace origin: (5,6,7)\nencoding: raw\n\n").encode() + bytes(160000))
        store, _ = self.store(long)
        self.run_it("export", store, "--field", "values", "-o", self.here / "long.nii")
        image = nibabel.load(self.here / "long.nii")
        self.assertIsInstance(image, nibabel.Nifti2Image)
        np.testing.assert_array_equal(image.affine, HALF_TURN @ [[1, 0, 0, 5], [0, 1, 0, 6], [0, 0, 1, 7], [0, 0, 0, 1]])
        np.testing.assert_allclose(image.get_qform(), image.affine, atol=1e-12)
        write_nrrd(self.here / "s.nrrd", affine(False), "space: LPS", self.data)
        self.run_it("smooth", self.here / "s.nrrd", "--tau", "0.1", "--lambda", "1", "--steps", "1", "-o", self.here / "smooth.nrrd")
        self.assertEqual(nrrd_fields(self.here / "smooth.nrrd")["space"], "left-posterior-superior")


READERS = {".ply": vtk.vtkPLYReader, ".stl": vtk.vtkSTLReader, ".obj": vtk.vtkOBJReader, ".vtp": vtk.vtkXMLPolyDataReader}


def read_mesh(path):
    """Positions, triangles, normals or None, and the space of the file as 3D Slicer determines it."""
    reader = READERS[path.suffix]()
    reader.SetFileName(str(path))
    if path.suffix == ".stl":
        reader.MergingOff()
    reader.Update()
    mesh = reader.GetOutput()
    if path.suffix == ".ply":
        texts = [reader.GetComments().GetValue(i) for i in range(reader.GetComments().GetNumberOfValues())]
    elif path.suffix == ".stl":
        texts = [path.read_bytes()[:80].rstrip(b"\0").decode()]
    elif path.suffix == ".obj":
        texts = [line for line in path.read_text().splitlines() if line.startswith("#")]
    else:
        field = mesh.GetFieldData().GetAbstractArray("SPACE")
        texts = ["SPACE=" + field.GetValue(0)] if field else []
    space = [re.search("SPACE=(RAS|LPS)", text).group(1) for text in texts if "SPACE=" in text]
    normals = mesh.GetPointData().GetNormals()
    return (vtk_to_numpy(mesh.GetPoints().GetData()).astype(float),
            vtk_to_numpy(mesh.GetPolys().GetConnectivityArray()).reshape(-1, 3),
            None if normals is None else vtk_to_numpy(normals), space[0] if space else None)


def facets(points, triangles):
    """The centres of all triangles, in an order that does not depend on the mesh; and the enclosed volume."""
    corners = points[triangles]
    volume = np.einsum("ij,ij->i", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])).sum() / 6
    middles = corners.mean(axis=1)
    return middles[np.lexsort(np.round(middles, 3).T)], volume


class Meshes(Frames):
    def test_meshes_of_one_scan_overlay_whatever_its_format_and_theirs(self):
        """In 3D Slicer, which reads the header, and in niivue, which assumes RAS."""
        for turned in (False, True):
            ras = affine(turned)
            # The surface by another program, in the scan's own indices and then in RAS.
            image = vtk.vtkImageData()
            image.SetDimensions(*SHAPE[::-1])
            array = vtk.util.numpy_support.numpy_to_vtk(self.data.reshape(-1))
            image.GetPointData().SetScalars(array)
            contour = vtk.vtkFlyingEdges3D()
            contour.SetInputData(image)
            contour.SetValue(0, 2.4)
            contour.Update()
            points = vtk_to_numpy(contour.GetOutput().GetPoints().GetData()).astype(float)
            expected = (np.c_[points, np.ones(len(points))] @ ras.T)[:, :3]
            expected = expected[np.lexsort(np.round(expected, 2).T)]
            volume = None
            for name, path in self.inputs(ras).items():
                store, info = self.store(path)
                for source in (store, path):
                    for ending in READERS:
                        with self.subTest(name, turned=turned, source=source.suffix, ending=ending):
                            out = self.here / f"m{ending}"
                            report = self.ask("extract", source, "--iso", "2.4", "--cells", "hex", "--normals", "-o", out)
                            self.assertEqual((report["frame"], report["space"]), (info["frame"], "RAS"))
                            points, triangles, normals, space = read_mesh(out)
                            self.assertEqual(space, "RAS")
                            if ending == ".stl":
                                points = np.unique(points, axis=0)
                            got = points[np.lexsort(np.round(points, 2).T)]
                            self.assertEqual(len(got), len(expected))
                            distances = np.linalg.norm(got[:, None] - expected[None], axis=2).min(axis=1)
                            self.assertLess(distances.max(), 2e-4)
                            points, triangles, normals, _ = read_mesh(out)
                            _, inside = facets(points, triangles)
                            # The surface faces the smaller values, which are inside: the triangles' orientation is
                            # right.
                            self.assertLess(inside, 0)
                            volume = volume or inside
                            self.assertAlmostEqual(inside / volume, 1, delta=1e-3)  # quads have either diagonal
                            if normals is not None:
                                corners = points[triangles]
                                faces = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
                                of_corner = normals[triangles[:, 0]]
                                self.assertGreater(np.mean(np.einsum("ij,ij->i", faces, of_corner) > 0), 0.99)

    def test_each_space_has_the_positions_of_the_other_with_x_and_y_negated(self):
        path = self.here / "l.nrrd"
        write_nrrd(path, affine(True), "space: LPS", self.data)
        store, _ = self.store(path)
        for ending in READERS:
            meshes = {}
            for space in (None, "as-stored", "lps", "ras"):
                out = self.here / f"m{ending}"
                report = self.ask("extract", store, "--iso", "2.4", "--normals", "-o", out, *(["--space", space] if space else []))
                points, triangles, normals, said = read_mesh(out)
                self.assertEqual(report["space"], said)
                meshes[space] = points, triangles, normals, said, out.read_bytes()
            self.assertEqual([meshes[s][3] for s in meshes], ["RAS", "LPS", "LPS", "RAS"])
            self.assertEqual(meshes[None][4], meshes["ras"][4])
            self.assertEqual(meshes["as-stored"][4], meshes["lps"][4])
            np.testing.assert_array_equal(meshes["ras"][0], meshes["lps"][0] * [-1, -1, 1])
            np.testing.assert_array_equal(meshes["ras"][1], meshes["lps"][1])
            if meshes["ras"][2] is not None:
                np.testing.assert_array_equal(meshes["ras"][2], meshes["lps"][2] * np.float32([-1, -1, 1]))

    def test_the_other_formats_say_their_space(self):
        path = self.here / "l.nrrd"
        write_nrrd(path, affine(False), "space: LPS", self.data)
        store, _ = self.store(path)
        extract = ["extract", store, "--iso", "2.4", "-o"]
        positions = {}
        for space in ("lps", "ras"):
            self.run_it(*extract, self.here / "m.glb", "--space", space)
            data = (self.here / "m.glb").read_bytes()
            size = struct.unpack_from("<I", data, 12)[0]
            head = json.loads(data[20:20 + size])
            self.assertEqual(head["nodes"][0]["extras"], {"SPACE": space.upper()})
            of = head["accessors"][0]
            points = np.frombuffer(data, "<f4", 3 * of["count"], 28 + size).reshape(-1, 3)
            np.testing.assert_allclose([of["min"], of["max"]], [points.min(0), points.max(0)], rtol=1e-6)
            self.run_it(*extract, self.here / "m.vtkhdf", "--space", space)
            with h5py.File(self.here / "m.vtkhdf") as f:
                self.assertEqual(np.bytes_(f["VTKHDF"].attrs["SPACE"]), space.upper().encode())
                np.testing.assert_array_equal(f["VTKHDF/Points"][...], points)
            self.run_it(*extract, self.here / "m.3mf", "--space", space)
            model = zipfile.ZipFile(self.here / "m.3mf").read("3D/3dmodel.model").decode()
            self.assertIn(f'<metadata name="Description">SPACE={space.upper()}</metadata>', model)
            of_3mf = np.array(re.findall(r'<vertex x="([^"]*)" y="([^"]*)" z="([^"]*)"', model), np.float32)
            np.testing.assert_array_equal(of_3mf, points)
            positions[space] = points
        np.testing.assert_array_equal(positions["ras"], positions["lps"] * np.float32([-1, -1, 1]))
        # Neuroglancer shows the volume next to it in its own coordinates.
        self.assertEqual(self.ask(*extract, self.here / "m.ngmesh")["space"], "LPS")
        data = (self.here / "m.ngmesh").read_bytes()
        np.testing.assert_array_equal(np.frombuffer(data, "<f4", 3 * len(positions["lps"]), 4).reshape(-1, 3), positions["lps"])

    def test_labels_interfaces_slices_lines_and_several_isovalues_are_turned_too(self):
        labels = (self.data > 2.4).astype("f4") + (self.data > 3.6)
        write_nrrd(self.here / "l.nrrd", affine(True), "space: LPS", labels)
        write_nrrd(self.here / "v.nrrd", affine(True), "space: LPS", self.data)
        of_labels, _ = self.store(self.here / "l.nrrd")
        store, _ = self.store(self.here / "v.nrrd")
        middle = affine(True) @ (5, 4, 3, 1)
        plane = f"0.3,0.2,1,{0.3 * middle[0] + 0.2 * middle[1] + middle[2]}"
        commands = {
            "plain label": ("extract", of_labels, "--label", "1"), "smooth label": ("extract", of_labels, "--label", "1", "--smooth"),
            "simplified label": ("extract", of_labels, "--label", "1", "--smooth", "--distance", "0.5"),
            "interfaces": ("extract", of_labels, "--labels", "all", "--smooth", "--interfaces"),
            "one for all": ("extract", store, "--iso", "2.1,2.4"), "simplified": ("extract", store, "--iso", "2.4", "--distance", "0.3"),
            "by error": ("extract", store, "--iso", "2.4", "--error", "0.2"), "closed": ("extract", store, "--iso", "2.4", "--close"),
            "slice": ("slice", store, "--plane", plane), "lines": ("slice", store, "--plane", plane, "--contours", "2,3"),
            "file": ("extract", self.here / "v.nrrd", "--iso", "2.4", "--distance", "0.3")}
        for name, command in commands.items():
            with self.subTest(name):
                points = {}
                for space in ("lps", "ras", "as-stored"):
                    report = self.ask(*command, "-o", self.here / "m.vtp", "--space", space)
                    reader = vtk.vtkXMLPolyDataReader()
                    reader.SetFileName(str(self.here / "m.vtp"))
                    reader.Update()
                    mesh = reader.GetOutput()
                    said = mesh.GetFieldData().GetAbstractArray("SPACE").GetValue(0)
                    for one in report.get("meshes", [report]):
                        self.assertEqual(one["space"], said)
                    self.assertEqual(said, "RAS" if space == "ras" else "LPS")
                    points[space] = vtk_to_numpy(mesh.GetPoints().GetData()).copy()
                    self.assertGreater(len(points[space]), 20)
                np.testing.assert_array_equal(points["ras"], points["lps"] * np.float32([-1, -1, 1]))
                np.testing.assert_array_equal(points["as-stored"], points["lps"])
        folder = self.here / "meshes"
        report = self.ask("extract", of_labels, "--labels", "all", "--smooth", "-o", folder)
        self.assertEqual((report["frame"], report["space"]), ("LPS", "RAS"))
        self.assertEqual({read_mesh(folder / one["mesh"])[3] for one in report["labels"]}, {"RAS"})

    def test_where_the_frame_is_unknown_nothing_is_turned_and_asking_for_one_is_refused(self):
        write_nrrd(self.here / "u.nrrd", affine(False), "space dimension: 3", self.data)
        store, _ = self.store(self.here / "u.nrrd")
        for source in (store, self.here / "u.nrrd"):
            for ending in READERS:
                out = self.here / f"m{ending}"
                report = self.ask("extract", source, "--iso", "2.4", "-o", out)
                self.assertEqual((report["frame"], report["space"]), (None, None))
                self.assertNotIn(b"SPACE", out.read_bytes())
                before = out.read_bytes()
                self.ask("extract", source, "--iso", "2.4", "-o", out, "--space", "as-stored")
                self.assertEqual(out.read_bytes(), before)
            error = self.ask("extract", source, "--iso", "2.4", "-o", self.here / "no.ply", "--space", "ras", code=2)["error"]
            self.assertIn("the patient axes of the volume are unknown", error["message"])
            self.assertFalse((self.here / "no.ply").exists())
        error = self.ask("extract", store, "--iso", "2.4", "-o", self.here / "no.ply", "--space", "rsa", code=2)["error"]
        self.assertIn("give ras, lps or as-stored", error["message"])
        self.ask("slice", store, "--plane", "0,0,1,42", "-o", self.here / "no.png", "--space", "ras", code=2)
        # The axes of a volume file can be given as an option.
        out = self.here / "m.ply"
        self.ask("extract", self.here / "u.nrrd", "--iso", "2.4", "-o", out, "--frame", "lps")
        self.assertEqual(read_mesh(out)[3], "RAS")

    def test_boxes_and_planes_are_in_the_stored_coordinates(self):
        write_nrrd(self.here / "b.nrrd", affine(False), "space: LPS", self.data)
        store, info = self.store(self.here / "b.nrrd")
        low = np.array(info["origin"])
        high = low + np.array(info["spacing"]) * (np.array(info["nodes"]) - 1)
        middle = (low + high) / 2
        box = ",".join(f"{c}" for c in (*low, middle[0], *high[1:]))
        self.run_it("extract", store, "--iso", "2.4", "--box", box, "-o", self.here / "m.ply")
        points = read_mesh(self.here / "m.ply")[0]
        self.assertGreaterEqual(points[:, 0].min(), -middle[0] - 1e-4)
        self.assertLessEqual(points[:, 0].max(), -low[0] + 1e-4)


if __name__ == "__main__":
    unittest.main(argv=[sys.argv[0], *sys.argv[3:]])
