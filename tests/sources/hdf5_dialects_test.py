#!/usr/bin/env python3
"""MINC 1 and 2, ITK, Imaris, ilastik, ChimeraX, HyperSpy, EMD, LZF: values and positions as by their own readers.

usage: hdf5_dialects_test.py ISONEST PLUGIN_FOLDER
"""
import json
import pathlib
import sys
import unittest
import warnings

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1] / "support"))
import served  # noqa: E402

try:
    import h5py
    import nibabel
    import numpy as np
    from scipy.io import netcdf_file
    from volume_inputs import ISONEST, RANDOM, Input, numbers
except ImportError as error:
    print(f"skipped: {error}")
    sys.exit(77)

UNSAID_SPACING = "the file does not give the spacing; it is taken as 1"


def letters(text):
    return np.array([c.encode() for c in text], "S1")


class Dialect(Input):
    frame = None

    def setUp(self):
        super().setUp()
        self.path = self.here / "v"

    def values(self, *options):
        """[z, y, x]"""
        done = self.preprocess("--json", *options)
        self.assertEqual(done.returncode, 0, done.stderr)
        self.notes = json.loads(done.stdout)["notes"]
        served.run([ISONEST, "export", self.here / "s.isonest", "--field", "values", "-o", self.here / "s.npy",
                    "--force"], check=True, capture_output=True)
        self.about = json.loads(served.run([ISONEST, "info", self.here / "s.isonest", "--json"], check=True,
                                          capture_output=True).stdout)
        return np.load(self.here / "s.npy")

    def agrees(self, values, affine, *options, unit=None):
        """Checks that the store has values[i, j, k] at affine @ (i, j, k, 1)."""
        found = self.values(*options)
        self.assertEqual(found.size, values.size)
        steps = np.reshape(self.about.get("direction") or np.eye(3), (3, 3)) * np.array(self.about["spacing"])[:, None]
        nodes = np.argwhere(np.ones(found.shape))[:, ::-1]
        at = (np.array(self.about["origin"]) + nodes @ steps - affine[:3, 3]) @ np.linalg.inv(affine[:3, :3]).T
        index = np.rint(at).astype(int)
        np.testing.assert_allclose(at, index, atol=1e-5)
        self.assertEqual(len(np.unique(index, axis=0)), values.size)
        np.testing.assert_allclose(found.ravel(), values[tuple(index.T)], rtol=1e-5, atol=1e-5)
        self.assertEqual((self.about["unit"], self.about["frame"]), (unit, self.frame))


