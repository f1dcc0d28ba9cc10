"""Runs the program on a damaged input within limits, and says whether its behaviour is allowed."""
import functools
import itertools
import os
import pickle
import re
import resource
import signal
import sys
import zlib

import numpy as np

import attack
from damage.case import ELSEWHERE

sys.path.insert(0, str(attack.ROOT / "tests/support"))
import served  # noqa: E402

MIB = 1 << 20
START = 24 * MIB  # data that the program needs for the smallest good files, including two threads' stacks
MEMORY = 64       # MiB
HEAP = START + MEMORY * MIB + 64 * MIB
LARGEST_FILE = 256 * MIB  # that the program may write
SECONDS = 10      # of processor time
WALL = 45         # after which waiting counts as a hang, on a busy machine
FOREIGN_WALL = 10  # the same for libraries that may hang
CODES = (2, 3, 4, 5, 6, 7)
LIMITS = ("--memory", f"{MEMORY}M", "-q")


def can_run(program):
    """Whether the build has what is needed to run the program many times and to look into stores."""
    try:
        attack.package(program)
    except ImportError:
        return False
    return served._library(program).exists()


def run(one, *arguments, heap=HEAP, wall=WALL):
    """Like Try.run(), with a program that is loaded once for all tries of a process."""
    limited = served._server(os.fspath(one.program), "")
    process = next(process for socket, process in served._servers.values() if socket is limited)
    for what, most in ((resource.RLIMIT_DATA, heap), (resource.RLIMIT_CORE, 0), (resource.RLIMIT_CPU, SECONDS), (resource.RLIMIT_FSIZE, LARGEST_FILE)):
        resource.prlimit(process.pid, what, (most, most))
    try:
        done = served.run([one.program, *arguments], cwd=one.folder, capture_output=True, text=True, errors="replace",
                          timeout=wall)
    except served.subprocess.TimeoutExpired:
        return attack.Done("hang", "", "")
    return attack.Done("hang" if done.returncode == -signal.SIGXCPU else done.returncode, done.stdout, done.stderr)


def listing(folder, but):
    """What is in the folder, except `but`: kind, size, time and a checksum of each."""
    found = {}
    for path, folders, files in os.walk(folder):
        for name in (*folders, *files):
            full = os.path.join(path, name)
            if full == str(but) or full.startswith(f"{but}/"):
                continue
            about = os.lstat(full)
            what = [about.st_mode]
            if os.path.isfile(full) and not os.path.islink(full):
                with open(full, "rb") as file:
                    what += [about.st_size, about.st_mtime_ns, zlib.crc32(file.read())]
            found[full] = what
    return found


def read_here(read, path):
    try:
        return np.ascontiguousarray(read(path))
    except Exception:  # readers raise errors of many kinds
        return None


def read_apart(read, path, seconds=20):
    """The result of read(path) in a process of its own; None if it fails, crashes or takes too long."""
    ours, its = os.pipe()
    child = os.fork()
    if child == 0:
        try:
            signal.alarm(seconds)
            os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
            os.dup2(1, 2)
            resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
            values = np.ascontiguousarray(read(path))
            with os.fdopen(its, "wb") as file:
                pickle.dump(values, file)
        finally:
            os._exit(0)
    os.close(its)
    with os.fdopen(ours, "rb") as file:
        data = file.read()
    os.waitpid(child, 0)
    return pickle.loads(data) if data else None


def equal(found, expected, close):
    """Whether the values are equal, with axes in any order and direction; values that are not finite are missing."""
    found = found.squeeze()
    expected = expected.squeeze()
    if found.size != expected.size or expected.ndim > 3 or expected.dtype.kind not in "biuf":
        return False
    with np.errstate(all="ignore"):
        expected = expected.astype(found.dtype)
    for axes in itertools.permutations(range(expected.ndim)):
        turned = expected.transpose(axes)
        if turned.shape != found.shape:
            continue
        for signs in itertools.product((1, -1), repeat=expected.ndim):
            mirrored = turned[tuple(slice(None, None, sign) for sign in signs)]
            lacks = ~np.isfinite(mirrored)
            if not np.array_equal(lacks, ~np.isfinite(found)):
                continue
            a, b = np.where(lacks, 0, mirrored), np.where(lacks, 0, found)
            if np.array_equal(a, b) or close and np.allclose(a, b, rtol=3e-6, atol=1e-6 * float(np.abs(b).max(initial=0))):
                return True
    return False


