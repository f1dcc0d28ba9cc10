#!/usr/bin/env python3
"""Series: preprocess --times and --append, and commands that read a series, compared with the same commands on the
store of each step.

usage: series_test.py ISONEST PLUGIN_FOLDER
"""
import json
import os
import pathlib
import random
import shutil
import subprocess
import sys
import tempfile
import time
import unittest
import xml.etree.ElementTree

HERE = pathlib.Path(__file__).resolve()
sys.path.insert(0, str(HERE.parents[1] / "support"))
import served  # noqa: E402

import h5py
import numpy as np

ISONEST = sys.argv[1]
os.environ["HDF5_PLUGIN_PATH"] = sys.argv[2]
SHAPE = 11, 14, 17  # z, y, x


def run(*arguments, cwd=None):
    return served.run([ISONEST, *map(str, arguments)], capture_output=True, text=True, cwd=cwd)


def ok(*arguments, cwd=None):
    done = run(*arguments, cwd=cwd)
    assert done.returncode == 0, (arguments, done.stderr)
    return done


def report(*arguments, cwd=None):
    return json.loads(ok(*arguments, "--json", cwd=cwd).stdout)


def ball(radius, shape=SHAPE):
    z, y, x = np.indices(shape, np.float32)
    return (radius - np.hypot(np.hypot(x - 8, y - 6.3), z - 5.1)).astype("<f4")


def write_nrrd(path, values, more=""):
    sizes = " ".join(map(str, reversed(values.shape)))
    kind = {"f4": "float", "u1": "uchar"}[values.dtype.str[1:]]
    path.write_bytes(f"NRRD0004\ntype: {kind}\ndimension: {values.ndim}\nsizes: {sizes}\nendian: little\n{more}"
                     "encoding: raw\n\n".encode() + values.tobytes())
    return path


def write_netcdf4(path, values, times, unit="hours since 2020-01-01"):
    """As xarray writes it: dimension scales, an unlimited axis of times."""
    with h5py.File(path, "w") as file:
        data = file.create_dataset("u", data=values, maxshape=(None, *values.shape[1:]), chunks=(1, *values.shape[1:]))
        axes = {"time": np.asarray(times, "f8"), "z": np.arange(values.shape[1]) * 0.5, "y": np.arange(values.shape[2]) * 2.0,
                "x": np.arange(values.shape[3]) * 1.0}
        for i, (name, numbers) in enumerate(axes.items()):
            file[name] = numbers
            file[name].make_scale(name)
            file[name].attrs["units"] = unit if name == "time" else "mm"
            data.dims[i].attach_scale(file[name])
    return path


