"""Answers to requests for ranges, right ones and what a server may make of them.

An Answer is what goes over the connection; a fault is a function that changes a right one. Faults have classes, by what
tools/MANUAL.md (12, "What the server has to do") says of them:

    harmless    a right answer in an odd form: the run succeeds
    busy        tried again, up to 5 times: the run succeeds, if it is right then
    odd         tried again once
    wild        anything: the run ends with the right bytes or with an error
"""
import dataclasses
import gzip
import random
import time


@dataclasses.dataclass
class Request:
    method: str
    path: str
    query: str
    headers: dict
    key: str  # what is asked for, the same for those that ask again for its rest
    times: int  # it was asked for before


@dataclasses.dataclass
class Answer:
    status: str = "206 Partial Content"
    headers: list = dataclasses.field(default_factory=list)
    body: bytes = b""
    version: str = "HTTP/1.1"
    before: bytes = b""  # an interim answer
    after: bytes = b""
    raw: "bytes | None" = None  # in place of all
    chunks: "int | None" = None  # bytes in each, where it goes in chunks
    trailer: bytes = b""
    cut: "float | None" = None  # the part of the message behind which the connection breaks
    reset: bool = False
    ends: bool = False  # closes the connection behind it
    delay: float = 0
    pause: "tuple | None" = None  # (pieces, seconds): between pieces

    def get(self, name):
        return next((value for known, value in self.headers if known.lower() == name.lower()), None)

    def set(self, name, value):
        self.remove(name)
        self.headers.append((name, value))
        return self

    def remove(self, name):
        self.headers = [(known, value) for known, value in self.headers if known.lower() != name.lower()]
        return self

    def plain(self, status, body=b"", **headers):
        """Another answer, of no part."""
        self.status, self.body = status, body
        self.headers = [(name.replace("_", "-"), value) for name, value in headers.items()]
        self.headers.append(("Content-Length", str(len(body))))
        return self

    def message(self):
        if self.raw is not None:
            return self.raw
        head = f"{self.version} {self.status}\r\n" + "".join(f"{name}: {value}\r\n" for name, value in self.headers)
        body = self.body
        if self.chunks is not None:
            pieces = [body[at:at + self.chunks] for at in range(0, len(body), self.chunks)]
            body = b"".join(b"%x\r\n%s\r\n" % (len(piece), piece) for piece in pieces) + b"0\r\n" + self.trailer + b"\r\n"
        return self.before + head.encode("latin-1") + b"\r\n" + body + self.after


def _range(answer):
    """(first, last, size) of its Content-Range; of everything where it has none."""
    text = answer.get("Content-Range")
    if text is None:
        return 0, len(answer.body) - 1, len(answer.body)
    part, size = text.removeprefix("bytes ").split("/")
    first, last = map(int, part.split("-"))
    return first, last, int(size)


def _chunked(answer, size):
    answer.remove("Content-Length").set("Transfer-Encoding", "chunked").chunks = size


def _is_part(answer):
    return answer.get("Content-Range") is not None


# Harmless ones: f(answer, random, server, request).

def delay(answer, lot, *_):
    answer.delay = lot.uniform(0, 0.15)


def chunked(answer, lot, *_):
    _chunked(answer, lot.choice((1000, 7919, 1 << 20)))
    answer.trailer = lot.choice((b"", b"X-Sum: 1\r\n", b"Content-Range: bytes 0-1/2\r\nETag: \"trailer\"\r\n"))


def closing(answer, *_):
    answer.set("Connection", "close").ends = True


def http_1_0(answer, lot, *_):
    answer.version, answer.ends = "HTTP/1.0", True


def interim(answer, lot, *_):
    answer.before = lot.choice((b"HTTP/1.1 100 Continue\r\n\r\n",
                                b"HTTP/1.1 103 Early Hints\r\nETag: \"early\"\r\nContent-Range: bytes 5-6/7\r\n\r\n")) * lot.choice((1, 3))


def header_forms(answer, lot, *_):
    answer.headers = [(lot.choice((name.lower(), name.upper(), name)), lot.choice((value, f"  {value}\t"))) for name, value in answer.headers]
    lot.shuffle(answer.headers)


