"""Ranges of remote objects: the right bytes with few requests, in bounded memory.

usage: url_bytes_test.py ISONEST PLUGIN_FOLDER
"""
import os
import pathlib
import sys
import time
import unittest

sys.path.insert(0, str(pathlib.Path(__file__).parents[1]))
from support.range_client import FOLDER, IS_SANITIZED, QUICK, SIZE, TAIL, Client, from_second  # noqa: E402
from support.range_server import RangeServer  # noqa: E402


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
            # Now it is in memory.
            self.assertEqual(client.read(*ranges, threads=4)["requests"], answer["requests"])
            # As far as can be known, each of these depends on the previous one.
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
            self.assertLess(answer["round_trips"], 60)  # rather than one for each of the 400
            self.assertLess(server.bytes, 1.25 * 400 * 40_000 + TAIL)
            self.assertTrue(IS_SANITIZED or client.memory() - before < 32 << 20)  # 23 with Debian 13's libcurl alone
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

    def test_what_a_cache_has_no_memory_for_comes_from_the_server(self):
        ranges = [[i * 20_000, 10_000] for i in range(40)]
        with RangeServer(FOLDER) as server, Client() as client:
            client.open(server.url("a.bin"), cache=True)
            client.read(*ranges)
            client.open(server.url("a.bin"), cache=True, cache_memory=False)
            for turn in range(2):
                client.do("want", ranges=ranges[:20])
                answer = client.read(*ranges, threads=4)
                self.assertEqual((answer["errors"], answer["cache_bytes"]), ([], 0))
                self.assertGreater(answer["requests"], 1)
            client.open(server.url("a.bin"), cache=True)
            answer = client.read(*ranges, threads=4)
            self.assertEqual((answer["errors"], answer["cache_bytes"], answer["requests"]), ([], 400_000, 1))

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
            os.utime(FOLDER / "a.bin", (1e9, 1e9))  # another ETag: the cache is not used
            self.assertEqual(opened(), (2, TAIL, 2, 0))
            self.assertEqual(opened(), (1, 64, 1, TAIL - 64))
            # Wrong content: other bytes under the same ETag.
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
            for _ in range(2):  # the cache is searched while other ranges are read
                client.open(server.url("a.bin"), cache=True, keep_ms=300, load_ms=0)
                client.do("want", ranges=ranges)
                start = time.monotonic()
                answer = client.read(*ranges, threads=2)
                self.assertEqual(answer["errors"], [])
                self.assertLess(time.monotonic() - start, 5)  # keeping them all takes 7.5 s
                start = time.monotonic()
                client.do("close")  # waits until they are kept
                kept = time.monotonic() - start
            self.assertLess(kept, 5)
            self.assertEqual((answer["requests"], answer["cache_bytes"]), (1, 25 * 20_000))

    def test_what_does_not_fit_into_the_queue_is_not_kept_and_not_waited_for(self):
        ranges = [[i * 100_000, 90_000] for i in range(25)]
        with RangeServer(FOLDER) as server, Client() as client:
            client.open(server.url("a.bin"), cache=True, keep_ms=1000, budget=1 << 20)
            start = time.monotonic()
            self.assertEqual(client.read(*ranges)["errors"], [])
            self.assertLess(time.monotonic() - start, 10)  # keeping them all takes 25 s
            client.open(server.url("a.bin"), cache=True)
            answer = client.read(*ranges)
            self.assertGreater(answer["cache_bytes"], 0)
            self.assertLess(answer["cache_bytes"], 25 * 90_000 // 2)

    def test_after_ctrl_c_the_cache_is_not_waited_for(self):
        with RangeServer(FOLDER, fault_of=lambda number, *_: "silent" if number > 21 else None) as server, Client() as client:
            client.open(server.url("a.bin"), cache=True, keep_ms=1000)
            client.read(*([i * 100_000, 9_000] for i in range(20)))  # takes 20 s to keep
            client.do("cancel", after_ms=0)
            start = time.monotonic()
            self.assertEqual(client.read([50_000, 1000])["errors"][0]["kind"], "cancelled")
            client.do("close")
            self.assertLess(time.monotonic() - start, 8)

    def test_ctrl_c_while_the_end_waits_for_the_cache(self):
        with RangeServer(FOLDER) as server, Client() as client:
            client.open(server.url("a.bin"), cache=True, keep_ms=1000)
            client.read(*([i * 100_000, 9_000] for i in range(20)))  # takes 20 s to keep
            client.do("cancel", after_ms=500)
            start = time.monotonic()
            client.do("close")
            self.assertLess(time.monotonic() - start, 8)

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


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1], verbosity=2)
