"""Every system call that can fail: reading the input, writing, reserving space, syncing, renaming. If the machine
reports an error, the run says so, leaves no incomplete output and keeps the file to be replaced, or, if the call is
optional, writes the same bytes.

strace injects the errors. Usage: fault_test.py ISONEST PLUGIN_FOLDER
"""
import os
import pathlib
import random
import re
import shutil
import subprocess
import sys
import tempfile
import time

import h5py
import numpy as np

isonest = sys.argv[1]
random.seed(3)
tries = 0

with tempfile.TemporaryDirectory(prefix="isonest-fault-") as name:
    folder = pathlib.Path(name)
    log = folder / "log"

    if not shutil.which("strace"):
        print("skipped: there is no strace")
        sys.exit(77)
    # The leak sanitizer does not work under strace.
    environment = {**os.environ, "LC_ALL": "C",
                   "ASAN_OPTIONS": os.environ.get("ASAN_OPTIONS", "") + ":detect_leaks=0"}
    strace = ["strace", "--seccomp-bpf", "-f", "-qq", "-o", log]
    if subprocess.run([*strace, "true"], capture_output=True).returncode != 0:
        print("skipped: strace may not trace here")
        sys.exit(77)

    def traced(call, path, command, fault=()):
        """Runs the command; if `path` is given, only calls on it count."""
        only = ["-P", path] if path else []
        return subprocess.run([*strace, *only, "-e", f"trace={call}", *fault, isonest,
                               *map(str, command)], capture_output=True, timeout=300,
                              env=environment)

    def calls(call, path, command):
        """How often the command makes the call, so that each try hits one of them."""
        traced(call, path, command)
        return len(re.findall(rf"\b{call.lstrip('/^')}\w*\(", log.read_text()))

    def try_all(command, output, call, error, path=None, most=3, last=1):
        """Makes the first call fail, the `last` ones and up to `most` others; returns the number of runs that were
        refused."""
        global tries
        whole = output.read_bytes()
        # strace counts calls per thread: only with a single thread every call is reached for sure.
        single = ["--threads", "1"]
        force = ["--force"] if command[0] == "preprocess" else []  # other commands always replace
        count = calls(call, path, [*command, *force, *single])
        assert count > 0, f"{call}: the run makes no such call"
        places = sorted({1, *range(max(1, count - last + 1), count + 1),
                         *random.sample(range(1, count + 1), min(most, count))})
        refused = 0
        for at, replacing in ((at, replacing) for at in places for replacing in (False, True)):
            if not replacing:
                output.unlink()
            done = traced(call, path, [*command, *(force if replacing else single)],
                          ["-e", f"inject={call}:error={error}:when={at}"])
            place = f"{command[0]}: {call} {at} of {count}: {error}: "
            tries += 1
            assert done.returncode in (0, 4, 6), place + f"{done.returncode} {done.stderr}"
            assert b"HDF5-DIAG" not in done.stderr, place + str(done.stderr)
            if done.returncode == 0:
                assert output.read_bytes() == whole, place + "other bytes"
            else:
                refused += 1
                assert b"isonest" in done.stderr or b"cannot" in done.stderr, place + str(done.stderr)
                if replacing:
                    assert output.read_bytes() == whole, place + "what was to be replaced is gone"
                elif output.exists():
                    # The folder is synced and the report printed after the output has its name.
                    assert output.read_bytes() == whole, place + "half written"
            left = sorted(p.name for p in folder.glob(".*"))
            assert not left, place + f"left {left}"
            output.write_bytes(whole)
        return refused

    # The same volume in formats that are read in different ways.
    u = np.random.default_rng(1).integers(0, 255, (30, 35, 40)).astype(np.uint16)
    h5 = folder / "chunked.h5"
    with h5py.File(h5, "w") as file:
        file.create_dataset("v", data=u, chunks=(16, 16, 16), compression="gzip")
    raw = folder / "v.raw.gz"
    subprocess.run(["gzip", "-c"], input=u.astype(">u2").tobytes(), stdout=raw.open("wb"), check=True)
    inputs = [[h5], [raw, "--dims", "40,35,30", "--type", "uint16", "--endian", "big"]]
    store, mesh, picture = folder / "s.isonest", folder / "m.ply", folder / "p.png"
    for source in inputs:
        command = ["preprocess", *source, "-o", store, "--chunk", "8", "--memory", "64M"]
        assert subprocess.run([isonest, *map(str, command), "--force"]).returncode == 0
        assert try_all(command, store, "pread64", "EIO", source[0]) > 3
        assert try_all(command, store, "pread64", "ESTALE", source[0], most=1) > 0  # deleted on its server

    writing = ["preprocess", h5, "-o", store, "--chunk", "8", "--memory", "64M"]
    assert try_all(writing, store, "pwrite64", "EIO") > 4
    # HDF5 writes small arrays when they are closed: ranges of cubes, checksums, the chunk table.
    assert try_all(writing, store, "pwrite64", "ENOSPC", last=30) >= 30
    assert try_all(writing, store, "fsync", "EIO") > 0
    assert try_all(writing, store, "fallocate", "ENOSPC") > 0
    assert try_all(writing, store, "/^rename", "EACCES") > 0
    try_all(writing, store, "flock", "ENOLCK")

    # If the file server is gone, closing the written file fails as well.
    whole = store.read_bytes()
    loading = calls("close", None, ["--version"])
    closing = f"inject=close:error=ENOTCONN:when={loading + 1}+"
    for fault in (["-e", "trace=close", "-e", closing],
                  ["-e", "trace=close,pwrite64", "-e", closing,
                   "-e", "inject=pwrite64:error=ECONNABORTED:when=9+"]):
        done = subprocess.run([*strace, *fault, isonest, *map(str, writing), "--force", "-q",
                               "--threads", "1"], capture_output=True, timeout=300, env=environment)
        assert done.returncode == 6, (done.returncode, done.stderr)
        assert done.stderr.startswith(b"isonest: error: ") and done.stderr.count(b"\n") == 1, \
            done.stderr
        assert store.read_bytes() == whole
        for left in folder.glob(".*"):
            left.unlink()

    for output, command in ((mesh, ["extract", store, "--iso", "128"]),
                            (folder / "m.vtkhdf", ["extract", store, "--iso", "128"]),
                            (picture, ["slice", store, "--plane", "0,0,1,20"])):
        command = [*command, "-o", output]
        done = subprocess.run([isonest, *map(str, command)], capture_output=True)
        assert done.returncode == 0, done.stderr
        for call, error in (("pwrite64", "ENOSPC"), ("fsync", "EIO"), ("/^rename", "EROFS")):
            try_all(command, output, call, error)

    # An input that is deleted while it is read: either the run had read all of it, or it reports an error.
    command = [isonest, *map(str, writing), "--force", "-q"]
    whole = store.read_bytes()
    copy = h5.read_bytes()
    start = time.monotonic()
    assert subprocess.run(command).returncode == 0
    seconds = time.monotonic() - start
    for _ in range(10):
        process = subprocess.Popen(command, stderr=subprocess.PIPE)
        time.sleep(random.uniform(0, seconds))
        h5.unlink()
        error = process.communicate(timeout=300)[1]
        assert process.returncode in (0, 3, 4, 6), error
        assert process.returncode == 0 or b"chunked.h5" in error, error
        assert store.read_bytes() == whole
        h5.write_bytes(copy)

    print(f"{tries} runs with an error of the machine, 10 with an input that vanished; nothing lost")