def more_headers(answer, lot, *_):
    answer.set("Set-Cookie", "session=c00kie; Path=/").set("Vary", "*").set("Link", "</x>; rel=preload")
    answer.headers += [(f"X-{i}", "y" * lot.choice((1, 900))) for i in range(lot.choice((1, 60)))]


def identity(answer, *_):
    answer.set("Content-Encoding", "identity")


def less(answer, lot, *_):
    """It may give less than it was asked for, from its beginning on."""
    first, last, size = _range(answer)
    if _is_part(answer) and first < last < size - 1:
        last = first + (last - first) // 2
        answer.body = answer.body[:last - first + 1]
        answer.set("Content-Range", f"bytes {first}-{last}/{size}").set("Content-Length", str(len(answer.body)))


def in_pieces(answer, lot, *_):
    answer.pause = lot.randint(2, 6), 0.02


def elsewhere(answer, lot, server, request):
    """To the same object at another port or path: what goes there has no secrets."""
    if "hop" not in request.query:
        place = lot.choice((server.other.place(request.path), request.path))
        answer.plain(lot.choice(("301 Moved", "302 Found", "307 Temporary", "308 Permanent", "303 See Other")), b"go on",
                     Location=f"{place}?hop=1&signature={server.secret_of_others}")


HARMLESS = [delay, chunked, closing, http_1_0, interim, header_forms, more_headers, identity, less, in_pieces, elsewhere]


# Busy ones.

def cut(answer, lot, *_):
    answer.cut, answer.reset = lot.choice((0, 0.02, lot.random())), lot.random() < 0.5


def busy_status(answer, lot, *_):
    waits = ("", "0", "1", "-5", "soon", "1.5", " 1", "1, 2", "Thu, 01 Jan 1970 00:00:00 GMT", "0x1", "\t1\t", "+1",
             time.strftime("%a, %d %b %Y %H:%M:%S GMT", time.gmtime(time.time() + 1)), None, None, None, None)
    wait = lot.choice(waits)
    answer.plain(lot.choice(("500 Oh", "502 Bad", "503 Busy", "504 Late", "429 Slow down", "408 Timeout", "503")),
                 lot.choice((b"", b"<Error><Code>SlowDown</Code></Error>", b"x" * 20000)),
                 **({} if wait is None else {"Retry_After": wait}))


def chunked_cut(answer, lot, *_):
    _chunked(answer, 5000)
    answer.cut = lot.uniform(0.05, 0.99)


BUSY = [cut, cut, busy_status, busy_status, chunked_cut]


# Odd ones.

def whole(answer, lot, server, request):
    data = server.data_of(request.path)
    if _is_part(answer):
        answer.status, answer.body = "200 OK", data
        answer.remove("Content-Range").set("Content-Length", str(len(data)))


def range_missing(answer, *_):
    if _is_part(answer):
        answer.remove("Content-Range")


def range_damaged(answer, lot, *_):
    if _is_part(answer):
        first, last, size = _range(answer)
        answer.set("Content-Range", lot.choice(("bytes", "", f"bytes {last + 1}-{first}/{size}", f"bytes {first}-/{size}", f"bytes */{size}",
                                                f"items {first}-{last}/{size}", f"bytes {first}-{last}", f"bytes -{first}-{last}/{size}",
                                                f"bytes {first}-{2**64 - 1}/{2**64 - 1}", f"bytes 0x0-{last}/{size}")))


def range_shifted(answer, lot, *_):
    if _is_part(answer):
        first, last, size = _range(answer)
        by = 1 if first == 0 else lot.choice((-1, 1))
        if first + by <= last < size - 1 or by < 0:
            answer.set("Content-Range", f"bytes {first + by}-{last + (by if lot.random() < 0.5 and last + by < size else 0)}/{size}")
        else:
            answer.remove("Content-Range")


def encoded(answer, lot, *_):
    if lot.random() < 0.5:
        answer.body = gzip.compress(answer.body, 1)
        answer.set("Content-Length", str(len(answer.body)))
    answer.set("Content-Encoding", lot.choice(("gzip", "br", "deflate, gzip", "aws-chunked")))


