#!/usr/bin/env python3
"""Attacks what reads stores and volumes at URLs, by a server that misbehaves at random.

Whatever the server does, a run gives the bytes that it gives of the file, or an error that says what is wrong, within its
time and memory; no secret is in what it says or writes or goes to another server; nothing is left behind. Where all that
the server does is what tools/MANUAL.md says is tried again, the run has to succeed.

ranges    single ranges, by several threads, with short times (isonest_fetch_ranges)
store     info, check, extract, slice, export of a store
volume    preprocess of volumes of each format that is read from URLs
zarr      preprocess of folders of Zarr: an error is never taken for a chunk that is not there
changing  objects that are replaced while they are read: old and new bytes never mix
cache     runs that share a folder of --cache, damaged and filled up between them
tls       https: handshakes that break, certificates of others, ways to http
python    isonest.open in one process
"""
import json
import os
import pathlib
import signal
import subprocess
import sys
import threading

import numpy as np

sys.path.insert(0, str(pathlib.Path(__file__).parent))
import attack  # noqa: E402
from remote_server import answers, fixtures  # noqa: E402
from remote_server.access import Access  # noqa: E402
from remote_server.cache_damage import damage_cache  # noqa: E402
from remote_server.hostile import SECRET_OF_OTHERS, Hostile, certificate  # noqa: E402
from remote_server.runs import CLEAN, MIB, Judge, Run, plan, said_of  # noqa: E402

MODES = ("mild", "mild", "wild", "wild", "bad")
_made, _right = {}, {}


def made(one, name):
    """The folder of fixtures of this process, and what they are."""
    folder = one.folder.parent / name
    if folder not in _made:
        _made[folder] = getattr(fixtures, name)(folder, one.program)
    return folder, _made[folder]


def local(one, arguments, output, key):
    """The bytes that the program makes of the file."""
    if key not in _right:
        done = one.run(*arguments, seconds=60, environment=CLEAN)
        if done.code != 0:
            raise RuntimeError(f"{arguments}: {done}")
        _right[key] = output.read_bytes() if output else said_of(done.out)
        if output:
            output.unlink()
    return _right[key]


def far_run(one, server, access, arguments, output, right, mode, memory=None, cache=None, stop=None, **how):
    """One run at URLs, judged."""
    kept = [*access.kept, *([cache] if cache else [])]
    judge = Judge(one, access.secrets, memory, must_succeed=mode in ("good", "mild") and stop is None, kept=access.kept)
    before = judge.files() if output is None or not output.exists() else judge.files() - {output}
    done = Run(one, [*arguments, *access.options], access.environment, stop, **how).end()
    judge.kept |= set(kept)
    result = judge(done, before, output, right)
    if result.what != "wrong":
        fault = access.fault_of_others()
        if fault:
            result = attack.wrong(f"{done.said()}\n{fault}")
    if result.what == "wrong":
        (one.folder / "server.log").write_text("\n".join(server.log + ["the other one"] + server.other.log))
    if output and output.exists():
        output.unlink()
    return result


STORES = {"S": "a.isonest", "V": "b.isonest", "L": "c.isonest"}


def at_files(folder, words, output):
    return [folder / STORES[word] if word in STORES else word for word in words] + (["-o", output] if output else [])


def at_urls(access, words, output):
    return [access.url(STORES[word]) if word in STORES else word for word in words] + (["-o", output] if output else [])


def a_query(one):
    """Options of a query of a.isonest, the output's name, and a second store."""
    iso = f"{one.random.uniform(800, 3200):.3g}"
    box = ["--box", "5,5,5,40,30,30"] if one.chance(0.3) else []
    error = one.pick([], ["--error", "50"], ["--error-relative", "0.05"])
    kind = int(one.random.integers(8))
    if kind == 0:
        return ["info", "S", "--json"], None
    if kind == 1:
        return ["check", "S", "--json", *one.pick([], ["--quick"], ["--deep"])], None
    if kind == 2:
        return ["slice", "S", "--plane", one.pick("0,0,1,10", "0,1,0,9.5", "1,2,1,60"), *error], one.pick("m.ply", "m.png", "m.vtp")
    if kind == 3:
        return ["export", "S", "--field", one.pick("values", "linf_plus", "deviation_bar"), "--level", one.pick("0", "1", "2")], one.pick("m.npy", "m.nrrd")
    if kind == 4:
        return ["info", "S", "--histogram", "--json"], None
    if kind == 5:
        return ["extract", "L", "--label", one.pick("1", "2"), *one.pick([], ["--smooth"])], "m.ply"
    return (["extract", "S", "--iso", iso, *error, *box, *one.pick([], ["--close"], ["--vertex-values", "V"], ["--components", "largest"])],
            one.pick("m.ply", "m.stl", "m.obj", "m.glb"))


