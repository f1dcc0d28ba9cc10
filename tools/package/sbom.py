#!/usr/bin/env python3
"""Writes a list of isonest's components, as CycloneDX 1.4 (JSON), to standard output.

usage: sbom.py

The libraries are those of DEPENDENCIES.md. The version is that of the installed Debian package; if it is not installed,
that of the document for this release of Debian.
"""
import json
import pathlib
import platform
import re
import subprocess
import sys

HERE = pathlib.Path(__file__).resolve().parent
HEADER = re.compile(r"\| library \| (Debian's|npm's) package \|")


def libraries():
    """Yields (kind, name, package, version, licence, reads, left out by) of each row; kind: "Debian's" or "npm's"."""
    kind = None
    for line in (HERE / "DEPENDENCIES.md").read_text().splitlines():
        found = HEADER.match(line)
        if found:
            kind = found[1]
        elif not line.startswith("|"):
            kind = None
        elif kind and not line.startswith("|---"):
            yield (kind, *(cell.strip() for cell in line.strip("|").split("|")))


def installed(package):
    """The version of Debian's package, or None."""
    try:
        done = subprocess.run(["dpkg-query", "-W", "-f", "${db:Status-Status} ${Version}", package], capture_output=True, text=True)
    except FileNotFoundError:
        return None
    status, _, version = done.stdout.partition(" ")
    return version if status == "installed" else None


def debian():
    """The code name of this machine's release, or of the oldest in the document."""
    try:
        return platform.freedesktop_os_release()["VERSION_CODENAME"]
    except (OSError, KeyError):
        return "bookworm"


def own_version():
    """isonest's own, from its one place."""
    return re.search(r"project\(isonest VERSION (\S+)", (HERE.parents[1] / "CMakeLists.txt").read_text())[1]


def debian_url(package, version):
    return f"pkg:deb/debian/{package}@{version}?distro={debian()}"


def part(name, version, url, licence):
    return {"type": "library", "name": name, "version": version, "purl": url.replace("+", "%2B"), "licenses": [licence]}


def component(kind, name, package, version, licence):
    if kind == "Debian's":
        found = installed(package)
        of_releases = version.split(", ")
        version = found or of_releases[-1 if debian() == "trixie" else 0]
        url = debian_url(package, version)
    else:
        url = f"pkg:npm/{package}@{version}"
    return part(name, version, url, {"expression": licence.replace(" or ", " OR ")} if " or " in licence
                else {"license": {"name": licence}})


def document(components):
    return {"bomFormat": "CycloneDX", "specVersion": "1.4", "version": 1,
            "metadata": {"component": {"type": "application", "name": "isonest", "version": own_version(),
                                       "licenses": [{"license": {"id": "MIT"}}]}},
            "components": components}


def main():
    made = document([component(*row[:5]) for row in libraries()])
    json.dump(made, sys.stdout, indent=2, ensure_ascii=False)
    print()


if __name__ == "__main__":
    main()
