"""The commands that limits.py runs: small inputs, the output of each undisturbed command, and how a disturbed run is
judged."""
import dataclasses
import fcntl
import gzip
import hashlib
import importlib.util
import os
import pathlib
import pickle
import re
import resource
import shutil
import signal
import subprocess
import sys

import numpy as np

import attack

KINDS = {2: "invalid argument", 3: "not found", 4: "corrupt", 5: "unsupported", 6: "input/output", 7: "limit", 130: "cancelled"}
# What no message may contain: C++ names, HDF5's error stack, Python tracebacks.
INNER = re.compile(r"std::|bad_alloc|HDF5-DIAG|terminate called|core dumped|Traceback|internal error|Assertion|filesystem error")

PYTHON = """
import os, sys
sys.path.insert(0, os.environ["ISONEST_PACKAGE"])
try:
    import isonest
    codes = {isonest.InvalidArgumentError: 2, isonest.NotFoundError: 3, isonest.CorruptError: 4, isonest.UnsupportedError: 5,
             isonest.InputOutputError: 6, isonest.LimitError: 7, isonest.CancelledError: 130}
except (ImportError, MemoryError, OSError, SyntaxError, SystemError, RuntimeError):
    os._exit(99)
try:
    exec(sys.argv[1])
    code = 0
except isonest.Error as error:
    sys.stderr.write(f"isonest: error: {error}\\n")
    code = next(code for kind, code in codes.items() if isinstance(error, kind))
except MemoryError as error:
    sys.stderr.write(f"isonest: error: out of memory\\n")
    code = 7
except KeyboardInterrupt:
    sys.stderr.write(f"isonest: error: interrupted\\n")
    code = 130
sys.exit(code)
"""


@dataclasses.dataclass(frozen=True)
class Command:
    """words: the command line; {i} is the folder of the inputs, {o} the path of the output. output: its name; "" if
    there is none. forced: files are replaced only with --force. folder: the output is a folder, whose files are
    replaced one by one."""
    name: str
    words: tuple
    output: str = ""
    forced: bool = False
    folder: bool = False
    python: bool = False
    inputs: tuple = ()

    def line(self, one, inputs, output):
        words = [word.replace("{i}", str(inputs)).replace("{o}", output) for word in self.words]
        if self.python:
            return [sys.executable, "-c", PYTHON, *words]
        return [str(one.program), *words]


def _writes(name, words, output, **options):
    return Command(name, (*words.split(), "-o", "{o}"), output, **options)


