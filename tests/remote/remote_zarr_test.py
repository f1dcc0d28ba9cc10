"""Zarr at URLs: the store has the same bytes as from a folder, each chunk is requested once, only the required ones
are, and failures give a clear error or a retry.

usage: remote_zarr_test.py ISONEST PLUGIN_FOLDER
"""
import collections
import json
import os
import pathlib
import re
import shutil
import sys
import tempfile
import time
import unittest

sys.path.insert(0, str(pathlib.Path(__file__).parents[1]))
sys.path.insert(0, str(pathlib.Path(__file__).parents[1] / "support"))
import served  # noqa: E402
from support.interrupted import interrupted  # noqa: E402
from support.range_server import RangeServer  # noqa: E402

try:
    import numcodecs
    import numpy as np
    from zarr_two import zarr
    from zarr_writer import V3
except ImportError as error:
    print(f"skipped: {error}")
    sys.exit(77)

ISONEST = pathlib.Path(sys.argv[1]).resolve()
FOLDER = pathlib.Path(tempfile.mkdtemp(prefix="isonest-remote-zarr-", dir=served.MEMORY))
ENVIRONMENT = {name: value for name, value in os.environ.items()
               if not name.startswith(("AWS_", "SSL_CERT", "CURL_")) and not name.lower().endswith("_proxy")}
ENVIRONMENT["HOME"] = str(FOLDER)
SECRET = "s3cret"
RANDOM = np.random.default_rng(11)
DESCRIPTIONS = ("zarr.json", ".zarray", ".zattrs", ".zgroup", ".zmetadata")


def run(*arguments, **environment):
    return served.run([ISONEST, *map(str, arguments)], cwd=FOLDER, env={**ENVIRONMENT, **environment},
                      capture_output=True, text=True, timeout=200)


def preprocess(place, store, *options, **environment):
    chunk = [] if "--chunk" in options else ["--chunk", "8"]
    return run("preprocess", place, "-o", store, *chunk, "--force", *options, **environment)


_missing = run("info", "http://127.0.0.1:1/x", "--json")
if _missing.returncode == 5:
    print("skipped: this build reads no URLs")
    sys.exit(77)


def smooth(shape, kind="u2"):
    at = np.indices(shape)
    return (sum(np.sin(a / 5) for a in at) * 500 + 2000 + RANDOM.integers(0, 9, shape)).astype(kind)


def asked(server):
    """Requests except those for metadata: {(path, range): number of requests}."""
    return collections.Counter((note["path"].partition("?")[0], note.get("range"))
                               for note in server.notes if "path" in note and
                               not note["path"].partition("?")[0].endswith(DESCRIPTIONS))


def until_it_is_quiet(server):
    """Waits for requests of a finished run that are still on their way."""
    before = -1
    while before != server.requests:
        before = server.requests
        time.sleep(0.3)


class Case(unittest.TestCase):
    def setUp(self):
        self.path = FOLDER / "v.zarr"
        shutil.rmtree(self.path, ignore_errors=True)

    def tearDown(self):
        for path in FOLDER.glob("*.isonest*"):
            path.unlink()

    def same(self, *options, name="v.zarr", server_options=None, little_memory=False):
        """Checks that both stores have the same bytes; returns the requests. With little memory, indices of shards may
        be requested again."""
        local = preprocess(FOLDER / name, "local.isonest", *options)
        self.assertEqual(local.returncode, 0, local.stderr)
        with RangeServer(FOLDER, **(server_options or {})) as server:
            remote = preprocess(server.url(name), "remote.isonest", *options)
            self.assertEqual(remote.returncode, 0, remote.stderr)
            self.assertEqual((FOLDER / "remote.isonest").read_bytes(), (FOLDER / "local.isonest").read_bytes())
            counts = asked(server)
            self.assertEqual([key for key, count in counts.items()
                              if count > (2 if little_memory and (key[1] or "").startswith("bytes=-") else 1)], [])
            return counts

    def failed(self, code, words, url, *options, **environment):
        done = preprocess(url, "out.isonest", "--json", *options, **environment)
        self.assertEqual(done.returncode, code, done.stdout + done.stderr)
        self.assertNotIn(SECRET, done.stdout + done.stderr)
        error = json.loads(done.stdout)["error"]
        for word in words if isinstance(words, (list, tuple)) else [words]:
            self.assertIn(word, error["message"])
        self.assertFalse((FOLDER / "out.isonest").exists())
        return error


