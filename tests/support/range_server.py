"""A file server for tests: ranges, counts, a delay and a rate, HTTPS, signatures and passwords, and scripted faults.
Uses only the standard library.

    with RangeServer(folder) as server:
        server.url("a.bin")     # http://127.0.0.1:PORT/a.bin
        server.requests, server.bytes

As a program: range_server.py FOLDER [--port N] [--delay MS] [--rate MBIT/S] [--tls]; it writes its URL.
"""
import argparse
import base64
import datetime
import hashlib
import hmac
import http.server
import pathlib
import re
import socket
import ssl
import struct
import subprocess
import sys
import threading
import time
import urllib.parse

PIECE = 16384
PAGE = b"<!DOCTYPE html><html><title>Please log in</title></html>\n"


def certificate(folder, host="127.0.0.1"):
    """A self-signed certificate for `host`, and its key: the two files."""
    files = folder / "certificate.pem", folder / "key.pem"
    subprocess.run(["openssl", "req", "-x509", "-newkey", "rsa:2048", "-nodes", "-days", "2", "-subj", f"/CN={host}",
                    "-addext", f"subjectAltName=IP:{host},DNS:localhost", "-out", files[0], "-keyout", files[1]],
                   check=True, capture_output=True)
    return files


class Link:
    """A link with a number of bytes per second that all connections share."""

    def __init__(self, rate):
        self.rate, self.free_at, self.lock = rate, 0, threading.Lock()

    def pass_on(self, size):
        if self.rate:
            with self.lock:
                now = time.monotonic()
                self.free_at = max(self.free_at, now) + size / self.rate
                wait = self.free_at - now
            time.sleep(wait)


def signature_fault(method, path, headers, keys, now=None):
    """Why this request is not signed by one of `keys` ({id: (secret, session or "")}); empty if it is.

    Source: "Authenticating requests (AWS Signature Version 4)", Amazon S3 API reference."""
    match = re.fullmatch(r"AWS4-HMAC-SHA256 Credential=([^/]+)/(\d{8})/([^/]+)/s3/aws4_request, ?"
                         r"SignedHeaders=([^,]+), ?Signature=([0-9a-f]{64})", headers.get("Authorization", ""))
    if not match:
        return "not signed"
    key, day, region, names, signature = match.groups()
    if key not in keys:
        return "unknown key"
    secret, session = keys[key]
    names = names.split(";")
    present = {name.lower() for name in headers.keys()}
    needed = {"host"} | {name for name in present if name.startswith("x-amz-")}
    if not needed <= set(names) <= present or names != sorted(names):
        return f"signed headers {names}"
    if headers.get("x-amz-security-token", "") != session:
        return "another session"
    stamp = headers.get("x-amz-date", "")
    sent = datetime.datetime.strptime(stamp, "%Y%m%dT%H%M%SZ").replace(tzinfo=datetime.timezone.utc)
    if stamp[:8] != day or abs((now or datetime.datetime.now(datetime.timezone.utc)) - sent) > datetime.timedelta(minutes=15):
        return "another time"
    if headers.get("x-amz-content-sha256") not in (hashlib.sha256(b"").hexdigest(), "UNSIGNED-PAYLOAD"):
        return "another body"
    uri, _, query = path.partition("?")
    # A key is encoded once, whatever the client has sent.
    canonical_uri = urllib.parse.quote(urllib.parse.unquote(uri), safe="/-_.~")
    canonical_query = "&".join(sorted(query.split("&"))) if query else ""
    lines = [method, canonical_uri, canonical_query]
    lines += [f"{name}:{' '.join(headers[name].split())}" for name in names]
    lines += ["", ";".join(names), headers["x-amz-content-sha256"]]
    scope = f"{day}/{region}/s3/aws4_request"
    text = "\n".join(["AWS4-HMAC-SHA256", stamp, scope, hashlib.sha256("\n".join(lines).encode()).hexdigest()])
    derived = ("AWS4" + secret).encode()
    for part in (day, region, "s3", "aws4_request", text):
        derived = hmac.new(derived, part.encode(), hashlib.sha256).digest()
    return None if hmac.compare_digest(derived.hex(), signature) else "wrong signature"


