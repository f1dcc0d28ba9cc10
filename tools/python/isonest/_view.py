"""Shows a store in the browser, with the program ``isonest view`` as a child process."""
from __future__ import annotations

import functools
import html
import json
import os
import pathlib
import re
import shutil
import subprocess
import sys
import tempfile
import threading
import warnings
import weakref
import webbrowser
from typing import IO, Any, Optional

from . import _errors
from ._arguments import Bytes, to_bytes, to_cache

_BESIDE = pathlib.Path(os.path.abspath(__file__)).parent / "bin" / "isonest"
"""Location of the program in a wheel or a build tree, where this source file is a symbolic link."""
_PATIENCE = 5.0
"""Seconds to wait for the program to end before it is killed."""
_OPTION = re.compile(r"--(port|memory|threads) ?")
_ERRORS = {"invalid_argument": _errors.InvalidArgumentError, "not_found": _errors.NotFoundError,
           "corrupt": _errors.CorruptError, "unsupported": _errors.UnsupportedError, "io": _errors.InputOutputError,
           "limit": _errors.LimitError, "cancelled": _errors.CancelledError}


class View:
    """A running ``isonest view``, which shows a store to this machine's browsers; see :meth:`isonest.Store.view`.

    In a notebook, a view that is the last expression of a cell is shown below it. The program ends on :meth:`close`, at
    the end of a ``with`` block, when the view is garbage-collected, and with this process. Keep a reference to the view
    while it is in use.
    """

    def __init__(self, process: "subprocess.Popen[bytes]", errors: "IO[bytes]", store: str, url: str,
                 height: int) -> None:
        self._process = process
        self._errors = errors
        self._store = store
        self._url = url
        self._height = height
        self._end = weakref.finalize(self, _end, process, errors, os.getpid())

    @property
    def url(self) -> str:
        """The URL of the page, including the token that the server requires."""
        return self._url

    @property
    def closed(self) -> bool:
        """Whether the program has ended."""
        return self._process.poll() is not None

    def close(self) -> None:
        """Ends the program; open pages then show that. Does nothing if it has already ended."""
        self._end()

    def wait(self) -> None:
        """Waits until the program has ended; Ctrl-C ends it. For scripts that only show a store.

        Raises an :class:`isonest.Error` if the program failed.
        """
        try:
            code = self._process.wait()
        except KeyboardInterrupt:
            self.close()
            return
        if code != 0 and self._process.stdout is not None and not self._process.stdout.closed:
            error = _failure("isonest view", code, self._process.stdout.read(), self._errors)
            self.close()
            raise error

    def __enter__(self) -> "View":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def __repr__(self) -> str:
        return f"<isonest.View of {self._store!r}{', closed' if self.closed else f' at {self._url}'}>"

    def _repr_html_(self) -> str:
        if self.closed:
            return f"<p>{html.escape(repr(self))}</p>"
        url, name = html.escape(self._url), html.escape(self._store.rpartition("/")[2])
        return (f'<iframe src="{url}" title="isonest: {name}" width="100%" height="{self._height}" '
                f'style="border: 0" allow="clipboard-write"></iframe>'
                f'<p><a href="{url}" target="_blank" rel="noopener">{name} in a tab of its own</a></p>')


def start(store: "os.PathLike[str] | str", *, shown: str, port: int, memory: Bytes, threads: int, open: Optional[bool],
          height: int, program: "os.PathLike[str] | str | None", headers: "Optional[list[str]]" = None,
          cache: "os.PathLike[str] | str | None" = None) -> View:
    """Implements :meth:`isonest.Store.view`. ``headers``: None for a file."""
    for name, number, least, most in (("port", port, 0, 65535), ("threads", threads, 0, 4096),
                                      ("height", height, 1, 100_000)):
        if not least <= number <= most:
            raise ValueError(f"{name}={number!r}: give a number from {least} to {most}")
    location = os.path.abspath(store) if headers is None else os.fspath(store)
    found = _find_program(program)
    command = [*_ending_with_us(), found, "view", location, "--json", "--token", "--port", str(int(port)),
               "--memory", str(to_bytes(memory)), "--threads", str(int(threads))]
    if cache:
        command += ["--cache", "{}:{}".format(*to_cache(cache))]
    errors = tempfile.TemporaryFile()
    # Headers are not passed on the command line, which other users can see.
    secrets = tempfile.TemporaryFile()
    if headers:
        secrets.write("\n".join(headers).encode())
        secrets.flush()
        command += ["--header", f"@/dev/fd/{secrets.fileno()}"]
    try:
        # start_new_session: Ctrl-C in a terminal, or a notebook's "interrupt", must not end the program.
        process = subprocess.Popen(command, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=errors,
                                   start_new_session=True, pass_fds=[secrets.fileno()] if headers else [])
    except BaseException:
        errors.close()
        raise
    finally:
        secrets.close()
    try:
        url = _url(process, found, errors)
    except BaseException:
        _end(process, errors, os.getpid())
        raise
    view = View(process, errors, shown if headers is not None else location, url, int(height))
    if (not _in_notebook() if open is None else open) and not webbrowser.open(url):
        warnings.warn(f"cannot open a browser; open {url} yourself", RuntimeWarning, stacklevel=3)
    return view