class SameBytes(Case):
    def chunks_of(self, suffix=""):
        return {"/" + str(path.relative_to(FOLDER)) for path in self.path.rglob("*")
                if path.is_file() and path.name not in DESCRIPTIONS}

    def test_version_2(self):
        for order, ends, separator, compressor in (("C", "<", ".", None), ("F", ">", "/", numcodecs.Blosc("lz4")),
                                                   ("C", ">", "/", numcodecs.Zstd(3)), ("F", "<", ".", numcodecs.GZip(3)),
                                                   ("C", "<", "/", numcodecs.Zlib(3))):
            with self.subTest(order=order, ends=ends, separator=separator, compressor=compressor):
                shutil.rmtree(self.path, ignore_errors=True)
                data = smooth((29, 33, 41), np.dtype("i2").newbyteorder(ends))
                a = zarr.open(str(self.path), mode="w", shape=data.shape, chunks=(9, 12, 10), order=order, fill_value=-5,
                              dtype=data.dtype, dimension_separator=separator, compressor=compressor)
                a[9:, :24] = data[9:, :24]  # the others have no file
                counts = self.same()
                stored = self.chunks_of()
                self.assertLess(len(stored), 4 * 3 * 5)
                self.assertEqual(len(counts), 4 * 3 * 5)  # missing ones are requested, too
                self.assertLessEqual(stored, {path for path, _ in counts})

    def test_version_3_and_shards(self):
        data = smooth((29, 33, 41), "f4")
        data[:16, :16] = 0
        for options in ({}, {"codecs": ("zstd", "crc32c")}, {"codecs": ("blosc",), "big": True},
                        {"codecs": ("gzip",), "separator": "."}, {"order": (2, 0, 1)},
                        {"shards": (16, 16, 24)}, {"shards": (16, 16, 24), "index_at": "start", "codecs": ("zstd",)},
                        {"shards": (16, 32, 48), "index_checksum": False, "codecs": ("blosc", "crc32c")},
                        {"shards": (8, 16, 24), "order": (2, 1, 0), "big": True}):
            with self.subTest(options=options):
                shutil.rmtree(self.path, ignore_errors=True)
                V3(self.path, data, (8, 8, 8), **options)
                counts = self.same()
                if "shards" in options:
                    # No byte is fetched twice, and an index is one request.
                    for path in self.chunks_of():
                        size = (FOLDER / path[1:]).stat().st_size
                        taken = np.zeros(size, int)
                        for (of, text), _ in counts.items():
                            first, last = re.fullmatch(r"bytes=(\d*)-(\d*)", text).groups()
                            if of == path:
                                taken[slice(-int(last), None) if not first else slice(int(first), int(last) + 1)] += 1
                        self.assertLessEqual(taken.max(), 1)
                else:
                    self.assertLessEqual(self.chunks_of(), {path for path, _ in counts})

    def ome(self, version, consolidated=False):
        data = smooth((2, 3, 17, 18, 19))
        self.path.mkdir()
        axes = [{"name": n, "type": {"t": "time", "c": "channel"}.get(n, "space"),
                 **({"unit": "micrometer"} if n in "zyx" else {})} for n in "tczyx"]
        image = {"version": version, "axes": axes, "datasets": [
            {"path": path, "coordinateTransformations": [{"type": "scale", "scale": [1, 1, 2 * f, f / 2, f / 4]}]}
            for path, f in (("0", 1), ("1", 2))]}
        colors = {"colors": [{"label-value": 2001, "rgba": [255, 0, 10, 255]}],
                  "properties": [{"label-value": 2002, "name": "cell"}]}
        for path in (self.path, self.path / "labels/nuclei"):
            path.mkdir(parents=True, exist_ok=True)
            for level, values in (("0", data), ("1", np.ascontiguousarray(data[..., ::2, ::2, ::2]))):
                if version == "0.5":
                    V3(path / level, values, (1, 1, 8, 8, 8), codecs=("zstd",),
                       shards=(1, 1, 16, 16, 16) if level == "0" else None)
                else:
                    zarr.save_array(str(path / level), values, chunks=(1, 1, 8, 8, 8), dimension_separator="/")
            words = {"multiscales": [image], **({"image-label": colors} if path != self.path else {})}
            if version == "0.5":
                (path / "zarr.json").write_text(json.dumps(
                    {"zarr_format": 3, "node_type": "group", "attributes": {"ome": {"version": version, **words}}}))
            else:
                (path / ".zgroup").write_text('{"zarr_format": 2}')
                (path / ".zattrs").write_text(json.dumps(words))
        if version == "0.5":
            (self.path / "labels/zarr.json").write_text(json.dumps(
                {"zarr_format": 3, "node_type": "group", "attributes": {"ome": {"version": version, "labels": ["nuclei"]}}}))
        else:
            (self.path / "labels/.zgroup").write_text('{"zarr_format": 2}')
            (self.path / "labels/.zattrs").write_text('{"labels": ["nuclei"]}')
            if consolidated:
                zarr.consolidate_metadata(str(self.path))

    def test_ome_images_their_levels_and_labels(self):
        for version, consolidated in (("0.4", False), ("0.4", True), ("0.5", False)):
            with self.subTest(version=version, consolidated=consolidated):
                shutil.rmtree(self.path, ignore_errors=True)
                self.ome(version, consolidated)
                with RangeServer(FOLDER) as server:
                    self.failed(5, ("axis 't'", "t 2, c 3, z 17"), server.url("v.zarr"))
                    error = self.failed(3, "there is no array 7", server.url("v.zarr"), "--dataset", "7")
                    self.assertEqual(error["file"], server.url("v.zarr"))
                    self.failed(3, "there is no array ../x", server.url("v.zarr"), "--dataset", "../x")
                self.same("--index", "t=1,c=2")
                self.same("--index", "t=0,c=1", "--dataset", "1")
                self.same("--index", "t=0,c=1", "--dataset", "labels/nuclei", "--labels")
                self.same("--index", "t=0,c=1", "--labels", name="v.zarr/labels/")
                labels = json.loads(run("info", "remote.isonest", "--json").stdout)
                self.assertEqual(labels["unit"], "um")

    def test_groups_and_what_is_consolidated(self):
        data = smooth((17, 18, 19))
        group = zarr.open_group(str(self.path), mode="w")
        group.create_dataset("a/volume", data=data, chunks=(8, 8, 8))
        group.create_dataset("b", data=data[0], chunks=(8, 8))
        with RangeServer(FOLDER) as server:
            error = self.failed(2, "cannot be listed", server.url("v.zarr"))
            self.assertEqual(error["remedies"][0]["kind"], "choose_dataset")
        self.same("--dataset", "a/volume")
        self.same("--dataset", "b")
        zarr.consolidate_metadata(str(self.path))
        self.same()
        self.same("--dataset", "/a/volume/")
        group.create_dataset("c", data=data[None], chunks=(1, 8, 8, 8))
        zarr.consolidate_metadata(str(self.path))
        with RangeServer(FOLDER) as server:
            self.failed(3, ("there is no array d", "\n  a/volume", "\n  b", "\n  c"), server.url("v.zarr"), "--dataset", "d")
        # The metadata of the array itself count, not an old copy of them.
        zarr.open(str(self.path / "c"), mode="a").resize((1, 13, 18, 19))
        self.same("--dataset", "c")

    def test_consolidated_metadata_of_version_3(self):
        data = smooth((17, 18, 19))
        members = {}
        for name, values in (("image", data), ("b/plane", data[0])):
            V3(self.path / name, values, (8,) * values.ndim, codecs=("zstd",))
            members[name] = json.loads((self.path / name / "zarr.json").read_text())
        members["b"] = {"zarr_format": 3, "node_type": "group", "attributes": {}}
        (self.path / "b/zarr.json").write_text(json.dumps(members["b"]))
        root = {"zarr_format": 3, "node_type": "group", "attributes": {}}
        (self.path / "zarr.json").write_text(json.dumps(root))
        with RangeServer(FOLDER) as server:
            self.failed(2, "cannot be listed", server.url("v.zarr"))
        (self.path / "zarr.json").write_text(json.dumps({**root, "consolidated_metadata": {
            "kind": "inline", "must_understand": False, "metadata": members}}))
        self.same()
        self.same("--dataset", "b/plane")

    def test_bioformats2raw(self):
        self.ome("0.4")
        outer = FOLDER / "outer.zarr"
        shutil.rmtree(outer, ignore_errors=True)
        shutil.copytree(self.path, outer / "0")
        (outer / ".zgroup").write_text('{"zarr_format": 2}')
        (outer / ".zattrs").write_text('{"bioformats2raw.layout": 3}')
        self.same("--index", "t=1,c=2", name="outer.zarr")
        (outer / "0").rename(outer / "first")
        (outer / "OME").mkdir()
        (outer / "OME/.zgroup").write_text('{"zarr_format": 2}')
        (outer / "OME/.zattrs").write_text('{"series": ["first"]}')
        self.same("--index", "t=1,c=2", name="outer.zarr")
        shutil.rmtree(outer)

    def test_coordinates_beside_the_volume(self):
        group = zarr.open_group(str(self.path), mode="w")
        group.create_dataset("t", data=smooth((9, 10, 11)), chunks=(4, 4, 4), fill_value=None).attrs["_ARRAY_DIMENSIONS"] = ["z", "y", "x"]
        for name, at in (("z", np.arange(9)[::-1] * 2 + 1), ("y", np.arange(10) / 4), ("x", np.arange(11) - 7)):
            a = group.create_dataset(name, data=at.astype("f8"), fill_value=None)
            a.attrs["_ARRAY_DIMENSIONS"], a.attrs["units"] = [name], "mm"
        self.same("--dataset", "t")
        info = json.loads(run("info", "remote.isonest", "--json").stdout)
        self.assertEqual((info["origin"], info["spacing"], info["unit"]), ([-7, 0, 1], [1, 0.25, 2], "mm"))
        zarr.consolidate_metadata(str(self.path))
        self.same("--crop", "2:5,:,1:4")

    def test_a_crop_fetches_the_chunks_that_it_needs(self):
        data = smooth((40, 48, 56))
        for options in ({}, {"shards": (16, 16, 16)}):
            shutil.rmtree(self.path, ignore_errors=True)
            V3(self.path, data, (8, 8, 8), **options)
            for crop, every, chunks in (("9:15,17:30,0:8", "1", 1 * 2 * 1), (":,:,-8:", "1", 7 * 6 * 1),
                                        ("20:,10:12,7:9", "2", 5 * 1 * 1), ("8:48,:,:", "16", 3 * 3 * 3)):
                with self.subTest(options=options, crop=crop, every=every):
                    counts = self.same(f"--crop={crop}", "--every", every)
                    if not options:
                        self.assertEqual(len(counts), chunks)
                    else:
                        fetched = sum(int(b) - int(a) + 1 for (_, text), _ in counts.items()
                                      for a, b in re.findall(r"(\d+)-(\d+)", text))
                        self.assertGreaterEqual(fetched, chunks * 1024)
                        self.assertLessEqual(fetched, chunks * 1024 * 5 / 4)
        shutil.rmtree(self.path)
        # Reversed axes.
        group = zarr.open_group(str(self.path), mode="w")
        group.create_dataset("t", data=data, chunks=(8, 8, 8), fill_value=None).attrs["_ARRAY_DIMENSIONS"] = ["z", "y", "x"]
        for name, size in (("z", 40), ("y", 48), ("x", 56)):
            group.create_dataset(name, data=-1.0 * np.arange(size), fill_value=None).attrs["_ARRAY_DIMENSIONS"] = [name]
        counts = self.same("--crop=40:56,0:8,0:9", "--dataset", "t")
        self.assertEqual(sum(path.startswith("/v.zarr/t/") for path, _ in counts), 2 * 1 * 2)

    def test_little_memory_and_copies_on_disk(self):
        data = smooth((100, 200, 210))
        V3(self.path, data, (16, 32, 64), codecs=("zstd",))
        self.same("--memory", "64M", "--chunk", "32", little_memory=True)
        shutil.rmtree(self.path)
        # Chunks as long as the axis z: a copy in temporary space.
        V3(self.path, data, (100, 8, 210), codecs=("zstd",), shards=(100, 64, 210))
        self.same("--memory", "64M", "--chunk", "32", little_memory=True)

    def test_what_goes_along_with_a_url(self):
        V3(self.path, smooth((17, 18, 19)), (8, 8, 8))
        with RangeServer(FOLDER, password=("me", SECRET),
                         fault_of=lambda number, path, _: None if path.endswith("?sig=" + SECRET) else "status:403") as server:
            url = server.url("v.zarr/", f"me:{SECRET}@") + "?sig=" + SECRET
            done = preprocess(url, "remote.isonest", "--json")
            self.assertEqual(done.returncode, 0, done.stderr)
            self.assertNotIn(SECRET, done.stdout + done.stderr)
            self.assertNotIn(SECRET.encode(), (FOLDER / "remote.isonest").read_bytes())
            error = self.failed(6, ("403", "credentials"), server.url("v.zarr", f"me:{SECRET}@"))
            self.assertEqual(error["file"], server.url("v.zarr/zarr.json"))

    def test_s3_is_signed(self):
        bucket = FOLDER / "bucket/a b+c=ü"
        V3(bucket, smooth((17, 18, 19)), (8, 8, 8), shards=(16, 16, 16))
        with RangeServer(FOLDER, keys={"KEY": (SECRET, "")}) as server:
            keys = {"AWS_ACCESS_KEY_ID": "KEY", "AWS_SECRET_ACCESS_KEY": SECRET, "AWS_REGION": "us-east-1",
                    "AWS_ENDPOINT_URL": server.url("").rstrip("/")}
            done = preprocess("s3://bucket/a b+c=ü/", "remote.isonest", **keys)
            self.assertEqual(done.returncode, 0, done.stderr)
            preprocess(bucket, "local.isonest")
            self.assertEqual((FOLDER / "remote.isonest").read_bytes(), (FOLDER / "local.isonest").read_bytes())
            # Without the permission to list, missing objects are answered with 403.
            server.fault_of = lambda number, path, _: None if path.startswith("/bucket/a") and (
                path.endswith("zarr.json") or "/c/" in path) else "status:403"
            done = preprocess("s3://bucket/a b+c=ü/", "remote.isonest", "--json", **keys)
            self.assertEqual(done.returncode, 0, done.stderr)
            self.assertIn("403", "".join(json.loads(done.stdout)["notes"]))
            server.fault_of = lambda number, path, _: "status:403" if path.endswith("/c/0/0/1") else None
            error = self.failed(6, ("403", "missing chunk"), "s3://bucket/a b+c=ü/", **keys)
            self.assertIn("c/0/0/1", error["file"])
            self.failed(6, "403", "s3://bucket/other/", **{**keys, "AWS_SECRET_ACCESS_KEY": "x"})
        shutil.rmtree(FOLDER / "bucket")