def long(answer, lot, *_):
    _chunked(answer, 4096)
    answer.body += bytes(lot.choice((1, 5000)))
    if not _is_part(answer):
        answer.chunks = None
        answer.remove("Transfer-Encoding").remove("Content-Length").set("Content-Length", str(len(answer.body) - 1))


def no_version(answer, *_):
    answer.remove("ETag").remove("Last-Modified")


ODD = [whole, range_missing, range_damaged, range_shifted, encoded, no_version]


# Anything else.

STATUSES = ("400 Bad", "401 Who", "403 No", "404 Nothing", "405 Not so", "407 Proxy", "410 Gone", "412 Not that", "416 No range",
            "418 Pot", "425 Early", "451 Law", "500 Oh", "501 Not yet", "505 Version", "511 Log in", "999 What", "000", "199 x",
            "204 No Content", "205 Reset", "226 IM", "304 Not Modified", "300 Many", "305 Proxy", "101 Switching")


def status_of(seed, request):
    """What any_status() answers to it."""
    return lot_of(seed, request.key, request.times, "how").choice(STATUSES)


def any_status(answer, lot, *_):
    answer.plain(lot.choice(STATUSES),
                 lot.choice((b"", b"why", b"<?xml version='1.0'?><Error><Code>Fault</Code></Error>", b"z" * 300_000)))
    if answer.status.startswith("416") and lot.random() < 0.5:
        answer.set("Content-Range", lot.choice(("bytes */0", "bytes */5", "bytes */18446744073709551615", "bytes */*")))
    if answer.status.startswith("401"):
        answer.set("WWW-Authenticate", lot.choice(("Basic realm=x", "Digest realm=x, nonce=y", "Negotiate", "Bearer")))


def waits_long(answer, lot, *_):
    far = time.strftime("%a, %d %b %Y %H:%M:%S GMT", time.gmtime(time.time() + 86400))
    answer.plain(lot.choice(("503 Busy", "429 Slow down")), b"", Retry_After=lot.choice(("3600", "9" * 30, "2147483648", "9223372036854775807", far)))


def lies_of_length(answer, lot, *_):
    size = len(answer.body)
    answer.set("Content-Length", lot.choice((str(size + 1), str(max(size - 1, 0)), "-1", f"+{size}", "0", str(2**63), str(2**64 + size), "x", "",
                                             f"{size}, {size}", f"0{size}", f"{size}.0")))
    if lot.random() < 0.3:
        answer.headers.append(("Content-Length", str(size)))
    answer.ends = lot.random() < 0.7


def lies_of_range(answer, lot, *_):
    first, last, size = _range(answer)
    answer.set("Content-Range", lot.choice((f"bytes {first}-{last}/{size + 1}", f"bytes {first}-{last}/{2**63}", f"bytes {first}-{last}/*",
                                            f"bytes {first}-{last}/{last + 1}", f"bytes {first}-{last}/{size}, bytes 0-1/2", f"bytes={first}-{last}/{size}",
                                            f"bytes {first}-{last + 1}/{size}", f"bytes 0-{size - 1}/{size}", f"bytes {first}-{first}/{size}")))
    if lot.random() < 0.3:
        answer.headers.append(("Content-Range", f"bytes {first}-{last}/{size}"))


def multipart(answer, lot, *_):
    body = b"--b\r\nContent-Range: " + (answer.get("Content-Range") or "").encode() + b"\r\n\r\n" + answer.body + b"\r\n--b--\r\n"
    answer.body = body
    answer.set("Content-Type", "multipart/byteranges; boundary=b").remove("Content-Range").set("Content-Length", str(len(body)))


def flood(answer, lot, *_):
    count, size = lot.choice(((20000, 40), (1, 3_000_000), (300, 9000), (5000, 1)))
    answer.headers[0:0] = [(f"X-{i}", "f" * size) for i in range(count)]


