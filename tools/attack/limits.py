#!/usr/bin/env python3
"""Attacks isonest by the limits of the machine: disk, memory, descriptors, threads, permissions, streams, signals, names.

Each try runs one command on small inputs, with one limit at a random size or one disturbance at a random moment. The judge is
a set of rules: an exit code that `isonest --help` lists and that fits the cause, never 1 and never a signal that was not sent;
one message; an output that has the bytes of an undisturbed run or is not there; what was there before, and the inputs, as they
were; no temporary file left, but by SIGKILL and by a second signal, and then the next run names it.

"refused" counts the runs that ended with an error; --reasons has the exit codes. Kinds that need root (disk, threads,
permission) count as refused where that is missing.
"""
import ctypes
import json
import os
import pathlib
import resource
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
import time

import attack

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent / "limits"))
from limit_commands import Bench, contents, ended, judge, limited, run, start  # noqa: E402

NOBODY = 65534
CLONE_NEWNS, MS_REC, MS_PRIVATE = 0x20000, 0x4000, 1 << 18
LIBC = ctypes.CDLL(None, use_errno=True)
shared_folder = None  # made before the tries' processes are forked
_bench = None


def bench(one):
    global _bench
    if _bench is None:
        folder = shared_folder or tempfile.mkdtemp(prefix="isonest-limits-")
        _bench = Bench(folder, one.program)
    return _bench


def pick(one, *, python=True, which=lambda command: True):
    choices = [command for command in bench(one).commands.values() if (python or not command.python) and which(command)]
    return one.pick(*choices)


def output_folder(one, command, place=None):
    """The folder of the output, with an old one in it in half of the tries; and what is in it."""
    out = place or one.folder / "out"
    out.mkdir(exist_ok=True)
    if command.output and not command.folder and one.chance(0.5):
        (out / command.output).write_bytes(b"what was there before\n" * int(one.random.integers(1, 200)))
    return out, contents(out)


def options(one, command):
    """That change nothing in the output."""
    words = []
    if command.words[0] not in ("picture", "export", "publish") and command.name != "info" and one.chance(0.7):
        words += ["--threads", str(one.pick(1, 2, 4, 16))]
    if command.words[0] not in ("publish", "make-volume") and command.name != "info" and one.chance(0.3):
        words += ["--memory", one.pick("64M", "256M", "2G")]
    if one.chance(0.3):
        words += ["--json"]
    elif one.chance(0.2):
        words += ["-q"]
    return words


def with_limits(one, limits):
    """The command that was run within them, the folder of its output, what was in it, how the command ended."""
    command = pick(one)
    out, old = output_folder(one, command)
    done = run(bench(one), command, one.folder, out, *options(one, command), prepare=limited(limits),
               environment={"TMPDIR": str(one.folder)})
    return command, out, old, done


def cannot_start(one, command, limits, user=None):
    """Whether the loader, or Python, cannot start the program at all within these limits."""
    words = [sys.executable, "-c", "import sys; sys.path.insert(0, sys.argv[1]); import isonest",
             one.program.parent.parent / "python"] if command.python else [one.program, "--version"]
    done = subprocess.run(words, preexec_fn=limited(limits, user), stdin=subprocess.DEVNULL, capture_output=True)
    return done.returncode != 0


def power(one, low, high):
    """A number whose logarithm is equally likely."""
    return int(low * (high / low) ** one.random.random())


def within_memory(one, limits):
    command, out, old, done = with_limits(one, limits)
    if done.code in (99, 127, -9, -11, -7, 1) and cannot_start(one, command, limits) and contents(out) == old:
        return attack.refused("the program cannot be loaded")
    if command.python and done.code == 99:
        return attack.refused("the program cannot be loaded")
    return judge(bench(one), command, out, old, done, (7, 6), names=("emor", "thread", "limit", "Cannot allocate"))


def heap(one):
    size = power(one, 1 << 20, 600 << 20)
    return within_memory(one, [(resource.RLIMIT_DATA, size, size)])


