#!/usr/bin/env python3
"""Attacks isonest-mpi: one to five ranks on one machine, on random small volumes, with random options.

The ranks write the same bytes as one process, or all end with an error that says what is wrong; no incomplete file has
the name of the output; nothing takes longer than a minute and a half.

preprocess  random volumes, chunks, memory, fields, crops
extract     random queries of stores
killed      ranks or mpirun get signals at random moments; --resume continues with other numbers of ranks
limits      small disks, file size limits for one rank, scratch folders that one rank does not have, inputs that are
            truncated during the run, damaged stores
"""
import contextlib
import itertools
import os
import pathlib
import resource
import shlex
import shutil
import signal
import subprocess
import sys
import threading
import time

sys.path.insert(0, str(pathlib.Path(__file__).parent))
import attack  # noqa: E402
import numpy as np  # noqa: E402

LONGEST = 90
ENVIRONMENT = {**os.environ, "OMPI_ALLOW_RUN_AS_ROOT": "1", "OMPI_ALLOW_RUN_AS_ROOT_CONFIRM": "1", "OMPI_MCA_btl_vader_single_copy_mechanism": "none"}
CODES = {2, 3, 4, 5, 6, 7}


class Ranks:
    """mpirun with these commands: (number of ranks, words before the program, arguments)."""

    def __init__(self, one, *parts):
        self.program = one.program.parent / "isonest-mpi"
        commands = [shlex.join(map(str, [*front, self.program, *arguments])) for _, front, arguments in parts]
        if len(parts) == 1:
            words = ["-n", parts[0][0], *shlex.split(commands[0])]
        else:  # a shell chooses: mpirun of Open MPI 5.0.7, in Debian 13, crashes with several programs, even /bin/true
            ends = itertools.accumulate(count for count, _, _ in parts)
            choice = "".join(f"[ $OMPI_COMM_WORLD_RANK -ge {end} ] || exec {command}\n" for end, command in zip(ends, commands))
            words = ["-n", sum(count for count, _, _ in parts), "sh", "-c", choice]
        self.words = [str(word) for word in words]
        (one.folder / "tmp").mkdir(exist_ok=True)
        self.names = [one.folder / "tmp" / f"said-{id(self)}-{end}" for end in ("out", "err")]

        def limit():
            os.setsid()
            resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
            signal.signal(signal.SIGINT, signal.SIG_DFL)  # a shell makes background processes ignore it
        with open(self.names[0], "wb") as out, open(self.names[1], "wb") as err:
            self.process = subprocess.Popen(["mpirun", "--oversubscribe", *self.words], cwd=one.folder, stdin=subprocess.DEVNULL, stdout=out, stderr=err,
                                            preexec_fn=limit, env={**ENVIRONMENT, "TMPDIR": str(one.folder / "tmp")})
        self.begun = time.monotonic()

    def ranks(self):
        """The processes of the ranks."""
        found = []
        for entry in pathlib.Path("/proc").iterdir():
            if entry.name.isdigit():
                with contextlib.suppress(OSError, ValueError, IndexError):
                    group = int((entry / "stat").read_text().rpartition(")")[2].split()[3])  # the field is the session
                    if group == self.process.pid and (entry / "exe").resolve() == self.program:
                        found.append(int(entry.name))
        return sorted(found)

    def end(self, one):
        try:
            self.code = self.process.wait(LONGEST)
            self.hangs = False
        except subprocess.TimeoutExpired:
            self.code, self.hangs = "hang", True
        self.left = self.ranks()
        if self.left and not self.hangs:
            time.sleep(3)
            self.left = self.ranks()
        for number in self.ranks():
            with contextlib.suppress(ProcessLookupError):
                os.kill(number, signal.SIGKILL)
        if self.hangs:
            with contextlib.suppress(ProcessLookupError):
                os.killpg(self.process.pid, signal.SIGKILL)
            self.process.wait()
        self.seconds = time.monotonic() - self.begun
        self.out, self.err = (name.read_bytes().decode(errors="replace") for name in self.names)
        for name in self.names:
            name.unlink()
        shutil.rmtree(one.folder / "tmp", ignore_errors=True)
        return self

    def said(self):
        return f"mpirun --oversubscribe {' '.join(self.words)}\ncode {self.code} after {self.seconds:.1f} s, left {self.left}\n{self.out[-1500:]}\n{self.err[-3000:]}"


