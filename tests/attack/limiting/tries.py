"""Shared by the kinds of limits.py: commands, outputs, users, limits."""
import os
import shutil
import subprocess
import sys
import tempfile

from .commands import Bench, contents, limited, run

shared_folder = None  # made before the processes of the tries are forked
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
    """The folder of the output, which in half of the tries has an old output in it; and its contents."""
    out = place or one.folder / "out"
    out.mkdir(exist_ok=True)
    if command.output and not command.folder and one.chance(0.5):
        (out / command.output).write_bytes(b"what was there before\n" * int(one.random.integers(1, 200)))
    return out, contents(out)


def options(one, command):
    """Options that do not change the output."""
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
    """Runs a command within the limits: the command, the folder of its output, the contents before, how it ended."""
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
    """A number with a uniformly distributed logarithm."""
    return int(low * (high / low) ** one.random.random())


def user_of(one):
    """A user that runs nothing else: limits on processes count all processes of a user."""
    return 1_000_000 + os.getpid() % 1_000_000


def of_all(one, name):
    """An empty folder that every user can reach; the try's own folder is in a private one."""
    place = bench(one).folder / f"user-{os.getpid()}"
    shutil.rmtree(place, ignore_errors=True)
    (place / name).mkdir(parents=True)
    os.chmod(place, 0o777)
    return place / name


def kept(one, folder, result):
    """The result; if it is wrong, the folder is copied to the try's own."""
    if result.what == "wrong":
        shutil.copytree(folder, one.folder / folder.name, symlinks=True)
    return result


def open_to_all(out):
    os.chmod(out, 0o777)
    for path in out.iterdir():
        os.chmod(path, 0o666)