class Faults(Case):
    def setUp(self):
        super().setUp()
        V3(self.path, smooth((17, 18, 19)), (8, 8, 8), codecs=("zstd",))
        self.shards = FOLDER / "s.zarr"
        shutil.rmtree(self.shards, ignore_errors=True)
        V3(self.shards, smooth((17, 18, 19)), (8, 8, 8), shards=(16, 16, 16))

    def only(self, fault, of=("/c/0/1/1",), times=10**9):
        counts = collections.Counter()

        def fault_of(number, path, _):
            path = path.partition("?")[0]
            counts[path] += 1
            return fault if path.endswith(of) and counts[path] <= times else None
        return fault_of

    def test_what_passes_is_tried_again(self):
        for name in ("v.zarr", "s.zarr"):
            preprocess(FOLDER / name, "local.isonest")
            for fault in ("status:500", "status:503:1", "status:429:0", "broken", "short", "reset", "half_head", "garbage", "page",
                          "gzip", "no_etag", "chunked", "less"):
                with self.subTest(name=name, fault=fault), RangeServer(
                        FOLDER, fault_of=self.only(fault, ("/c/0/1/1", "/c/0/0/0", "zarr.json"), 1)) as server:
                    code = 4 if fault == "page" else 0  # the wrong content cannot be detected
                    done = preprocess(server.url(name), "remote.isonest", "--json")
                    self.assertEqual(done.returncode, code, done.stdout)
                    if code == 0:
                        self.assertEqual((FOLDER / "remote.isonest").read_bytes(), (FOLDER / "local.isonest").read_bytes())

    def test_what_does_not_pass_is_an_error_that_names_the_object(self):
        for name, fault, code, words in (
                ("v.zarr", "status:400", 6, "400"), ("v.zarr", "status:403", 6, ("403", "missing chunk")),
                ("v.zarr", "page", 4, "not decompress"), ("v.zarr", "wrong_bytes", 4, "not decompress"),
                ("v.zarr", "gzip", 6, "Encoding"), ("v.zarr", "long_page", 4, "accepted"),
                ("v.zarr", "redirect:/v.zarr/c/0/1/1?" + SECRET, 6, "more than 5 times"),
                ("v.zarr", "redirect:ftp://127.0.0.1/" + SECRET, 6, "invalid URL"),
                ("v.zarr", "status:503:90", 6, ("503", "wait 90 s")),
                ("s.zarr", "page", 4, "were expected"), ("s.zarr", "range_missing", 6, "Content-Range"),
                ("s.zarr", "wrong_bytes", 4, "checksum"), ("s.zarr", "status:403", 6, "403")):
            with self.subTest(name=name, fault=fault), RangeServer(
                    FOLDER, fault_of=self.only(fault, ("/c/0/1/1", "/c/0/0/1"))) as server:
                error = self.failed(code, words, server.url(name, f"me:{SECRET}@"))
                self.assertTrue(error["file"].startswith(server.url(name)), error)
                self.assertRegex(error["message"], r"c/0/[01]/1\b")

    def test_descriptions_that_are_none(self):
        for fault, code, words in (("page", 4, "JSON"), ("status:500", 6, "500"), ("long_page", 4, "accepted")):
            if fault == "status:500":
                continue  # would wait for a minute
            with self.subTest(fault=fault), RangeServer(FOLDER, fault_of=self.only(fault, ("zarr.json",))) as server:
                error = self.failed(code, words, server.url("v.zarr"))
                self.assertEqual(error["file"], server.url("v.zarr/zarr.json"))
        with RangeServer(FOLDER) as server:
            for name, words in (("none.zarr", "no Zarr array or group"), ("none/", "no Zarr array or group"), ("c", "404")):
                error = self.failed(3, words, server.url(name))
                self.assertEqual(error["remedies"][0]["kind"], "check_url")
        with RangeServer(FOLDER, fault_of=lambda *_: "status:401") as server:
            self.failed(6, "401", server.url("v.zarr"))

    def test_chunks_of_another_length_are_corrupt(self):
        V3(self.path.with_name("p.zarr"), smooth((8, 8, 8)), (8, 8, 8))
        chunk = FOLDER / "p.zarr/c/0/0/0"
        for size in (0, 5, 1023, 1025, 100_000):
            chunk.write_bytes(bytes(size))
            with RangeServer(FOLDER) as server:
                self.failed(4, "c/0/0/0", server.url("p.zarr"))
        shutil.rmtree(FOLDER / "p.zarr")

    def test_a_shard_that_changes_while_it_is_read(self):
        counts = collections.Counter()

        def fault_of(number, path, _):
            counts[path] += 1
            return "etag" if "/c/" in path and counts[path] > 1 else None
        with RangeServer(FOLDER, fault_of=fault_of) as server:
            error = self.failed(6, "has changed", server.url("s.zarr"))
            self.assertIn("/s.zarr/c/", error["file"])

    def test_ctrl_c_ends_a_wait_at_once(self):
        for first_silent in (1, 9):
            with self.subTest(first_silent=first_silent), RangeServer(
                    FOLDER, fault_of=lambda number, *_, n=first_silent: "silent" if number >= n else None) as server:
                code, seconds, text = interrupted(server, first_silent, [ISONEST, "preprocess", server.url("v.zarr"), "-o", "out.isonest"],
                                                  cwd=FOLDER, env=ENVIRONMENT)
                self.assertLess(seconds, 3)
                self.assertEqual(code, 130, text)


