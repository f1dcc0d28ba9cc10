#!/usr/bin/env python3
"""NIfTI, MetaImage, MRC and MGH files as written by nibabel, VTK and mrcfile.

usage: header_formats_test.py ISONEST PLUGIN_FOLDER
"""
import gzip
import itertools
import json
import pathlib
import sys
import unittest
import warnings
import zlib

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1] / "support"))
import served  # noqa: E402

try:
    import mrcfile
    import nibabel
    import numpy as np
    import vtk
    from vtk.util import numpy_support
    from volume_inputs import ISONEST, TYPES, DamagedFiles, Input, is_read_as, numbers
except ImportError as error:
    print(f"skipped: {error}")
    sys.exit(77)

warnings.filterwarnings("ignore")


class Nifti(DamagedFiles, Input):
    def setUp(self):
        super().setUp()
        self.path = self.here / "v.nii"

    def save(self, data, affine, name="v.nii", kind=nibabel.Nifti1Image, **header):
        image = kind(data, affine)
        for key, value in header.items():
            getattr(image.header, key)(*value)
        self.path = self.here / name
        nibabel.save(image, self.path)
        return image

    def test_all_types_orders_and_versions(self):
        for kind, big, version in itertools.product((*TYPES, "i8", "u8"), (False, True), (1, 2)):
            with self.subTest(kind=kind, big=big, version=version):
                data = numbers((7, 6, 5), kind)
                maker = nibabel.Nifti1Image if version == 1 else nibabel.Nifti2Image
                header = maker.header_class(endianness=">" if big else "<")
                header.set_data_dtype(np.dtype(kind).newbyteorder(">" if big else "<"))
                image = maker(data, np.diag([1, 2, 3, 1]), header)
                nibabel.save(image, self.path)
                self.reads(is_read_as(data.T))
                self.lies([0, 0, 0], [1, 2, 3])

    def test_packed_and_split_files(self):
        data = numbers((7, 6, 5))
        for name, kind in (("v.nii.gz", nibabel.Nifti1Image), ("v.img", nibabel.Nifti1Pair),
                           ("v.img.gz", nibabel.Nifti1Pair)):
            self.save(data, np.eye(4), name, kind)
            self.reads(data.T)
            if "img" in name:
                image = self.path
                self.path = image.with_name(image.name.replace("img", "hdr"))
                self.reads(data.T)
                before = image.read_bytes()
                done = self.preprocess(store=image)
                self.assertEqual(done.returncode, 2)
                self.assertEqual(image.read_bytes(), before)
                image.unlink()
                self.path.unlink()

    def test_the_place_by_sform_qform_or_size(self):
        data = numbers((7, 6, 5))
        affine = np.array([[-2., 0, 0, 10], [0, 0.5, 0, 20], [0, 0, -3, 30], [0, 0, 0, 1]])
        for forms in ((1, 0), (0, 1), (1, 1)):
            image = nibabel.Nifti1Image(data, affine)
            image.set_sform(affine if forms[0] else None, forms[0])
            image.set_qform(affine if forms[1] else None, forms[1])
            nibabel.save(image, self.path)
            np.testing.assert_allclose(nibabel.load(self.path).affine, affine, atol=1e-5)
            self.reads(data[::-1, :, ::-1].T)
            self.lies([10 - 2 * 6, 20, 30 - 3 * 4], [2, 0.5, 3])
        image.set_sform(None, 0)
        image.set_qform(None, 0)
        nibabel.save(image, self.path)
        self.reads(data.T)
        self.lies([0, 0, 0], [2, 0.5, 3])

    def test_a_packed_image_whose_z_runs_backward_keeps_its_place(self):
        """A stream is read from its start: z keeps its direction, and x is reversed so that the axes are
        right-handed."""
        data = numbers((7, 6, 5))
        for x, y, name in itertools.product((2, -2), (0.5, -0.5), ("v.nii.gz", "v.img.gz")):
            with self.subTest(x=x, y=y, name=name):
                self.save(data, np.array([[x, 0, 0, 10], [0, y, 0, 20], [0, 0, -3, 30], [0, 0, 0, 1.]]), name,
                          nibabel.Nifti1Pair if "img" in name else nibabel.Nifti1Image)
                self.reads(np.ascontiguousarray((data[::-1] if x > 0 else data)[:, ::-1 if y < 0 else 1].T))
                self.lies([10 + max(x, 0) * 6, 20 + min(y, 0) * 5, 30], [2, 0.5, 3])
                self.assertEqual(self.directions(), [[-1, 0, 0], [0, 1, 0], [0, 0, -1]])

    def test_slope_and_intercept(self):
        for kind, slope, intercept, made in (("u2", 2, -1024, "i4"), ("i2", 0.5, 3, "f4"), ("i4", 0.1, 0, "f8"),
                                             ("u1", 1, 100, "u2"), ("f4", 3, 1, "f4"), ("u1", 1, 0, "u1"),
                                             ("u1", 0, 7, "u1"), ("u1", np.nan, 7, "u1")):
            with self.subTest(kind=kind, slope=slope):
                data = numbers((7, 6, 5), kind)
                image = nibabel.Nifti1Image(data, np.eye(4))
                nibabel.save(image, self.path)
                raw = bytearray(self.path.read_bytes())
                raw[112:120] = np.array([slope, intercept], "<f4").tobytes()
                self.path.write_bytes(raw)
                expected = np.asarray(nibabel.load(self.path).dataobj, "f8").T
                if made == "f4":
                    expected = (np.float64(np.float32(slope)) * data.T.astype("f8") + np.float64(np.float32(intercept)))
                self.reads(expected.astype(made))

    def test_time_steps_are_chosen(self):
        data = numbers((7, 6, 5, 3))
        for name in ("v.nii", "v.nii.gz"):
            self.save(data, np.diag([1, 2, 3, 1]), name)
            self.refuses(5, "axis 't'", "t 3, z 5, y 6, x 7", "--index")
            for t in range(3):
                self.reads(data[..., t].T, "--index", f"t={t}")
                self.reads(data[..., t].T, "--index", f"{t - 3},:,:,:")
            self.refuses(2, "no position 3", options=("--index", "t=3"))
            self.refuses(2, "no axis 'place'", "--index t=0", options=("--index", "place=3"))
            self.refuses(2, "3 entries for 4 axes", options=("--index", "0,:,:"))
        self.reads(data[:, 2, :, 1].T, "--index", "t=1,y=2")
        self.lies([0, 4, 0], [1, 3, 1])
        self.reads(data[:, :, 2, 1].T, "--index", "t=1,z=2")
        self.lies([0, 0, 6], [1, 2, 1])

    def test_oblique_axes_are_kept_or_ignored(self):
        data = numbers((7, 6, 5))
        c, s = np.cos(0.3), np.sin(0.3)
        self.save(data, np.array([[c, -s, 0, 1], [s, c, 0, 2], [0, 0, 1, 3], [0, 0, 0, 1.0]]))
        self.reads(data.T)
        self.lies([1, 2, 3], [1, 1, 1])
        self.reads(data.T, "--spacing", "1,1,1")
        self.lies([1, 2, 3], [1, 1, 1])

    def test_a_sheared_volume_lies_as_the_file_says(self):
        data = numbers((7, 6, 5))
        affine = np.array([[1, 0.5, 0, 1], [0, 1, 0, 2], [0, 0, 1, 3], [0, 0, 0, 1.0]])
        self.save(data, affine)
        self.reads(data.T)
        self.lies([1, 2, 3], [1, np.hypot(0.5, 1), 1])
        np.testing.assert_allclose(np.array(self.directions()).T * self.info()["spacing"], affine[:3, :3], atol=1e-12)

    def test_what_a_spacing_of_ones_own_loses_is_noted(self):
        """For every affine: the values keep their order in the file, and a note says what part of their position is
        lost."""
        data = numbers((7, 6, 5))
        c, s = np.cos(np.radians(18.5)), np.sin(np.radians(18.5))
        turned = np.array([[1, 0, 0], [0, c, -s], [0, s, c]])
        for affine, words in ((np.eye(3), ()), (np.diag([2, 3, 4]), ()), (turned, ("a rotation by 18.5 degrees",)),
                              (turned @ np.diag([2, 3, 4]), ("a rotation by 18.5 degrees",)),
                              (np.diag([-1, -1, 1]), ("x, y", "reversed")), (np.diag([1, 1, -2]), ("z", "reversed")),
                              (np.array([[1, 0.5, 0], [0, 1, 0], [0, 0, 1]]), ("a shear (x and y meet at 63.43 degrees)",)),
                              (turned @ np.diag([-1, 1, 1]), ("mirrored", "a rotation by"))):
            with self.subTest(affine=affine.tolist()):
                whole = np.eye(4)
                whole[:3, :3], whole[:3, 3] = affine, (4, 5, 6)
                self.save(data, whole)
                done = self.reads(data.T, "--spacing", "3,4,5")
                self.lies((4, 5, 6), (3, 4, 5))
                notes = [line for line in done.stdout.splitlines() if "are lost" in line]
                self.assertEqual(len(notes), 1 if words else 0, done.stdout)
                for word in words:
                    self.assertIn(word, notes[0])

    def test_damaged_files(self):
        self.save(numbers((7, 6, 5)), np.diag([1, 2, 3, 1]))
        self.damaged(self.path.read_bytes())
        self.save(numbers((7, 6, 5)), np.diag([1, 2, 3, 1]), kind=nibabel.Nifti2Image)
        self.damaged(self.path.read_bytes())