def address_space(one):
    size = power(one, 24 << 20, 4 << 30)
    return within_memory(one, [(resource.RLIMIT_AS, size, size)])


def descriptors(one):
    size = int(one.random.integers(3, 64)) if one.chance(0.7) else int(one.random.integers(3, 12))
    limits = [(resource.RLIMIT_NOFILE, size, size)]
    command, out, old, done = with_limits(one, limits)
    if done.code in (99, 127, 1) and cannot_start(one, command, limits):
        return attack.refused("the program cannot be loaded")
    if command.python and done.code == 99:
        return attack.refused("the program cannot be loaded")
    return judge(bench(one), command, out, old, done, (6, 7), names=("open files", "descriptors", "threads"))


def threads(one):
    if os.geteuid() != 0:
        return attack.refused("needs root")
    size = int(one.random.integers(1, 12))
    command = pick(one)
    out, old = output_folder(one, command, of_all(one, "out"))
    open_to_all(out)
    done = run(bench(one), command, out.parent, out, *options(one, command), environment={"TMPDIR": str(out)},
               prepare=limited([(resource.RLIMIT_NPROC, size, size)], user_of(one)))
    return kept(one, out, judge(bench(one), command, out, old, done, (7,), names=("thread", "process")))


def user_of(one):
    """A user that runs nothing else: limits on processes count all of a user's."""
    return 1_000_000 + os.getpid() % 1_000_000


def of_all(one, name):
    """An empty folder that every user may search the way to: that of the try is in a private one."""
    place = bench(one).folder / f"user-{os.getpid()}"
    shutil.rmtree(place, ignore_errors=True)
    (place / name).mkdir(parents=True)
    os.chmod(place, 0o777)
    return place / name


def kept(one, folder, result):
    """The result; the folder is copied to the try's own if that is wrong."""
    if result.what == "wrong":
        shutil.copytree(folder, one.folder / folder.name, symlinks=True)
    return result


def open_to_all(out):
    os.chmod(out, 0o777)
    for path in out.iterdir():
        os.chmod(path, 0o666)


def stack(one):
    size = power(one, 96 << 10, 64 << 20)
    limits = [(resource.RLIMIT_STACK, size, size)]
    command, out, old, done = with_limits(one, limits)
    if done.code in (99, 127, -9, -11, -7, 1) and cannot_start(one, command, limits) and contents(out) == old:
        return attack.refused("the program cannot be loaded")
    return judge(bench(one), command, out, old, done, (7,))


def file_size(one):
    size = power(one, 1, 4 << 20)
    command, out, old, done = with_limits(one, [(resource.RLIMIT_FSIZE, size, size)])
    return judge(bench(one), command, out, old, done, (6,), names=(str(one.folder),))


def mounts(one):
    """Whether this process may mount what nobody else sees."""
    if getattr(mounts, "ready", None) is None:
        mounts.ready = (os.geteuid() == 0 and LIBC.unshare(CLONE_NEWNS) == 0
                        and LIBC.mount(b"none", b"/", None, MS_REC | MS_PRIVATE, None) == 0)
    return mounts.ready


def disk(one):
    if not mounts(one):
        return attack.refused("needs root")
    command = pick(one)
    place = one.folder / "disk"
    place.mkdir()
    limit = f"size={4096 * int(power(one, 1, 1500))}" if one.chance(0.8) else f"nr_inodes={int(one.random.integers(2, 9))}"
    if LIBC.mount(b"limits", os.fsencode(place), b"tmpfs", 0, limit.encode()) != 0:
        return attack.refused("no tmpfs")
    try:
        try:
            out, old = output_folder(one, command, place)
        except OSError:
            return attack.refused("no place for what is there before")
        environment = {"TMPDIR": str(place)} if one.chance(0.5) else None
        done = run(bench(one), command, one.folder, out, *options(one, command), environment=environment)
        result = judge(bench(one), command, out, old, done, (6,), names=(str(place), "temporary"))
        if result.what == "wrong":  # the mount is this process's
            shutil.copytree(place, one.folder / "disk-then")
        return result
    finally:
        LIBC.umount2(os.fsencode(place), 2)