def all_commands(inputs):
    """The commands whose inputs are available."""
    volumes = {
        "npy": "v.npy", "raw.gz": "v.raw.gz --dims 34,30,26 --type uint16 --endian big", "h5": "v.h5", "h5 packed": "packed.h5",
        "nrrd": "v.nrrd", "nifti": "v.nii.gz", "tiff": "v.tif", "zarr": "v.zarr", "dicom": "dicom", "dicom jpeg": "jpeg",
        "openvdb": "v.vdb", "netcdf": "v.nc", "mrc": "v.mrc", "metaimage": "v.mhd", "vti": "v.vti"}
    commands = []
    for name, words in volumes.items():
        if (inputs / words.split()[0]).exists():
            commands.append(_writes(f"preprocess {name}", f"preprocess {{i}}/{words} --chunk 16 --force", "o.isonest", forced=True))
    store = "extract {i}/s.isonest --iso 0.5"
    commands += [
        _writes("extract ply", store, "o.ply"), _writes("extract stl", store, "o.stl"), _writes("extract obj", store, "o.obj"),
        _writes("extract vtp", store + " --normals", "o.vtp"), _writes("extract vtkhdf", store, "o.vtkhdf"),
        _writes("extract glb", store + " --normals", "o.glb"), _writes("extract 3mf", store, "o.3mf"),
        _writes("extract error", store + " --error 0.01 --quality", "o.ply"),
        _writes("extract close", store + " --close --components 2", "o.ply"),
        _writes("extract distance", store + " --distance 0.5voxel", "o.ply"),
        _writes("extract fast", store + " --distance 0.5voxel --effort fast", "o.ply"),
        _writes("extract triangles", store + " --triangles 2000 --by error", "o.ply"),
        _writes("extract simplify", store + " --error 0.05", "o.ply"),
        _writes("extract isovalues", "extract {i}/s.isonest --iso 0.3,0.5", "o.vtp"),
        _writes("extract volume", "extract {i}/v.h5 --iso 0.5", "o.ply"),
        _writes("extract volume distance", "extract {i}/v.npy --iso 0.5 --distance 0.5voxel", "o.ply"),
        _writes("extract label", "extract {i}/l.isonest --label 2", "o.ply"),
        _writes("extract labels", "extract {i}/l.isonest --labels all", "labels", folder=True),
        _writes("extract smooth labels", "extract {i}/l.isonest --labels all --smooth --distance 0.5voxel", "labels", folder=True),
        _writes("extract neuroglancer", "extract {i}/l.isonest --labels all --format neuroglancer", "labels", folder=True),
        _writes("extract interfaces", "extract {i}/l.isonest --labels all --smooth --interfaces", "o.vtp"),
        _writes("slice png", "slice {i}/s.isonest --plane 0,0,1,12 --grid --contours 0.4,0.5 --size 200x200", "o.png"),
        _writes("slice vtp", "slice {i}/s.isonest --plane 1,1,0,20 --normals", "o.vtp"),
        _writes("slice lines", "slice {i}/s.isonest --plane 0,0,1,12 --contours 0.4", "o.obj"),
        _writes("study", "study {i}/p.isonest --steps 3 --fields linf_bar,deviation_bar", "study", folder=True),
        _writes("smooth h5", "smooth {i}/v.h5 --steps 1 --tau 1 --lambda 1 --force", "o.h5", forced=True),
        _writes("smooth nrrd", "smooth {i}/s.isonest --steps 1 --tau 1 --lambda 1 --force", "o.nrrd", forced=True),
        Command("info", ("info", "{i}/s.isonest")),
        _writes("info plot", "info {i}/s.isonest --histogram", "o.png"),
        _writes("info svg", "info {i}/s.isonest --histogram", "o.svg"),
        Command("check", ("check", "{i}/s.isonest", "--deep")),
        Command("check source", ("check", "{i}/s.isonest", "--source", "{i}/v.h5")),
        _writes("make-volume h5", "make-volume bucky --size 33 --force", "o.h5", forced=True),
        _writes("make-volume nrrd", "make-volume noise --size 33 --force --type uint8", "o.nrrd", forced=True),
        _writes("make-volume raw", "make-volume cahn-hilliard --size 33 --force", "o.raw", forced=True),
        _writes("picture", "picture {i}/m.ply --size 160x120", "o.png"),
        _writes("picture flat", "picture {i}/m.ply --size 160x120 --flat --wireframe --plain", "o.png"),
        _writes("publish", "publish {i}/s.isonest", "site", folder=True)]
    for end in ("h5", "nrrd", "nii", "vti", "npy", "mha", "raw"):
        commands.append(_writes(f"export {end}", "export {i}/s.isonest --field values --force", f"o.{end}", forced=True))
    commands.append(_writes("export lp", "export {i}/s.isonest --field lp:3 --force", "o.nrrd", forced=True))
    code = {
        "python preprocess": ("isonest.preprocess('{i}/v.npy', '{o}', chunk=16, replace=True)", "o.isonest"),
        "python save": ("isonest.open('{i}/s.isonest').isosurface(0.5).save('{o}')", "o.ply"),
        "python isosurface": ("import numpy; isonest.isosurface(numpy.load('{i}/v.npy'), 0.5, distance='0.5voxel').save('{o}')", "o.stl"),
        "python labels": ("isonest.open('{i}/l.isonest').label_surface(2).save('{o}')", "o.ply"),
        "python values": ("isonest.open('{i}/s.isonest').values(0)[...].sum()", "")}
    for name, (text, output) in code.items():
        commands.append(Command(name, (text,), output, python=True))
    return commands


def _ball(shape):
    z, y, x = np.meshgrid(*(np.linspace(-1, 1, n) for n in shape), indexing="ij")
    return (np.exp(-2 * (x * x + y * y + z * z)) + 0.1 * np.sin(9 * x) * np.cos(7 * y) * np.sin(8 * z)).astype("f4")


def _has(*names):
    return all(importlib.util.find_spec(name) for name in names)


def _volumes(folder):
    """The same ball in the formats that can be written on this machine."""
    u = _ball((26, 30, 34))
    i16 = (u * 1000).astype("i2")
    np.save(folder / "v.npy", u)
    (folder / "v.raw.gz").write_bytes(gzip.compress((u * 1000).clip(0).astype(">u2").tobytes(), mtime=0))
    (folder / "v.raw").write_bytes(i16.tobytes())
    (folder / "v.mhd").write_text("ObjectType = Image\nNDims = 3\nDimSize = 34 30 26\nElementType = MET_SHORT\n"
                                  "ElementByteOrderMSB = False\nElementDataFile = v.raw\n")
    if _has("h5py"):
        import h5py
        with h5py.File(folder / "packed.h5", "w") as file:
            file.create_dataset("v", data=u, chunks=(8, 8, 8), compression="gzip")
    if _has("nibabel"):
        import nibabel
        nibabel.save(nibabel.Nifti1Image(i16.T, np.eye(4)), folder / "v.nii.gz")
    if _has("tifffile"):
        import tifffile
        tifffile.imwrite(folder / "v.tif", i16, compression="zlib")
    if _has("zarr"):
        import zarr
        if int(zarr.__version__.partition(".")[0]) >= 3:
            zarr.config.set({"default_zarr_format": 2})
        zarr.save(str(folder / "v.zarr"), u)
    if _has("mrcfile"):
        import mrcfile
        with mrcfile.new(folder / "v.mrc") as file:
            file.set_data(u)
            file.voxel_size = 1
    if _has("netCDF4"):
        import netCDF4
        with netCDF4.Dataset(folder / "v.nc", "w") as file:
            for name, size in zip("zyx", u.shape):
                file.createDimension(name, size)
            file.createVariable("v", "f4", tuple("zyx"), zlib=True)[:] = u
    if _has("openvdb"):
        import openvdb
        grid = openvdb.FloatGrid()
        grid.copyFromArray(np.ascontiguousarray(u.T))
        openvdb.write(str(folder / "v.vdb"), [grid])
    if _has("pydicom"):
        _dicom(folder / "dicom", i16)