class Resume(Case):
    def test_another_description(self):
        data = smooth((96, 40, 40))
        V3(self.path, data, (8, 16, 16), codecs=("zstd",))
        preprocess(self.path, "local.isonest")
        with RangeServer(FOLDER, fault_of=lambda number, path, _: "status:400" if "/c/8/" in path else None) as server:
            done = run("preprocess", server.url("v.zarr"), "-o", "remote.isonest", "--chunk", "8", "--resume")
            self.assertEqual(done.returncode, 6, done.stderr)
            self.assertIn("is kept", done.stderr)
            server.fault_of = lambda *_: None
            # The same metadata, written again, have another ETag.
            (self.path / "zarr.json").write_text((self.path / "zarr.json").read_text())
            again = run("preprocess", server.url("v.zarr"), "-o", "remote.isonest", "--chunk", "8", "--resume")
            self.assertEqual(again.returncode, 2, again.stderr)
            self.assertIn("the interrupted run", again.stderr)

    def test_only_what_is_left_is_fetched(self):
        V3(self.path, smooth((96, 40, 40)), (8, 16, 16), codecs=("zstd",))
        preprocess(self.path, "local.isonest")
        for validators in (None, lambda path, data: {}):
            with RangeServer(FOLDER, validators=validators,
                             fault_of=lambda number, path, _: "status:400" if "/c/8/" in path else None) as server:
                done = run("preprocess", server.url("v.zarr"), "-o", "remote.isonest", "--chunk", "8", "--resume")
                self.assertEqual(done.returncode, 6, done.stderr)
                until_it_is_quiet(server)
                server.fault_of, server.notes[:] = lambda *_: None, []
                done = run("preprocess", server.url("v.zarr"), "-o", "remote.isonest", "--chunk", "8", "--resume", "--json")
                self.assertEqual(done.returncode, 0, done.stderr)
                self.assertGreater(json.loads(done.stdout)["resumed_chunks"], 0)
                self.assertEqual((FOLDER / "remote.isonest").read_bytes(), (FOLDER / "local.isonest").read_bytes())
                counts = asked(server)
                self.assertEqual({what: times for what, times in counts.items() if times > 1}, {})
                # The first plane is compared; nothing is fetched from the planes in between.
                self.assertEqual([path for path, _ in counts if re.match(r"/v.zarr/c/[12]/", path)], [])
            (FOLDER / "remote.isonest").unlink()

    def test_another_volume_of_the_same_description(self):
        data = smooth((96, 40, 40))
        V3(self.path, data, (8, 16, 16), codecs=("zstd",))
        with RangeServer(FOLDER, fault_of=lambda number, path, _: "status:400" if "/c/8/" in path else None) as server:
            done = run("preprocess", server.url("v.zarr"), "-o", "remote.isonest", "--chunk", "8", "--resume")
            self.assertEqual(done.returncode, 6, done.stderr)
            description = self.path / "zarr.json"
            stamp = description.stat().st_mtime_ns
            shutil.rmtree(self.path)
            V3(self.path, data + 1, (8, 16, 16), codecs=("zstd",))
            os.utime(description, ns=(stamp, stamp))
            server.fault_of = lambda *_: None
            again = run("preprocess", server.url("v.zarr"), "-o", "remote.isonest", "--chunk", "8", "--resume")
            self.assertEqual(again.returncode, 2, again.stderr)
            self.assertIn("the input has changed", again.stderr)


class Speed(Case):
    def test_many_chunks_are_under_way_at_a_time(self):
        V3(self.path, smooth((64, 64, 64), "u2"), (8, 16, 16), codecs=("zstd",))
        with RangeServer(FOLDER, delay=0.05) as server:
            start = time.monotonic()
            done = preprocess(server.url("v.zarr"), "remote.isonest", "--chunk", "32")
            seconds = time.monotonic() - start
            self.assertEqual(done.returncode, 0, done.stderr)
            # Sequentially they would wait for 0.05 s each.
            self.assertLess(seconds, 0.05 * len(asked(server)) / 2.5)


try:
    unittest.main(argv=sys.argv[:1], verbosity=2)
finally:
    shutil.rmtree(FOLDER)
