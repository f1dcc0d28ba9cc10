"""A place in memory for temporary folders.

The program waits until the disk has each output, which takes longer than a small run, above all beside other tests that
write. Tests that make many small outputs make them in `FOLDER`: TemporaryDirectory(dir=memory_folder.FOLDER). It is
None, the usual place, if TMPDIR is set or there is no memory for it. Tests of what happens while an output is written
stay on the disk.
"""
import os

_MEMORY = "/dev/shm"


def _is_usable():
    try:
        status = os.statvfs(_MEMORY)
    except OSError:
        return False
    return os.access(_MEMORY, os.W_OK | os.X_OK) and not status.f_flag & os.ST_NOEXEC and \
        status.f_bavail * status.f_frsize >= 2 << 30


FOLDER = _MEMORY if "TMPDIR" not in os.environ and _is_usable() else None
