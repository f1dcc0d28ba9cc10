"""Installs the wheel and the Debian packages into bare roots of Debian, and uses them as their users would.

usage: bare_root.py ISONEST PLUGIN_FOLDER [RELEASE FOLDER [TEST...]]

The wheel goes into a new environment in a root that has NumPy and nothing else: it runs README's snippet, the program,
DICOM's codecs, view() and, after ParaView is installed, its plugin. The packages are installed as in the recipe of
the container. FOLDER contains what tools/release has made; without it, wheel and packages are made from the build that
contains ISONEST, for this machine's Debian release. Skipped where no root can be made (tools/debian-root). Prints seconds
and sizes.
"""
import pathlib
import re
import shutil
import subprocess
import sys
import tempfile
import time
import unittest

ROOT = pathlib.Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "tools" / "package"))
import make_wheel  # noqa: E402

BUILD = pathlib.Path(sys.argv[1]).resolve().parent.parent
CORPUS = ROOT / "tests/fuzz/corpus/volume"
VERSION = re.search(r"project\(isonest VERSION (\S+)", (ROOT / "CMakeLists.txt").read_text())[1]

VOLUME = """import numpy as np
z, y, x = np.mgrid[:64, :72, :80].astype(np.float32) / 8
volume = np.sin(x) * np.cos(y) + np.sin(y) * np.cos(z) + np.sin(z) * np.cos(x)
"""
SNIPPET = re.search(r"^From Python.*?```python\n(.*?)```", (ROOT / "README.md").read_text(), re.S | re.M)[1]
# The files that the process has loaded, apart from Python's and NumPy's own: the wheel's, and the system's.
LOADED = """
import os
print("surface", len(faces), mesh.report.distance_bound <= 0.5, os.path.getsize("surface.glb") > 1000)
for line in open("/proc/self/maps"):
    path = line.split()[-1]
    if ".so" in path:
        print("loaded", path)
"""
IMPORT = """import isonest, sys
print("packages", *sorted({name.partition(".")[0] for name, module in sys.modules.items()
                           if "-packages/" in (getattr(module, "__file__", None) or "")}))
"""
VIEW = """import isonest, urllib.request
with isonest.open("/tmp/v.isonest").view(open=False) as view:
    with urllib.request.urlopen(view.url, timeout=60) as page:
        print("page", b"<html" in page.read())
"""
PARAVIEW = """import sys
from paraview import servermanager
from paraview.simple import LoadPlugin
LoadPlugin(sys.argv[1], remote=False, ns=globals())
surface = IsonestSurface(FileName="/tmp/v.isonest", Isovalues=[0.1], Within="distance, in voxels", Tolerance=0.5)
surface.UpdatePipeline()
print("triangles", servermanager.Fetch(surface).GetNumberOfPolys())
"""


def own_release():
    """This machine's release of Debian, or None."""
    text = pathlib.Path("/etc/os-release")
    found = re.search(r"^VERSION_CODENAME=(bookworm|trixie)$", text.read_text(), re.M) if text.exists() else None
    return {"bookworm": "12", "trixie": "13"}[found[1]] if found else None


RELEASE = sys.argv[3] if len(sys.argv) > 3 else own_release()


def skip(reason):
    print(f"skipped: {reason}")
    sys.exit(77)


def run(*command, **how):
    return subprocess.run([*map(str, command)], capture_output=True, text=True, **how)


def packages_of_build(folder):
    """Makes the wheel and the Debian packages of BUILD in a folder."""
    if shutil.which("patchelf") is None or not (BUILD / "CPackConfig.cmake").exists():
        skip("patchelf is missing, or this build has no rules for installation")
    run("cmake", "--install", BUILD, "--component", "wheel", "--prefix", folder / "tree", check=True)
    name, libraries = make_wheel.make(folder / "tree", folder)
    print(f"{name}: {(folder / name).stat().st_size} bytes, {len(libraries)} libraries")
    run("cpack", "--config", BUILD / "CPackConfig.cmake", "-B", folder / "packages", check=True)
    for package in (folder / "packages").glob("*.deb"):
        package.rename(folder / package.name)
    recipe = (ROOT / "tools/package/Containerfile").read_text()
    (folder / "Containerfile").write_text(recipe.replace("@RELEASE@", "bookworm" if RELEASE == "12" else "trixie"))


