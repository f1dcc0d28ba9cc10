#!/usr/bin/env python3
"""No option is ignored: with every kind of input each one changes an output or the report, or is refused by name.

The options are those that --help lists, so one that is not in the tables below fails the test.

usage: options_test.py ISONEST PLUGIN_FOLDER
"""
import hashlib
import json
import os
import pathlib
import re
import sys
import tempfile
import unittest

HERE = pathlib.Path(__file__).resolve()
sys.path.insert(0, str(HERE.parents[1] / "support"))
import range_server  # noqa: E402
import served  # noqa: E402

import numpy as np

ISONEST = sys.argv[1]
os.environ["HDF5_PLUGIN_PATH"] = sys.argv[2]

# Options of every command that affect how it runs and how long it takes, but not the results.
PERFORMANCE = {"--memory", "--threads"}
# Tested where their effect can be seen; the named test must mention the option.
ELSEWHERE = {
    ("preprocess", "--resume"): "tests/program/kill_test.py",
    **{("view", option): "tests/view/view_trust_test.py"
       for option in ("--port", "--address", "--token", "--open")},
    ("view", "--times"): "tests/view/view_series_test.py", ("view", "--vertex-values"): "tests/view/view_quantities_test.py",
    **{("publish", option): "tests/publish/publish_test.py"
       for option in ("--link", "--hard-link", "--title", "--description", "--license", "--force", "--times")},
    **{("publish", option): "tests/publish/publish_check_test.py" for option in ("--check", "--origin")},
}

# Refusals that describe the option in words.
IN_WORDS = {
    "--graph": "graph", "--close": "closing", "--triangles": "number of triangles|no triangles", "--by": "number of triangles|no triangles",
    "--keep-analysis": "analys[ie]s", "--effort": "effort|simplified",
    "--view": "backface", "--cull-by": "backface", "--cells": "hexahedral", "--label": "labels?", "--labels": "labels?",
    "--vertex-values": "vertex values|values at the vertices", "--vertex-error": "error at the vertices",
    "--color-by": "property", "--fields": "field", "--volume-interval": "interval|closing", "--min-volume": "closing|closed",
    "--source": "nodes", "--focus": "focus", "--falloff": "focus", "--camera": "camera", "--pixels": "camera",
    "--fov": "camera", "--height": "camera", "--bound": "bound|field", "--vertices": "exact vertices",
    "--level": "level", "--box": "box", "--plane": "plane|slice", "--field": "indicator|field", "--graph-distance": "graphs?",
    "--space": "patient", "--contours": "lines", "--over": "Neuroglancer|label",
    "--up": "y up", "--mesh-unit": "another unit", "--manifold": "manifold", "--colors": "colours", "--range": "colours", "--norm": "L\\^|norm", "--iso": "isosurface|isovalue|label", "--quality": "quality",
}

STORES = ("store", "plane store", "label store", "url of a store")
VOLUMES = ("volume", "plane volume", "raw volume", "standard input", "url of a volume")

