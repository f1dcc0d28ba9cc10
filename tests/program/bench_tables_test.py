"""tools/bench/run --update replaces the tables of RESULTS.md with the output of their commands, and nothing else.

usage: bench_tables_test.py ISONEST PLUGIN_FOLDER
"""
import contextlib
import io
import os
import pathlib
import sys
import tempfile
import unittest

ROOT = pathlib.Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "tools/bench"))
import tables  # noqa: E402

TEXT = """# Figures

Before.

<!-- table one: echo "| $BUILD |" -->
Measured: isonest 0.0.1 (commit 0123abcd), 2000-01-01, a machine.

| old |
<!-- end -->
Between \\1.

<!-- table two: echo "| $DATA |"; exit "${CODE:-0}" -->
<!-- end -->
After.
"""


class Tables(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.addCleanup(setattr, tables, "RESULTS", tables.RESULTS)
        self.addCleanup(os.environ.pop, "CODE", None)
        self.path = tables.RESULTS = pathlib.Path(folder.name, "RESULTS.md")
        self.path.write_text(TEXT)

    def update(self, *names, data=None):
        """The exit code or message."""
        with contextlib.redirect_stderr(io.StringIO()), self.assertRaises(SystemExit) as ended:
            tables.update(list(names), pathlib.Path("/build"), data, pathlib.Path("/work"))
        return ended.exception.code

    def test_a_named_table_is_replaced(self):
        self.assertEqual(self.update("one"), 0)
        text = self.path.read_text()
        (_, _, body), (_, _, other) = tables.BLOCK.findall(text)
        self.assertEqual(tables.MEASURED.search(body).group(1), tables.version())
        self.assertTrue(body.endswith("\n\n| /build |\n"))
        self.assertEqual(other, "")
        self.assertEqual(tables.BLOCK.sub("", text), tables.BLOCK.sub("", TEXT))
        self.assertEqual(self.update("one"), 0)
        self.assertEqual(self.path.read_text(), text)

    def test_all_tables_are_replaced_and_what_is_missing_is_said(self):
        self.assertIn("two: give --data FOLDER", self.update())
        self.assertEqual(self.update(data="/data"), 0)
        self.assertEqual([body.splitlines()[-1] for _, _, body in tables.BLOCK.findall(self.path.read_text())],
                         ["| /build |", "| /data |"])

    def test_a_command_that_fails_leaves_its_table(self):
        os.environ["CODE"] = "3"
        self.assertIn("two: exit code 3", self.update("two", data="/data"))
        self.assertEqual(self.path.read_text(), TEXT)

    def test_an_unknown_name_is_refused(self):
        self.assertIn("RESULTS.md has no table three; it has one, two", self.update("three"))


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1])
