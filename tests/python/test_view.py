"""store.view(): the program serves the store until the view ends."""
import gc
import html.parser
import json
import os
import pathlib
import signal
import socket
import subprocess
import sys
import textwrap
import time
import types
import urllib.error
import urllib.parse
import urllib.request
import webbrowser

import pytest

import isonest
from isonest import _view

PROGRAM = os.environ.get("ISONEST_PROGRAM", "")


def has_view():
    done = subprocess.run([PROGRAM, "view", "--help"], capture_output=True, check=False) if PROGRAM else None
    return done is not None and done.returncode == 0


needs_program = pytest.mark.skipif(not has_view(), reason="ISONEST_PROGRAM names no program that has the command view")


def ask(url, path, token=True):
    """The JSON at /api/PATH of the server with this page."""
    parts = urllib.parse.urlsplit(url)
    place = urllib.parse.urlunsplit((parts.scheme, parts.netloc, f"/api/{path}", parts.query if token else "", ""))
    with urllib.request.urlopen(place, timeout=20) as answer:
        return json.load(answer)


def is_served(url):
    try:
        ask(url, "status")
    except urllib.error.URLError:
        return False
    return True


def is_gone(url):
    """Waits until the program has ended, long enough for a slow machine."""
    deadline = time.monotonic() + 30
    while is_served(url) and time.monotonic() < deadline:
        time.sleep(0.05)
    return not is_served(url)


@pytest.fixture
def store(store_path, noise, monkeypatch):
    monkeypatch.setenv("ISONEST", PROGRAM)
    isonest.preprocess(noise, store_path)
    return isonest.open(store_path)


@needs_program
def test_a_view_serves_the_store_until_it_is_closed(store):
    view = store.view(open=False)
    assert not view.closed and repr(view).endswith(f"at {view.url}>")
    told = ask(view.url, "store")
    assert (told["name"], tuple(told["nodes"][::-1])) == ("x.isonest", store.shape)
    assert (told["min_value"], told["max_value"], told["memory"]) == (*store.range, 1 << 30)
    with urllib.request.urlopen(view.url, timeout=20) as page:
        assert b"<html" in page.read()
    view.close()
    assert view.closed and repr(view).endswith("closed>") and not is_served(view.url)
    view.close()
    view.wait()


@needs_program
def test_without_the_token_the_server_gives_no_data(store):
    with store.view(open=False) as view, pytest.raises(urllib.error.HTTPError) as caught:
        ask(view.url, "store", token=False)
    assert caught.value.code == 403
    caught.value.close()


@needs_program
def test_arguments_are_passed_to_the_program(store, store_path):
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    with isonest.view(store_path, port=port, memory="640M", threads=1, open=False) as view:
        assert urllib.parse.urlsplit(view.url).port == port and ask(view.url, "store")["memory"] == 640 << 20


@needs_program
def test_a_view_ends_with_its_block_or_when_garbage_collected(store):
    with pytest.raises(ZeroDivisionError), store.view(open=False) as view:
        raise ZeroDivisionError
    assert view.closed and not is_served(view.url)
    view = store.view(open=False)
    url = view.url
    del view
    gc.collect()
    assert not is_served(url)


def run(script, **more):
    """A Python process that runs this code; its standard output is a pipe."""
    return subprocess.Popen([sys.executable, "-c", textwrap.dedent(script)], stdin=subprocess.PIPE, text=True,
                            stdout=subprocess.PIPE, **more)


@needs_program
def test_a_view_ends_with_its_process(store, store_path):
    with run(f"""
        import isonest
        view = isonest.view({str(store_path)!r}, open=False)
        print(view.url, flush=True)
        input()
    """) as child:
        url = child.stdout.readline().strip()
        assert is_served(url)
        child.communicate("\n")
        assert child.returncode == 0 and not is_served(url)


@needs_program
@pytest.mark.skipif(not _view._setpriv(), reason="this system has no setpriv --pdeathsig")
def test_a_view_ends_when_its_process_is_killed(store, store_path):
    with run(f"""
        import isonest
        view = isonest.view({str(store_path)!r}, open=False)
        print(view.url, flush=True)
        input()
    """) as child:
        url = child.stdout.readline().strip()
        assert is_served(url)
        child.kill()
        child.wait()
        assert is_gone(url)


