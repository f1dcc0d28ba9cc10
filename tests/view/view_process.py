"""A server of isonest view for tests: starts it, sends requests, and decodes its meshes with meshoptimizer's library, by
tools/view/PROTOCOL.md. Ends the test with 77 if the build has no isonest view.
"""
import contextlib
import ctypes
import ctypes.util
import http.client
import json
import os
import pathlib
import resource
import shutil
import signal
import struct
import subprocess
import sys
import tempfile
import unittest
import urllib.parse

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1] / "support"))
import served  # noqa: E402

import numpy

ISONEST = pathlib.Path(sys.argv[1]).resolve()
HERE = pathlib.Path(tempfile.mkdtemp(prefix="isonest-view-test-"))


def isonest(*arguments):
    return served.run([ISONEST, *map(str, arguments)], cwd=HERE, capture_output=True, text=True,
                      timeout=300, check=True)


if served.run([ISONEST, "view", "--help"], capture_output=True).returncode != 0:
    print("skipped: this build has no isonest view")
    sys.exit(77)
try:
    CODEC = ctypes.CDLL(ctypes.util.find_library("meshoptimizer") or "libmeshoptimizer.so")
except OSError as error:
    print("skipped:", error)
    sys.exit(77)


class View:
    """A server, and requests to it."""

    def __init__(self, store, *options, limit=None, folder=None):
        env = dict(os.environ, TMPDIR=str(folder or HERE))
        self.process = subprocess.Popen(
            [ISONEST, "view", store, "--json", *([] if "--port" in options else ["--port", "0"]), *map(str, options)], cwd=HERE, env=env,
            stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
            preexec_fn=limit and (lambda: resource.setrlimit(resource.RLIMIT_DATA, (limit, limit))))
        self.url = json.loads(self.process.stdout.readline())["url"]
        self.port = urllib.parse.urlsplit(self.url).port

    def ask(self, path, method="GET", headers=None, **parameters):
        """Status, headers, body."""
        connection = http.client.HTTPConnection("127.0.0.1", self.port, timeout=120)
        try:
            query = urllib.parse.urlencode(parameters)
            connection.putrequest(method, path + ("?" + query if query else ""), skip_host="Host" in (headers or {}))
            for name, value in (headers or {}).items():
                connection.putheader(name, value)
            connection.endheaders()
            answer = connection.getresponse()
            return answer.status, answer.headers, answer.read()
        finally:
            connection.close()

    def json(self, path, **parameters):
        status, _, body = self.ask(path, **parameters)
        return status, json.loads(body)

    def mesh(self, path, **parameters):
        status, _, body = self.ask(path, **parameters)
        assert status == 200, (status, body[:300])
        return decoded(body)

    def end(self, number=signal.SIGINT):
        if self.process.poll() is None:
            self.process.send_signal(number)
        out, err = self.process.communicate(timeout=60)
        return self.process.returncode, out, err


@contextlib.contextmanager
def view(*arguments, **options):
    server = View(*arguments, **options)
    try:
        yield server
    finally:
        code, _, err = server.end()
    assert code == 0, (code, err)


def decoded(message):
    """Header, positions, normals or values, triangles."""
    magic, version, length, zero = struct.unpack_from("<4sIII", message)
    assert (magic, version, zero) == (b"ISOV", 1, 0) and length % 16 == 0
    header = json.loads(message[16:16 + length])
    at, arrays = 16 + length, {}
    for section in header["sections"]:
        data = message[at:at + section["bytes"]]
        at += (section["bytes"] + 15) // 16 * 16
        count, stride = section["count"], section["stride"]
        out = ctypes.create_string_buffer(max(count * stride, 1))
        if section["encoding"] == "raw":
            out[:len(data)] = data
        elif section["encoding"] == "meshopt_vertex":
            assert CODEC.meshopt_decodeVertexBuffer(out, ctypes.c_size_t(count), ctypes.c_size_t(stride), data,
                                                    ctypes.c_size_t(len(data))) == 0
        else:
            assert section["encoding"] == "meshopt_index"
            assert CODEC.meshopt_decodeIndexBuffer(out, ctypes.c_size_t(count), ctypes.c_size_t(stride), data,
                                                   ctypes.c_size_t(len(data))) == 0
        dtype = {"positions": "<u2", "normals": "i1", "indices": "<u4"}[section["name"]]
        arrays[section["name"]] = numpy.frombuffer(out.raw[:count * stride], dtype)
    assert at == len(message)
    steps = arrays["positions"].reshape(-1, 4)
    header["points"] = numpy.array(header["origin"]) + numpy.array(header["step"]) * steps[:, :3]
    if "value_step" in header:
        header["values"] = header["value_origin"] + header["value_step"] * steps[:, 3]
    if "normals" in arrays:
        header["normals"] = arrays["normals"].reshape(-1, 4)[:, :3] / 127
    header["faces"] = arrays["indices"].reshape(-1, 3)
    return header


def corners(points, faces):
    """The corners of each triangle, starting at the smallest: (triangles, 3, 3)."""
    t = points[faces]
    first = numpy.array([min(range(3), key=lambda k: tuple(c[k])) for c in t])
    rows = numpy.arange(len(t))
    return numpy.stack([t[rows, (first + k) % 3] for k in range(3)], axis=1)


def run_tests():
    """Runs the tests of the program's main module, and removes the folder."""
    try:
        unittest.main("__main__", argv=[sys.argv[0], *sys.argv[3:]], exit=False).result.wasSuccessful() or sys.exit(1)
    finally:
        shutil.rmtree(HERE, ignore_errors=True)
