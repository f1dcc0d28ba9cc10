"""What the attack programs share: seeded tries, each in an empty folder and within limits, counted; findings are kept.

An attack program has one function for each kind of thing that it tries:

    def nifti(one):            # one: Try
        ...
        return attack.SAME     # or attack.refused("why"), or attack.wrong("what")

    if __name__ == "__main__":
        sys.exit(attack.main(__doc__, {"nifti": nifti}))

A try depends on its seed alone: `--seed 4711 --count 1 nifti` repeats one. Tries run in processes of their own, some
hundred in each. A try that ends its process or takes longer than a minute is wrong. For a wrong try the folder is
kept as FOLDER/KIND-SEED, with the reason in why.txt.
"""
import argparse
import collections
import contextlib
import dataclasses
import importlib
import json
import os
import pathlib
import re
import resource
import select
import shutil
import signal
import subprocess
import sys
import tempfile
import time
import traceback

try:
    import numpy as np
except ImportError as error:
    print(f"skipped: {error}")
    sys.exit(77)

ROOT = pathlib.Path(__file__).resolve().parents[2]
BATCH = 200  # tries in one process


@dataclasses.dataclass(frozen=True)
class Result:
    what: str  # "same", "refused" or "wrong"
    why: str = ""


SAME = Result("same")


def refused(why):
    """isonest reports an error where an error is allowed. `why`: always the same text for the same reason; they are
    counted."""
    return Result("refused", why)


def wrong(why):
    return Result("wrong", why)


def reason(message, folder=""):
    """An error's message without names and numbers, so that the same reason gives the same text. folder: of the try."""
    text = (str(message).strip().splitlines() or [""])[0].replace(str(folder), "")
    text = re.sub(r"^\S*?: ", "", re.sub(r"^isonest(-mpi)?: error: ", "", text))
    text = re.sub(r"'[^']*'|\"[^\"]*\"", "'...'", text)
    return re.sub(r"[-+]?\d[\d.e+-]*( x N)*", "N", re.sub(r"\S*/\S+", "FILE", text))[:160]


@dataclasses.dataclass(frozen=True)
class Done:
    """The result of a program. A negative `code` is the signal that ended it; "hang": it was killed after its time
    limit."""
    code: object
    out: str
    err: str


def ended(process, seconds=30):
    """The result of a process, which is killed after this number of seconds."""
    try:
        out, err = process.communicate(timeout=seconds)
        code = process.returncode
    except subprocess.TimeoutExpired:
        process.kill()
        out, err = process.communicate()
        code = "hang"
    return Done(code, (out or b"").decode(errors="replace"), (err or b"").decode(errors="replace"))


class Try:
    """One try: its seed, random numbers, empty folder, and the program."""

    def __init__(self, seed, folder, program):
        self.seed = seed
        self.random = np.random.default_rng(seed)
        self.folder = folder
        self.program = program

    def pick(self, *choices):
        return choices[int(self.random.integers(len(choices)))]

    def chance(self, part):
        return self.random.random() < part

    def run(self, *arguments, heap=None, seconds=10, environment=None):
        """Runs the program with these arguments in the try's folder. heap: limit of its data in bytes (RLIMIT_DATA)."""
        def limit():
            resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
            if heap is not None:
                resource.setrlimit(resource.RLIMIT_DATA, (heap, heap))
        process = subprocess.Popen([self.program, *map(os.fspath, map(_word, arguments))], cwd=self.folder,
                                   stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.PIPE,
                                   preexec_fn=limit, env={**os.environ, **(environment or {})})
        return ended(process, seconds)


def require(*names):
    """Imports these Python modules; exits with code 77 if one is missing."""
    modules = []
    for name in names:
        try:
            modules.append(importlib.import_module(name))
        except ImportError as error:
            print(f"skipped: {error}")
            sys.exit(77)
    return modules if len(modules) > 1 else modules[0]


