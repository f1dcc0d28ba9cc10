"""Ctrl-C in a wait for a server."""
import signal
import subprocess
import time


def interrupted(server, first_silent, command, **options):
    """The command, ended by SIGINT when the server has so many requests; its exit code, seconds until then, and standard error."""
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, **options)
    until = time.monotonic() + 60
    while server.requests < first_silent and time.monotonic() < until:
        time.sleep(0.02)
    time.sleep(0.3)
    start = time.monotonic()
    process.send_signal(signal.SIGINT)
    _, text = process.communicate(timeout=60)
    return process.returncode, time.monotonic() - start, text
