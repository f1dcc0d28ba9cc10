"""Ctrl-C during a wait for a server."""
import signal
import subprocess
import time


def interrupted(server, first_silent, command, **options):
    """Runs the command, with SIGINT after this number of requests; returns its exit code, the seconds until it ended,
    and standard error."""
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, **options)
    until = time.monotonic() + 60
    while server.requests < first_silent and time.monotonic() < until:
        time.sleep(0.02)
    time.sleep(0.3)
    start = time.monotonic()
    process.send_signal(signal.SIGINT)
    _, text = process.communicate(timeout=60)
    return process.returncode, time.monotonic() - start, text
