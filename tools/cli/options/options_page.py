#!/usr/bin/env python3
"""Prints tools/OPTIONS.md, the page of all options, from the program's table of options.

usage: options_page.py ISONEST > tools/OPTIONS.md
"""
import json
import subprocess
import sys

HEAD = """# All options

The options of every command, and their arguments in [Python](python/README.md#what-the-program-does-from-python), where
most may also be None: a `choice` is one of the words that the option lists, a `Point` is three numbers, a `Box` two
points, `Bytes` a number or a string such as "512M", and `Headers` a dict or a list of strings. `make-volume`, `picture`
and `publish` have no function in Python. The [manual](MANUAL.md) says more; `isonest --help --json` prints this table.

`tools/cli/options/options_page.py` writes this page from `tools/cli/options/option_table.cpp`. Do not edit it.
"""


def commands_of(program):
    """The program's table: a list of commands, each with its options."""
    done = subprocess.run([program, "--help", "--json"], capture_output=True, text=True, check=True)
    return json.loads(done.stdout)["commands"]


def cell(text):
    return text.replace("|", "\\|")


def usage(option):
    """The option with the form of its value: `--keep-analysis[=FOLDER]`, `--error E|P%`."""
    form = option["value"]
    return option["name"] + (form if form.startswith("[=") else f" {form}" if form else "")


def argument(option):
    python = option["python"]
    return python["none"] if "none" in python else f"`{python['argument']}: {python['type']}`"


def page(commands):
    groups = {}
    for command in commands:
        for option in command["options"]:
            if "group" in option:
                row = (usage(option), argument(option), option["text"])
                groups.setdefault(option["group"], {}).setdefault(row, []).append(command["command"])
    text = HEAD
    for group, rows in groups.items():
        text += f"\n## {group}\n\n| option | | commands | in Python |\n|---|---|---|---|\n"
        for (option, python, words), names in sorted(rows.items(), key=lambda row: row[0][0]):
            named = "all" if len(names) == len(commands) else ", ".join(names)
            text += f"| `{cell(option)}` | {cell(words)} | {named} | {cell(python)} |\n"
    return text


if __name__ == "__main__":
    sys.stdout.write(page(commands_of(sys.argv[1])))
