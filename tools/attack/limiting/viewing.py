"""The viewer within limits, with signals and without streams."""
import json
import os
import resource
import signal
import socket
import subprocess
import time

import attack

from .commands import limited
from .tries import bench, cannot_start, power, user_of


def viewer(one):
    """`isonest view` within limits, or with signals: it ends by itself with an error, or serves and ends by a signal with 0."""
    store = bench(one).inputs / "s.isonest"
    case = one.pick("heap", "address space", "descriptors", "threads", "signal", "signal", "streams")
    limits, user = [], None
    if case == "heap":
        limits = [(resource.RLIMIT_DATA, size := power(one, 1 << 20, 600 << 20), size)]
    elif case == "address space":
        limits = [(resource.RLIMIT_AS, size := power(one, 24 << 20, 4 << 30), size)]
    elif case == "descriptors":
        limits = [(resource.RLIMIT_NOFILE, size := int(one.random.integers(3, 40)), size)]
    elif case == "threads" and os.geteuid() == 0:
        limits, user = [(resource.RLIMIT_NPROC, size := int(one.random.integers(1, 20)), size)], user_of(one)
    given = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
    before = []
    if case == "streams":
        before = [lambda fd=fd: os.close(fd) for fd in (0, 1, 2) if one.chance(0.5)]
    process = subprocess.Popen([one.program, "view", store, "--port", "0", "--json", "--threads", str(one.pick(1, 2, 4))], cwd="/",
                               stdin=subprocess.DEVNULL, preexec_fn=limited(limits, user, before), **given)
    begun, url, text = time.monotonic(), None, b""
    os.set_blocking(process.stdout.fileno(), False)
    while time.monotonic() - begun < 5 and url is None and process.poll() is None:
        text += process.stdout.read() or b""
        try:
            url = json.loads(text)["url"]
        except (ValueError, KeyError):
            time.sleep(0.005)
        if case == "streams" and time.monotonic() - begun > 0.5:
            break
    asked = ask(url, one) if url else None
    kind = one.pick(signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
    if process.poll() is None:
        process.send_signal(kind)
        if case == "signal" and one.chance(0.3):
            process.send_signal(kind)
    done = attack.ended(process, 20)
    said = f"{case} {limits} {kind} {asked}: {done}"
    if done.code == 0 and (url or case == "streams"):
        return attack.SAME
    if done.code in (99, 127, -9, -11, -7, 1) and limits and url is None:
        class Plain:
            python = False
        if cannot_start(one, Plain, limits, user):
            return attack.refused("the program cannot be loaded")
    if case == "signal" and done.code == 130:
        return attack.refused("130 (cancelled)")
    if case == "streams" and done.code in (6, -signal.SIGPIPE):
        return attack.refused(f"{done.code}")
    if limits and done.code in (6, 7) and done.err.count("isonest: error: ") == 1:
        return attack.refused(f"{case}: {done.code}")
    return attack.wrong(said)


def ask(url, one):
    """Some requests; what was answered."""
    host, port = url.split("/")[2].split(":")
    said = []
    for path in ("/", "/api/store", "/api/histogram", "/main.js"):
        try:
            with socket.create_connection((host, int(port)), timeout=5) as server:
                server.sendall(f"GET {path} HTTP/1.1\r\nHost: {host}:{port}\r\nConnection: close\r\n\r\n".encode())
                said.append(server.recv(64)[:15])
        except OSError as error:
            said.append(str(error))
    return said
