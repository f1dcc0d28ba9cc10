"""A server of the files of a folder that misbehaves as it is told.

    with Hostile(folder, fault_of) as server:
        server.url("a.bin")

fault_of(request) gives a function of remote_server.answers, or None. Requests and what they had are in server.seen.
`server.other` is a second server of the same folder, at another port, to which redirects may lead; it misbehaves not.
"""
import email.utils
import hashlib
import os
import pathlib
import re
import socket
import ssl
import struct
import subprocess
import threading
import time
import urllib.parse

from .answers import Answer, Request, lot_of

SECRET_OF_OTHERS = "0thersS3cret"


def certificate(folder, name="127.0.0.1"):
    """A certificate for a name or an address, and its key: two files."""
    files = folder / f"certificate-{name}.pem", folder / f"key-{name}.pem"
    if not files[0].exists():
        kind = "IP" if name[0].isdigit() else "DNS"
        subprocess.run(["openssl", "req", "-x509", "-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:prime256v1", "-nodes", "-days", "2",
                        "-subj", f"/CN={name}", "-addext", f"subjectAltName={kind}:{name}", "-out", files[0], "-keyout", files[1]],
                       check=True, capture_output=True)
    return files


class Hostile:
    """tls: files of certificate(). tls_fault(): bytes to send in place of a handshake, or None. validators: names of the
    headers that tell a version. absent(path): whether 404 is right where there is no file."""

    def __init__(self, folder, fault_of=None, seed=0, tls=None, tls_fault=None, validators=("ETag", "Last-Modified"), is_other=False,
                 knows_tails=True, other_tls=True, absent=None):
        self.absent = absent or (lambda path: True)
        self.folder, self.fault_of, self.seed = pathlib.Path(folder), fault_of or (lambda request: None), seed
        self.tls, self.tls_fault, self.validators, self.knows_tails = tls, tls_fault or (lambda: None), validators, knows_tails
        self.begun, self.log = time.monotonic(), []
        self.seen, self.times, self.lock, self.closing = [], {}, threading.Lock(), threading.Event()
        self.replaced, self.kept, self.connections = {}, {}, set()
        self.secret_of_others = SECRET_OF_OTHERS
        self.context = None
        if tls:
            self.context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
            self.context.load_cert_chain(*tls)
        self.listener = socket.create_server(("127.0.0.1", 0), backlog=256)
        self.port = self.listener.getsockname()[1]
        self.other = None if is_other else Hostile(folder, tls=tls if other_tls else None, validators=validators, is_other=True,
                                                          absent=self.absent)
        self.thread = threading.Thread(target=self.accept, daemon=True)

    def __enter__(self):
        if self.other:
            self.other.replaced = self.replaced
            self.other.__enter__()
        self.thread.start()
        return self

    def __exit__(self, *_):
        self.closing.set()
        try:
            self.listener.shutdown(socket.SHUT_RDWR)
        except OSError:
            pass
        self.listener.close()
        with self.lock:
            for connection in list(self.connections):
                try:
                    connection.shutdown(socket.SHUT_RDWR)
                except OSError:
                    pass
        if self.other:
            self.other.__exit__()

    def place(self, path):
        return f"{'https' if self.tls else 'http'}://127.0.0.1:{self.port}{path}"

    def url(self, name, userinfo=""):
        return self.place("/" + name).replace("://", "://" + userinfo)

    def file_of(self, path):
        """None if there is none."""
        name = os.path.normpath(urllib.parse.unquote(path)).lstrip("/")
        name = self.replaced.get(name, name)
        file = self.folder / name
        return file if not name.startswith("..") and file.is_file() else None

    def data_of(self, path):
        file = self.file_of(path)
        if file is None:
            return b""
        if file not in self.kept:
            self.kept[file] = file.read_bytes()
        return self.kept[file]

    def decoy(self, path):
        """A file of this machine with other bytes than those of this path."""
        return f"{self.folder}/decoy{pathlib.PurePosixPath(path).suffix}"

    def accept(self):
        while not self.closing.is_set():
            try:
                connection, _ = self.listener.accept()
            except OSError:
                return
            with self.lock:
                self.connections.add(connection)
            threading.Thread(target=self.serve, args=(connection,), daemon=True).start()

    def serve(self, raw):
        connection = raw
        try:
            raw.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            raw.settimeout(30)
            if self.context:
                broken = self.tls_fault()
                if broken is not None:
                    raw.sendall(broken)
                    return
                connection = self.context.wrap_socket(raw, server_side=True)
            rest = b""
            while not self.closing.is_set():
                while b"\r\n\r\n" not in rest:
                    more = connection.recv(1 << 16)
                    if not more:
                        return
                    rest += more
                head, _, rest = rest.partition(b"\r\n\r\n")
                if not self.answer_to(connection, head.decode("latin-1")):
                    return
        except (OSError, ValueError):
            pass
        finally:
            with self.lock:
                self.connections.discard(raw)
            connection.close()

    def request_of(self, head):
        line, *lines = head.split("\r\n")
        method, target, _ = line.split(" ", 2)
        headers = {}
        for text in lines:
            name, _, value = text.partition(":")
            headers[name.strip().lower()] = value.strip()
        path, _, query = target.partition("?")
        asked = re.fullmatch(r"bytes=(\d*)-(\d*)", headers.get("range", ""))
        is_tail = asked and (not asked[1] or asked[2] == str(len(self.data_of(path)) - 1))
        key = path + ":" + ("" if not asked else "tail" if is_tail else asked[2])
        with self.lock:
            times = self.times.get(key, 0)
            self.times[key] = times + 1
            self.seen.append({"method": method, "path": path, "query": query, **headers})
        return Request(method, path, query, headers, key, times)

    def right(self, request):
        file = self.file_of(request.path)
        if file is None:
            return Answer().plain("404 Not Found" if self.absent(request.path) else "500 Lost", b"nothing here")
        data = self.data_of(request.path)
        of_version = {"ETag": '"%s"' % hashlib.md5(data).hexdigest(), "Last-Modified": email.utils.formatdate(
            1_700_000_000 + int.from_bytes(hashlib.md5(data).digest()[:3], "big"), usegmt=True)}
        answer = Answer(headers=[(name, of_version[name]) for name in self.validators])
        if "if-match" in request.headers and request.headers["if-match"] != answer.get("ETag"):
            return answer.plain("412 Precondition Failed")
        asked = re.fullmatch(r"bytes=(\d*)-(\d*)", request.headers.get("range", ""))
        if not asked or (not asked[1] and not self.knows_tails):
            answer.status, answer.body = "200 OK", data
        else:
            size = len(data)
            first = int(asked[1]) if asked[1] else max(size - int(asked[2]), 0)
            last = min(int(asked[2]), size - 1) if asked[1] and asked[2] else size - 1
            if first > last:
                return answer.plain("416 Not there", b"", Content_Range=f"bytes */{size}")
            answer.body = data[first:last + 1]
            answer.headers.append(("Content-Range", f"bytes {first}-{last}/{size}"))
        answer.headers.append(("Content-Length", str(len(answer.body))))
        return answer

    def answer_to(self, connection, head):
        """Whether the connection goes on."""
        request = self.request_of(head)
        fault = self.fault_of(request)
        answer = self.right(request)
        if fault is not None:
            fault(answer, lot_of(self.seed, request.key, request.times, "how"), self, request)
        message = answer.message()
        with self.lock:
            self.log.append(f"{time.monotonic() - self.begun:6.2f} {request.path} {request.headers.get('range', '')} #{request.times} "
                            f"{fault.__name__ if fault else ''} {message[:300 if fault else 24]!r} {answer.cut or ''}")
        if answer.delay:
            self.closing.wait(answer.delay)
        if answer.cut is not None:
            message = message[:int(len(message) * answer.cut)]
        pieces, seconds = answer.pause or (1, 0)
        size = max(-(-len(message) // pieces), 1)
        for at in range(0, len(message), size):
            connection.sendall(message[at:at + size])
            if seconds:
                self.closing.wait(seconds)
        if answer.cut is not None and answer.reset:
            connection.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
            return False
        return answer.cut is None and not answer.ends
