"""Who is refused: other names, other origins, tokens that are not the one, other users, pages of other sites."""
import concurrent.futures
import contextlib
import http.server
import json
import os
import shutil
import subprocess
import threading
import time
import urllib.parse

import attack as shared
from serving import questions, view

NOBODY = 65534


def _own(server):
    return (server.name, f"localhost:{server.port}")


def one_request(one, server, any_name):
    """A request, and the statuses that it may have: 403, or 400 where it makes no sense either."""
    own = one.pick(*_own(server))
    hosts = one.pick(*[[own]] * 6, [], [own, own], [own, "evil.example"], ["evil.example"], [f"evil.example:{server.port}"], [""],
                     [server.name.rsplit(":", 1)[0]], [f"localhost:{server.port}."], [f"{own}@evil.example"], [f"evil.example#{own}"], [f"127.0.0.1:0{server.port}"],
                     [f"localhost.evil.example:{server.port}"], [f"{own}, evil.example"], [f"0.0.0.0:{server.port}"], [f"[::1]:{server.port}"], [f"127.1:{server.port}"])
    host = hosts[0] if len(hosts) == 1 else None
    good_host = host is not None and (host in _own(server) or (any_name and host != ""))
    origins = one.pick(*[[]] * 4, [f"http://{host}"], [f"http://{host}"], ["null"], ["http://evil.example"], [f"https://{host}"], [f"http://{host}/"],
                       [f"http://{host}.evil.example"], [f"http://{host}", "http://evil.example"], ["http://evil.example", f"http://{host}"],
                       [f"HTTP://{host}"], ["file://"], [f"http://localhost:{server.port + 1}"], ["", "http://evil.example"])
    good_origin = all(origin == f"http://{host}" for origin in origins)
    sites = one.pick(*[[]] * 4, ["same-origin"], ["none"], ["same-site"], ["cross-site"], ["SAME-ORIGIN"], ["odd"], ["none", "cross-site"], ["cross-site", "none"],
                     ["same-origin, cross-site"], ["", "cross-site"])
    good_site = all(site in ("same-origin", "none") for site in sites)
    tokens = one.pick(*[[server.token]] * 4, [], ["x" * 32], [(server.token or "")[:-1]], [(server.token or "") + "0"], [(server.token or "a").upper()],
                      [server.token, server.token], [server.token, "x"], ["x", server.token], [""], ["0" * 100000 if one.chance(0.1) else "0"])
    tokens = [token if token is not None else "none" for token in tokens]
    good_token = server.token is None or tokens == [server.token]
    path = one.pick("/api/store", "/api/label?id=1", "/api/value?at=1,1,1", "/api/histogram", "/api/status", "/", "/main.js", "/api/surface?iso=0.4")
    is_page = not path.startswith("/api/")
    names = one.pick("token", "token", "token", "Token", "%74oken")
    text = path + "".join(("&" if "?" in path or i else "?") + f"{names}={token}" for i, token in enumerate(tokens))
    headers = [("Host", value) for value in hosts] + [("Origin", value) for value in origins] + [("Sec-Fetch-Site", value) for value in sites]
    allowed = good_host if is_page else good_host and good_origin and good_site and good_token and (names != "Token" or server.token is None)
    refusals = {403}
    if len(tokens) > 1 or (names == "Token" and not is_page) or len(hosts) != 1:
        refusals.add(400)
    if len(text) > 8000:
        refusals.add(431)
    version = one.pick("1.1", "1.1", "1.1", "1.0")
    if not hosts:
        lines = f"GET {text} HTTP/{version}\r\n" + "".join(f"{n}: {v}\r\n" for n, v in headers) + "\r\n"
        return lines.encode("latin-1"), set() if allowed else refusals
    good = {200} | (refusals - {403}) | ({413} if "surface" in path else set())
    return server.request(text, headers=headers, version=version), good if allowed else refusals


def _asked(server, data, statuses):
    with contextlib.closing(server.connect()) as s:
        s.sendall(data)
        answer = view.Answers(s).next()
    if answer is None:
        return f"no answer to {data[:600]!r}"
    if answer.wrong_form():
        return answer.wrong_form()
    if answer.status not in statuses:
        return f"{answer.status}, not one of {sorted(statuses)}, for {data[:600]!r}"
    return None