# Options for reading a volume, in every command that does. An entry: the words of the option, and the words required
# with it.
READING = {
    "--dataset": (["--dataset", "a"], []), "--series": (["--series", "1.2"], []), "--index": (["--index", "0"], []),
    "--crop": (["--crop", "1:9,:,:"], []), "--every": (["--every", "2"], []),
    "--periodic": (["--periodic", "x"], []), "--repeat": (["--repeat", "2,1,1"], ["--periodic", "x"]), "--dims": (["--dims", "5,4,3"], []),
    "--type": (["--type", "i2"], []), "--endian": (["--endian", "big"], []), "--offset": (["--offset", "4"], []),
    "--spacing": (["--spacing", "3,4,5"], []), "--origin": (["--origin", "7,8,9"], []), "--unit": (["--unit", "um"], []),
    "--frame": (["--frame", "ras"], []),
    "--missing": (["--missing", "{missing}"], []),  # a value that occurs in all of them
}
KEEP = {"--keep-store": (["--keep-store", "{out}/kept.isonest"], [])}
NETWORK = {"--header": (["--header", "X-Test: 1"], []), "--cache": (["--cache", "{out}/cache"], [])}
COARSE = {
    "--error": (["--error", "20"], []), "--error-relative": (["--error-relative", "0.2"], []),
    "--indicator": (["--indicator", "plus"], ["--error", "20"]), "--stop": (["--stop", "linf_bar"], []),
    "--threshold": (["--threshold", "20"], ["--stop", "linf_bar"]),
    "--threshold-relative": (["--threshold-relative", "0.2"], ["--stop", "linf_bar"]),
    # Alone it is the place where the error holds, which the text states.
    "--focus": (["--focus", "0,0,0", "--falloff", "1"], ["--error", "5"]), "--falloff": (["--falloff", "1"], ["--error", "5", "--focus", "0,0,0"]),
    "--camera": (["--camera", "0,0,-90", "--pixels", "60"], []), "--pixels": (["--pixels", "300"], ["--camera", "0,0,-90"]),
    "--fov": (["--fov", "170"], ["--camera", "0,0,-90", "--pixels", "30"]),
    "--height": (["--height", "9"], ["--camera", "0,0,-90", "--pixels", "30"]), "--box": (["--box", "0,0,0,9,9,9"], []),
}
OPTIONS = {
    "preprocess": {**READING, **NETWORK,
        "--output": None, "--labels": (["--labels"], []), "--label-names": (["--label-names", "{here}/names.txt"], ["--labels"]),
        "--chunk": (["--chunk", "8"], []), "--compression": (["--compression", "9"], []),
        "--indicators": (["--indicators", "l1_bar"], []), "--own": (["--own", "square={here}/other.nrrd"], []), "--tolerance": (["--tolerance", "2"], []), "--exact": (["--exact"], []), "--force": "existing",
        "--times": (["--times", "3"], []), "--append": (["--append"], [])},
    "extract": {**READING, **KEEP, **NETWORK, **COARSE,
        "--output": None, "--iso": (["--iso", "60"], []), "--graph": "graph", "--components": (["--components", "1"], []),
        "--min-component": (["--min-component", "1000"], []), "--min-volume": (["--min-volume", "500"], ["--close"]),
        "--close": (["--close"], []), "--volume-interval": (["--volume-interval"], ["--close", "--error", "5"]),
        "--scale": (["--scale", "3"], ["--graph"]), "--distance": (["--distance", "0.5voxel"], []),
        "--triangles": (["--triangles", "100"], []), "--by": (["--by", "error"], ["--triangles", "100"]),
        "--keep-analysis": (["--keep-analysis={out}"], ["--distance", "0.5voxel"]),
        "--effort": (["--effort", "fast"], ["--distance", "0.5voxel"]), "--bound": (["--bound", "linf_plus"], []),
        "--view": (["--view", "1,0,0"], ["--error", "5"]),
        "--cull-by": (["--cull-by", "grad_linf_plus"], ["--error", "5", "--view", "1,0,0"]),
        "--vertices": (["--vertices", "exact"], ["--error", "20"]), "--cells": (["--cells", "{cells}"], []),
        "--label": "label", "--labels": "label", "--smooth": (["--smooth"], []), "--keep-nodes": (["--keep-nodes"], []),
        "--interfaces": (["--interfaces"], []), "--manifold": (["--manifold"], []), "--format": (["--format", "stl"], []), "--georeference": (["--georeference", "1,2"], ["--format", "3dtiles"]), "--normals": (["--normals"], []),
        "--vertex-values": (["--vertex-values", "{here}/other.isonest"], []),
        "--vertex-error": (["--vertex-error", "deviation_bar"], []), "--quality": (["--quality"], []), "--times": (["--times", "1"], []),
        "--space": (["--space", "lps"], []), "--up": (["--up", "y"], []), "--mesh-unit": (["--mesh-unit", "m"], []),
        "--colors": (["--colors", "gray"], ["--vertex-values", "{here}/other.isonest"]),
        "--range": (["--range", "10,2000"], ["--vertex-values", "{here}/other.isonest", "--colors", "gray"]),
        "--over": (["--over", "precomputed"], ["--labels", "1", "--smooth", "--format", "neuroglancer"])},
    "slice": {**READING, **KEEP, **NETWORK, **COARSE,
        "--output": None, "--plane": (["--plane", "1,2,3,24"], []), "--cells": (["--cells", "hex"], []),
        "--normals": (["--normals"], []), "--vertex-error": (["--vertex-error", "deviation_bar"], []),
        "--size": (["--size", "100x90"], []), "--colors": (["--colors", "gray"], []), "--plain": (["--plain"], []),
        "--space": (["--space", "lps"], []), "--up": (["--up", "y"], []), "--mesh-unit": (["--mesh-unit", "m"], []), "--range": (["--range", "10,20"], []), "--grid": (["--grid"], []), "--contours": (["--contours", "50"], []), "--times": (["--times", "1"], [])},
    "study": {**NETWORK,
        "--out": None, "--fields": (["--fields", "l1_bar"], []), "--iso": (["--iso", "60"], []),
        "--plane": (["--plane", "1,2,3,24"], []), "--norm": (["--norm", "3"], []), "--graph-distance": (["--graph-distance"], []),
        "--steps": (["--steps", "3"], []), "--least": (["--least", "0.1"], [])},
    "smooth": {**READING, **NETWORK,
        "--output": None, "--steps": (["--steps", "3"], []), "--tau": (["--tau", "2"], []), "--lambda": (["--lambda", "2"], []),
        "--sigma": (["--sigma", "0"], []), "--threshold": (["--threshold", "5"], []), "--snapshots": (["--snapshots", "0"], []),
        "--grid": (["--grid", "{out}/grid.nrrd"], []), "--colors": (["--colors", "gray"], []),
        "--size": (["--size", "100x90"], []), "--force": "existing"},
    "info": {**READING, **KEEP, **NETWORK, "--labels": (["--labels"], []), "--histogram": (["--histogram"], []), "--level": (["--level", "1"], ["--histogram"]),
             "--output": (["-o", "{out}/h.svg"], ["--histogram"])},
    "export": {**NETWORK, "--field": (["--field", "linf_bar"], []), "--level": (["--level", "2"], []), "--output": None,
               "--force": "existing"},
    "check": {**READING, **NETWORK, "--quick": (["--quick"], []), "--deep": (["--deep"], []),
              "--source": (["--source", "{source}"], []), "--labels": (["--labels"], [])},
    "make-volume": {"--size": (["--size", "9"], []), "--type": (["--type", "u1"], []), "--seed": (["--seed", "2"], []),
                    "--output": None, "--force": "existing"},
    "picture": {"--output": None, "--size": (["--size", "90x80"], []), "--view": (["--view", "top"], []),
                "--turntable": (["--turntable", "2"], []), "--wireframe": (["--wireframe"], []), "--flat": (["--flat"], []),
                "--plain": (["--plain"], []), "--color-by": (["--color-by", "error"], []), "--colors": (["--colors", "gray"], []),
                "--range": (["--range", "1,2"], []), "--color": (["--color", "9,99,9"], [])},
    "view": {**READING, **KEEP, **NETWORK}, "publish": {"--output": None},
}
# Kinds of input of each command; the words that make it run, and its output.
KINDS = {
    "preprocess": VOLUMES + ("label volume",), "extract": STORES + VOLUMES,
    "slice": STORES + ("store as a mesh", "store as lines", "volume", "raw volume"), "study": STORES,
    "smooth": ("store", "plane store", "label store", "url of a store", "volume", "plane volume", "raw volume",
               "url of a volume"),
    "info": STORES + ("volume", "plane volume", "raw volume", "url of a volume"), "export": STORES, "check": STORES, "make-volume": ("noise", "sphere", "bucky", "marschner-lobb",
                                                                        "cahn-hilliard"),
    "picture": ("mesh with values", "mesh without values"), "view": ("store",), "publish": (),
}
OUTPUTS = {"preprocess": "o.isonest", "extract": "o.ply", "slice": "o.png", "study": "o", "smooth": "o.nrrd", "info": "",
           "export": "o.nrrd", "check": "", "make-volume": "o.h5", "picture": "o.png"}
