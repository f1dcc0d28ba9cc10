"""Senseless requests, from several clients at once."""
import concurrent.futures
import contextlib

import attack as shared
from serving import questions, view

# With a complete store none is 500: what is impossible is the request's fault.
ALLOWED = {200, 204, 400, 403, 404, 405, 409, 413, 503}


def wrong_answer(answer, method, target, heads):
    if answer is None:
        return "no answer"
    if answer.wrong_form():
        return answer.wrong_form()
    if answer.status not in ALLOWED:
        return f"{answer.status} {answer.body[:300]}"
    if answer.status == 204 and not (method == "POST" and target.startswith("/api/cancel")):
        return "204"
    if answer.status == 200 and method not in ("GET", "HEAD"):
        return f"200 for {method}"
    if answer.status == 200 and answer.headers["content-type"] == "application/json" and not heads:
        text = answer.body.decode()
        answer.json
        if "NaN" in text or "Infinity" in text or "-9223372036854775808" in text.replace("-9223372036854775808", "", target.count("-9223372036854775808")):
            return f"a number that is none: {text[:300]}"
    return None


def one_client(server, asked):
    """What is wrong with the answers to these requests, sent on one connection as long as it stays open."""
    s = None
    for method, target in asked:
        heads = method == "HEAD"
        for again in (True, False):
            if s is None:
                s = server.connect()
                answers = view.Answers(s)
            with contextlib.suppress(ConnectionError):
                s.sendall(server.request(server.with_token(target), method))
            try:
                answer = answers.next(head=heads)
            except view.Broken as error:
                return f"{method} {target!r}\n{error}"
            if answer is None and again:  # the server had closed the connection after the previous answer
                s.close()
                s = None
                continue
            break
        wrong = wrong_answer(answer, method, target, heads)
        if wrong:
            return f"{method} {target!r}\n{wrong}"
        if answer.headers.get("connection", "").lower() == "close":
            s.close()
            s = None
    if s:
        s.close()
    return None


def attack(one):
    isonest = shared.package(one.program)
    path, kind = questions.make_store(one, isonest, most=14)
    clients = [[questions.hostile(one) for _ in range(int(one.random.integers(5, 30)))] for _ in range(int(one.random.integers(1, 9)))]
    options = ["--token"] if one.chance(0.3) else []
    server = view.View(one.program, path, one.folder, *options)
    try:
        server.status()
        before = server.holds()
        with concurrent.futures.ThreadPoolExecutor(len(clients)) as pool:
            wrongs = list(pool.map(lambda asked: one_client(server, asked), clients))
        wrong = next(filter(None, wrongs), None) or server.what_is_left(before)
        if not wrong and server.ask(server.with_token("/api/store")).status != 200:
            wrong = "no answer afterwards"
        wrong = wrong or server.wrong_end()
        return shared.wrong(f"{kind}: {wrong}") if wrong else shared.SAME
    finally:
        server.end()