def permission(one):
    """Folders and files that another user may not write or read."""
    if os.geteuid() != 0:
        return attack.refused("needs root")
    command = pick(one)
    out, old = output_folder(one, command, of_all(one, "out"))
    open_to_all(out)
    place, user, allowed, names = out.parent, user_of(one), (6,), ()
    environment = {"TMPDIR": str(place)}
    case = one.pick("folder", "search", "input", "input folder", "old", "temporary", "home")
    inputs = None
    if case == "folder" and command.output:
        os.chmod(out, 0o555)
        names = (str(out),)
    elif case == "search" and command.output:
        os.chmod(out, one.pick(0o666, 0o000))
        names = (str(out),)
    elif case in ("input", "input folder") and "{i}" in " ".join(command.words):
        inputs = place / "in"
        shutil.copytree(bench(one).inputs, inputs)
        for path in inputs.rglob("*"):
            if path.is_dir() == (case == "input folder"):
                os.chmod(path, one.pick(0o000, 0o200))
        if case == "input folder":
            os.chmod(inputs, one.pick(0o000, 0o444))
        names = (str(inputs),)
    elif case == "old" and old:
        os.chmod(out / command.output, one.pick(0o000, 0o444, 0o200))
        names = (str(out),)
    elif case == "temporary":
        environment, names = {"TMPDIR": "/proc"}, ("/proc", "temporary")
    else:
        environment, names = {"HOME": "/root", "XDG_CACHE_HOME": "/root/x", "TMPDIR": str(place)}, ()
    here = bench(one) if inputs is None else AsIf(bench(one), inputs)
    done = run(here, command, place, out, *options(one, command), prepare=limited([], user), environment=environment)
    os.chmod(out, 0o777)
    for path in out.rglob("*"):
        os.chmod(path, 0o777 if path.is_dir() else 0o666)
    return kept(one, out, judge(bench(one), command, out, old, done, allowed, names=names))


class AsIf:
    """The bench with its inputs elsewhere."""

    def __init__(self, here, inputs):
        self.inputs, self.program = inputs, here.program


def streams(one):
    """Standard streams that are closed, full, or go to nobody."""
    command = pick(one, python=False)
    out, old = output_folder(one, command)
    chosen = {fd: one.pick("as usual", "closed", "full", "nobody", "read-only", "folder") for fd in (0, 1, 2)}
    opened, before, given = [], [], {}
    for fd, how in chosen.items():
        if how == "as usual":
            continue
        if how == "closed":
            before.append(lambda fd=fd: os.close(fd))
            continue
        if how == "full":
            end = os.open("/dev/full", os.O_RDWR)
        elif how == "nobody":
            reader, end = os.pipe()
            if fd == 0:
                reader, end = end, reader
            os.close(reader)
        elif how == "read-only":
            end = os.open("/dev/null", os.O_RDONLY if fd else os.O_WRONLY)
        else:
            end = os.open(one.folder, os.O_RDONLY | os.O_DIRECTORY)
        opened.append(end)
        given[("stdin", "stdout", "stderr")[fd]] = end
    if one.chance(0.5):
        before.append(lambda: signal.signal(signal.SIGPIPE, signal.SIG_DFL))  # subprocess restores that by itself
    process = start(bench(one), command, one.folder, out, *options(one, command), prepare=limited(before=before), **given)
    for end in opened:
        os.close(end)
    done = ended(process)
    allowed = []
    if chosen[1] != "as usual":
        allowed.append(6)
    if "nobody" in (chosen[1], chosen[2]):
        allowed.append(-signal.SIGPIPE)
    return judge(bench(one), command, out, old, done, allowed, tell=chosen[2] == "as usual", silent=(-signal.SIGPIPE,),
                 whole_after=(6, -signal.SIGPIPE), names=("standard output",))


