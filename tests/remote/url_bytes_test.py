"""Ranges of objects elsewhere: the right bytes by few requests, or a clear error, whatever the server does.

usage: url_bytes_test.py ISONEST PLUGIN_FOLDER [FAULTS]   (of the random ones; ISONEST_FAULTS says the same)
"""
import json
import os
import pathlib
import random
import re
import socket
import subprocess
import sys
import tempfile
import threading
import time
import unittest

sys.path.insert(0, str(pathlib.Path(__file__).parents[1]))
from support.range_server import RangeServer, certificate  # noqa: E402

PROGRAM = pathlib.Path(sys.argv[1]).parent / "isonest_fetch_ranges"
FAULTS = int(sys.argv[3] if len(sys.argv) > 3 else os.environ.get("ISONEST_FAULTS", "600"))
SIZE = 3_000_017
TAIL = 65536
QUICK = {"first_wait_ms": 2, "total_ms": 3000, "slow_ms": 3000, "slow_bytes": 100, "connect_ms": 2000}
CLEAN = {name: value for name, value in os.environ.items()
         if not name.startswith(("AWS_", "SSL_CERT", "CURL_")) and not name.lower().endswith("_proxy")}
# A sanitizer's own memory says nothing of ours.
IS_SANITIZED = re.search(b"__[at]san_init", PROGRAM.read_bytes()) is not None


class Client:
    """The program that reads, in a process of its own."""

    def __init__(self, **environment):
        self.process = subprocess.Popen([PROGRAM], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True,
                                        env={**CLEAN, "HOME": str(FOLDER / "home"), **environment})

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.process.stdin.close()
        self.process.stdout.close()
        if self.process.wait(20) != 0 and sys.exc_info()[0] is None:
            raise AssertionError(f"the program ended with {self.process.returncode}")

    def do(self, what, **values):
        self.process.stdin.write(json.dumps({"do": what, **values}) + "\n")
        self.process.stdin.flush()
        return json.loads(self.process.stdout.readline())

    def open(self, url, **values):
        return self.do("open", url=url, file=str(FOLDER / "a.bin"), **{**QUICK, **values})

    def read(self, *ranges, threads=1):
        answer = self.do("read", ranges=ranges, threads=threads)
        if answer["wrong"]:
            raise AssertionError(f"{answer['wrong']} of {len(ranges)} ranges are wrong")
        return answer

    def held(self):
        """Open files and threads."""
        process = pathlib.Path("/proc", str(self.process.pid))
        return len(list((process / "fd").iterdir())), len(list((process / "task").iterdir()))

    def memory(self):
        text = pathlib.Path("/proc", str(self.process.pid), "status").read_text(encoding="ascii")
        return int(text.split("VmRSS:")[1].split()[0]) * 1024


def from_second(fault, times=10**9):
    """Opening goes well; then so many requests have a fault."""
    return lambda number, path, headers: fault if 2 <= number < 2 + times else None