class BareRoot(unittest.TestCase):
    """A copy of the bare root; `at` runs a command in it."""

    @classmethod
    def setUpClass(cls):
        cls.base = WORK / cls.__name__
        cls.root = cls.base / "root"
        cls.base.mkdir()
        run("cp", "--archive", "--reflink=auto", BARE / "root", cls.root, check=True)

    @classmethod
    def tearDownClass(cls):
        shutil.rmtree(cls.base)

    @classmethod
    def at(cls, *command, fails=False):
        done = run(ROOT / "tools/debian-root", "--run", cls.base, *command)
        if done.returncode < 0 or done.returncode > 127 or (done.returncode != 0) != fails:
            raise AssertionError(f"{command}: {done.returncode}\n{done.stdout}{done.stderr}")
        return done.stdout + done.stderr

    @classmethod
    def put(cls, name, text):
        path = cls.root / "tmp" / name
        path.write_text(text)
        return f"/tmp/{name}"

    @classmethod
    def first_surface(cls, python):
        """What README's snippet and LOADED print, run in an empty folder."""
        script = cls.put("snippet.py", VOLUME + SNIPPET + LOADED)
        return cls.at("env", "--chdir=/tmp", python, script)


class Wheel(BareRoot):
    @classmethod
    def setUpClass(cls):
        super().setUpClass()
        wheels = list(OUT.glob("*.whl"))
        if len(wheels) != 1:
            raise AssertionError(f"{OUT} has the wheels {wheels}")
        shutil.copy(wheels[0], cls.root / "tmp")
        begin = time.monotonic()
        # NumPy is Debian's package, because a root without network cannot reach a package index.
        cls.at("python3", "-m", "venv", "--system-site-packages", "/venv")
        made = time.monotonic()
        cls.at("/venv/bin/pip", "install", "--no-index", f"/tmp/{wheels[0].name}")
        installed = time.monotonic()
        cls.said = cls.first_surface("/venv/bin/python")
        end = time.monotonic()
        (cls.package,) = (cls.root / "venv/lib").glob("python3.*/site-packages/isonest")
        size = sum(path.stat().st_size for folder in (cls.package, cls.package.with_name("isonest.libs"))
                   for path in folder.rglob("*") if path.is_file())
        print(f"Debian {RELEASE}, wheel: environment {made - begin:.1f} s, pip install {installed - made:.1f} s, "
              f"first surface {end - installed:.1f} s, in all {end - begin:.1f} s; installed {size} bytes")
        cls.at("/venv/bin/python", "-c", VOLUME + "import isonest\nisonest.preprocess(volume, '/tmp/v.isonest')")

    def test_1_import_loads_numpy_alone(self):
        said = self.at("/venv/bin/python", "-X", "importtime", "-c", IMPORT)
        total = {name: int(microseconds) / 1000 for microseconds, name in
                 re.findall(r"(?m)^import time: +\d+ \| +(\d+) \| +(isonest(?:\._core)?|numpy)$", said)}
        print(f"import: isonest {total['isonest']:.0f} ms, of these numpy {total['numpy']:.0f} ms, "
              f"isonest._core {total['isonest._core']:.0f} ms")
        # _distutils_hack is Debian's setuptools, which every environment that sees the system's packages loads.
        self.assertRegex(said, r"packages (_distutils_hack )?isonest numpy\n")

    def test_1_snippet_of_the_readme(self):
        self.assertRegex(self.said, r"(?m)^surface \d{4,} True True$")

    def test_1_only_the_wheels_libraries_are_loaded(self):
        loaded = set(re.findall(r"(?m)^loaded (\S+)$", self.said))
        self.assertTrue(any("/isonest.libs/" in path for path in loaded), loaded)
        ours = re.compile(r"/venv/lib/python3[.\d]+/site-packages/isonest(\.libs)?/.*")
        of_numpy = re.compile(r"/usr/lib/python3.*|.*/lib(blas|lapack|gfortran|quadmath|z|expat|ffi|crypto|ssl|bz2|lzma|uuid|mpdec"
                              r"|openblas.*|gomp)\.so.*")
        for path in loaded:
            self.assertTrue(ours.fullmatch(path) or of_numpy.fullmatch(path) or
                            make_wheel.SYSTEM.fullmatch(path.rsplit("/", 1)[1]), path)

    def test_1_program(self):
        self.assertIn("extract", self.at("/venv/bin/isonest", "--help"))
        self.assertIn(VERSION, self.at("/venv/bin/isonest", "--version"))
        self.at("/venv/bin/isonest", "extract", "/tmp/v.isonest", "--iso", "0.1", "--distance", "0.5voxel", "-o", "/tmp/p.ply")
        self.assertTrue((self.root / "tmp/p.ply").read_bytes().startswith(b"ply\n"))
        self.at("/venv/bin/isonest", "info", "/tmp/v.isonest", "--histogram", "-o", "/tmp/p.svg")  # cairo
        self.assertTrue("<svg" in (self.root / "tmp/p.svg").read_text())

    def test_1_codecs_of_dicom(self):
        for name in ("dicom_jpeg", "dicom_jpegls", "dicom_j2k"):
            shutil.copy(CORPUS / name, self.root / "tmp" / f"{name}.dcm")
            stores = []
            for program in ("/venv/bin/isonest", None):
                if program:
                    self.at(program, "preprocess", f"/tmp/{name}.dcm", "-o", f"/tmp/{name}.isonest")
                    stores.append((self.root / f"tmp/{name}.isonest").read_bytes())
                elif RELEASE == own_release():
                    run(sys.argv[1], "preprocess", CORPUS / name, "-o", WORK / "own.isonest", "--force", check=True)
                    stores.append((WORK / "own.isonest").read_bytes())
            self.assertEqual(stores[0], stores[-1], name)

    def test_1_view(self):
        self.assertIn("page True", self.at("/venv/bin/python", self.put("view.py", VIEW)))

    def test_1_a_url_without_libcurl_says_what_to_install(self):
        if list(self.root.glob("usr/lib/*/libcurl.so.4")):
            self.skipTest("this root has libcurl")
        self.assertIn("install Debian's libcurl4", self.at("/venv/bin/isonest", "info", "https://127.0.0.1:1/x.isonest", fails=True))

    def test_2_a_url_with_the_systems_libcurl(self):
        self.at("apt-get", "update", "-qq")
        self.at("apt-get", "install", "-y", "-qq", "--no-install-recommends", "libcurl4", "ca-certificates")
        said = self.at("/venv/bin/isonest", "info", "https://127.0.0.1:1/x.isonest", fails=True)
        self.assertRegex(said, "(?i)connect")

    def test_3_plugin_of_paraview(self):
        begin = time.monotonic()
        try:
            self.at("apt-get", "update", "-qq")
            self.at("env", "DEBIAN_FRONTEND=noninteractive", "apt-get", "install", "-y", "-qq", "--no-install-recommends",
                    "paraview", "python3-paraview")
        except AssertionError as error:
            self.skipTest(f"ParaView cannot be installed: {error}")
        print(f"ParaView was installed in {time.monotonic() - begin:.0f} s")
        folder = "/" + str(self.package.relative_to(self.root).parent)
        said = self.at("env", f"PYTHONPATH={folder}:{folder}/isonest/paraview/debian12", "pvpython",
                       "--force-offscreen-rendering", self.put("plugin.py", PARAVIEW),
                       f"{folder}/isonest/paraview/isonest_paraview.py")
        expected = self.at("/venv/bin/python", "-c", "import isonest\nstore = isonest.open('/tmp/v.isonest')\n"
                           "print(len(store.isosurface(0.1, distance='0.5voxel', cells='tet').faces))")  # as the plugin does
        self.assertIn(f"triangles {int(expected)}\n", said)


