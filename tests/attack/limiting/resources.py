"""Too little memory, disk space, time, too few descriptors or threads."""
import ctypes
import os
import resource
import shutil
import subprocess

import attack

from .commands import contents, judge, limited, run
from .tries import bench, cannot_start, kept, of_all, open_to_all, options, output_folder, pick, power, user_of, with_limits

CLONE_NEWNS, MS_REC, MS_PRIVATE = 0x20000, 0x4000, 1 << 18
LIBC = ctypes.CDLL(None, use_errno=True)


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
    """Whether this process may mount file systems that no other process sees."""
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
        if result.what == "wrong":  # only this process sees the mount
            shutil.copytree(place, one.folder / "disk-then")
        return result
    finally:
        LIBC.umount2(os.fsencode(place), 2)


def cpu(one):
    """A limit of processor time for a command that takes longer."""
    words, output = one.pick(
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
    done = attack.ended(process, 50)
    left = sorted(os.listdir(out))
    if done.code == 0 and left == [output]:
        return attack.SAME
    if done.code == 130 and not left and done.err.count("isonest: error: ") == 1:
        return attack.refused("130 (cancelled)")
    return attack.wrong(f"{words}: {left}: {done}")
