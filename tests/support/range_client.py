"""Controls the program that reads ranges of URLs, line by line, and makes the objects that it reads: for test scripts
that are called with ISONEST, next to which that program is. Importing this module makes a folder of objects, which is
removed at the end.
"""
import atexit
import json
import os
import pathlib
import random
import shutil
import subprocess
import sys
import tempfile

from support.sanitized import is_sanitized

PROGRAM = pathlib.Path(sys.argv[1]).parent / "isonest_fetch_ranges"
FOLDER = pathlib.Path(tempfile.mkdtemp(prefix="isonest-ranges-"))
atexit.register(shutil.rmtree, FOLDER, ignore_errors=True)
SIZE = 3_000_017
TAIL = 65536
QUICK = {"first_wait_ms": 2, "total_ms": 3000, "slow_ms": 3000, "slow_bytes": 100, "connect_ms": 2000}
CLEAN = {name: value for name, value in os.environ.items()
         if not name.startswith(("AWS_", "SSL_CERT", "CURL_")) and not name.lower().endswith("_proxy")}
IS_SANITIZED = is_sanitized(PROGRAM)


class Client:
    """The reading program, as a process."""

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
        """Numbers of open files and threads."""
        process = pathlib.Path("/proc", str(self.process.pid))
        return len(list((process / "fd").iterdir())), len(list((process / "task").iterdir()))

    def memory(self):
        text = pathlib.Path("/proc", str(self.process.pid), "status").read_text(encoding="ascii")
        return int(text.split("VmRSS:")[1].split()[0]) * 1024


def from_second(fault, times=10**9):
    """Opening succeeds; then `times` requests have a fault."""
    return lambda number, path, headers: fault if 2 <= number < 2 + times else None


def make_objects():
    """a.bin and b.bin of SIZE bytes, large.bin of 40 MiB, small.bin, empty.bin, and a home without secrets."""
    generator = random.Random(7)
    (FOLDER / "a.bin").write_bytes(generator.randbytes(SIZE))
    (FOLDER / "b.bin").write_bytes(generator.randbytes(SIZE))
    (FOLDER / "large.bin").write_bytes(generator.randbytes(1 << 20) * 40)
    (FOLDER / "small.bin").write_bytes(generator.randbytes(100))
    (FOLDER / "empty.bin").touch()
    (FOLDER / "home").mkdir()


make_objects()
with Client() as probe:
    if probe.open("http://127.0.0.1:1/").get("error", {}).get("kind") == "unsupported":
        print("skipped: this build has no libcurl")
        sys.exit(77)
