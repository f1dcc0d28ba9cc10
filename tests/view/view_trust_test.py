"""The server of isonest view from outside, over its socket: limits on what strangers, signals and replaced files
can do to it.

Usage: view_trust_test.py ISONEST PLUGIN_FOLDER
"""
import concurrent.futures
import contextlib
import json
import os
import pathlib
import random
import resource
import shutil
import signal
import socket
import sys
import tempfile
import time
import unittest
import unittest.mock
import urllib.parse

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1] / "support"))
import sanitized  # noqa: E402
import served  # noqa: E402
from view_process import HERE, ISONEST, View, isonest, run_tests, view  # noqa: E402

import numpy


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

    def test_impossible_options_are_refused_before_the_start(self):
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


if __name__ == "__main__":
    run_tests()