@needs_program
def test_a_view_outlives_the_thread_that_started_it_forked_processes_and_an_interrupt(store, store_path):
    with run(f"""
        import os, sys, threading, time
        import isonest
        views = []
        thread = threading.Thread(target=lambda: views.append(isonest.view({str(store_path)!r}, open=False)))
        thread.start()
        thread.join()
        if os.fork() == 0:
            views.clear()
            sys.exit()
        os.wait()
        try:
            print(views[0].url, flush=True)
            time.sleep(60)
        except KeyboardInterrupt:
            print("interrupted", flush=True)
        input()
    """, start_new_session=True) as child:
        url = child.stdout.readline().strip()
        assert is_served(url)
        os.killpg(child.pid, signal.SIGINT)
        assert child.stdout.readline() == "interrupted\n" and is_served(url)
        child.communicate("\n")
        assert child.returncode == 0 and not is_served(url)


@needs_program
def test_wait_returns_when_the_program_ends_and_says_why(store):
    view = store.view(open=False)
    view._process.terminate()
    view.wait()
    assert view.closed
    view = store.view(open=False)
    view._process.kill()
    with pytest.raises(isonest.InputOutputError, match="signal 9"):
        view.wait()


@needs_program
def test_ctrl_c_ends_a_script_that_waits(store, store_path):
    with run(f"""
        import isonest
        view = isonest.view({str(store_path)!r}, open=False)
        print(view.url, flush=True)
        view.wait()
        print("done", view.closed)
    """, start_new_session=True) as child:
        url = child.stdout.readline().strip()
        assert is_served(url)
        time.sleep(0.2)  # until it waits
        os.killpg(child.pid, signal.SIGINT)
        assert child.communicate("")[0] == "done True\n" and child.returncode == 0 and not is_served(url)


@needs_program
def test_errors_of_the_program_raise_the_corresponding_exceptions(store, store_path, tmp_path):
    with pytest.raises(MemoryError) as caught:
        store.view(memory="1M", open=False)
    assert isinstance(caught.value, isonest.MemoryLimitError) and str(store_path) in str(caught.value)
    (remedy,) = caught.value.remedies
    assert str(caught.value).endswith(remedy) and "--" not in str(caught.value)
    assert caught.value.problem in str(caught.value) and remedy not in caught.value.problem
    with store.view(memory=int(remedy.split("=")[1].split()[0]), open=False) as view:
        assert is_served(view.url)
        with pytest.raises(isonest.InputOutputError, match="port") as caught:
            store.view(port=urllib.parse.urlsplit(view.url).port, open=False)
        assert isinstance(caught.value, OSError)
    with pytest.raises(FileNotFoundError):
        isonest.view(tmp_path / "none", open=False)
    (tmp_path / "text").write_text("no store" * 100)
    with pytest.raises(isonest.InvalidArgumentError):
        isonest.view(tmp_path / "text", open=False)
    store_path.unlink()
    with pytest.raises(isonest.NotFoundError) as caught:
        store.view(open=False)
    assert caught.value.file == str(store_path)


def test_invalid_arguments_raise_value_error(store):
    for wrong in ({"port": -1}, {"port": 65536}, {"threads": -1}, {"height": 0}, {"memory": "lots"}):
        with pytest.raises(ValueError, match=next(iter(wrong))):
            store.view(open=False, **wrong)
    store.close()
    with pytest.raises(ValueError, match="closed"):
        store.view(open=False)


def fake(path, *lines):
    """A shell script in place of the program."""
    path.parent.mkdir(exist_ok=True)
    path.write_text("\n".join(["#!/bin/sh", *lines, ""]))
    path.chmod(0o755)
    return path


def says(path):
    """A program that prints a URL with its own name as that of the page, and runs until it is ended."""
    return fake(path, f'echo \'{{"url": "http://{path.parent.name}/"}}\'', "exec sleep 600")


