"""The benchmark programs say what they need and how to get it, immediately and without a traceback.

usage: bench_needs_test.py ISONEST PLUGIN_FOLDER
"""
import pathlib
import subprocess
import sys
import tempfile

ROOT = pathlib.Path(__file__).resolve().parents[2]
BENCH = ROOT / "tools/bench"
isonest = sys.argv[1]
failures = []


def lacks(what, script, *arguments, options=(), says):
    """The script ends immediately with a code other than 0, and prints each text of `says`."""
    done = subprocess.run([sys.executable, *options, script, *map(str, arguments)], timeout=20,
                          capture_output=True, text=True)
    said = done.stdout + done.stderr
    if done.returncode == 0 or "Traceback" in said or not all(text in said for text in says):
        failures.append(f"{script.name}, {what}: exit code {done.returncode}\n{said}")


with tempfile.TemporaryDirectory(prefix="isonest-needs-") as name:
    folder = pathlib.Path(name)
    none, tree = folder / "none", folder / "another"
    tree.mkdir()
    (tree / "CMakeCache.txt").write_text("CMAKE_HOME_DIRECTORY:INTERNAL=/another/tree\n")
    file = folder / "file"
    file.write_bytes(b"")
    INSTALL = "tools/install-deps --bench"
    bare = ("-S",)  # without the distribution's modules

    with_modules = {"flying_edges.py": [file, 1, none],
                    "peers.py": [file, 1, 0.1, none], "odd_volumes.py": [folder / "odd"],
                    "distance.py": [isonest, none, "verify"],
                    "distance_peers.py": [isonest, none, "hausdorff"],
                    "verify_surfaces.py": [isonest, none, file], "run": ["--folder", folder / "run"]}
    for script, arguments in with_modules.items():
        lacks("no modules", BENCH / script, *arguments, options=bare, says=["h5py", INSTALL])
    for script in sorted(BENCH.glob("*.py")):
        if script.name not in ("needs.py", "tables.py", "culling.py", *with_modules):
            lacks("no arguments", script, says=["usage:"])
    lacks("no program", BENCH / "culling.py", file, "--iso", 1, "--isonest", none, says=["cmake --build"])
    lacks("no store", BENCH / "culling.py", none, "--iso", 1, "--isonest", isonest, says=["give a store"])
    lacks("no program", ROOT / "tools/figures", folder / "figures", "--isonest", none,
          says=["cmake --build"])
    lacks("another tree's build", BENCH / "large.py", tree, folder, "uint8:9:64M",
          says=["another tree"])
    lacks("no such volume", BENCH / "large.py", tree, folder, "uint8-9-64M", says=["TYPE:SIZE:MEMORY"])
    lacks("no space", BENCH / "large.py", tree, folder, "float64:100000:64M", says=["GB are needed"])
    lacks("a folder that cannot be made", BENCH / "large.py", tree, file / "below", "uint8:9:64M",
          says=["can be written"])

print("\n".join(failures))
sys.exit(f"{len(failures)} programs do not say what they lack" if failures else 0)
