"""Stores at URLs: the same results as from a file, the number of bytes fetched, and interruptible waits."""
import os
import pathlib
import pickle
import signal
import sys
import threading
import time

import numpy as np
import pytest

import isonest
from conftest import ball

sys.path.insert(0, str(pathlib.Path(__file__).parents[1]))
from support.range_server import RangeServer  # noqa: E402

PROGRAM = os.environ.get("ISONEST_PROGRAM", "")
SECRET = "s3cret"


def has_urls():
    try:
        isonest.open("http://127.0.0.1:1/x")
    except isonest.UnsupportedError as error:
        assert "libcurl4-openssl-dev" in str(error)
        return False
    except isonest.InputOutputError:
        return True
    raise AssertionError("there is no server")


pytestmark = pytest.mark.skipif(not has_urls(), reason="this build reads no URLs")


@pytest.fixture(autouse=True)
def plain_environment(monkeypatch, tmp_path):
    for name in list(os.environ):
        if name.startswith(("AWS_", "SSL_CERT", "CURL_")) or name.lower().endswith("_proxy"):
            monkeypatch.delenv(name)
    monkeypatch.setenv("HOME", str(tmp_path))


@pytest.fixture
def made(tmp_path):
    path = tmp_path / "ball.isonest"
    isonest.preprocess(ball((40, 44, 48), 15), path, chunk=16)
    return path


def test_a_url_gives_the_results_of_the_file(made):
    with RangeServer(made.parent) as server, isonest.open(made) as local:
        assert local.fetched == dict.fromkeys(("remote_bytes", "requests", "round_trips", "cache_bytes"), 0)
        with isonest.open(server.url(made.name, f"me:{SECRET}@") + f"?{SECRET}", headers={"X-Token": SECRET}) as remote:
            assert remote.path == server.url(made.name)
            assert repr(remote).startswith(f"<isonest.Store '{server.url(made.name)}'")
            assert remote.shape == local.shape and remote.arrays[0].stored_bytes == local.arrays[0].stored_bytes
            for ask in (lambda s: s.isosurface(0.1, error=0.5), lambda s: s.slice((1, 0, 0), 20.0, error=0.5),
                        lambda s: s.isosurface(0.1, distance="1voxel"), lambda s: s.isosurface(0.1, vertex_values=s)):
                for here, there in zip(ask(local), ask(remote)):
                    np.testing.assert_array_equal(here, there)
            np.testing.assert_array_equal(local.values(1), remote.values(1))
            assert local.histogram().suggested == remote.histogram().suggested
            assert remote.check().ok
            smooth = {"steps": 1, "tau": 0.5, "lambda_": 0.2}
            np.testing.assert_array_equal(isonest.smooth(local, **smooth).values, isonest.smooth(remote, **smooth).values)
            assert remote.fetched["requests"] == server.requests
            assert remote.fetched["remote_bytes"] == server.bytes
            assert 1 <= remote.fetched["round_trips"] <= server.requests
            again = pickle.loads(pickle.dumps(remote))
            np.testing.assert_array_equal(again.values(2), local.values(2))
        assert all(note.get("x-token", SECRET) == SECRET for note in server.notes)


def test_the_cache_is_used_when_the_store_is_reopened(made, tmp_path):
    with RangeServer(made.parent) as server:
        for cache in (tmp_path / "cache", f"{tmp_path / 'cache'}:16M"):
            with isonest.open(server.url(made.name), cache=cache, memory="32M") as store:
                store.values(0)
                fetched = store.fetched
        assert fetched["requests"] == 1 and fetched["cache_bytes"] > 0


def test_an_unusable_cache_gives_a_warning(made, tmp_path):
    (tmp_path / "file").write_text("no folder")
    with RangeServer(made.parent) as server:
        with pytest.raises(isonest.Error, match="file"):
            isonest.open(server.url(made.name), cache=tmp_path / "file")
    for cache in ("", ":1G", "folder:0"):
        with pytest.raises(ValueError, match="give a folder"):
            isonest.open(made, cache=cache)


def test_errors_contain_remedies_and_no_secrets(made):
    with RangeServer(made.parent, fault_of=lambda *_: "status:403") as server:
        with pytest.raises(isonest.InputOutputError, match="403") as raised:
            isonest.open(server.url(made.name, f"me:{SECRET}@"), headers=[f"X-Token: {SECRET}"])
    assert raised.value.file == server.url(made.name)
    assert any("headers=" in remedy for remedy in raised.value.remedies)
    assert SECRET not in str(raised.value)
    for headers in ({"X Token": SECRET}, [SECRET], [f"X-Token: {SECRET}\nHost: a"], {"X-Token": f"{SECRET}\r\nHost: a"}):
        with pytest.raises(ValueError, match="headers") as raised:
            isonest.open(made, headers=headers)
        assert SECRET not in str(raised.value)
    (made.parent / "slice.tif").write_bytes(b"II*\0" + bytes(100))
    with RangeServer(made.parent) as server, pytest.raises(isonest.UnsupportedError, match="download"):
        isonest.preprocess(server.url("slice.tif"), made.parent / "x.isonest")


def test_ctrl_c_ends_a_wait(made):
    def interrupt(server, first):
        while server.requests < first:
            time.sleep(0.01)
        time.sleep(0.3)
        os.kill(os.getpid(), signal.SIGINT)

    for first in (1, 2):
        with RangeServer(made.parent, fault_of=lambda number, *_, n=first: "silent" if number >= n else None) as server:
            thread = threading.Thread(target=interrupt, args=(server, first))
            thread.start()
            start = time.monotonic()
            with pytest.raises(KeyboardInterrupt):
                isonest.open(server.url(made.name)).values(0)
            assert time.monotonic() - start < 10
            thread.join()


@pytest.mark.skipif(not PROGRAM, reason="ISONEST_PROGRAM names no program")
def test_a_view_gets_headers_without_revealing_them(made):
    def guarded(number, path, headers):
        return None if headers.get("X-Token") == SECRET else "status:403"

    with RangeServer(made.parent, fault_of=guarded) as server, \
            isonest.open(server.url(made.name), headers={"X-Token": SECRET}) as store:
        try:
            view = store.view(open=False)
        except isonest.UnsupportedError:
            pytest.skip("this build has no viewer")
        with view:
            command = pathlib.Path("/proc", str(view._process.pid), "cmdline").read_bytes()
            assert made.name.encode() in command and SECRET.encode() not in command
            assert server.url(made.name) in repr(view)