def store(one):
    folder, _ = made(one, "stores")
    words, name = a_query(one)
    memory = one.pick(None, 64 * MIB, 256 * MIB) if words != ["info", "S", "--json"] else None
    threads = ["--threads", one.pick("1", "2", "4")] if words[0] in ("check", "extract", "slice") or "--histogram" in words else []
    output = one.folder / name if name else None
    right = local(one, at_files(folder, words, output), output, (*words, name))
    mode = one.pick(*MODES)
    validators = one.pick(("ETag", "Last-Modified"), ("ETag",), ("Last-Modified",))
    with Hostile(folder, seed=one.seed, validators=validators, knows_tails=mode in ("good", "mild") or one.chance(0.8)) as server:
        access = Access(one, server)
        server.fault_of = plan(one, mode, has_checksums=True, redirects=not access.is_signed) or server.fault_of
        far = at_urls(access, words, output)
        cache = one.folder / "cache" if one.chance(0.3) else None
        far += (["--memory", f"{memory >> 20}M"] if memory else []) + threads + (["--cache", cache] if cache else [])
        stop = (one.pick(signal.SIGINT, signal.SIGTERM, signal.SIGHUP), one.random.uniform(0, 0.5)) if one.chance(0.1) else None
        return far_run(one, server, access, far, output, right, mode, memory or 1024 * MIB, cache, stop)


def volume(one):
    folder, names = made(one, "volumes")
    name = one.pick(*sorted(names))
    options = [*names[name], "--chunk", one.pick("8", "16")]
    options += one.pick([], [], ["--crop", "5:40,3:20,10:30"], ["--every", "2"])
    output = one.folder / "out.isonest"
    right = local(one, ["preprocess", folder / name, "-o", output, *options], output, (name, *options))
    mode = one.pick(*MODES)
    with Hostile(folder, seed=one.seed, validators=one.pick(("ETag", "Last-Modified"), ("ETag",), ("Last-Modified",), ()),
                 knows_tails=mode in ("good", "mild") or one.chance(0.8)) as server:
        access = Access(one, server)
        # Of a version that is not told, nothing is noticed; numbers without checksums may be any.
        server.fault_of = plan(one, mode, redirects=not access.is_signed) or server.fault_of
        memory = one.pick(96 * MIB, 256 * MIB)
        cache = one.folder / "cache" if one.chance(0.2) else None
        stop = (one.pick(signal.SIGINT, signal.SIGTERM), one.random.uniform(0, 0.5)) if one.chance(0.1) else None
        far = ["preprocess", access.url(name), "-o", output, *options, "--memory", f"{memory >> 20}M", "--threads", one.pick("1", "2"),
               *(["--cache", cache] if cache else []), *(["--json"] if one.chance(0.5) else [])]
        return far_run(one, server, access, far, output, right, mode, memory, cache, stop)


