"""A volume in one object at a URL gives the same store as the file, byte for byte, with few requests and almost no byte
fetched twice; failures on the way give a clear error without an output; no secret is shown; and files that an object
names are never opened except next to it.

usage: remote_volumes_test.py ISONEST PLUGIN_FOLDER
"""
import base64
import gzip
import json
import os
import pathlib
import shutil
import signal
import struct
import subprocess
import sys
import tempfile
import time
import unittest
import zlib

import h5py
import numpy as np

sys.path.insert(0, str(pathlib.Path(__file__).parents[1]))
sys.path.insert(0, str(pathlib.Path(__file__).parents[1] / "support"))
import served  # noqa: E402
from support.range_server import RangeServer  # noqa: E402
from support.sanitized import is_sanitized  # noqa: E402

ISONEST = pathlib.Path(sys.argv[1]).resolve()
FOLDER = pathlib.Path(tempfile.mkdtemp(prefix="isonest-remote-volumes-"))
ENVIRONMENT = {name: value for name, value in os.environ.items()
               if not name.startswith(("AWS_", "SSL_CERT", "CURL_")) and not name.lower().endswith("_proxy")}
ENVIRONMENT["HOME"] = str(FOLDER)
SECRET = "s3cret"
SHAPE = (100, 90, 80)  # [z, y, x]: 2.9 MB of float32, more than the window with the minimum memory
RAW = ["--dims", "80,90,100", "--type", "float32"]
STORE = ["--chunk", "16", "--indicators", "deviation_bar"]


def run(*arguments, **environment):
    return served.run([ISONEST, *map(str, arguments)], cwd=FOLDER, env={**ENVIRONMENT, **environment},
                      capture_output=True, text=True, timeout=300)


def report(*arguments, **environment):
    done = run(*arguments, "--json", **environment)
    if done.returncode != 0:
        raise AssertionError(f"{arguments}: {done.stdout}{done.stderr}")
    return json.loads(done.stdout)


_missing = run("info", "http://127.0.0.1:1/x", "--json")
if _missing.returncode == 5:
    print("skipped: this build reads no URLs")
    sys.exit(77)


def write(name, *parts):
    (FOLDER / name).write_bytes(b"".join(part if isinstance(part, bytes) else part.encode() for part in parts))


def nifti(values, single, offset):
    head = bytearray(348)
    struct.pack_into("<i", head, 0, 348)
    nz, ny, nx = values.shape
    struct.pack_into("<8h", head, 40, 3, nx, ny, nz, 1, 1, 1, 1)
    struct.pack_into("<hh", head, 70, 16, 32)
    struct.pack_into("<8f", head, 76, 1, 1, 1, 1, 1, 1, 1, 1)
    struct.pack_into("<f", head, 108, offset)
    head[344:348] = b"n+1\0" if single else b"ni1\0"
    return bytes(head) + bytes(4)


def mrc(values):
    nz, ny, nx = values.shape
    head = bytearray(1024)
    struct.pack_into("<4i", head, 0, nx, ny, nz, 2)
    struct.pack_into("<3i", head, 28, nx, ny, nz)
    struct.pack_into("<3f", head, 40, nx, ny, nz)
    struct.pack_into("<3f", head, 52, 90, 90, 90)
    struct.pack_into("<3i", head, 64, 1, 2, 3)
    head[208:212] = b"MAP "
    head[212:214] = b"\x44\x44"
    return bytes(head)