class Minc(Dialect):
    names, shape, frame = ("zspace", "yspace", "xspace"), (4, 5, 6), "RAS"
    # Negative steps, and directions that are not the world's axes.
    dims = {"zspace": {"start": -10.0, "step": 2.0, "direction_cosines": [0.0, 0, 1]},
            "yspace": {"start": -21.0, "step": 3.0, "direction_cosines": [-0.6, 0.8, 0]},
            "xspace": {"start": 5.0, "step": -1.5, "direction_cosines": [0.8, 0.6, 0]}}

    def write1(self, values, least, most, names=None, dims=None, image=None, varid=b"MINC standard variable"):
        names = names or self.names
        with netcdf_file(self.path, "w") as file:
            for name, n in zip(names, values.shape):
                file.createDimension(name, n)
            for name, said in (self.dims if dims is None else dims).items():
                v = file.createVariable(name, "i", ())
                v.data[...] = 0
                for key, value in {"varid": varid, "spacing": b"regular__", **said}.items():
                    setattr(v, key, value)
            letter = {1: "b", 2: "h", 4: "i"}[values.itemsize] if values.dtype.kind != "f" else values.dtype.char
            v = file.createVariable("image", letter, names)
            v[:] = values.view(values.dtype.str.replace("u", "i"))
            for key, value in {"varid": varid, "signtype": b"unsigned" if values.dtype.kind == "u" else b"signed__",
                               **(image or {})}.items():
                setattr(v, key, value)
            for name, number in (("image-min", least), ("image-max", most)):
                if number is not None:
                    v = file.createVariable(name, "d", names[:np.ndim(number)])
                    v.varid = varid
                    if np.ndim(number):
                        v[:] = number
                    else:
                        v.data[...] = number

    def write2(self, values, least, most, names=None, dims=None, image=None):
        names = names or self.names
        with h5py.File(self.path, "w") as file:
            root = file.create_group("minc-2.0")
            for name, said in (self.dims if dims is None else dims).items():
                dim = root.create_dataset(f"dimensions/{name}", data=0)
                dim.attrs.update({"spacing": np.bytes_("regular__"), **said})
            v = root.create_dataset("image/0/image", data=values, chunks=True, compression="gzip")
            v.attrs.update({"dimorder": np.bytes_(",".join(names)), **(image or {})})
            for name, number in (("image-min", least), ("image-max", most)):
                if number is not None:
                    v = root.create_dataset(f"image/0/{name}", data=number)
                    if np.ndim(number):
                        v.attrs["dimorder"] = np.bytes_(",".join(names[:np.ndim(number)]))

    def nibabel(self):
        path = self.path.rename(self.path.with_suffix(".mnc"))
        self.path = path
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            image = nibabel.load(path)
            return np.asarray(image.dataobj, "f8"), image.affine

    def each(self):
        for version, write in ((1, self.write1), (2, self.write2)):
            with self.subTest(version=version):
                self.path = self.here / f"v{version}"
                yield write

    def test_slices_with_ranges_of_their_own(self):
        for write in self.each():
            for kind in ("i1", "u1", "i2", "u2", "i4", "u4"):
                least = RANDOM.normal(size=4)
                self.path.unlink(missing_ok=True)
                write(numbers(self.shape, kind), least, least + RANDOM.uniform(1, 5, 4))
                self.agrees(*self.nibabel(), unit="mm")
                self.assertIn("are scaled to image-min to image-max", self.notes[0])
                self.assertEqual(len(self.notes), 1)
                self.path = self.path.with_suffix("")

    def test_numbers_outside_of_the_valid_range_are_its_ends(self):
        for write in self.each():
            stored = numbers(self.shape, "i2")
            for image in ({"valid_range": np.array([-1000.0, 20000.0])}, {"valid_range": np.array([0.0, 4095])}):
                for least, most in ((-1.0, 2.0), (np.zeros((4, 5)), np.arange(1, 21).reshape(4, 5) / 7)):
                    write(stored, least, most, image=image)
                    values, affine = self.nibabel()
                    self.agrees(values, affine, unit="mm")
                    self.assertTrue(np.isfinite(values).all())
                    self.path = self.path.with_suffix("")
        self.path = self.here / "v1"
        self.write1(stored, -1.0, 2.0, image={"valid_min": -5.0, "valid_max": 500.0})
        self.agrees(*self.nibabel(), unit="mm")

    def test_labels_stay_integers(self):
        for write in self.each():
            stored = numbers(self.shape, "u1")
            write(stored, 0.0, 255.0, dims={}, image={"valid_range": np.array([0.0, 255])})
            found = self.values("--spacing", "1,1,1")
            self.assertEqual((found.dtype, self.notes), (np.uint8, []))
            np.testing.assert_array_equal(found, stored)

    def test_any_order_of_the_axes(self):
        for write in self.each():
            for names in (("xspace", "yspace", "zspace"), ("xspace", "zspace", "yspace"), ("yspace", "zspace", "xspace")):
                least = RANDOM.normal(size=4)
                write(numbers(self.shape, "i2"), least, least + 3, names=names)
                self.agrees(*self.nibabel(), unit="mm")
                self.path = self.path.with_suffix("")

    def test_floating_point_numbers_stay(self):
        for write in self.each():
            stored = numbers(self.shape, "f4")
            write(stored, -5.0, 5.0, image={"valid_range": np.array([-1.0, 1])})
            values, affine = self.nibabel()
            self.agrees(values, affine, unit="mm")
            self.assertEqual(self.notes, [])

    def test_a_time_is_chosen(self):
        names = ("time", *self.names)
        dims = {"time": {"start": 0.0, "step": 2.5}, **self.dims}
        for write in self.each():
            least = RANDOM.normal(size=(3, 4))
            write(numbers((3, *self.shape), "i2"), least, least + 2, names=names, dims=dims)
            values, affine = self.nibabel()
            self.refuses(5, "time 3, zspace 4", "--index")
            for t in range(3):
                self.agrees(values[t], affine, "--index", f"time={t}", unit="mm")
                self.agrees(values[t], affine, "--index", f"{t},:,:,:", unit="mm")
            plane = self.values("--index", "time=1,zspace=2")
            self.assertEqual(plane.size, 30)
            np.testing.assert_allclose(np.sort(plane.ravel()), np.sort(values[1, 2].ravel()), atol=1e-5)

    def test_what_is_not_said(self):
        for write in self.each():
            write(numbers(self.shape, "u1"), None, None, dims={})
            found = self.values()
            self.assertIn("scaled to 0 to 1", self.notes[0])
            self.assertEqual(UNSAID_SPACING, self.notes[-1])
            self.assertTrue(0 <= found.min() and found.max() <= 1)
            write(numbers(self.shape, "u1"), 0.0, None)
            self.refuses(4, "MINC", "image-min and image-max")
            write(numbers(self.shape, "u1"), 0.0, 1.0, image={"valid_range": np.array([7.0, 7])})
            self.refuses(4, "valid_range", "7 to 7")
            dims = {**self.dims, "zspace": {"spacing": b"irregular", "start": 0.0, "step": 1.0}}
            write(numbers(self.shape, "u1"), 0.0, 1.0, dims=dims)
            self.refuses(5, "irregular", "zspace", "--spacing")
        with h5py.File(self.path, "w") as file:
            file.create_group("minc-2.0/image")
        self.refuses(4, "this is MINC 2", "/minc-2.0/image/0/image")