def other_user(one, server):
    """What nobody, the user, can read while a file waits to be sent, and without the token."""
    with contextlib.closing(server.connect(receive=4096)) as s:
        s.sendall(server.request(server.with_token("/api/export?iso=0.5&format=ply")))
        for _ in range(200):
            found = list(server.scratch.rglob("*"))
            if len(found) > 1:
                break
            time.sleep(0.005)
        names = [str(path) for path in found]
        script = ("import os, sys, urllib.request, urllib.error\n"
                  "for name in sys.argv[2:]:\n"
                  "    for reads in (lambda: open(name, 'rb').read(1), lambda: os.listdir(name)):\n"
                  "        try:\n            reads()\n            print('read', name)\n        except OSError:\n            pass\n"
                  "try:\n    print('token', urllib.request.urlopen(sys.argv[1]).status)\n"
                  "except urllib.error.HTTPError as error:\n    print('status', error.code)\n")
        os.chmod(one.folder, 0o755)
        os.chmod(server.scratch, 0o777)
        process = f"/proc/{server.process.pid}"
        done = subprocess.run(["setpriv", f"--reuid={NOBODY}", f"--regid={NOBODY}", "--clear-groups", "/usr/bin/python3", "-c", script,
                               f"http://{server.name}/api/store", *names, f"{process}/environ", f"{process}/mem", f"{process}/fd"],
                              capture_output=True, text=True, timeout=30, cwd="/")
    wanted = "status 403" if server.token else "token 200"
    if done.stdout.split("\n")[:-1] != [wanted]:
        return f"another user: {done.stdout} {done.stderr[:300]}"
    with open(f"{process}/cmdline", "rb") as line:
        if server.token and server.token.encode() in line.read():
            return "the token is on the command line"
    return None


PAGE = """<!doctype html><body><iframe id=f src="%(url)s"></iframe><script>
const url = "%(url)s", seen = [];
const tries = [fetch(url + "api/store").then(r => r.text()).then(t => seen.push("fetch " + t)),
  fetch(url + "api/store", {mode: "no-cors"}).then(r => r.text()).then(t => t && seen.push("no-cors " + t)),
  fetch(url + "api/cancel?stream=a", {method: "POST", mode: "no-cors"}),
  fetch(url + "api/store", {headers: {"X-A": "b"}}).then(r => r.text()).then(t => seen.push("header " + t)),
  new Promise(done => { const s = document.createElement("script"); s.src = url + "api/store"; s.onload = () => { seen.push("script"); done(); }; s.onerror = done; document.body.append(s); }),
  new Promise(done => { const s = new Image(); s.src = url + "api/store"; s.onload = () => { seen.push("image"); done(); }; s.onerror = done; }),
  new Promise(done => setTimeout(() => { try { seen.push("frame " + document.getElementById("f").contentDocument.body.innerHTML.length); } catch { } done(); }, 300))];
Promise.allSettled(tries).then(() => { document.title = "done"; document.body.textContent = "SEEN" + JSON.stringify(seen) + "NEES"; });
</script></body>"""


def other_page(one, server):
    """A page of another site, in a browser, asks for the store; once more where its name has come to lead to the server."""
    page = {}

    class Site(http.server.BaseHTTPRequestHandler):
        def do_GET(self):
            self.send_response(200)
            self.send_header("Content-Type", "text/html")
            self.end_headers()
            self.wfile.write(page["text"].encode())

        def log_message(self, *_):
            pass

    with http.server.ThreadingHTTPServer(("127.0.0.1", 0), Site) as site:
        threading.Thread(target=site.serve_forever, daemon=True).start()
        name = one.pick(server.name, f"evil.example:{server.port}")
        page["text"] = PAGE % {"url": f"http://{name}/"}
        done = subprocess.run(["chromium", "--headless=new", "--no-sandbox", "--disable-gpu", "--no-first-run", f"--user-data-dir={one.folder / 'profile'}",
                               "--host-resolver-rules=MAP evil.example 127.0.0.1", "--virtual-time-budget=10000", "--dump-dom",
                               f"http://evil.example:{site.server_port}/"], capture_output=True, text=True, timeout=50)
        site.shutdown()
    shutil.rmtree(one.folder / "profile", ignore_errors=True)
    if "SEEN[" not in done.stdout:
        return f"the browser has not shown the page to its end: {done.stdout[:500]} {done.stderr[-300:]}"
    seen = json.loads(done.stdout.rsplit("SEEN", 1)[1].split("NEES")[0].replace("&lt;", "<").replace("&gt;", ">").replace("&amp;", "&"))
    return f"a page of another site saw {seen}" if seen else None


def attack(one):
    isonest = shared.package(one.program)
    looks = one.chance(0.1)
    path, _ = questions.make_store(one, isonest, kind="smooth", most=90 if looks else 14)
    mode = one.pick([], ["--token"], ["--address", "0.0.0.0"], ["--address", "::1"], ["--address", "127.0.0.2"], ["--address", "127.0.0.1", "--token"])
    server = view.View(one.program, path, one.folder, *mode)
    try:
        server.status()
        before = server.holds()
        any_name = "0.0.0.0" in mode
        asked = [one_request(one, server, any_name) for _ in range(100)]
        with concurrent.futures.ThreadPoolExecutor(int(one.random.integers(1, 9))) as pool:
            wrongs = list(pool.map(lambda a: _asked(server, *a), asked))
        wrong = next(filter(None, wrongs), None)
        if looks and not wrong and os.geteuid() == 0 and shutil.which("setpriv"):
            wrong = other_user(one, server)
        if one.chance(0.02) and not wrong and shutil.which("chromium") and "::1" not in mode:
            wrong = other_page(one, server)
        wrong = wrong or server.what_is_left(before) or server.wrong_end()
        return shared.wrong(f"{' '.join(mode)} {wrong}") if wrong else shared.SAME
    finally:
        server.end()