def make_files():
    """Each input: its name, and the options that it needs."""
    nz, ny, nx = SHAPE
    z, y, x = np.mgrid[0:nz, 0:ny, 0:nx]
    noise = np.random.default_rng(5).random(SHAPE)
    values = (np.sqrt((x - 40.0) ** 2 + (y - 45) ** 2 + (z - 50) ** 2) + noise).astype(np.float32)
    data = values.tobytes()
    nrrd = f"NRRD0004\ntype: float\ndimension: 3\nsizes: {nx} {ny} {nz}\nendian: little\n"
    meta = f"ObjectType = Image\nNDims = 3\nDimSize = {nx} {ny} {nz}\nElementType = MET_FLOAT\n"
    vti = (f'<VTKFile type="ImageData" version="1.0" byte_order="LittleEndian" header_type="UInt64"{{}}>\n'
           f'<ImageData WholeExtent="0 {nx - 1} 0 {ny - 1} 0 {nz - 1}" Origin="0 0 0" Spacing="1 1 1">\n'
           f'<Piece Extent="0 {nx - 1} 0 {ny - 1} 0 {nz - 1}"><PointData>\n'
           '<DataArray type="Float32" Name="a" format="appended" offset="0"/>\n'
           '</PointData></Piece></ImageData>\n<AppendedData encoding="raw">_')
    end = "\n</AppendedData></VTKFile>\n"
    write("a.raw", data)
    write("big.raw", values.astype(">f4").tobytes())
    write("a.raw.gz", gzip.compress(data, 1))
    write("a.nrrd", nrrd, "encoding: raw\n\n", data)
    write("gz.nrrd", nrrd, "encoding: gzip\n\n", gzip.compress(data, 1))
    (FOLDER / "below").mkdir()
    write("below/of a #b?.raw", b"two\nlines\n", data)
    write("apart.nhdr", nrrd, "encoding: raw\nline skip: 2\ndata file: below/of a #b?.raw\n")
    write("a.nii", nifti(values, True, 352), data)
    write("a.nii.gz", gzip.compress(nifti(values, True, 352) + data, 1))
    write("pair.hdr", nifti(values, False, 0))
    write("pair.img", data)
    write("packed.hdr.gz", gzip.compress(nifti(values, False, 0)))
    write("packed.img.gz", gzip.compress(data, 1))
    write("a.mha", meta, "ElementDataFile = LOCAL\n", data)
    write("z.mha", meta, "CompressedData = True\nElementDataFile = LOCAL\n", zlib.compress(data, 1))
    write("apart.mhd", meta, "ElementDataFile = a.raw\n")
    write("a.mrc", mrc(values), data)
    write("a.vti", vti.format(""), struct.pack("<Q", len(data)), data, end)
    inline = lambda kind, name, array: (f'<DataArray type="{kind}" Name="{name}" format="binary">\n'.encode() + base64.b64encode(  # noqa: E731
        struct.pack("<Q", array.nbytes) + array.tobytes()) + b"\n</DataArray>\n")
    head, behind = vti.format("").split("<DataArray")[0], "</PointData></Piece></ImageData></VTKFile>\n"
    write("inline.vti", head, inline("Float64", "b", values.astype("f8")), inline("Float32", "a", values), behind)
    write("a.vtk", f"# vtk DataFile Version 3.0\nt\nBINARY\nDATASET STRUCTURED_POINTS\nDIMENSIONS {nx} {ny} {nz}\n"
          f"ORIGIN 0 0 0\nSPACING 1 1 1\nPOINT_DATA {values.size}\nSCALARS a float 1\nLOOKUP_TABLE default\n",
          values.astype(">f4").tobytes())
    np.save(FOLDER / "c.npy", values)
    np.save(FOLDER / "fortran.npy", np.asfortranarray(values))
    np.save(FOLDER / "colours.npy", np.stack([values, -values, values], axis=-1))
    np.save(FOLDER / "times.npy", np.stack([values, values + 1]))
    with h5py.File(FOLDER / "plain.h5", "w") as file:
        file["a"] = values
    with h5py.File(FOLDER / "block.h5", "w", userblock_size=1024) as file:
        file["a"] = values
    with h5py.File(FOLDER / "big.h5", "w") as file:
        file["a"] = values.astype(">f4")
    with h5py.File(FOLDER / "long.h5", "w") as file:
        file["a"] = (values * 100).astype("<i8")
    with h5py.File(FOLDER / "times.h5", "w") as file:
        file["a"] = np.stack([values, values + 1])
    for name, options in {"gzip": {"compression": "gzip", "shuffle": True, "fletcher32": True},
                          "none": {}, "offset": {"dtype": "<i2", "scaleoffset": 0}}.items():
        with h5py.File(FOLDER / f"{name}.h5", "w", userblock_size=512 if name == "none" else 0) as file:
            file.create_dataset("g/a", data=values * 100, chunks=(17, 30, 40), **options)
    with h5py.File(FOLDER / "holes.h5", "w") as file:
        some = file.create_dataset("a", SHAPE, "<f4", chunks=(20, 20, 20), fillvalue=3)
        some[30:70, 10:60, 5:60] = values[30:70, 10:60, 5:60]
    return {"a.raw": RAW, "big.raw": RAW + ["--endian", "big"], "a.raw.gz": RAW, "a.nrrd": [], "gz.nrrd": [],
            "apart.nhdr": [], "a.nii": [], "a.nii.gz": [], "pair.hdr": [], "pair.img": [], "packed.hdr.gz": [],
            "a.mha": [], "z.mha": [], "apart.mhd": [], "a.mrc": [], "a.vti": [],
            "inline.vti": ["--dataset", "a"], "a.vtk": [], "c.npy": [],
            "fortran.npy": [], "colours.npy": ["--index", ":,:,:,1"], "times.npy": ["--index", "1,:,:,:"],
            "plain.h5": [], "block.h5": [], "big.h5": [], "long.h5": [], "times.h5": ["--index", "1,:,:,:"],
            "gzip.h5": [], "none.h5": ["--dataset", "g/a"], "offset.h5": [], "holes.h5": []}