def launched(one, count, *arguments):
    return Ranks(one, (count, [], arguments)).end(one)


def judged(done, output, right, plain_code=0, may_fail=False, is_killed=False):
    """right: the bytes that one process writes; None: one process fails with plain_code."""
    if done.hangs and is_killed and not done.left:
        return attack.refused("mpirun hangs without ranks")  # for example if one rank ends while others start
    if done.hangs:
        return attack.wrong(f"{done.said()}\nno end after {LONGEST} s")
    if done.left and not is_killed:
        return attack.wrong(f"{done.said()}\nranks go on without mpirun")
    if output.exists() and (right is None or output.read_bytes() != right):
        return attack.wrong(f"{done.said()}\nother bytes than one process writes" if right is not None else f"{done.said()}\nan output where one process fails")
    if done.code == 0:
        return attack.SAME if output.exists() else attack.wrong(f"{done.said()}\nno output")
    if is_killed:
        return attack.refused("killed")
    if output.exists():
        return attack.wrong(f"{done.said()}\nan error, and an output")
    if not may_fail and right is not None:
        return attack.wrong(f"{done.said()}\nan error where one process has none")
    if done.code not in CODES or "isonest-mpi: error: " not in done.err:
        return attack.wrong(f"{done.said()}\ncode {done.code}, or no error is said")
    if right is None and done.code != plain_code:
        return attack.wrong(f"{done.said()}\none process ends with {plain_code}")
    text = next(line for line in done.err.splitlines() if "isonest-mpi: error: " in line).partition("error: ")[2]
    return attack.refused(attack.reason(text))


def left_beside(folder, *names):
    return sorted(path.name for path in folder.iterdir() if path.name not in names and path.name not in ("tmp", "scratch"))


def a_volume(one, folder, most=(48, 44, 40)):
    """The volume's file name, and the options that it needs."""
    shape = tuple(int(one.random.integers(1, n)) for n in most)[::-1]
    kind = one.pick("u1", "i2", "f4", "f8", "labels")
    at = np.indices(shape)
    values = sum(np.sin(a / one.random.uniform(2, 9) + one.random.random() * 6) for a in at) * 40 + 120 + one.random.random(shape) * one.pick(0, 9)
    if kind == "labels":
        values, kind = np.floor(values / 30), "u1"
        labels = ["--labels"]
    else:
        labels = []
    values = values.astype(kind)
    if kind in ("f4", "f8") and one.chance(0.3):
        values[one.random.random(shape) < 0.02] = np.nan
    values.tofile(folder / "v.raw")
    return folder / "v.raw", ["--dims", ",".join(map(str, shape[::-1])), "--type", kind, *labels]


def make_options(one):
    options = ["--chunk", one.pick("8", "8", "16", "32")]
    options += one.pick([], [], ["--indicators", "all"], ["--indicators", "linf_plus,normal_turn_bar,hex_deviation"], ["--exact"])
    options += one.pick([], [], [], ["--every", "2"], ["--spacing", "1,0.5,2"], ["--missing", "120"], ["--compression", "9"])
    return options + one.pick([], ["--memory", "64M"], ["--memory", "40M"])


def plain(one, *arguments):
    return one.run(*arguments, seconds=60)