def test_where_the_program_is_searched(store, tmp_path, monkeypatch):
    path = f"{tmp_path / 'path'}:{os.environ['PATH']}"
    monkeypatch.setenv("PATH", path)
    says(tmp_path / "path" / "isonest")
    monkeypatch.setattr(_view, "_BESIDE", says(tmp_path / "beside" / "isonest"))
    monkeypatch.setenv("ISONEST", str(says(tmp_path / "variable" / "another-name")))
    given = says(tmp_path / "given" / "isonest")

    def found(**more):
        with store.view(open=False, **more) as view:
            return view.url

    assert found(program=given) == found(program=str(given)) == "http://given/"
    assert found() == "http://variable/"
    monkeypatch.delenv("ISONEST")
    assert found() == "http://beside/"
    monkeypatch.setattr(_view, "_BESIDE", tmp_path / "none")
    assert found() == "http://path/"
    assert found(program="isonest") == "http://path/"
    for way in ("program=", "variable ISONEST"):
        monkeypatch.setenv("ISONEST", str(tmp_path / "no-program"))
        with pytest.raises(FileNotFoundError, match=way) as caught:
            found(**({"program": tmp_path / "no-program"} if way == "program=" else {}))
        assert isinstance(caught.value, isonest.NotFoundError) and "no-program" in str(caught.value)
    monkeypatch.delenv("ISONEST")
    monkeypatch.setenv("PATH", str(tmp_path))
    with pytest.raises(FileNotFoundError, match="install it .*the package isonest") as caught:
        found()
    assert len(caught.value.remedies) == 2


def test_wrong_programs_raise_errors(store, tmp_path):
    told = {"error": {"kind": "invalid_argument", "message": "there is no command 'view'; see: isonest --help",
                      "file": "", "inside": "", "remedies": []}}
    old = fake(tmp_path / "old", f"cat <<'END'\n{json.dumps(told, indent=2)}\nEND", "exit 2")
    with pytest.raises(isonest.UnsupportedError, match="install-deps"):
        store.view(program=old, open=False)
    other = fake(tmp_path / "other", "echo hello; echo 'no such library' >&2; exit 127")
    with pytest.raises(isonest.InputOutputError, match="exit code 127: no such library"):
        store.view(program=other, open=False)


class Frames(html.parser.HTMLParser):
    def __init__(self, text):
        super().__init__()
        self.found, self.text = [], ""
        self.feed(text)

    def handle_starttag(self, tag, attrs):
        self.found.append((tag, dict(attrs)))

    def handle_data(self, data):
        self.text += data


def test_a_notebook_shows_a_frame_for_any_store_name(tmp_path, noise):
    name = '"><script>&amp;.isonest'
    isonest.preprocess(noise, tmp_path / name)
    program = fake(tmp_path / "program", 'echo \'{"url": "http://127.0.0.1:1/?token=a&b"}\'', "exec sleep 600")
    with isonest.view(tmp_path / name, program=program, open=False, height=432) as view:
        (_, frame), *others = Frames(view._repr_html_()).found
        assert [tag for tag, _ in others] == ["p", "a"] and others[1][1]["href"] == view.url
        assert (frame["src"], frame["title"]) == (view.url, f"isonest: {name}")
        assert (frame["width"], frame["height"]) == ("100%", "432")
    closed = Frames(view._repr_html_())
    assert [tag for tag, _ in closed.found] == ["p"] and closed.text == repr(view) and "closed" in closed.text


def test_a_browser_is_opened_only_outside_notebooks(store, tmp_path, monkeypatch):
    program = says(tmp_path / "fake" / "isonest")
    opened = []
    monkeypatch.setattr(webbrowser, "open", lambda url: opened.append(url) or True)

    def opens(**more):
        opened.clear()
        with store.view(program=program, **more) as view:
            assert opened in ([], [view.url])
            return bool(opened)

    monkeypatch.setitem(sys.modules, "IPython", types.SimpleNamespace(get_ipython=lambda: None))
    assert [opens(), opens(open=None), opens(open=True), opens(open=False)] == [True, True, True, False]
    terminal = types.SimpleNamespace()
    monkeypatch.setattr(sys.modules["IPython"], "get_ipython", lambda: terminal)
    assert opens()
    notebook = types.SimpleNamespace(kernel=object())
    monkeypatch.setattr(sys.modules["IPython"], "get_ipython", lambda: notebook)
    assert [opens(), opens(open=True), opens(open=False)] == [False, True, False]
    monkeypatch.setattr(webbrowser, "open", lambda url: False)
    with pytest.warns(RuntimeWarning, match="http://fake/"), store.view(program=program, open=True):
        pass


@needs_program
def test_in_a_build_tree_the_program_is_next_to_the_package(store, monkeypatch):
    if not pathlib.Path(PROGRAM).resolve().is_relative_to(_view._BESIDE.parents[3]):
        pytest.skip("the package is not that of the program's build tree")
    monkeypatch.delenv("ISONEST")
    assert os.path.samefile(_view._find_program(None), PROGRAM)