def _url(process: "subprocess.Popen[bytes]", program: str, errors: "IO[bytes]") -> str:
    """The URL in the program's first line of output; raises the error that the program reports instead."""
    assert process.stdout is not None
    line = process.stdout.readline()
    try:
        return str(json.loads(line)["url"])
    except (ValueError, KeyError, TypeError):
        pass
    rest = process.stdout.read()
    raise _failure(program, process.wait(), line + rest, errors)


def _end(process: "subprocess.Popen[bytes]", errors: "IO[bytes]", owner: int) -> None:
    """Ends the program, unless called in a process forked from its owner."""
    if os.getpid() != owner:
        return
    if process.poll() is None:
        process.terminate()
        try:
            process.wait(_PATIENCE)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()
    if process.stdout is not None:
        process.stdout.close()
    errors.close()


def _find_program(program: "os.PathLike[str] | str | None") -> str:
    by = "program=" if program is not None else "the environment variable ISONEST"
    named = os.fspath(program) if program is not None else os.environ.get("ISONEST") or None
    found = shutil.which(named) if named is not None else shutil.which(str(_BESIDE)) or shutil.which("isonest")
    if found:
        return found
    if named is not None:
        raise _errors.made(_errors.NotFoundError, named, f"there is no such program; {by} names it")
    raise _errors.made(_errors.NotFoundError, "isonest", "the program isonest is neither in this package nor on the PATH", ["install it (Debian: the package isonest, which a build of the project makes)",
                                 "name it with program= or the environment variable ISONEST"])


@functools.lru_cache(maxsize=None)
def _setpriv() -> "list[str]":
    """A command prefix that makes Linux end the command with the thread that started it; empty if not available."""
    command = ["setpriv", "--pdeathsig", "TERM"]
    try:
        works = subprocess.run([*command, "true"], stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL,
                               stderr=subprocess.DEVNULL, check=False).returncode == 0
    except OSError:
        works = False
    return command if works else []


def _ending_with_us() -> "list[str]":
    """A prefix that ends the program if this process is killed. Empty in other threads, as they may end earlier."""
    return _setpriv() if threading.current_thread() is threading.main_thread() else []


def _in_notebook() -> bool:
    """Whether this process is the kernel of a notebook."""
    ipython = sys.modules.get("IPython")
    shell = ipython.get_ipython() if ipython is not None else None
    return getattr(shell, "kernel", None) is not None


def _failure(program: str, code: int, out: bytes, errors: "IO[bytes]") -> _errors.Error:
    """The exception for a program that failed: from its last JSON, otherwise from its standard error."""
    begin = out.find(b'{\n  "error"')
    try:
        return _told(json.loads(out[max(begin, 0):])["error"])
    except (ValueError, KeyError, TypeError):
        errors.seek(0)
        text = errors.read().decode(errors="replace").strip()
        how = f"ended by signal {-code}" if code < 0 else f"ended with exit code {code}"
        return _errors.made(_errors.InputOutputError, program, how + (f": {text}" if text else ""))


def _told(error: "dict[str, Any]") -> _errors.Error:
    """Converts an error of the program to an exception that names this package's arguments."""
    kind, message, file = error["kind"], error["message"], error["file"]
    for remedy in error["remedies"][:1]:
        message = re.split("(?:; |\n)" + re.escape(remedy["text"]), message)[0]
    if kind == "invalid_argument" and message.startswith("there is no command 'view'"):
        return _errors.made(_errors.UnsupportedError, "isonest", "this build of the program cannot show a store",
                      ["run tools/install-deps and build it again"])
    remedies = [f"give memory={remedy['value']} or more" if remedy["kind"] == "more_memory" and remedy["value"]
                else _OPTION.sub(r"\1=", remedy["text"]) for remedy in error["remedies"]]
    about_memory = any(remedy["kind"] in ("more_memory", "less_memory") for remedy in error["remedies"])
    chosen = _errors.MemoryLimitError if kind == "limit" and about_memory else _ERRORS.get(kind, _errors.Error)
    place = f"{file}: " if file else ""
    return _errors.made(chosen, file, _OPTION.sub(r"\1=", message[len(place):] if message.startswith(place) else message),
                  remedies, error["inside"])