def preprocess(one):
    volume, needs = a_volume(one, one.folder)
    options = [*needs, *make_options(one), "--threads", one.pick("1", "2")]
    expected, output = one.folder / "plain.isonest", one.folder / "s.isonest"
    alone = plain(one, "preprocess", volume, "-o", expected, *options)
    scratch = []
    if one.chance(0.3):
        (one.folder / "scratch").mkdir()
        scratch = ["--scratch", one.folder / "scratch"]
    done = launched(one, one.pick(1, 2, 2, 3, 4, 5), "preprocess", volume, "-o", output, *options, *scratch)
    result = judged(done, output, expected.read_bytes() if alone.code == 0 else None, alone.code)
    if result.what != "wrong":
        left = left_beside(one.folder, "v.raw", "plain.isonest", "s.isonest") + ([str(path) for path in (one.folder / "scratch").iterdir()] if scratch else [])
        if left:
            return attack.wrong(f"{done.said()}\nleft: {left}")
    return result


_stores = {}


def stores(one):
    """Some stores, shared by all tries of this process."""
    folder = one.folder.parent / "stores"
    if folder not in _stores:
        folder.mkdir()
        _stores[folder] = []
        for i in range(6):
            lot = attack.Try(one.seed * 10 + i, folder, one.program)
            volume, needs = a_volume(lot, folder, (70, 60, 50))
            store = folder / f"{i}.isonest"
            subprocess.run([one.program, "preprocess", volume, "-o", store, *needs, "--chunk", lot.pick("8", "16"), "--indicators", "all", "-q"], check=True)
            _stores[folder].append((store, "--labels" in needs))
    return _stores[folder]


def a_query(one, is_labels):
    """Arguments, and the file name extension of the output."""
    if is_labels:
        return ["--label", one.pick("2", "3", "all"), *one.pick([], ["--smooth"], ["--smooth", "--close"])], ".ply"
    options = ["--iso", f"{one.random.uniform(70, 170):.3g}"]
    options += one.pick([], ["--error", "3"], ["--error-relative", "0.05"], ["--distance", "0.7"], ["--distance", "1", "--effort", "fast"], ["--triangles", "500"],
                        ["--error", "4"], ["--cells", "hex"], ["--distance", "1", "--effort", "none"])
    options += one.pick([], [], [], ["--close"], ["--close=above"])
    options += one.pick([], [], [], ["--components", "largest"], ["--min-component", "20"])
    options += one.pick([], [], [], ["--box", "3,3,3,30,20,25"])
    options += one.pick([], [], ["--normals"], ["--vertex-error", "linf_plus"])
    return options + one.pick([], ["--memory", "96M"]), one.pick(".ply", ".ply", ".stl", ".vtp", ".glb", ".obj", ".3mf", ".vtkhdf")


def extract(one):
    stored = stores(one)
    store, is_labels = stored[int(one.random.integers(len(stored)))]
    options, ending = a_query(one, is_labels)
    options += ["--threads", one.pick("1", "2")]
    expected, output = one.folder / f"plain{ending}", one.folder / f"m{ending}"
    if "all" in options:
        return refused_or_same_folders(one, store, options)
    alone = plain(one, "extract", store, "-o", expected, *options)
    done = launched(one, one.pick(1, 2, 2, 3, 4, 5), "extract", store, "-o", output, *options)
    result = judged(done, output, expected.read_bytes() if alone.code == 0 else None, alone.code)
    left = left_beside(one.folder, expected.name, output.name)
    return attack.wrong(f"{done.said()}\nleft: {left}") if left and result.what != "wrong" else result


def refused_or_same_folders(one, store, options):
    near, far = one.folder / "near", one.folder / "far"
    near.mkdir()
    far.mkdir()
    alone = plain(one, "extract", store, "-o", near, *options)
    done = launched(one, one.pick(2, 3), "extract", store, "-o", far, *options)
    if done.hangs or done.code != alone.code:
        return attack.wrong(f"{done.said()}\none process: {alone}")
    for path in {path.name for folder in (near, far) for path in folder.iterdir()}:
        if not (near / path).exists() or not (far / path).exists() or (near / path).read_bytes() != (far / path).read_bytes():
            return attack.wrong(f"{done.said()}\n{path} is another")
    return attack.SAME if alone.code == 0 else attack.refused("as by one process")


