"""Whether a program is built with a sanitizer, whose memory and time say nothing of the program's own."""
import pathlib
import re


def is_sanitized(program):
    return re.search(b"__[at]san_init", pathlib.Path(program).read_bytes()) is not None
