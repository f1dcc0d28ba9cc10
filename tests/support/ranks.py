"""Runs programs on several MPI ranks, on one machine."""
import os
import pathlib
import shlex
import shutil
import subprocess
import sys

SKIPPED = 77


def beside(isonest, name):
    return pathlib.Path(isonest).resolve().parent / name


def require(isonest):
    """Skips the test if there is no isonest-mpi."""
    if not beside(isonest, "isonest-mpi").exists() or shutil.which("mpirun") is None:
        print("skipped: isonest-mpi was not built, or there is no mpirun")
        sys.exit(SKIPPED)


def _command(count, program, arguments):
    launcher = ["mpirun", "--oversubscribe", "-n", str(count)] if count > 1 else []
    return [*launcher, str(program), *map(str, arguments)]


def _environment():
    return {**os.environ, "OMPI_ALLOW_RUN_AS_ROOT": "1", "OMPI_ALLOW_RUN_AS_ROOT_CONFIRM": "1"}


def launched(count, program, *arguments, timeout=300, **settings):
    """The finished process of the launcher; a single rank is started without it."""
    return subprocess.run(_command(count, program, arguments), capture_output=True, timeout=timeout,
                          env=_environment(), check=False, **settings)


def started(count, program, *arguments):
    """The launcher's process, with its output discarded."""
    return subprocess.Popen(_command(count, program, arguments), env=_environment(), stdout=subprocess.DEVNULL,
                            stderr=subprocess.DEVNULL)


def ended(process, program, timeout=120):
    """The launcher's exit code. mpirun (Open MPI 4.1, PMIx 4.2) may hang after a rank was killed, in
    PMIx_server_finalize(), when all ranks have ended: then it is killed, too."""
    try:
        return process.wait(timeout=timeout)
    except subprocess.TimeoutExpired:
        if processes_of(program):
            raise
        process.kill()
        return process.wait()


def launched_apart(*commands, timeout=300):
    """The finished process of the launcher, with one rank for each command, a program with its arguments. (mpirun of
    Open MPI 5.0.7, Debian 13's, crashes if it is given several commands itself.)"""
    cases = " ".join(f"{rank}) exec {shlex.join(map(str, command))};;" for rank, command in enumerate(commands))
    return subprocess.run(["mpirun", "--oversubscribe", "-n", str(len(commands)), "sh", "-c",
                           f'case "$OMPI_COMM_WORLD_RANK" in {cases} esac'],
                          capture_output=True, timeout=timeout, env=_environment(), check=False)


def processes_of(program):
    """The numbers of the processes that run it."""
    found = []
    for entry in pathlib.Path("/proc").iterdir():
        if entry.name.isdigit():
            try:
                if (entry / "exe").resolve() == program:
                    found.append(int(entry.name))
            except OSError:
                pass  # it has ended meanwhile
    return found
