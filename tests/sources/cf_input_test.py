#!/usr/bin/env python3
"""Climate and forecast data (CF) in NetCDF-4, NetCDF-3 and HDF5: scaled and placed as by xarray.

usage: cf_input_test.py ISONEST PLUGIN_FOLDER
"""
import itertools
import json
import os
import pathlib
import struct
import sys
import unittest

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1] / "support"))
import served  # noqa: E402

os.environ["HDF5_PLUGIN_PATH"] = sys.argv[2]
try:
    import h5py
    import netCDF4
    import numpy as np
    import xarray
    from volume_inputs import ISONEST, RANDOM, Input, numbers
except ImportError as error:
    print(f"skipped: {error}")
    sys.exit(77)

FORMATS = ("NETCDF4", "NETCDF4_CLASSIC", "NETCDF3_CLASSIC", "NETCDF3_64BIT_OFFSET", "NETCDF3_64BIT_DATA")


class Cf(Input):
    def setUp(self):
        super().setUp()
        self.path = self.here / "v.nc"

    def values(self, *options):
        done = self.preprocess("--json", *options)
        self.assertEqual(done.returncode, 0, done.stderr)
        self.notes = json.loads(done.stdout)["notes"]
        served.run([ISONEST, "export", self.here / "s.isonest", "--field", "values", "-o", self.here / "s.npy",
                    "--force"], check=True, capture_output=True)
        return np.load(self.here / "s.npy")

    def noted(self, *notes):
        """Checks that there are as many notes, and that each has its words."""
        self.assertEqual(len(self.notes), len(notes), self.notes)
        for note, words in zip(self.notes, notes):
            for word in words:
                self.assertIn(word, note)

    def write(self, data, kind, fmt="NETCDF4", name="t", dims=("z", "y", "x"), coordinates=None, unlimited=None,
              attributes=None, fill=None, **storage):
        with netCDF4.Dataset(self.path, "w", format=fmt) as file:
            for dim, length in zip(dims, data.shape):
                file.createDimension(dim, None if dim == unlimited else length)
                if coordinates and dim in coordinates:
                    file.createVariable(dim, "f8", (dim,))[:] = coordinates[dim]
            v = file.createVariable(name, kind, dims, fill_value=fill, **storage)
            v.set_auto_maskandscale(False)
            for key, value in (attributes or {}).items():
                v.setncattr(key, value)
            v[:] = data

    def expected(self, name="t"):
        with xarray.open_dataset(self.path, decode_times=False) as x:
            return x[name].values

    def test_scale_offset_and_missing_values(self):
        for fmt, chunks in itertools.product(FORMATS, (None, (2, 3, 4))):
            if chunks and "NETCDF4" not in fmt:
                continue
            stored = numbers((4, 5, 6), "i2")
            stored[1, 2, 3], stored[0, 0, 0] = -999, -998
            for attributes, fill in (({"scale_factor": 0.01, "add_offset": 273.15}, -999),
                                     ({"missing_value": np.int16(-998)}, -999), ({"scale_factor": 2.0}, None),
                                     ({"add_offset": -5.0}, None)):
                with self.subTest(fmt=fmt, chunks=chunks, attributes=attributes, fill=fill):
                    self.write(stored, "i2", fmt, attributes=attributes, fill=fill, zlib=bool(chunks),
                               chunksizes=chunks)
                    found, expected = self.values(), self.expected()
                    if fill is None:
                        np.testing.assert_array_equal(found, expected)
                        self.assertEqual(found.dtype.kind, "i")
                    else:
                        np.testing.assert_allclose(found, expected, rtol=3e-7, atol=5e-5)
                        self.assertEqual(np.isnan(found).sum(), np.isnan(expected).sum())
                    self.assertEqual(len(self.notes), 2)  # the other one says that there is no spacing
        self.assertIn("plus -5", self.notes[1])

    def test_all_types(self):
        for fmt in FORMATS:
            for kind in ("i1", "i2", "i4", "f4", "f8", "u1", "u2", "u4"):
                if kind[0] == "u" and fmt in ("NETCDF4_CLASSIC", "NETCDF3_CLASSIC", "NETCDF3_64BIT_OFFSET"):
                    continue
                with self.subTest(fmt=fmt, kind=kind):
                    data = numbers((3, 5, 7), kind)
                    self.write(data, kind, fmt)
                    np.testing.assert_array_equal(self.values("--spacing", "1,1,1"), data)
                    self.assertEqual(self.notes, [])

    def test_valid_range_and_unsigned_numbers(self):
        stored = numbers((4, 5, 6), "i1")
        for fmt in ("NETCDF4", "NETCDF3_CLASSIC"):
            self.write(stored, "i1", fmt, attributes={"_Unsigned": "true"})
            np.testing.assert_array_equal(self.values(), stored.view("u1"))
            self.write(stored, "i1", fmt, attributes={"_Unsigned": "true", "scale_factor": 0.5}, fill=-1)
            np.testing.assert_allclose(self.values(), self.expected())
            self.write(stored, "i1", fmt, attributes={"valid_range": np.array([-50, 60], "i1")})
            expected = np.where((stored >= -50) & (stored <= 60), stored, np.nan)
            np.testing.assert_array_equal(self.values(), expected)

    def test_coordinates_place_the_volume(self):
        data = numbers((4, 5, 6), "f4")
        at = {"z": [10, 30, 50, 70], "y": [40, 38, 36, 34, 32], "x": np.arange(6) * 0.25 - 7}
        for fmt in FORMATS:
            self.write(data, "f4", fmt, coordinates=at)
            np.testing.assert_array_equal(self.values(), data[:, ::-1])
            self.lies([-7, 32, 10], [0.25, 2, 20])
            self.assertEqual(self.notes, [])

    def test_uneven_coordinates_are_never_moved_without_a_word(self):
        data = numbers((3, 5, 6), "f4")
        grid = {"y": [40, 38, 36, 34, 32], "x": np.arange(6) * 0.25 - 7}
        for fmt in FORMATS:
            self.write(data, "f4", fmt, coordinates={"z": [200, 500, 850], **grid})
            np.testing.assert_array_equal(self.values(), data[:, ::-1])
            self.noted(("'z' are not quite evenly spaced", "25", "0.077 of a step"))
            self.lies([-7, 32, 200], [0.25, 2, 325])
            for levels, spacing, most in (([1000, 850, 500], 250, 100), ([1, 2, 40], 19.5, 18.5)):
                self.write(data, "f4", fmt, coordinates={"z": levels, **grid})
                np.testing.assert_array_equal(self.values(), data[::-1 if levels[0] > levels[1] else 1, ::-1])
                self.assertEqual(self.notes, [])
                self.lies([-7, 32, min(levels)], [0.25, 2, spacing])
                with h5py.File(self.here / "s.isonest") as store:
                    self.assertEqual(list(store.attrs["offsets_z"]), sorted(abs(z - min(levels)) for z in levels))
                found = self.values("--spacing", f"0.25,2,{spacing}")
                np.testing.assert_array_equal(found, data[::-1 if levels[0] > levels[1] else 1, ::-1])
                self.noted(("'z' are not evenly spaced", "spacing", f"up to {most} away"))
                self.lies([-7, 32, min(levels)], [0.25, 2, spacing])
            for levels in ([1, 2, 2], [1, 3, 2], [2, 1, 2]):
                self.write(data, "f4", fmt, coordinates={"z": levels, **grid})
                self.refuses(5, "'z' neither increase nor decrease", "give --spacing")
            # Deviations within the rounding to float32, and a single level, are accepted.
            self.write(data, "f4", fmt, coordinates={**grid, "z": [1, 2, 3], "y": np.float32(4000 - np.arange(5) * 0.1)})
            self.values()
            self.assertEqual(self.notes, [])
            np.testing.assert_array_equal(self.values("--index", "z=1")[0], data[1, ::-1])

    def test_a_spacing_that_is_not_said_is_noted(self):
        data = numbers((3, 5, 6), "f4")
        for fmt in FORMATS:
            self.write(data, "f4", fmt)
            self.values()
            self.noted(("the spacing;", "taken as 1"))
            self.values("--spacing", "1,1,1")
            self.assertEqual(self.notes, [])
            self.write(data, "f4", fmt, coordinates={"y": [1, 2, 3, 4, 5]})
            self.values()
            self.noted(("spacing along x and z", "taken as 1"))
            self.write(data, "f4", fmt, coordinates={"z": [1, 1, 1], "y": [1, 2, np.inf, 4, 5], "x": range(6)})
            self.values()
            self.noted(("'y' are not all finite numbers", "ignored"), ("'z' are all the same", "ignored"),
                       ("spacing along y and z", "taken as 1"))

    def test_time_steps_are_chosen(self):
        data = numbers((3, 4, 5, 6), "f4")
        for fmt, unlimited in itertools.product(FORMATS, (None, "time")):
            self.write(data, "f4", fmt, dims=("time", "z", "lat", "lon"), unlimited=unlimited,
                       coordinates={"time": [0, 1, 2], "lat": range(5), "lon": range(6)})
            self.refuses(5, "time 3, z 4, lat 5, lon 6", "--index")
            for t in range(3):
                np.testing.assert_array_equal(self.values("--index", f"time={t}"), data[t])
            np.testing.assert_array_equal(self.values("--index", "1,:,:,:"), data[1])
            np.testing.assert_array_equal(self.values("--index", "time=2,z=1")[0], data[2, 1])

    def test_records_of_several_variables(self):
        for fmt in ("NETCDF3_CLASSIC", "NETCDF3_64BIT_OFFSET", "NETCDF3_64BIT_DATA"):
            data, other = numbers((3, 5, 7), "i2"), numbers((3, 3), "i1")
            with netCDF4.Dataset(self.path, "w", format=fmt) as file:
                for dim, length in (("time", None), ("y", 5), ("x", 7), ("n", 3)):
                    file.createDimension(dim, length)
                file.createVariable("other", "i1", ("time", "n"))[:] = other
                file.createVariable("t", "i2", ("time", "y", "x"))[:] = data
                file.createVariable("text", "S1", ("time", "n"))
            np.testing.assert_array_equal(self.values(), data)
            np.testing.assert_array_equal(self.values("--dataset", "other")[0], other)
            self.refuses(3, "t [3, 5, 7] int16", options=("--dataset", "u"))
            # If there is only one record variable, records are not padded.
            with netCDF4.Dataset(self.path, "w", format=fmt) as file:
                for dim, length in (("time", None), ("x", 7)):
                    file.createDimension(dim, length)
                file.createVariable("t", "i1", ("time", "x"))[:] = data[:, 0].astype("i1")
            np.testing.assert_array_equal(self.values()[0], data[:, 0].astype("i1"))

    def test_records_whose_length_is_no_multiple_of_their_numbers(self):
        data, steps = numbers((4, 5, 3), "f8"), np.array([7, 9, 11, 13], "i4")
        for fmt in FORMATS[2:]:
            with netCDF4.Dataset(self.path, "w", format=fmt) as file:
                for dim, length in (("time", None), ("y", 5), ("x", 3)):
                    file.createDimension(dim, length)
                file.createVariable("step", "i4", ("time",))[:] = steps
                file.createVariable("time", "f8", ("time",))[:] = [4, 3, 2, 1]
                file.createVariable("t", "f8", ("time", "y", "x"))[:] = data
            np.testing.assert_array_equal(self.values(), data[::-1])
            self.lies([0, 0, 1], [1, 1, 1])
            np.testing.assert_array_equal(self.values("--index", "time=2")[0], data[2])
            np.testing.assert_array_equal(self.values("--index", "1,2,0").ravel(), data[1, 2, 0])

    def test_records_that_are_not_all_there(self):
        data = numbers((40, 50, 60), "f4")
        for fmt in FORMATS[2:]:
            with netCDF4.Dataset(self.path, "w", format=fmt) as file:
                for dim, length in (("time", None), ("y", 50), ("x", 60)):
                    file.createDimension(dim, length)
                for name in "ab":
                    file.createVariable(name, "f4", ("time", "y", "x"))[:] = data
            whole = self.path.read_bytes()
            record = 50 * 60 * 4
            for lost in (record + 4, record + 100, 20 * record, 40 * record):  # of the last record of b, and of a
                self.path.write_bytes(whole[:-lost])
                self.refuses(2, "but the file has", options=("--dataset", "a"))
            self.path.write_bytes(whole[:-record])
            np.testing.assert_array_equal(self.values("--dataset", "a"), data)

    def test_packed_and_wide_coordinates(self):
        data = numbers((4, 5, 6), "f4")
        for fmt in FORMATS:
            wide = fmt in ("NETCDF4", "NETCDF3_64BIT_DATA")
            with netCDF4.Dataset(self.path, "w", format=fmt) as file:
                for dim, length in zip("zyx", data.shape):
                    file.createDimension(dim, length)
                v = file.createVariable("z", "i2", ("z",))
                v.set_auto_maskandscale(False)
                v.scale_factor, v.add_offset, v.units = -0.5, 10.0, "mm"
                v[:] = range(4)
                v = file.createVariable("y", "i1", ("y",))
                v.set_auto_maskandscale(False)
                v._Unsigned = "true"
                v.units = "mm"
                v[:] = np.array([100, 120, 140, 160, 180], "u1").view("i1")
                v = file.createVariable("x", "i8" if wide else "i4", ("x",))
                v.units = "mm"
                v[:] = [20, 18, 16, 14, 12, 10]
                file.createVariable("t", "f4", ("z", "y", "x"))[:] = data
            with xarray.open_dataset(self.path) as x:
                np.testing.assert_array_equal(x["z"].values, [10, 9.5, 9, 8.5])
            np.testing.assert_array_equal(self.values(), data[::-1, :, ::-1])
            self.assertEqual(self.notes, [])
            self.lies([10, 100, 8.5], [2, 20, 0.5])

    def test_coordinates_of_text_are_none(self):
        data = numbers((4, 5, 6), "f4")
        for fmt in FORMATS:
            self.write(data, "f4", fmt, coordinates={"y": range(5)})
            with netCDF4.Dataset(self.path, "a") as file:
                file.createVariable("z", "S1", ("z",))[:] = np.array(list("abcd"), "S1")
            np.testing.assert_array_equal(self.values("--dataset", "t"), data)

    def test_an_axis_of_one_node_lies_where_its_coordinate_says(self):
        data = numbers((1, 5, 6), "f4")
        for fmt in FORMATS:
            for units, origin, unit in ((("m", "m", "m"), [3, 0, 850], "m"), ((None, None, None), [3, 0, 850], None),
                                        (("km", "m", "m"), [3, 0, 850000], "m"), (("hPa", "m", "m"), [3, 0, 0], "m"),
                                        ((None, "m", "m"), [3, 0, 0], "m")):
                with self.subTest(fmt=fmt, units=units):
                    self.write(data, "f4", fmt, coordinates={"z": [850], "y": range(5), "x": range(3, 9)})
                    with netCDF4.Dataset(self.path, "a") as file:
                        for dim, of in zip("zyx", units):
                            if of:
                                file[dim].units = of
                    np.testing.assert_array_equal(self.values(), data)
                    self.lies(origin, [1, 1, 1])
                    info = served.run([ISONEST, "info", self.here / "s.isonest", "--json"], check=True, capture_output=True)
                    self.assertEqual(json.loads(info.stdout)["unit"], unit)

    def test_what_is_missing_in_float32_may_be_said_in_float64(self):
        stored = numbers((4, 5, 6), "f4")
        stored[1, 2, 3], stored[0, 0, 0], stored[3, 4, 5] = 1e20, 0.1, -0.3
        for fmt in FORMATS:
            self.write(stored, "f4", fmt, attributes={"missing_value": np.array([1e20, 0.1], "f8")})
            # xarray compares in float64 with NumPy 2 or later, and then never finds 0.1.
            np.testing.assert_array_equal(self.values(), np.where(np.isin(stored, np.float32([1e20, 0.1])), np.float32(np.nan), stored))
            self.assertEqual(np.isnan(self.values()).sum(), 2)
            self.write(np.clip(stored, -0.3, 0.1), "f4", fmt, attributes={"valid_range": np.array([-0.3, 0.1], "f8")})
            self.assertEqual(np.isnan(self.values()).sum(), 0)

    def test_the_largest_float32_is_missing_as_it_is_often_written(self):
        stored = numbers((4, 5, 6), "f4")
        stored[1, 2, 3] = -np.finfo("f4").max
        for fmt in FORMATS:
            self.write(stored, "f4", fmt, attributes={"missing_value": np.float64(-3.40282347e38)})
            values = self.values()
            self.assertTrue(np.isnan(values[1, 2, 3]))
            self.assertEqual(np.isnan(values).sum(), 1)

    def test_labels_of_64_bits_are_kept_beside_a_note(self):
        labels = np.array([0, 7, 2**53 + 1, 2**62 - 1], "i8")[RANDOM.integers(4, size=(4, 5, 6))]
        for fmt in ("NETCDF4", "NETCDF3_64BIT_DATA"):
            for depths, notes in (([0, 1, 2, 3], 1), ([0, 1, 2, 3.1], 2)):  # one is about the spacing along x and y
                with self.subTest(fmt=fmt, depths=depths):
                    self.write(labels, "i8", fmt, coordinates={"z": depths})
                    done = self.preprocess("--json", "--labels")
                    self.assertEqual(done.returncode, 0, done.stderr)
                    self.assertEqual(len(json.loads(done.stdout)["notes"]), notes)
                    with h5py.File(self.here / "s.isonest") as file:  # the format of FORMAT.md
                        np.testing.assert_array_equal(file["levels/0/values"][:].view("i8") - 0x3FF0000000000000, labels)

    def test_hdf5_of_any_axes_and_filters(self):
        data = numbers((3, 2, 9, 10, 11), "i2")
        for storage in ({}, {"chunks": (1, 1, 4, 4, 4), "compression": "gzip"}, {"chunks": (2, 2, 3, 3, 5), "shuffle": True},
                        {"chunks": (2, 2, 3, 3, 5), "compression": "lzf"}, {"chunks": (3, 2, 9, 10, 11), "compression": 9}):
            if storage.get("compression") == "lzf":
                continue
            with h5py.File(self.path, "w") as file:
                v = file.create_dataset("v", data=data, **storage)
                for dim, name in zip(v.dims, "tczyx"):
                    dim.label = name
            self.refuses(5, "t 3, c 2, z 9, y 10, x 11")
            for t, c in itertools.product(range(3), range(2)):
                np.testing.assert_array_equal(self.values("--index", f"t={t},c={c}"), data[t, c])
            np.testing.assert_array_equal(self.values("--index", "1,:,:,3,:"), data[1, :, :, 3])

    def test_a_netcdf_3_header_that_would_take_much_memory(self):
        self.write(numbers((3, 4, 5), "i2"), "i2", FORMATS[2])
        whole = self.path.read_bytes()
        nothing = bytes(8)  # the place of the list of the dataset's own attributes
        at = whole.index(nothing, 12)
        for count, code in ((300000, 4), (1000, 0)):
            attributes = struct.pack(">ii", 12, count) + struct.pack(">iii", 0, 1, 0) * count
            data = bytearray(whole[:at] + attributes + whole[at + 8:])
            begin = data.rindex(whole[-120:]) - 4  # the last number of the header, the offset of the values
            struct.pack_into(">i", data, begin, begin + 4)
            self.path.write_bytes(data)
            done = self.preprocess("--memory", "64M")
            self.assertEqual(done.returncode, code, done.stderr)
            self.assertIn("more than 200000 dimensions" if code else "", done.stderr)

    def test_damaged_netcdf_3(self):
        for fmt in FORMATS[2:]:
            self.write(numbers((3, 4, 5), "i2"), "i2", fmt, unlimited="z", coordinates={"y": range(4)},
                       attributes={"scale_factor": 2.0})
            whole = self.path.read_bytes()
            for i in range(100):
                data = bytearray(whole)
                for _ in range(RANDOM.integers(1, 4)):
                    data[RANDOM.integers(len(data))] = RANDOM.integers(256)
                if i % 4 == 0:
                    del data[RANDOM.integers(len(data)):]
                self.path.write_bytes(data)
                done = self.preprocess("--memory", "256M")
                self.assertIn(done.returncode, (0, 2, 3, 4, 5, 6, 7), (i, done.stderr))


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1])
