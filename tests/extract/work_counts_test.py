"""The counted work of fixed queries: shows a regression without measuring time.

Usage: work_counts_test.py ISONEST PLUGIN_FOLDER     (--record in place of the folder writes the file)

Compares with work_counts.csv. Surfaces are those of the nested grid of tetrahedra. All counts are exact except the
bytes, which also depend on the version of zstd and may differ by 5 %. The volumes are integers, so that the last bit of
a C library's exp() does not matter.
"""
import csv
import json
import pathlib
import sys
import tempfile

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1] / "support"))
import served  # noqa: E402

isonest, plugin = sys.argv[1:3]
recorded = pathlib.Path(__file__).with_name("work_counts.csv")
VOLUMES = [("bucky", "129", "uint8", "32"), ("bucky", "65", "uint8", "8"),
           ("bucky", "129", "uint16", "64"), ("noise", "97,50,71", "uint16", "16"),
           ("marschner-lobb", "65", "uint16", "16"), ("sphere", "100", "uint8", "32")]
ERRORS = ["--error-relative 0", "--error-relative 0.01", "--error-relative 0.05",
          "--indicator plus --error-relative 0.05", "--indicator estimate --error-relative 0.05"]
# From a store with the required fields; ISO is replaced.
OTHERS = ["extract --iso ISO --error-relative 0.02 --focus 20,30,25 --falloff 0.1",
          "extract --iso ISO --camera -40,30,200 --pixels 4",
          "extract --iso ISO --error-relative 0.02 --bound grad_linf_plus",
          "extract --iso ISO --stop normal_turn_plus --threshold 0.5",
          "extract --iso ISO --view 1,2,-0.5",
          "extract --iso ISO --error-relative 0.02 --view 1,2,-0.5 --cull-by grad_linf_plus",
          "slice --plane 1,2,3,170 --error-relative 0.02",
          "slice --plane 0,0,1,31 --error-relative 0"]
PLANAR = ["extract --iso ISO --error-relative 0.02", "extract --graph --error-relative 0.05"]
FIELDS = "linf_plus,deviation_bar,grad_linf_plus,normal_turn_plus"
COUNTS = ["vertices", "triangles", "visited_tetrahedra", "leaf_tetrahedra", "chunks_read"]


def run(*arguments):
    return served.run([isonest, *map(str, arguments), "--json"], capture_output=True,
                      check=True, timeout=600).stdout


rows = []
with tempfile.TemporaryDirectory(prefix="isonest-counts-") as name:
    folder = pathlib.Path(name)

    def store(volume, size, kind, chunk, *options):
        """Makes a store; returns an isovalue below the middle of its range."""
        run("make-volume", volume, "--size", size, "--type", kind, "-o", folder / "v.h5", "--force")
        report = json.loads(run("preprocess", folder / "v.h5", "-o", folder / "s.isonest", "--chunk",
                                chunk, "--force", *options))
        low, high = report["min_value"], report["max_value"]
        return str(round(low + 0.45 * (high - low)))

    def query(text, iso, *volume):
        command, *options = text.replace("ISO", iso).split()
        if command == "extract" and "--graph" not in options:
            options += ["--cells", "tet", "--effort", "none"]
        mesh = folder / ("m.obj" if volume[1].count(",") == 1 and "graph" not in text else "m.ply")
        counts = json.loads(run(command, folder / "s.isonest", *options, "-o", mesh))
        rows.append([*volume, text.replace("ISO", iso), *(str(counts[c]) for c in COUNTS),
                     str(counts["bytes_read"])])

    for volume in VOLUMES:
        iso = store(*volume, "--indicators", "linf_bar,linf_plus,deviation_bar")
        for error in ERRORS:
            query(f"extract --iso ISO {error}", iso, *volume)
    for volume in [("bucky", "97", "uint16", "16"), ("noise", "60,70,50", "uint8", "32")]:
        iso = store(*volume, "--indicators", FIELDS)
        for text in OTHERS:
            query(text, iso, *volume)
    volume = ("noise", "300,211", "uint16", "32")
    iso = store(*volume)
    for text in PLANAR:
        query(text, iso, *volume)
header = ["volume", "size", "type", "chunk", "query", *COUNTS, "bytes_read"]
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