def zarr(one):
    folder, names = made(one, "zarrs")
    name = one.pick(*names)
    options = ["--chunk", "8", *one.pick([], [], ["--crop", "5:25,3:20,4:16"])]
    output = one.folder / "out.isonest"
    right = local(one, ["preprocess", folder / name, "-o", output, *options], output, (name, *options))
    mode = one.pick(*MODES)
    with Hostile(folder, seed=one.seed, absent=lambda path: path.startswith(f"/{name}/")) as server:
        access = Access(one, server)
        while access.how == "s3":
            access = Access(one, server)
        fault_of = plan(one, mode, has_checksums=name in ("packed.zarr", "front.zarr", "dots.zarr")) or (lambda request: None)

        def without_404(request):
            """404 of a chunk, and a description with other words, are right answers of other data."""
            fault = fault_of(request)
            is_404 = fault is answers.any_status and answers.status_of(one.seed, request)[:3] in ("404", "410")
            is_changed = fault is answers.damaged and request.path.endswith((".json", ".zarray", ".zattrs", ".zgroup"))
            return None if is_404 or is_changed else fault
        server.fault_of = without_404
        memory = one.pick(96 * MIB, 256 * MIB)
        stop = (one.pick(signal.SIGINT, signal.SIGTERM), one.random.uniform(0, 0.5)) if one.chance(0.1) else None
        far = ["preprocess", access.url(name), "-o", output, *options, "--memory", f"{memory >> 20}M", *(["--json"] if one.chance(0.5) else [])]
        return far_run(one, server, access, far, output, right, mode, memory, None, stop)


def changing(one):
    """Replaced at some request by what has another version, and perhaps put back."""
    of_store = one.chance(0.5)
    folder, names = made(one, "stores" if of_store else "volumes")
    if of_store:
        name, other, words = "a.isonest", "decoy.isonest", a_query(one)
        while "L" in words[0]:
            words = a_query(one)
        words, output = words[0], one.folder / words[1] if words[1] else None
    else:
        name = one.pick(*(name for name in sorted(names) if name.startswith("v.") and name.endswith((".raw", ".nrrd", ".nii", ".npy", ".mha"))))
        other, output = name.replace("v", "decoy", 1), one.folder / "out.isonest"
        words = ["preprocess", "S", *names[name], "--chunk", "8"]
    rights = [local(one, [folder / {"S": source, "V": "b.isonest"}[word] if word in ("S", "V") else word for word in words] +
                    (["-o", output] if output else []), output, (source, *words, output and output.name)) for source in (name, other)]
    at, back = int(one.random.integers(1, 12)), int(one.random.integers(1, 12)) if one.chance(0.3) else 10**9
    mild = plan(one, "mild", redirects=False)
    with Hostile(folder, seed=one.seed, validators=one.pick(("ETag", "Last-Modified"), ("ETag",), ("Last-Modified",))) as server:
        asked = [0]

        def fault_of(request):
            with server.lock:
                asked[0] += 1
                server.replaced = {name: other} if at <= asked[0] < at + back else {}
            fault = mild(request) if one.seed % 2 else None
            is_first = not any(name in request.headers for name in ("if-match", "if-unmodified-since"))
            return None if fault is answers.no_version and is_first else fault  # without a version no change is found
        server.fault_of = fault_of
        access = Access(one, server)
        cache = one.folder / "cache" if one.chance(0.3) else None
        far = [access.url({"S": name, "V": "b.isonest"}[word]) if word in ("S", "V") else word for word in words]
        far += (["-o", output] if output else []) + (["--cache", cache] if cache else [])
        result = attack.SAME
        for _ in range(2 if cache else 1):
            result = far_run(one, server, access, far, output, rights, "wild", 1024 * MIB, cache)
            if result.what == "wrong":
                break
        return result