class DebianPackages(BareRoot):
    def test_recipe_of_the_container(self):
        """The COPY and RUN of the recipe, in the root instead of in an image."""
        recipe = (OUT / "Containerfile").read_text().replace("\\\n", "")
        copied = re.search(r"^COPY (.*) (\S+)$", recipe, re.M)
        command = re.search(r"^RUN (.*)$", recipe, re.M)[1]
        (self.root / copied[2].lstrip("/")).mkdir()
        for pattern in copied[1].split():
            (package,) = OUT.glob(pattern)
            shutil.copy(package, self.root / copied[2].lstrip("/"))
        begin = time.monotonic()
        self.at("sh", "-ec", command)
        installed = time.monotonic()
        said = self.first_surface("/usr/bin/python3")
        end = time.monotonic()
        print(f"Debian {RELEASE}, packages: apt {installed - begin:.1f} s, first surface {end - installed:.1f} s")
        self.assertRegex(said, r"(?m)^surface \d{4,} True True$")
        entry = re.search(r'^ENTRYPOINT \["(.*)"\]$', recipe, re.M)[1]
        self.assertIn(VERSION, self.at(entry, "--version"))
        self.at(entry, "make-volume", "bucky", "--size", "33", "-o", "/tmp/b.h5")
        self.at(entry, "extract", "/tmp/b.h5", "--iso", "0.5", "-o", "/tmp/b.ply")
        self.at(entry, "picture", "/tmp/b.ply", "-o", "/tmp/b.png")
        self.assertTrue((self.root / "tmp/b.png").read_bytes().startswith(b"\x89PNG"))


if __name__ == "__main__":
    if RELEASE not in ("12", "13"):
        skip("this is no Debian 12 or 13")
    BARE = BUILD / f"bare-{RELEASE}"
    done = run(ROOT / "tools/debian-root", RELEASE, BARE, "python3-venv", "python3-numpy")
    if done.returncode == 77:
        skip(done.stderr.strip())
    if done.returncode != 0:
        sys.exit(done.stdout + done.stderr)
    with tempfile.TemporaryDirectory(prefix="isonest-test-", dir=BUILD) as name:
        WORK = pathlib.Path(name)
        OUT = pathlib.Path(sys.argv[4]).resolve() if len(sys.argv) > 4 else WORK
        if OUT == WORK:
            packages_of_build(WORK)
        unittest.main(argv=[sys.argv[0], *sys.argv[5:]], verbosity=2)