class Itk(Dialect):
    frame = "LPS"

    def write(self, values, direction, spacing, origin):
        n = len(spacing)
        with h5py.File(self.path, "w") as file:
            group = file.create_group("ITKImage/0")
            group["Dimension"] = np.array(values.shape[:n][::-1], "u8")
            group["Origin"], group["Spacing"], group["Directions"] = origin, spacing, direction
            group["VoxelData"] = values

    def test_directions_are_rows(self):
        direction = np.array([[0.8, 0.6, 0], [-0.6, 0.8, 0], [0, 0, 1]])  # of axes x, y, z
        for turn in (direction, direction[[2, 0, 1]], np.diag([1.0, -1, 1])):
            values, spacing, origin = numbers((4, 5, 6), "i2"), np.array([0.5, 0.75, 2]), np.array([5.0, 6, 7])
            self.write(values, turn, spacing, origin)
            affine = np.eye(4)
            affine[:3, :3], affine[:3, 3] = (turn * spacing[:, None])[::-1].T, origin
            self.agrees(values, affine)
            self.assertEqual(self.notes, [])
            self.agrees(values, affine, "--dataset", "ITKImage/0/VoxelData")

    def test_components_and_planes(self):
        values = numbers((4, 5, 6, 3), "u1")
        self.write(values, np.eye(3), [1.0, 2, 3], [7.0, 8, 9])
        self.refuses(5, "component 3", "--index")
        np.testing.assert_array_equal(self.values("--index", "component=1"), values[..., 1])
        self.lies([7, 8, 9], [1, 2, 3])
        self.write(values[0, ..., 0], np.eye(2), [1.0, 2], [7.0, 8])
        np.testing.assert_array_equal(self.values()[0], values[0, ..., 0])
        self.lies([7, 8, 0], [1, 2, 1])

    def test_what_is_missing_is_named(self):
        self.write(numbers((4, 5, 6)), np.eye(3), [1.0, 1, 1], [0.0, 0, 0])
        for name in ("Spacing", "Directions", "VoxelData"):
            with h5py.File(self.path, "a") as file:
                del file[f"ITKImage/0/{name}"]
            self.refuses(4, "this is an ITK image", name)
            self.write(numbers((4, 5, 6)), np.eye(3), [1.0, 1, 1], [0.0, 0, 0])


