#!/usr/bin/env python3
"""Attacks the server of isonest view (tools/view/PROTOCOL.md) with senseless requests and with bytes that are no
request.

A try is one server with up to eight clients at once:

    requests  a hundred senseless ones, with odd numbers, names and methods; checks status, body and the resources that
              the server holds afterwards
    bytes     invalid requests: flipped, truncated, pipelined, smuggled, slow, half closed, aborted
"""
import argparse
import pathlib
import subprocess
import sys

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent))
import attack  # noqa: E402

attack.require("numpy")

from serving import requests, wire  # noqa: E402

KINDS = {"requests": requests.attack, "bytes": wire.attack}


def require_viewer():
    parser = argparse.ArgumentParser(add_help=False)
    parser.add_argument("--isonest", default=attack.ROOT / "build/bin/isonest")
    program = parser.parse_known_args()[0].isonest
    if pathlib.Path(program).exists() and subprocess.run([program, "view", "--help"], capture_output=True).returncode != 0:
        print("skipped: this build has no isonest view")
        sys.exit(77)


if __name__ == "__main__":
    require_viewer()
    sys.exit(attack.main(__doc__, KINDS))
