"""The documents: links lead somewhere, the program has the options that are mentioned, with the values that are
mentioned, and OPTIONS.md is the program's table of options.

usage: documents_test.py ISONEST PLUGIN_FOLDER
"""
import pathlib
import re
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

sys.path.insert(0, str(ROOT / "tools/cli/options"))
import options_page  # noqa: E402

table = options_page.commands_of(sys.argv[1])
forms = {}  # of the value of each option, in all commands
for command in table:
    for option in command["options"]:
        forms.setdefault(option["name"], set()).add(option["value"])
if len(table) < 5 or "--error" not in forms:
    faults.append(f"the program's table has the commands {[command['command'] for command in table]}")
mentioned = 0
for document in (ROOT / "README.md", ROOT / "tools/MANUAL.md"):
    name = document.relative_to(ROOT)
    for paragraph in document.read_text(encoding="utf-8").split("\n\n"):
        if re.search(r"cmake |pkg-config |tools/(bench|figures|install-deps|test)|put-bucket-cors|bwrap ", paragraph):
            continue  # other programs' options
        for option in set(re.findall(r"--[a-z][a-z-]+", paragraph)) - forms.keys() - {"--version"}:
            faults.append(f"{name}: the program has no {option}: {paragraph}")
        # The form of a value, in capitals or as a list of choices: `--min-volume V`, `--frame ras|lps`.
        for span in re.findall(r"`([^`\n]+)`", paragraph):
            for option, form in re.findall(r"(--[a-z-]+)[ =]?((?:\[=)?[A-Z][A-Z,:\[\]]*|[a-z]+(?:\|[a-z]+)+)(?![\w.])", span):
                mentioned += 1
                if option in forms and not any(form in known for known in forms[option]):
                    faults.append(f"{name}: the value of {option} has the form {forms[option]}: {span}")
if mentioned < 20:
    faults.append(f"only {mentioned} values of options were recognised")

page = ROOT / "tools/OPTIONS.md"
if not any(command["command"] == "view" for command in table):
    print("tools/OPTIONS.md was not compared: this build has no viewer")
elif options_page.page(table) != page.read_text(encoding="utf-8"):
    faults.append(f"tools/OPTIONS.md is not the program's table: {options_page.__file__} ISONEST > {page}")

# Every section of RESULTS.md that has a table says with which version it was measured, none older than the last release:
# the second version in CHANGES.md, whose first one is this one.
sys.path.insert(0, str(ROOT / "tools/bench"))
import tables  # noqa: E402

releases = re.findall(r"^## (\d+\.\d+\.\d+)$", (ROOT / "CHANGES.md").read_text(encoding="utf-8"), re.M)
numbers = lambda text: tuple(map(int, text.split(".")))
if releases[0] != tables.version() or sorted(releases, key=numbers, reverse=True) != releases:
    faults.append(f"CHANGES.md has the versions {releases}; this is {tables.version()}")
results = tables.RESULTS.read_text(encoding="utf-8")
current = 0
for section in re.split(r"^(?=##+ )", results, flags=re.M):
    title, tables_of_others = section.partition("\n")[0], tables.BLOCK.sub("", section)
    found = tables.BLOCK.findall(section)
    parts = [body for _, _, body in found] + [tables_of_others] * ("\n|---" in tables_of_others and title != "## The programs")
    for part in parts:
        which = tables.MEASURED.search(part)
        if not which:
            faults.append(f"RESULTS.md, {title}: no line says with which version its table was measured")
        elif numbers(which.group(1)) < numbers(releases[1]):
            faults.append(f"RESULTS.md, {title}: measured with {which.group(1)}, which is older than {releases[1]}: "
                          "tools/bench/run --update")
        else:
            current += 1
    for name, command, _ in found:
        for program in re.findall(r"tools/bench/[\w./]+", command):
            if not (ROOT / program).is_file():
                faults.append(f"RESULTS.md, table {name}: no such program: {program}")
if current < 10:
    faults.append(f"only {current} tables of RESULTS.md were recognised")

print("\n".join(faults) or f"{len(documents)} documents")
sys.exit(1 if faults else 0)
