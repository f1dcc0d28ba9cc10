"""A process of isonest view, the resources that it holds, and connections that need not follow HTTP."""
import contextlib
import json
import os
import pathlib
import resource
import signal
import socket
import subprocess
import time
import urllib.parse

MOST_ANONYMOUS = 200 << 20  # beyond --memory: threads' stacks and memory of the libraries (view_trust_test.py)


class Broken(Exception):
    """The bytes received are not an HTTP/1.1 answer as described in PROTOCOL.md."""


class View:
    """The server, with its own folder for temporary files."""

    def __init__(self, program, store, folder, *options, memory=512 << 20, environment=None):
        self.memory, self.scratch = memory, pathlib.Path(folder) / "tmp"
        self.scratch.mkdir(exist_ok=True)
        self.process = subprocess.Popen(
            [program, "view", store, "--port", "0", "--json", "--threads", "2", "--memory", str(memory), *options], cwd=folder,
            env={**os.environ, "TMPDIR": str(self.scratch), **(environment or {})}, stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE, stderr=subprocess.PIPE,
            preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_CORE, (0, 0)))
        first = self.process.stdout.readline()
        if not first:
            raise RuntimeError("isonest view did not start: " + self.process.communicate()[1].decode(errors="replace"))
        self.url = json.loads(first)["url"]
        parts = urllib.parse.urlsplit(self.url)
        self.host, self.port = parts.hostname, parts.port
        self.name = parts.netloc
        self.token = urllib.parse.parse_qs(parts.query).get("token", [None])[0]

    def connect(self, receive=None, seconds=30):
        address = "127.0.0.1" if self.host == "localhost" else self.host
        s = socket.socket(socket.AF_INET6 if ":" in address else socket.AF_INET)
        if receive:
            s.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, receive)
        s.settimeout(seconds)
        s.connect((address, self.port))
        return s

    def request(self, target, method="GET", headers=(), version="1.1", body=b""):
        lines = [f"{method} {target} HTTP/{version}"]
        if not any(name.lower() == "host" for name, _ in headers):
            lines.append(f"Host: {self.name}")
        lines += [f"{name}: {value}" for name, value in headers]
        return ("\r\n".join(lines) + "\r\n\r\n").encode("latin-1") + body

    def ask(self, target, method="GET", headers=(), seconds=60):
        """One request on a connection of its own."""
        with contextlib.closing(self.connect(seconds=seconds)) as s:
            s.sendall(self.request(target, method, headers))
            return Answers(s).next(head=method == "HEAD")

    def with_token(self, target):
        return target + (("&" if "?" in target else "?") + "token=" + self.token if self.token else "")

    def status(self):
        return json.loads(self.ask(self.with_token("/api/status")).body)

    def holds(self):
        """Numbers of descriptors and threads, bytes of private memory, and the names in its folder for temporary
        files."""
        process = pathlib.Path("/proc") / str(self.process.pid)
        lines = dict(line.split(":", 1) for line in (process / "status").read_text().splitlines() if ":" in line)
        return {"descriptors": len(os.listdir(process / "fd")), "threads": int(lines["Threads"]),
                "anonymous": int(lines["RssAnon"].split()[0]) << 10, "files": sorted(os.listdir(self.scratch))}

    def what_is_left(self, before, seconds=15):
        """What it holds in addition to `before` once there are no more requests; None if nothing."""
        end = time.monotonic() + seconds
        while True:
            now = self.holds()
            # The 2 threads for computations (--threads) are started by the first request that needs them.
            left = [f"{name}: {before[name]} before, {now[name]} after" for name, more in (("descriptors", 0), ("threads", 2))
                    if now[name] > before[name] + more]
            left += [f"temporary files {now['files']}"] if now["files"] else []
            if now["anonymous"] > self.memory + MOST_ANONYMOUS:
                return f"{now['anonymous']} bytes of its own with --memory {self.memory}"
            if not left or time.monotonic() > end:
                return "; ".join(left) or None
            time.sleep(0.02)

    def end(self, number=signal.SIGINT):
        """Exit code and standard error."""
        if self.process.poll() is None:
            self.process.send_signal(number)
        try:
            _, err = self.process.communicate(timeout=30)
        except subprocess.TimeoutExpired:
            self.process.kill()
            self.process.communicate()
            return "hang", ""
        return self.process.returncode, err.decode(errors="replace")

    def wrong_end(self):
        code, err = self.end()
        if (code, err) != (0, ""):
            return f"it ended with {code}: {err[:500]}"
        left = sorted(os.listdir(self.scratch))
        return f"after its end there is {left}" if left else None