class Imaris(Dialect):
    def write(self, size=True, extent=True, times=1, channels=2):
        self.data = numbers((times, channels, 10, 14, 18), "u1")
        with h5py.File(self.path, "w") as file:
            for t in range(times):
                for c in range(channels):
                    group = file.create_group(f"DataSet/ResolutionLevel 0/TimePoint {t}/Channel {c}")
                    padded = np.zeros((16, 16, 24), "u1")
                    padded[:10, :14, :18] = self.data[t, c]
                    group.create_dataset("Data", data=padded, chunks=(8, 8, 8), compression="gzip")
                    group = file.create_group(f"DataSet/ResolutionLevel 1/TimePoint {t}/Channel {c}")
                    group["Data"] = padded[::2, ::2, ::2]
                    for name, n in zip("XYZ", (9, 7, 5)):
                        group.attrs[f"ImageSize{name}"] = letters(str(n))
            image = file.create_group("DataSetInfo/Image")
            if size:
                image.attrs.update({name: letters(n) for name, n in zip("XYZ", ("18", "14", "10"))})
            if extent:
                image.attrs.update({f"ExtMin{a}": letters(str(v)) for a, v in enumerate((100, 0, -5.5))})
                image.attrs.update({f"ExtMax{a}": letters(str(v)) for a, v in enumerate((109, 7, 14.5))})
                image.attrs["Unit"] = letters("um")

    def test_padding_is_no_data_and_nodes_are_centres_of_voxels(self):
        self.write()
        self.refuses(5, "t 1, c 2, z 10, y 14, x 18", "--index")
        for options in (("--index", "c=1"), ("--index", "0,1,:,:,:"),
                        ("--dataset", "DataSet/ResolutionLevel 0/TimePoint 0/Channel 1/Data")):
            np.testing.assert_array_equal(self.values(*options), self.data[0, 1])
            self.lies([100.25, 0.25, -4.5], [0.5, 0.5, 2])
            self.assertEqual((self.about["unit"], self.notes), ("um", []))
        np.testing.assert_array_equal(self.values("--index", "c=0,z=-1")[0], self.data[0, 0, 9])
        found = self.values("--dataset", "DataSet/ResolutionLevel 1/TimePoint 0/Channel 1/Data")
        np.testing.assert_array_equal(found, self.data[0, 1, ::2, ::2, ::2])
        self.lies([100.5, 0.5, -3.5], [1, 1, 4])
        self.write(times=3, channels=1)
        np.testing.assert_array_equal(self.values("--index", "t=2"), self.data[2, 0])

    def test_what_is_missing_is_named(self):
        self.write(size=False, channels=1)
        self.refuses(4, "this is an Imaris file", "ImageSizeZ")
        self.write(extent=False, channels=1)
        np.testing.assert_array_equal(self.values(), self.data[0, 0])
        self.assertEqual(self.notes, [UNSAID_SPACING])
        with h5py.File(self.path, "a") as file:
            del file["DataSet/ResolutionLevel 0"]
        self.refuses(4, "this is an Imaris file", "ResolutionLevel 0")


class Ilastik(Dialect):
    def write(self, values, keys, resolution=None, name="exported_data", **storage):
        with h5py.File(self.path, "w") as file:
            data = file.create_dataset(name, data=values, **storage)
            data.attrs["axistags"] = json.dumps({"axes": [
                {"key": k, "typeFlags": 2, "resolution": (resolution or {}).get(k, 0), "description": ""} for k in keys]})

    def test_axes_are_those_of_their_names(self):
        values = numbers((3, 5, 7), "f4")
        for storage in ({}, {"chunks": (2, 3, 4), "compression": "gzip"}, {"chunks": (3, 5, 7), "compression": "lzf"},
                        {"chunks": (2, 2, 2), "scaleoffset": 9}):
            for keys in ("xyz", "zyx", "yxz", "zxy"):
                with self.subTest(keys=keys, storage=storage):
                    self.write(values, keys, {"x": 0.5, "y": 2.0, "z": 3.0}, **storage)
                    with h5py.File(self.path) as file:
                        try:
                            expected = file["exported_data"][()].transpose([keys.index(k) for k in "zyx"])
                        except OSError:
                            continue  # HDF5 1.14 cannot read such numbers, although it wrote them
                    np.testing.assert_array_equal(self.values(), expected)
                    self.lies([0, 0, 0], [0.5, 2, 3])
                    self.assertEqual(self.notes, [])
        self.write(numbers((200, 100, 130), "f8"), "xyz")  # more than fits into the buffer
        with h5py.File(self.path) as file:
            np.testing.assert_array_equal(self.values(), file["exported_data"][()].T)
        self.assertEqual(self.notes, [UNSAID_SPACING])

    def test_channels_and_times_are_chosen(self):
        values = numbers((2, 3, 5, 7, 4), "u2")
        for storage in ({}, {"chunks": (1, 2, 3, 4, 4), "compression": "gzip"}):
            self.write(values, "txyzc", **storage)
            self.refuses(5, "t 2, x 3, y 5, z 7, c 4", "--index")
            np.testing.assert_array_equal(self.values("--index", "t=1,c=3"), values[1, ..., 3].T)
            np.testing.assert_array_equal(self.values("--index", "t=0,c=-1,z=2")[0], values[0, :, :, 2, 3].T)
        self.write(values[:1, ..., :1], "txyzc")
        np.testing.assert_array_equal(self.values(), values[0, ..., 0].T)

    def test_wrong_axistags(self):
        for tags in ("{", "[]", '{"axes": 3}', '{"axes": [{"key": "x"}]}', '{"axes": [1, 2, 3]}', '{"axes":[{},{},{}]}'):
            with h5py.File(self.path, "w") as file:
                file["v"] = numbers((3, 4, 5))
                file["v"].attrs["axistags"] = tags
            self.refuses(4, "axistags")


