"""Messages between MPI ranks arrive complete; if one rank fails, all end and the message names one of them.

usage: exchange_test.py ISONEST PLUGIN_FOLDER
"""
import pathlib
import sys
import unittest

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1] / "support"))
import ranks


class Exchange(unittest.TestCase):
    def outcome(self, count, *how):
        done = ranks.launched(count, ranks.beside(sys.argv[1], "isonest_mpi_exchange"), *how)
        return done.returncode, done.stdout.decode().splitlines()[:1]

    def test_messages_of_all_sizes_come_once_and_whole(self):
        for count in (1, 2, 3, 7):
            self.assertEqual(self.outcome(count, "ok"), (0, ["all is well"]))

    def test_if_a_rank_fails_while_others_wait_for_it_all_end_and_it_is_named(self):
        for count, which in ((2, 0), (2, 1), (5, 3)):
            self.assertEqual(self.outcome(count, "throw", which), (6, [f"rank {which}: failed at {which}"]))

    def test_if_all_fail_one_is_named(self):
        code, said = self.outcome(4, "throw-all")
        self.assertEqual(code, 6)
        self.assertRegex(said[0], r"rank (\d): failed at \1")

    def test_a_rank_that_works_without_messages_learns_that_others_have_failed(self):
        for which in (0, 2):
            code, said = self.outcome(3, "wait", which)
            self.assertEqual(code, 6)
            self.assertRegex(said[0], r"rank (\d): failed at \1")


if __name__ == "__main__":
    ranks.require(sys.argv[1])
    unittest.main(argv=sys.argv[:1])
