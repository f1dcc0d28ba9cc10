"""How often a query of a remote store waits for the network is bounded by the number of the store's levels, and not by
that of its chunks, of which it reads many more.

usage: round_trips_test.py ISONEST PLUGIN_FOLDER
"""
import json
import os
import pathlib
import shutil
import sys
import tempfile
import unittest

sys.path.insert(0, str(pathlib.Path(__file__).parents[1]))
sys.path.insert(0, str(pathlib.Path(__file__).parents[1] / "support"))
import served  # noqa: E402
from support.range_server import RangeServer  # noqa: E402

ISONEST = pathlib.Path(sys.argv[1]).resolve()
FOLDER = pathlib.Path(tempfile.mkdtemp(prefix="isonest-trips-", dir=served.MEMORY))
ENVIRONMENT = {name: value for name, value in os.environ.items()
               if not name.startswith(("AWS_", "SSL_CERT", "CURL_")) and not name.lower().endswith("_proxy")}
ENVIRONMENT["HOME"] = str(FOLDER)
FIELDS = "linf_bar,linf_plus,deviation_bar,hex_linf,hex_deviation,grad_linf_bar"
# Maximum round trips per level of the store, in addition to three for opening and the rest.
QUERIES = {
    "bucky": {
        "extract --iso 120 --error-relative 0.05 -o o.ply": 1,
        "extract --iso 120 --error-relative 0.02 --normals --vertex-error deviation_bar -o o.vtp": 2,
        "extract --iso 120 --error-relative 0.05 --vertices exact -o o.ply": 1,
        "extract --iso 120 --error-relative 0.05 --cells hex -o o.ply": 2,
        "extract --iso 120 --error-relative 0.02 --cells hex --normals --vertex-error deviation_bar -o o.vtp": 2,
        "extract --iso 120 --distance 0.5voxel --effort none -o o.ply": 2,
        "extract --iso 120 --distance 0.5voxel --effort none --normals -o o.vtp": 2,
        "slice --plane 1,2,3,300 --error-relative 0.02 --normals --vertex-error deviation_bar -o o.vtp": 2,
        "slice --plane 1,2,3,300 --error-relative 0.02 --cells hex -o o.ply": 2,
        "study --fields deviation_bar --steps 3 --iso 120 --out o": 2,
        "smooth --steps 1 --tau 1 --lambda 20 -o o.nrrd": 1,
        "export --field lp:3 -o o.npy": 1,
    },
    "map": {
        "extract --iso 120 -o o.vtp": 2, "extract --iso 120 --error-relative 0.1 -o o.vtp": 2,
        "extract --iso 120 --error-relative 0.1 --vertices exact -o o.vtp": 2,
        "extract --graph -o o.ply": 2, "extract --graph --error-relative 0.1 --normals -o o.ply": 2,
        "extract --graph --error-relative 0.1 --cells quad -o o.ply": 2, "extract --graph --cells quad -o o.ply": 2,
        "extract --iso 120 --distance 1voxel -o o.vtp": 2,
        "smooth --steps 1 --tau 1 --lambda 20 -o o.nrrd": 1,
    },
}


def report(*arguments):
    done = served.run([ISONEST, *map(str, arguments), "--json"], cwd=FOLDER, env=ENVIRONMENT, capture_output=True,
                      text=True, timeout=300)
    if done.returncode != 0:
        raise AssertionError(f"{arguments}: {done.stdout}{done.stderr}")
    return json.loads(done.stdout)


def removed_outputs():
    for path in FOLDER.glob("o*"):
        shutil.rmtree(path) if path.is_dir() else path.unlink()


_missing = served.run([ISONEST, "info", "http://127.0.0.1:1/x", "--json"], cwd=FOLDER, env=ENVIRONMENT,
                      capture_output=True, text=True)
if _missing.returncode == 5:
    print("skipped: this build reads no URLs")
    sys.exit(77)


class RoundTrips(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        report("make-volume", "bucky", "--size", "97", "--type", "uint8", "-o", "bucky.h5")
        report("make-volume", "noise", "--size", "300,260", "--type", "uint8", "-o", "map.h5")
        for name, chunk in (("bucky", 32), ("map", 16)):
            report("preprocess", f"{name}.h5", "-o", f"{name}.isonest", "--chunk", chunk, "--indicators", FIELDS)

    def require_few(self, name):
        with RangeServer(FOLDER) as server:
            server.delay = 0.01
            levels = report("info", f"{name}.isonest")["levels"]
            levels = len(levels) if isinstance(levels, list) else levels
            for query, per_level in QUERIES[name].items():
                command, *words = query.split()
                removed_outputs()
                remote = report(command, server.url(f"{name}.isonest"), *words)["remote"]
                with self.subTest(query=query, remote=remote, levels=levels):
                    self.assertLessEqual(remote["round_trips"], per_level * levels + 3)

    def test_of_a_volume(self):
        self.require_few("bucky")

    def test_of_data_in_a_plane(self):
        self.require_few("map")


try:
    unittest.main(argv=sys.argv[:1])
finally:
    shutil.rmtree(FOLDER)