class Handler(http.server.BaseHTTPRequestHandler):
    protocol_version = "HTTP/1.1"
    disable_nagle_algorithm = True
    wbufsize = 1 << 16

    def setup(self):
        time.sleep(self.server.owner.delay * self.server.owner.handshakes)
        super().setup()

    def log_message(self, *_):
        pass

    def answer(self, status, headers=(), body=b"", length=None, also=b""):
        """`length`: the Content-Length, if it is to be wrong."""
        self.send_response(status)
        for name, value in {**self.server.owner.extra(self.command, self.path), **dict(headers)}.items():
            self.send_header(name, value)
        self.send_header("Content-Length", str(len(body) if length is None else length))
        self.end_headers()
        self.write_body(body + also)
        if length is not None or also:
            self.wfile.flush()
            self.close_connection = True

    def write_body(self, body, pause=0, piece=PIECE):
        for at in range(0, len(body), piece):
            part = body[at:at + piece]
            self.server.owner.link.pass_on(len(part))
            self.wfile.write(part)
            self.server.owner.count(0, len(part))
            if pause:
                self.wfile.flush()
                time.sleep(pause)

    def reset(self):
        """The client sees a broken connection."""
        self.wfile.flush()
        self.connection.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
        self.close_connection = True
        self.connection.close()

    def do_GET(self):
        owner = self.server.owner
        number = owner.count(1, 0)
        owner.note({"path": self.path, **{name.lower(): value for name, value in self.headers.items()}})
        time.sleep(owner.delay)
        fault = owner.fault_of(number, self.path, self.headers) or ""
        try:
            self.do_request(owner, fault)
        except (OSError, ValueError):
            self.close_connection = True

    def do_HEAD(self):
        owner = self.server.owner
        number = owner.count(1, 0)
        owner.note({"method": "HEAD", "path": self.path, **{name.lower(): value for name, value in self.headers.items()}})
        path = owner.folder / urllib.parse.unquote(self.path.partition("?")[0]).lstrip("/")
        if not path.is_file() or owner.fault_of(number, self.path, self.headers) == "no_head":
            return self.answer(405 if path.is_file() else 404)
        data = owner.data_of(path)
        self.send_response(200)
        for name, value in {**owner.extra(self.command, self.path), **owner.validators(path, data)}.items():
            self.send_header(name, value)
        self.send_header("Content-Length", str(len(data)))
        return self.end_headers()

    def do_OPTIONS(self):
        owner = self.server.owner
        owner.count(1, 0)
        owner.note({"method": "OPTIONS", "path": self.path, **{name.lower(): value for name, value in self.headers.items()}})
        self.answer(owner.options, {}, b"")

    def do_request(self, owner, fault):
        if fault.startswith("status:"):
            _, status, *retry_after = fault.split(":")
            return self.answer(int(status), {"Retry-After": retry_after[0]} if retry_after else {},
                               b"<?xml version='1.0'?><Error><Code>TestFault</Code><Secret>s3cret</Secret></Error>")
        if fault.startswith("redirect:"):
            return self.answer(302, {"Location": fault.removeprefix("redirect:")}, b"elsewhere")
        if fault == "silent":
            owner.closing.wait(owner.silence)
            return self.reset()
        if fault == "garbage":
            self.wfile.write(b"\0\1\2 what is this\r\n\r\n" * 3)
            self.close_connection = True
            return None
        if fault == "half_head":
            self.wfile.write(b"HTTP/1.1 200 OK\r\nContent-Type: text/plain\r\n")
            self.close_connection = True
            return None
        if fault in ("large_head", "long_line"):
            count, length = (500, 1000) if fault == "large_head" else (1, 3_000_000)
            self.wfile.write(b"HTTP/1.1 200 OK\r\n" + b"".join(b"X-%d: %s\r\n" % (i, b"x" * length) for i in range(count)) + b"\r\n")
            self.close_connection = True
            return None
        if fault == "reset":
            return self.reset()
        if owner.keys:
            why = signature_fault(self.command, self.path, self.headers, owner.keys)
            if why:
                owner.note({"signature": why})
                return self.answer(403, {}, f"<Error><Code>SignatureDoesNotMatch</Code><Why>{why}</Why></Error>".encode())
        if owner.password:
            asked = "Basic " + base64.b64encode(":".join(owner.password).encode()).decode()
            if self.headers.get("Authorization") != asked:
                return self.answer(401, {"WWW-Authenticate": "Basic"}, b"who is it?")
        return self.send_range(owner, fault)

    def send_range(self, owner, fault):
        path = owner.folder / urllib.parse.unquote(self.path.partition("?")[0]).lstrip("/")
        if not path.is_file():
            return self.answer(404, {}, b"nothing here")
        data = owner.data_of(path)
        size = len(data)
        headers = dict(owner.validators(path, data))
        if fault == "etag":
            headers = {"ETag": '"another"', "Last-Modified": "Thu, 01 Jan 1970 00:00:00 GMT"}
            data = bytes(size)
        elif self.headers.get("If-Match", headers.get("ETag")) != headers.get("ETag"):
            return self.answer(412, headers)
        if fault == "no_etag":
            headers = {}
        if fault == "gzip":
            headers["Content-Encoding"] = "gzip"
        asked = re.fullmatch(r"bytes=(\d*)-(\d*)", self.headers.get("Range", ""))
        if fault in ("page", "long_page"):
            return self.answer(200, headers, PAGE * (1 if fault == "page" else 20_000_000 // len(PAGE)))
        if "Range" not in self.headers:
            return self.send_whole(headers, data, fault)
        if not asked or not owner.knows_ranges or fault == "whole" or (not asked[1] and not owner.knows_tails):
            return self.answer(200, headers, bytes(data))
        first = int(asked[1]) if asked[1] else max(size - int(asked[2]), 0)
        last = min(int(asked[2]), size - 1) if asked[1] and asked[2] else size - 1
        if first >= size or first > last:
            return self.answer(416, {**headers, "Content-Range": f"bytes */{size}"})
        if fault == "less" and asked[1]:
            last = first + (last - first) // 2
        body = bytes(data[first:last + 1])
        headers["Content-Range"] = f"bytes {first}-{last}/{size}"
        if fault == "range_wrong":
            headers["Content-Range"] = f"bytes {first + 1}-{last + 1}/{size + 1 if last + 1 == size else size}"
        elif fault == "range_shifted":
            shift = 1 if first == 0 else -1
            headers["Content-Range"] = f"bytes {first + shift}-{last}/{size}"
        elif fault == "range_missing":
            del headers["Content-Range"]
        elif fault == "range_damaged":
            headers["Content-Range"] = "bytes some/of it"
        elif fault == "size":
            headers["Content-Range"] = f"bytes {first}-{last}/{size + 17}"
        elif fault == "short":
            return self.answer(206, headers, body[:len(body) // 2], length=len(body))
        elif fault == "short_length":
            return self.answer(206, headers, body[:len(body) // 2])
        elif fault == "long":
            return self.send_chunked(headers, body + b"more than was asked for")
        elif fault == "chunked":
            return self.send_chunked(headers, body)
        elif fault == "chunked_length":
            return self.send_chunked({**headers, "Content-Length": str(len(body))}, body)
        elif fault == "no_chunks":  # twelve bytes that look like the first chunk
            return self.send_chunked(headers, b"c\r\n" + body[1:], is_raw=True)
        elif fault == "broken":
            self.send_response(206)
            for name, value in {**headers, "Content-Length": len(body)}.items():
                self.send_header(name, str(value))
            self.end_headers()
            self.write_body(body[:len(body) // 2])
            return self.reset()
        elif fault == "slow":
            self.send_response(206)
            for name, value in {**headers, "Content-Length": len(body)}.items():
                self.send_header(name, str(value))
            self.end_headers()
            return self.write_body(body, 0.02, 1)
        elif fault == "wrong_bytes":
            body = bytes([body[0] ^ 1]) + body[1:]
        elif fault not in ("", "etag", "no_etag", "gzip", "less"):
            raise AssertionError(fault)
        return self.answer(206, headers, body)

    def send_whole(self, headers, data, fault):
        body = bytes(data)
        if fault in ("short", "broken"):
            self.send_response(200)
            for name, value in {**headers, "Content-Length": len(body)}.items():
                self.send_header(name, str(value))
            self.end_headers()
            self.write_body(body[:len(body) // 2])
            return self.reset() if fault == "broken" else setattr(self, "close_connection", True)
        if fault == "chunked":
            return self.send_chunked(headers, body, 200)
        if fault == "wrong_bytes":
            body = bytes([body[0] ^ 1]) + body[1:]
        return self.answer(200, headers, body)

    def send_chunked(self, headers, body, status=206, is_raw=False):
        self.send_response(status)
        for name, value in {**headers, "Transfer-Encoding": "chunked"}.items():
            self.send_header(name, value)
        self.end_headers()
        if is_raw:
            self.write_body(body)
            return setattr(self, "close_connection", True)
        for at in range(0, len(body), 5000):
            part = body[at:at + 5000]
            self.wfile.write(f"{len(part):x}\r\n".encode())
            self.write_body(part)
            self.wfile.write(b"\r\n")
        self.wfile.write(b"0\r\n\r\n")


class Server(http.server.ThreadingHTTPServer):
    daemon_threads = True
    block_on_close = False
    request_queue_size = 128

    def handle_error(self, request, client_address):
        if not isinstance(sys.exc_info()[1], (OSError, ValueError)):
            super().handle_error(request, client_address)


class RangeServer:
    """`delay`: seconds before each answer; `handshakes`: the number of such delays before the first request of a
    connection. `rate`: bytes per second of all connections together. `fault_of(number, path, headers)`: the fault of
    the request with this number (Handler.do_request), or None. `keys`: see signature_fault(). `password`: (user,
    password). `tls`: the result of certificate(). `extra(method, path)`: additional headers of whole answers and of
    parts; `options`: the status for OPTIONS."""

    def __init__(self, folder, *, port=0, delay=0, handshakes=0, rate=0, fault_of=None, keys=None, password=None,
                 tls=None, knows_ranges=True, knows_tails=True, validators=None, silence=30, extra=None, options=501):
        self.folder, self.delay, self.handshakes = pathlib.Path(folder), delay, handshakes
        self.link, self.silence = Link(rate), silence
        self.extra, self.options = extra or (lambda method, path: {}), options
        self.fault_of = fault_of or (lambda number, path, headers: None)
        self.keys, self.password, self.knows_ranges, self.knows_tails = keys, password, knows_ranges, knows_tails
        self.validators = validators or (lambda path, data: {
            "ETag": f'"{path.stat().st_mtime_ns:x}-{len(data):x}"',
            "Last-Modified": time.strftime("%a, %d %b %Y %H:%M:%S GMT", time.gmtime(path.stat().st_mtime))})
        self.requests = self.bytes = 0
        self.notes, self.lock, self.closing, self.kept = [], threading.Lock(), threading.Event(), {}
        self.server = Server(("127.0.0.1", port), Handler)
        self.server.owner = self
        self.scheme = "http"
        if tls:
            context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
            context.load_cert_chain(*tls)
            self.server.socket = context.wrap_socket(self.server.socket, server_side=True, do_handshake_on_connect=False)
            self.scheme = "https"
        self.thread = threading.Thread(target=self.server.serve_forever, args=(0.05,), daemon=True)

    def __enter__(self):
        self.thread.start()
        return self

    def __exit__(self, *_):
        self.closing.set()
        self.server.shutdown()
        self.server.server_close()

    def url(self, name, userinfo=""):
        return f"{self.scheme}://{userinfo}{self.host}/{name}"

    @property
    def host(self):
        return "127.0.0.1:%d" % self.server.server_address[1]

    def count(self, requests, size):
        with self.lock:
            self.requests += requests
            self.bytes += size
            return self.requests

    def note(self, what):
        with self.lock:
            self.notes.append(what)

    def data_of(self, path):
        """The file's bytes, read once for each state of the file."""
        state = path.stat().st_mtime_ns, path.stat().st_size
        with self.lock:
            if self.kept.get(path, (None,))[0] != state:
                self.kept[path] = state, path.read_bytes()
            return memoryview(self.kept[path][1])


def main():
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("folder", type=pathlib.Path)
    parser.add_argument("--port", type=int, default=0)
    parser.add_argument("--delay", type=float, default=0, metavar="MS", help="a round trip")
    parser.add_argument("--rate", type=float, default=0, metavar="MBIT/S")
    parser.add_argument("--tls", action="store_true", help="a certificate of its own, in FOLDER/certificate.pem")
    options = parser.parse_args()
    tls = certificate(options.folder) if options.tls else None
    with RangeServer(options.folder, port=options.port, delay=options.delay / 1000, handshakes=2 if tls else 1,
                     rate=options.rate * 125000, tls=tls) as server:
        print(server.url(""), flush=True)
        try:
            threading.Event().wait()
        except KeyboardInterrupt:
            print(f"{server.requests} requests, {server.bytes} bytes")


if __name__ == "__main__":
    main()