# For these, less or more than the object is read: one of several volumes, or two objects.
PARTS = {"times.npy": 0.6, "times.h5": 0.6, "inline.vti": 0.4}
DATA_OF = {"apart.nhdr": "below/of a #b?.raw", "pair.hdr": "pair.img", "packed.hdr.gz": "packed.img.gz",
           "apart.mhd": "a.raw"}


class Volumes(unittest.TestCase):
    maxDiff = None

    @classmethod
    def setUpClass(cls):
        cls.inputs = make_files()

    def setUp(self):
        self.outputs = []

    def tearDown(self):
        left = [path.name for path in FOLDER.iterdir() if path.name.startswith(("out", ".out"))]
        for name in left:
            (FOLDER / name).unlink()
        self.assertEqual([name for name in left if name not in self.outputs], [])

    def store_of(self, source, *options):
        """The store's bytes, and the report."""
        memory = [] if "--memory" in options else ["--memory", "48M"]
        said = report("preprocess", source, "-o", "out.isonest", "--force", *STORE, *memory, *options)
        stored = (FOLDER / "out.isonest").read_bytes()
        (FOLDER / "out.isonest").unlink()
        return stored, said

    def failed(self, code, words, *arguments, **environment):
        done = run(*arguments, "--json", **environment)
        self.assertEqual(done.returncode, code, done.stdout + done.stderr)
        self.assertNotIn(SECRET, done.stdout + done.stderr)
        error = json.loads(done.stdout)["error"]
        for word in words if isinstance(words, list) else [words]:
            self.assertIn(word, error["message"])
        return error

    def preprocess_fails(self, code, words, url, *options):
        return self.failed(code, words, "preprocess", url, "-o", "out.isonest", *STORE, "--memory", "48M", *options)

    def test_stores_are_those_of_the_files(self):
        with RangeServer(FOLDER, delay=0.01) as server:
            for name, options in self.inputs.items():
                with self.subTest(input=name):
                    local, said = self.store_of(name, *options)
                    self.assertNotIn("remote", said)
                    requests, fetched = server.requests, server.bytes
                    far, said = self.store_of(server.url(name), *options)
                    self.assertEqual(far, local)
                    requests, fetched = server.requests - requests, server.bytes - fetched
                    remote = said["remote"]
                    # The image of an HDR, and the header of an IMG, are searched for.
                    self.assertEqual(remote["cache_bytes"], 0)
                    self.assertLessEqual(remote["requests"], requests)
                    self.assertLessEqual(requests, remote["requests"] + 4)
                    self.assertLessEqual(remote["round_trips"], remote["requests"])
                    size = PARTS.get(name, 1) * (FOLDER / DATA_OF.get(name, name)).stat().st_size
                    # The ends are fetched when the object is opened.
                    self.assertLessEqual(fetched, 1.05 * size + (192 << 10), name)
                    self.assertLessEqual(requests, size / (200 << 10) + 24, name)

    def test_a_part_of_a_volume_is_fetched_alone(self):
        with RangeServer(FOLDER) as server:
            for name, most in (("a.nrrd", 0.5), ("gzip.h5", 0.85)):
                options = ["--crop", ":,:,30:45"]
                local, _ = self.store_of(name, *options)
                before = server.bytes
                far, _ = self.store_of(server.url(name), *options)
                self.assertEqual(far, local)
                self.assertLess(server.bytes - before, most * (FOLDER / name).stat().st_size)

    def test_threads_memory_and_cache_change_nothing(self):
        # Data that arrive faster than the cache is written are not kept.
        with RangeServer(FOLDER, rate=3e5 if is_sanitized(ISONEST) else 3e6) as server:
            for name, options in (("a.raw", RAW), ("gzip.h5", []), ("a.nii.gz", [])):
                local, _ = self.store_of(name, *options)
                cold = ["--cache", "kept:64M"]
                for more in (["--threads", "1"], ["--memory", "1G"], cold, cold):
                    far, said = self.store_of(server.url(name), *options, *more)
                    self.assertEqual(far, local, more)
                remote = said["remote"]
                self.assertGreater(remote["cache_bytes"], 0.9 * (FOLDER / name).stat().st_size)
                self.assertLess(remote["remote_bytes"], 200 << 10)
                shutil.rmtree(FOLDER / "kept")

    def test_other_commands(self):
        report("preprocess", "a.nrrd", "-o", "b.isonest", *STORE)
        with RangeServer(FOLDER, password=("me", SECRET)) as server:
            url = server.url("a.nrrd", f"me:{SECRET}@") + f"?key={SECRET}"
            for words in (["extract", "{}", "--iso", "30", "-o", "out.ply"], ["check", "b.isonest", "--source", "{}"],
                          ["smooth", "{}", "--steps", "1", "--tau", "1", "--lambda", "9", "-o", "out.nrrd"]):
                made, reports = [], []
                for source in ("a.nrrd", url):
                    done = run(*[source if word == "{}" else word for word in words], "--json")
                    self.assertEqual(done.returncode, 0, done.stdout + done.stderr)
                    self.assertNotIn(SECRET, done.stdout + done.stderr)
                    reports.append(json.loads(done.stdout))
                    made.append([(FOLDER / name).read_bytes() for name in words if name.startswith("out")])
                    for name in words:
                        if name.startswith("out"):
                            (FOLDER / name).unlink()
                self.assertEqual(made[0], made[1])
                counted = reports[1]["remote_source" if words[0] == "check" else "remote"]
                self.assertGreater(counted["remote_bytes"], 2_000_000)
            token = ["--header", f"Authorization: Basic {SECRET}"]
            self.failed(6, "401", "check", "b.isonest", "--source", server.url("a.nrrd"), *token)

    def test_a_store_names_no_secret(self):
        with RangeServer(FOLDER, password=("me", SECRET)) as server:
            self.make_long()
            url = server.url("long.nrrd", f"me:{SECRET}@") + f"?key={SECRET}"
            stored, _ = self.store_of(url)
            self.assertNotIn(SECRET.encode(), stored)
            # A run that is interrupted leaves files next to the store.
            end = server.bytes + 8_000_000
            server.fault_of = lambda *_: "status:404" if server.bytes > end else None
            self.preprocess_fails(3, "part is kept", url, "--resume")
            left = [path for path in FOLDER.iterdir() if "out.isonest" in path.name]
            self.assertTrue(left)
            for path in left:
                self.assertNotIn(SECRET.encode(), path.read_bytes())
                self.assertNotIn(SECRET, path.name)
                path.unlink()

    def test_what_cannot_be_read_by_ranges(self):
        write("a.tif", b"II*\0" + bytes(2000))
        write("a.dcm", bytes(128) + b"DICM" + bytes(2000))
        write("a.nc", b"CDF\1" + bytes(2000))
        np.savez(FOLDER / "a.npz", a=np.zeros((9, 9, 9), np.float32))
        with RangeServer(FOLDER) as server:
            for name, format_name in (("a.tif", "TIFF"), ("a.dcm", "DICOM"), ("a.nc", "NetCDF-3"), ("a.npz", "NumPy archive")):
                error = self.preprocess_fails(5, [format_name, "download it first"], server.url(name))
                self.assertEqual(error["remedies"][0]["kind"], "download")
            self.failed(5, "download it first", "preprocess", server.url("a.raw"), server.url("a.raw"), "-o", "out.isonest", *RAW)
            self.preprocess_fails(2, "--dims", server.url("a.raw"))

    def test_scattered_numbers_are_not_read(self):
        """A slab of planes consists of pieces of 256 bytes, 6400 bytes apart; if they fit into the window, they are
        read."""
        for sections, is_read in ((600, False), (100, True)):
            columns, rows = 4, 400
            head = bytearray(mrc(np.zeros((sections, rows, columns), np.float32)))
            struct.pack_into("<3i", head, 64, 2, 3, 1)  # columns along y, rows along z, sections along x
            write("scattered.mrc", bytes(head), np.random.default_rng(1).random(sections * rows * columns, np.float32).tobytes())
            with RangeServer(FOLDER) as server:
                if is_read:
                    self.assertEqual(self.store_of(server.url("scattered.mrc"))[0], self.store_of("scattered.mrc")[0])
                else:
                    self.preprocess_fails(5, ["order", "download it first"], server.url("scattered.mrc"))

    def test_only_what_lies_beside_is_opened(self):
        head = "NRRD0004\ntype: uchar\ndimension: 3\nsizes: 4 4 4\nencoding: raw\ndata file: "
        with RangeServer(FOLDER) as server, RangeServer(FOLDER) as other:
            for name in ("../a.raw", "/etc/hostname", "below/../../a.raw", "file:///etc/hostname", other.url("a.raw"), "a\\b",
                         "./a.raw", "//host/a.raw"):
                write("below/bad.nhdr", head, name, "\n")
                before = server.requests
                self.preprocess_fails(5, "subfolder", server.url("below/bad.nhdr", f"me:{SECRET}@"))
                self.assertLessEqual(server.requests - before, 3)
            self.assertEqual(other.requests, 0)
            write("below/bad.nhdr", head, "not there.raw\n")
            self.preprocess_fails(3, "not%20there.raw", server.url("below/bad.nhdr"))

    def test_other_files_of_hdf5_are_not_opened(self):
        (FOLDER / "inner").mkdir()
        local = FOLDER / "inner" / "local.bin"
        local.write_bytes(bytes(1000))
        with h5py.File(FOLDER / "inner" / "other.h5", "w") as file:
            file["a"] = np.zeros((10, 10, 10), np.uint8)
        with h5py.File(FOLDER / "inner" / "names.h5", "w") as file:
            file.create_dataset("stored", (10, 10, 10), "u1", external=[(str(local), 0, 1000)])
            file["linked"] = h5py.ExternalLink(str(FOLDER / "inner" / "other.h5"), "a")
            layout = h5py.VirtualLayout((10, 10, 10), "u1")
            layout[:] = h5py.VirtualSource(str(FOLDER / "inner" / "other.h5"), "a", (10, 10, 10))
            file.create_virtual_dataset("virtual", layout)
            scale = file.create_dataset("scale", (10,), "u1", external=[(str(local), 0, 10)])
            scale.make_scale("scale")
            file["scaled"] = np.ones((10, 10, 10), np.uint8)
            file["scaled"].dims[0].attach_scale(scale)
        with RangeServer(FOLDER) as server:
            url = server.url("inner/names.h5")
            for name in ("stored", "linked", "virtual"):
                self.preprocess_fails(5, "download it first", url, "--dataset", name)
                trace = subprocess.run(["strace", "-f", "-e", "trace=openat,open", ISONEST, "preprocess", url, "--dataset",
                                        name, "-o", FOLDER / "out.isonest"], capture_output=True, text=True,
                                       env=ENVIRONMENT) if shutil.which("strace") else None
                if trace:
                    self.assertRegex(trace.stderr, "open.*libhdf5")
                    self.assertNotRegex(trace.stderr, r"open(at)?\(.*(local\.bin|other\.h5)")
            # Coordinates in another file are ignored.
            local.unlink()
            said = report("preprocess", url, "--dataset", "scaled", "-o", "c.isonest", "--force")
            self.assertEqual(said["nodes"], [10, 10, 10])

    def test_faults(self):
        later = {"status:404": (3, "404"), "status:403": (6, "403"), "whole": (6, "a range was requested"),
                 "etag": (6, "changed"), "size": (6, "changed"), "status:503:0": (6, "503"), "short": (6, "")}
        for name in ("a.nrrd", "gzip.h5", "a.nii.gz"):
            for fault, (code, words) in later.items():
                if fault in ("status:503:0", "short") and name != "a.nrrd":
                    continue  # they take as long as the retries
                with self.subTest(input=name, fault=fault), RangeServer(
                        FOLDER, fault_of=lambda number, *_, fault=fault: fault if number > 3 else None) as server:
                    self.preprocess_fails(code, words, server.url(name, f"me:{SECRET}@") + f"?key={SECRET}",
                                          "--header", f"X-Token: {SECRET}")
        with RangeServer(FOLDER, knows_ranges=False) as server:
            self.preprocess_fails(5, "range requests", server.url("a.nrrd"))
        with RangeServer(FOLDER) as server:
            self.preprocess_fails(3, "404", server.url("not there.nrrd"))

    def test_what_passes_is_tried_again(self):
        faults = ["status:503:0", "reset", "status:429:0", "broken", "status:500"]
        for name in ("a.nrrd", "gzip.h5", "a.nii.gz"):
            with RangeServer(FOLDER, fault_of=lambda number, *_: faults[number // 2 % 5] if number % 2 == 0 else None) as server:
                local, _ = self.store_of(name)
                far, _ = self.store_of(server.url(name))
                self.assertEqual(far, local)

    def test_redirects(self):
        with RangeServer(FOLDER) as server:
            server.fault_of = lambda number, path, headers: "redirect:" + server.url("a.nrrd") if "moved" in path else None
            local, _ = self.store_of("a.nrrd")
            far, _ = self.store_of(server.url("moved.nrrd"))
            self.assertEqual(far, local)

    def make_long(self):
        """Several windows, and several rows of blocks."""
        values = np.random.default_rng(7).random((400, 90, 80)).astype(np.float32)
        write("long.nrrd", "NRRD0004\ntype: float\ndimension: 3\nsizes: 80 90 400\nendian: little\nencoding: raw\n\n",
              values.tobytes())
        write("long.nii.gz", gzip.compress(nifti(values, True, 352) + values.tobytes(), 1))
        with h5py.File(FOLDER / "packed.h5", "w") as file:
            file.create_dataset("g/a", data=values, chunks=(17, 30, 40), compression="gzip")

    def test_resume(self):
        self.make_long()
        for name in ("long.nrrd", "packed.h5", "long.nii.gz"):
            with self.subTest(input=name), RangeServer(FOLDER) as server:
                size = (FOLDER / name).stat().st_size
                local, _ = self.store_of(name)
                server.fault_of = lambda *_: "status:404" if server.bytes > 0.7 * size else None
                self.preprocess_fails(3, "part is kept", server.url(name), "--resume")
                server.fault_of = lambda *_: None
                before = server.bytes
                far, said = self.store_of(server.url(name), "--resume")
                self.assertEqual(far, local)
                self.assertGreater(said["resumed_chunks"], 0)
                if name != "long.nii.gz":  # a stream is read from its start
                    self.assertLess(server.bytes - before, 0.85 * size)

    def test_another_object_is_not_resumed(self):
        self.make_long()
        write("changing.nrrd", (FOLDER / "long.nrrd").read_bytes())
        with RangeServer(FOLDER) as server:
            url = server.url("changing.nrrd")
            server.fault_of = lambda *_: "status:404" if server.bytes > 8_000_000 else None
            self.preprocess_fails(3, "part is kept", url, "--resume")
            server.fault_of = lambda *_: None
            data = bytearray((FOLDER / "changing.nrrd").read_bytes())
            data[len(data) // 2] ^= 1
            write("changing.nrrd", bytes(data))
            local, _ = self.store_of("changing.nrrd")
            done = run("preprocess", url, "-o", "out.isonest", *STORE, "--memory", "48M", "--resume", "--json")
            if done.returncode == 0:
                self.assertEqual(json.loads(done.stdout)["resumed_chunks"], 0)
                self.assertEqual((FOLDER / "out.isonest").read_bytes(), local)
            for path in FOLDER.iterdir():
                if "out.isonest" in path.name:
                    path.unlink()

    def test_without_a_version_nothing_is_resumed(self):
        with RangeServer(FOLDER, validators=lambda path, data: {}) as server:
            local, _ = self.store_of("a.nrrd")
            far, _ = self.store_of(server.url("a.nrrd"))
            self.assertEqual(far, local)
            self.preprocess_fails(2, "", server.url("a.nrrd"), "--resume")

    @unittest.skipIf(is_sanitized(ISONEST), "sanitizers need more memory than such limits leave")
    def test_memory(self):
        nodes = 256 << 20
        with open(FOLDER / "large.raw", "wb") as file:
            file.truncate(nodes)
        with RangeServer(FOLDER) as server:
            done = subprocess.run(["prlimit", f"--data={(64 + 64) << 20}", ISONEST, "preprocess", server.url("large.raw"), "--dims",
                                   "512,512,1024", "--type", "uint8", "--memory", "64M", "--indicators", "deviation_bar", "-o",
                                   FOLDER / "large.isonest", "--json"], capture_output=True, text=True, env=ENVIRONMENT)
            self.assertEqual(done.returncode, 0, done.stdout + done.stderr)
            self.assertLess(server.bytes, 1.02 * nodes)
        (FOLDER / "large.raw").unlink()
        (FOLDER / "large.isonest").unlink()

    def test_an_interrupt_ends_it_at_once(self):
        for fault in ("silent", "slow"):
            with RangeServer(FOLDER, fault_of=lambda number, *_, fault=fault: fault if number > 2 else None) as server:
                process = subprocess.Popen([ISONEST, "preprocess", server.url("a.nrrd"), "-o", FOLDER / "out.isonest"],
                                           stdout=subprocess.PIPE, stderr=subprocess.PIPE, env=ENVIRONMENT)
                while server.requests < 3:
                    time.sleep(0.02)
                time.sleep(0.3)
                begin = time.monotonic()
                process.send_signal(signal.SIGINT)
                process.communicate()
                self.assertEqual(process.returncode, 130)
                self.assertLess(time.monotonic() - begin, 3)


try:
    unittest.main(argv=sys.argv[:1])
finally:
    shutil.rmtree(FOLDER)
