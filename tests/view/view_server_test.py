"""The server of isonest view from outside, over its socket: its answers are compared with the results of the program's
other commands, and what strangers can do to it is bounded.

Meshes are decoded following tools/view/PROTOCOL.md, by meshoptimizer's own library.
Usage: view_server_test.py ISONEST PLUGIN_FOLDER
"""
import concurrent.futures
import contextlib
import ctypes
import ctypes.util
import http.client
import json
import os
import pathlib
import random
import resource
import shutil
import signal
import socket
import struct
import subprocess
import sys
import tempfile
import time
import unittest
import unittest.mock
import urllib.parse

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1] / "support"))
import sanitized  # noqa: E402
import served  # noqa: E402
from mesh_data import read_ply  # noqa: E402

import h5py
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


class Answers(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        isonest("make-volume", "bucky", "--size", 33, "-o", "v.h5", "-q")
        isonest("preprocess", "v.h5", "-o", "s.isonest", "-q")
        cls.view = View("s.isonest")
        cls.box = 32.0

    @classmethod
    def tearDownClass(cls):
        code, _, err = cls.view.end()
        assert code == 0, err

    def same_as_extract(self, mesh, **parameters):
        status, said = self.view.json("/api/command", **parameters)
        self.assertEqual(status, 200, said)
        done = subprocess.run(f"{said['command'].replace('isonest ', str(ISONEST) + ' ', 1)} --json", shell=True,
                              cwd=HERE, capture_output=True, text=True, check=True)
        vertices, faces = read_ply(HERE / said["command"].split()[-1])
        points = numpy.stack([vertices[k] for k in "xyz"], axis=1).astype(float)
        self.assertEqual(len(points), mesh["vertices"])
        self.assertEqual(len(faces), mesh["triangles"])
        self.assertGreater(len(faces), 50)
        distances = numpy.linalg.norm(points - mesh["points"], axis=1)
        self.assertLessEqual(distances.max(), mesh["position_rounding"] * 1.0001 + 1e-9)
        self.assertTrue((numpy.sort(faces, axis=1) == numpy.sort(mesh["faces"].astype(int), axis=1)).all())
        # The first corner may differ, but the orientation is preserved.
        turns = (faces[:, :1] == mesh["faces"]).argmax(axis=1)
        rows = numpy.arange(len(faces))
        for k in range(3):
            self.assertTrue((mesh["faces"][rows, (turns + k) % 3] == faces[:, k]).all())
        return json.loads(done.stdout), vertices

    def test_a_surface_within_an_error_is_the_one_that_extract_makes(self):
        for parameters in ({"iso": 0.5, "error": 0}, {"iso": 0.5, "error": 0.05},
                           {"iso": 0.3, "error": 0.02, "box": "2,3,4,20,21,22.5"},
                           {"iso": 0.5, "camera": "16,16,-60,40,400,9"},
                           {"iso": 0.9, "error": 0.01, "components": "largest"}):
            with self.subTest(parameters):
                mesh = self.view.mesh("/api/surface", **parameters)
                report, _ = self.same_as_extract(mesh, **parameters)
                self.assertEqual(mesh["error_bound"], report["error_bound"])
                self.assertIsNone(mesh["distance_bound"])
                self.assertEqual(mesh["full_resolution"], report["error_bound"] == 0)

    def test_normals_are_those_of_extract(self):
        mesh = self.view.mesh("/api/surface", iso=0.5, error=0.05)
        isonest("extract", "s.isonest", "--iso", 0.5, "--error", 0.05, "--effort", "none", "--normals", "-o", "n.ply")
        vertices, _ = read_ply(HERE / "n.ply")
        normals = numpy.stack([vertices["n" + k] for k in "xyz"], axis=1)
        self.assertLessEqual(numpy.abs(normals - mesh["normals"]).max(), 0.5 / 127 + 1e-6)

    def test_a_slice_is_the_one_that_slice_makes(self):
        for parameters in ({"plane": "0,0,1,11.25", "error": 0.01}, {"plane": "1,2,-1,20", "error": 0},
                           {"plane": "1,0,0,16", "error": 0.05, "box": "0,5,5,32,30,30"}):
            with self.subTest(parameters):
                mesh = self.view.mesh("/api/slice", **parameters)
                report, vertices = self.same_as_extract(mesh, **parameters)
                self.assertEqual(mesh["error_bound"], report["error_bound"])
                self.assertLessEqual(numpy.abs(vertices["value"] - mesh["values"]).max(),
                                     mesh["value_rounding"] * 1.001 + 1e-7)
                self.assertEqual(mesh["faces"].max() + 1, mesh["vertices"])

    def test_the_fast_effort_leaves_more_triangles_within_the_same_distance(self):
        best, fast = (self.view.mesh("/api/surface", iso=0.5, distance=0.5, effort=effort) for effort in ("best", "fast"))
        self.assertLess(best["triangles"], fast["triangles"])
        self.assertLessEqual(fast["distance_bound"], 0.5)
        _, answer = self.view.json("/api/command", iso=0.5, distance=0.5, effort="fast")
        self.assertIn(" --distance 0.5 --effort fast ", answer["command"])

    def test_a_distance_that_needs_too_many_triangles_gives_way_to_an_error(self):
        mesh = self.view.mesh("/api/surface", iso=0.5, distance=0.01, limit=2000)
        self.assertEqual(mesh["stop"], "error")
        self.assertLessEqual(mesh["triangles"], 2000)
        self.assertGreater(mesh["error_bound"], 0)

    def test_a_distance_is_kept_with_positions_rounded(self):
        mesh = self.view.mesh("/api/surface", iso=0.5, distance=0.5)
        full = self.view.mesh("/api/surface", iso=0.5, error=0)
        self.assertLessEqual(mesh["distance_bound"], 0.5)
        self.assertEqual(mesh["tolerance"], 0.5)
        self.assertIsNone(mesh["error_bound"])
        self.assertLess(mesh["triangles"], full["triangles"] / 4)
        # Vertices of a mesh with effort fast are vertices of the full surface.
        mesh = self.view.mesh("/api/surface", iso=0.5, distance=0.5, effort="fast")
        for point in mesh["points"][::7]:
            self.assertLessEqual(numpy.linalg.norm(full["points"] - point, axis=1).min(),
                                 mesh["position_rounding"] + full["position_rounding"] + 1e-6)

    def test_a_number_of_triangles_is_never_passed(self):
        counts = []
        for most in (500, 2000, 20000, 2000):
            for iso in (0.1, 0.5, 0.52, 0.9, 0.05):
                mesh = self.view.mesh("/api/surface", iso=iso, triangles=most)
                self.assertLessEqual(mesh["triangles"], most)
                self.assertLessEqual(mesh["error_bound"], mesh["tolerance"])
                counts.append(mesh["triangles"] / most)
        self.assertGreater(sum(count > 0.2 for count in counts), len(counts) / 2)

    def test_beyond_a_limit_the_mesh_is_one_of_fewer_triangles(self):
        full = self.view.mesh("/api/surface", iso=0.5, error=0)["triangles"]
        mesh = self.view.mesh("/api/surface", iso=0.5, error=0, limit=full - 1)
        self.assertLess(mesh["triangles"], full)
        self.assertGreater(mesh["triangles"], full / 10)
        self.assertFalse(mesh["full_resolution"])

    def test_the_value_at_a_place_is_linear_in_the_finest_tetrahedra(self):
        # An independent computation: a slice at full resolution has the same function, triangle by triangle.
        mesh = self.view.mesh("/api/slice", plane="0,0,1,11.3", error=0)
        rng = random.Random(5)
        for face in rng.sample(list(mesh["faces"]), 60):
            weights = numpy.array([rng.random() + 0.01 for _ in range(3)])
            weights /= weights.sum()
            place = weights @ mesh["points"][face]
            status, said = self.view.json("/api/value", at=",".join(map(repr, map(float, place))))
            self.assertEqual(status, 200)
            self.assertTrue(said["inside"])
            self.assertAlmostEqual(said["value"], float(weights @ mesh["values"][face]), delta=2e-3)
        for place in ("-0.1,3,3", "3,32.5,3", "3,3,1e300"):
            _, said = self.view.json("/api/value", at=place)
            self.assertFalse(said["inside"])
            self.assertIsNone(said["value"])

    def test_exported_files_are_those_of_extract(self):
        for ending in ("ply", "stl", "obj", "glb", "3mf", "vtp"):
            status, headers, body = self.view.ask("/api/export", iso=0.5, error=0.05, format=ending)
            self.assertEqual(status, 200)
            self.assertEqual(headers["Content-Disposition"], f'attachment; filename="surface.{ending}"')
            isonest("extract", "s.isonest", "--iso", 0.5, "--error", 0.05, "--effort", "none", "--normals", "-o", f"e.{ending}")
            self.assertEqual(body, (HERE / f"e.{ending}").read_bytes())
        self.assertEqual([p.name for p in HERE.glob("isonest-view-*")], [])

    def test_what_the_store_holds_is_what_info_says(self):
        _, said = self.view.json("/api/store")
        info = json.loads(isonest("info", "s.isonest", "--histogram", "--json").stdout)
        for name in ("nodes", "type", "spacing", "origin", "min_value", "max_value", "has_missing", "levels",
                     "file_bytes", "unit", "frame"):
            self.assertEqual(said[name], info[name])
        self.assertEqual(said["box"], [0, 0, 0, 32, 32, 32])
        _, histogram = self.view.json("/api/histogram")
        self.assertEqual(histogram, info["histogram"])

    def test_requests_that_make_no_sense_are_refused_by_name(self):
        cases = [("/api/surface", {}, "iso"), ("/api/surface", {"iso": "nan"}, "iso"),
                 ("/api/surface", {"iso": "1e999"}, "iso"), ("/api/surface", {"iso": 1, "error": -1}, "error"),
                 ("/api/surface", {"iso": 1, "triangles": 1}, "triangles"),
                 ("/api/surface", {"iso": 1, "triangles": 10 ** 30}, "triangles"),
                 ("/api/surface", {"iso": 1, "triangles": 500, "error": 1}, "one of"),
                 ("/api/surface", {"iso": 1, "wrong": 1}, "wrong"),
                 ("/api/surface", {"iso": 1, "distance": 1, "effort": "quick"}, "effort"),
                 ("/api/surface", {"iso": 1, "error": 1, "effort": "fast"}, "effort"),
                 ("/api/surface", {"iso": 1, "box": "1,2,3"}, "box"),
                 ("/api/surface", {"iso": 1, "box": "5,5,5,1,1,1"}, "box"),
                 ("/api/surface", {"iso": 1, "camera": "0,0,0,180,100,1"}, "camera"),
                 ("/api/surface", {"iso": 1, "camera": "0,0,0,40,1e9,1"}, "camera"),
                 ("/api/surface", {"iso": 1, "components": "some"}, "components"),
                 ("/api/surface", {"iso": 1, "stream": "a b"}, "stream"),
                 ("/api/surface", {"iso": 1, "stream": "x" * 65}, "stream"),
                 ("/api/slice", {}, "plane"),
                 ("/api/slice", {"plane": "0,0,0,1"}, ""), ("/api/slice", {"plane": "0,0,1,1", "distance": 1}, "distance"),
                 ("/api/value", {}, "at"), ("/api/value", {"at": "1,2"}, "at"),
                 ("/api/export", {"iso": 0.5, "error": 0, "format": "exe"}, "exe"),
                 ("/api/export", {"iso": 0.5, "error": 0, "format": "../x.ply"}, "format"),
                 ("/api/export", {"iso": 0.5, "error": 0, "format": "x\r\nSet-Cookie: a=b\r\n.ply"}, "format"),
                 ("/api/export", {"iso": 0.5, "error": 0, "format": 'x".ply'}, "format"),
                 ("/api/export", {"iso": 0.5, "triangles": 1000}, "number"),
                 ("/api/command", {"iso": 0.5, "triangles": 1000}, "number")]
        for path, parameters, name in cases:
            with self.subTest(path=path, parameters=parameters):
                status, said = self.view.json(path, **parameters)
                self.assertEqual(status, 400, said)
                self.assertIn(name, said["error"]["message"])
        self.assertEqual(self.view.json("/api/surface?iso=1&iso=2")[0], 400)
        self.assertEqual(self.view.json("/api/surface?iso=%zz")[0], 400)
        self.assertEqual(self.view.json("/api/surface?" + "&".join(f"a{i}=1" for i in range(99)))[0], 400)
        self.assertEqual(self.view.ask("/api/surface", method="POST", iso=0.5)[0], 405)
        self.assertEqual(self.view.ask("/api/cancel", stream="a")[0], 405)
        self.assertEqual(self.view.ask("/api/cancel", method="POST", stream="a")[0], 204)
        self.assertEqual(self.view.ask("/api/nothing")[0], 404)

    def test_no_path_leads_out_of_the_page(self):
        for path in ("/../s.isonest", "/..%2fs.isonest", "/%2e%2e/v.h5", "//etc/passwd", "/index.html/..",
                     "/main.js%00", "/.git", "/s.isonest", "/INDEX.HTML"):
            self.assertEqual(self.view.ask(path)[0], 404, path)

    def test_the_page_comes_with_its_policy(self):
        status, headers, body = self.view.ask("/")
        self.assertEqual(status, 200)
        self.assertIn(b"<!doctype html>", body[:200].lower())
        self.assertIn("script-src 'self' 'wasm-unsafe-eval'", headers["Content-Security-Policy"])
        self.assertEqual(headers["X-Content-Type-Options"], "nosniff")
        self.assertNotIn("Access-Control-Allow-Origin", headers)
        for name in ("main.js", "mesh_worker.js", "worker.js", "style.css", "licences.txt"):
            self.assertEqual(self.view.ask("/" + name)[0], 200, name)

    def test_other_origins_and_names_get_nothing(self):
        own = f"127.0.0.1:{self.view.port}"
        for headers, status in (({"Host": own}, 200), ({"Host": f"localhost:{self.view.port}"}, 200),
                                ({"Host": "127.0.0.1"}, 403), ({"Host": f"evil.example:{self.view.port}"}, 403),
                                ({"Host": own, "Origin": "http://" + own}, 200),
                                ({"Host": own, "Origin": "http://evil.example"}, 403),
                                ({"Host": own, "Origin": "null"}, 403),
                                ({"Host": own, "Origin": f"http://localhost:{self.view.port}"}, 403),
                                ({"Host": own, "Sec-Fetch-Site": "same-origin"}, 200),
                                ({"Host": own, "Sec-Fetch-Site": "none"}, 200),
                                ({"Host": own, "Sec-Fetch-Site": "same-site"}, 403),
                                ({"Host": own, "Sec-Fetch-Site": "cross-site"}, 403)):
            with self.subTest(headers):
                self.assertEqual(self.view.ask("/api/store", headers=headers)[0], status)
        # A link from another site may open the page itself, but not under another name.
        self.assertEqual(self.view.ask("/", headers={"Host": own, "Sec-Fetch-Site": "cross-site"})[0], 200)
        self.assertEqual(self.view.ask("/", headers={"Host": "evil.example"})[0], 403)


    def raw(self, *lines):
        """The complete answer to these lines."""
        with socket.create_connection(("127.0.0.1", self.view.port), timeout=30) as s:
            s.sendall("".join(line + "\r\n" for line in lines).encode())
            s.shutdown(socket.SHUT_WR)
            got = b""
            while more := s.recv(1 << 16):
                got += more
        return got

    def test_a_header_that_is_there_twice_is_none_of_its_values(self):
        own = f"127.0.0.1:{self.view.port}"
        for name, good, bad in (("Origin", "http://" + own, "http://evil.example"), ("Sec-Fetch-Site", "same-origin", "cross-site"),
                                ("Origin", "", "http://evil.example"), ("Sec-Fetch-Site", "none", "cross-site")):
            for first, second in ((good, bad), (bad, good)):
                got = self.raw("GET /api/store HTTP/1.1", f"Host: {own}", f"{name}: {first}", f"{name}: {second}", "")
                self.assertTrue(got.startswith(b"HTTP/1.1 403 "), (name, first, second, got[:100]))

    def test_what_follows_a_head_has_its_body(self):
        got = self.raw("HEAD /api/store HTTP/1.1", f"Host: 127.0.0.1:{self.view.port}", "", "this is no request", "")
        first, second, body = got.split(b"\r\n\r\n")
        self.assertTrue(first.startswith(b"HTTP/1.1 200 ") and second.startswith(b"HTTP/1.1 400 "), got)
        self.assertEqual(body, b"not an HTTP request\n")

    def test_no_content_has_no_length(self):
        _, headers, _ = self.view.ask("/api/cancel", method="POST", stream="a")
        self.assertNotIn("Content-Length", headers)

    def test_a_parameter_that_is_not_known_is_refused_everywhere(self):
        for method, path, parameters in (("GET", "/api/store", {"a": 1}), ("GET", "/api/status", {"a": 1}), ("GET", "/api/histogram", {"a": 1}),
                                         ("POST", "/api/cancel", {"stream": "a", "a": 1}), ("POST", "/api/cancel", {}),
                                         ("GET", "/api/command", {"iso": 0.5, "format": "exe"})):
            status, _, body = self.view.ask(path, method=method, **parameters)
            self.assertEqual(status, 400, (path, parameters))
            self.assertTrue(json.loads(body)["error"]["message"])


class Trust(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        # 1.6 M triangles at full resolution: long enough to be cancelled.
        isonest("make-volume", "bucky", "--size", 257, "--type", "uint8", "-o", "l.h5", "-q")
        isonest("preprocess", "l.h5", "-o", "l.isonest", "-q")
        isonest("make-volume", "bucky", "--size", 33, "-o", "t.h5", "-q")
        isonest("preprocess", "t.h5", "-o", "t.isonest", "-q")

    def wait_until(self, condition, what):
        for _ in range(6000 if sanitized.is_sanitized(ISONEST) else 600):
            if condition():
                return
            time.sleep(0.05)
        self.fail(what)

    def test_a_newer_request_of_a_stream_ends_the_older_one(self):
        with view("l.isonest") as server, concurrent.futures.ThreadPoolExecutor() as pool:
            old = pool.submit(server.json, "/api/surface", iso=128, distance=1, stream="a")
            self.wait_until(lambda: server.json("/api/status")[1]["surface"] == 1, "it never began")
            new = server.mesh("/api/surface", iso=128, triangles=5000, stream="a")
            self.assertLessEqual(new["triangles"], 5000)
            status, said = old.result(timeout=60)
            self.assertEqual((status, said["error"]["kind"]), (409, "cancelled"))

    def test_cancel_and_a_closed_connection_end_the_work(self):
        with view("l.isonest") as server, concurrent.futures.ThreadPoolExecutor() as pool:
            old = pool.submit(server.json, "/api/surface", iso=128, distance=1, stream="a")
            self.wait_until(lambda: server.json("/api/status")[1]["surface"] == 1, "it never began")
            self.assertEqual(server.ask("/api/cancel", method="POST", stream="a")[0], 204)
            self.assertEqual(old.result(timeout=60)[0], 409)
            gone = socket.create_connection(("127.0.0.1", server.port))
            gone.sendall(f"GET /api/surface?iso=128&distance=1 HTTP/1.1\r\nHost: 127.0.0.1:{server.port}\r\n\r\n".encode())
            self.wait_until(lambda: server.json("/api/status")[1]["surface"] == 1, "it never began")
            gone.close()
            self.wait_until(lambda: server.json("/api/status")[1]["surface"] == 0, "it went on")
            self.assertEqual(server.json("/api/status")[1]["cancelled"], 2)

    def test_too_much_waiting_work_is_refused(self):
        with view("l.isonest") as server, concurrent.futures.ThreadPoolExecutor(40) as pool:
            answers = [pool.submit(server.ask, "/api/surface", iso=128, distance=1, stream=f"s{i}") for i in range(30)]
            self.wait_until(lambda: any(a.done() for a in answers), "none was refused")
            for i in range(30):
                server.ask("/api/cancel", method="POST", stream=f"s{i}")
            codes = {a.result(timeout=60)[0] for a in answers}
            self.assertEqual(codes - {200}, {409, 503})  # if the machine is busy the first may be done before others arrive

    def test_thousands_of_connections_and_slow_readers_leave_it_usable(self):
        resource.setrlimit(resource.RLIMIT_NOFILE, (4096, resource.getrlimit(resource.RLIMIT_NOFILE)[1]))
        with view("l.isonest") as server:
            held = []
            for i in range(2000):
                s = socket.create_connection(("127.0.0.1", server.port), timeout=10)
                if i % 2:
                    with contextlib.suppress(OSError):
                        s.sendall(b"GET /api/st")
                held.append(s)
            self.assertEqual(server.json("/api/store")[0], 200)
            self.assertLessEqual(server.json("/api/status")[1]["connections"], 128)
            slow = []
            for i in range(60):
                s = socket.socket()
                s.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
                s.connect(("127.0.0.1", server.port))
                s.sendall(f"GET /api/slice?plane=0,0,1,{100 + i}&error=0 HTTP/1.1\r\nHost: 127.0.0.1:{server.port}\r\n\r\n".encode())
                slow.append(s)
                if i % 10 == 9:
                    self.wait_until(lambda: server.json("/api/status")[1]["waiting"] == 0, "it stands")
            mesh = server.mesh("/api/surface", iso=128, triangles=50000)
            self.assertGreater(mesh["triangles"], 100)
            state = server.json("/api/status")[1]
            self.assertLess(state["heap_bytes"], state["memory"])
            for s in held + slow:
                s.close()

    def test_bytes_that_are_no_request_are_answered_or_dropped(self):
        rng = random.Random(11)
        good = "GET /api/surface?iso=0.5&error=0.1&box=0,0,0,9,9,9 HTTP/1.1\r\nHost: 127.0.0.1:{}\r\n\r\n"
        with view("t.isonest") as server:
            for i in range(400):
                data = bytearray(good.format(server.port).encode())
                for _ in range(rng.randrange(1, 8)):
                    data[rng.randrange(len(data))] = rng.randrange(256)
                if i % 3 == 0:
                    data = bytearray(rng.randbytes(rng.randrange(1, 300)))
                if i % 50 == 1:
                    data = b"GET /" + b"a" * 40000 + b" HTTP/1.1\r\n\r\n"
                if i % 50 == 2:
                    data = b"POST /api/cancel HTTP/1.1\r\nContent-Length: 99999999999999\r\n\r\n"
                with socket.create_connection(("127.0.0.1", server.port), timeout=30) as s:
                    with contextlib.suppress(OSError):
                        s.sendall(data)
                        s.shutdown(socket.SHUT_WR)
                        answer = s.recv(15)
                        self.assertTrue(answer == b"" or answer.startswith(b"HTTP/1.1 "), answer)
            self.assertEqual(server.json("/api/store")[0], 200)

    def test_another_address_needs_the_token_of_its_url(self):
        for options in (["--address", "0.0.0.0"], ["--token"]):
            with view("t.isonest", *options) as server:
                token = urllib.parse.parse_qs(urllib.parse.urlsplit(server.url).query)["token"][0]
                self.assertRegex(token, r"^[0-9a-f]{32}$")
                self.assertEqual(server.ask("/")[0], 200)
                self.assertEqual(server.ask("/api/store")[0], 403)
                self.assertEqual(server.ask("/api/store", token=token[:-1] + "x")[0], 403)
                self.assertEqual(server.ask("/api/store", token=token)[0], 200)

    def test_a_browser_that_lasts_holds_up_nothing_and_has_no_socket(self):
        folder = HERE / "bin"
        folder.mkdir()
        (folder / "xdg-open").write_text("#!/bin/sh\necho $1 $(ls -l /proc/$$/fd | grep -c socket:) $$ > new\n"
                                         "mv new opened\nexec sleep 600 > /dev/null 2>&1\n")
        (folder / "xdg-open").chmod(0o755)
        with unittest.mock.patch.dict(os.environ, PATH=f"{folder}:{os.environ['PATH']}"), \
                view("t.isonest", "--open") as server:
            self.wait_until((HERE / "opened").exists, "no browser was opened")
            self.assertEqual(server.json("/api/store")[0], 200)
            url, sockets, pid = (HERE / "opened").read_text().split()
            os.kill(int(pid), signal.SIGKILL)
            self.assertEqual((url, sockets), (server.url, "0"))

    def test_a_replaced_or_cut_off_store_is_noticed(self):
        def replace(path):
            shutil.copy(HERE / "t.isonest", HERE / "new.isonest")
            (HERE / "new.isonest").rename(path)

        def write(path):
            with open(path, "r+b") as f:
                f.seek(100)
                f.write(b"x")

        for change, word in ((replace, "replaced"), (os.unlink, "replaced"), (write, "replaced"),
                             (lambda p: os.truncate(p, 4096), "cut off")):
            path = HERE / "c.isonest"
            shutil.copy(HERE / "t.isonest", path)
            time.sleep(0.02)
            with view("c.isonest") as server:
                self.assertEqual(server.json("/api/status")[1]["store"], "ok")
                change(path)
                status, said = server.json("/api/surface", iso=0.5, error=0)
                self.assertEqual(status, 410)
                self.assertIn(word, said["error"]["message"])
                self.assertEqual(server.json("/api/status")[1]["store"], word)

    def test_a_store_that_is_cut_off_while_it_is_read_leaves_no_file(self):
        shutil.copy(HERE / "l.isonest", HERE / "cut.isonest")
        folder = pathlib.Path(tempfile.mkdtemp(dir=HERE))
        server = View("cut.isonest", folder=folder)
        waiting = socket.socket()
        waiting.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        waiting.connect(("127.0.0.1", server.port))
        waiting.sendall(f"GET /api/export?iso=128&error=0 HTTP/1.1\r\nHost: 127.0.0.1:{server.port}\r\n\r\n".encode())
        self.wait_until(lambda: list(folder.glob("*/surface.ply")), "no file was made")
        with concurrent.futures.ThreadPoolExecutor(10) as pool:
            for i in range(10):
                pool.submit(server.ask, "/api/surface", iso=120 + i, error=0)
            self.wait_until(lambda: server.json("/api/status")[1]["waiting"] > 5, "it never began")
            os.truncate(HERE / "cut.isonest", 4096)
            _, err = server.process.communicate(timeout=60)
        waiting.close()
        self.assertEqual(server.process.returncode, 6, err)
        self.assertIn("truncated", err)
        self.assertEqual(list(folder.iterdir()), [])

    def test_an_address_may_be_written_in_any_way_and_a_browser_leaves_out_port_80(self):
        with view("t.isonest", "--address", "0:0:0:0:0:0:0:1") as server:
            self.assertEqual(server.url, f"http://[::1]:{server.port}/")
            with socket.create_connection(("::1", server.port)) as s:
                s.sendall(f"GET /api/store HTTP/1.1\r\nHost: [::1]:{server.port}\r\n\r\n".encode())
                self.assertTrue(s.recv(15).startswith(b"HTTP/1.1 200 "))
        try:
            socket.create_server(("127.0.3.7", 80)).close()
        except OSError as error:
            self.skipTest(f"port 80: {error}")
        with view("t.isonest", "--address", "127.0.3.7", "--port", "80") as server:
            for host, status in (("127.0.3.7", b"200"), ("127.0.3.7:80", b"200"), ("localhost", b"200"), ("evil.example", b"403")):
                with socket.create_connection(("127.0.3.7", 80)) as s:
                    s.sendall(f"GET /api/store HTTP/1.1\r\nHost: {host}\r\nOrigin: http://{host}\r\n\r\n".encode())
                    self.assertTrue(s.recv(15).startswith(b"HTTP/1.1 " + status), host)

    def test_signals_end_it_cleanly_with_work_under_way(self):
        for number in (signal.SIGINT, signal.SIGTERM):
            folder = pathlib.Path(tempfile.mkdtemp(dir=HERE))
            server = View("l.isonest", folder=folder)
            with concurrent.futures.ThreadPoolExecutor() as pool:
                for path in ("/api/surface", "/api/export"):
                    pool.submit(server.ask, path, iso=128, distance=1)
                self.wait_until(lambda: server.json("/api/status")[1]["surface"] == 1, "it never began")
                code, out, err = server.end(number)
            self.assertEqual((code, err), (0, ""))
            self.assertTrue(json.loads(out)["ended"])
            self.assertEqual(list(folder.iterdir()), [])

    @unittest.skipIf(sanitized.is_sanitized(ISONEST), "sanitizers need more memory than such limits leave")
    def test_the_memory_is_kept_whatever_is_asked_for(self):
        # Mapped memory (the store, the program's code) does not count; what threads' stacks reserve does.
        memory = 512 << 20
        with view("l.isonest", "--memory", "512M", "--threads", 2, limit=memory + (200 << 20)) as server, \
                concurrent.futures.ThreadPoolExecutor(12) as pool:
            asked = [("/api/surface", {"iso": 128, "error": 0}), ("/api/surface", {"iso": 90, "triangles": 2000000}),
                     ("/api/slice", {"plane": "0,0,1,128", "error": 0}), ("/api/slice", {"plane": "1,1,1,380", "error": 0}),
                     ("/api/export", {"iso": 128, "error": 0}), ("/api/histogram", {}), ("/api/value", {"at": "9,9,9"})]
            answers = [pool.submit(server.ask, path, **parameters) for _ in range(3) for path, parameters in asked]
            most = 0
            while not all(a.done() for a in answers):
                most = max(most, server.json("/api/status")[1]["heap_bytes"])
                time.sleep(0.01)
            self.assertLess(most, memory)
            for answer, (path, parameters) in zip(answers, asked * 3):
                self.assertIn(answer.result()[0], (200, 413), (path, parameters, answer.result()[2][:300]))
            self.assertEqual(server.json("/api/store")[0], 200)

    @unittest.skipIf(sanitized.is_sanitized(ISONEST), "a sanitizer keeps what is freed")
    def test_a_server_that_nobody_asks_keeps_no_memory(self):
        with view("l.isonest", "--memory", "512M", "--threads", 2) as server, concurrent.futures.ThreadPoolExecutor(4) as pool:
            def own():
                lines = pathlib.Path(f"/proc/{server.process.pid}/status").read_text().splitlines()
                return next(int(line.split()[1]) << 10 for line in lines if line.startswith("RssAnon"))
            before = own()
            asked = [("/api/surface", {"iso": 128, "error": 0}), ("/api/surface", {"iso": 90, "triangles": 200000}),
                     ("/api/slice", {"plane": "1,1,1,380", "error": 0}), ("/api/export", {"iso": 128, "error": 0})]
            for answer in [pool.submit(server.ask, path, **parameters) for _ in range(2) for path, parameters in asked]:
                self.assertEqual(answer.result()[0], 200)
            self.wait_until(lambda: own() < before + (12 << 20), "it keeps what its answers took")

    def test_a_volume_is_shown_as_its_store_which_is_gone_afterwards(self):
        with view("t.isonest") as server:
            expected = server.mesh("/api/surface", iso=128, error=3)
        for number in (signal.SIGINT, signal.SIGTERM):
            with tempfile.TemporaryDirectory() as folder:
                server = View("t.h5", folder=folder)
                self.assertEqual(len(os.listdir(folder)), 1)
                shown = server.mesh("/api/surface", iso=128, error=3)
                self.assertEqual(shown["triangles"], expected["triangles"])
                numpy.testing.assert_array_equal(shown["points"], expected["points"])
                self.assertEqual(server.end(number)[0], 0)
                self.assertEqual(os.listdir(folder), [])

    def test_what_cannot_be_is_said_before_the_start(self):
        (HERE / "junk").write_bytes(b"hello world" * 100)
        for options, code, words in ((["none.isonest"], 3, "none.isonest"), (["junk"], 2, "--dims"),
                                     (["t.isonest", "--memory", "10M"], 7, "--memory"),
                                     (["t.isonest", "--port", "70000"], 2, "--port"),
                                     (["t.isonest", "--address", "here"], 2, "address")):
            done = served.run([ISONEST, "view", *options], cwd=HERE, capture_output=True, text=True, timeout=60)
            self.assertEqual(done.returncode, code, done.stderr)
            self.assertIn(words, done.stderr)
        with view("t.isonest") as server:
            done = served.run([ISONEST, "view", "t.isonest", "--port", str(server.port)], cwd=HERE,
                              capture_output=True, text=True, timeout=60)
            self.assertEqual(done.returncode, 6)
            self.assertIn(str(server.port), done.stderr)


class Kinds(unittest.TestCase):
    """Stores that are not plain volumes."""

    def test_a_plane_has_slices_and_says_that_it_has_no_surface(self):
        numpy.random.default_rng(1).integers(0, 99, (20, 30)).astype("<i2").tofile(HERE / "p.raw")
        isonest("preprocess", "p.raw", "--dims", "30,20", "--type", "int16", "-o", "p.isonest", "-q")
        with view("p.isonest") as server:
            self.assertEqual(server.json("/api/store")[1]["dimension"], 2)
            mesh = server.mesh("/api/slice", plane="0,0,1,0", error=0)
            self.assertEqual(mesh["triangles"], 2 * 19 * 29)
            data = numpy.fromfile(HERE / "p.raw", "<i2").reshape(20, 30)
            x, y = mesh["points"][:, :2].round().astype(int).T
            self.assertLessEqual(numpy.abs(data[y, x] - mesh["values"]).max(), mesh["value_rounding"] * 1.001)
            coarse = server.mesh("/api/slice", plane="0,0,1,0", error=5)
            self.assertTrue(0 < coarse["error_bound"] <= 5 and not coarse["full_resolution"], coarse["error_bound"])
            said = server.json("/api/command", plane="0,0,1,0", error=5)[1]
            isonest(*said["command"].split()[1:])
            self.assertEqual(len(read_ply(HERE / "slice.ply")[1]), coarse["triangles"])
            status, said = server.json("/api/surface", iso=50, error=0)
            self.assertEqual(status, 400, said)
            self.assertIn("plane", said["error"]["message"])

    def test_missing_values_and_empty_surfaces_are_answers(self):
        data = numpy.random.default_rng(2).random((9, 10, 11), dtype=numpy.float32)
        data[4] = numpy.nan
        data.tofile(HERE / "m.raw")
        numpy.full((5, 5, 5), numpy.nan, "<f4").tofile(HERE / "n.raw")
        isonest("preprocess", "m.raw", "--dims", "11,10,9", "--type", "float32", "-o", "m.isonest", "-q")
        isonest("preprocess", "n.raw", "--dims", "5,5,5", "--type", "float32", "-o", "n.isonest", "-q")
        with view("m.isonest") as server:
            self.assertEqual(server.mesh("/api/surface", iso=7, error=0)["triangles"], 0)
            self.assertGreater(server.mesh("/api/surface", iso=0.5, triangles=50000)["triangles"], 100)
            _, said = server.json("/api/value", at="3,3,4")
            self.assertEqual((said["inside"], said["value"]), (True, None))
        with view("n.isonest") as server:
            self.assertIsNone(server.json("/api/store")[1]["min_value"])
            self.assertEqual(server.mesh("/api/surface", iso=0, triangles=1000)["triangles"], 0)

    def test_labels_have_surfaces_by_their_names(self):
        labels = numpy.zeros((12, 12, 12), "<u8")
        labels[3:8, 3:8, 3:8] = 2 ** 60 + 1
        with h5py.File(HERE / "b.h5", "w") as file:
            file["labels"] = labels
        isonest("preprocess", "b.h5", "--labels", "-o", "b.isonest", "-q")
        with view("b.isonest") as server:
            self.assertTrue(server.json("/api/store")[1]["labels"])
            self.assertGreater(server.mesh("/api/surface", label=2 ** 60 + 1)["triangles"], 100)
            said = server.json("/api/value", at="5,5,5")[1]
            self.assertEqual((said["node_value"], said["name"]), (2 ** 60 + 1, None))
            self.assertEqual(server.json("/api/label", id=2 ** 60 + 1)[1],
                             {"id": 2 ** 60 + 1, "name": None, "color": None})

    def test_labels_with_names_are_named_and_coloured(self):
        labels = numpy.ones((12, 12, 12), "u1")
        labels[3:8, 3:8, 3:8] = 7
        numpy.save(HERE / "named.npy", labels)
        (HERE / "named.txt").write_text("7 Übergang 255 0 128 255\n9 nowhere\n")
        isonest("preprocess", "named.npy", "--labels", "--label-names", "named.txt", "-o", "named.isonest", "-q")
        isonest("extract", "named.isonest", "--label", "7", "--normals", "-o", "named.glb", "-q")
        with view("named.isonest") as server:
            self.assertTrue(server.json("/api/store")[1]["labels"])
            for label, name, color in ((7, "Übergang", [255, 0, 128]), (9, "nowhere", None), (1, None, None)):
                self.assertEqual(server.json("/api/label", id=label)[1], {"id": label, "name": name, "color": color})
            said = server.json("/api/value", at="5,5,5")[1]
            self.assertEqual((said["value"], said["node_value"], said["name"]), (None, 7, "Übergang"))
            for query in ({}, {"id": "x"}, {"id": 7, "more": 1}):
                self.assertEqual(server.json("/api/label", **query)[0], 400)
            self.assertEqual(server.ask("/api/export", format="glb", label=7, error=0)[2], (HERE / "named.glb").read_bytes())

    def test_a_smooth_label_is_the_one_that_extract_makes(self):
        z, y, x = numpy.mgrid[:30, :32, :34]
        labels = 1 + (x > 14).astype("u2") + 2 * ((x - 17) ** 2 + (y - 16) ** 2 + (z - 15) ** 2 < 110)
        labels[2, 2, 2] = 3
        numpy.save(HERE / "smooth.npy", labels.astype("u2"))
        isonest("preprocess", "smooth.npy", "--labels", "--spacing", "0.5,1,2", "--origin", "7,-3,0", "--unit", "mm", "-o",
                "smooth.isonest", "-q")
        with view("smooth.isonest") as server:
            for asked in ({"smooth": 16}, {"smooth": 0}, {"smooth": 5, "components": "largest"}):
                mesh = server.mesh("/api/surface", label=3, **asked)
                said = server.json("/api/command", label=3, **asked)[1]["command"]
                self.assertIn(f" --smooth={asked['smooth']} ", said)
                report = json.loads(isonest(*said.split()[1:], "--json").stdout)
                vertices, faces = read_ply(HERE / "surface.ply")
                points = numpy.stack([vertices[k] for k in "xyz"], axis=1).astype(float)
                self.assertEqual((mesh["vertices"], mesh["triangles"]), (len(points), len(faces)))
                self.assertLessEqual(numpy.linalg.norm(points - mesh["points"], axis=1).max(),
                                     mesh["position_rounding"] * 1.0001 + 1e-6)
                self.assertTrue((numpy.sort(faces, axis=1) == numpy.sort(mesh["faces"].astype(int), axis=1)).all())
                self.assertEqual((mesh["stop"], mesh["full_resolution"]), ("smooth", True))
                self.assertIsNone(mesh["error_bound"])
                self.assertIsNone(mesh["distance_bound"])
                self.assertAlmostEqual(mesh["smooth_bound"], report["smooth_bound"] + mesh["position_rounding"], 12)
                # Its normals: of unit length, outward from the label, and close to those of the surrounding triangles.
                self.assertLess(numpy.abs(numpy.linalg.norm(mesh["normals"], axis=1) - 1).max(), 0.02)
                t = mesh["points"][mesh["faces"]]
                area = numpy.cross(t[:, 1] - t[:, 0], t[:, 2] - t[:, 0])
                mean = numpy.zeros_like(mesh["points"])
                for k in range(3):
                    numpy.add.at(mean, mesh["faces"][:, k], area)
                mean /= numpy.linalg.norm(mean, axis=1)[:, None]
                self.assertLess(numpy.abs(mean - mesh["normals"]).max(), 0.01)
                centre = numpy.array([7 + 0.5 * 11, -3 + 16, 2 * 15])
                big = numpy.linalg.norm((mesh["points"] - centre) / (0.5, 1, 2), axis=1) < 12
                self.assertGreater(((mesh["points"] - centre) * mesh["normals"]).sum(1)[big].min(), 0)
                # As a file it has no normals, like the output of extract.
                content = server.ask("/api/export", label=3, format="ply", **asked)[2]
                self.assertEqual(content, (HERE / "surface.ply").read_bytes())
            self.assertEqual(server.mesh("/api/surface", label=77, smooth=16)["triangles"], 0)
            full = server.mesh("/api/surface", label=3, error=0)
            self.assertIsNone(full["smooth_bound"])
            for status, asked in ((400, {"smooth": 65}), (400, {"smooth": "x"}), (400, {"smooth": 16, "box": "8,0,0,9,9,9"}),
                                  (400, {"smooth": 16, "distance": 1}), (400, {"smooth": 16, "error": 1}),
                                  (400, {"smooth": 16, "triangles": 100}), (413, {"smooth": 16, "limit": 100})):
                found, said = server.json("/api/surface", label=3, **asked)
                self.assertEqual(found, status, said)
                self.assertIn("triangles" if status == 413 else "smooth" if "error" not in asked and "triangles" not in asked
                              else "labels", said["error"]["message"])
            self.assertEqual(server.json("/api/surface", iso=1, smooth=16)[0], 400)


if __name__ == "__main__":
    try:
        unittest.main(argv=[sys.argv[0], *sys.argv[3:]], exit=False).result.wasSuccessful() or sys.exit(1)
    finally:
        shutil.rmtree(HERE, ignore_errors=True)