def usual_seconds(one, command):
    """How long an undisturbed run takes, roughly."""
    known = usual_seconds.__dict__
    if command.name not in known:
        with tempfile.TemporaryDirectory(dir=bench(one).folder) as folder:
            begun = time.monotonic()
            run(bench(one), command, folder, folder)
            known[command.name] = time.monotonic() - begun
    return known[command.name]


def wait_until_it_watches(process):
    """Until the program is loaded and has its handlers; false if it has ended before."""
    while process.poll() is None:
        try:
            status = pathlib.Path(f"/proc/{process.pid}/status").read_text()
        except OSError:
            return False
        caught = next((line.split()[1] for line in status.splitlines() if line.startswith("SigCgt")), "0")
        if int(caught, 16) >> (signal.SIGINT - 1) & 1:
            return True
        time.sleep(0.0005)
    return False


ENDING = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGXCPU)
HARMLESS = (signal.SIGPIPE, signal.SIGXFSZ, signal.SIGCHLD, signal.SIGWINCH, signal.SIGURG, signal.SIGCONT, "stop")


def send(process, one_signal):
    if one_signal == "stop":
        process.send_signal(signal.SIGTSTP)
        time.sleep(0.01)
        process.send_signal(signal.SIGCONT)
    else:
        process.send_signal(one_signal)


def signals(one):
    """One signal, or several, at random moments after the program watches for them."""
    command = pick(one, python=False)
    out, old = output_folder(one, command)
    seconds = usual_seconds(one, command)
    process = start(bench(one), command, one.folder, out, *options(one, command))
    if not wait_until_it_watches(process):
        return judge(bench(one), command, out, old, ended(process), ())
    kinds = [one.pick(*ENDING, *HARMLESS) for _ in range(one.pick(1, 1, 2, 3))]
    for kind in kinds:
        time.sleep(one.random.random() * seconds * 1.2 / len(kinds))
        send(process, kind)
    done = ended(process)
    ends = [kind for kind in kinds if kind in ENDING]
    twice = len([kind for kind in ends if kind != signal.SIGHUP]) > 1 or (len(ends) > 1 and ends[-1] != signal.SIGHUP)
    result = judge(bench(one), command, out, old, done, (130,) if ends else (), tell=not twice, whole_after=(6, 130), left=twice)
    if result.what != "wrong" and any(path.name.startswith(".") for path in out.iterdir()):
        return next_run(one, command, out, kinds)
    return result


def kill(one):
    """SIGKILL, and the next run: it names what is left, or there is nothing left."""
    command = pick(one, python=False)
    out, old = output_folder(one, command)
    seconds = usual_seconds(one, command)
    process = start(bench(one), command, one.folder, out, *options(one, command))
    time.sleep(one.random.random() * seconds * 1.1)
    process.kill()
    done = ended(process)
    result = judge(bench(one), command, out, old, done, (-signal.SIGKILL,), tell=False, whole_after=(-signal.SIGKILL,), left=True)
    return result if result.what == "wrong" or done.code == 0 else next_run(one, command, out, ["SIGKILL"])


def next_run(one, command, out, kinds):
    left = [path for path in out.rglob("*") if path.name.startswith(".")]
    done = run(bench(one), command, one.folder, out)
    said = f"{command.name}, after {kinds}, which left {[path.name for path in left]}: {done.code}: {done.err}"
    if done.code != 0 and not (command.name == "publish" and done.code == 2):
        return attack.wrong("the next run fails: " + said)
    told = done.out + done.err
    for path in left:
        named = str(path) in told or any(path.name.endswith(end) and str(path)[:-len(end)] in told
                                         for end in (".journal", ".centres"))
        if path.exists() and not named:
            return attack.wrong("the next run does not name what is left: " + said)
    now = {name: data for name, data in contents(out).items() if not any(p.startswith(".") for p in name.split("/"))}
    if done.code == 0 and now != bench(one).reference(command):
        return attack.wrong("the next run is not whole: " + said)
    return attack.refused("killed, and named" if left else "killed, and nothing left")