def _word(argument):
    return argument if isinstance(argument, os.PathLike) else str(argument)


def package(program):
    """The Python package of the build tree that `program` is in."""
    folder = str(pathlib.Path(program).resolve().parent.parent / "python")
    if folder not in sys.path:
        sys.path.insert(0, folder)
    return importlib.import_module("isonest")


def _one(function, kind, seed, folder, program):
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    try:
        result = function(Try(seed, folder, program))
    except Exception:  # the attack program's own mistakes must be seen
        result = wrong("the attacker failed:\n" + traceback.format_exc())
    return result


def _folder_of_wrong(folder, seed):
    return folder.with_name(f"{folder.name}-wrong-{seed}")


def _batch(function, kind, seeds, folder, program, out, ends):
    for seed in seeds:
        if time.monotonic() > ends:
            return
        os.write(out, (json.dumps({"seed": seed}) + "\n").encode())
        result = _one(function, kind, seed, folder, program)
        if result.what == "wrong" and folder.exists():
            folder.rename(_folder_of_wrong(folder, seed))  # the next try empties its own folder
        os.write(out, (json.dumps({"seed": seed, "what": result.what, "why": result.why}) + "\n").encode())


class Worker:
    """A process that makes a batch of tries until the time is up."""

    def __init__(self, function, kind, seeds, folder, program, ends):
        read, write = os.pipe()
        self.begun, self.at, self.rest, self.folder = None, time.monotonic(), b"", folder
        self.pid = os.fork()
        if self.pid == 0:
            os.close(read)
            os.setpgid(0, 0)
            _batch(function, kind, seeds, folder, program, write, ends)
            os._exit(0)
        os.close(write)
        self.read = read

    def lines(self):
        """What the process has reported since the last call; None at its end."""
        data = os.read(self.read, 1 << 16)
        if not data:
            return None
        self.at = time.monotonic()
        *lines, self.rest = (self.rest + data).split(b"\n")
        return [json.loads(line) for line in lines]

    def kill(self):
        for process in (-self.pid, self.pid):
            try:
                os.killpg(self.pid, signal.SIGKILL) if process < 0 else os.kill(self.pid, signal.SIGKILL)
            except ProcessLookupError:
                pass


class Tally:
    def __init__(self, kind, keep):
        self.kind, self.keep = kind, keep
        self.counts = collections.Counter()
        self.reasons = collections.Counter()

    def add(self, seed, result, folder):
        self.counts[result.what] += 1
        if result.what == "refused":
            self.reasons[result.why] += 1
        if result.what != "wrong":
            return
        place = self.keep / f"{self.kind}-{seed}"
        shutil.rmtree(place, ignore_errors=True)
        place.parent.mkdir(parents=True, exist_ok=True)
        of_wrong = _folder_of_wrong(folder, seed)
        with contextlib.suppress(shutil.Error):  # FIFOs and sockets are not copied
            if of_wrong.exists():
                shutil.move(of_wrong, place)
            elif folder.exists():  # its process has ended
                shutil.copytree(folder, place, symlinks=True)
        place.mkdir(parents=True, exist_ok=True)
        (place / "why.txt").write_text(result.why + "\n")
        last = (result.why.strip().splitlines() or ["?"])[-1]
        print(f"wrong: {self.kind} --seed {seed}: {last}  ({place})", file=sys.stderr, flush=True)

    @property
    def tried(self):
        return sum(self.counts.values())

    def row(self, seconds):
        of = self.counts
        return f"| {self.kind} | {self.tried:,} | {of['same']:,} | {of['refused']:,} | {of['wrong']:,} | {seconds:.0f} |"


