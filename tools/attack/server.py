#!/usr/bin/env python3
"""Attacks the server of isonest view (tools/view/PROTOCOL.md): questions of every kind from several clients, and what is no question.

A try is one server, asked by up to eight clients at once:

    answers   some twenty questions that make sense; what comes is compared with what the library makes, number by number
    requests  a hundred that make little, with odd numbers, names and methods: statuses, bodies, and what it holds afterwards
    bytes     what is no request: flipped, cut, pipelined, smuggled, slow, half closed, gone
    strangers who is refused: hosts, origins, tokens, other users, and a page of another origin in a browser
    stores    the store is replaced, cut, deleted, unreadable or damaged under it
    long      all of it for --long seconds, with what the server holds, which may not grow (give --patience, too)
"""
import argparse
import pathlib
import subprocess
import sys

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent))
import attack  # noqa: E402

attack.require("numpy")

from serving import answers, long, requests, strangers, stores, wire  # noqa: E402

KINDS = {"answers": answers.attack, "requests": requests.attack, "bytes": wire.attack, "strangers": strangers.attack,
         "stores": stores.attack, "long": long.attack}


def require_viewer():
    parser = argparse.ArgumentParser(add_help=False)
    parser.add_argument("--isonest", default=attack.ROOT / "build/bin/isonest")
    program = parser.parse_known_args()[0].isonest
    if pathlib.Path(program).exists() and subprocess.run([program, "view", "--help"], capture_output=True).returncode != 0:
        print("skipped: this build has no isonest view")
        sys.exit(77)


def more(parser):
    parser.add_argument("--long", type=long.set_seconds, metavar="SECONDS", help="of one try of the kind long (2)")


if __name__ == "__main__":
    require_viewer()
    sys.exit(attack.main(__doc__, KINDS, more))
