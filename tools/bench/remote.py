"""A query of a store behind a network with a delay and a rate: seconds, bytes, requests and round trips, without and
with a disk cache, compared with the same query of the file.

usage: remote.py ISONEST STORE --iso V [--error-relative R] [--delay MS] [--rate MBIT/S] [--runs N]
       remote.py ISONEST STORE --view [--iso V] [--delay MS] [--rate MBIT/S] [--runs N]
The server is tests/support/range_server.py on this machine: the delay comes before each answer and once more for each
new connection, and all connections share the rate. Runs take turns (cold, warm, local); all figures are medians, the
seconds those of whole processes. The file is in the page cache.

--view measures what `isonest view` of the URL has fetched when it has answered the page's requests for its first picture:
the store, the coarse histogram, and the surface at the isovalue that it suggests (or at V). Seconds include the start.
"""
import argparse
import hashlib
import json
import pathlib
import signal
import statistics
import struct
import subprocess
import sys
import tempfile
import time
import urllib.request

SERVER = pathlib.Path(__file__).resolve().parents[2] / "tests" / "support" / "range_server.py"
parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
parser.add_argument("isonest", type=pathlib.Path)
parser.add_argument("store", type=pathlib.Path)
parser.add_argument("--iso")
parser.add_argument("--view", action="store_true")
parser.add_argument("--error-relative", default="0.05")
parser.add_argument("--delay", type=float, default=50)
parser.add_argument("--rate", type=float, default=50)
parser.add_argument("--runs", type=int, default=5)
options = parser.parse_args()
if not options.view and options.iso is None:
    parser.error("--iso V is missing")



def first_picture(url):
    """Seconds, header of the mesh, and what was fetched."""
    browser = urllib.request.build_opener(urllib.request.ProxyHandler({}))
    start = time.monotonic()
    with subprocess.Popen([options.isonest, "view", url, "--port", "0", "--json"], stdout=subprocess.PIPE, text=True) as view:
        try:
            page = json.loads(view.stdout.readline())["url"]

            def ask(what):
                with browser.open(f"{page}api/{what}") as answer:
                    return answer.read()

            store, histogram = json.loads(ask("store")), json.loads(ask("histogram?coarse=1"))
            iso = options.iso or histogram["suggested"][0]["isovalue"]
            mesh = ask(f"surface?iso={iso}&error={store['first_error']}&limit=100000")
            seconds = time.monotonic() - start
            header = json.loads(mesh[16:16 + struct.unpack_from("<I", mesh, 8)[0]])
            return seconds, {**header, "iso": iso}, json.loads(ask("status"))["remote"]
        finally:
            view.send_signal(signal.SIGINT)


if options.view:
    with subprocess.Popen([sys.executable, SERVER, options.store.resolve().parent, "--delay", str(options.delay), "--rate",
                           str(options.rate)], stdout=subprocess.PIPE, text=True) as server:
        try:
            url = server.stdout.readline().strip() + options.store.name
            runs = [first_picture(url) for _ in range(options.runs)]
        finally:
            server.terminate()
    _, header, _ = runs[0]
    print(f"isovalue {header['iso']}: {header['triangles']} triangles within {header['error_bound']}")
    print("| seconds | fetched, MB | requests | round trips |\n|---|---|---|---|")
    print(f"| {statistics.median(seconds for seconds, _, _ in runs):.2f} | " + " | ".join(
        str(statistics.median_high(fetched[name] for _, _, fetched in runs) / unit)
        for name, unit in (("remote_bytes", 1e6), ("requests", 1), ("round_trips", 1))) + " |")
    sys.exit()

with tempfile.TemporaryDirectory(prefix="isonest-bench-") as name:
    here = pathlib.Path(name)
    server = subprocess.Popen([sys.executable, SERVER, options.store.resolve().parent, "--delay", str(options.delay),
                               "--rate", str(options.rate)], stdout=subprocess.PIPE, text=True)
    url = server.stdout.readline().strip() + options.store.name

    def run(location, *more):
        mesh = here / "mesh.ply"
        start = time.monotonic()
        done = subprocess.run([options.isonest, "extract", location, "--iso", options.iso, "--error-relative",
                               options.error_relative, "--effort", "none", "-o", mesh, "--json", *more], stdout=subprocess.PIPE, check=True)
        seconds = time.monotonic() - start
        return seconds, json.loads(done.stdout), hashlib.sha256(mesh.read_bytes()).hexdigest()

    try:
        run(options.store)
        rows = {"cold": [], "cold, cache": [], "warm cache": [], "file": []}
        for i in range(options.runs):
            rows["cold"].append(run(url))
            rows["cold, cache"].append(run(url, "--cache", here / f"cache{i}"))
            rows["warm cache"].append(run(url, "--cache", here / f"cache{i}"))
            rows["file"].append(run(options.store))
    finally:
        server.terminate()
        server.wait()

if len({digest for runs in rows.values() for _, _, digest in runs}) != 1:
    sys.exit("the meshes differ")
report = rows["file"][0][1]
print(f"{report['triangles']} triangles; {report['chunks_read']} chunks of {report['bytes_read'] / 1e6:.3f} MB")
print("| | seconds | fetched, MB | requests | round trips | from the cache, MB |\n|---|---|---|---|---|---|")
for row, runs in rows.items():
    seconds = statistics.median(seconds for seconds, _, _ in runs)
    fetched = {name: statistics.median_high(said.get("remote", {}).get(name, 0) for _, said, _ in runs)
               for name in ("remote_bytes", "requests", "round_trips", "cache_bytes")}
    print(f"| {row} | {seconds:.3f} | {fetched['remote_bytes'] / 1e6:.3f} | {fetched['requests']} | "
          f"{fetched['round_trips']} | {fetched['cache_bytes'] / 1e6:.3f} |")
