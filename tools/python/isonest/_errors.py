"""The exceptions of isonest. Each also derives from a suitable built-in exception."""
from __future__ import annotations

from typing import Sequence


class Error(Exception):
    """Base class of all exceptions of isonest."""

    file: str = ""
    """The file, or the name given by the caller if there is no file; may be empty."""
    inside: str = ""
    """The position in the file; may be empty."""
    problem: str = ""
    """The message without position and remedies."""
    remedies: tuple[str, ...] = ()
    """Suggested remedies, most likely first."""


class InvalidArgumentError(Error, ValueError):
    """An invalid argument or combination of arguments; no file was changed."""


class NotFoundError(Error, FileNotFoundError):
    """A file, dataset, level or field does not exist."""


class CorruptError(Error, ValueError):
    """Data that violate their format or do not match their checksum."""


class UnsupportedError(Error, NotImplementedError):
    """A valid request or file that this version does not support."""


class InputOutputError(Error, OSError):
    """Reading or writing failed in the operating system or a library."""


class LimitError(Error, RuntimeError):
    """A limit of the format or the system is exceeded."""


class MemoryLimitError(LimitError, MemoryError):
    """The work needs more memory than ``memory=`` allows. ``remedies`` contains the minimum required."""


class CancelledError(Error, KeyboardInterrupt):
    """The work was interrupted."""


def made(kind: "type[Error]", file: str, problem: str, remedies: "Sequence[str]" = (), inside: str = "") -> Error:
    """An exception with all its attributes, and a message made from them."""
    advice = "; " + ", or ".join(remedies) if remedies else ""
    error = kind(f"{file}: {problem}{advice}" if file else problem + advice)
    error.file, error.inside, error.problem, error.remedies = file, inside, problem, tuple(remedies)
    return error