BASE = {"preprocess": [], "extract": ["--iso", "50"], "slice": ["--plane", "0,0,1,4"], "study": ["--steps", "2"],
        "smooth": ["--steps", "1", "--tau", "1", "--lambda", "20"], "info": [], "export": ["--field", "values"],
        "check": [], "make-volume": ["--size", "12"], "picture": []}


def run(*arguments, stdin=None):
    command = [ISONEST, *map(str, arguments)]
    if stdin is not None:
        with open(stdin, "rb") as data:
            return served.run(command, stdin=data, capture_output=True, text=True)
    return served.run(command, capture_output=True, text=True)


def made(*arguments):
    done = run(*arguments)
    assert done.returncode == 0, (arguments, done.stderr)


def commands():
    text = run("--help").stdout
    return re.findall(r"^  ([a-z][a-z-]+) ", text[text.index("Subcommands:"):text.index("Start here:")], re.M)


def options_of(command):
    found = re.findall(r"^  (?:-\w,)?(--[a-z][a-z-]*)", run(command, "--help").stdout, re.M)
    return [option for option in found if option not in ("--help", "--json", "--quiet")]


def steady(value, out):
    """A report without the fields that vary between runs."""
    if isinstance(value, dict):
        return {key: steady(entry, out) for key, entry in value.items()
                if "seconds" not in key and key not in ("remote", "peak_cache_bytes")}
    if isinstance(value, list):
        return [steady(entry, out) for entry in value]
    return value.replace(str(out), "OUT") if isinstance(value, str) else value


