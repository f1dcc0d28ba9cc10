"""tools/package/make_wheel.py: the tag, the names, the list of files and their licences. A wheel of a small module and
program works without the installed libraries that it contains, names what it lacks, and is reproducible.

usage: wheel_test.py ISONEST PLUGIN_FOLDER   (arguments are not used)
"""
import base64
import ctypes
import email
import hashlib
import os
import pathlib
import re
import shutil
import signal
import subprocess
import sys
import tarfile
import tempfile
import unittest
import zipfile

ROOT = pathlib.Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "tools" / "package"))
import backend  # noqa: E402
import make_wheel  # noqa: E402
from make_wheel import WheelError, glibc_of, module_tags  # noqa: E402

MISSING = [tool for tool in ("patchelf", "readelf", "ldd", "strip", "gcc", "dpkg-query") if not shutil.which(tool)]
VERSION = re.search(r"project\(isonest VERSION (\S+)", (ROOT / "CMakeLists.txt").read_text())[1]

MODULE = "#include <lz4.h>\nint lz4(void) { return LZ4_versionNumber(); }\n"
# HDF5 needs libcurl and libcrypto, cairo needs X11, and a wheel must contain none of them. The system's libcurl, loaded
# later, still works.
PROGRAM = """#include <cairo.h>
#include <hdf5.h>
#include <dlfcn.h>
#include <stdio.h>
int main(int argc, char** argv) {
    cairo_surface_t* s = cairo_image_surface_create(CAIRO_FORMAT_A8, 8, 8);
    cairo_t* c = cairo_create(s);
    hid_t file = H5Fcreate(argv[1], H5F_ACC_TRUNC, H5P_DEFAULT, H5P_DEFAULT);
    cairo_paint(c);
    void* system = dlopen("libcurl.so.4", RTLD_NOW | RTLD_LOCAL);
    void* (*init)(void) = (void* (*)(void))dlsym(system, "curl_easy_init");
    printf("%d %d %d %s\\n", cairo_status(c), file >= 0 && H5Fclose(file) >= 0, init() != 0, argv[argc - 1]);
    return 3;
}
"""


def run(*command, **how):
    return subprocess.run([*map(str, command)], capture_output=True, text=True, **how)


