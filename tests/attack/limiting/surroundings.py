"""Permissions, standard streams, the environment, file names."""
import json
import os
import pathlib
import shutil
import signal
import subprocess

import attack

from .commands import judge, limited, run, start
from .tries import bench, kept, of_all, open_to_all, options, output_folder, pick, user_of


class AsIf:
    """The bench with its inputs in another folder."""

    def __init__(self, here, inputs):
        self.inputs, self.program = inputs, here.program


def permission(one):
    """Folders and files that another user must not write or read."""
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


def streams(one):
    """Standard streams that are closed, full, or without a reader."""
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
        before.append(lambda: signal.signal(signal.SIGPIPE, signal.SIG_DFL))  # subprocess restores it by itself
    process = start(bench(one), command, one.folder, out, *options(one, command), prepare=limited(before=before), **given)
    for end in opened:
        os.close(end)
    done = attack.ended(process)
    allowed = []
    if chosen[1] != "as usual":
        allowed.append(6)
    if "nobody" in (chosen[1], chosen[2]):
        allowed.append(-signal.SIGPIPE)
    return judge(bench(one), command, out, old, done, allowed, tell=chosen[2] == "as usual", silent=(-signal.SIGPIPE,),
                 whole_after=(6, -signal.SIGPIPE), names=("standard output",))


LOCALES = ("C", "POSIX", "C.UTF-8", "de_DE.UTF-8", "fr_FR", "tr_TR.UTF-8", "xx_YY", "", "../../etc", "a" * 5000)


def environment(one):
    """Environment variables that are odd, missing or huge."""
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
    # If the temporary folder does not exist, commands that need it must say so.
    allowed = (6, 3) if "TMPDIR" in given else ()
    return judge(bench(one), command, out, old, done, allowed, names=(given.get("TMPDIR") or "temporary", "temporary"))


def odd_name(one, end):
    """A valid file name that ends with `end`."""
    kind = one.pick("newline", "dash", "long", "bytes", "spaces", "quotes", "dots", "unicode", "percent", "control", "braces")
    stem = {"newline": b"a\nb\n", "dash": one.pick(b"-", b"--", b"-o", b"--force"), "long": b"n" * (255 - len(end) - int(one.random.integers(0, 40))),
            "bytes": bytes(one.random.choice([*range(128, 256)], 9).astype("u1")), "spaces": b"  a  ", "quotes": b"'\"`$(x)\\",
            "dots": one.pick(b"...", b".hidden", b"a..b"), "unicode": "ü漢字\u202e🧊".encode(), "percent": b"%s%n%20{}",
            "control": b"\x1b[31m\x07\t\x7f", "braces": b"{iso}{0}" if end not in (b".ply", b".stl", b".obj", b".vtp", b".vtkhdf", b".glb", b".3mf") else b"{0}{}"}[kind]
    return kind, stem + end


def names(one):
    """Inputs and outputs whose names are odd, long, or not valid text; paths near the maximum length."""
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
    if name.startswith(b"-") and one.chance(0.5) and not deep:  # next to the folder, given as -o=NAME
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