class Answer:
    def __init__(self, status, headers, body):
        self.status, self.headers, self.body = status, headers, body

    @property
    def json(self):
        return json.loads(self.body)

    def wrong_form(self):
        """How the answer violates PROTOCOL.md, whatever the request; None if it does not."""
        if "access-control-allow-origin" in self.headers:
            return "an answer allows other origins"
        for name in ("content-security-policy", "x-content-type-options", "cache-control", "cross-origin-resource-policy"):
            if name not in self.headers:
                return f"an answer without {name}"
        kind = self.headers.get("content-type")
        if self.status in (200, 204):
            return None
        if self.status == 431 or (self.status == 400 and kind == "text/plain"):
            short = len(self.body) < 200 and self.body.endswith(b"\n")
            return None if short or not self.body else "an odd line of text"  # an answer to HEAD has no body
        if self.status not in (400, 403, 404, 405, 409, 410, 413, 500, 503):
            return f"status {self.status}"
        if self.body or "content-length" not in self.headers:
            try:
                error = json.loads(self.body)["error"]
                good = isinstance(error["kind"], str) and error["message"] and isinstance(error["remedies"], list)
                good = good and all({"kind", "value", "text"} <= set(remedy) for remedy in error["remedies"])
            except (ValueError, KeyError, TypeError):
                good = False
            if not good or kind != "application/json":
                return f"{self.status} with the body {self.body[:200]!r}"
        return None


class Answers:
    """The answers on one connection, one after the other."""

    def __init__(self, s):
        self.socket, self.rest = s, b""

    def _more(self):
        data = self.socket.recv(1 << 16)
        self.rest += data
        return bool(data)

    def next(self, head=False):
        """None if the connection ended before an answer began; raises Broken if it ended within one."""
        try:
            while b"\r\n\r\n" not in self.rest:
                if len(self.rest) > 1 << 16:
                    raise Broken("a head without an end")
                if not self._more():
                    if self.rest:
                        raise Broken(f"it ended within a head: {self.rest[:80]!r}")
                    return None
        except (ConnectionError, BrokenPipeError):
            if self.rest:
                raise Broken("reset within a head") from None
            return None
        text, self.rest = self.rest.split(b"\r\n\r\n", 1)
        first, *lines = text.decode("latin-1").split("\r\n")
        words = first.split(" ", 2)
        if len(words) < 3 or words[0] != "HTTP/1.1" or not words[1].isdigit():
            raise Broken(f"a first line {first!r}")
        headers = {}
        for line in lines:
            name, colon, value = line.partition(": ")
            if not colon or name.lower() in headers or any(ord(c) < 32 for c in line):
                raise Broken(f"a header {line!r}")
            headers[name.lower()] = value
        status = int(words[1])
        length = int(headers.get("content-length", "0"))
        if "transfer-encoding" in headers or (status == 204 and "content-length" in headers):
            raise Broken(f"a {status} with {headers}")
        if head:
            return Answer(status, headers, b"")
        while len(self.rest) < length:
            try:
                if not self._more():
                    raise Broken(f"{len(self.rest)} bytes of {length}")
            except ConnectionError:
                raise Broken(f"reset after {len(self.rest)} bytes of {length}") from None
        body, self.rest = self.rest[:length], self.rest[length:]
        return Answer(status, headers, body)
