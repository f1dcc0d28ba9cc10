"""Bytes that are not a request, or more than one, or a request that never ends."""
import concurrent.futures
import contextlib
import socket
import struct
import time

import numpy as np

import attack as shared
from serving import questions, view

HIDDEN = 666  # the request hidden in the body of another one, which must never be answered


def _gone(s):
    """Closed so that the other end gets a reset."""
    s.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
    s.close()


def _all(s, answers, most=100):
    """All answers until the server closes the connection."""
    got = []
    while len(got) < most:
        answer = answers.next()
        if answer is None:
            return got
        if answer.wrong_form():
            raise view.Broken(answer.wrong_form())
        got.append(answer)
    return got


def _ids(got):
    return [answer.json["id"] for answer in got if answer.status == 200 and answer.headers["content-type"] == "application/json"
            and "id" in answer.json]


def _label(server, number, headers=(), **more):
    return server.request(f"/api/label?id={number}", headers=headers, **more)


def _answered(server, data):
    """The answers to these bytes, after which nothing more is sent."""
    with contextlib.closing(server.connect()) as s:
        with contextlib.suppress(OSError):
            s.sendall(data)
            s.shutdown(socket.SHUT_WR)
        return _all(s, view.Answers(s))


def flipped(one, server, r):
    data = bytearray(server.request("/api/slice?plane=0,0,1,3&error=0.1", headers=[("Accept", "*/*"), ("Connection", "close")]))
    for _ in range(int(r.integers(1, 9))):
        at = int(r.integers(len(data)))
        data[at:at + int(r.integers(0, 2))] = bytes(r.integers(0, 256, int(r.integers(0, 3)), dtype=np.uint8))
    if r.random() < 0.2:
        data = bytearray(r.integers(0, 256, int(r.integers(1, 3000)), dtype=np.uint8).tobytes())
    _answered(server, data)


def strange(one, server, r):
    """Other protocols and versions."""
    host = server.name.encode()
    data = (b"GET /\r\n", b"PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n", b"\x16\x03\x01\x02\x00\x01\x00\x01\xfc\x03\x03" + bytes(100),
            b"GET / HTTP/1.2\r\nHost: " + host + b"\r\n\r\n", b"GET / HTTP/9.9\r\nHost: " + host + b"\r\n\r\n", b"\r\n\r\n\r\nGET / HTTP/1.1\r\nHost: " + host + b"\r\n\r\n",
            b"GET  /api/store  HTTP/1.1\r\nHost: " + host + b"\r\n\r\n", b"GET /api/store HTTP/1.1\nHost: " + host + b"\n\n", b"\0" * 5000,
            b"GET /api/store HTTP/1.1\r\nHost : " + host + b"\r\n\r\n", b"GET /api/store HTTP/1.1\r\n Host: " + host + b"\r\n\r\n",
            b"GET /api/store HTTP/1.1\r\nHost: " + host + b"\r\nA: b\r\n c\r\n\r\n", b"GET /api/\0store HTTP/1.1\r\nHost: " + host + b"\r\n\r\n",
            b"GET /api/store HTTP/1.1\r\nHost: " + host + b"\r\nX: \0\r\n\r\n", b"GET\t/api/store\tHTTP/1.1\r\nHost: " + host + b"\r\n\r\n",
            b"GET /api/store HTTP/1.1\r\nHost: " + host + b"\r\nUpgrade: websocket\r\nConnection: Upgrade\r\nSec-WebSocket-Key: AA==\r\n\r\n",
            b"POST /api/cancel HTTP/1.1\r\nHost: " + host + b"\r\nExpect: 100-continue\r\nContent-Length: 3\r\n\r\nabc")[int(r.integers(17))]
    _answered(server, data)


