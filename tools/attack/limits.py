#!/usr/bin/env python3
"""Attacks isonest by the limits of the machine: disk, memory, descriptors, threads, permissions, streams, signals, names.

Each try runs one command on small inputs, with one limit at a random size or one disturbance at a random moment. The judge is
a set of rules: an exit code that `isonest --help` lists and that fits the cause, never 1 and never a signal that was not sent;
one message; an output that has the bytes of an undisturbed run or is not there; what was there before, and the inputs, as they
were; no temporary file left, but by SIGKILL and by a second signal, and then the next run names it.

"refused" counts the runs that ended with an error; --reasons has the exit codes. Kinds that need root (disk, threads,
permission) count as refused where that is missing.
"""
import os
import sys
import tempfile

import attack
from limiting import endings, resources, surroundings, tries, viewing

KINDS = {"disk": resources.disk, "heap": resources.heap, "address_space": resources.address_space, "descriptors": resources.descriptors,
         "threads": resources.threads, "stack": resources.stack, "file_size": resources.file_size, "cpu": resources.cpu,
         "permission": surroundings.permission, "streams": surroundings.streams, "signals": endings.signals, "kill": endings.kill,
         "environment": surroundings.environment, "names": surroundings.names, "viewer": viewing.viewer}

if __name__ == "__main__":
    with tempfile.TemporaryDirectory(prefix="isonest-limits-") as made:
        os.chmod(made, 0o755)
        tries.shared_folder = made
        sys.exit(attack.main(__doc__, KINDS))
