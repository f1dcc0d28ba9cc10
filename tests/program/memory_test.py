"""The heap of every command stays within --memory, or the command reports the minimum that it needs.

Usage: memory_test.py ISONEST PLUGIN_FOLDER [inputs|CHUNK...]

Without further arguments, commands on stores of several chunk sizes: on one of them all commands, on the others those
whose memory depends most on the chunk size. With chunk sizes: all commands, with every budget, on stores of these.
inputs: commands that read other formats, search labels and draw pictures.

For each chunk size and budget, either the peak of allocated bytes (tools/bench/peak_heap.cpp) is at most --memory, or
the exit code is 7 with a message that names the minimum; with that minimum the command works and stays within it.
"""
import functools
import gzip
import itertools
import os
import pathlib
import re
import sys
import tempfile

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1] / "support"))
import served  # noqa: E402

try:
    import netCDF4
    import nibabel
    import numcodecs
    import numpy as np
    import tifffile
    from zarr_two import zarr
except ImportError as error:
    print(f"skipped: {error}")
    sys.exit(77)

ISONEST = pathlib.Path(sys.argv[1]).resolve()
HEAP = ISONEST.parent.parent / "tools" / "bench" / "libisonest_peak_heap.so"
MIB = 1 << 20
LIMIT = 7
CHUNKS = [16, 64, 256]
COMMON = 64  # chunk size with which all commands are tried
INPUTS = sys.argv[3:] == ["inputs"]
ALL = [] if INPUTS else [int(chunk) for chunk in sys.argv[3:]]  # every command, with every budget
BUDGETS = ["20M", "64M"]
LARGEST = "4096x4096"
SIDE = 560  # an eighth of its cube is 21 MiB
FAST_ZLIB = {"compression": "zlib", "compressionargs": {"level": 1}}
failures = []


def run(*arguments):
    """(exit code, stderr, peak heap or None)"""
    done = served.run([ISONEST, *map(str, arguments), "-q"], capture_output=True, text=True,
                      timeout=600, env={**os.environ, "LD_PRELOAD": str(HEAP)})
    peak = re.search(r"peak heap (\d+) bytes", done.stderr)
    return done.returncode, done.stderr, int(peak[1]) if peak else None


def bytes_of(memory):
    return int(memory[:-1]) * MIB if memory.endswith("M") else int(memory)


def require(good, what):
    if not good:
        failures.append(what)
        print("FAILED:", what, flush=True)


def must_stay_within(command, memory):
    """Returns the minimum memory that the command reports, or None if it worked."""
    code, text, peak = run(*command, "--memory", memory)
    what = f"{' '.join(map(str, command))} --memory {memory}: exit {code}, heap {peak}, {text}"
    if code == LIMIT:
        least = re.search(r"give at least --memory (\d+M)", text)
        require(least is not None, "no least memory is named: " + what)
        return least[1] if least else None
    require(code == 0, what)
    require(peak <= bytes_of(memory), "more heap than --memory: " + what)
    return None


def check(command, budgets):
    # No command works with one byte, and each works with the reported minimum.
    least = must_stay_within(command, "1")
    require(least is not None, f"--memory 1 is accepted: {command}")
    for memory in [*budgets, *([least] if least else [])]:
        named = must_stay_within(command, memory)
        if named is not None:
            require(memory != least, f"the least memory, {least}, is not enough: {command}")
            require(named == least, f"two least memories, {least} and {named}: {command}")


@functools.cache
def waves():
    x = np.arange(SIDE, dtype="f4") / 9
    return (120 + 40 * (np.sin(x)[:, None, None] + np.cos(x)[:, None] + np.sin(2 * x))).astype("u1")


def inputs(folder):
    """Files of SIDE^3 bytes as written by Python packages."""
    data = waves()
    stack = folder / "stack"
    stack.mkdir()
    for z, plane in enumerate(data):
        tifffile.imwrite(stack / f"{z}.tif", plane, photometric="minisblack", metadata=None,
                         **(FAST_ZLIB if z % 2 else {}), rowsperstrip=SIDE if z % 3 else 7)
    tifffile.imwrite(folder / "v.tif", data, photometric="minisblack", metadata=None, tile=(128, 128), **FAST_ZLIB)
    zarr.save_array(str(folder / "v.zarr"), data, chunks=(64, 64, 64))
    zarr.save_array(str(folder / "z.zarr"), data, chunks=(1, SIDE, SIDE), compressor=numcodecs.Zstd(1))
    with gzip.open(folder / "v.nii.gz", "wb", 1) as file:
        file.write(nibabel.Nifti1Image(data.T, np.eye(4)).to_bytes())
    with netCDF4.Dataset(folder / "v.nc", "w", format="NETCDF3_64BIT_OFFSET") as file:
        for dim in "zyx":
            file.createDimension(dim, SIDE)
        file.createVariable("v", "i1", tuple("zyx"))[:] = data.view("i1")
        file["v"].setncattr("_Unsigned", "true")
    return [[stack], [folder / "v.tif"], [folder / "v.zarr"], [folder / "z.zarr"], [folder / "v.nii.gz"], [folder / "v.nc"]]


