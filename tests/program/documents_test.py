"""The documents: links lead somewhere, and the program has the options that are mentioned.

usage: documents_test.py ISONEST PLUGIN_FOLDER
"""
import pathlib
import re
import subprocess
import sys

ROOT = pathlib.Path(__file__).resolve().parents[2]
FENCE = re.compile(r"^ *```")
faults = []


def anchors(path):
    """Anchors as GitHub makes them from headings."""
    found, code = set(), False
    for line in path.read_text(encoding="utf-8").splitlines():
        code ^= bool(FENCE.match(line))
        if not code and re.match(r"#+ ", line):
            text = re.sub(r"[^\w\- ]", "", line.lstrip("#").strip().lower())
            found.add(text.replace(" ", "-"))
    return found


documents = [p for p in sorted(ROOT.rglob("*.md"))
             if not any(part.startswith((".", "build", "quickstart-out", "node_modules")) for part in p.relative_to(ROOT).parts)]
for document in documents:
    name = document.relative_to(ROOT).as_posix()
    text = document.read_text(encoding="utf-8")
    if not re.match(r"# \S", text):
        faults.append(f"{name}: the first line is no title")
    for target in re.findall(r"\]\(([^)\s]+)\)", text):
        if re.match(r"[a-z]+:", target):
            continue
        file, _, anchor = target.partition("#")
        other = (document.parent / file).resolve() if file else document
        if not other.exists():
            faults.append(f"{name}: no such file: {target}")
        elif anchor and anchor not in anchors(other):
            faults.append(f"{name}: no such heading: {target}")

isonest = sys.argv[1]
commands = re.findall(r"^  ([a-z-]+)  ", subprocess.run([isonest, "--help"], check=True, text=True,
                                                        stdout=subprocess.PIPE).stdout, re.M)
known = set()
for command in ["", *commands]:
    shown = subprocess.run([isonest, *filter(None, [command]), "--help"], check=True, text=True,
                           stdout=subprocess.PIPE).stdout
    known |= set(re.findall(r"--[a-z-]+", shown))
if len(commands) < 5:
    faults.append(f"the program's help names the commands {commands}")
for document in (ROOT / "README.md", ROOT / "tools/MANUAL.md"):
    for paragraph in document.read_text(encoding="utf-8").split("\n\n"):
        if re.search(r"cmake |pkg-config |tools/(bench|figures|install-deps|test)|put-bucket-cors|bwrap ", paragraph):
            continue  # other programs' options
        for option in set(re.findall(r"--[a-z][a-z-]+", paragraph)) - known:
            faults.append(f"{document.relative_to(ROOT)}: the program has no {option}: {paragraph}")

print("\n".join(faults) or f"{len(documents)} documents")
sys.exit(1 if faults else 0)