class MetaImage(DamagedFiles, Input):
    def save(self, data, name, compress, spacing=(1, 2, 3), origin=(-1, 5, 7), channels=1):
        image = vtk.vtkImageData()
        image.SetDimensions(data.shape[2], data.shape[1], data.shape[0])
        image.SetSpacing(spacing)
        image.SetOrigin(origin)
        image.GetPointData().SetScalars(
            numpy_support.numpy_to_vtk(data.reshape(-1, channels) if channels > 1 else data.ravel()))
        self.path = self.here / name
        writer = vtk.vtkMetaImageWriter()
        writer.SetInputData(image)
        writer.SetFileName(str(self.path))
        writer.SetCompression(compress)
        writer.Write()

    def test_what_vtk_writes(self):
        for kind, name, compress in itertools.product(TYPES, ("v.mha", "v.mhd"), (True, False)):
            with self.subTest(kind=kind, name=name, compress=compress):
                data = numbers((5, 6, 7), kind)
                self.save(data, name, compress)
                self.reads(data)
                self.lies([-1, 5, 7], [1, 2, 3])

    def text(self, *lines, data=None, file="LOCAL", kind="MET_SHORT"):
        """A header as the format's documentation describes it."""
        self.path = self.here / "v.mha"
        header = ["ObjectType = Image", "NDims = 3", "DimSize = 7 6 5", f"ElementType = {kind}", *lines,
                  f"ElementDataFile = {file}"]
        self.path.write_bytes(("\n".join(header) + "\n").encode() + (b"" if data is None else data.tobytes()))

    def test_directions_orders_and_skipped_bytes(self):
        data = numbers((5, 6, 7))
        self.text("TransformMatrix = -1 0 0 0 1 0 0 0 -1", "Offset = 10 20 30", "ElementSpacing = 2 0.5 3", data=data)
        self.reads(data[::-1, :, ::-1])
        self.lies([10 - 2 * 6, 20, 30 - 3 * 4], [2, 0.5, 3])
        self.text("ElementByteOrderMSB = True", data=data.astype(">i2"))
        self.reads(data)
        self.text("TransformMatrix = 0 1 0 0 0 1 1 0 0", data=data)
        self.reads(data)
        (self.here / "other.raw").write_bytes(b"header" + data.tobytes())
        self.text("HeaderSize = -1", file="other.raw")
        self.reads(data)
        self.text("HeaderSize = 6", file="other.raw")
        self.reads(data)

    def test_intensities_are_not_computed_and_that_is_said(self):
        data = numbers((5, 6, 7))
        for lines, said in ((("ElementToIntensityFunctionSlope = 2", "ElementToIntensityFunctionOffset = 100"), True),
                            (("ElementToIntensityFunctionSlope = 1.0", "ElementToIntensityFunctionOffset = 0"), False)):
            self.text(*lines, data=data)
            done = self.reads(data)
            self.assertEqual("ElementToIntensityFunction" in done.stdout + done.stderr, said)

    def test_channels_are_chosen(self):
        data = numbers((5, 6, 7, 2))
        for compress in (False, True):
            self.save(data, "v.mha", compress, channels=2)
            self.refuses(5, "axis 'c'", "z 5, y 6, x 7, c 2")
            for c in range(2):
                self.reads(np.ascontiguousarray(data[..., c]), "--index", f"c={c}")

    def test_what_cannot_be_read_is_refused(self):
        data = numbers((5, 6, 7))
        for code, lines, words in ((4, ("NDims = 2",), "DimSize"), (5, ("BinaryData = False",), "text"),
                                   (4, ("ElementSpacing = 1 x 2",), "not a number"), (4, ("DimSize = 7 0 5",), "DimSize"),
                                   (2, ("DimSize = 7 6 500",), "bytes"), (5, ("ElementType = MET_LONG",), "MET_LONG"),
                                   (4, ("ElementSpacing = 1 0 2",), "step"), (4, ("nonsense",), "nonsense")):
            with self.subTest(lines=lines):
                self.text(*lines, data=data)
                self.refuses(code, words)
        for code, file in ((4, "LIST"), (3, "v%03d.raw 1 5 1"), (3, "missing.raw"), (3, "50%.raw"), (4, "v%03d.raw 1 4 1"),
                           (4, "v%03d.raw 1 5 0"), (4, "v%03d.raw 1 4000000000 1"), (4, "v%03d.raw 5 1 1"), (4, "LIST 4\na.raw"),
                           (4, "LIST 0\na.raw"), (4, "LIST\na.raw\nb.raw")):
            with self.subTest(file=file):
                self.text(file=file)
                self.refuses(code)

    def test_lists_and_patterns_of_files(self):
        data = numbers((5, 6, 7))
        names = [f"s{i}.raw" for i in (3, 9, 10, 11, 12)]
        for skip, front in (("HeaderSize = 0", b""), ("HeaderSize = 6", b"header"), ("HeaderSize = -1", b"heading")):
            for packed in (False, True):
                if packed and "-1" in skip:
                    continue
                with self.subTest(skip=skip, packed=packed):
                    for i, name in enumerate((*names, *(f"p{j:03d}.raw" for j in range(4, 24, 4)))):
                        part = data[i % 5].tobytes()
                        (self.here / name).write_bytes(front + (zlib.compress(part) if packed else part))
                    lines = (skip, *(["CompressedData = True"] if packed else []))
                    for file in ("LIST\n" + "\n".join(names), "LIST 2D\n" + "\n".join(names) + "\n\n", "p%03d.raw 4 20 4",
                                 "p%03d.raw 4 21 4"):
                        self.text(*lines, file=file)
                        self.reads(data)
        whole = self.path.read_text()
        (self.here / "p012.raw").write_bytes(b"short")
        self.refuses(2, "p012.raw")
        (self.here / "p012.raw").unlink()
        self.refuses(3, "p012.raw")
        self.path.write_text(whole.replace("p%03d.raw 4 21 4", "LIST 3\nall.raw"))
        (self.here / "all.raw").write_bytes(b"heading" + data.tobytes())
        self.reads(data)
        before = (self.here / "all.raw").read_bytes()
        self.assertEqual(self.preprocess(store=self.here / "all.raw").returncode, 2)
        self.assertEqual((self.here / "all.raw").read_bytes(), before)

    def test_vtk_reads_the_same_list(self):
        data = numbers((5, 6, 7))
        for i, plane in enumerate(data):
            (self.here / f"s{i}.raw").write_bytes(plane.tobytes())
        self.text("BinaryData = True", "BinaryDataByteOrderMSB = False", file="LIST\n" + "\n".join(f"s{i}.raw" for i in range(5)))
        self.path = self.path.rename(self.here / "v.mhd")
        self.reads(data)
        # VTK's image reader takes file names by such patterns.
        reader = vtk.vtkImageReader2()
        reader.SetFileDimensionality(2)
        reader.SetFilePattern("%s/s%d.raw")
        reader.SetFilePrefix(str(self.here))
        reader.SetDataExtent(0, 6, 0, 5, 0, 4)
        reader.SetDataScalarTypeToShort()
        reader.SetDataByteOrderToLittleEndian()
        reader.FileLowerLeftOn()
        reader.Update()
        scalars = numpy_support.vtk_to_numpy(reader.GetOutput().GetPointData().GetScalars())
        self.text(file="s%d.raw 0 4 1")
        self.reads(np.ascontiguousarray(scalars.reshape(data.shape)))

    def test_damaged_files(self):
        self.save(numbers((5, 6, 7)), "v.mha", False)
        self.damaged(self.path.read_bytes())
        self.save(numbers((5, 6, 7)), "v.mha", True)
        self.damaged(self.path.read_bytes())

    def test_what_a_message_quotes_does_not_reach_the_terminal_as_it_is(self):
        self.save(numbers((5, 6, 7)), "v.mha", False)
        whole = self.path.read_bytes()
        for hostile, shown in ((b"\x1b[2J", r"\x1b"), (b"\x07", r"\x07"), (b"\x7f", r"\x7f"), (b"\xc2\x9b2J", r"\x9b")):
            self.path.write_bytes(whole.replace(b"MET_SHORT", b"MET_" + hostile))
            done = self.preprocess()
            self.assertEqual(done.returncode, 5, done.stderr)
            self.assertIn(shown, done.stderr)
            self.assertNotRegex(done.stderr, "[\0-\x08\x0b-\x1f\x7f-\x9f]")