def killed(one):
    volume, needs = a_volume(one, one.folder, (100, 90, 80))
    options = [*needs, "--chunk", one.pick("8", "16"), "--threads", "1", "--indicators", one.pick("all", "linf_bar")]
    expected, folder = one.folder / "plain.isonest", one.folder / "out"
    folder.mkdir()
    output = folder / "s.isonest"
    alone = plain(one, "preprocess", volume, "-o", expected, *options)
    if alone.code != 0:
        return attack.refused("no such volume")
    right = expected.read_bytes()
    resume = one.chance(0.7)
    ways = []
    for _ in range(int(one.random.integers(1, 4))):
        run = Ranks(one, (one.pick(1, 2, 3, 4, 5), [], ["preprocess", volume, "-o", output, *options, "--force", *(["--resume"] if resume else [])]))
        until = time.monotonic() + 20
        while not run.ranks() and run.process.poll() is None and time.monotonic() < until:
            time.sleep(0.005)
        before = {path.name for path in folder.iterdir()}
        while {path.name for path in folder.iterdir()} <= before and run.process.poll() is None and time.monotonic() < until and one.seed % 5:
            time.sleep(0.002)  # mpirun itself may hang if ranks end while they start
        time.sleep(one.random.uniform(0, 0.3))
        alive = run.ranks()
        how = one.pick("kill one", "kill one", "stop one", "stop all", "mpirun", "mpirun twice", "stop and kill")
        ways.append(how)
        with contextlib.suppress(ProcessLookupError, IndexError):
            number = one.pick(signal.SIGTERM, signal.SIGINT, signal.SIGHUP)
            if how == "kill one":
                os.kill(alive[int(one.random.integers(len(alive)))], signal.SIGKILL)
            elif how == "stop one":
                os.kill(alive[int(one.random.integers(len(alive)))], number)
            elif how == "stop all":
                for rank in alive:
                    os.kill(rank, number)
            elif how == "stop and kill":
                os.kill(alive[0], signal.SIGTERM)
                os.kill(alive[-1], signal.SIGKILL)
            else:
                os.kill(run.process.pid, number)
                if how == "mpirun twice":
                    time.sleep(one.random.uniform(0, 0.2))
                    os.kill(run.process.pid, number)
        done = run.end(one)
        result = judged(done, output, right, is_killed=True)
        if result.what == "wrong":
            return attack.wrong(f"{ways}\n{result.why}")
        output.unlink(missing_ok=True)
        if how in ("stop one", "stop all") and not resume and done.code != 0 and "kill one" not in ways and "mpirun" not in str(ways) and \
                "stop and kill" not in ways and left_beside(folder):
            return attack.wrong(f"{ways}\n{done.said()}\nleft after a signal: {left_beside(folder)}")
    again = launched(one, one.pick(1, 2, 3, 4), "preprocess", volume, "-o", output, *options, "--force", *(["--resume"] if resume else []))
    result = judged(again, output, right)
    return attack.wrong(f"{ways}\n{result.why}") if result.what == "wrong" else result