def flood(one, server, r):
    """Headers, targets and bodies beyond the limits: refused by the status or by closing the connection."""
    kind, length = int(r.integers(5)), int(r.integers(17 << 10, 200 << 10))
    if kind == 0:
        data = server.request("/api/label?id=1", headers=[(f"X-{i}", "y" * 50) for i in range(length // 50)])
    elif kind == 1:
        data = server.request("/api/label?id=1&a=" + "b" * length)
    elif kind == 2:
        data = server.request("/api/label?id=1", headers=[("Cookie", "c" * length)])
    elif kind == 3:
        data = server.request("/api/cancel?stream=x", "POST", headers=[("Content-Length", str(length))], body=b"d" * length)
    else:
        data = server.request("/api/cancel?stream=x", "POST", headers=[("Transfer-Encoding", "chunked")]) + b"1;" + b"e" * length + b"\r\nx\r\n0\r\n\r\n"
    got = _answered(server, data)
    # The text after a chunk's length is limited by the buffer of 64 KiB that is read at once.
    taken = kind == 4 and length < 64 << 10
    if any(answer.status not in (400, 431) and not (taken and answer.status == 204) for answer in got):
        return f"flood {kind} of {length}: {[answer.status for answer in got]}"
    return None


def pipelined(one, server, r):
    """Several requests at once are answered in order, however the bytes are split."""
    wanted = [int(n) for n in r.integers(0, 1000, int(r.integers(2, 12)))]
    data = b"".join(_label(server, n, [("Connection", "close")] if i == len(wanted) - 1 else []) for i, n in enumerate(wanted))
    with contextlib.closing(server.connect()) as s:
        if r.random() < 0.5:
            s.sendall(data)
        else:
            s.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            at = 0
            while at < len(data):
                piece = int(r.integers(1, 300))
                s.sendall(data[at:at + piece])
                at += piece
                if r.random() < 0.2:
                    time.sleep(0.002)
        got = _ids(_all(s, view.Answers(s)))
    return None if got == wanted else f"{got} for {wanted}"


def hidden(one, server, r):
    """A request in the body of another one, with contradictory or invalid lengths."""
    inner = _label(server, HIDDEN)
    chunked = f"{len(inner):x}\r\n".encode() + inner + b"\r\n0\r\n\r\n"
    length, te = ("Content-Length", str(len(inner))), ("Transfer-Encoding", "chunked")
    cases = (([length], inner, True), ([te], chunked, True), ([("Content-Length", str(len(chunked))), te], chunked, False),
             ([te, ("Content-Length", str(len(b"0\r\n\r\n" + inner)))], b"0\r\n\r\n" + inner, False),
             ([length, ("Content-Length", "0")], inner, False), ([("Content-Length", "0"), length], inner, False),
             ([("Content-Length", f"{len(inner)}, {len(inner)}")], inner, False), ([("Content-Length", f"+{len(inner)}")], inner, False),
             ([("Content-Length", f"0x{len(inner):x}")], inner, False), ([("Content-Length", f"{len(inner)} ")], inner, True),
             ([("Transfer-Encoding", "identity, chunked")], chunked, False), ([("Transfer-Encoding", "chunked, identity")], chunked, False),
             ([("Transfer-Encoding", "xchunked"), length], inner, False), ([("Transfer-Encoding", "\x0bchunked"), length], inner, False),
             ([("Transfer-Encoding", "chunked"), ("Transfer-Encoding", "identity")], chunked, False),
             ([("Content-Length", str((1 << 64) + len(inner)))], inner, False), ([("Content-Length", "-1")], inner, False),
             ([te], b"-1\r\n" + inner, False), ([te], f"{(1 << 64) + len(inner):x}\r\n".encode() + inner + b"\r\n0\r\n\r\n", False),
             ([te], f"{len(inner):x};a=\"b\"\r\n".encode() + inner + b"\r\n0\r\nTrailer: x\r\n\r\n", True))
    headers, body, good = cases[int(r.integers(len(cases)))]
    path, method = ("/api/cancel?stream=x", "POST") if r.random() < 0.5 else ("/api/label?id=5", "GET")
    data = server.request(path, method, headers=headers, body=body) + _label(server, 7, [("Connection", "close")])
    got = _answered(server, data)
    if HIDDEN in _ids(got):
        return f"{headers}: the hidden request was answered"
    if good and (len(got) != 2 or _ids(got)[-1:] != [7]):
        return f"{headers}: {[answer.status for answer in got]} {_ids(got)}"
    return None


def old(one, server, r):
    """HTTP/1.0 is answered, and the connection is closed unless the client asks to keep it."""
    keeps = r.random() < 0.5
    data = _label(server, 3, [("Connection", "keep-alive")] if keeps else [], version="1.0")
    with contextlib.closing(server.connect()) as s:
        s.sendall(data)
        answers = view.Answers(s)
        first = answers.next()
        if first is None or first.status != 200:
            return f"HTTP/1.0: {first and first.status}"
        if not keeps and answers.next() is not None:
            return "HTTP/1.0 was kept alive"
    return None


def big(server, r):
    return server.request(f"/api/slice?plane=0,0,1,{r.uniform(1, 60):.3f}&error=0")


def slow_writer(one, server, r):
    data = _label(server, 9, [("Connection", "close")])
    with contextlib.closing(server.connect()) as s:
        for at in range(0, len(data), 8):
            s.sendall(data[at:at + 8])
            time.sleep(float(r.random()) * 0.03)
        got = _ids(_all(s, view.Answers(s)))
    return None if got == [9] else f"a slow writer got {got}"


def slow_reader(one, server, r):
    with contextlib.closing(server.connect(receive=4096)) as s:
        s.sendall(big(server, r))
        time.sleep(float(r.random()) * 0.5)
        answer = view.Answers(s).next()
    if answer is not None and answer.status not in (200, 400, 503):
        return f"a slow reader got {answer.status} {answer.body[:200]}"
    return None


def half_closed(one, server, r):
    """A client that has shut down its sending side need not get an answer, but what it gets is a valid one."""
    with contextlib.closing(server.connect()) as s:
        s.sendall(big(server, r) if r.random() < 0.5 else _label(server, 1))
        s.shutdown(socket.SHUT_WR)
        _all(s, view.Answers(s))


def gone(one, server, r):
    """Closed or reset before, within or after the request, or within the answer."""
    s = server.connect(receive=4096 if r.random() < 0.5 else None)
    data = one_of(r, big(server, r), server.request("/api/export?iso=0.5&format=ply"), server.request("/api/histogram"), _label(server, 2))
    with contextlib.suppress(OSError):
        s.sendall(data[:int(r.integers(len(data)))] if r.random() < 0.3 else data * int(r.integers(1, 4)))
        if r.random() < 0.7:
            time.sleep(float(r.random()) * 0.03)
        if r.random() < 0.5:
            s.settimeout(0.1)
            s.recv(int(r.integers(1, 5000)))
    _gone(s) if r.random() < 0.5 else s.close()


def one_of(r, *choices):
    return choices[int(r.integers(len(choices)))]


def many(one, server, r):
    """Idle connections, some with half a request."""
    held = []
    for _ in range(int(r.integers(10, 200))):
        with contextlib.suppress(OSError):
            s = server.connect(seconds=5)
            held.append(s)
            if r.random() < 0.5:
                s.sendall(b"GET /api/la")
    time.sleep(float(r.random()) * 0.1)
    for s in held:
        _gone(s) if r.random() < 0.5 else s.close()


ACTIONS = (flipped, flipped, strange, flood, pipelined, hidden, hidden, old, slow_writer, slow_reader, half_closed, gone, gone)
# Requests that need an answer may find their connection closed while there are too many.
FLOODING = (flipped, strange, half_closed, gone, many)


def wrong_action(action, one, server, seed):
    try:
        wrong = action(one, server, np.random.default_rng(seed))
    except view.Broken as error:
        wrong = str(error)
    except TimeoutError:
        wrong = "it waited without an end"
    except ConnectionError as error:
        wrong = None if action in FLOODING else f"{type(error).__name__}"
    return f"{action.__name__}: {wrong}" if wrong else None


def attack(one):
    isonest = shared.package(one.program)
    path, _ = questions.make_store(one, isonest, kind=one.pick("smooth", "bytes"), most=64)
    actions = FLOODING if one.chance(0.15) else ACTIONS
    chosen = [(one.pick(*actions), int(one.random.integers(1 << 60))) for _ in range(60)]
    server = view.View(one.program, path, one.folder)
    try:
        server.status()
        before = server.holds()
        with concurrent.futures.ThreadPoolExecutor(int(one.random.integers(1, 9))) as pool:
            wrongs = list(pool.map(lambda c: wrong_action(c[0], one, server, c[1]), chosen))
        wrong = next(filter(None, wrongs), None) or server.what_is_left(before)
        if not wrong and server.ask("/api/store").status != 200:
            wrong = "no answer afterwards"
        wrong = wrong or server.wrong_end()
        return shared.wrong(wrong) if wrong else shared.SAME
    finally:
        server.end()
