"""The work that fixed queries cost, counted: a regression shows without a clock.

Usage: work_counts_test.py ISONEST PLUGIN_FOLDER     (--record in place of the folder writes the file)

Compares with work_counts.csv. All counts are exact except the bytes, which depend on the version of
zstd too and may differ by 5 %. The volumes are integers, so that the last bit of a C library's exp()
does not show.
"""
import csv
import json
import pathlib
import subprocess
import sys
import tempfile

isonest, plugin = sys.argv[1:3]
recorded = pathlib.Path(__file__).with_name("work_counts.csv")
VOLUMES = [("bucky", "129", "uint8", "32"), ("bucky", "65", "uint8", "8"),
           ("bucky", "129", "uint16", "64"), ("noise", "97,50,71", "uint16", "16"),
           ("marschner-lobb", "65", "uint16", "16"), ("sphere", "100", "uint8", "32")]
QUERIES = [("deviation", "0"), ("deviation", "0.01"), ("deviation", "0.05"), ("plus", "0.05"),
           ("estimate", "0.05")]
COUNTS = ["vertices", "triangles", "visited_tetrahedra", "leaf_tetrahedra", "chunks_read"]


def run(*arguments):
    return subprocess.run([isonest, *map(str, arguments), "--json"], capture_output=True,
                          check=True, timeout=600).stdout


rows = []
with tempfile.TemporaryDirectory(prefix="isonest-counts-") as name:
    folder = pathlib.Path(name)
    for volume, size, kind, chunk in VOLUMES:
        run("make-volume", volume, "--size", size, "--type", kind, "-o", folder / "v.h5", "--force")
        report = json.loads(run("preprocess", folder / "v.h5", "-o", folder / "s.isonest", "--chunk",
                                chunk, "--force"))
        low, high = report["min_value"], report["max_value"]
        iso = str(round(low + 0.45 * (high - low)))
        for guarantee, tolerance in QUERIES:
            counts = json.loads(run("extract", folder / "s.isonest", "--iso", iso, "--guarantee",
                                    guarantee, "--error-relative", tolerance, "-o",
                                    folder / "m.ply"))
            rows.append([volume, size, kind, chunk, iso, guarantee, tolerance,
                         *(str(counts[c]) for c in COUNTS), str(counts["bytes_read"])])
header = ["volume", "size", "type", "chunk", "iso", "guarantee", "error_relative", *COUNTS,
          "bytes_read"]
if plugin == "--record":
    with open(recorded, "w", newline="") as file:
        csv.writer(file, lineterminator="\n").writerows([header, *rows])
    sys.exit(0)
with open(recorded, newline="") as file:
    expected = list(csv.reader(file))
different = 0
if expected[0] != header or len(expected) != len(rows) + 1:
    sys.exit(f"{recorded}: other columns or queries than the test's; record again with --record")
for before, now in zip(expected[1:], rows):
    close = abs(int(before[-1]) - int(now[-1])) <= 0.05 * int(before[-1])
    if before[:-1] != now[:-1] or not close:
        different += 1
        print("recorded", ",".join(before), "\n     now", ",".join(now))
sys.exit(f"{different} of {len(rows)} queries cost other work than recorded" if different else 0)