if not HEAP.exists() or run("info", "--help")[2] is None:
    print(f"{HEAP} does not exist or cannot be preloaded (sanitizers?)")
    sys.exit(77)


def made_store(folder, name, *options):
    """The store of a volume that make-volume generates with these options."""
    volume, store = folder / f"{name}.h5", folder / f"{name}.isonest"
    assert run("make-volume", *options, "-o", volume)[0] == 0
    assert run("preprocess", volume, "-o", store, "--memory", "2G")[0] == 0
    return store


def check_chunks(folder, volume, chunk):
    """All commands on a store of this chunk size."""
    mesh, store = folder / "m.ply", folder / f"{chunk}.isonest"
    check(["preprocess", volume, "-o", store, "--chunk", chunk, "--force"], ["48M"])
    assert run("preprocess", volume, "-o", store, "--chunk", chunk, "--force", "--memory", "2G")[0] == 0
    full = ["extract", store, "--iso", 0.5, "-o", mesh]
    commands = [
        full,
        [*full, "--close", "--normals", "--box", "1.5,2,3.25,120.5,90,100"],
        [*full, "--cells", "hex", "--close", "--normals", "--box", "1.5,2,3.25,120.5,90,100"],
        ["slice", store, "--plane", "1,2,3,300", "-o", folder / "s.png", "--size", "1500x1500"],
        ["export", store, "--field", "deviation_bar", "-o", folder / "e.h5", "--force"],
        ["check", store]]
    if ALL or chunk == COMMON:
        commands += [
            [*full, "--error-relative", 0.1, "--normals", "--vertex-error", "deviation_bar"],
            [*full, "--normals", "--vertex-values", store],
            [*full, "--close", "--error-relative", 0.1],
            ["extract", store, "--iso", 0.5, "-o", folder / "m.3mf"],
            ["extract", store, "--iso", 0.5, "--format", "3dtiles", "-o", folder / "tiles"],
            ["slice", store, "--plane", "1,2,3,300", "-o", mesh, "--error-relative", 0.1],
            ["export", store, "--field", "values", "-o", folder / "e.nrrd", "--force"],
            ["export", store, "--field", "values", "-o", folder / "e.vti", "--force"],
            ["export", store, "--field", "lp:3", "-o", folder / "e.raw", "--force"],
            ["smooth", store, "--steps", 1, "--tau", 1, "--lambda", 0.1, "-o", folder / "u.raw", "--force"],
            ["info", store, "--histogram", "-o", folder / "h.svg"]]
    for command in commands:
        check(command, BUDGETS)
    for threads, command in itertools.product([1, 8], [full, ["check", store]]):
        must_stay_within([*command, "--threads", threads], "200M")
    slow = [
        ["extract", store, "--iso", 0.1, "-o", mesh, "--error-relative", 0.03, "--box",
         "10,10,10,70,60,60"],
        ["check", store, "--deep", "--source", volume],
        ["study", store, "-o", folder / "study", "--steps", 2, "--fields", "linf_plus", "--iso", 0.5],
        ["study", store, "-o", folder / "study", "--steps", 2, "--fields", "lp:3_bar", "--norm", 3],
        ["study", store, "-o", folder / "study", "--steps", 2, "--fields", "linf_plus", "--plane", "1,2,3,300"]]
    for command in slow if ALL or chunk == COMMON else []:
        check(command, BUDGETS if ALL else BUDGETS[:1])


def check_volume(folder, volume):
    """Surfaces without a store, with their temporary files."""
    straight = ["extract", volume, "--iso", 0.5, "-o", folder / "m.ply"]
    for options in ([], ["--normals", "--components", "largest"], ["--distance", "0.5voxel", "--effort", "fast"]):
        check([*straight, *options], BUDGETS)


def check_smooth(folder, volume):
    for command in [
            ["smooth", volume, "--steps", 1, "--tau", 1, "--lambda", 0.1, "--threshold", 0.003, "-o",
             folder / "u.raw", "--force"],
            ["smooth", volume, "--steps", 2, "--tau", 1, "--lambda", 0.1, "--threshold", 0.3, "-o",
             folder / "u.h5", "--grid", folder / "g.h5", "--snapshots", 1, "--force"]]:
        check(command, BUDGETS)


