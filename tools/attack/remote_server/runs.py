"""One run of the program against a server, and what is asked of it whatever the server does."""
import contextlib
import json
import os
import pathlib
import re
import resource
import signal
import subprocess
import threading
import time

import attack

from . import answers
from .hostile import SECRET_OF_OTHERS

MIB = 1 << 20
BASE = 40 * MIB  # the program and its libraries
MARGIN = 64 * MIB
LONGEST = 55  # seconds of a run; a server that may be tried again is tried for up to a minute, see plan()
MOMENT = 4  # seconds until a signal has ended a run
ENDS = {3: "not_found", 4: "corrupt", 5: "unsupported", 6: "io"}
CLEAN = {name: value for name, value in os.environ.items()
         if not name.startswith(("AWS_", "SSL_CERT", "CURL_", "ISONEST_")) and not name.lower().endswith("_proxy")}


def plan(one, mode, has_checksums=False, redirects=True):
    """fault_of() for a server. mode: of MODES."""
    seed, many = one.seed, {"good": 0, "mild": 0, "wild": 0.08, "bad": 0.6}[mode]
    harmless = [fault for fault in answers.HARMLESS if redirects or fault is not answers.elsewhere]
    wild = answers.WILD + answers.ODD + answers.BUSY + [answers.damaged] * 3 * has_checksums

    def mild_fault(request):
        """Each thing that is asked for: some busy answers or one odd one; then harmless ones."""
        lot = answers.lot_of(seed, request.key)
        kind, busy = lot.random(), lot.choice((1, 1, 2))
        lot = answers.lot_of(seed, request.key, request.times)
        if kind < 0.12 and request.times < busy:
            return lot.choice(answers.BUSY)
        if 0.12 <= kind < 0.2 and request.times == 0:
            fault = lot.choice(answers.ODD)
            # To who asks first, everything is what a server answers that knows no ranges.
            knows = any(name in request.headers for name in ("if-match", "if-unmodified-since"))
            return fault if knows or fault is not answers.whole else None
        return lot.choice(harmless) if lot.random() < 0.3 else None

    def wild_fault(request):
        lot = answers.lot_of(seed, request.key, request.times)
        if lot.random() < many:
            return lot.choice(wild)
        return lot.choice(harmless) if lot.random() < 0.1 else None

    return {"good": None, "mild": mild_fault}.get(mode, wild_fault)


class Run:
    """Done.code, .out, .err; .seconds, .memory (the most that was resident)."""

    def __init__(self, one, arguments, environment=None, stop=None, user=None, most_file=None):
        """stop: (signal, seconds after the start)."""
        self.one, self.arguments, self.most_file = one, [str(argument) for argument in arguments], most_file
        (one.folder / "tmp").mkdir(exist_ok=True)
        names = [one.folder / "tmp" / f".said-{id(self)}-{end}" for end in ("out", "err")]

        def limit():
            resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
            signal.signal(signal.SIGINT, signal.SIG_DFL)  # in the background a shell ignores it
            if most_file is not None:
                resource.setrlimit(resource.RLIMIT_FSIZE, (most_file, most_file))
            if user is not None:
                os.setgroups([])
                os.setresgid(user, user, user)
                os.setresuid(user, user, user)
        with contextlib.ExitStack() as files:
            out, err = (files.enter_context(open(name, "wb")) for name in names)
            self.begun = time.monotonic()
            self.process = subprocess.Popen([one.program, *self.arguments], cwd=one.folder, stdin=subprocess.DEVNULL, stdout=out, stderr=err,
                                            preexec_fn=limit, env={**CLEAN, "HOME": str(one.folder / "home"), "TMPDIR": str(one.folder / "tmp"),
                                                                   **(environment or {})})
        self.names, self.stop, self.stopped_at, self.hangs = names, stop, None, False
        self.watch = threading.Thread(target=self._wait)
        self.watch.start()
        self.lookout = threading.Thread(target=self._stop)
        self.lookout.start()

    def _wait(self):
        _, self.status, used = os.wait4(self.process.pid, 0)
        self.seconds, self.memory = time.monotonic() - self.begun, used.ru_maxrss * 1024

    def _stop(self):
        if self.stop:
            self.watch.join(self.stop[1])
            if self.watch.is_alive():
                self.stopped_at = time.monotonic()
                self._send(self.stop[0])
                self.watch.join(MOMENT)
        self.watch.join(max(LONGEST - (time.monotonic() - self.begun), 0) if self.stopped_at is None else 0)
        if self.watch.is_alive():
            self.hangs = True
            self._send(signal.SIGKILL)

    def _send(self, number):
        with contextlib.suppress(ProcessLookupError):
            os.kill(self.process.pid, number)

    def end(self):
        self.lookout.join()
        self.watch.join()
        self.process.returncode = self.code = os.waitstatus_to_exitcode(self.status)
        self.out, self.err = (name.read_bytes().decode(errors="replace") for name in self.names)
        for name in self.names:
            name.unlink()
        return self

    def said(self):
        return f"{' '.join(self.arguments)}\ncode {self.code} after {self.seconds:.1f} s, {self.memory >> 20} MiB\n{self.out[-3000:]}\n{self.err[-3000:]}"


