"""tools/package/DEPENDENCIES.md: every library that is linked, installed for the build or locked for the page has a
row, with its version.

usage: dependencies_test.py ISONEST PLUGIN_FOLDER
"""
import collections
import json
import pathlib
import re
import subprocess
import sys
import unittest

ROOT = pathlib.Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "tools" / "package"))
import sbom  # noqa: E402

sys.path.insert(0, str(ROOT / "tests"))
from support.sanitized import is_sanitized  # noqa: E402

BUILD = pathlib.Path(sys.argv[1]).resolve().parent.parent
ROWS = list(sbom.libraries())
DEBIAN = {row[2]: row[3] for row in ROWS if row[0] == "Debian's"}
# Versions in the rows: Debian 12's, then Debian 13's; or one for both.
RELEASES = ["bookworm", "trixie"]
# Build tools, and what comes with the system's compiler.
TOOLS = {"g++", "cmake", "ninja-build", "pkg-config"}
TESTS_ALONE = {"catch2"}
SYSTEM = {"gcc-12", "gcc-14", "glibc"}


def sources_of(packages):
    """Debian's source package of each package that is installed."""
    done = subprocess.run(["dpkg-query", "-W", "-f", "${Package} ${source:Package}\n", *packages], capture_output=True, text=True)
    return dict(line.split() for line in done.stdout.splitlines())


def upstream(version):
    """The upstream part of a Debian version."""
    version = re.sub(r"^\d+:|-[^-]*$", "", version)
    if "+really" in version:
        version = version.partition("+really")[2]
    return re.sub(r"^\d+:|-[^-]*$|\+.*$|~.*$", "", version)


def release():
    """The code name of this Debian release, if the rows cover it."""
    text = pathlib.Path("/etc/os-release")
    found = re.search(r"^VERSION_CODENAME=(\w+)", text.read_text(), re.M) if text.exists() else None
    return found[1] if found and found[1] in RELEASES else None


class Dependencies(unittest.TestCase):
    def test_every_row_is_whole(self):
        self.assertGreater(len(ROWS), 20)
        for row in ROWS:
            self.assertEqual(len(row), 7, row)
            self.assertTrue(all(row), row)

    def test_packages_for_the_build_have_rows(self):
        text = (ROOT / "tools" / "install-deps").read_text()
        packages = set(re.search(r"^packages=\((.*?)\)", text, re.S | re.M)[1].split())
        rows = set(DEBIAN)
        self.assertEqual(packages - TOOLS - TESTS_ALONE - rows, set())
        self.assertEqual([name for name in rows if name not in text], [])

    def test_options_are_those_of_the_build(self):
        text = (ROOT / "CMakeLists.txt").read_text() + (ROOT / "tools/CMakeLists.txt").read_text()
        for row in ROWS:
            options, libraries = re.findall(r"`-DISONEST_(\w+)=OFF`", row[6]), re.findall(r"`(\w+)`", row[6])
            self.assertTrue(options or libraries or row[6].startswith("no"), row)
            for option in options:
                self.assertRegex(text, rf"ISONEST_{option}\b")
            for library in libraries:
                self.assertRegex(text, rf"isonest_(?:format_library|source_library|find_module)\({library}\b"
                                       rf"|isonest_module\(\w+ {library}\b|find_package\({library}\b|FIND_PACKAGE_{library}\b")

    def test_the_page_has_its_packages(self):
        locked = json.loads((ROOT / "tools/view/web/package-lock.json").read_text())["packages"]
        expected = {name.removeprefix("node_modules/"): (of["version"], of["license"]) for name, of in locked.items()
                    if name and not of.get("dev") and not of.get("optional")}
        self.assertEqual({row[2]: (row[3], row[4]) for row in ROWS if row[0] == "npm's"}, expected)

    @unittest.skipUnless(release(), "the versions are Debian 12's and 13's")
    def test_versions_are_those_installed(self):
        for package, version in DEBIAN.items():
            found = sbom.installed(package)
            if found:
                versions = version.split(", ")
                expected = versions[RELEASES.index(release())] if len(versions) > 1 else version
                self.assertTrue(upstream(found).startswith(expected), f"{package}: {found}, not {expected}")

    @unittest.skipUnless(release(), "asks dpkg")
    @unittest.skipIf(is_sanitized(sys.argv[1]), "clang links what a library that it uses names, too")
    def test_what_is_linked_has_a_row(self):
        files = [BUILD / "bin/isonest", BUILD / "bin/isonest-mpi", *(BUILD / "lib/isonest").glob("*.so"),
                 *(BUILD / "python/isonest").glob("*.so")]
        needed = {}
        for file in filter(pathlib.Path.exists, files):
            dynamic = subprocess.run(["readelf", "-d", file], capture_output=True, text=True, check=True).stdout
            for library in re.findall(r"NEEDED.*\[(.*)\]", dynamic):
                needed[library] = file
        self.assertIn("libc.so.6", needed)
        # One line for each file of that name: PACKAGES: PATH.
        owners = collections.defaultdict(set)
        found = subprocess.run(["dpkg-query", "-S", *(f"*/{library}" for library in needed)], capture_output=True, text=True)
        for line in found.stdout.splitlines():
            packages, _, path = line.partition(": ")
            if not packages.startswith("diversion by"):
                owners[path.rsplit("/", 1)[-1]] |= {package.split(":")[0] for package in packages.split(", ")}
        sources = sources_of({*DEBIAN, *(package for of in owners.values() for package in of)})
        # Imath is part of OpenVDB's row.
        known = {sources.get(package) for package in DEBIAN} | SYSTEM | {"imath"}
        for library, file in needed.items():
            self.assertTrue({sources.get(package) for package in owners[library]} & known, f"{file}: {library}")

    def test_cyclonedx_has_every_library(self):
        made = json.loads(subprocess.run([ROOT / "tools/package/sbom.py"], capture_output=True, text=True, check=True).stdout)
        self.assertEqual((made["bomFormat"], made["specVersion"]), ("CycloneDX", "1.4"))
        self.assertEqual([part["name"] for part in made["components"]], [row[1] for row in ROWS])
        for part in made["components"]:
            self.assertRegex(part["purl"], r"^pkg:(deb/debian|npm)/[\w.%+-]+@[\w.:%~+-]+(\?distro=[\w.]+)?$")


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1])
