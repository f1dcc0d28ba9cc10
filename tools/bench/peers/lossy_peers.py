#!/usr/bin/python3
"""Compares stores of rounded values with zfp in its fixed-accuracy mode at the same bound.

usage: lossy_peers.py ISONEST PLUGIN_FOLDER STORE...

Each STORE is one of the volume as it is (isonest preprocess without --tolerance). For 0.5 % and 1 % of the range, prints
a row: bytes of the whole store, of its values on all levels, and of its values on the finest level, each divided by what
zstd 3 makes of the volume's values; the same for zfp of the whole volume; seconds of `isonest preprocess` and of
`zfp`, and of reading all values again (`isonest export`, `zfp -d`). zfp works on floating-point numbers, so integers
become float32 first, which is exact for up to 16 bits. zfp alone gives values; a store also has all levels and bounds.
The largest difference from the volume is measured for both.
"""
import json
import os
import pathlib
import subprocess
import sys
import tempfile
import time

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1]))
import needs  # noqa: E402

needs.require(needs.module("numpy"), needs.module("h5py"), needs.tool("zfp"), needs.tool("zstd"))
import numpy as np  # noqa: E402

PARTS = (0.005, 0.01)


def timed(command):
    start = time.monotonic()
    done = subprocess.run(list(map(str, command)), check=True, capture_output=True)
    return time.monotonic() - start, done.stdout


def zfp(folder, u, tolerance):
    """Bytes, seconds to compress and to read, largest difference."""
    plain, packed, back = (folder / name for name in ("u.raw", "u.zfp", "b.raw"))
    v = u.astype("f4" if u.dtype.itemsize <= 2 or u.dtype == "f4" else "f8")
    plain.write_bytes(v.tobytes())
    shape = ("-f" if v.dtype == "f4" else "-d", "-3", *v.shape[::-1], "-a", repr(tolerance))
    pack, _ = timed(("zfp", "-i", plain, "-z", packed, *shape))
    read, _ = timed(("zfp", "-z", packed, "-o", back, *shape))
    off = np.abs(np.frombuffer(back.read_bytes(), v.dtype).reshape(v.shape).astype("f8") - u).max()
    return packed.stat().st_size, pack, read, off


def rounded(isonest, folder, volume, u, part):
    """Bytes of the store, of all values, of the finest values; seconds to make and to read; largest difference."""
    store, back = folder / "t.isonest", folder / "b.npy"
    make, _ = timed((isonest, "preprocess", volume, "-o", store, "--force", "-q", "--tolerance", f"{100 * part}%"))
    _, text = timed((isonest, "info", store, "--json"))
    info = json.loads(text)
    read, _ = timed((isonest, "export", store, "--field", "values", "-o", back, "--force", "-q"))
    values = [array["stored_bytes"] for array in info["arrays"] if array["field"] == "values"]
    return store.stat().st_size, sum(values), values[0], make, read, np.abs(np.load(back).astype("f8") - u).max()


def main():
    isonest, plugin, *stores = needs.arguments(3, __doc__)
    os.environ["HDF5_PLUGIN_PATH"] = plugin
    needs.require(needs.program(isonest), needs.zstd_filter())
    import h5py
    print("| volume | part | T | store | values | finest | zfp | made | zfp | read | zfp | off / T | zfp |")
    print("|---|---|---|---|---|---|---|---|---|---|---|---|---|")
    for name in stores:
        with tempfile.TemporaryDirectory() as text:
            folder = pathlib.Path(text)
            with h5py.File(name) as file:
                u = file["levels/0/values"][...]
            (folder / "v.raw").write_bytes(u.tobytes())
            np.save(folder / "v.npy", u)
            subprocess.run(["zstd", "-3", "-q", folder / "v.raw"], check=True)
            whole = (folder / "v.raw.zst").stat().st_size
            for part in PARTS:
                tolerance = part * (float(u.max()) - float(u.min()))
                store, values, finest, make, read, off = rounded(isonest, folder, folder / "v.npy", u, part)
                size, pack, unpack, off_zfp = zfp(folder, u, tolerance)
                print(f"| {pathlib.Path(name).stem} {u.dtype} | {100 * part:g} % | {tolerance:.3g} | {store / whole:.2f} | "
                      f"{values / whole:.2f} | {finest / whole:.2f} | {size / whole:.2f} | {make:.2f} s | {pack:.2f} s | "
                      f"{read:.2f} s | {unpack:.2f} s | {off / tolerance:.2f} | {off_zfp / tolerance:.2f} |", flush=True)


if __name__ == "__main__":
    main()