class Options(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        folder = tempfile.TemporaryDirectory(prefix="isonest-test-", dir=served.MEMORY)
        cls.addClassCleanup(folder.cleanup)
        here = cls.here = pathlib.Path(folder.name)
        z, y, x = np.mgrid[0:14, 0:15, 0:17].astype("f4")
        data = 100 - 9 * np.hypot(np.hypot(x - 7, y - 7), z - 6) + 3 * np.sin(2 * x + y) * np.cos(3 * z)
        data[np.hypot(np.hypot(x - 16, y - 14), z - 13) < 1.5] = 99  # another component
        data = np.round(data)
        header = "NRRD0004\ntype: float\ndimension: 3\nsizes: 17 15 14\nendian: little\nencoding: raw\n\n"
        (here / "volume.nrrd").write_bytes(header.encode() + data.astype("<f4").tobytes())
        (here / "other.nrrd").write_bytes(header.encode() + (data * data).astype("<f4").tobytes())
        (here / "raw.raw").write_bytes(data.astype("<f4").tobytes())
        np.save(here / "plane.npy", data[6])
        np.save(here / "labels.npy", (data > 50).astype("i8") + (data > 70))
        (here / "names.txt").write_text("1 one\n2 two\n")
        for name, source, more in (("store", "volume.nrrd", ["--indicators", "all"]), ("other", "other.nrrd", []),
                                   ("plane", "plane.npy", ["--indicators", "all"]), ("labels", "labels.npy", ["--labels"])):
            made("preprocess", here / source, "-o", here / f"{name}.isonest", "--chunk", "8", "--frame", "lps", *more)
        made("extract", here / "store.isonest", "--iso", "50", "--error", "9", "-o", here / "plain.ply")
        made("extract", here / "store.isonest", "--iso", "50", "--error", "9", "-o", here / "valued.ply", "--vertex-values",
             here / "other.isonest", "--vertex-error", "linf_bar")
        cls.server = range_server.RangeServer(here).__enter__()
        cls.addClassCleanup(cls.server.__exit__, None, None, None)

    def input_of(self, kind):
        """The words for an input, and the file for standard input."""
        files = {"store as a mesh": "store.isonest", "store as lines": "store.isonest", "store": "store.isonest", "plane store": "plane.isonest", "label store": "labels.isonest",
                 "volume": "volume.nrrd", "plane volume": "plane.npy", "label volume": "labels.npy",
                 "mesh with values": "valued.ply", "mesh without values": "plain.ply"}
        if kind == "raw volume":
            return [self.here / "raw.raw", "--dims", "17,15,14", "--type", "f4"], None
        if kind == "standard input":
            return ["-"], self.here / "volume.nrrd"
        if kind.startswith("url"):
            return [self.server.url("store.isonest" if "store" in kind else "volume.nrrd")], None
        return [self.here / files[kind] if kind in files else kind], None

    def outcome(self, command, kind, words, existing=False):
        """The exit code, the text on stderr, and all outputs."""
        first, stdin = self.input_of(kind)
        given = {word for word in words if word.startswith("--")}
        if given & {"--dims", "--type"} and kind == "raw volume":  # an option is given only once
            for option in given & {"--dims", "--type"}:
                at = first.index(option)
                first = first[:at] + first[at + 2:]
        base = [str(word) for word in BASE[command]]
        if command == "extract" and kind == "label store":
            base = ["--label", "1"]
        if kind == "store as lines":
            base += ["--contours", "40"]
        for i in range(len(base) - 2, -1, -2):
            if base[i] in given or (base[i] == "--iso" and given & {"--graph", "--label", "--labels"}) or \
                    (base[i] == "--label" and given & {"--labels", "--iso", "--graph"}):
                del base[i:i + 2]
        with tempfile.TemporaryDirectory(prefix="isonest-test-", dir=served.MEMORY) as name:
            out = pathlib.Path(name)
            source = {"plane store": "plane.npy", "label store": "labels.npy"}.get(kind, "volume.nrrd")
            missing = "1" if "label" in kind else "37"
            words = [word.format(out=out, here=self.here, missing=missing, source=self.here / source, cells="hex" if "plane" in kind else "tet")
                     for word in words]
            to = out / OUTPUTS[command]
            if command == "extract" and kind in ("plane store", "plane volume") and "--graph" not in given:
                to = out / "o.vtp"
            if kind.startswith("store as"):
                to = out / ("o.vtp" if kind == "store as lines" else "o.ply")
            if to.suffix == ".png" and "--size" not in given:
                base += ["--size", "320x240"]  # small pictures are made sooner
            if existing:
                to.write_bytes(b"x")
            output = [] if OUTPUTS[command] == "" else ["--out" if command == "study" else "-o", to]
            done = run(command, *first, *base, *words, *output, "--json", stdin=stdin)
            files = {str(path.relative_to(out)): hashlib.sha256(path.read_bytes()).hexdigest()
                     for path in sorted(out.rglob("*")) if path.is_file()}
            try:
                report = steady(json.loads(done.stdout), out)
            except ValueError:
                report = done.stdout
            return done.returncode, done.stderr, (report, files)

    def entries(self, command, option):
        entry = OPTIONS[command][option]
        if entry == "existing":
            return [([option], [], True)]
        if entry == "graph":
            return [(["--graph"], [], False)]
        if entry == "label":
            return [([option, "2"], [], False)]
        return [(*entry, False)]

    def test_every_option_is_in_the_tables(self):
        self.assertEqual(set(commands()), set(OPTIONS))
        for command in commands():
            with self.subTest(command=command):
                self.assertEqual(set(options_of(command)) - PERFORMANCE, set(OPTIONS[command]) | {
                    option for of, option in ELSEWHERE if of == command})

    def test_options_tested_elsewhere(self):
        for (command, option), path in ELSEWHERE.items():
            self.assertIn(f'"{option}', (HERE.parents[2] / path).read_text(), (command, option))

    def test_view_of_a_file_takes_nothing_for_urls(self):
        for words, _ in NETWORK.values():
            done = run("view", self.here / "store.isonest", *(word.format(out=self.here) for word in words))
            self.assertEqual((done.returncode, words[0] in done.stderr), (2, True), done.stderr)

    def no_option_is_ignored(self, command):
        for kind in KINDS[command]:
            results = {}
            code, error, plain = results[()] = self.outcome(command, kind, [])
            for option in OPTIONS[command]:
                if OPTIONS[command][option] is None:
                    continue
                for words, companions, existing in self.entries(command, option):
                    with self.subTest(command=command, kind=kind, option=option):
                        key = tuple(companions), existing
                        if key not in results:
                            results[key] = self.outcome(command, kind, companions, existing)
                        before = results[key]
                        after = self.outcome(command, kind, companions + words, existing)
                        if after[0] == 0 or (command, after[0]) == ("check", 4):  # 4: a finding
                            same = before[0] == after[0] and before[2] == after[2]
                            if option == "--header" and "url" in kind:
                                continue  # what the server received: tests/remote/url_credentials_test.py
                            self.assertFalse(same, f"{option} is ignored")
                        elif code == 0 and (before[0] == 0 or before[1] != after[1]):  # otherwise it does nothing
                            named = [word.split("=")[0] for word in companions + words if word.startswith("--")]
                            said = [rf"{word}(?![a-z-])" for word in named] + [IN_WORDS[word] for word in named if word in IN_WORDS]
                            self.assertRegex(after[1], "|".join(said))


for name in OPTIONS:
    if name in BASE:
        setattr(Options, f"test_no_option_of_{name.replace('-', '_')}_is_ignored",
                lambda self, command=name: self.no_option_is_ignored(command))


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1] + sys.argv[3:])