class Microscopy(Dialect):
    def test_chimera(self):
        values = numbers((4, 5, 6), "f4")
        with h5py.File(self.path, "w") as file:
            image = file.create_group("Chimera/image1")
            image.attrs.update({"step": np.float32([1.5, 2, 2.5]), "origin": [10.0, -20, 30], "cell_angles": [90.0, 90, 90]})
            image["data_zyx"] = values
            image["data_zyx_2_2_2"] = values[::2, ::2, ::2]
            image["data_zyx_2_2_2"].attrs["subsample_spacing"] = [2, 2, 2]
        np.testing.assert_array_equal(self.values(), values)
        self.lies([10, -20, 30], [1.5, 2, 2.5])
        self.assertEqual(self.about["unit"], "angstrom")
        self.refuses(5, "reduced copy", options=("--dataset", "Chimera/image1/data_zyx_2_2_2"))
        with h5py.File(self.path, "a") as file:  # a rotation by 90 degrees about z: x runs along y
            file["Chimera/image1"].attrs.update({"rotation_axis": [0.0, 0, 1], "rotation_angle": 90.0})
        affine = np.array([[0, -2, 0, 10], [0, 0, 1.5, -20], [2.5, 0, 0, 30], [0, 0, 0, 1.0]])
        self.agrees(values, affine, unit="angstrom")
        with h5py.File(self.path, "a") as file:
            file["Chimera/image1"].attrs["cell_angles"] = [90.0, 90, 70]
        c, s = np.cos(np.radians(70)), np.sin(np.radians(70))
        cell = np.array([[1, c, 0], [0, s, 0], [0, 0, 1]]) * [1.5, 2, 2.5]
        affine[:3, :3] = np.array([[0, -1, 0], [1, 0, 0], [0, 0, 1]]) @ cell
        self.assertEqual(self.preprocess().returncode, 0)
        np.testing.assert_allclose(np.array(self.directions()).T * self.info()["spacing"], affine[:3, :3], atol=1e-9)
        np.testing.assert_allclose(self.info()["origin"], [10, -20, 30])
        self.assertEqual(self.preprocess("--spacing", "1,1,1").returncode, 0)

    def test_hyperspy(self):
        values = numbers((4, 5, 6), "i2")
        for names in ("zyx", "xyz"):
            with h5py.File(self.path, "w") as file:
                group = file.create_group("Experiments/v")
                group["data"] = values
                for i, name in enumerate(names):
                    group.create_group(f"axis-{i}").attrs.update({"name": name, "scale": 0.5 + i, "offset": 10.0 * i,
                                                                  "size": values.shape[i], "units": "nm"})
            np.testing.assert_array_equal(self.values(), values.transpose([names.index(k) for k in "zyx"]))
            self.lies(*np.transpose([(10 * names.index(k), 0.5 + names.index(k)) for k in "xyz"]))
            self.assertEqual((self.about["unit"], self.notes), ("nm", []))
        with h5py.File(self.path, "a") as file:
            del file["Experiments/v/axis-1"]
        self.refuses(4, "HyperSpy", "axis-1")

    def test_the_emd_of_berkeley(self):
        values = numbers((4, 5, 6), "f4")
        with h5py.File(self.path, "w") as file:
            group = file.create_group("data/tomography")
            group.attrs["emd_group_type"] = 1
            group["data"] = values
            for i, name in enumerate("xyz"):
                dim = group.create_dataset(f"dim{i + 1}", data=5 * i + (i + 1) * np.arange(values.shape[i] if i else 2))
                dim.attrs.update({"name": np.bytes_(name), "units": "[n_m]"})
        np.testing.assert_array_equal(self.values(), values.T)
        self.lies([0, 5, 10], [1, 2, 3])
        self.assertEqual(self.about["unit"], "nm")
        with h5py.File(self.path, "a") as file:
            file["data/tomography/dim2"][...] = [1, 2, 4, 2, 16]
        self.refuses(5, "'y' neither increase nor decrease", "--spacing")

    def test_a_frame_of_velox(self):
        values = numbers((5, 6, 3), "u2")
        text = json.dumps({"BinaryResult": {"PixelSize": {"width": "2e-10", "height": "3e-10"}, "PixelUnitX": "m",
                                            "PixelUnitY": "m", "Offset": {"x": "-1e-9", "y": "4e-9"}}})
        with h5py.File(self.path, "w") as file:
            group = file.create_group("Data/Image/f5a4")
            group["Data"] = values
            group["Metadata"] = np.repeat(np.frombuffer(text.encode() + bytes(50), "u1")[:, None], 3, 1)
        self.refuses(5, "frame 3", "--index")
        np.testing.assert_array_equal(self.values("--index", "frame=2")[0], values[..., 2])
        self.lies([-1e-9, 4e-9, 0], [2e-10, 3e-10, 1])
        self.assertEqual(self.about["unit"], "m")


