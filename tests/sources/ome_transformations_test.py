#!/usr/bin/env python3
"""OME-Zarr's coordinate transformations: where nodes lie, compared with NumPy's product of the matrices.

usage: ome_transformations_test.py ISONEST PLUGIN_FOLDER
"""
import itertools
import json
import pathlib
import shutil
import sys
import unittest

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1] / "support"))
import served  # noqa: E402

try:
    import numpy as np
    from volume_inputs import ISONEST, RANDOM, Input, numbers
    from zarr_writer import V3
except ImportError as error:
    print(f"skipped: {error}")
    sys.exit(77)

SIZES = {"t": 2, "c": 3, "z": 5, "y": 6, "x": 7}
KINDS = {"t": "time", "c": "channel"}


def described(axes, unit=None):
    return [{"name": a, "type": KINDS.get(a, "space"), **({"unit": unit} if unit and a in "xyz" else {})} for a in axes]


def homogeneous(one, count):
    """The matrix of a transformation of `count` axes."""
    matrix = np.eye(count + 1)
    if one["type"] == "scale":
        matrix[:count, :count] = np.diag(one["scale"])
    elif one["type"] == "translation":
        matrix[:count, count] = one["translation"]
    elif one["type"] == "affine":
        matrix[:count] = one["affine"]
    elif one["type"] == "rotation":
        matrix[:count, :count] = one["rotation"]
    elif one["type"] == "sequence":
        for inner in one["transformations"]:
            matrix = homogeneous(inner, count) @ matrix
    return matrix


def turned(degrees):
    """A rotation about (1, 2, 3), by Rodrigues' formula."""
    axis = np.array([1, 2, 3]) / np.sqrt(14)
    cross = np.array([[0, -axis[2], axis[1]], [axis[2], 0, -axis[0]], [-axis[1], axis[0], 0]])
    angle = np.radians(degrees)
    return np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross


def sheared():
    """Three steps far from a plane, and a translation."""
    steps = turned(RANDOM.uniform(20, 60)) @ np.array([[2, 0.3, -0.4], [0, 1.5, 0.2], [0, 0, 1]])
    return np.column_stack([steps, RANDOM.uniform(-9, 9, 3)])


