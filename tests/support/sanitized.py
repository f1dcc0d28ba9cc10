"""Whether a program is built with a sanitizer, so that its memory and time are not those of the program."""
import pathlib
import re


def is_sanitized(program):
    return re.search(b"__[at]san_init", pathlib.Path(program).read_bytes()) is not None