class Lzf(Dialect):
    def test_chunks_in_lzf(self):
        for values in (numbers((9, 10, 11), "i2") // 4096, numbers((9, 10, 11), "f8"), np.zeros((9, 10, 11), "u1")):
            for chunks in ((9, 10, 11), (4, 3, 8)):
                for more in ({}, {"shuffle": True}, {"fletcher32": True}, {"shuffle": True, "fletcher32": True}):
                    with h5py.File(self.path, "w") as file:
                        file.create_dataset("v", data=values, chunks=chunks, compression="lzf", **more)
                    np.testing.assert_array_equal(self.values(), values)

    def test_lzf_that_hdf5_has_to_undo(self):
        values = numbers((9, 10, 11), "i2") // 4096
        for kind in (">i2", "<i8"):  # another byte order, and a type that is converted
            with h5py.File(self.path, "w") as file:
                file.create_dataset("v", data=values.astype(kind), chunks=(4, 3, 8), compression="lzf", shuffle=True)
            np.testing.assert_array_equal(self.values(), values)
        for first in ("fletcher32", "shuffle"):  # before or after it
            creation = h5py.h5p.create(h5py.h5p.DATASET_CREATE)
            creation.set_chunk((4, 3, 8))
            if first == "fletcher32":
                creation.set_fletcher32()
            creation.set_filter(32000, h5py.h5z.FLAG_OPTIONAL)
            if first == "shuffle":
                creation.set_shuffle()
            with h5py.File(self.path, "w") as file:
                h5py.h5d.create(file.id, b"v", h5py.h5t.NATIVE_INT16, h5py.h5s.create_simple(values.shape), creation)
                file["v"][...] = values
            np.testing.assert_array_equal(self.values(), values)

    def test_a_damaged_chunk_is_an_error(self):
        values = np.repeat(np.arange(1000, dtype="i4"), 8).reshape(20, 20, 20)
        for kind in ("<i4", ">i4"):
            with h5py.File(self.path, "w") as file:
                data = file.create_dataset("v", data=values.astype(kind), chunks=(20, 20, 20), compression="lzf")
                chunk = data.id.get_chunk_info(0)
            whole = self.path.read_bytes()
            for _ in range(20):
                at = chunk.byte_offset + int(RANDOM.integers(chunk.size))
                self.path.write_bytes(whole[:at] + b"\xff" * min(40, chunk.byte_offset + chunk.size - at) + whole[at + 40:])
                self.assertIn(self.preprocess().returncode, (0, 4, 6))


class Unsaid(Dialect):
    note = UNSAID_SPACING

    def test_a_spacing_that_no_file_says_is_noted(self):
        data = numbers((3, 4, 5), "i2")
        np.save(self.here / "v.npy", data)
        np.savez(self.here / "v.npz", data)
        with h5py.File(self.here / "v.h5", "w") as file:
            file["v"] = data
        for name in ("v.npy", "v.npz", "v.h5"):
            self.path = self.here / name
            self.values()
            self.assertEqual(self.notes, [self.note])
            self.values("--spacing", "1,1,1")
            self.assertEqual(self.notes, [])
            self.assertIn(self.note, self.preprocess().stdout + self.preprocess().stderr)
        with h5py.File(self.path, "a") as file:
            file["v"].attrs["spacing"] = [1.0, 1, 1]
        self.values()
        self.assertEqual(self.notes, [])


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1])