class Mrc(DamagedFiles, Input):
    def setUp(self):
        super().setUp()
        self.path = self.here / "v.mrc"

    def save(self, data, **header):
        with mrcfile.new(self.path, overwrite=True) as file:
            file.set_data(data)
            for key, value in header.items():
                setattr(file.header if key != "voxel_size" else file, key, value)

    def test_modes_and_voxel_sizes(self):
        for kind in ("i1", "i2", "f4", "u2", "f2"):
            with self.subTest(kind=kind):
                data = numbers((5, 6, 7), kind)
                self.save(data, voxel_size=(1, 2, 3))
                self.reads(is_read_as(data))
                self.lies([0, 0, 0], [1, 2, 3])
        self.save(data, voxel_size=(1, 2, 3), origin=(4, 5, 6))
        self.reads(is_read_as(data))
        self.lies([4, 5, 6], [1, 2, 3])
        self.save(data, voxel_size=(1, 2, 3), nxstart=-1, nystart=2, nzstart=3)
        self.reads(is_read_as(data))
        self.lies([-1, 4, 9], [1, 2, 3])

    def test_big_endian_packed_and_extended(self):
        data = numbers((5, 6, 7), "f4")
        with mrcfile.new(self.path, overwrite=True) as file:
            file.set_data(data)
            file.set_extended_header(np.frombuffer(bytes(range(160)), "V160"))
        self.reads(data)
        whole = self.path.read_bytes()
        self.path = self.here / "v.mrc.gz"
        self.path.write_bytes(gzip.compress(whole))
        self.reads(data)
        self.path = self.here / "v.mrc"
        with mrcfile.new(self.path, overwrite=True) as file:
            file.set_data(data)
        raw = bytearray(self.path.read_bytes())
        words = np.frombuffer(bytes(raw[:1024]), "<i4").astype(">i4").tobytes()
        raw[:1024] = words
        raw[208:216] = b"MAP \x11\x11\0\0"
        raw[1024:] = data.astype(">f4").tobytes()
        self.path.write_bytes(raw)
        np.testing.assert_array_equal(mrcfile.open(self.path).data, data)
        self.reads(data)

    def test_columns_along_other_axes(self):
        data = numbers((5, 6, 7), "f4")
        for order in itertools.permutations((1, 2, 3)):
            with self.subTest(order=order):
                self.save(data, mapc=order[0], mapr=order[1], maps=order[2])
                # Axis i of the file, fastest first, runs along order[i].
                expected = np.transpose(data, [2 - order.index(w) for w in (3, 2, 1)])
                self.reads(np.ascontiguousarray(expected))

    def test_packed_columns_along_other_axes(self):
        """In a stream they are in another order: it is decompressed to temporary space."""
        data = numbers((5, 6, 7), "f4")
        for order, big in itertools.product(itertools.permutations((1, 2, 3)), (False, True)):
            with self.subTest(order=order, big=big):
                self.path = self.here / "v.map"
                self.save(data.astype(">f4") if big else data, mapc=order[0], mapr=order[1], maps=order[2])
                expected = mrcfile.open(self.path).data
                expected = np.transpose(expected, [2 - order.index(w) for w in (3, 2, 1)]).astype("f4")
                whole = self.path.read_bytes()
                self.path = self.here / "v.map.gz"
                self.path.write_bytes(gzip.compress(whole))
                self.reads(np.ascontiguousarray(expected))
                before = self.path.read_bytes()
                self.assertEqual(self.preprocess(store=self.path).returncode, 2)
                self.assertEqual(self.path.read_bytes(), before)
                if order != (1, 2, 3):
                    self.path.write_bytes(before[:-5])  # without its checksum
                    self.refuses(4, "cut short")
                    self.path.write_bytes(gzip.compress(whole[:-9]))
                    self.refuses(2, "decompressed data end")

    def test_a_stack_of_volumes(self):
        data = numbers((3, 5, 6, 7), "i2")
        with mrcfile.new(self.path, overwrite=True) as file:
            file.set_data(data)
            file.set_volume_stack() if not file.is_volume_stack() else None
        self.refuses(5, "axis 'volume'")
        self.reads(data[2], "--index", "volume=2")

    def test_cells_that_are_not_at_right_angles(self):
        """By the angles alone: edges of these lengths, a along x, b in the plane of x and y."""
        data = numbers((5, 6, 7), "f4")
        for angles in ((90, 90, 120), (90, 104.5, 90), (80, 75, 110), (60, 60, 60)):
            with self.subTest(angles=angles):
                self.save(data, voxel_size=(1.5, 2, 2.5))
                with mrcfile.open(self.path, "r+") as file:
                    for name, angle in zip(("alpha", "beta", "gamma"), angles):
                        file.header.cellb[name] = angle
                    file.header.nxstart, file.header.nystart, file.header.nzstart = 3, -4, 5
                    file.header.origin = (0, 0, 0)
                self.reads(data)
                steps = np.array(self.directions()) * np.array(self.info()["spacing"])[:, None]
                np.testing.assert_allclose(np.linalg.norm(steps, axis=1), [1.5, 2, 2.5], rtol=1e-6)
                for angle, a, b in zip(angles, (1, 0, 0), (2, 2, 1)):
                    cosine = steps[a] @ steps[b] / np.linalg.norm(steps[a]) / np.linalg.norm(steps[b])
                    self.assertAlmostEqual(np.degrees(np.arccos(cosine)), angle, 4)
                np.testing.assert_allclose(steps[0, 1:], 0, atol=1e-9)
                np.testing.assert_allclose(steps[1, 2], 0, atol=1e-9)
                self.assertGreater(np.linalg.det(steps), 0)
                np.testing.assert_allclose(self.info()["origin"], np.array([3, -4, 5]) @ steps, atol=1e-5)
                with mrcfile.open(self.path, "r+") as file:
                    file.header.origin = (1, 2, 3)
                self.reads(data)
                np.testing.assert_allclose(self.info()["origin"], [1, 2, 3])
                done = self.reads(data, "--spacing", "1,1,1")
                self.assertIn("a shear (", done.stdout + done.stderr)
        with mrcfile.open(self.path, "r+") as file:
            file.header.cellb.alpha, file.header.cellb.beta, file.header.cellb.gamma = 30, 40, 100
        self.refuses(4, "no cell has the angles", "--spacing")
        done = self.reads(data, "--spacing", "1,1,1")
        self.assertIn("no cell has the angles", done.stdout + done.stderr)

    def test_what_cannot_be_read_is_refused(self):
        data = numbers((5, 6, 7), "f4")
        self.save(data.astype("c8"))
        self.refuses(5, "mode")

    def test_damaged_files(self):
        self.save(numbers((5, 6, 7), "f4"))
        self.damaged(self.path.read_bytes())


