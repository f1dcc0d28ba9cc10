"""The answers of isonest view from outside, over its socket: they are those of the program's other commands.

Usage: view_server_test.py ISONEST PLUGIN_FOLDER
"""
import json
import pathlib
import random
import socket
import subprocess
import sys
import unittest

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1] / "support"))
from mesh_data import read_ply  # noqa: E402
from view_process import HERE, ISONEST, View, isonest, run_tests, view  # noqa: E402

import h5py
import numpy


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
    run_tests()
