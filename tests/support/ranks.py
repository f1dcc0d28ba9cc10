"""Programs as several ranks of MPI, on one machine."""
import os
import pathlib
import shutil
import subprocess
import sys

SKIPPED = 77


def beside(isonest, name):
    return pathlib.Path(isonest).resolve().parent / name


def require(isonest):
    """Ends the test as skipped where there is no isonest-mpi."""
    if not beside(isonest, "isonest-mpi").exists() or shutil.which("mpirun") is None:
        print("skipped: isonest-mpi was not built, or there is no mpirun")
        sys.exit(SKIPPED)


def _command(count, program, arguments):
    launcher = ["mpirun", "--oversubscribe", "-n", str(count)] if count > 1 else []
    return [*launcher, str(program), *map(str, arguments)]


def _environment():
    return {**os.environ, "OMPI_ALLOW_RUN_AS_ROOT": "1", "OMPI_ALLOW_RUN_AS_ROOT_CONFIRM": "1"}


def launched(count, program, *arguments, timeout=300, **settings):
    """The finished process of the launcher; one rank is started without it."""
    return subprocess.run(_command(count, program, arguments), capture_output=True, timeout=timeout,
                          env=_environment(), check=False, **settings)


def started(count, program, *arguments):
    """The launcher's process, which says nothing."""
    return subprocess.Popen(_command(count, program, arguments), env=_environment(), stdout=subprocess.DEVNULL,
                            stderr=subprocess.DEVNULL)


def ended(process, program, timeout=120):
    """The launcher's exit code. mpirun (Open MPI 4.1, PMIx 4.2) may stand for ever when a rank was killed, in
    PMIx_server_finalize(), after all ranks have ended: then it is killed, too."""
    try:
        return process.wait(timeout=timeout)
    except subprocess.TimeoutExpired:
        if processes_of(program):
            raise
        process.kill()
        return process.wait()


def launched_apart(*commands, timeout=300):
    """The finished process of the launcher of one rank for each command, a program with its arguments."""
    parts = [part for command in commands for part in (":", "-n", "1", *map(str, command))]
    return subprocess.run(["mpirun", "--oversubscribe", *parts[1:]], capture_output=True, timeout=timeout,
                          env=_environment(), check=False)


def processes_of(program):
    """Those that run it, by their numbers."""
    found = []
    for entry in pathlib.Path("/proc").iterdir():
        if entry.name.isdigit():
            try:
                if (entry / "exe").resolve() == program:
                    found.append(int(entry.name))
            except OSError:
                pass  # it has ended meanwhile
    return found
