"""extract --error E, simplified, from outside: what is refused, what is reported, and that there are fewer triangles.

Usage: simplify_error_test.py ISONEST PLUGIN_FOLDER
"""
import json
import pathlib
import sys
import tempfile

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1] / "support"))
import served  # noqa: E402

ISONEST = pathlib.Path(sys.argv[1]).resolve()
failures = []


def run(*arguments):
    return served.run([ISONEST, *map(str, arguments)], capture_output=True, text=True, timeout=300)


def require(good, what):
    if not good:
        failures.append(what)
        print("FAILED:", what, flush=True)


with tempfile.TemporaryDirectory(prefix="isonest-simplify-") as name:
    folder = pathlib.Path(name)
    store, mesh = folder / "s.isonest", folder / "m.ply"
    assert run("make-volume", "noise", "--size", 24, "-o", folder / "v.h5").returncode == 0
    assert run("preprocess", folder / "v.h5", "-o", store, "-q").returncode == 0
    extract = ["extract", store, "--iso", 0.5, "-o", mesh]

    def refused(why, *options):
        mesh.unlink(missing_ok=True)
        done = run(*extract, *options, "-q")
        require(done.returncode == 2 and why in done.stderr, f"{options}: {done}")
        require(not mesh.exists(), f"{options}: a mesh is left")

    for effort in "fast", "best":
        refused("effort", "--effort", effort)
        refused("effort", "--effort", effort, "--error", 0)
        refused("effort none", "--effort", effort, "--error", 0.1, "--focus", "1,2,3")
        refused("threshold", "--effort", effort, "--stop", "linf_bar", "--threshold", 0.1)
        refused("estimate", "--effort", effort, "--error", 0.1, "--indicator", "estimate")
    refused("effort none", "--effort", "none", "--triangles", 500)
    done = run(*extract, "--error", 0.1, "--memory", "20M")
    require(done.returncode == 7 and "give at least --memory" in done.stderr, f"20M: {done}")

    plain = json.loads(run(*extract, "--error", 0.2, "--effort", "none", "--json").stdout)
    require("nested_triangles" not in plain, "nested_triangles without simplification")
    require((plain["cells"], plain["function"]) == ("tetrahedra", "piecewise linear"), f"{plain}")
    # Surfaces that cannot be simplified are not, unless it was requested.
    for options in (["--focus", "1,2,3"], ["--camera", "-9,0,0"], ["--indicator", "estimate"]):
        report = json.loads(run(*extract, "--error", 0.2, "--json", *options).stdout)
        require("nested_triangles" not in report, f"{options}: {report}")
    for options in ([], ["--vertices", "exact"], ["--indicator", "plus"], ["--close"], ["--components", "largest"],
                    ["--box", "2,3,4.5,20,21,22"]):
        if "plus" in options:
            assert run("preprocess", folder / "v.h5", "-o", store, "-q", "--force", "--indicators",
                       "deviation_bar,linf_plus").returncode == 0
        done = run(*extract, "--error", 0.2, "--json", *options)
        require(done.returncode == 0, f"{options}: {done.stderr}")
        report = json.loads(done.stdout)
        require(0.1 < report["error_bound"] <= 0.2 and report["guaranteed"], f"{options}: {report}")
        require(report["triangles"] < report["nested_triangles"], f"{options}: nothing is simplified: {report}")
    counts = {}
    for options in (["--cells", "hex", "--effort", "best"], ["--cells", "hex", "--effort", "fast"],
                    ["--cells", "tet", "--effort", "fast"], ["--effort", "fast", "--close"]):
        report = json.loads(run(*extract, "--error", 0.2, "--json", *options).stdout)
        require(0.1 < report["error_bound"] <= 0.2 and report["guaranteed"], f"{options}: {report}")
        require(("full_error_bound" in report) == ("leaf_hexahedra" in report), f"{options}: {report}")
        counts[" ".join(options)] = report["triangles"]
    require(counts["--cells hex --effort best"] < counts["--cells hex --effort fast"], f"{counts}")
    default = json.loads(run(*extract, "--error", 0.2, "--json").stdout)
    best = json.loads(run(*extract, "--error", 0.2, "--json", "--effort", "best").stdout)
    require(default["triangles"] == best["triangles"], f"{default}, {best}")
    require((default["cells"], default["function"]) == ("hexahedra", "trilinear"), f"{default}")
    require(default["triangles"] == counts["--cells hex --effort best"], f"{counts}, {default}")
    text = run(*extract, "--error", 0.05, "--cells", "hex", "--effort", "fast").stdout
    require("error at most 0." in text and "of the trilinear function on hexahedra" in text
            and "from the full-resolution surface" in text, text)
    budget = json.loads(run(*extract, "--triangles", 500, "--by", "error", "--effort", "fast", "--json").stdout)
    require(budget["triangles"] <= 500 and budget["within_budget"], f"{budget}")
    text = run(*extract, "--error", 0.2).stdout
    require("error at most 0." in text and "simplified from" in text, text)
    budget = json.loads(run(*extract, "--triangles", plain["triangles"] // 2, "--by", "error",
                            "--json").stdout)
    require(budget["triangles"] <= plain["triangles"] // 2 and budget["within_budget"]
            and budget["nested_triangles"] > budget["triangles"], f"{budget}")

sys.exit(1 if failures else 0)
