"""If preprocess is killed at a random moment, there is no store or a complete one, and the replaced one survives; a
resumed run continues from the files that are left and gives the same bytes. The same for extract and its mesh.

Usage: kill_test.py ISONEST PLUGIN_FOLDER     (ISONEST_KILLS=200 in the environment: number of kills)
"""
import json
import os
import pathlib
import random
import subprocess
import sys
import tempfile
import time

isonest = sys.argv[1]
kills = int(os.environ.get("ISONEST_KILLS", "30"))
random.seed(7)


def shortest(command):
    """Duration of the shortest of three runs in seconds: with that of a slow first run most kills would come too
    late."""
    times = []
    for _ in range(3):
        start = time.monotonic()
        assert subprocess.run(command).returncode == 0
        times.append(time.monotonic() - start)
    return min(times)


def run(*arguments, **options):
    return subprocess.run([isonest, *map(str, arguments)], capture_output=True, timeout=600, **options)


with tempfile.TemporaryDirectory(prefix="isonest-kill-") as name:
    folder = pathlib.Path(name)
    volume, store = folder / "v.h5", folder / "s.isonest"
    assert run("make-volume", "noise", "--size", "60,50,70", "-o", volume).returncode == 0
    command = [isonest, "preprocess", str(volume), "-o", str(store), "--chunk", "8", "-q"]
    seconds = shortest([*command, "--force"])
    whole = store.read_bytes()
    killed = finished = warned = resumed = taken_over = 0
    for i in range(4 * kills):
        if i >= kills and taken_over > 0:
            break  # on a busy machine most runs are killed before there is anything to continue from
        replacing = i % 2 == 1
        for old in folder.glob(".*"):
            old.unlink()
        if replacing:
            store.write_bytes(whole)
        else:
            store.unlink(missing_ok=True)
        process = subprocess.Popen([*command, "--force"])
        time.sleep(random.uniform(0, 1.1 * seconds))
        process.kill()
        code = process.wait()
        killed += code == -9
        finished += code == 0
        assert code in (0, -9), code
        if code == 0 or replacing:
            assert store.exists(), f"kill {i}: the store that was to be replaced is gone"
        if store.exists():
            assert store.read_bytes() == whole, f"kill {i}: neither the old store nor the new one"
            if i < 10:
                done = run("check", store, "--json")
                assert done.returncode == 0, done.stdout
        left = [p.name for p in folder.iterdir() if p not in (volume, store)]
        assert all(p.startswith(".s.isonest.partial-") for p in left), left
        if left and warned < 3:
            done = run("preprocess", volume, "-o", store, "--chunk", "8", "--force", "--json")
            assert done.returncode == 0, done.stderr
            store_left = min(left, key=len)
            assert store_left.encode() in done.stderr, done.stderr
            assert store_left in json.loads(done.stdout)["warning"]
            warned += 1
        if code == -9 and i % 3 == 0:
            done = run("preprocess", volume, "-o", store, "--chunk", "8", "--force", "--resume",
                       "--json")
            assert done.returncode == 0, done.stderr
            assert store.read_bytes() == whole, f"kill {i}: resumed, but not to the same bytes"
            taken_over += json.loads(done.stdout)["resumed_chunks"] > 0
            resumed += 1
    assert killed >= kills // 2, (killed, finished)
    assert warned > 0
    assert taken_over > 0 or kills < 30, "no run went on with what another left"
    print(f"{killed} runs killed, {finished} finished first; no store was lost or half written; "
          f"{resumed} resumed to the same bytes, {taken_over} of them from work done before")

    # A mesh, too, is complete or does not exist.
    done = run("preprocess", volume, "-o", store, "--chunk", "8", "--force", "-q")
    assert done.returncode == 0, done.stderr
    for end in ("ply", "vtkhdf"):
        mesh = folder / f"m.{end}"
        command = [isonest, "extract", str(store), "--iso", "0.5", "-o", str(mesh), "-q"]
        seconds = shortest(command)
        expected = mesh.read_bytes()
        mesh.unlink()
        killed_meshes = 0
        for i in range(kills // 3):
            process = subprocess.Popen(command)
            time.sleep(random.uniform(0, 1.1 * seconds))
            process.kill()
            killed_meshes += process.wait() == -9
            if mesh.exists():
                assert mesh.read_bytes() == expected, f"kill {i}: half a mesh"
                mesh.unlink()
            for left in folder.glob(f".m.{end}*"):
                assert left.name.startswith(f".m.{end}.partial-"), left
                left.unlink()
        assert killed_meshes >= kills // 6, killed_meshes
        print(f"{killed_meshes} extractions to .{end} killed; no half mesh")