def _dicom(folder, u):
    import pydicom
    from pydicom.dataset import FileDataset, FileMetaDataset
    folder.mkdir()
    for k, plane in enumerate(u):
        meta = FileMetaDataset()
        meta.MediaStorageSOPClassUID = "1.2.840.10008.5.1.4.1.1.2"
        meta.MediaStorageSOPInstanceUID = f"1.2.3.{k + 1}"
        meta.TransferSyntaxUID = pydicom.uid.ExplicitVRLittleEndian
        data = FileDataset(str(folder / f"{k}.dcm"), {}, file_meta=meta, preamble=b"\0" * 128)
        data.is_little_endian, data.is_implicit_VR = True, False
        data.SOPClassUID, data.SOPInstanceUID = meta.MediaStorageSOPClassUID, meta.MediaStorageSOPInstanceUID
        data.SeriesInstanceUID, data.StudyInstanceUID, data.Modality = "1.2.3", "1.2.4", "CT"
        data.Rows, data.Columns = plane.shape
        data.PixelSpacing, data.ImageOrientationPatient = [1, 1], [1, 0, 0, 0, 1, 0]
        data.ImagePositionPatient, data.InstanceNumber = [0, 0, k], k + 1
        data.SamplesPerPixel, data.PhotometricInterpretation = 1, "MONOCHROME2"
        data.BitsAllocated, data.BitsStored, data.HighBit, data.PixelRepresentation = 16, 16, 15, 1
        data.PixelData = plane.tobytes()
        data.save_as(folder / f"{k}.dcm")


class Bench:
    """Inputs that all tries share, and the output of each undisturbed command. In one folder, made by the first process
    that needs it."""

    def __init__(self, folder, program):
        self.folder, self.program = pathlib.Path(folder), program
        self.inputs = self.folder / "in"
        with open(self.folder / "lock", "w") as lock:
            fcntl.flock(lock, fcntl.LOCK_EX)
            if not self.inputs.exists():
                self._make(self.folder / "making")
                (self.folder / "making").rename(self.inputs)
        self.commands = {command.name: command for command in all_commands(self.inputs)}
        self.before = self.state()

    def _make(self, folder):
        shutil.rmtree(folder, ignore_errors=True)
        folder.mkdir()
        _volumes(folder)
        labels = np.zeros((20, 22, 24), "u1")
        labels[3:12, 4:18, 4:20], labels[12:17, 4:18, 4:12], labels[12:17, 4:18, 12:20] = 1, 2, 3
        np.save(folder / "l.npy", labels)
        for words in ("make-volume bucky --size 33 -o v.h5", "make-volume bucky --size 33 -o v.nrrd",
                      "preprocess v.h5 -o s.isonest --indicators all --chunk 16",
                      "preprocess l.npy --labels -o l.isonest --chunk 16",
                      "make-volume bucky --size 33,33 -o p.h5", "preprocess p.h5 -o p.isonest --indicators all",
                      "extract s.isonest --iso 0.5 --distance 0.5voxel -o m.ply",
                      "export s.isonest --field values -o v.vti"):
            subprocess.run([self.program, *words.split(), "-q"], cwd=folder, check=True, capture_output=True)
        for path in [folder, *folder.rglob("*")]:
            path.chmod(0o755 if path.is_dir() else 0o644)

    def state(self):
        return {str(path): (status.st_size, status.st_mtime_ns, status.st_mode)
                for path in self.inputs.rglob("*") if (status := path.lstat())}

    def reference(self, command):
        """The bytes of each file that the command writes: {relative name: bytes}."""
        kept = self.folder / (hashlib.sha256(command.name.encode()).hexdigest()[:16] + ".pickle")
        if not kept.exists():
            place = self.folder / f"reference-{os.getpid()}"
            shutil.rmtree(place, ignore_errors=True)
            place.mkdir()
            done = run(self, command, place, place)
            if done.code != 0:
                raise RuntimeError(f"{command.name}, undisturbed: {done}")
            unfinished = kept.with_suffix(f".{os.getpid()}")
            unfinished.write_bytes(pickle.dumps(contents(place)))
            unfinished.rename(kept)
            shutil.rmtree(place)
        return pickle.loads(kept.read_bytes())