class Rules(unittest.TestCase):
    def test_the_tag_is_of_the_newest_symbol(self):
        self.assertEqual(glibc_of(set()), 17)
        self.assertEqual(glibc_of({("GLIBC", "2.2.5"), ("GLIBC", "2.34"), ("GLIBC", "2.4")}), 34)
        self.assertEqual(glibc_of({("GLIBC", "2.9"), ("GLIBC", "2.17")}), 17)
        self.assertEqual(glibc_of({("GLIBC", "ABI_DT_RELR")}), 36)
        # The C++ library decides where it is newer than the C library that is needed.
        self.assertEqual(glibc_of({("GLIBC", "2.28"), ("GLIBCXX", "3.4.30"), ("CXXABI", "1.3.9")}), 35)
        self.assertEqual(glibc_of({("GLIBC", "2.38"), ("GLIBCXX", "3.4.32")}), 39)
        self.assertEqual(glibc_of({("CXXABI", "1.3.15")}), 39)
        self.assertEqual(glibc_of({("CXXABI", "FLOAT128"), ("GCC", "3.0")}), 17)

    def test_a_symbol_that_no_other_system_has_is_an_error(self):
        for symbol in (("GLIBC", "PRIVATE"), ("GLIBCXX", "3.4.99"), ("GCC", "99.0.0")):
            with self.assertRaises(WheelError, msg=symbol):
                glibc_of({symbol})

    def test_readelf_lists_what_is_needed(self):
        text = "  0x0010: Version: 1  File: libc.so.6  Cnt: 2\n  0x0020:   Name: GLIBC_2.34  Flags: none  Version: 5\n" \
               "  0x0030:   Name: CXXABI_1.3.9  Flags: none  Version: 4\n  000: Rev: 1  Name: LIBTIFF_4.0\n"
        self.assertEqual(make_wheel.NEEDED_VERSION.findall(text), [("GLIBC", "2.34"), ("CXXABI", "1.3.9")])

    def test_the_python_is_that_of_the_module(self):
        self.assertEqual(module_tags("_core.cpython-311-x86_64-linux-gnu.so"), ("cp311", "cp311"))
        self.assertEqual(module_tags("_core.cpython-39-aarch64-linux-gnu.so"), ("cp39", "cp39"))
        self.assertEqual(module_tags("_core.cpython-313t-x86_64-linux-gnu.so"), ("cp313", "cp313t"))
        with self.assertRaises(WheelError):
            module_tags("_core.so")

    def test_what_is_left_to_the_system(self):
        for name in ("libc.so.6", "libm.so.6", "libstdc++.so.6", "libgcc_s.so.1", "ld-linux-x86-64.so.2"):
            self.assertTrue(make_wheel.SYSTEM.fullmatch(name), name)
        for name in ("libcairo.so.2", "libz.so.1", "libtbb.so.12", "libm17n.so.0", "libcurl.so.4", "libgcc_sx.so"):
            self.assertFalse(make_wheel.SYSTEM.fullmatch(name), name)

    def test_licences_of_a_copyright_file(self):
        self.assertEqual(make_wheel.licence_of(
            "Format: x\n\nFiles: *\nCopyright: a\nLicense: BSD-3-clause\n text\n\nFiles: b\nLicense: Expat\n\n"
            "Files: debian/*\nLicense: GPL-3\n\nLicense: BSD-3-clause\n text\n"), "BSD-3-clause, Expat")
        self.assertEqual(make_wheel.licence_of("This is free.\n"), "see its copyright file")

    def test_record_row(self):
        digest = base64.urlsafe_b64encode(hashlib.sha256(b"abc").digest()).decode().rstrip("=")
        self.assertEqual(make_wheel.record_row("a/b.py", b"abc"), f"a/b.py,sha256={digest},3")

    def test_options_of_pip(self):
        self.assertEqual(backend.chosen(None), [])
        self.assertEqual(backend.chosen({"cmake": "-DA=1 -DB='x y'"}), ["-DA=1", "-DB=x y"])
        self.assertEqual(backend.chosen({"cmake": ["-DA=1", "-DB=2"]}), ["-DA=1", "-DB=2"])

    def test_metadata_before_the_build(self):
        with tempfile.TemporaryDirectory() as folder:
            name = backend.prepare_metadata_for_build_wheel(folder)
            self.assertEqual(name, f"isonest-{VERSION}.dist-info")
            said = email.message_from_string((pathlib.Path(folder) / name / "METADATA").read_text(encoding="utf-8"))
        self.assertEqual((said["Name"], said["Version"], said.get_all("Requires-Dist")[0]), ("isonest", VERSION, "numpy>=1.20"))
        self.assertTrue(said.get_payload().startswith("# isonest for Python\n"))

    @unittest.skipUnless((ROOT / ".git").exists() and shutil.which("git"), "the list of files is git's")
    def test_the_source_archive_has_all_files_and_the_same_bytes(self):
        listed = set(run("git", "-C", ROOT, "ls-files", "-z", check=True).stdout.split("\0")) - {""}
        with tempfile.TemporaryDirectory() as folder:
            name = backend.build_sdist(folder)
            first = pathlib.Path(folder, name).read_bytes()
            backend.build_sdist(folder)
            self.assertEqual(pathlib.Path(folder, name).read_bytes(), first)
            with tarfile.open(pathlib.Path(folder, name)) as archive:
                members = {member.name.partition("/")[2]: member for member in archive}
                self.assertEqual({member.name.partition("/")[0] for member in members.values()}, {f"isonest-{VERSION}"})
                data = archive.extractfile(members["CMakeLists.txt"]).read()
        self.assertEqual(set(members), listed | {"PKG-INFO"})
        self.assertEqual(data, (ROOT / "CMakeLists.txt").read_bytes())
        self.assertTrue(members["tools/test"].mode & 0o100)
        self.assertFalse(members["README.md"].mode & 0o100)