def cache(one):
    folder, _ = made(one, "stores")
    outside = one.folder.parent / "outside"
    outside.write_bytes(b"of somebody else" * 100)
    place, mounted = one.folder / "cache", False
    if os.geteuid() == 0 and one.chance(0.15):
        place.mkdir()
        mounted = subprocess.run(["mount", "-t", "tmpfs", "-o", f"size={one.pick('64k', '300k', '1m')}", "tmpfs", place], capture_output=True).returncode == 0
    try:
        with Hostile(folder, seed=one.seed, validators=one.pick(("ETag",), ("ETag", "Last-Modified"))) as server:
            access = Access(one, server)
            server.fault_of = plan(one, one.pick("good", "good", "mild"), has_checksums=False, redirects=not access.is_signed) or server.fault_of
            option = ["--cache", f"{place}{one.pick('', '', ':64k', ':300k', ':1', ':1T')}"]
            for _ in range(int(one.random.integers(2, 5))):
                runs = []
                for number in range(one.pick(1, 1, 2, 3)):
                    words, name = a_query(one)
                    output = one.folder / f"{number}{name}" if name else None
                    right = local(one, at_files(folder, words, output), output, (*words, name))
                    far = at_urls(access, words, output) + option
                    user = 65534 if os.geteuid() == 0 and one.chance(0.1) else None
                    if user is not None:
                        one.folder.chmod(0o777)
                        (one.folder / "tmp").mkdir(exist_ok=True)
                        (one.folder / "tmp").chmod(0o777)
                    stop = (signal.SIGKILL, one.random.uniform(0, 0.2)) if one.chance(0.15) else None
                    runs.append((Run(one, [*far, *access.options], access.environment, stop, user=user,
                                     most_file=40_000 if output is None and one.chance(0.1) else None), output, right, user))
                outputs = {output for _, output, _, _ in runs if output}
                for run, *_ in runs:
                    run.end()
                judge = Judge(one, access.secrets, 1024 * MIB, kept=access.kept)
                for run, output, right, user in runs:
                    judge.must_succeed = user is None and not run.stop and not run.most_file
                    secret = judge.secret_in(run)
                    judge.kept |= {place, one.folder / "tmp"}
                    killed = {path for path in one.folder.iterdir() if path.name.startswith(".") and any(output.name in path.name for output in outputs)
                              } if any(run.stop for run, *_ in runs) else set()
                    if secret:
                        return attack.wrong(f"{run.said()}\n{secret}")
                    if run.code in (-signal.SIGKILL, -signal.SIGXFSZ) and run.stop:
                        continue
                    result = judge(run, outputs | killed, output, right)
                    if result.what == "wrong":
                        (one.folder / "server.log").write_text("\n".join(server.log))
                        return result
                for path in one.folder.iterdir():
                    if path in outputs or path.name.startswith("."):
                        path.unlink()
                if outside.read_bytes() != b"of somebody else" * 100:
                    return attack.wrong("a file outside of the folder was written")
                damage_cache(one, place)
        return attack.SAME
    finally:
        if mounted:
            subprocess.run(["umount", place], check=False)


def tls(one):
    folder, _ = made(one, "stores")
    kind = one.pick("trusted", "trusted", "trusted", "untrusted", "another host", "to http")
    files = certificate(one.folder.parent, "localhost" if kind == "another host" else "127.0.0.1")
    lot, counts, mode = answers.lot_of(one.seed, "tls"), [0], one.pick("good", "mild")

    def broken():
        with server.lock:
            counts[0] += 1
            if kind != "trusted" or mode == "mild" or counts[0] > 3 or lot.random() > 0.4:
                return None
        return lot.choice((b"", b"HTTP/1.1 400 Bad\r\n\r\n", lot.randbytes(300), b"\x15\x03\x03\x00\x02\x02\x28", b"\x16\x03\x03\x40\x00" + bytes(99)))
    server = Hostile(folder, seed=one.seed, tls=files, tls_fault=broken, other_tls=kind != "to http")
    with server:
        access = Access(one, server)
        access.environment["SSL_CERT_FILE"] = "/etc/ssl/certs/ca-certificates.crt" if kind == "untrusted" else str(files[0])
        if kind == "to http":
            server.fault_of = lambda request: lambda answer, *_: answer.plain("302 Found", b"", Location=server.other.place(request.path))
        else:
            server.fault_of = plan(one, mode, redirects=not access.is_signed) or server.fault_of
        words, name = a_query(one)
        output = one.folder / name if name else None
        right = local(one, at_files(folder, words, output), output, (*words, name))
        far = at_urls(access, words, output)
        result = far_run(one, server, access, far, output, right, mode if kind == "trusted" else "wild", 1024 * MIB)
        if kind != "trusted" and result.what == "same":
            return attack.wrong(f"it took an answer: {kind}")
        if kind == "to http" and server.other.seen:
            return attack.wrong("it went from https to http")
        return result


