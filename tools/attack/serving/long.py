"""All that the other kinds ask, of one server, for as long as it is told; what it holds is looked at each second."""
import threading
import time

import numpy as np

import attack as shared
from serving import answers, questions, requests, truth, view, wire

_seconds = 2.0
GROWTH = 48 << 20  # bytes of its own beyond those of the first third, in the middle: answers on their way are peaks


def set_seconds(text):
    global _seconds
    _seconds = float(text)
    return _seconds


def _client(one, seed, server, path, ends, counts, wrongs):
    """Questions of all kinds, one after the other."""
    isonest = shared.package(one.program)
    mine = shared.Try(seed, one.folder, one.program)
    library, number = truth.codec(), 0
    store = isonest.open(path)
    volume = truth.Volume(store)
    while time.monotonic() < ends and not wrongs:
        number += 1
        kind = mine.pick("answer", "requests", "wire")
        if kind == "answer":
            where, parameters = questions.sensible(mine, volume, "smooth")
            try:
                answer = server.ask(questions.target(where, parameters))
            except ConnectionError:
                answer = None
            # With many others a connection may be closed for a newer one, and an answer given up for others.
            wrong = None
            if answer is not None and answer.status != 503 and library:
                wrong = answers.wrong_answer(answer, where, dict(parameters), store, volume, isonest, "smooth", library, one.folder, f"{seed}-x")
            wrong = wrong and f"{questions.target(where, parameters)}\n{wrong}"
        elif kind == "requests":
            wrong = requests.one_client(server, [questions.hostile(mine) for _ in range(10)])
            wrong = None if wrong and "no answer" in wrong else wrong
        else:
            action = mine.pick(*wire.ACTIONS, wire.many)
            wrong = wire.wrong_action(action, mine, server, int(mine.random.integers(1 << 60)))
            if wrong and ("Error" in wrong or "reset" in wrong or "for [" in wrong or "got" in wrong or "bytes of" in wrong or "[]" in wrong):
                wrong = None
        counts[kind] = counts.get(kind, 0) + 1
        if wrong:
            wrongs.append(wrong)


def attack(one):
    isonest = shared.package(one.program)
    path, _ = questions.make_store(one, isonest, kind="smooth", most=64)
    server = view.View(one.program, path, one.folder)
    counts, wrongs, samples = {}, [], []
    try:
        server.status()
        before = server.holds()
        begun = time.monotonic()
        seeds = one.random.integers(1 << 60, size=6)
        clients = [threading.Thread(target=_client, args=(one, int(seed), server, path, begun + _seconds, counts, wrongs)) for seed in seeds]
        for client in clients:
            client.start()
        while any(client.is_alive() for client in clients):
            if server.process.poll() is not None:
                wrongs.append("it ended")
                break
            samples.append((time.monotonic() - begun, server.holds()))
            time.sleep(min(1, _seconds / 20))
        for client in clients:
            client.join()
        wrong = wrongs[0] if wrongs else server.what_is_left(before, seconds=90)
        third = max(1, len(samples) // 3)
        own = [sample["anonymous"] for _, sample in samples]
        usual = [float(np.median(part)) for part in (own[:third], own[-third:])]
        if not wrong and usual[1] > usual[0] + GROWTH:
            wrong = f"it grew from {usual[0]:.0f} to {usual[1]:.0f} bytes of its own"
        if not wrong and max(sample["descriptors"] for _, sample in samples) > before["descriptors"] + 128 + 40:
            wrong = "more descriptors than connections and files need"
        wrong = wrong or server.wrong_end()
        if _seconds > 10:
            with open("attack-long.txt", "a") as file:
                tenths = np.array_split(own, 10)
                file.write(f"seed {one.seed}: {_seconds:.0f} s, asked {counts}; of its own, in tenths of the time, usually "
                           f"{[int(np.median(part)) >> 20 for part in tenths]} and at most {[int(max(part)) >> 20 for part in tenths]} MiB; "
                           f"descriptors {before['descriptors']} before, at most {max(s['descriptors'] for _, s in samples)}, "
                           f"{np.median([s['descriptors'] for _, s in samples]):.0f} in the middle; threads {before['threads']}, at most {max(s['threads'] for _, s in samples)}; "
                           f"{wrong or 'nothing wrong'}\n")
        return shared.wrong(wrong) if wrong else shared.SAME
    finally:
        server.end()