def limits(one):
    volume, needs = a_volume(one, one.folder, (90, 80, 70))
    options = [*needs, "--chunk", one.pick("8", "16"), "--threads", "1", "--indicators", one.pick("all", "linf_bar")]
    expected, folder = one.folder / "plain.isonest", one.folder / "out"
    folder.mkdir()
    output, count = folder / "s.isonest", one.pick(2, 3, 4)
    alone = plain(one, "preprocess", volume, "-o", expected, *options)
    if alone.code != 0:
        return attack.refused("no such volume")
    right = expected.read_bytes()
    words = ["preprocess", volume, "-o", output, *options]
    kind = one.pick("disk", "file size of all", "file size of one", "no scratch", "cut input", "scratch disk", "no folder", "damaged store", "data of one")
    mounted = None
    try:
        if kind in ("disk", "scratch disk"):
            mounted = folder if kind == "disk" else one.folder / "scratch"
            mounted.mkdir(exist_ok=True)
            size = max(int(len(right) * one.random.uniform(0.1, 2.5)), 8192)
            if subprocess.run(["mount", "-t", "tmpfs", "-o", f"size={size}", "tmpfs", mounted], capture_output=True).returncode != 0:
                mounted = None
            if kind == "scratch disk":
                words += ["--scratch", mounted or one.folder]
            done = launched(one, count, *words)
        elif kind == "file size of all":
            done = Ranks(one, (count, ["prlimit", f"--fsize={int(one.random.integers(20_000, 2 * len(right) + 20_001))}"], words)).end(one)
        elif kind in ("file size of one", "data of one"):
            limit = f"--fsize={int(one.random.integers(1, len(right) + 2))}" if kind == "file size of one" else f"--data={int(one.random.integers(20, 200))}000000"
            fronts = [["prlimit", limit], []] if one.chance(0.5) else [[], ["prlimit", limit]]
            done = Ranks(one, (1, fronts[0], words), (count - 1, fronts[1], words)).end(one)
        elif kind == "no scratch":
            (one.folder / "scratch").mkdir()
            there, nowhere = [*words, "--scratch", one.folder / "scratch"], [*words, "--scratch", one.folder / "nowhere"]
            parts = [(1, [], there), (count - 1, [], nowhere)]
            done = Ranks(one, *(parts if one.chance(0.5) else parts[::-1])).end(one)
            if done.code == 0:
                return attack.wrong(f"{done.said()}\nit does without a folder that it should use")
        elif kind == "cut input":
            run = Ranks(one, (count, [], words))

            def cut():
                time.sleep(one.random.uniform(0, 1))
                with contextlib.suppress(OSError):
                    os.truncate(volume, int(os.path.getsize(volume) * one.random.random()))
            thread = threading.Thread(target=cut)
            thread.start()
            done = run.end(one)
            thread.join()
        elif kind == "no folder":
            done = launched(one, count, "preprocess", volume, "-o", one.folder / "none" / "s.isonest", *options)
        else:
            store = one.folder / "damaged.isonest"
            data = bytearray(right)
            for _ in range(int(one.random.integers(1, 30))):
                data[int(one.random.integers(len(data)))] ^= 1 << int(one.random.integers(8))
            store.write_bytes(data)
            near, far = one.folder / "near.ply", one.folder / "far.ply"
            query = ["--label", "2"] if "--labels" in options else ["--iso", "120"]
            alone = plain(one, "extract", store, "-o", near, *query)
            done = launched(one, count, "extract", store, "-o", far, *query)
            return judged(done, far, near.read_bytes() if near.exists() else None, alone.code)
        result = judged(done, output, right, may_fail=True)
        if result.what == "wrong" and kind in ("data of one", "file size of one", "file size of all") and not done.hangs and not output.exists():
            return attack.refused("MPI fails by itself")  # MPI needs memory and files of its own
        left = left_beside(folder, "s.isonest") if folder.exists() else []
        if result.what != "wrong" and left:
            return attack.wrong(f"{kind}\n{done.said()}\nleft: {left}")
        return attack.wrong(f"{kind}\n{result.why}") if result.what == "wrong" else result
    finally:
        if mounted:
            subprocess.run(["umount", "-l", mounted], check=False)


if __name__ == "__main__":
    if shutil.which("mpirun") is None or not any((pathlib.Path(word).parent / "isonest-mpi").exists() for word in sys.argv[1:]) and \
            not (attack.ROOT / "build/bin/isonest-mpi").exists():
        print("skipped: there is no mpirun, or no isonest-mpi")
        sys.exit(77)
    sys.exit(attack.main(__doc__, {"preprocess": preprocess, "extract": extract, "killed": killed, "limits": limits},
                         lambda parser: parser.set_defaults(patience=500)))
