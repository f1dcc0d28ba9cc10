#!/usr/bin/env python3
"""Attacks isonest by the limits of the machine: disk, memory, descriptors, threads, permissions, streams, signals,
names.

Each try runs one command on small inputs, with one limit of random size or one disturbance at a random moment. It is
judged by rules: the exit code is one that `isonest --help` lists and fits the cause, never 1, and the program never
dies by a signal that was not sent; there is one message; the output has the bytes of an undisturbed run or does not
exist; existing files and the inputs are unchanged; no temporary file remains, except after SIGKILL or a second signal,
and then the next run names it.

"refused" counts the runs that ended with an error; --reasons lists the exit codes. Kinds that need root (disk, threads,
permission) count as refused without it.
"""
import os
import sys
import tempfile

import attack
from limiting import endings, resources, surroundings, tries

KINDS = {"disk": resources.disk, "heap": resources.heap, "address_space": resources.address_space, "descriptors": resources.descriptors,
         "threads": resources.threads, "stack": resources.stack, "file_size": resources.file_size, "cpu": resources.cpu,
         "permission": surroundings.permission, "streams": surroundings.streams, "signals": endings.signals, "kill": endings.kill,
         "environment": surroundings.environment, "names": surroundings.names}

if __name__ == "__main__":
    with tempfile.TemporaryDirectory(prefix="isonest-limits-") as made:
        os.chmod(made, 0o755)
        tries.shared_folder = made
        sys.exit(attack.main(__doc__, KINDS))