def attack(kind, function, options, folder):
    """All tries of one kind."""
    tally = Tally(kind, options.keep)
    ends = time.monotonic() + options.seconds
    following, last = options.seed, options.seed + options.count
    workers = []
    size = max(1, min(BATCH, -(-options.count // options.jobs)))
    while True:
        while len(workers) < options.jobs and following < last and time.monotonic() < ends:
            seeds = range(following, min(following + size, last))
            following = seeds.stop
            workers.append(Worker(function, kind, seeds, folder / f"{kind}-{following}" / "try", options.isonest, ends))
            workers[-1].left = collections.deque(seeds)
        if not workers:
            return tally
        ready, _, _ = select.select([worker.read for worker in workers], [], [], 1)
        for worker in list(workers):
            lines = worker.lines() if worker.read in ready else []
            hangs = time.monotonic() - worker.at > options.patience
            for said in lines or []:
                if "what" in said:
                    worker.begun = None
                    worker.left.popleft()
                    tally.add(said["seed"], Result(said["what"], said["why"]), worker.folder)
                else:
                    worker.begun = said["seed"]
            over = lines is not None and time.monotonic() > ends and worker.begun is None
            if lines is not None and not hangs and not over:
                continue
            if hangs or over:
                worker.kill()
            os.close(worker.read)
            _, status = os.waitpid(worker.pid, 0)
            workers.remove(worker)
            if worker.begun is not None:
                why = f"no end after {options.patience} s" if hangs else f"its process ended: {os.waitstatus_to_exitcode(status)}"
                tally.add(worker.begun, wrong(why), worker.folder)
                worker.left.popleft()
                if worker.left and time.monotonic() < ends:  # the tries that its process did not get to
                    rest = Worker(function, kind, list(worker.left), worker.folder, options.isonest, ends)
                    rest.left = worker.left
                    workers.append(rest)


def main(doc, kinds, more=None):
    """Runs the tries that the command line asks for and prints the table; returns the number of wrong tries, at most
    100.

    kinds: name -> function of a Try. more: called with the parser before parsing and with the options after it.
    """
    parser = argparse.ArgumentParser(description=doc.strip(), formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("kinds", nargs="*", metavar="KIND", help="of " + ", ".join(kinds) + " (all, if none is given)")
    parser.add_argument("--isonest", type=pathlib.Path, default=ROOT / "build/bin/isonest", help="the program, in its build tree")
    parser.add_argument("--seconds", type=float, default=1e9, help="for each kind, at most")
    parser.add_argument("--count", type=int, default=100, help="tries of each kind, at most (%(default)s)")
    parser.add_argument("--seed", type=int, default=1, help="of the first try; the others follow (%(default)s)")
    parser.add_argument("--jobs", type=int, default=1, help="processes (%(default)s)")
    parser.add_argument("--patience", type=float, default=60, help="seconds until a try hangs (%(default)s)")
    parser.add_argument("--keep", type=pathlib.Path, default=pathlib.Path("attack-out"), help="folder for what is wrong (%(default)s)")
    parser.add_argument("--reasons", action="store_true", help="also say why files were refused, and how often")
    if more:
        more(parser)
    options = parser.parse_args()
    options.isonest = options.isonest.resolve()
    unknown = [kind for kind in options.kinds if kind not in kinds]
    if unknown:
        parser.error(f"no {', '.join(unknown)}: there are {', '.join(kinds)}")
    if not options.isonest.exists():
        parser.error(f"there is no {options.isonest}: build it, or name it by --isonest")
    print("| | tried | same | refused | wrong | seconds |\n|---|---|---|---|---|---|", flush=True)
    wrong_ones = 0
    with tempfile.TemporaryDirectory(prefix="isonest-attack-") as folder:
        for kind in options.kinds or kinds:
            begun = time.monotonic()
            tally = attack(kind, kinds[kind], options, pathlib.Path(folder))
            print(tally.row(time.monotonic() - begun), flush=True)
            if options.reasons:
                for why, count in tally.reasons.most_common():
                    print(f"  {count:6} {why}", flush=True)
            wrong_ones += tally.counts["wrong"]
    return min(wrong_ones, 100)