def contents(folder):
    """{relative name: bytes}; None for links and for folders without files."""
    found = {}
    for path in sorted(pathlib.Path(folder).rglob("*")):
        if path.is_file() and not path.is_symlink():
            data = path.read_bytes()
            if path.name == "labels.json":  # contains the name of its folder
                data = re.sub(rb'"folder": "[^\n]*",', b"", data)
            found[str(path.relative_to(folder))] = data
        elif path.is_symlink() or not path.is_dir():
            found[str(path.relative_to(folder))] = None
    return found


def limited(limits=(), user=None, before=()):
    """For preexec_fn: sets limits, each (name of resource, soft, hard), then calls the functions `before`, then changes
    user."""
    def prepare():
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
        signal.signal(signal.SIGHUP, signal.SIG_DFL)  # even if the attack program itself runs under nohup
        for function in before:
            function()
        if user is not None:
            os.setgroups([])
            os.setgid(user)
            os.setuid(user)
        for which, soft, hard in limits:
            resource.setrlimit(which, (soft, hard))
    return prepare


def start(bench, command, cwd, out, *more, output=None, environment=None, prepare=None, stdin=subprocess.DEVNULL,
          stdout=subprocess.PIPE, stderr=subprocess.PIPE, pass_fds=()):
    """Starts the command as a process. out: the folder of its output."""
    line = command.line(bench, bench.inputs, str(output or pathlib.Path(out) / (command.output or "none")))
    environ = {**os.environ, "ISONEST_PACKAGE": str(bench.program.parent.parent / "python"), **(environment or {})}
    environ = {name: value for name, value in environ.items() if value is not None}
    return subprocess.Popen([*line, *([] if command.python else more)], cwd=cwd, env=environ, preexec_fn=prepare or limited(),
                            stdin=stdin, stdout=stdout, stderr=stderr, pass_fds=pass_fds)


def run(bench, command, cwd, out, *more, seconds=30, **options):
    return attack.ended(start(bench, command, cwd, out, *more, **options), seconds)


def judge(bench, command, out, old, done, allowed, *, tell=True, names=(), silent=(), whole_after=(6,), left=False):
    """Judges how a disturbed run ended.

    out: the folder of its output. old: contents of that folder before. allowed: exit codes that have a cause in this
    try. tell: a failure must print a message. names: the message of a failure must contain one of these. whole_after:
    exit codes after which the complete output may exist. left: a temporary file may remain."""
    said = f"{command.name}: {done.code}: {done.err[-2000:]}"
    after = contents(out)
    new = bench.reference(command)
    if done.code not in (0, *allowed):
        return attack.wrong("this exit code: " + said)
    if INNER.search(done.err):
        return attack.wrong("inner words: " + said)
    temporary = [name for name in after if any(part.startswith(".") for part in pathlib.PurePath(name).parts)]
    if temporary and not left:
        return attack.wrong(f"left {temporary}: " + said)
    for name, data in after.items():
        if name in temporary:
            continue
        possible = [of[name] for of in (new, old) if name in of]
        if data not in possible:
            return attack.wrong(f"{name} is neither the old one nor whole: " + said)
    if done.code == 0:
        if {name: data for name, data in after.items() if name not in temporary} != {**old, **new}:
            return attack.wrong("said to be done, but it is not: " + said)
        if "error:" in done.err:
            return attack.wrong("done with an error: " + said)
    else:
        gone = [name for name in old if name not in after]
        if gone:
            return attack.wrong(f"{gone} lost: " + said)
        if command.name == "publish" and done.code not in whole_after and after not in (old, {**old, **new}):
            return attack.wrong("the folder is not whole: " + said)
        if not command.folder and done.code not in whole_after and after != old and not left:
            return attack.wrong("an error, but the output is there: " + said)
        if tell and done.code not in silent:
            lines = [line for line in done.err.splitlines() if line.startswith("isonest: error: ")]
            if len(lines) != 1:
                return attack.wrong("not one message: " + said)
            if names and not any(name in lines[0] for name in names):
                return attack.wrong(f"the message names none of {names}: " + said)
    if bench.state() != bench.before:
        return attack.wrong("an input has changed: " + said)
    return attack.SAME if done.code == 0 else attack.refused(f"{done.code} ({KINDS.get(done.code, 'signal')})")
