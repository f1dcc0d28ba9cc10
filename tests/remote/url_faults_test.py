"""Faults of a server of ranges: each gives a clear error or a retry, and no byte is ever wrong.

usage: url_faults_test.py ISONEST PLUGIN_FOLDER [FAULTS]   (number of random ones; also as ISONEST_FAULTS)
"""
import json
import os
import pathlib
import random
import socket
import sys
import threading
import time
import unittest

sys.path.insert(0, str(pathlib.Path(__file__).parents[1]))
from support.range_client import FOLDER, IS_SANITIZED, QUICK, SIZE, TAIL, Client, from_second  # noqa: E402
from support.range_server import RangeServer  # noqa: E402

FAULTS = int(sys.argv[3] if len(sys.argv) > 3 else os.environ.get("ISONEST_FAULTS", "600"))


class Faults(unittest.TestCase):
    def error_of(self, fault, kind, problem, *remedies, at_opening=False):
        """Checks that a server with this fault gives this error in time, without any secret in it."""
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
                    ("half_head", "io", "connection broke: the answer ended within its headers", "try_later"),
                    ("large_head", "io", "the headers of the server's answer are too large", "check_url"),
                    ("long_line", "io", "the headers of the server's answer are too large", "check_url"),
                    ("garbage", "io", "is not HTTP", "check_url"),
                    ("short_length", "io", "contradict each other", "serve_ranges"),
                    ("chunked_length", "io", "Content-Length and Transfer-Encoding contradict each other", "serve_ranges"),
                    ("gzip", "io", "Encoding", "serve_ranges"),
                    ("silent", "io", "too slow: 0 bytes in 0.3 s (3 tries)", "try_later"),
                    ("slow", "io", "too slow", "try_later"),
                    ("status:401", "io", "401 Unauthorized", "give_credentials", "check_url"),
                    ("status:403", "io", "403 Forbidden (TestFault)", "give_credentials", "check_url"),
                    ("status:404", "not_found", "404 Not Found", "check_url"),
                    ("status:410", "not_found", "410 Gone", "check_url"),
                    ("status:429", "io", "429 Too Many Requests (TestFault) (3 tries)", "try_later"),
                    ("status:500", "io", "500 Internal Server Error", "try_later"),
                    ("status:502", "io", "502 Bad Gateway", "try_later"),
                    ("status:503:60", "io", "asks clients to wait 60 s", "try_later"),
                    ("status:504", "io", "504 Gateway Timeout", "try_later"),
                    ("redirect:ftp://127.0.0.1/x?s3cret", "io", "invalid URL", "check_url"),
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
        self.error_of("no_etag", "io", "no longer sends an ETag", "serve_ranges")

    def test_everything_in_place_of_a_part_is_not_downloaded(self):
        self.error_of("whole", "io", "sent the whole object", "serve_ranges")
        with RangeServer(FOLDER, fault_of=from_second("whole")) as server, Client() as client:
            client.do("open", url=server.url("large.bin"), file=str(FOLDER / "large.bin"), **QUICK)
            self.assertEqual(len(client.read([0, 1000])["errors"]), 1)
            self.assertEqual(server.requests, 3)
            self.assertLess(server.bytes, 24_000_000)  # of 80 MB: the amount that fits into the system's buffers
        with RangeServer(FOLDER, knows_ranges=False) as server, Client() as client:
            error = client.do("open", url=server.url("large.bin"), file=str(FOLDER / "a.bin"), **QUICK)["error"]
            self.assertEqual([remedy["kind"] for remedy in error["remedies"]], ["serve_ranges"])
            self.assertIn("does not support range requests", error["message"])
            self.assertLess(server.bytes, 12_000_000)  # of 40 MB: the amount that fits into the system's buffers
            self.assertEqual(server.requests, 2)

    def test_what_passes_is_asked_for_again(self):
        for fault in ("short", "broken", "reset", "half_head", "large_head", "long_line", "garbage", "silent", "status:500",
                      "status:503:1", "status:429", "whole", "range_missing", "range_shifted", "gzip", "no_etag", "less", "chunked", "chunked_length",
                      "long"):
            with self.subTest(fault), RangeServer(FOLDER, fault_of=from_second(fault, 1)) as server, \
                    Client() as client:
                client.open(server.url("a.bin"), slow_ms=500 if fault == "silent" else 3000)
                start = time.monotonic()
                answer = client.read([0, 200_000])
                self.assertEqual(answer["errors"], [])
                # libcurl itself retries once if a kept connection broke.
                self.assertIn(server.requests - answer["requests"], (0, 1) if fault == "reset" else (0,))
                self.assertEqual(answer["round_trips"], 2)
                if fault == "status:503:1":
                    self.assertGreater(time.monotonic() - start, 1)
                if fault in ("short", "less"):  # received bytes are not requested again
                    self.assertLess(server.bytes, TAIL + 200_000 + 64)

    def test_after_chunks_that_are_none_no_rest_is_asked_for(self):
        """The bytes that libcurl takes for the first chunk are not those of the object."""
        with RangeServer(FOLDER, fault_of=from_second("no_chunks", 1)) as server, Client() as client:
            client.open(server.url("a.bin"))
            errors = client.read([0, 50_000])["errors"]
            self.assertEqual([error["kind"] for error in errors], ["io"])
            self.assertIn("the connection broke", errors[0]["message"])
            self.assertEqual(server.requests, 2)
            self.assertEqual(client.read([100_000, 1000])["errors"], [])

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
                # The redirect target has expired: the first server redirects to another one.
                other.fault_of = lambda number, path, headers: "status:403" if "token=1" in path else None
                place["at"] = other.url("a.bin?token=2")
                self.assertEqual(client.read([50_000, 1000])["errors"], [])
                self.assertEqual(server.requests, 2)

    def test_a_server_to_which_a_redirect_led_goes_away_while_it_is_read(self):
        place = {}
        with RangeServer(FOLDER, fault_of=lambda *_: f"redirect:{place['at']}") as server, Client() as client:
            with RangeServer(FOLDER) as first:
                place["at"] = first.url("a.bin?signature=s3cret")
                client.open(server.url("a.bin"), attempts=3)
                self.assertEqual(client.read([0, 1000], [50_000, 1000])["errors"], [])
                self.assertEqual((server.requests, first.requests), (1, 3))
                first.fault_of = lambda *_: "reset"  # on connections that outlive the server
            # There is no server, and the URL still redirects there.
            start = time.monotonic()
            answer = client.read([100_000, 1000], [300_000, 1000], threads=2)
            self.assertLess(time.monotonic() - start, 10)
            # One thread may have found a broken connection and another one none, with different messages.
            self.assertEqual({(error["kind"], error["file"]) for error in answer["errors"]}, {("io", server.url("a.bin"))})
            self.assertNotIn("s3cret", json.dumps(answer))
            # The URL redirects to another place: the remaining bytes of the same version are read there.
            asked = server.requests
            with RangeServer(FOLDER) as second:
                place["at"] = second.url("a.bin")
                answer = client.read([0, 1000], [100_000, 1000], [500_000, 1000], [900_000, 1000], threads=2)
                self.assertEqual(answer["errors"], [])
                self.assertLessEqual(server.requests - asked, 3)
                self.assertLessEqual(second.requests, 4)
                # A place with another object is not accepted.
                os.utime(FOLDER / "b.bin", (1, 1))
                second.fault_of = lambda number, path, headers: "redirect:/b.bin" if path.startswith("/a.bin") else None
                error = client.read([1_200_000, 1000])["errors"][0]
                self.assertIn("has changed", error["message"])

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


class RandomFaults(unittest.TestCase):
    """No wrong byte, no hang, no leak."""
    KINDS = ("whole", "range_wrong", "range_shifted", "range_missing", "range_damaged", "size", "short", "short_length",
             "long", "chunked", "chunked_length", "broken", "less", "gzip", "no_etag", "etag", "reset", "half_head", "garbage", "silent", "slow",
             "status:403", "status:404", "status:429", "status:429:1", "status:500", "status:503", "status:503:9",
             "status:504", "status:412", "status:416", "redirect:/a.bin", "redirect:/b.bin", "redirect:nowhere")

    def test_random_faults(self):
        lot, lock, faults = random.Random(1), threading.Lock(), [0]

        def fault_of(_number, _path, headers):
            with lock:
                if lot.random() < 0.3:
                    fault = lot.choice(self.KINDS)
                    # For a client that does not know the object yet, these are valid answers, with other bytes than the
                    # test expects.
                    if fault in ("etag", "redirect:/b.bin", "range_wrong") and "If-Match" not in headers:
                        return None
                    faults[0] += 1
                    # Slow faults are less frequent.
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


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1], verbosity=2)
