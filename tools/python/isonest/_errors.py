"""The exceptions of isonest. Each is also one of Python's own that fits."""
from __future__ import annotations


class Error(Exception):
    """What all errors of isonest have in common."""

    file: str = ""
    """The file, or what was asked for where there is none; may be empty."""
    inside: str = ""
    """The place in the file; may be empty."""
    problem: str = ""
    """The message without the place and without what can be done."""
    remedies: tuple[str, ...] = ()
    """What can be done, the most likely first."""


class InvalidArgumentError(Error, ValueError):
    """The request makes no sense; nothing was touched."""


class NotFoundError(Error, FileNotFoundError):
    """A file, dataset, level or field that is not there."""


class CorruptError(Error, ValueError):
    """Bytes that contradict their own format or checksum."""


class UnsupportedError(Error, NotImplementedError):
    """Well formed, but nothing that this version can do."""


class InputOutputError(Error, OSError):
    """The operating system or a library refused a read or a write."""


class LimitError(Error, RuntimeError):
    """The work needs a larger format, or more of something, than there is."""


class MemoryLimitError(LimitError, MemoryError):
    """The work needs more memory than ``memory=`` allows. ``remedies`` names what is enough."""


class CancelledError(Error, KeyboardInterrupt):
    """The work was interrupted."""
