"""Random stores and requests: with valid numbers, and with invalid ones."""
import urllib.parse

import numpy as np

KINDS = ("smooth", "noise", "bytes", "turned", "far", "missing", "labels", "names", "plane", "constant", "thin")
ENDINGS = ("ply", "stl", "obj", "vtp", "vtkhdf", "glb", "3mf", "ngmesh", "vtk", "off", "exe", "PLY", "", "p.ly", "x" * 300)
ODD = ("", " ", "nan", "inf", "-inf", "1e999", "-1e999", "1e308", "-1e308", "1.7976931348623157e308", "5e-324", "-0", "0x10", "1,", ",",
       "1,2", "0,0,0,0", "0,0,0,0,0,0", "1e308,1e308,1e308,1e308", "1e308,-1e308,1e308", "-1e308,-1e308,-1e308,1e308,1e308,1e308",
       "1e-320,0,0,1", "1,2,3,4,5,6,7,8", "9" * 400, "0." + "0" * 400 + "1", "-1", "0", "1", "99", "100", "101", "100000000", "100000001",
       "9223372036854775807", "9223372036854775808", "-9223372036854775808", "18446744073709551616", "1\0", "\0", "1\r\nX: y", "../../x",
       "/etc/passwd", "ä", "\ud800", "\xff\xfe", "%", "%zz", "%0", "+1", "1+1", "1e5", "best", "fast", "largest", "all", "true", "null",
       "0,0,0,40,100,1", "0,0,0,179.99999,100000,1e-300", "1e300,0,0,1e-300,1,1e300", "16,16,-60,40,400.9,9", "a" * 64, "a" * 65, "{}")
NAMES = ("iso", "label", "triangles", "error", "distance", "effort", "camera", "limit", "box", "components", "smooth", "stream", "plane",
         "format", "at", "id", "coarse", "token", "unknown", "", "Iso", "iso[]", "a" * 300)
PATHS = ("/api/store", "/api/histogram", "/api/surface", "/api/slice", "/api/value", "/api/label", "/api/status", "/api/export",
         "/api/command", "/api/cancel")
STRANGE_PATHS = ("/", "/main.js", "/api", "/api/", "//api/store", "/api//store", "/api/store/", "/API/store", "/api/../api/store",
                 "/%61pi/store", "/api%2fstore", "/api/store%00", "/../../etc/passwd", "/%2e%2e/%2e%2e/etc/passwd", "*", "http://evil.example/",
                 "http://127.0.0.1/api/store", "/index.html", "/worker.js", "/site.json", "/isonest.wasm", "/%", "/%f", "/\\", "/a" * 4000,
                 "/api/surface;iso=1", "/api/store#x", "/api/\xff", "?", "/?iso=1")