def python(one):
    try:
        isonest = attack.package(one.program)
    except ImportError:
        return attack.refused("the package is not built")
    folder, _ = made(one, "stores")
    level = int(one.pick(0, 1, 2))
    threads = one.pick(1, 1, 3)
    key = "python", level
    if key not in _right:
        with isonest.open(folder / "a.isonest") as near:
            _right[key] = near.values(level)
    mode = one.pick(*MODES)
    secret = f"s3cret{one.seed}x"
    results = []
    with Hostile(folder, seed=one.seed) as server:
        server.fault_of = plan(one, mode, has_checksums=True) or server.fault_of
        if one.chance(0.5):
            where, headers = server.url("a.isonest", f"me:{secret}@"), None
        else:
            where, headers = server.url("a.isonest") + f"?sig={secret}", {"X-Key": secret}

        def work():
            try:
                with isonest.open(where, headers=headers, cache=one.folder / "cache" if one.seed % 3 == 0 else None) as far:
                    same = np.array_equal(far.values(level), _right[key])
                    results.append(attack.SAME if same and secret not in repr(far) else attack.wrong("other values, or a secret in its text"))
            except isonest.Error as error:
                text = str(error) + repr(error)
                results.append(attack.wrong(text) if secret in text or answers_secret(text) or mode == "mild" else attack.refused(type(error).__name__))
        workers = [threading.Thread(target=work) for _ in range(threads)]
        for worker in workers:
            worker.start()
        for worker in workers:
            worker.join()
    return max(results, key=lambda result: ("same", "refused", "wrong").index(result.what)) if len(results) == threads else attack.wrong("no result")


def answers_secret(text):
    return SECRET_OF_OTHERS in text


_client = {}


def ranges(one):
    program = one.program.parent / "isonest_fetch_ranges"
    folder, _ = made(one, "stores")
    if program not in _client:
        _client[program] = subprocess.Popen([program], stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True,
                                            env={**CLEAN, "HOME": str(one.folder)})
    process = _client[program]

    def do(what, **values):
        process.stdin.write(json.dumps({"do": what, **values}) + "\n")
        process.stdin.flush()
        line = process.stdout.readline()
        if not line:
            del _client[program]
            raise RuntimeError(f"the program ended with {process.wait()} at {what} {values}")
        return json.loads(line)
    secret, mode = f"s3cret{one.seed}x", one.pick(*MODES)
    with Hostile(folder, seed=one.seed, validators=one.pick(("ETag", "Last-Modified"), ("ETag",), ("Last-Modified",))) as server:
        fault_of = plan(one, mode)
        server.fault_of = lambda request: answers.drip if mode == "bad" and answers.lot_of(one.seed, request.key, request.times, "drip").random() < 0.05 \
            else fault_of(request)
        answer = do("open", url=server.url("a.raw", f"me:{secret}@") + f"?sig={secret}", file=str(folder / "a.raw"), headers=[f"X-Key: {secret}"],
                    first_wait_ms=2, total_ms=3000, slow_ms=400 if mode == "mild" else 150, slow_bytes=100, connect_ms=2000, budget=1 << 20,
                    cache=one.chance(0.3), known=one.chance(0.3))
        begun = json.dumps(answer)
        if "error" not in answer:
            answer = do("random", reads=int(one.random.integers(1, 60)), threads=int(one.pick(1, 4)), seed=one.seed, most=int(one.pick(100, 30_000)))
        do("close")
        text = json.dumps(answer) + begun
        if mode == "mild" and ("error" in answer or answer["failed"] or answer["wrong"]):
            (one.folder / "server.log").write_text("\n".join(server.log))
        if secret in text or answers_secret(text):
            return attack.wrong("a secret in " + text)
        for request in server.other.seen:
            if secret in json.dumps(request) or "authorization" in request:
                return attack.wrong(f"another server got a secret: {request}")
        if "error" in answer:
            return attack.wrong(text) if mode == "mild" else attack.refused(answer["error"]["kind"])
        if answer["wrong"] or answer["longest"] > 20:
            return attack.wrong(text)
        if answer["failed"]:
            return attack.wrong(text) if mode == "mild" else attack.refused("some ranges")
        return attack.SAME


if __name__ == "__main__":
    attack.require("numcodecs", "zarr")
    sys.exit(attack.main(__doc__, {"ranges": ranges, "store": store, "volume": volume, "zarr": zarr, "changing": changing, "cache": cache,
                                   "tls": tls, "python": python}))