def check_inputs(folder):
    """Inputs in other formats, eight times as large as the memory, in chunks and pieces of many sizes."""
    with tempfile.TemporaryDirectory(prefix="isonest-memory-", dir=served.MEMORY) as name:
        store, values = pathlib.Path(name) / "input.isonest", pathlib.Path(name) / "input.raw"
        for path, *options in inputs(folder):
            bytes_in = SIDE**3
            must_stay_within(["preprocess", path, "-o", store, "--chunk", 16, "--force", *options], str(bytes_in // 8))
            assert run("export", store, "--field", "values", "-o", values, "--force")[0] == 0
            require(np.array_equal(np.memmap(values, "u1", "r"), waves().reshape(-1)), f"other numbers from {path}")


def check_curvilinear(folder):
    """A grid whose positions take 24 times as much as its values: more than ten times the memory."""
    data = waves()[::2, ::2, ::2]
    side = len(data)
    with netCDF4.Dataset(folder / "curved.nc", "w") as file:
        for dim in "zyx":
            file.createDimension(dim, side)
        made = file.createVariable("v", "u1", tuple("zyx"), chunksizes=(16, 64, side))
        made[:] = data
        made.coordinates = "lon lat"
        for name, units, step in (("lon", "degrees_east", (0.01, 0.2)), ("lat", "degrees_north", (0.2, -0.01))):
            at = file.createVariable(name, "f8", ("y", "x"), zlib=True, chunksizes=(70, side))
            at[:] = step[0] * np.arange(side)[:, None] + step[1] * np.arange(side)
            at.units = units
    store = folder / "curved.isonest"
    command = ["preprocess", folder / "curved.nc", "--dataset", "v", "-o", store, "--chunk", 16, "--force"]
    require(must_stay_within(command, "40M") is None, "40M are not enough for a curvilinear grid")
    for more in ([], ["--normals"], ["--cells", "tet"]):
        check(["extract", store, "--iso", 140, "-o", folder / "m.ply", *more], ["40M"])


def check_labels(folder):
    """Labels, each in a part of the volume."""
    labels = made_store(folder, "labels", "sphere", "--size", 65, "--type", "uint8")
    for options, to in (([], "meshes"), (["--distance", "1voxel"], "meshes"), (["--smooth"], "meshes"),
                        (["--smooth=3", "--close"], "meshes"), (["--smooth=3", "--distance", "1voxel"], "meshes"),
                        (["--smooth=3", "--min-volume", "9", "--components", "3"], "meshes"),
                        (["--smooth=3", "--close", "--manifold"], "meshes"),
                        (["--smooth", "--close", "--interfaces"], "i.vtp"),
                        (["--smooth", "--close", "--interfaces"], "i.msh"),
                        (["--smooth", "--interfaces", "--distance", "0.5voxel", "--keep-nodes"], "i.vtp"),
                        (["--smooth=3", "--close", "--format", "neuroglancer-multilod"], "levels"),
                        (["--smooth=3", "--format", "3dtiles"], "site")):
        if to == "levels" and "libdraco-dev" in run("extract", labels, "--labels", "1", "-o", folder / to, *options)[1]:
            continue  # this build has no Draco
        # Searching labels takes less memory than extracting them.
        command = ["extract", labels, "--labels", "1-40", "-o", folder / to, *options]
        least = "1"
        for _ in range(3):
            least = must_stay_within(command, least) or least
        for memory in [*BUDGETS, least]:
            named = must_stay_within(command, memory)
            require(named is None or memory != least, f"the least memory, {least}, is not enough: {command}")


def check_pictures(folder):
    """Pictures in strips; the default memory is enough for the largest."""
    mesh = folder / "ball.ply"
    noise = made_store(folder, "noise", "noise", "--size", "131,100,120")
    assert run("extract", made_store(folder, "ball", "sphere", "--size", 33), "--iso", 0.5, "-o", mesh)[0] == 0
    check(["picture", mesh, "-o", folder / "p.png", "--size", LARGEST, "--flat"], ["256M"])
    check(["picture", mesh, "-o", folder / "p.png", "--size", "300x200"], BUDGETS)
    for command in [["picture", mesh], ["slice", noise, "--plane", "0,0,1,30"]]:
        code, text, peak = run(*command, "-o", folder / "p.png", "--size", LARGEST)
        require(code == 0 and peak <= 1024 * MIB, f"{command} {LARGEST}: {code}, {peak}, {text}")


def check_thin_study(folder):
    """The memory of a study depends on the volume, not on the cube around it."""
    thin = made_store(folder, "thin", "noise", "--size", "1000,3,3")
    check(["study", thin, "-o", folder / "study", "--steps", 2], BUDGETS)


with tempfile.TemporaryDirectory(prefix="isonest-memory-") as name:
    here = pathlib.Path(name)
    if INPUTS:
        check_inputs(here)
        check_curvilinear(here)
        check_labels(here)
        check_pictures(here)
    else:
        source = here / "v.h5"
        assert run("make-volume", "noise", "--size", "131,100,120", "-o", source)[0] == 0
        for size in ALL or CHUNKS:
            check_chunks(here, source, size)
        check_smooth(here, source)
        check_volume(here, source)
        if not ALL:
            check_thin_study(here)

sys.exit(1 if failures else 0)