def make_store(one, isonest, kind=None, most=20, name="s.isonest"):
    """The path of a small store, and its kind."""
    kind = kind or one.pick(*KINDS)
    r, path = one.random, one.folder / name
    z, y, x = (int(n) for n in r.integers(2, most, 3))
    if kind == "plane":
        z = 1
    if kind == "thin":
        z, y, x = one.pick((2, 2, 2), (2, 3, x), (z, 2, 2), (3, y, 2))
    options = {"chunk": one.pick(8, 16, 64)}
    grid = np.meshgrid(*(np.arange(n) for n in (z, y, x)), indexing="ij")
    smooth = sum(np.sin(g * r.uniform(0.1, 0.9) + r.uniform(0, 6)) for g in grid).astype(np.float32)
    noise = r.random((z, y, x)).astype(np.float32)
    values = {"noise": noise, "constant": np.full((z, y, x), r.integers(0, 9), one.pick("f4", "u1", "i2")),
              "bytes": (smooth * 40 + 128 + noise * 9).astype(one.pick("u1", "i2", "u2"))}.get(kind, smooth)
    if kind in ("labels", "names"):
        values = (smooth > 0.3).astype("u1") + 2 * (noise > 0.9).astype("u1")
        options["labels"] = True
        if kind == "names":
            table = one.folder / "names.txt"
            table.write_text("1 Übergang 255 0 128 255\n3 <b>&amp;</b> 1 2 3 255\n77 nowhere\n")
            options["label_names"] = table
    if kind == "missing":
        values = values.copy()
        values[r.random(values.shape) < 0.1] = np.nan
        if one.chance(0.1):
            values[:] = np.nan
    if kind == "plane" and one.chance(0.5):
        values = (values * 20).astype("i2")
    if kind == "turned":
        turn, _ = np.linalg.qr(r.normal(size=(3, 3)))
        lengths = r.uniform(0.3, 3, 3)
        rows = " ".join("(" + ",".join(repr(float(c)) for c in turn[:, k] * lengths[k]) + ")" for k in range(3))
        origin = ",".join(repr(float(c)) for c in r.uniform(-50, 50, 3))
        head = (f"NRRD0004\ntype: float\ndimension: 3\nspace dimension: 3\nsizes: {x} {y} {z}\nspace directions: {rows}\n"
                f"space origin: ({origin})\nendian: little\nencoding: raw\n\n")
        volume = one.folder / "v.nrrd"
        volume.write_bytes(head.encode() + values.astype("<f4").tobytes())
        isonest.preprocess(volume, path, **options)
        return path, kind
    if kind != "plane":
        options["spacing"] = tuple(float(s) for s in r.uniform(0.2, 3, 3)) if one.chance(0.7) else (1.0, 1.0, 1.0)
        options["origin"] = tuple(float(s) for s in r.uniform(-1, 1, 3) * (1e6 if kind == "far" else 10 if one.chance(0.5) else 0))
    volume = values if kind != "plane" else values[0]
    if "labels" in options:  # only for files
        np.save(one.folder / "v.npy", volume)
        volume = one.folder / "v.npy"
    isonest.preprocess(volume, path, **options)
    return path, kind


def target(path, parameters):
    query = urllib.parse.urlencode(list(parameters.items()) if isinstance(parameters, dict) else parameters, errors="surrogatepass")
    return path + ("?" + query if query else "")


def hostile(one):
    """Method, target, and whether its path is one of PROTOCOL.md's; the target may be valid or not."""
    method = one.pick("GET", "GET", "GET", "GET", "GET", "GET", "HEAD", "POST", "PUT", "DELETE", "OPTIONS", "TRACE", "PATCH", "CONNECT", "get", "GETT", "M-SEARCH")
    if one.chance(0.1):
        path = one.pick(*STRANGE_PATHS)
        return method, path if path in ("*", "?") else path + one.pick("", "", "?a=1", "?%", "?&&&", "?=", "?iso=1&iso=1")
    path = one.pick(*PATHS)
    needed = {"/api/surface": {"iso": "0.5"}, "/api/slice": {"plane": "0,0,1,3"}, "/api/value": {"at": "1,1,1"}, "/api/label": {"id": "1"},
              "/api/export": {"iso": "0.5"}, "/api/command": {"iso": "0.5"}}.get(path, {})
    parameters = list(needed.items()) if one.chance(0.8) else []
    for _ in range(int(one.random.integers(0, 4))):
        parameters.append((one.pick(*NAMES), one.pick(*ODD)))
    if one.chance(0.03):
        parameters += [(f"a{i}", "1") for i in range(int(one.random.integers(25, 60)))]
    if parameters and one.chance(0.3):
        at = int(one.random.integers(len(parameters)))
        parameters[at] = (parameters[at][0], one.pick(*ODD))
    text = target(path, parameters)
    if one.chance(0.1):  # invalid percent encodings, and bytes that must not occur in a URL
        at = int(one.random.integers(len(text)))
        text = text[:at] + one.pick("%", "%0", "%g1", "%00", "\x7f", "\xe4", "%ff%fe", "&", "=", "?", "+") + text[at:]
    return one.pick("POST", method) if path == "/api/cancel" else method, text
