"""The store changes under the server."""
import concurrent.futures
import contextlib
import os
import shutil
import time

import attack as shared
from serving import answers, questions, truth, view


def _replaced(one, path):
    other = one.folder / "other"
    shutil.copy(one.pick(path, one.folder / "second"), other)
    os.replace(other, path)


def _cut(one, path):
    os.truncate(path, int(one.random.integers(path.stat().st_size)))


def _emptied(one, path):
    with open(path, "wb"):
        pass


def _deleted(one, path):
    path.unlink()


def _is_folder(one, path):
    path.unlink()
    path.mkdir()


def _unreadable(one, path):
    path.chmod(0)


def _appended(one, path):
    with open(path, "ab") as file:
        file.write(b"x" * int(one.random.integers(1, 5000)))


def _flipped(one, path):
    """Bytes of it change, and neither its size nor its times say so."""
    was = path.stat()
    with open(path, "r+b") as file:
        for _ in range(int(one.random.integers(1, 30))):
            at = int(one.random.integers(was.st_size))
            file.seek(at)
            byte = file.read(1)
            file.seek(at)
            file.write(bytes([byte[0] ^ (1 << int(one.random.integers(8)))]))
    os.utime(path, ns=(was.st_atime_ns, was.st_mtime_ns))


def _rewritten(one, path):
    """Another store's bytes in its place, in the same file."""
    was = path.stat()
    data = (one.folder / "second").read_bytes()[:was.st_size]
    with open(path, "r+b") as file:
        file.write(data)
    if one.chance(0.5):
        os.utime(path, ns=(was.st_atime_ns, was.st_mtime_ns))


def _folder_moved(one, path):
    path.parent.rename(one.folder / "moved")


CHANGES = (_replaced, _cut, _emptied, _deleted, _is_folder, _unreadable, _appended, _flipped, _flipped, _rewritten, _folder_moved)
ENDS = (_cut, _emptied)  # after which the program may end, with a message


def attack(one):
    library = truth.codec()
    if library is None:
        return shared.refused("no meshoptimizer to decode with")
    isonest = shared.package(one.program)
    made, kind = questions.make_store(one, isonest, kind=one.pick("smooth", "noise", "bytes", "missing", "labels", "far"), most=40)
    path = one.folder / "store" / "s.isonest"
    path.parent.mkdir()
    shutil.copy(made, path)
    questions.make_store(one, isonest, kind="noise", most=40, name="second")
    shutil.copy(path, one.folder / "first")
    store = isonest.open(one.folder / "first")
    volume = truth.Volume(store)
    change = one.pick(*CHANGES)
    asked = [questions.sensible(one, volume, kind) for _ in range(30)]
    asked = [(where, parameters) for where, parameters in asked if where != "/api/command"]
    before, wait = int(one.random.integers(len(asked))), float(one.random.random()) * 0.02
    server = view.View(one.program, path, one.folder)
    ended = False

    def ask(question):
        try:
            return server.ask(questions.target(*question))
        except (ConnectionError, view.Broken) as error:
            return error

    try:
        with concurrent.futures.ThreadPoolExecutor(int(one.random.integers(1, 9))) as pool:
            first = [pool.submit(ask, question) for question in asked[:before]]
            time.sleep(wait)
            change(one, path)
            rest = [pool.submit(ask, question) for question in asked[before:]]
            got = [answer.result() for answer in first + rest]
        ended = server.process.poll() is not None
        for i, (question, answer) in enumerate(zip(asked, got)):
            where, parameters = question
            if answer is None or isinstance(answer, Exception):
                if change in ENDS:
                    ended = True
                    continue
                return shared.wrong(f"{change.__name__}: {answer!r} to {questions.target(where, parameters)}")
            if answer.wrong_form():
                return shared.wrong(f"{change.__name__}: {answer.wrong_form()}")
            if answer.status in (410, 500):
                continue
            wrong = answers.wrong_answer(answer, where, dict(parameters), store, volume, isonest, kind, library, one.folder, str(i))
            if wrong:
                return shared.wrong(f"{change.__name__} {kind}: {questions.target(where, parameters)}\n{wrong}")
        if ended:
            code, err = server.end()
            if code != 6 or "isonest" not in err:
                return shared.wrong(f"{change.__name__}: it ended with {code}: {err[:500]}")
            left = sorted(os.listdir(server.scratch))
            return shared.wrong(f"{change.__name__}: after its end there is {left}") if left else shared.refused("the store was cut off, and the program ended with a message")
        if change not in (_unreadable, _flipped, _rewritten):
            said = server.ask("/api/surface?iso=0.5" if kind != "labels" else "/api/surface?label=1")
            if said.status != 410:
                return shared.wrong(f"{change.__name__}: {said.status} afterwards")
        if server.status()["store"] not in ("ok", "replaced", "cut off"):
            return shared.wrong("its status says something else")
        wrong = server.wrong_end()
        return shared.wrong(f"{change.__name__}: {wrong}") if wrong else shared.SAME
    finally:
        server.end()
        with contextlib.suppress(OSError):
            path.chmod(0o644)