class Reading(unittest.TestCase):
    def test_opening_is_one_request_for_the_end(self):
        with RangeServer(FOLDER) as server, Client() as client:
            answer = client.open(server.url("a.bin"))
            self.assertEqual((answer["size"], answer["requests"], answer["round_trips"], answer["remote_bytes"]),
                             (SIZE, 1, 1, TAIL))
            answer = client.read([SIZE - TAIL, TAIL], [SIZE - 5, 5], [SIZE, 0])
            self.assertEqual((answer["requests"], answer["round_trips"], answer["errors"]), (1, 1, []))

    def test_small_and_empty_objects_and_servers_that_know_only_a_first_byte(self):
        for name, size in (("small.bin", 100), ("empty.bin", 0)):
            with RangeServer(FOLDER) as server, Client() as client:
                answer = client.do("open", url=server.url(name), file=str(FOLDER / name), **QUICK)
                self.assertEqual((answer["size"], answer["requests"]), (size, 1))
                self.assertEqual(client.read([0, size])["errors"], [])
        with RangeServer(FOLDER, knows_tails=False) as server, Client() as client:
            answer = client.open(server.url("a.bin"))
            self.assertEqual((answer["size"], answer["requests"]), (SIZE, 2))
            client.read([1000, 5000], [SIZE - 100_000, 100_000])

    def test_what_was_announced_together_comes_in_one_round_trip_and_joined(self):
        with RangeServer(FOLDER, delay=0.02) as server, Client() as client:
            client.open(server.url("a.bin"))
            before = server.requests
            ranges = [[i * 10_000, 9_000] for i in range(50)] + [[1_000_000, 9_000], [2_000_000, 30_000]]
            client.do("want", ranges=ranges + [[SIZE + 5, 10]])
            answer = client.read(*ranges, threads=8)
            self.assertEqual(answer["round_trips"], 2)
            self.assertEqual(server.requests - before, 3)  # gaps of 1000 bytes are joined, larger ones are not
            self.assertLessEqual(server.bytes - TAIL, 1.25 * sum(size for _, size in ranges))
            # It is there now.
            self.assertEqual(client.read(*ranges, threads=4)["requests"], answer["requests"])
            # Each of these needs the one before, as far as anybody can know.
            for i in range(3):
                answer = client.read([600_000 + i * 100_000, 500])
            self.assertEqual(answer["round_trips"], 5)

    def test_nothing_is_fetched_twice_at_the_same_time(self):
        with RangeServer(FOLDER, delay=0.05) as server, Client() as client:
            client.open(server.url("a.bin"))
            answer = client.read(*[[500_000, 100_000]] * 16, threads=16)
            self.assertEqual((answer["requests"], answer["round_trips"]), (2, 2))
            client.read(*([i * 1000, 50_000] for i in range(40)), threads=16)
            fetched = server.bytes - TAIL
            self.assertEqual(fetched, 100_000 + 89_000)

    def test_large_ranges_are_cut_and_what_does_not_fit_comes_later(self):
        with RangeServer(FOLDER) as server, Client() as client:
            client.do("open", url=server.url("large.bin"), file=str(FOLDER / "large.bin"), **QUICK)
            self.assertEqual(client.read([17, 20_000_000])["requests"], 4)
        with RangeServer(FOLDER) as server, Client() as client:
            client.do("open", url=server.url("large.bin"), file=str(FOLDER / "large.bin"), **QUICK, budget=2 << 20)
            before = client.memory()
            chunks = [[at, 40_000] for at in range(0, 20_000_000, 50_000)]
            client.do("want", ranges=chunks)
            answer = client.read(*chunks, threads=4)
            self.assertEqual(answer["errors"], [])
            self.assertLess(answer["round_trips"], 60)  # and not one for each of the 400
            self.assertLess(server.bytes, 1.25 * 400 * 40_000 + TAIL)
            self.assertTrue(IS_SANITIZED or client.memory() - before < 24 << 20)
            self.assertEqual(client.read([0, 10_000_000])["errors"], [])  # larger than the budget

    def test_a_cache_answers_in_place_of_the_server(self):
        ranges = [[i * 20_000, 10_000] for i in range(40)]
        with RangeServer(FOLDER) as server, Client() as client:
            for turn in range(2):
                client.open(server.url("a.bin?sig=s3cret"), cache=True)
                client.do("want", ranges=ranges[turn * 8:])
                answer = client.read(*ranges, threads=4)
                self.assertEqual(answer["errors"], [])
            self.assertEqual((answer["requests"], answer["round_trips"], answer["cache_bytes"]), (1, 1, 400_000))
            os.utime(FOLDER / "a.bin")  # another ETag
            client.open(server.url("a.bin"), cache=True)
            self.assertEqual(client.read(*ranges)["cache_bytes"], 0)

    def test_of_a_known_object_only_its_last_bytes_are_asked_for(self):
        end = [SIZE - TAIL, TAIL]
        with RangeServer(FOLDER) as server, Client() as client:
            def opened():
                requests, sent = server.requests, server.bytes
                client.open(server.url("a.bin?v=1"), cache=True, known=True)
                answer = client.read(end, [SIZE - 10, 10])
                self.assertEqual(answer["errors"], [])
                return server.requests - requests, server.bytes - sent, answer["round_trips"], answer["cache_bytes"]

            self.assertEqual(opened(), (1, TAIL, 1, 0))
            for _ in range(2):
                self.assertEqual(opened(), (1, 64, 1, TAIL - 64))
            os.utime(FOLDER / "a.bin", (1e9, 1e9))  # another ETag: nothing of the cache is used
            self.assertEqual(opened(), (2, TAIL, 2, 0))
            self.assertEqual(opened(), (1, 64, 1, TAIL - 64))
            # What is not what it says it is: other bytes under the same ETag.
            server.validators = lambda path, data, same=server.validators(FOLDER / "a.bin", bytes(SIZE)): same
            before = (FOLDER / "a.bin").read_bytes()
            (FOLDER / "a.bin").write_bytes(bytes(SIZE))
            try:
                self.assertEqual(opened(), (2, TAIL, 2, 0))
            finally:
                (FOLDER / "a.bin").write_bytes(before)

    def test_a_slow_cache_holds_up_no_transfer(self):
        ranges = [[i * 100_000, 20_000] for i in range(25)]
        with RangeServer(FOLDER) as server, Client() as client:
            for _ in range(2):  # what the cache has not is looked for while others are read
                client.open(server.url("a.bin"), cache=True, keep_ms=100, load_ms=0)
                client.do("want", ranges=ranges)
                start = time.monotonic()
                answer = client.read(*ranges, threads=2)
                self.assertEqual(answer["errors"], [])
                self.assertLess(time.monotonic() - start, 1.5)  # to keep them all takes 2.5 s
                start = time.monotonic()
                client.do("close")  # which waits until they are kept
                kept = time.monotonic() - start
            self.assertLess(kept, 0.5)
            self.assertEqual((answer["requests"], answer["cache_bytes"]), (1, 25 * 20_000))

    def test_what_does_not_fit_into_the_queue_is_not_kept_and_not_waited_for(self):
        ranges = [[i * 100_000, 90_000] for i in range(25)]
        with RangeServer(FOLDER) as server, Client() as client:
            client.open(server.url("a.bin"), cache=True, keep_ms=400, budget=1 << 20)
            start = time.monotonic()
            self.assertEqual(client.read(*ranges)["errors"], [])
            self.assertLess(time.monotonic() - start, 2)
            client.open(server.url("a.bin"), cache=True)
            answer = client.read(*ranges)
            self.assertGreater(answer["cache_bytes"], 0)
            self.assertLess(answer["cache_bytes"], 25 * 90_000 // 2)

    def test_after_ctrl_c_the_cache_is_not_waited_for(self):
        with RangeServer(FOLDER, fault_of=lambda number, *_: "silent" if number > 21 else None) as server, Client() as client:
            client.open(server.url("a.bin"), cache=True, keep_ms=300)
            client.read(*([i * 100_000, 9_000] for i in range(20)))  # 6 s to keep
            client.do("cancel", after_ms=0)
            start = time.monotonic()
            self.assertEqual(client.read([50_000, 1000])["errors"][0]["kind"], "cancelled")
            client.do("close")
            self.assertLess(time.monotonic() - start, 1.5)

    def test_what_is_forgotten_is_fetched_again_and_not_taken_from_the_cache(self):
        faults = iter(["wrong_bytes"])
        with RangeServer(FOLDER, fault_of=lambda number, *_: next(faults, None) if number == 2 else None) as server, \
                Client() as client:
            client.open(server.url("a.bin"), cache=True)
            self.assertEqual(client.do("read", ranges=[[5000, 1000]])["wrong"], 1)
            self.assertEqual(client.do("read", ranges=[[5000, 1000]])["wrong"], 1)
            client.do("forget", ranges=[[5000, 10]])
            for want in (False, True):
                if want:
                    client.do("want", ranges=[[5000, 1000]])
                self.assertEqual(client.do("read", ranges=[[5000, 1000]])["wrong"], 0)
            self.assertEqual(server.requests, 3)
            client.open(server.url("a.bin"), cache=True)
            self.assertEqual(client.read([5000, 1000])["cache_bytes"], 1000)

    def test_ctrl_c_ends_a_wait_at_once(self):
        with RangeServer(FOLDER, fault_of=from_second("silent")) as server, Client() as client:
            client.open(server.url("a.bin"), slow_ms=20_000)
            client.do("cancel", after_ms=200)
            start = time.monotonic()
            answer = client.read([0, 1000], [5000, 1000], threads=2)
            self.assertEqual([error["kind"] for error in answer["errors"]], ["cancelled"])
            client.do("close")
            self.assertLess(time.monotonic() - start, 1)
        with RangeServer(FOLDER, fault_of=lambda *_: "silent") as server, Client() as client:
            client.do("cancel", after_ms=200)
            start = time.monotonic()
            self.assertEqual(client.open(server.url("a.bin"), slow_ms=20_000)["error"]["kind"], "cancelled")
            self.assertLess(time.monotonic() - start, 1)


class Faults(unittest.TestCase):
    def error_of(self, fault, kind, problem, *remedies, at_opening=False):
        """That a server with this fault leads to this error, in time, and without a word of what is secret."""
        faults = (lambda *_: fault) if at_opening else from_second(fault)
        with self.subTest(fault), RangeServer(FOLDER, fault_of=faults, silence=5) as server, Client() as client:
            start = time.monotonic()
            url = server.url("a.bin?signature=s3cret", "user:s3cret@")
            slow_ms = 300 if fault in ("silent", "slow") else 3000
            opened = client.open(url, headers=["X-Key: s3cret"], attempts=3, slow_ms=slow_ms)
            errors = [opened["error"]] if at_opening else client.read([0, 50_000])["errors"]
            self.assertLess(time.monotonic() - start, 10)
            self.assertEqual(len(errors), 1)
            self.assertEqual(errors[0]["kind"], kind, errors)
            self.assertIn(problem, errors[0]["message"])
            self.assertEqual(errors[0]["file"], server.url("a.bin"))
            self.assertNotIn("s3cret", json.dumps(errors))
            self.assertEqual([remedy["kind"] for remedy in errors[0]["remedies"]], list(remedies))

    def test_each_ends_in_a_clear_error(self):
        for at_opening in (False, True):
            for fault, kind, problem, *remedies in (
                    ("range_missing", "io", "Content-Range", "serve_ranges"),
                    ("range_damaged", "io", "Content-Range", "serve_ranges"),
                    ("range_shifted", "io", "Content-Range", "serve_ranges"),
                    ("short", "io", "connection broke", "try_later"),
                    ("broken", "io", "connection broke", "try_later"),
                    ("reset", "io", "connection broke", "try_later"),
                    ("garbage", "io", "is no HTTP", "check_url"),
                    ("short_length", "io", "contradicts itself", "serve_ranges"),
                    ("gzip", "io", "encoding", "serve_ranges"),
                    ("silent", "io", "too slow: 0 bytes in 0.3 s (3 tries)", "try_later"),
                    ("slow", "io", "too slow", "try_later"),
                    ("status:401", "io", "401 Unauthorized", "give_credentials", "check_url"),
                    ("status:403", "io", "403 Forbidden (TestFault)", "give_credentials", "check_url"),
                    ("status:404", "not_found", "404 Not Found", "check_url"),
                    ("status:410", "not_found", "410 Gone", "check_url"),
                    ("status:429", "io", "429 Too Many Requests (TestFault) (3 tries)", "try_later"),
                    ("status:500", "io", "500 Internal Server Error", "try_later"),
                    ("status:502", "io", "502 Bad Gateway", "try_later"),
                    ("status:503:60", "io", "asks to wait for 60 s", "try_later"),
                    ("status:504", "io", "504 Gateway Timeout", "try_later"),
                    ("redirect:ftp://127.0.0.1/x?s3cret", "io", "no URL", "check_url"),
                    ("redirect:/a.bin?s3cret", "io", "more than 5 times", "check_url")):
                self.error_of(fault, kind, problem, *remedies, at_opening=at_opening)

    def test_an_object_that_changes_is_an_error_and_nothing_else_is_read(self):
        for fault in ("etag", "size", "status:412", "status:416"):
            self.error_of(fault, "io", "has changed", "open_again")
        with RangeServer(FOLDER, fault_of=from_second("etag", 1)) as server, Client() as client:
            client.open(server.url("a.bin"))
            for _ in range(2):
                self.assertIn("has changed", client.read([0, 1000])["errors"][0]["message"])
            self.assertIn("has changed", client.read([SIZE - 100, 100])["errors"][0]["message"])
            self.assertEqual(server.requests, 2)
            self.assertEqual(client.open(server.url("a.bin"))["size"], SIZE)
            self.assertEqual(client.read([0, 1000])["errors"], [])

    def test_servers_without_strong_etags(self):
        dated = {"Last-Modified": "Mon, 05 Jan 2026 10:00:00 GMT"}
        for validators in (dated, {}, {**dated, "ETag": 'W/"1"'}):
            with self.subTest(validators), RangeServer(FOLDER, validators=lambda *_: validators) as server, \
                    Client() as client:
                for turn in range(2):
                    client.open(server.url("a.bin"), cache=True)
                    answer = client.read([0, 1000], [50_000, 1000])
                    self.assertEqual((answer["errors"], answer["cache_bytes"]),
                                     ([], 2000 if turn and validators else 0))
                self.assertEqual(server.notes[1].get("if-unmodified-since"),
                                 dated["Last-Modified"] if validators == dated else None)
                self.assertNotIn("if-match", server.notes[1])
                if validators:
                    server.validators = lambda *_: {name: value + "x" for name, value in validators.items()}
                    self.assertIn("has changed", client.read([9000, 9])["errors"][0]["message"])

    def test_an_answer_that_does_not_say_what_it_is_of(self):
        self.error_of("no_etag", "io", "no longer says which version", "serve_ranges")

    def test_everything_in_place_of_a_part_is_not_downloaded(self):
        self.error_of("whole", "io", "sends everything", "serve_ranges")
        with RangeServer(FOLDER, fault_of=from_second("whole")) as server, Client() as client:
            client.do("open", url=server.url("large.bin"), file=str(FOLDER / "large.bin"), **QUICK)
            self.assertEqual(len(client.read([0, 1000])["errors"]), 1)
            self.assertEqual(server.requests, 3)
            self.assertLess(server.bytes, 24_000_000)  # of 80 MB: what the system's buffers take
        with RangeServer(FOLDER, knows_ranges=False) as server, Client() as client:
            error = client.do("open", url=server.url("large.bin"), file=str(FOLDER / "a.bin"), **QUICK)["error"]
            self.assertEqual([remedy["kind"] for remedy in error["remedies"]], ["serve_ranges"])
            self.assertIn("does not answer requests for a part", error["message"])
            self.assertLess(server.bytes, 12_000_000)  # of 40 MB: what the system's buffers take
            self.assertEqual(server.requests, 2)

    def test_what_passes_is_asked_for_again(self):
        for fault in ("short", "broken", "reset", "garbage", "silent", "status:500", "status:503:1", "status:429",
                      "whole", "range_missing", "range_shifted", "gzip", "no_etag", "less", "chunked", "long"):
            with self.subTest(fault), RangeServer(FOLDER, fault_of=from_second(fault, 1)) as server, \
                    Client() as client:
                client.open(server.url("a.bin"), slow_ms=500 if fault == "silent" else 3000)
                start = time.monotonic()
                answer = client.read([0, 200_000])
                self.assertEqual(answer["errors"], [])
                # libcurl itself asks once more where a connection that it had kept broke.
                self.assertIn(server.requests - answer["requests"], (0, 1) if fault == "reset" else (0,))
                self.assertEqual(answer["round_trips"], 2)
                if fault == "status:503:1":
                    self.assertGreater(time.monotonic() - start, 1)
                if fault in ("short", "less"):  # what came is not asked for again
                    self.assertLess(server.bytes, TAIL + 200_000 + 64)

    def test_redirects_are_followed_and_remembered_and_get_no_secrets(self):
        with RangeServer(FOLDER) as other:
            place = {"at": other.url("a.bin?token=1")}
            with RangeServer(FOLDER, fault_of=lambda *_: f"redirect:{place['at']}") as server, \
                    Client() as client:
                url = server.url("x.bin?signature=s3cret", "user:s3cret@")
                self.assertEqual(client.open(url, headers=["X-Key: s3cret"])["name"], server.url("x.bin"))
                client.read([0, 1000], [5000, 1000])
                self.assertEqual((server.requests, other.requests), (1, 3))
                self.assertIn("authorization", server.notes[0])
                self.assertEqual(server.notes[0]["x-key"], "s3cret")
                self.assertNotIn("s3cret", json.dumps(other.notes))
                self.assertNotIn("authorization", other.notes[0])
                # What was good for a while only: the first server knows another place.
                other.fault_of = lambda number, path, headers: "status:403" if "token=1" in path else None
                place["at"] = other.url("a.bin?token=2")
                self.assertEqual(client.read([50_000, 1000])["errors"], [])
                self.assertEqual(server.requests, 2)

    def test_https_needs_a_trusted_certificate_and_stays_https(self):
        with RangeServer(FOLDER, tls=TLS) as server, RangeServer(FOLDER) as plain:
            with Client() as client:
                error = client.open(server.url("a.bin"))["error"]
                self.assertIn("certificate is not trusted", error["message"])
                self.assertEqual(error["remedies"][0]["value"], "SSL_CERT_FILE=CERTIFICATES.pem")
            with Client(CURL_CA_BUNDLE=str(FOLDER / "none.pem"), SSL_CERT_FILE=str(TLS[0])) as client:
                error = client.open(server.url("a.bin"))["error"]
                self.assertEqual(error["remedies"][0]["value"], "CURL_CA_BUNDLE=CERTIFICATES.pem")
            for name in ("SSL_CERT_FILE", "CURL_CA_BUNDLE"):
                with Client(**{name: str(TLS[0])}) as client:
                    self.assertEqual(client.open(server.url("a.bin"))["size"], SIZE)
                    self.assertEqual(client.read([0, 100_000], [500_000, 1000])["errors"], [])
            server.fault_of = lambda *_: f"redirect:{plain.url('a.bin')}"
            with Client(SSL_CERT_FILE=str(TLS[0])) as client:
                self.assertIn("from https to http", client.open(server.url("a.bin"))["error"]["message"])
            self.assertEqual(plain.requests, 0)

    def test_nobody_answers(self):
        with socket.socket() as free:
            free.bind(("127.0.0.1", 0))
            port = free.getsockname()[1]
        with Client() as client:
            start = time.monotonic()
            error = client.open(f"http://user:s3cret@127.0.0.1:{port}/a.bin?s3cret")["error"]
            self.assertEqual((error["kind"], error["remedies"][0]["kind"]), ("io", "check_url"))
            self.assertNotIn("s3cret", json.dumps(error))
            error = client.open("http://no-such-host.invalid/a.bin")["error"]
            self.assertEqual((error["kind"], error["remedies"][0]["kind"]), ("io", "check_url"))
            self.assertLess(time.monotonic() - start, 20)


class Credentials(unittest.TestCase):
    def test_passwords_of_the_url_and_of_netrc(self):
        with RangeServer(FOLDER, password=("me", "pass word")) as server:
            with Client() as client:
                self.assertEqual(client.open(server.url("a.bin", "me:pass%20word@"))["size"], SIZE)
                self.assertEqual(client.read([0, 10])["errors"], [])
                self.assertIn("401", client.open(server.url("a.bin"))["error"]["message"])
                self.assertIn("401", client.open(server.url("a.bin", "me:wrong@"))["error"]["message"])
            home = FOLDER / "with_netrc"
            home.mkdir()
            (home / ".netrc").write_text('machine 127.0.0.1 login me password "pass word"\n', encoding="ascii")
            with Client(HOME=str(home)) as client:
                self.assertEqual(client.open(server.url("a.bin"))["size"], SIZE)

    def test_s3_is_signed(self):
        key = "some folder/a+b=ü%41~(1).bin"
        file = FOLDER / "bucket" / key
        file.parent.mkdir(parents=True)
        file.write_bytes((FOLDER / "a.bin").read_bytes())
        for session in ("", "a/session+token=="):
            with RangeServer(FOLDER, keys={"KEY": ("secret/+key", session)}) as server:
                names = {"AWS_ACCESS_KEY_ID": "KEY", "AWS_SECRET_ACCESS_KEY": "secret/+key", "AWS_REGION": "eu-x-1",
                         "AWS_SESSION_TOKEN": session, "AWS_ENDPOINT_URL": server.url("")}
                with Client(**names) as client:
                    answer = client.open(f"s3://bucket/{key}")
                    self.assertEqual(answer.get("name"), f"s3://bucket/{key}", (answer, server.notes))
                    self.assertEqual(client.read([0, 1000], [50_000, 1000], threads=2)["errors"], [])
                    self.assertIn("/eu-x-1/s3/", server.notes[0]["authorization"])
                    server.fault_of = lambda *_: "redirect:http://localhost:1/x"
                    self.assertIn("gets no credentials", client.open(f"s3://bucket/{key}")["error"]["message"])
                    server.fault_of = lambda *_: None
                for wrong in ({"AWS_SECRET_ACCESS_KEY": "another"}, {"AWS_ACCESS_KEY_ID": "another"}):
                    with Client(**{**names, **wrong}) as client:
                        error = client.open(f"s3://bucket/{key}")["error"]
                        self.assertIn("403 Forbidden (SignatureDoesNotMatch)", error["message"])
                        self.assertIn("AWS_ACCESS_KEY_ID", error["remedies"][0]["text"])
                        self.assertNotIn("another", json.dumps(error))
        with RangeServer(FOLDER) as server, Client(AWS_ENDPOINT_URL=server.url("")) as client:
            self.assertEqual(client.open(f"s3://bucket/{key}")["size"], SIZE)
            self.assertNotIn("authorization", server.notes[0])


class RandomFaults(unittest.TestCase):
    """No wrong byte, no hang, no leak."""
    KINDS = ("whole", "range_wrong", "range_shifted", "range_missing", "range_damaged", "size", "short", "short_length",
             "long", "chunked", "broken", "less", "gzip", "no_etag", "etag", "reset", "garbage", "silent", "slow",
             "status:403", "status:404", "status:429", "status:429:1", "status:500", "status:503", "status:503:9",
             "status:504", "status:412", "status:416", "redirect:/a.bin", "redirect:/b.bin", "redirect:nowhere")

    def test_random_faults(self):
        lot, lock, faults = random.Random(1), threading.Lock(), [0]

        def fault_of(_number, _path, headers):
            with lock:
                if lot.random() < 0.3:
                    fault = lot.choice(self.KINDS)
                    # To one who does not know the object, these are good answers with other bytes than the test's.
                    if fault in ("etag", "redirect:/b.bin", "range_wrong") and "If-Match" not in headers:
                        return None
                    faults[0] += 1
                    # Those that take their time are not as many.
                    return fault if fault not in ("silent", "slow", "status:429:1") or lot.random() < 0.1 else "reset"
            return None

        with RangeServer(FOLDER, fault_of=fault_of, silence=0.5) as server, Client() as client:
            options = {**QUICK, "slow_ms": 150, "total_ms": 800, "budget": 1 << 20}
            done, turn = {"read": 0, "failed": {}}, 0
            memory, held = None, None
            while faults[0] < FAULTS:
                client.do("cancel", after_ms=3_600_000)
                client.do("open", url=server.url("a.bin"), file=str(FOLDER / "a.bin"), **options)
                answer = client.do("random", reads=480, threads=4, seed=turn, most=60_000)
                self.assertNotIn("error", answer)
                self.assertEqual(answer["wrong"], 0)
                self.assertLess(answer["longest"], 20)
                done["read"] += answer["read"]
                for text, count in answer["failed"].items():
                    done["failed"][text] = done["failed"].get(text, 0) + count
                turn += 1
                if turn == 2:
                    memory, held = client.memory(), client.held()
            if turn > 2:
                self.assertLessEqual(client.held(), held)
                self.assertTrue(IS_SANITIZED or client.memory() - memory < 8 << 20)
            print(f"{faults[0]} faults in {server.requests} requests: {done['read']} ranges read, "
                  f"{sum(done['failed'].values())} times an error, of {len(done['failed'])} texts", flush=True)
            for text in done["failed"]:
                self.assertTrue(text.startswith(server.url("a.bin") + ": "), text)


with tempfile.TemporaryDirectory() as temporary:
    FOLDER = pathlib.Path(temporary)
    generator = random.Random(7)
    (FOLDER / "a.bin").write_bytes(generator.randbytes(SIZE))
    (FOLDER / "b.bin").write_bytes(generator.randbytes(SIZE))
    (FOLDER / "large.bin").write_bytes(generator.randbytes(1 << 20) * 40)
    (FOLDER / "small.bin").write_bytes(generator.randbytes(100))
    (FOLDER / "empty.bin").touch()
    (FOLDER / "home").mkdir()
    TLS = certificate(FOLDER)
    with Client() as probe:
        if probe.open("http://127.0.0.1:1/").get("error", {}).get("kind") == "unsupported":
            print("skipped: this build has no libcurl")
            sys.exit(77)
    unittest.main(argv=sys.argv[:1], verbosity=2)