class Case(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory(prefix="isonest-test-")
        self.addCleanup(folder.cleanup)
        self.here = pathlib.Path(folder.name)

    def inputs(self, count=3, name="run_{:03}.nrrd"):
        return [write_nrrd(self.here / name.format(i), ball(3 + 0.7 * i)) for i in range(count)]

    def series(self, *more, count=3):
        ok("preprocess", *self.inputs(count), "--times", "auto", "-o", self.here / "run", *more)
        return self.here / "run"

    def index(self, series):
        return json.loads((series / "series.json").read_text())

    def times(self, series):
        return [step["time"] for step in self.index(series)["steps"]]

    def refused(self, code, words, *arguments):
        done = run(*arguments)
        self.assertEqual(done.returncode, code, done.stderr)
        for word in [words] if isinstance(words, str) else words:
            self.assertIn(word, done.stderr)
        return done


class Making(Case):
    def test_each_step_is_the_store_of_its_input(self):
        inputs = self.inputs()
        made = report("preprocess", *inputs, "--times", "auto", "-o", self.here / "run.isonest")
        self.assertEqual([step["time"] for step in made["steps"]], [0, 1, 2])
        self.assertEqual(made["times_from"], "the numbers in the file names")
        index = self.index(self.here / "run.isonest")
        self.assertEqual((index["format"], index["version"], index["time_unit"]), ("isonest series", 1, None))
        for i, (volume, step) in enumerate(zip(inputs, index["steps"])):
            ok("preprocess", volume, "-o", self.here / f"own{i}.isonest")
            self.assertEqual((self.here / "run.isonest" / step["store"]).read_bytes(), (self.here / f"own{i}.isonest").read_bytes())
        self.assertEqual({path.name for path in (self.here / "run.isonest").iterdir()},
                         {"series.json"} | {step["store"] for step in index["steps"]})

    def test_several_volumes_are_a_series_by_themselves(self):
        files = [write_nrrd(self.here / f"own_{i}.nrrd", ball(6 + i)) for i in (2, 0, 1)]
        ok("preprocess", *files, "-o", self.here / "own")
        ok("preprocess", *files, "--times", "auto", "-o", self.here / "asked")
        self.assertEqual((self.here / "own/series.json").read_bytes(), (self.here / "asked/series.json").read_bytes())
        self.assertEqual([step["time"] for step in json.loads((self.here / "own/series.json").read_text())["steps"]], [0, 1, 2])
        # Not if one of them is something else.
        (self.here / "own_3.nrrd").write_bytes(bytes(100))
        self.assertNotEqual(run("preprocess", *files, self.here / "own_3.nrrd", "-o", self.here / "other").returncode, 0)
        self.assertFalse((self.here / "other").exists())

    def test_names_whose_numbers_are_no_times(self):
        for name in ("2020-02-02", "2020-01-31", "c2.9", "c2.10"):
            write_nrrd(self.here / f"{name}.nrrd", ball(3))
        made = report("preprocess", self.here / "2020-01-31.nrrd", self.here / "2020-02-02.nrrd", "-o", self.here / "dates")
        self.assertEqual(([step["time"] for step in made["steps"]], made["times_from"]), ([0, 1], "counted from 0"))
        self.assertIn("2020-01-31", made["steps"][0]["input"])
        self.refused(2, "--times", "preprocess", self.here / "c2.9.nrrd", self.here / "c2.10.nrrd", "-o", self.here / "c")

    def test_large_times_are_not_mistaken_for_their_neighbours(self):
        first = 1_700_000_000
        inputs = self.inputs(4)
        ok("preprocess", *inputs, "--times", ",".join(str(first + 1 + i) for i in (0, 2, 3, 4)), "-o", self.here / "run")
        chosen = lambda times: [step["time"] - first for step in  # noqa: E731
                                report("extract", self.here / "run", "--iso", "0.5", "--times", times, "-o", self.here / "m_{step}.ply")["steps"]]
        self.refused(2, "nearest", "extract", self.here / "run", "--iso", "0.5", "--times", first + 2, "-o", self.here / "m_{step}.ply")
        self.assertEqual(chosen(f"{first + 1}"), [1])
        self.assertEqual(chosen(f"{first + 1}:{first + 2}"), [1])
        self.assertEqual(chosen(f"{first + 3}:{first + 4}"), [3, 4])
        for times in (":-5", "1e20::1", "0:1e300:1e-300"):
            self.refused(2, "--times", "preprocess", *inputs, f"--times={times}", "-o", self.here / "other")

    def test_times_from_names_are_sorted(self):
        for i in (10, 9, 0.5):
            write_nrrd(self.here / f"t{i}.nrrd", ball(3))
        made = report("preprocess", *sorted(self.here.glob("t*")), "--times", "auto", "-o", self.here / "run")
        self.assertEqual([step["time"] for step in made["steps"]], [0.5, 9, 10])

    def test_times_that_are_counted(self):
        for name in "cab":
            write_nrrd(self.here / f"{name}.nrrd", ball(3))
        made = report("preprocess", *(self.here / f"{n}.nrrd" for n in "cab"), "--times", "auto", "-o", self.here / "run")
        self.assertEqual(([pathlib.Path(s["input"]).stem for s in made["steps"]], made["times_from"]), (list("cab"), "counted from 0"))

    def test_times_that_are_given(self):
        inputs = self.inputs()
        for text, expected in (("0.1,0.25,7", [0.1, 0.25, 7]), ("5:6:0.5", [5, 5.5, 6]), ("1::2", [1, 3, 5]), ("0:0.2:0.1", [0, 0.1, 0.2])):
            made = report("preprocess", *inputs, "--times", text, "-o", self.here / f"run {text}")
            np.testing.assert_allclose([step["time"] for step in made["steps"]], expected, rtol=1e-15)
        for text, words in (("1,2", "3 steps"), ("0:5:1", "6 times"), ("3,2,1", "ascend"), ("1,1,2", "ascend"), ("x", "--times"),
                            ("0:1:-1", "STEP > 0"), ("nan,1,2", "--times")):
            self.refused(2, words, "preprocess", *inputs, "--times", text, "-o", self.here / "refused")
        self.assertFalse((self.here / "refused").exists())

    def test_times_of_netcdf4(self):
        values = np.stack([ball(3 + i / 2) for i in range(4)])
        file = write_netcdf4(self.here / "run.nc", values, [0, 0.5, 2, 6])
        made = report("preprocess", file, "--index", "time=:", "--times", "auto", "-o", self.here / "run")
        self.assertEqual((made["times_from"], made["time_unit"]), ("the coordinates in the input", "hours since 2020-01-01"))
        self.assertEqual(self.times(self.here / "run"), [0, 0.5, 2, 6])
        for i in range(4):
            ok("preprocess", file, "--index", f"time={i}", "-o", self.here / f"own{i}.isonest")
            self.assertEqual((self.here / f"run/step_{i:06}.isonest").read_bytes(), (self.here / f"own{i}.isonest").read_bytes())
        # A file for each step, in another order.
        files = [write_netcdf4(self.here / f"{name}.nc", values[i:i + 1], [t]) for i, (name, t) in enumerate(zip("dbca", (0, 0.5, 2, 6)))]
        ok("preprocess", *sorted(files), "--times", "auto", "-o", self.here / "files")
        self.assertEqual(self.times(self.here / "files"), [0, 0.5, 2, 6])
        other = write_netcdf4(self.here / "other.nc", values[:1], [9], "days since 2020-01-01")
        self.refused(2, "days since", "preprocess", other, "--times", "auto", "--append", "-o", self.here / "files")
        ok("preprocess", other, "--times", "216", "--append", "-o", self.here / "files")
        self.assertEqual(self.times(self.here / "files")[-1], 216)

    def test_times_of_netcdf3(self):
        try:
            from scipy.io import netcdf_file
        except ImportError:
            self.skipTest("scipy is missing")
        with netcdf_file(self.here / "run.nc", "w") as file:
            for name, length in (("time", None), ("z", SHAPE[0]), ("y", SHAPE[1]), ("x", SHAPE[2])):
                file.createDimension(name, length)
            times = file.createVariable("time", "f8", ("time",))
            times.units = "s"
            data = file.createVariable("u", "f4", ("time", "z", "y", "x"))
            for i, t in enumerate((0, 1.5, 2)):
                times[i] = t
                data[i] = ball(3 + i)
        made = report("preprocess", self.here / "run.nc", "--index", "time=:", "--times", "auto", "-o", self.here / "run")
        self.assertEqual(([step["time"] for step in made["steps"]], made["time_unit"]), ([0, 1.5, 2], "s"))

    def test_steps_of_other_formats(self):
        """Times without coordinates are counted."""
        write_nrrd(self.here / "four.nrrd", np.stack([ball(3), ball(4)]), "labels: \"x\" \"y\" \"z\" \"t\"\nkinds: domain domain domain time\n")
        made = report("preprocess", self.here / "four.nrrd", "--index", "t=:", "--times", "auto", "-o", self.here / "run")
        self.assertEqual(([step["time"] for step in made["steps"]], made["times_from"]), ([0, 1], "counted from 0"))
        made = report("preprocess", self.here / "four.nrrd", "--index", "t=1", "--times", "7", "-o", self.here / "one")
        self.assertEqual([step["time"] for step in made["steps"]], [7])
        np.save(self.here / "four.npy", np.stack([ball(3), ball(4)]))  # no names of axes
        self.refused(2, "no axis 't'", "preprocess", self.here / "four.npy", "--index", "t=:", "--times", "auto", "-o", self.here / "x")
        for i in range(2):
            ok("preprocess", self.here / "four.npy", "--index", f"0={i}", "--times", str(i), "--append", "-o", self.here / "npy")
        self.assertEqual(self.times(self.here / "npy"), [0, 1])

    def test_times_of_zarr(self):
        """As xarray writes it, without a library: uncompressed arrays beside each other."""
        group = self.here / "run.zarr"
        arrays = {"u": (np.stack([ball(3 + i) for i in range(3)]), ["time", "z", "y", "x"], {}),
                  "time": (np.array([0, 0.25, 2.5]), ["time"], {"units": "s"})}
        group.mkdir()
        (group / ".zgroup").write_text('{"zarr_format": 2}')
        for name, (values, axes, attributes) in arrays.items():
            (group / name).mkdir()
            (group / name / ".zarray").write_text(json.dumps({
                "zarr_format": 2, "shape": values.shape, "chunks": values.shape, "dtype": values.dtype.str, "compressor": None, "fill_value": None,
                "order": "C", "filters": None}))
            (group / name / ".zattrs").write_text(json.dumps({"_ARRAY_DIMENSIONS": axes, **attributes}))
            (group / name / ".".join("0" * values.ndim)).write_bytes(values.tobytes())
        made = report("preprocess", group, "--index", "time=:", "--times", "auto", "-o", self.here / "run")
        self.assertEqual(([step["time"] for step in made["steps"]], made["time_unit"]), ([0, 0.25, 2.5], "s"))
        (group / "time/.zarray").write_text("{")  # the volume can be read all the same
        made = report("preprocess", group, "--index", "time=:", "--times", "auto", "-o", self.here / "counted")
        self.assertEqual(made["times_from"], "counted from 0")

    def test_different_grids_are_refused_by_name(self):
        first = write_nrrd(self.here / "a1.nrrd", ball(3))
        others = {
            "nodes": write_nrrd(self.here / "a2.nrrd", ball(3, (11, 14, 18))),
            "values": write_nrrd(self.here / "a3.nrrd", ball(3).astype("u1")),
            "spacing": write_nrrd(self.here / "a4.nrrd", ball(3), "spacings: 1 1 2\n"),
            "origin": write_nrrd(self.here / "a5.nrrd", ball(3), "space dimension: 3\nspace directions: (1,0,0) (0,1,0) (0,0,1)\nspace origin: (1,0,0)\n"),
        }
        for word, other in others.items():
            self.refused(2, (str(other), f"its {word}"), "preprocess", first, other, "--times", "auto", "-o", self.here / "run")
            self.assertFalse((self.here / "run").exists())
        ok("preprocess", first, "--times", "auto", "-o", self.here / "run")
        for word, other in others.items():
            self.refused(2, (str(other), f"its {word}"), "preprocess", other, "--append", "-o", self.here / "run")
        self.assertEqual(self.times(self.here / "run"), [1])

    def test_refusals(self):
        inputs = self.inputs()
        series = self.series()
        self.refused(2, "--append", "preprocess", *inputs, "--times", "auto", "-o", series)
        self.refused(2, "--append", "preprocess", inputs[0], "-o", series)
        self.refused(2, "--force", "preprocess", *inputs, "--times", "auto", "--force", "-o", series)
        self.refused(2, "standard input", "preprocess", "-", "--times", "auto", "-o", self.here / "x")
        self.refused(3, "missing.nrrd", "preprocess", inputs[0], self.here / "missing.nrrd", "--times", "auto", "-o", self.here / "x")
        (self.here / "full").mkdir()
        (self.here / "full/file").write_text("")
        self.refused(2, "not an empty folder", "preprocess", *inputs, "--append", "-o", self.here / "full")
        self.refused(3, "folder", "preprocess", *inputs, "--append", "-o", self.here / "none/run")
        self.refused(2, "one step", "preprocess", series, "-o", self.here / "x.isonest")
        self.assertFalse((self.here / "x").exists())
        # A first step that fails leaves nothing.
        (self.here / "short.nrrd").write_bytes(inputs[0].read_bytes()[:-100])
        self.assertNotEqual(run("preprocess", self.here / "short.nrrd", "--times", "0", "-o", self.here / "x").returncode, 0)
        self.assertFalse((self.here / "x").exists())

    def test_labels_planes_and_odd_sizes(self):
        for shape in ((1, 9, 12), (1, 1, 5), (2, 3, 1), (1, 1, 1), (65, 3, 2)):
            inputs = [write_nrrd(self.here / f"s{i}.nrrd", ball(3 + i, shape)) for i in range(2)]
            series = self.here / f"run{shape}"
            ok("preprocess", *inputs, "--times", "auto", "-o", series)
            ok("preprocess", *inputs, "--times", "auto", "--append", "-o", series)
            inputs.append(write_nrrd(self.here / "s2.nrrd", ball(5, shape)))
            ok("preprocess", inputs[2], "--append", "-o", series)
            self.assertEqual(self.times(series), [0, 1, 2])
            ok("check", series)
        for i in range(2):
            np.save(self.here / f"l{i}.npy", (ball(3 + i) > 0).astype("i8") * (2 ** 40 + i))
        ok("preprocess", self.here / "l0.npy", self.here / "l1.npy", "--labels", "--times", "auto", "-o", self.here / "labels")
        np.save(self.here / "l2.npy", (ball(5) > 0).astype("i8"))
        ok("preprocess", self.here / "l2.npy", "--labels", "--append", "-o", self.here / "labels")
        self.assertEqual(report("info", self.here / "labels")["labels"], True)


class Appending(Case):
    def test_steps_are_added_and_known_ones_skipped(self):
        inputs = self.inputs(5)
        series = self.here / "run"
        self.assertEqual(len(report("preprocess", *inputs[:2], "--append", "-o", series)["steps"]), 2)
        before = (series / "step_000000.isonest").stat().st_mtime_ns
        made = report("preprocess", *inputs, "--append", "-o", series)
        self.assertEqual((made["skipped"], [step["step"] for step in made["steps"]]), (2, [2, 3, 4]))
        self.assertEqual((series / "step_000000.isonest").stat().st_mtime_ns, before)
        made = report("preprocess", *inputs, "--append", "-o", series)
        self.assertEqual((made["skipped"], made["steps"]), (5, []))
        self.assertEqual(self.times(series), [0, 1, 2, 3, 4])

    def test_a_changed_input_is_refused(self):
        inputs = self.inputs()
        series = self.series()
        write_nrrd(inputs[1], ball(5))
        self.refused(2, (str(inputs[1]), "another step at its time, 1"), "preprocess", *inputs, "--append", "-o", series)

    def test_earlier_times_are_refused(self):
        inputs = self.inputs()
        series = self.here / "run"
        ok("preprocess", inputs[0], inputs[2], "--times", "auto", "-o", series)
        self.refused(2, ("earlier than that of the last step", "2 steps are complete"), "preprocess", inputs[1], "--append", "-o", series)

    def test_counted_times_continue(self):
        for name in "abcd":
            write_nrrd(self.here / f"{name}.nrrd", ball(3 + ord(name) % 5))
        series = self.here / "run"
        ok("preprocess", self.here / "a.nrrd", self.here / "b.nrrd", "--append", "-o", series)
        ok("preprocess", self.here / "c.nrrd", "--append", "-o", series)
        made = report("preprocess", *(self.here / f"{n}.nrrd" for n in "abcd"), "--append", "-o", series)
        self.assertEqual((made["skipped"], self.times(series)), (3, [0, 1, 2, 3]))

    def test_a_file_that_grows(self):
        values = np.stack([ball(3 + i / 2) for i in range(5)])
        file = self.here / "run.nc"
        for count in (2, 2, 5):
            write_netcdf4(file, values[:count], range(count))
            ok("preprocess", file, "--index", "time=:", "--append", "-o", self.here / "run")
        self.assertEqual(self.times(self.here / "run"), [0, 1, 2, 3, 4])
        values[1] += 1
        write_netcdf4(file, values, range(5))
        self.refused(2, "another step at its time", "preprocess", file, "--index", "time=:", "--append", "-o", self.here / "run")

    def test_only_one_run_adds_steps(self):
        import fcntl
        series = self.series()
        folder = os.open(series, os.O_RDONLY)
        fcntl.flock(folder, fcntl.LOCK_EX)
        self.refused(6, "another run", "preprocess", self.here / "run_000.nrrd", "--append", "-o", series)
        ok("info", series)
        os.close(folder)
        ok("preprocess", self.here / "run_000.nrrd", "--append", "-o", series)

    def test_killed_runs_are_continued(self):
        rng = random.Random(5)
        noise = np.random.default_rng(5)
        inputs = [write_nrrd(self.here / f"n{i}.nrrd", noise.random((30, 31, 33), np.float32)) for i in range(8)]
        command = [ISONEST, "preprocess", *map(str, inputs), "--append", "-q", "--chunk", "8", "-o"]
        whole = self.here / "whole"
        start = time.monotonic()
        subprocess.run([*command, whole], check=True)
        seconds = time.monotonic() - start
        killed = 0
        for attempt in range(6):
            series = self.here / f"run{attempt}"
            for _ in range(4):
                process = subprocess.Popen([*command, series], stderr=subprocess.DEVNULL)
                time.sleep(rng.uniform(0.1, 0.7) * seconds)
                process.kill()
                killed += process.wait() == -9
                if (series / "series.json").exists():
                    for i, step in enumerate(self.index(series)["steps"]):
                        self.assertEqual((series / step["store"]).read_bytes(), (whole / f"step_{i:06}.isonest").read_bytes())
            subprocess.run([*command, series], check=True, stderr=subprocess.DEVNULL)
            self.assertEqual((series / "series.json").read_bytes(), (whole / "series.json").read_bytes())
            for i in range(8):
                self.assertEqual((series / f"step_{i:06}.isonest").read_bytes(), (whole / f"step_{i:06}.isonest").read_bytes())
        self.assertGreater(killed, 3)

    def test_interrupt(self):
        noise = np.random.default_rng(5)
        inputs = [write_nrrd(self.here / f"n{i}.nrrd", noise.random((60, 61, 63), np.float32)) for i in range(8)]
        series = self.here / "run"
        process = subprocess.Popen([ISONEST, "preprocess", *map(str, inputs), "--append", "--chunk", "8", "-o", series],
                                   stderr=subprocess.PIPE, stdout=subprocess.DEVNULL, text=True)
        while not (series / "step_000001.isonest").exists() and process.poll() is None:
            time.sleep(0.002)
        process.send_signal(2)
        error = process.communicate()[1]
        if process.returncode == 130:
            self.assertIn("--append", error)
            steps = self.index(series)["steps"]
            self.assertEqual({path.name for path in series.iterdir()} - {step["store"] for step in steps}, {"series.json"})
            ok("check", series)
        ok("preprocess", *inputs, "--append", "--chunk", "8", "-o", series)
        self.assertEqual(len(self.times(series)), 8)


class Reading(Case):
    def test_meshes_are_those_of_the_stores(self):
        series = self.series()
        for end in ("vtp", "ply", "stl", "obj", "glb", "vtkhdf", "3mf"):
            out = self.here / end
            out.mkdir()
            found = report("extract", series, "--iso", "0.5", "--error", "2%", "-o", out / f"s_{{time}}.{end}")
            self.assertEqual([step["time"] for step in found["steps"]], [0, 1, 2])
            for i in range(3):
                ok("extract", series / f"step_{i:06}.isonest", "--iso", "0.5", "--error", "2%", "-o", self.here / f"own.{end}")
                self.assertEqual((out / f"s_{i}.{end}").read_bytes(), (self.here / f"own.{end}").read_bytes())
                self.assertGreater(found["steps"][i]["triangles"], 10)
            files = {path.name for path in out.iterdir()} - {f"s_{i}.{end}" for i in range(3)}
            self.assertEqual(files, {"vtp": {"s.pvd"}, "3mf": set()}.get(end, {f"s.{end}.series"}))
            self.assertEqual({pathlib.Path(name).name for name in found["index"]}, files)

    def test_the_collection_names_the_meshes(self):
        series = self.series()
        ok("extract", series, "--iso", "0.5", "--times", "1:", "-o", "a&b <{step}>_{time}.vtp", cwd=self.here)
        root = xml.etree.ElementTree.parse(self.here / "a&b.pvd").getroot() if (self.here / "a&b.pvd").exists() else \
            xml.etree.ElementTree.parse(next(self.here.glob("*.pvd"))).getroot()
        self.assertEqual((root.tag, root.get("type")), ("VTKFile", "Collection"))
        sets = root.findall("Collection/DataSet")
        self.assertEqual([float(entry.get("timestep")) for entry in sets], [1, 2])
        for entry in sets:
            self.assertTrue((self.here / entry.get("file")).is_file(), entry.get("file"))
        ok("extract", series, "--iso", "0.5", "-o", self.here / "{time}.ply")
        index = json.loads((self.here / "run.ply.series").read_text())
        self.assertEqual(index["file-series-version"], "1.0")
        self.assertEqual([(entry["name"], entry["time"]) for entry in index["files"]], [(f"{i}.ply", i) for i in range(3)])

    def test_several_isovalues(self):
        series = self.series()
        ok("extract", series, "--iso", "0.5,1", "-o", self.here / "s_{iso}_{step}.vtp")
        for iso in ("0.5", "1"):
            root = xml.etree.ElementTree.parse(self.here / f"s_{iso}.pvd").getroot()
            self.assertEqual([entry.get("file") for entry in root.iter("DataSet")], [f"s_{iso}_{i:06}.vtp" for i in range(3)])
            self.assertTrue((self.here / f"s_{iso}_000002.vtp").is_file())
        ok("extract", series, "--iso", "0.5,1", "-o", self.here / "both_{step}.vtp")
        ok("extract", series / "step_000001.isonest", "--iso", "0.5,1", "-o", self.here / "own.vtp")
        self.assertEqual((self.here / "both_000001.vtp").read_bytes(), (self.here / "own.vtp").read_bytes())
        self.assertEqual(len(list(xml.etree.ElementTree.parse(self.here / "both.pvd").getroot().iter("DataSet"))), 3)

    def test_the_choice_of_times(self):
        inputs = self.inputs(7)
        ok("preprocess", *inputs, "--times", "0:0.6:0.1", "-o", self.here / "run")
        for text, expected in ((None, range(7)), ("0.3", [3]), ("0.6,0", [0, 6]), ("0.2:0.4", [2, 3, 4]), ("::0.2", [0, 2, 4, 6]),
                               ("0.1:0.5:0.2", [1, 3, 5]), ("0:0.6:0.3", [0, 3, 6]), ("0.45:", [5, 6]), (":0.1", [0, 1]),
                               ("0:1:0.25", [0, 3, 5]), ("0:100:10", [0])):
            found = report("extract", self.here / "run", "--iso", "0.5", "-o", self.here / "m_{step}.stl", *(["--times", text] if text else []))
            self.assertEqual([step["step"] for step in found["steps"]], list(expected), text)
        for text, words in (("0.35", "the nearest is at"), ("1:2", "0 to 0.6"), ("a", "--times"), ("1:2:3:4", "--times"), ("2:1", "START <= STOP"), ("0:1:0", "STEP > 0")):
            self.refused(2, words, "extract", self.here / "run", "--iso", "0.5", "-o", self.here / "m_{step}.stl", "--times", text)

    def test_names_without_a_place(self):
        series = self.series()
        self.refused(2, "mesh_{time}.vtp", "extract", series, "--iso", "0.5", "-o", self.here / "mesh.vtp")
        self.refused(2, "not in that of its folder", "extract", series, "--iso", "0.5", "-o", self.here / "{time}/mesh.vtp")
        self.refused(2, "film_{time}.png", "slice", series, "--plane", "0,0,1,4", "-o", self.here / "film.png")
        self.assertEqual(list(self.here.glob("*.vtp")), [])

    def test_a_failure_leaves_no_index(self):
        series = self.series()
        store = series / "step_000001.isonest"
        data = bytearray(store.read_bytes())
        data[len(data) // 3:len(data) // 2] = bytes(len(data) // 2 - len(data) // 3)
        store.write_bytes(data)
        done = run("extract", series, "--iso", "0.5", "-o", self.here / "s_{time}.vtp")
        self.assertNotEqual(done.returncode, 0)
        self.assertIn("step_000001", done.stderr)
        self.assertEqual(sorted(path.name for path in self.here.glob("*s*.[vp]*")), ["s_0.vtp"])
        checked = run("check", series, "--json")
        self.assertEqual(checked.returncode, 4)

    def test_slices(self):
        series = self.series()
        ok("slice", series, "--plane", "0,0,1,4", "-o", self.here / "film_{step}.png")
        ok("slice", series, "--plane", "0,0,1,4", "-o", self.here / "mesh_{time}.vtp")
        for i in range(3):
            for name, own in ((f"film_{i:06}.png", "own.png"), (f"mesh_{i}.vtp", "own.vtp")):
                ok("slice", series / f"step_{i:06}.isonest", "--plane", "0,0,1,4", "-o", self.here / own)
                self.assertEqual((self.here / name).read_bytes(), (self.here / own).read_bytes())
        self.assertEqual([path.name for path in self.here.glob("*.pvd")], ["mesh.pvd"])

    def test_missing_values(self):
        values = [ball(3 + i) for i in range(2)]
        values[0][2:4, 5] = np.nan
        values[1][:] = np.nan
        inputs = [write_nrrd(self.here / f"v{i}.nrrd", v) for i, v in enumerate(values)]
        ok("preprocess", *inputs, "--times", "auto", "-o", self.here / "run")
        found = report("extract", self.here / "run", "--iso", "0.5", "-o", self.here / "m_{time}.ply")
        self.assertGreater(found["steps"][0]["triangles"], 0)
        self.assertEqual(found["steps"][1]["triangles"], 0)
        ok("check", self.here / "run")

    def test_info_and_check(self):
        series = self.series()
        found = report("info", series)
        self.assertEqual(([step["time"] for step in found["steps"]], found["nodes"], found["type"]), ([0, 1, 2], [17, 14, 11], "float32"))
        self.assertEqual(found["file_bytes"], sum(path.stat().st_size for path in series.glob("*.isonest")))
        text = ok("info", series).stdout
        self.assertIn("3 steps", text)
        self.assertIn("step_000002.isonest", text)
        checked = report("check", series)
        self.assertEqual((checked["ok"], len(checked["steps"])), (True, 3))
        self.refused(2, "one step", "info", series, "--histogram")
        self.refused(2, "--source", "check", series, "--source", self.here / "run_000.nrrd")
        self.refused(2, "--dims", "info", series, "--dims", "2,2,2")

    def test_commands_for_one_store_say_so(self):
        series = self.series()
        for words in (["study", "--out", self.here / "s"], ["smooth", "--steps", "1", "--tau", "1", "--lambda", "1", "-o", self.here / "x.nrrd"],
                      ["export", "--field", "values", "-o", self.here / "x.nrrd"]):
            done = run(words[0], series, *words[1:])
            self.assertIn(done.returncode, (2, 5), done.stderr)
            if "no command" not in done.stderr and "build" not in done.stderr:
                self.assertIn("step_000002.isonest", done.stderr, words)
        one = series / "step_000000.isonest"
        self.refused(2, "not a series", "extract", one, "--iso", "1", "--times", "0", "-o", self.here / "m.ply")
        self.refused(2, "not a series", "slice", one, "--plane", "0,0,1,1", "--times", "0", "-o", self.here / "m.ply")

    def test_broken_indexes(self):
        series = self.series()
        good = self.index(series)
        steps = good["steps"]

        def with_step(**changes):
            return {**good, "steps": [steps[0], {**steps[1], **changes}, steps[2]]}

        def without(key):
            return {**good, "steps": [{k: v for k, v in steps[0].items() if k != key}]}

        outside = self.here / "outside.isonest"
        shutil.copy(series / steps[0]["store"], outside)
        cases = [
            (4, "not valid JSON", "{"), (4, "not valid JSON", ""), (4, "not valid JSON", '{"format": "\xff"}'.encode("latin-1")),
            (4, "format", []), (4, "format", {}), (4, "format", {**good, "format": "other"}), (4, "version", {**good, "version": "1"}),
            (4, "version", {**good, "version": 0}), (5, "version 2", {**good, "version": 2}), (4, "steps", {**good, "steps": {}}),
            (4, "time_unit", {**good, "time_unit": 3}), (4, "step 0", {**good, "steps": [7]}), (4, "store", without("store")), (4, "time", without("time")),
            (4, "time", with_step(time="1")), (4, "time", with_step(time=None)), (4, "step 1: its time, 0, is not later", with_step(time=0)),
            (4, "step 1: its time, -3, is not later", with_step(time=-3)), (4, "occurs twice", with_step(store=steps[0]["store"])),
            (4, "series' folder", with_step(store="../outside.isonest")), (4, "series' folder", with_step(store=str(outside))),
            (4, "series' folder", with_step(store="..")), (4, "series' folder", with_step(store="")), (4, "series' folder", with_step(store="a\0b")),
            (4, "source", with_step(source=3)), (3, "step_7.isonest: is missing", with_step(store="step_7.isonest")),
            (4, "not valid JSON", json.dumps(good).replace('"time": 1', '"time": 1e999')), (4, "not valid JSON", json.dumps(good).replace('"time": 1', '"time": NaN')),
            (4, "not valid JSON", "[" * 100000),
        ]
        for code, words, text in cases:
            text = text if isinstance(text, (str, bytes)) else json.dumps(text)
            (series / "series.json").write_bytes(text if isinstance(text, bytes) else text.encode())
            for command in (["info", series], ["extract", series, "--iso", "1", "-o", self.here / "m_{time}.ply"], ["check", series],
                            ["preprocess", self.here / "run_000.nrrd", "--append", "-o", series]):
                self.refused(code, words, *command)
        (series / "series.json").write_text(json.dumps({**good, "more": 1, "steps": [{**step, "more": [1]} for step in steps]}))
        self.assertEqual(len(report("info", series)["steps"]), 3)
        (series / "series.json").write_text(json.dumps({**good, "steps": []}))
        self.assertEqual(report("info", series)["steps"], [])
        self.refused(2, "no steps", "extract", series, "--iso", "1", "-o", self.here / "m_{time}.ply")
        os.remove(series / "series.json")
        os.mkfifo(series / "series.json")
        self.assertNotEqual(run("info", series).returncode, 0)

    def test_changed_bytes_of_an_index_are_refused_or_harmless(self):
        series = self.series()
        good = (series / "series.json").read_bytes()
        rng = random.Random(7)
        pieces = [b"{", b"}", b"[", b"]", b",", b'"', b"\\u0000", b"1e308", b"-", b"null", b"..", b"/", b"\xff", b"time", b"store", b"0"]
        for _ in range(150):
            data = bytearray(good)
            for _ in range(rng.randint(1, 3)):
                at = rng.randrange(len(data))
                data[at:at + rng.choice((0, 1, 5))] = rng.choice(pieces)
            (series / "series.json").write_bytes(data)
            done = run("info", series, "--json")
            self.assertIn(done.returncode, (0, 2, 3, 4, 5), (bytes(data), done.stderr))
            if done.returncode == 0:
                names = [step["store"] for step in json.loads(done.stdout)["steps"]]
                self.assertTrue(all((series / name).is_file() and "/" not in name for name in names), bytes(data))


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1] + sys.argv[3:])