class Judge:
    """What a run may do: the bytes of the local run, or a clear error; no secret anywhere, nothing left, no more memory."""

    def __init__(self, one, secrets, memory, must_succeed=False, kept=()):
        self.one, self.secrets, self.memory, self.must_succeed = one, list(secrets) + [SECRET_OF_OTHERS], memory, must_succeed
        self.kept = {pathlib.Path(path) for path in kept}

    def files(self):
        return {path for path in self.one.folder.rglob("*") if not path.is_dir() and not any(kept in (path, *path.parents) for kept in self.kept)}

    def secret_in(self, done):
        words = [secret.encode() for secret in self.secrets]
        for where, text in (("what it says", (done.out + done.err).encode()),
                            *((str(path), path.read_bytes() if path.is_file() and not path.is_symlink() else b"") for path in self.one.folder.rglob("*")
                              if not any(path.is_relative_to(kept) for kept in self.kept))):
            for word in words:
                if word in text or word in where.encode():
                    return f"a secret is in {where}"
        return None

    def __call__(self, done, before, output, right):
        """output: a path or None, right: its bytes, or what is said. None if all is well, and (why) if it was refused."""
        if done.hangs:
            return attack.wrong(f"no end: {'%.1f s after a signal' % MOMENT if done.stopped_at else LONGEST}\n" + done.said())
        secret = self.secret_in(done)
        if secret:
            return attack.wrong(f"{done.said()}\n{secret}")
        if self.memory is not None and done.memory > BASE + MARGIN + self.memory:
            return attack.wrong(f"{done.said()}\n{done.memory >> 20} MiB resident, with --memory {self.memory >> 20}M")
        left = self.files() - before - ({output} if done.code == 0 and output else set())
        if left:
            return attack.wrong(f"{done.said()}\nleft: {sorted(map(str, left))}")
        if done.code == 0:
            got = output.read_bytes() if output else said_of(done.out)
            return attack.SAME if got in (right if isinstance(right, list) else [right]) else attack.wrong(f"{done.said()}\nother bytes than those of the file")
        if done.stopped_at is not None and done.code in (130, -done.stop[0]):
            return attack.refused("interrupted")
        if done.code == 2 and not self.must_succeed and "is no store" in done.err + done.out:
            return attack.refused("another object")
        if done.code not in ENDS:
            return attack.wrong(f"{done.said()}\ncode {done.code}")
        if done.code == 4 and done.arguments[0] == "check" and not self.must_succeed and '"findings": [' in done.out:
            return attack.refused("check finds damage")
        fault = self.fault_in_error(done)
        if fault:
            return attack.wrong(f"{done.said()}\n{fault}")
        if self.must_succeed:
            return attack.wrong(f"{done.said()}\nan error where trying again is right")
        return attack.refused(reason(done))

    @staticmethod
    def fault_in_error(done):
        if "--json" in done.arguments:
            try:
                error = json.loads(done.out)["error"]
            except (ValueError, KeyError):
                return "no error in its JSON"
            return None if error["message"] and error["kind"] == ENDS[done.code] else "another kind of error than its code says"
        lines = done.err.strip().splitlines()
        if not lines or not any(line.startswith("isonest: error: ") for line in lines):
            return "no error is said"
        if re.search("[\0-\x08\x0b-\x1f\x7f]", done.err.replace("\r", "")):
            return "control characters in its error"
        return None


def said_of(text):
    """What is said of a store, without where it is and how it was fetched."""
    values = json.loads(text)
    for name in ("file", "store", "path", "input", "remote", "seconds", "analyses", "warnings", "warning", "notes"):
        values.pop(name, None)
    return values


def reason(done):
    text = json.loads(done.out)["error"]["message"] if "--json" in done.arguments else \
        next(line for line in done.err.splitlines() if line.startswith("isonest: error: "))
    text = re.sub(r"^(isonest: error: )?\S+?: ", "", text)
    return re.sub(r"\d+", "N", text)[:110]