@unittest.skipIf(MISSING, f"missing: {', '.join(MISSING)}")
class SmallWheel(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.folder = pathlib.Path(cls.enterClassContext(tempfile.TemporaryDirectory())) if hasattr(cls, "enterClassContext") \
            else pathlib.Path(tempfile.mkdtemp())
        cls.tree = cls.folder / "tree"
        package = cls.tree / "isonest"
        (package / "bin").mkdir(parents=True)
        (package / "__init__.py").write_text("raise ImportError('this package is not to be imported')\n")
        cls.compile(MODULE, package / "_core.cpython-311-x86_64-linux-gnu.so", "-shared", "-fPIC", "-llz4")
        flags = run("pkg-config", "--cflags", "--libs", "hdf5-serial", "cairo", check=True).stdout.split()
        cls.compile(PROGRAM, package / "bin/isonest", *flags, "-Wl,-rpath,/nowhere")
        cls.wheel, cls.libraries = cls.make(cls.tree, "first")
        cls.there = cls.folder / "unpacked"
        with zipfile.ZipFile(cls.wheel) as archive:
            cls.names = archive.namelist()
            cls.contents = {name: archive.read(name) for name in cls.names}
            cls.modes = {entry.filename: entry.external_attr >> 16 for entry in archive.infolist()}
            archive.extractall(cls.there)
        for name, mode in cls.modes.items():  # as pip does it
            (cls.there / name).chmod(mode & 0o777)
        cls.info = f"isonest-{VERSION}.dist-info/"

    @classmethod
    def compile(cls, source, made, *flags):
        file = cls.folder / "source.c"
        file.write_text(source)
        done = run("gcc", file, "-o", made, "-g", *flags)
        if done.returncode != 0:
            raise AssertionError(done.stderr)

    @classmethod
    def make(cls, tree, name):
        out = cls.folder / name
        out.mkdir()
        made, libraries = make_wheel.make(tree, out)
        return out / made, libraries

    def test_its_name_and_tag_agree(self):
        said = self.contents[self.info + "WHEEL"].decode()
        tag = re.search(r"^Tag: (.*)$", said, re.M)[1]
        self.assertEqual(self.wheel.name, f"isonest-{VERSION}-{tag}.whl")
        self.assertRegex(tag, rf"^cp311-cp311-manylinux_2_\d\d_{os.uname().machine}$")
        glibc = int(tag.split("_")[2])
        needed = {found for path in self.there.rglob("*") if path.is_file() and path.read_bytes()[:4] == b"\x7fELF"
                  for found in re.findall(r"GLIBC_2\.(\d+)", run("objdump", "-T", path, check=True).stdout)}
        self.assertGreaterEqual(glibc, max(map(int, needed)))
        self.assertLessEqual(glibc, int(os.confstr("CS_GNU_LIBC_VERSION").split(".")[1]))

    def test_record_lists_every_file(self):
        rows = [row.rsplit(",", 2) for row in self.contents[self.info + "RECORD"].decode().splitlines()]
        self.assertEqual(sorted(row[0] for row in rows), sorted(self.names))
        for name, digest, size in rows:
            if name.endswith("/RECORD"):
                self.assertEqual((digest, size), ("", ""))
            else:
                expected = base64.urlsafe_b64encode(hashlib.sha256(self.contents[name]).digest()).decode().rstrip("=")
                self.assertEqual((digest, int(size)), (f"sha256={expected}", len(self.contents[name])), name)
        self.assertEqual(self.names[-1], self.info + "RECORD")

    def test_libraries_are_renamed_and_the_systems_stay_out(self):
        inside = [name.partition("/")[2] for name in self.names if name.startswith("isonest.libs/")]
        self.assertGreater(len(inside), 8)
        for name in inside:
            self.assertRegex(name, r"^lib[\w+.-]+-[0-9a-f]{8}\.so[.\d]*$")
            said = run("readelf", "-d", self.there / "isonest.libs" / name, check=True).stdout
            self.assertIn(f"Library soname: [{name}]", said)
        self.assertTrue(any(name.startswith("liblz4-") for name in inside))
        self.assertTrue(any(name.startswith("libcurl-absent-") for name in inside))
        for name in ("libc", "libm", "libstdc++", "libX11", "libcurl", "libcrypto"):
            self.assertFalse([file for file in inside if re.match(re.escape(name) + r"-[0-9a-f]{8}\.", file)], name)

    def test_needed_libraries_are_inside_or_the_systems(self):
        for path in self.there.rglob("*"):
            if path.is_file() and path.read_bytes()[:4] == b"\x7fELF":
                said = run("readelf", "-d", path, check=True).stdout
                for name in re.findall(r"NEEDED.*\[(.*)\]", said):
                    self.assertTrue((self.there / "isonest.libs" / name).exists() or make_wheel.SYSTEM.fullmatch(name), (path, name))
                for where in re.findall(r"R(?:UN)?PATH.*\[(.*)\]", said):
                    self.assertEqual((path.parent / where.replace("$ORIGIN", ".")).resolve(),
                                     (self.there / "isonest.libs").resolve(), path)

    def test_no_file_names_the_build(self):
        for name, data in self.contents.items():
            self.assertNotIn(str(self.folder).encode(), data, name)
            self.assertNotIn(b"/nowhere", data, name)

    def test_module_and_program_work(self):
        module = self.there / "isonest" / "_core.cpython-311-x86_64-linux-gnu.so"
        done = run(sys.executable, "-c", "import ctypes, sys\nprint(ctypes.CDLL(sys.argv[1]).lz4())\n"
                   "print([line.split()[-1] for line in open('/proc/self/maps') if 'lz4' in line][0])", module)
        self.assertEqual(done.returncode, 0, done.stderr)
        version, path = done.stdout.split()
        self.assertGreater(int(version), 10000)
        self.assertEqual(pathlib.Path(path).parent, (self.there / "isonest.libs").resolve())
        # By the script, which pip installs with a first line that names its Python; the package is not imported.
        script = self.there / f"isonest-{VERSION}.data/scripts/isonest"
        self.assertTrue(script.read_bytes().startswith(b"#!python\n"))
        done = run(sys.executable, script, self.folder / "x.h5", "last word", env={**os.environ, "PYTHONPATH": str(self.there)})
        self.assertEqual((done.returncode, done.stdout, done.stderr), (3, "0 1 1 last word\n", ""))

    def test_what_is_absent_says_so(self):
        (absent,) = (self.there / "isonest.libs").glob("libcurl-absent-*")
        done = run(sys.executable, "-c", "import ctypes, sys\nctypes.CDLL(sys.argv[1]).Zurl_easy_init()", absent)
        self.assertEqual(done.returncode, -signal.SIGABRT)
        self.assertEqual(done.stderr, "isonest: curl_easy_init: the wheel has no libcurl.so.4\n")

    def stand_in_for(self, name, code, use):
        """Returns a stand-in for lib`name`.so, made from `code`, and the library made from `use` that calls it."""
        real, user = self.folder / f"lib{name}.so", self.folder / f"libuse_{name}.so"
        self.compile(code, real, "-shared", "-fPIC", f"-Wl,-soname,{real.name}")
        self.compile(use, user, "-shared", "-fPIC", f"-L{self.folder}", f"-l{name}")
        made = self.folder / f"absent_{name}"
        made.mkdir()
        return make_wheel.stand_in(real.name, [user], real, made), user

    def test_absent_data_are_zeros(self):
        made, user = self.stand_in_for("data", "int data[4] = {1, 2, 3, 4}; int other;",
                                       "extern int data[4]; int use(void) { return data[3]; }")
        symbols = make_wheel.symbols_of(made, True)
        self.assertEqual({name: of[2] for name, of in symbols.items()}, {"Zata": 16})
        self.assertIn("Zata", make_wheel.symbols_of(user, False))

    def test_an_absent_function_can_answer(self):
        library, _ = self.stand_in_for("jbig", "int jbg_dec_in(void) { return 0; }",
                                       "int jbg_dec_in(void); int use(void) { return jbg_dec_in(); }")
        self.assertEqual(ctypes.CDLL(str(library)).Zbg_dec_in(), 1)

    def test_a_library_without_a_package_is_refused(self):
        self.compile("int own(void) { return 1; }", self.folder / "libown.so", "-shared", "-fPIC", "-Wl,-soname,libown.so")
        tree = self.folder / "own"
        (tree / "isonest").mkdir(parents=True)
        self.compile("int own(void); int f(void) { return own(); }", tree / "isonest/_core.cpython-311-x86_64-linux-gnu.so",
                     "-shared", "-fPIC", f"-L{self.folder}", "-lown", f"-Wl,-rpath,{self.folder}")
        with self.assertRaisesRegex(WheelError, "libown.so is of no Debian package"):
            self.make(tree, "refused")

    def test_napari_finds_the_manifest(self):
        self.assertEqual(self.contents[self.info + "entry_points.txt"].decode().split("\n"),
                         ["[napari.manifest]", "isonest = isonest:napari.yaml", ""])

    def test_licences_are_inside(self):
        table = self.contents[self.info + "licenses/LIBRARIES.md"].decode()
        copied = [name for name in self.names if name.startswith("isonest.libs/") and "-absent-" not in name]
        for name in copied:
            row = next(line for line in table.splitlines() if f"| {name} |" in line)
            self.assertIn(f"{self.info}licenses/{row.split('|')[3].strip()}/copyright", self.names)
        self.assertEqual(len(copied), len(self.libraries))
        self.assertIn(b"isonest", self.contents[self.info + "licenses/LICENSE"])

    def test_permissions(self):
        self.assertEqual(self.modes["isonest/bin/isonest"], 0o100755)
        self.assertEqual(self.modes["isonest/__init__.py"], 0o100644)

    def test_equal_trees_make_equal_bytes(self):
        other = self.folder / "other name"
        shutil.copytree(self.tree, other, copy_function=shutil.copyfile)
        (other / "isonest/bin/isonest").chmod(0o700)
        (other / "isonest/__init__.py").chmod(0o600)
        os.utime(other / "isonest/__init__.py", (0, 0))
        again, _ = self.make(other, "second")
        self.assertEqual(again.name, self.wheel.name)
        with zipfile.ZipFile(again) as archive:
            self.assertEqual({name: archive.read(name) for name in archive.namelist()}, self.contents)
        self.assertEqual(again.read_bytes(), self.wheel.read_bytes())

    def test_the_systems_libraries_on_request(self):
        out = self.folder / "system"
        out.mkdir()
        name, libraries = make_wheel.make(self.tree, out, is_bundled=False)
        self.assertEqual((name, libraries), (f"isonest-{VERSION}-cp311-cp311-linux_{os.uname().machine}.whl", []))
        with zipfile.ZipFile(out / name) as archive:
            self.assertFalse([file for file in archive.namelist() if file.startswith("isonest.libs")])


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1])
