#!/usr/bin/env python3
"""NRRD files that other programs write, where their parser and the format's description decide: names of data files,
axes of one node, types.

usage: nrrd_input_test.py ISONEST PLUGIN_FOLDER
"""
import pathlib
import sys
import unittest

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1] / "support"))

try:
    import numpy as np
    from volume_inputs import RANDOM, Input, numbers
except ImportError as error:
    print(f"skipped: {error}")
    sys.exit(77)


class Nrrd(Input):
    def setUp(self):
        super().setUp()
        self.path = self.here / "v.nrrd"
        self.data = RANDOM.integers(0, 255, (4, 3, 2)).astype(np.uint8)

    def write(self, *lines, data=None, kind="uint8", sizes=None, body=None):
        data = self.data if data is None else data
        sizes = sizes or data.shape[::-1]
        head = ["NRRD0004", f"type: {kind}", f"dimension: {len(sizes)}", f"sizes: {' '.join(map(str, sizes))}",
                "encoding: raw", f"endian: {'big' if data.dtype.byteorder == '>' else 'little'}", *lines]
        self.path.write_bytes(("\n".join(head) + "\n\n").encode() + (data.tobytes() if body is None else body))

    def test_a_data_file_with_a_percent_sign_in_its_name_is_one_file(self):
        for name in ("50%.raw", "5%d.raw", "50% of it.raw", "%03d 1 2", "LISTED.raw"):
            with self.subTest(name=name):
                (self.here / name).write_bytes(self.data.tobytes())
                self.write(f"data file: {name}", body=b"")
                self.reads(self.data)

    def test_data_in_several_files_are_refused_as_such(self):
        for lines in (["data file: LIST", "a.raw", "b: c.raw", "#.raw"], ["data file: LIST 2", "a.raw"],
                      ["data file: v%03d.raw 1 4 1"], ["data file: v%d.raw 1 4 1 2"]):
            with self.subTest(lines=lines):
                self.write(*lines, body=b"")
                self.refuses(5, "data spread over several files")

    def test_an_axis_of_one_node_without_a_direction_gets_one_at_right_angles(self):
        data = self.data.reshape(1, 1, 24)
        for vector, step in (((0, 2, 0), 2), ((0, 0, -3), 3), ((3, 4, 0), 5), ((1, 2, 2), 3), ((2, 0, 0), 2)):
            with self.subTest(vector=vector):
                self.write("space: RAS", f"space directions: ({','.join(map(str, vector))})", sizes=(24,))
                self.reads(data)
                self.lies((0, 0, 0), (step, 1, 1))
                turn = np.array(self.directions())
                np.testing.assert_allclose(turn[0], np.array(vector) / step, atol=1e-12)
                np.testing.assert_allclose(turn @ turn.T, np.eye(3), atol=1e-12)
                self.assertAlmostEqual(np.linalg.det(turn), 1)
        # And of four axes one is long.
        self.write("space: RAS", "space directions: none (0,0,0) (0,2,0) none", sizes=(1, 1, 24, 1))
        self.reads(data)
        np.testing.assert_allclose(self.directions()[0], (0, 1, 0))
        self.write("space: RAS", "space directions: (1,0,0) (2,0,0)", data=self.data[0])
        self.refuses(5, "sheared")

    def test_an_axis_has_a_spacing_or_a_direction(self):
        directions = "space directions: (1,0,0) (0,2,0) (0,0,3) none"
        self.write(directions, "spacings: nan nan nan 2.5", sizes=(2, 3, 4, 1))
        self.reads(self.data)
        self.lies((0, 0, 0), (1, 2, 3))
        self.write(directions, "spacings: nan 2 nan 2.5", sizes=(2, 3, 4, 1))
        self.refuses(4, "axis 1", "'spacings'", "'space directions'")

    def test_the_unit_is_that_of_the_axes_with_more_than_one_node(self):
        self.write("spacings: 1 2 3", 'units: "" "km" "km"', data=self.data[:, :, :1])
        done = self.reads(self.data[:, :, :1], "--json")
        self.assertIn('"unit": "km"', done.stdout)

    def test_integers_of_64_bits_are_read_where_float64_has_them(self):
        for kind, names in (("i8", ("longlong", "long long", "signed long long int", "int64", "int64_t")),
                            ("u8", ("ulonglong", "unsigned long long", "uint64", "uint64_t"))):
            for order, name in zip("<><><", names):
                with self.subTest(name=name, order=order):
                    data = numbers((4, 3, 2), kind).astype(order + kind)
                    if kind == "i8":
                        data[0, 0, 0] = -5
                    self.write(data=data, kind=name)
                    self.reads(data.astype("f8"))
        data[1, 2, 0] = 2**53 + 1
        self.write(data=data, kind="uint64")
        self.refuses(5, "2^53")
        labels = np.full((4, 3, 2), 2**60 + 1, "<i8")
        self.write(data=labels, kind="int64")
        self.assertEqual(self.preprocess("--labels").returncode, 0)


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1])
