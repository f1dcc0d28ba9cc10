"""Signals and kills at random moments, and the next run."""
import dataclasses
import pathlib
import signal
import tempfile
import time

import attack

from .commands import contents, judge, run, start
from .tries import bench, options, output_folder, pick


def usual_seconds(one, command):
    """The approximate duration of an undisturbed run."""
    known = usual_seconds.__dict__
    if command.name not in known:
        with tempfile.TemporaryDirectory(dir=bench(one).folder) as folder:
            begun = time.monotonic()
            run(bench(one), command, folder, folder)
            known[command.name] = time.monotonic() - begun
    return known[command.name]


def wait_until_it_watches(process):
    """Waits until the program is loaded and has installed its signal handlers; false if it ended before."""
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
    """One or several signals at random moments after the program has installed its handlers."""
    command = pick(one, python=False)
    out, old = output_folder(one, command)
    seconds = usual_seconds(one, command)
    process = start(bench(one), command, one.folder, out, *options(one, command))
    if not wait_until_it_watches(process):
        return judge(bench(one), command, out, old, attack.ended(process), ())
    kinds = [one.pick(*ENDING, *HARMLESS) for _ in range(one.pick(1, 1, 2, 3))]
    for kind in kinds:
        time.sleep(one.random.random() * seconds * 1.2 / len(kinds))
        send(process, kind)
    done = attack.ended(process)
    if done.code == -signal.SIGPIPE and signal.SIGPIPE in kinds:
        done = dataclasses.replace(done, code=0)  # its outputs are complete: only the report is cut
    ends = [kind for kind in kinds if kind in ENDING]
    twice = len([kind for kind in ends if kind != signal.SIGHUP]) > 1 or (len(ends) > 1 and ends[-1] != signal.SIGHUP)
    result = judge(bench(one), command, out, old, done, (130,) if ends else (), tell=not twice, whole_after=(6, 130), left=twice)
    if result.what != "wrong" and any(path.name.startswith(".") for path in out.iterdir()):
        return next_run(one, command, out, kinds)
    return result


def kill(one):
    """SIGKILL, and the next run: it names what remains, or nothing remains."""
    command = pick(one, python=False)
    out, old = output_folder(one, command)
    seconds = usual_seconds(one, command)
    process = start(bench(one), command, one.folder, out, *options(one, command))
    time.sleep(one.random.random() * seconds * 1.1)
    process.kill()
    done = attack.ended(process)
    result = judge(bench(one), command, out, old, done, (-signal.SIGKILL,), tell=False, whole_after=(-signal.SIGKILL,), left=True)
    return result if result.what == "wrong" or done.code == 0 else next_run(one, command, out, ["SIGKILL"])


def next_run(one, command, out, kinds):
    # The contents of a folder that remains belong to it.
    left = [path for path in out.rglob("*") if path.name.startswith(".")
            and not any(part.startswith(".") for part in path.relative_to(out).parts[:-1])]
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