def odd_headers(answer, lot, *_):
    odd = lot.choice(("X\x00Y: 1", "ETag: \"" + "e" * 90_000 + "\"", "no colon", ": empty", "ETag: \"a\rb\"", "ETag: \x1b[31m\"red\"", " folded",
                      "Transfer-Encoding: gzip", "Transfer-Encoding: chunked", "Trailer: ETag", "Upgrade: h2c", "Connection: upgrade", "ETag:",
                      "Location: /elsewhere", "Content-Range:", "Refresh: 0; url=/x", "Strict-Transport-Security: max-age=9", "Alt-Svc: h3=\":1\""))
    message = answer.message()
    answer.raw = message.replace(b"\r\n", b"\r\n" + odd.encode("latin-1") + b"\r\n", 1)
    answer.ends = True


def garbage(answer, lot, *_):
    answer.raw = lot.choice((b"", b"\0" * 500, b"HTTP/", b"HTTP/1.1\r\n\r\n", b"HTTP/9.9 206 x\r\n\r\n", b"HTTP/1.1 206\r\n", b"\r\n" * 500,
                             b"SSH-2.0-OpenSSH\r\n", lot.randbytes(2000), b"HTTP/1.1 -20 x\r\n\r\n", b"HTTP/2 206\r\n\r\n", b"<html>" * 99,
                             b"ICY 200 OK\r\n\r\n" + answer.body, b"PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n"))
    answer.ends = True


def bad_chunks(answer, lot, *_):
    _chunked(answer, None)
    answer.chunks = None
    n = len(answer.body)
    answer.body = lot.choice((b"ffffffffffffffff\r\n" + answer.body, b"-1\r\n" + answer.body, b"zz\r\n" + answer.body, b"%x\r\n" % (n + 9) + answer.body,
                              b"%x;x=%s\r\n" % (n, b"e" * 70000) + answer.body + b"\r\n0\r\n\r\n", b"0\r\n\r\n", b"\r\n" * 9,
                              b"%x\r\n" % max(n - 1, 1) + answer.body + b"\r\n0\r\n\r\n"))
    answer.ends = True


def two_answers(answer, lot, *_):
    """The second one waits for the next request of the connection."""
    message = answer.message()
    answer.after = message.replace(answer.body, bytes(len(answer.body))) if answer.body else message


def bad_redirect(answer, lot, server, request):
    other = server.other.place("")
    to = lot.choice((f"file://{server.decoy(request.path)}", f"FILE://{server.decoy(request.path)}", "ftp://127.0.0.1/x", "gopher://127.0.0.1:1/x",
                     "dict://127.0.0.1:1/x", "data:text/plain,hello", "javascript:1", "scp://h/x", "smb://h/x", "//", "http://", "http:///x",
                     "http://[::1", "http://127.0.0.1:99999/x", "http://127.0.0.1:1/x", "http://no-such-host.invalid/x", "?x", "#x", "", " ", "..", "../../x",
                     request.path, request.path + "?n=%d" % request.times, "x" * 90_000, "/%00/%0d%0aX: 1", "\x7f\x01", f"{other}/missing",
                     f"http://user:{server.secret_of_others}@{other.removeprefix('http://').removeprefix('https://')}{request.path}",
                     f"{other}{request.path}\r\nX-More: 1", f"http://127.0.0.1@evil.invalid{request.path}", "unix:///tmp/x", "https:x", "s3://bucket/x"))
    answer.plain(lot.choice(("301 Moved", "302 Found", "303 See", "307 Temporary", "308 Permanent")), b"away", Location=to)


def stands(answer, lot, *_):
    """Nothing comes for a while."""
    answer.delay, answer.cut, answer.reset = lot.uniform(0.2, 1), lot.choice((0, 0.3)), True


def drip(answer, *_):
    answer.pause = 10_000, 0.02


WILD = [any_status, any_status, waits_long, lies_of_length, lies_of_range, multipart, flood, odd_headers, garbage, bad_chunks, two_answers, bad_redirect,
        bad_redirect, stands, long]


def damaged(answer, lot, *_):
    """For what has checksums."""
    if answer.body:
        body = bytearray(answer.body)
        for _ in range(lot.choice((1, 3))):
            body[lot.randrange(len(body))] ^= 1 << lot.randrange(8)
        answer.body = bytes(body)


def lot_of(*words):
    return random.Random("/".join(map(str, words)))