class Transformations(Input):
    def setUp(self):
        super().setUp()
        self.path = self.here / "v.zarr"

    def image(self, of_dataset, of_image=(), *, axes="zyx", systems=None, unit=None):
        """Writes an image of these axes, with coordinate systems as in version 0.6, or without as in 0.5."""
        shutil.rmtree(self.path, ignore_errors=True)
        self.path.mkdir()
        data = numbers([SIZES[a] for a in axes], "u2")
        V3(self.path / "0", data, (4,) * len(axes))
        image = {"datasets": [{"path": "0", "coordinateTransformations": list(of_dataset)}],
                 "coordinateTransformations": list(of_image)}
        image.update({"axes": described(axes, unit)} if systems is None else {"coordinateSystems": systems})
        (self.path / "zarr.json").write_text(json.dumps({
            "zarr_format": 3, "node_type": "group",
            "attributes": {"ome": {"version": "0.5" if systems is None else "0.6", "multiscales": [image]}}}))
        return data

    def has_nodes_at(self, data, matrix, *options, rows=(2, 1, 0)):
        """Whether each node of [z, y, x] has its value, and lies at `matrix` [z, y, x, 1]; `rows`: those of x, y, z."""
        self.assertEqual(self.preprocess("--json", *options).returncode, 0)
        info = self.info()
        direction = np.array(info.get("direction", np.eye(3))).reshape(3, 3)
        steps = direction * np.array(info["spacing"])[:, None]
        values, _ = self.exported()
        self.assertEqual(values.shape, data.shape)
        places = {}
        for index in np.ndindex(*data.shape):
            z, y, x = index
            expected = (matrix @ [z, y, x, 1])[list(rows)]
            places.setdefault(int(data[index]), []).append(expected)
        for index in np.ndindex(*values.shape):
            z, y, x = index
            found = np.array(info["origin"]) + x * steps[0] + y * steps[1] + z * steps[2]
            distance = min(np.abs(found - at).max() for at in places[int(values[index])])
            self.assertLess(distance, 1e-5)
        return info

    def exported(self):
        served.run([ISONEST, "export", self.here / "s.isonest", "--field", "values", "-o", self.here / "s.raw", "--force"],
                   check=True, capture_output=True)
        info = self.info()
        return np.fromfile(self.here / "s.raw", "u2").reshape(info["nodes"][::-1]), info

    def test_affine_and_rotation_after_scale_and_translation(self):
        scale = {"type": "scale", "scale": [2.0, 0.5, 0.25]}
        shift = {"type": "translation", "translation": [30.0, 20.0, 10.0]}
        for number in range(6):
            affine = {"type": "affine", "affine": sheared().tolist()}
            if number % 2:  # left-handed
                affine["affine"][0] = [-n for n in affine["affine"][0]]
            rotation = {"type": "rotation", "rotation": turned(25 * number + 10).tolist()}
            for steps in ((affine,), (scale, affine), (affine, scale), (scale, shift, affine), (rotation,),
                          (scale, rotation, shift), (affine, rotation)):
                matrix = np.eye(4)
                for one in steps:
                    matrix = homogeneous(one, 3) @ matrix
                with self.subTest(number=number, steps=[one["type"] for one in steps]):
                    info = self.has_nodes_at(self.image(steps), matrix)
                    self.assertEqual(info.get("sheared", False), affine in steps)
                    sequence = {"type": "sequence", "transformations": list(steps)}
                    self.has_nodes_at(self.image((), (sequence,)), matrix)

    def test_an_affine_along_the_axes_is_a_scale(self):
        data = self.image(({"type": "affine", "affine": [[2, 0, 0, 30], [0, 0.5, 0, 20], [0, 0, 0.25, 10]]},))
        self.reads(data)
        self.lies([10, 20, 30], [0.25, 0.5, 2])
        self.assertEqual(json.loads(self.preprocess("--json").stdout).get("notes", []), [])

    def test_coordinate_systems_name_the_coordinates(self):
        for order in ("zyx", "xyz", "yzx"):
            systems = [{"name": "own", "axes": described("zyx", "micrometer")}, {"name": "world", "axes": described(order, "millimeter")}]
            affine = {"type": "affine", "affine": sheared().tolist(), "input": "own", "output": "world"}
            scale = {"type": "scale", "scale": [3, 2, 1], "input": "0", "output": "own"}
            rows = [order.index(a) for a in "xyz"]
            with self.subTest(order=order):
                matrix = homogeneous(affine, 3) @ homogeneous(scale, 3)
                info = self.has_nodes_at(self.image((scale,), (affine,), systems=systems), matrix, rows=rows)
                self.assertEqual(info["unit"], "mm")

    def test_the_transformations_of_an_image_are_alternatives_since_0_6(self):
        systems = [{"name": n, "axes": described("zyx")} for n in ("own", "one", "two")]
        scale = {"type": "scale", "scale": [3, 2, 1], "input": {"path": "0"}, "output": {"name": "own"}}
        one, two = ({"type": "translation", "translation": [n, n, n], "input": {"name": "own"}, "output": {"name": name}}
                    for n, name in ((5, "one"), (7, "two")))
        self.image((scale,), (one, two), systems=systems)
        notes = " ".join(json.loads(self.preprocess("--json").stdout)["notes"])
        self.assertRegex(notes, "one.*two")
        self.lies([5, 5, 5], [1, 2, 3])
        # Positions of an array get their axes from the coordinates.
        systems = [{"name": "array", "axes": [{"name": f"dim_{i}", "type": "array"} for i in range(3)]},
                   {"name": "physical", "axes": described("zyx", "nanometer")}]
        identity = {"type": "identity", "input": "0", "output": "array"}
        data = self.image((identity,), ({**scale, "input": "array", "output": "physical"},), systems=systems)
        self.reads(data)
        self.lies([0, 0, 0], [1, 2, 3])
        self.assertEqual(self.info()["unit"], "nm")
        self.image((identity,), ({**scale, "input": "elsewhere", "output": "physical"},), systems=systems)
        self.refuses(5, "elsewhere", "array")

    def test_an_affine_with_time_and_channels(self):
        axes = "tczyx"
        matrix = np.eye(6)
        matrix[2:5, 2:5] = sheared()[:, :3]
        matrix[2:5, 5] = 1, 2, 3
        matrix[2:5, 0] = 0.5, 0.25, -0.5  # the stage moves with the time
        affine = {"type": "affine", "affine": matrix[:5].tolist()}
        data = self.image((affine,), axes=axes)
        for t, c in itertools.product(range(2), range(3)):
            with self.subTest(t=t, c=c):
                of_volume = np.eye(4)
                of_volume[:3, :3] = matrix[2:5, 2:5]
                of_volume[:3, 3] = matrix[2:5] @ [t, c, 0, 0, 0, 1]
                self.has_nodes_at(np.ascontiguousarray(data[t, c]), of_volume, "--index", f"t={t},c={c}")
        matrix[0, 4] = 1
        self.image(({"type": "affine", "affine": matrix[:5].tolist()},), axes=axes)
        self.refuses(5, "changes coordinate 0", options=("--index", "t=0,c=0"))

    def test_what_is_wrong_or_not_supported(self):
        right = sheared().tolist()
        deep = {"type": "identity"}
        for _ in range(20):
            deep = {"type": "sequence", "transformations": [deep]}
        for wrong in ({"type": "affine"}, {"type": "affine", "affine": right[:2]}, {"type": "affine", "affine": [*right, right[0]]},
                      {"type": "affine", "affine": [row[:3] for row in right]}, {"type": "affine", "affine": [row + [0] for row in right]},
                      {"type": "affine", "affine": [*right[:2], ["1", 2, 3, 4]]}, {"type": "affine", "affine": 3},
                      {"type": "affine", "affine": sum(right, [])}, {"type": "affine", "affine": [*right[:2], None]},
                      {"type": "affine", "path": "matrix"}, {"type": "rotation", "rotation": right},
                      {"type": "scale", "scale": [1, 2]}, {"type": "scale", "scale": [1, 2, None]}, {"type": "scale", "path": "s"},
                      {"type": "mapAxis", "mapAxis": [0, 2, 1]}, {"type": "displacements", "path": "d"}, {"type": "sequence"},
                      {"type": "byDimension", "transformations": []}, {}, 5, deep):
            with self.subTest(wrong=wrong):
                self.image((wrong,))
                self.refuses(5, "coordinateTransformations", "is not supported; ")
        # Steps in a plane, and of no length.
        self.image(({"type": "affine", "affine": [[1, 0, 1, 0], [0, 1, 1, 0], [1, 1, 2, 0]]},))
        self.refuses(5, "plane")
        self.image(({"type": "affine", "affine": [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 0, 0]]},))
        self.refuses(4)


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1])