def cpu(one):
    """A limit of processor time, on what takes longer."""
    command, (words, output) = bench(one).commands["make-volume h5"], one.pick(
        (["make-volume", "cahn-hilliard", "--size", "181"], "o.h5"),
        (["preprocess", "BIG", "--indicators", "all", "--chunk", "16", "--force"], "o.isonest"),
        (["extract", "BIGSTORE", "--iso", "0.5", "--distance", "0.3voxel"], "o.ply"))
    out = one.folder / "out"
    out.mkdir()
    big = bench(one).folder / "big.h5"
    for path, line in ((big, ["make-volume", "bucky", "--size", "129"]), (big.with_suffix(".isonest"), ["preprocess", big])):
        if not path.exists():
            made = one.run(*line, "-o", f"{path}.{os.getpid()}.h5", seconds=100)
            if made.code != 0:
                return attack.wrong(f"undisturbed: {made}")
            os.rename(f"{path}.{os.getpid()}.h5", path)
    words = [str(big) if word == "BIG" else str(big.with_suffix(".isonest")) if word == "BIGSTORE" else word for word in words]
    hard = one.pick(resource.RLIM_INFINITY, 2)
    process = subprocess.Popen([one.program, *words, "-o", out / output], cwd=one.folder, stdin=subprocess.DEVNULL,
                               stdout=subprocess.PIPE, stderr=subprocess.PIPE, preexec_fn=limited([(resource.RLIMIT_CPU, 1, hard)]))
    done = ended(process, 50)
    left = sorted(os.listdir(out))
    if done.code == 0 and left == [output]:
        return attack.SAME
    if done.code == 130 and not left and done.err.count("isonest: error: ") == 1:
        return attack.refused("130 (cancelled)")
    return attack.wrong(f"{words}: {left}: {done}")


LOCALES = ("C", "POSIX", "C.UTF-8", "de_DE.UTF-8", "fr_FR", "tr_TR.UTF-8", "xx_YY", "", "../../etc", "a" * 5000)


def environment(one):
    """Variables of the environment that are odd, missing or huge."""
    command = pick(one)
    out, old = output_folder(one, command)
    given = {}
    for name, values in {
            "LC_ALL": LOCALES, "LANG": LOCALES, "LC_NUMERIC": LOCALES, "TMPDIR": ("/nowhere", "", "/dev/null", "relative", "/proc"),
            "HOME": (None, "", "/nowhere", "relative"), "COLUMNS": ("0", "-1", "1", "99999999999", "x"), "LINES": ("0", "x"),
            "TERM": (None, "dumb", "", "x" * 300), "PATH": (None, "", "/nowhere"), "USER": (None, ""), "DISPLAY": ("", ":99", "x"),
            "TZ": ("", "Nowhere/X", ":/dev/null"), "XDG_CACHE_HOME": ("/nowhere", ""), "XDG_RUNTIME_DIR": ("/nowhere", ""),
            "OMP_NUM_THREADS": ("0", "-3", "x", "100000"), "TBB_NUM_THREADS": ("0", "x"), "MALLOC_ARENA_MAX": ("1",),
            "MALLOC_PERTURB_": ("165",), "HDF5_PLUGIN_PATH": ("/nowhere", "", str(one.folder)), "HDF5_USE_FILE_LOCKING": ("FALSE", "TRUE", "x"),
            "HDF5_DISABLE_VERSION_CHECK": ("2",), "LP_NUM_THREADS": ("0", "x"), "no_proxy": ("*",), "http_proxy": ("http://127.0.0.1:1",),
            "POSIXLY_CORRECT": ("1",), "LD_BIND_NOW": ("1",), "GDCM_RESOURCES_PATH": ("/nowhere",), "NO_COLOR": ("1",)}.items():
        if one.chance(0.3):
            given[name] = one.pick(*values)
    if command.python:
        for name in ("PATH", "HOME", "LC_ALL"):
            given.pop(name, None)
    done = run(bench(one), command, one.folder, out, *options(one, command), environment=given)
    # Where the temporary folder is nowhere, what needs one says so.
    allowed = (6, 3) if "TMPDIR" in given else ()
    return judge(bench(one), command, out, old, done, allowed, names=(given.get("TMPDIR") or "temporary", "temporary"))