class Mgh(DamagedFiles, Input):
    def setUp(self):
        super().setUp()
        self.path = self.here / "v.mgh"

    def save(self, data, affine=np.eye(4), name="v.mgh"):
        self.path = self.here / name
        nibabel.save(nibabel.MGHImage(data, affine), self.path)
        return nibabel.load(self.path)

    def world(self):
        """The positions of the store's nodes: x, y, z of the node (0, 0, 0), and the steps."""
        info = json.loads(served.run([ISONEST, "info", self.here / "s.isonest", "--json"], check=True, capture_output=True).stdout)
        return np.array(info["origin"]), np.array(info["direction"]) * np.array(info["spacing"])[:, None], info

    def test_types_and_packed_files(self):
        for kind, name in itertools.product(("u1", "i2", "i4", "f4"), ("v.mgh", "v.mgz")):
            with self.subTest(kind=kind, name=name):
                data = numbers((7, 6, 5), kind)
                self.save(data, np.diag([1, 2, 3, 1.]), name)
                self.reads(data.T)
                self.lies([0, 0, 0], [1, 2, 3])
                self.assertEqual(self.world()[2]["unit"], "mm")

    def test_the_place_is_that_of_nibabel(self):
        """A rotation by 180 degrees, an oblique one and reversed axes; odd and even sizes, whose middles differ."""
        c, s = np.cos(0.4), np.sin(0.4)
        for directions, shape in itertools.product((np.eye(3), np.diag([-1, 1, 1]), [[-1, 0, 0], [0, 0, 1], [0, -1, 0]],
                                                    [[c, -s, 0], [s, c, 0], [0, 0, 1]]), ((7, 6, 5), (8, 1, 3), (4, 4, 4))):
            data = numbers(shape)
            affine = np.eye(4)
            affine[:3, :3] = np.array(directions) * [0.5, 2, 1.25]
            affine[:3, 3] = [10, -20, 30]
            image = self.save(data, affine)
            self.assertEqual(self.preprocess().returncode, 0)
            origin, steps, info = self.world()
            served.run([ISONEST, "export", self.here / "s.isonest", "--field", "values", "-o", self.here / "s.raw", "--force"],
                       check=True, capture_output=True)
            found = np.fromfile(self.here / "s.raw", "i2").reshape([n for n in info["nodes"]][::-1])
            for at in np.ndindex(*found.shape):
                place = origin + np.array(at[::-1]) @ steps
                voxel = np.linalg.inv(image.affine) @ [*place, 1]
                index = tuple(np.round(voxel[:3]).astype(int))
                np.testing.assert_allclose(voxel[:3], index, atol=1e-3)
                self.assertEqual(found[at], data[index])

    def test_without_a_place(self):
        data = numbers((7, 6, 5))
        self.save(data, np.diag([1, 2, 3, 1.]))
        raw = bytearray(self.path.read_bytes())
        raw[28:30] = b"\0\0"
        self.path.write_bytes(raw)
        done = self.preprocess()
        self.assertIn("as in FreeSurfer", done.stdout + done.stderr)
        origin, steps, _ = self.world()
        # FreeSurfer's columns; in nibabel's default y and z are exchanged.
        affine = np.array([[-1, 0, 0], [0, 0, 1], [0, -1, 0]])
        ends = [affine @ (np.array(corner) - [3.5, 3, 2.5]) for corner in itertools.product((0, 6), (0, 5), (0, 4))]
        np.testing.assert_allclose(np.minimum(origin, origin + [6, 5, 4] @ steps), np.min(ends, axis=0), atol=1e-6)

    def test_frames_and_what_follows_the_numbers(self):
        data = numbers((7, 6, 5, 3), "f4")
        for name in ("v.mgh", "v.mgz"):
            self.save(data, name=name)
            self.refuses(5, "axis 't'", "--index")
            for t in range(3):
                self.reads(data[..., t].T, "--index", f"t={t}")
            self.reads(data[..., 1].T, "--index", "t=1", "--spacing", "1,1,1")

    def test_unsigned_shorts(self):
        """Type 10, which FreeSurfer 7 writes and nibabel does not support."""
        data = numbers((7, 6, 5), "u2")
        self.save(data.view("i2"))
        raw = bytearray(self.path.read_bytes())
        raw[20:24] = (10).to_bytes(4, "big")
        self.path.write_bytes(raw)
        self.reads(data.T)

    def test_what_cannot_be_read_is_refused(self):
        self.save(numbers((7, 6, 5)))
        whole = self.path.read_bytes()
        self.path.write_bytes(whole[:20] + (7).to_bytes(4, "big") + whole[24:])
        self.refuses(5, "type: 7")
        self.path.write_bytes(whole[:600])
        self.refuses(2, "need")
        self.path.write_bytes(whole[:4] + b"\x7f\xff\xff\xff" * 4 + whole[20:])
        self.refuses(5, "2147483647")
        self.path.write_bytes(whole[:30] + bytes(4) + whole[34:])  # a step of zero length
        self.refuses(4, "--spacing")

    def test_damaged_files(self):
        self.save(numbers((7, 6, 5), "f4"))
        whole = self.path.read_bytes()[:284 + 4 * 7 * 6 * 5]
        self.damaged(whole)


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1])
