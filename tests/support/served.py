"""Runs the program many times without loading it each time, which takes longer than most runs.

served.run(COMMAND, ...) is like subprocess.run(COMMAND, ...) for a program of the build tree and the options below. The
program is loaded once, waits, and runs each command in a process forked from it (serve_program.cpp). Standard output
and error are files, not pipes. Use subprocess if a new process is needed: for signals, limits, input through a pipe,
events while the program is loaded, and environment variables that the loader or a library reads before main(). If the
serving library is not built (sanitizers), this is subprocess.run.

MEMORY is a folder in memory for TemporaryDirectory(dir=served.MEMORY): the program waits until the disk has each output,
which takes longer than most runs, above all beside other tests that write. None, the usual place, if TMPDIR is set or
there is too little memory. Tests of what happens while an output is written stay on the disk.
"""
import array
import os
import pathlib
import signal
import socket
import struct
import subprocess
import threading


def _memory(folder="/dev/shm"):
    try:
        status = os.statvfs(folder)
    except OSError:
        return None
    usable = os.access(folder, os.W_OK | os.X_OK) and not status.f_flag & os.ST_NOEXEC
    return folder if usable and status.f_bavail * status.f_frsize >= 2 << 30 else None


MEMORY = None if "TMPDIR" in os.environ else _memory()
_servers = {}
_lock = threading.Lock()


def _library(program):
    return pathlib.Path(program).resolve().parent.parent / "tests" / "libisonest_serve.so"


def _server(program, preload):
    program = os.path.abspath(program)
    key = os.getpid(), program, preload
    if key not in _servers:
        ours, its = socket.socketpair()
        with its:
            environment = {**os.environ, "LD_PRELOAD": f"{_library(program)} {preload}", "LD_BIND_NOW": "1",
                           "ISONEST_SERVE": str(its.fileno())}
            process = subprocess.Popen([program], env=environment, pass_fds=[its.fileno()], stdin=subprocess.DEVNULL,
                                       stdout=subprocess.DEVNULL, cwd="/")
        _servers[key] = ours, process  # the end of the first ends the second
    return _servers[key][0]


def _number(server):
    data = server.recv(4, socket.MSG_WAITALL)
    if len(data) < 4:
        raise RuntimeError("the program that serves has ended")
    return struct.unpack("i", data)[0]


def _served(command, files, cwd, env, timeout):
    """The exit code, as subprocess gives it."""
    words = [*command, os.path.abspath(cwd or "."), *(f"{name}={value}" for name, value in env.items())]
    text = b"".join(os.fsencode(word) + b"\0" for word in words)
    with _lock:
        server = _server(command[0], env.get("LD_PRELOAD", ""))
        os.umask(mask := os.umask(0))
        server.sendmsg([struct.pack("III", len(text), len(command), mask)],
                       [(socket.SOL_SOCKET, socket.SCM_RIGHTS, array.array("i", files))])
        server.sendall(text)
        process = _number(server)
        over = threading.Timer(timeout, os.kill, (process, signal.SIGKILL)) if timeout else None
        if over:
            over.start()
        try:
            return os.waitstatus_to_exitcode(_number(server))
        finally:
            if over:
                over.cancel()


def run(command, *, cwd=None, env=None, stdin=None, capture_output=False, stdout=None, stderr=None, text=False,
        errors="strict", timeout=None, check=False):
    """Like subprocess.run(); stdin: an open file; stdout and stderr: as there, except STDOUT."""
    command = [os.fspath(word) for word in command]
    if not _library(command[0]).exists():
        return subprocess.run(command, cwd=cwd, env=env, stdin=stdin, capture_output=capture_output, stdout=stdout,
                              stderr=stderr, text=text, errors=errors if text else None, timeout=timeout, check=check)
    if capture_output:
        stdout = stderr = subprocess.PIPE
    outputs, opened = [], []
    for inherited, to in ((1, stdout), (2, stderr)):
        if to is None:
            outputs.append(inherited)
        elif to in (subprocess.PIPE, subprocess.DEVNULL):
            opened.append(os.memfd_create("output") if to == subprocess.PIPE else os.open(os.devnull, os.O_WRONLY))
            outputs.append(opened[-1])
        else:
            outputs.append(to if isinstance(to, int) else to.fileno())
    opened.append(os.dup(stdin.fileno()) if stdin else os.open(os.devnull, os.O_RDONLY))
    try:
        code = _served(command, [opened[-1], *outputs], cwd, dict(os.environ if env is None else env), timeout)
        if timeout and code == -signal.SIGKILL:
            raise subprocess.TimeoutExpired(command, timeout)
        texts = []
        for to, file in ((stdout, outputs[0]), (stderr, outputs[1])):
            data = os.pread(file, os.fstat(file).st_size, 0) if to == subprocess.PIPE else None
            if text and data is not None:
                data = data.decode(errors=errors).replace("\r\n", "\n").replace("\r", "\n")
            texts.append(data)
    finally:
        for file in opened:
            os.close(file)
    done = subprocess.CompletedProcess(command, code, *texts)
    if check:
        done.check_returncode()
    return done