def odd_name(one, end):
    """A name that a file may have, before `end`."""
    kind = one.pick("newline", "dash", "long", "bytes", "spaces", "quotes", "dots", "unicode", "percent", "control", "braces")
    stem = {"newline": b"a\nb\n", "dash": one.pick(b"-", b"--", b"-o", b"--force"), "long": b"n" * (255 - len(end) - int(one.random.integers(0, 40))),
            "bytes": bytes(one.random.choice([*range(128, 256)], 9).astype("u1")), "spaces": b"  a  ", "quotes": b"'\"`$(x)\\",
            "dots": one.pick(b"...", b".hidden", b"a..b"), "unicode": "ü漢字\u202e🧊".encode(), "percent": b"%s%n%20{}",
            "control": b"\x1b[31m\x07\t\x7f", "braces": b"{iso}{0}" if end not in (b".ply", b".stl", b".obj", b".vtp", b".vtkhdf", b".glb", b".3mf") else b"{0}{}"}[kind]
    return kind, stem + end


def names(one):
    """Inputs and outputs whose names are odd, long, or no text; paths near the longest one."""
    command = pick(one, which=lambda command: not command.python and command.output and not command.folder)
    kind, name = odd_name(one, os.fsencode(pathlib.Path(command.output).suffix))
    inner = one.folder / "x"
    inner.mkdir()
    deep = one.chance(0.2)
    place = os.fsencode(inner)
    if deep:
        reach = int(one.random.integers(3000, 4300))
        opened = os.open(place, os.O_RDONLY)
        while len(place) + 201 < reach:
            os.mkdir(b"d" * 200, dir_fd=opened)
            following = os.open(b"d" * 200, os.O_RDONLY, dir_fd=opened)
            os.close(opened)
            opened, place = following, place + b"/" + b"d" * 200
        os.close(opened)
    output = place + b"/" + name
    relative = not deep and one.chance(0.5) and not (name.startswith(b"-"))
    words = [os.fsencode(word) for word in command.line(bench(one), bench(one).inputs, "OUTPUT")]
    if relative:
        words = [name if word == b"OUTPUT" else word for word in words]
    else:
        words = [output if word == b"OUTPUT" else word for word in words]
    if name.startswith(b"-") and one.chance(0.5) and not deep:  # beside the folder, as -o=NAME says it
        words = words[:words.index(b"-o")] + [b"--output=" + name]
    json_asked = one.chance(0.4)
    process = subprocess.Popen(words + ([b"--json"] if json_asked else []), cwd=inner, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE,
                               stderr=subprocess.PIPE, env={**os.environ, "LC_ALL": one.pick("C", "C.UTF-8")}, preexec_fn=limited())
    out, err = process.communicate(timeout=60)
    said = f"{kind} {name!r} {len(output)} {words[1]!r}: {process.returncode}: {err.decode(errors='replace')[-600:]}"
    if json_asked:
        try:
            json.loads(out.decode())
        except ValueError:
            return attack.wrong(f"no JSON: {out[:300]!r}: " + said)
    if deep:
        deepest = os.open(inner, os.O_RDONLY)
        for part in place[len(os.fsencode(inner)):].split(b"/")[1:]:
            following = os.open(part, os.O_RDONLY, dir_fd=deepest)
            os.close(deepest)
            deepest = following
    else:
        deepest = os.open(inner, os.O_RDONLY)
    here = [os.fsencode(entry) for entry in os.listdir(deepest)]
    try:
        if process.returncode == 0:
            if here != [name]:
                return attack.wrong(f"made {here}: " + said)
            with open(os.open(name, os.O_RDONLY, dir_fd=deepest), "rb") as file:
                whole = bench(one).reference(command)[command.output]
                if file.read() != whole and not command.output.endswith((".obj", ".mtl")):
                    return attack.wrong("other bytes: " + said)
            return attack.SAME
        too_long = kind == "long" or deep
        if process.returncode not in ((2, 3, 6) if too_long else ()) or here or err.count(b"isonest: error: ") != 1:
            return attack.wrong(f"left {here}: " + said)
        if b"too long" not in err:
            return attack.wrong("does not say that a name is too long: " + said)
        return attack.refused(f"{process.returncode}: too long")
    finally:
        os.close(deepest)