def refusal(one, done, output, names, foreign):
    """Checks an error against what isonest promises: a Result, or None if the program succeeded.

    foreign: the library that reads the format may crash or hang; no promise covers that."""
    if done.code == 0:
        return None
    if done.code not in CODES:
        if foreign:
            return attack.refused(f"library crashed: {done.code}")
        return attack.wrong(f"ended with {done.code}\n{done.err[-2000:]}")
    if not done.err.startswith("isonest: error: ") or done.err.count("error: ") != 1 + done.err.count("internal error: "):
        return attack.wrong(f"not one error message, exit {done.code}:\n{done.err[-3000:]}")
    if re.search(r"[\0-\x08\x0b-\x1f\x7f-\x9f]", done.err):
        return attack.wrong(f"the message has control characters: {done.err!r}")
    if "out of memory" in done.err or "allows this run only" in done.err:
        if foreign:
            return attack.refused("library took more memory than it may")
        return attack.wrong(f"took more memory than it may\n{done.err}")
    if "this build" not in done.err and not any(name in done.err for name in names):  # a capability that was not built in
        return attack.wrong(f"the message names no file: {done.err}")
    if output.exists() or output.is_symlink():
        return attack.wrong(f"left an output in spite of an error: {done.err}")
    return attack.refused(f"exit {done.code}: {attack.reason(done.err, one.folder)}")


def prepare(one, case):
    """Makes the folders of a try: in/deep (the input), out, outside."""
    for name in ("in/deep", "out", "outside"):
        (one.folder / name).mkdir(parents=True)
    (one.folder / "outside/secret.raw").write_bytes(bytes(range(256)) * 40)
    case.write(one.folder / "in/deep")
    return one.folder / "in/deep" / case.name


def watched(one, output, arguments, names, foreign, more=0):
    """Runs the program: how it ended, and the Result if there is a finding or an error, else None. more: additional
    bytes of heap that it may take."""
    before = listing(one.folder, output)
    done = run(one, *arguments, heap=HEAP + more, wall=FOREIGN_WALL if foreign else WALL)
    if done.code == "hang":
        return done, None
    after = listing(one.folder, output)
    if after != before:
        changed = sorted(set(before) ^ set(after)) or [path for path in before if before[path] != after[path]]
        return done, attack.wrong(f"changed or left other files than its output: {changed}\nexit {done.code}: {done.err}")
    return done, refusal(one, done, output, names, foreign)


def preprocessed(one, case, foreign=False, straight=True):
    """The verdict on preprocess of an input, or sometimes, if `straight`, on extract from the volume."""
    path = prepare(one, case)
    straight = straight and "--labels" not in case.options and one.chance(0.1)
    output = one.folder / "out" / ("m.ply" if straight else "s.isonest")
    command = [*(("extract", path, "--iso", "100") if straight else ("preprocess", path, "--chunk", "8", "--indicators", "linf_bar")), "-o", output,
               "--threads", "2", *LIMITS, *case.options]
    # A message names the input, another file that the input names, or the option or space that is too small.
    names = ["in/deep", f"error: {case.name}", *(f"error: {place}:" for place in ELSEWHERE), "/outside/secret.raw: ", "error: --dims",
             "/out: temporary space"]
    done, result = watched(one, output, command, names, foreign)
    if done.code == "hang":
        if foreign:
            return attack.refused("library crashed: hang")
        # A good header of a huge volume is not damage: in that case a corner of it can be read quickly.
        again = run(one, *command, "--crop", "0:2,0:2,0:2", *(() if straight else ("--force",)))
        if again.code == 0 or again.code == 2 and "--crop" in again.err or again.code == 7 and "give at least --memory" in again.err:
            return attack.refused("a volume that takes longer than 10 s: a corner of it is read, or needs more memory")
        return attack.wrong(f"no end within {SECONDS} s; a corner of the volume: {again.code} {again.err}")
    if result is not None:
        return result
    if straight:
        return attack.refused("not compared: a mesh")
    return compared(one, case, path, output)


@functools.cache
def package(program):
    return attack.package(program)


def stored(one, store):
    with package(one.program).open(str(store)) as opened:
        return opened.values(0)


def compared(one, case, path, output):
    """The verdict on a store that was made from a damaged input."""
    found = stored(one, output)
    if case.cut and case.exact:
        return attack.wrong("a file that was cut short was read")
    if case.cut and case.values is not None and not equal(found, case.values, case.close):
        return attack.wrong("a file that was cut short was read, with other values")
    if case.read is None:
        return attack.refused("not compared: no reader")
    expected = read_apart(case.read, path) if case.apart else read_here(case.read, path)
    if expected is None:
        return attack.refused("not compared: the reader refuses it")
    if equal(found, expected, case.close):
        return attack.SAME
    with np.errstate(all="ignore"):
        return attack.wrong(f"other values than the reader's\nstore {found.dtype} {found.shape}: {found.ravel()[:12]}\n"
                            f"reader {expected.dtype} {expected.shape}: {expected.ravel()[:12]}")