def viewer(one):
    """`isonest view` within limits, or with signals: it ends by itself with an error, or serves and ends by a signal with 0."""
    store = bench(one).inputs / "s.isonest"
    case = one.pick("heap", "address space", "descriptors", "threads", "signal", "signal", "streams")
    limits, user = [], None
    if case == "heap":
        limits = [(resource.RLIMIT_DATA, size := power(one, 1 << 20, 600 << 20), size)]
    elif case == "address space":
        limits = [(resource.RLIMIT_AS, size := power(one, 24 << 20, 4 << 30), size)]
    elif case == "descriptors":
        limits = [(resource.RLIMIT_NOFILE, size := int(one.random.integers(3, 40)), size)]
    elif case == "threads" and os.geteuid() == 0:
        limits, user = [(resource.RLIMIT_NPROC, size := int(one.random.integers(1, 20)), size)], user_of(one)
    given = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
    before = []
    if case == "streams":
        before = [lambda fd=fd: os.close(fd) for fd in (0, 1, 2) if one.chance(0.5)]
    process = subprocess.Popen([one.program, "view", store, "--port", "0", "--json", "--threads", str(one.pick(1, 2, 4))], cwd="/",
                               stdin=subprocess.DEVNULL, preexec_fn=limited(limits, user, before), **given)
    begun, url, text = time.monotonic(), None, b""
    os.set_blocking(process.stdout.fileno(), False)
    while time.monotonic() - begun < 5 and url is None and process.poll() is None:
        text += process.stdout.read() or b""
        try:
            url = json.loads(text)["url"]
        except (ValueError, KeyError):
            time.sleep(0.005)
        if case == "streams" and time.monotonic() - begun > 0.5:
            break
    asked = ask(url, one) if url else None
    kind = one.pick(signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
    if process.poll() is None:
        process.send_signal(kind)
        if case == "signal" and one.chance(0.3):
            process.send_signal(kind)
    done = ended(process, 20)
    said = f"{case} {limits} {kind} {asked}: {done}"
    if done.code == 0 and (url or case == "streams"):
        return attack.SAME
    if done.code in (99, 127, -9, -11, -7, 1) and limits and url is None:
        class Plain:
            python = False
        if cannot_start(one, Plain, limits, user):
            return attack.refused("the program cannot be loaded")
    if case == "signal" and done.code == 130:
        return attack.refused("130 (cancelled)")
    if case == "streams" and done.code in (6, -signal.SIGPIPE):
        return attack.refused(f"{done.code}")
    if limits and done.code in (6, 7) and done.err.count("isonest: error: ") == 1:
        return attack.refused(f"{case}: {done.code}")
    return attack.wrong(said)


def ask(url, one):
    """Some requests; what was answered."""
    host, port = url.split("/")[2].split(":")
    said = []
    for path in ("/", "/api/store", "/api/histogram", "/main.js"):
        try:
            with socket.create_connection((host, int(port)), timeout=5) as server:
                server.sendall(f"GET {path} HTTP/1.1\r\nHost: {host}:{port}\r\nConnection: close\r\n\r\n".encode())
                said.append(server.recv(64)[:15])
        except OSError as error:
            said.append(str(error))
    return said


KINDS = {"disk": disk, "heap": heap, "address_space": address_space, "descriptors": descriptors, "threads": threads, "stack": stack,
         "file_size": file_size, "cpu": cpu, "permission": permission, "streams": streams, "signals": signals, "kill": kill,
         "environment": environment, "names": names, "viewer": viewer}

if __name__ == "__main__":
    with tempfile.TemporaryDirectory(prefix="isonest-limits-") as made:
        os.chmod(made, 0o755)
        shared_folder = made
        sys.exit(attack.main(__doc__, KINDS))
