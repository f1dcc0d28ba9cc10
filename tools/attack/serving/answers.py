"""Questions that make sense, and the library's answers to them."""
import concurrent.futures
import json

import numpy as np

import attack as shared
from serving import questions, truth, view


def _numbers(text):
    return [float(word) for word in text.split(",")]


def made(store, asked, isonest, kind):
    """The mesh that the library makes for these parameters of /api/surface or /api/slice, or its error. None: not asked of it."""
    options = {"coordinates": "world", "threads": 2}
    if "box" in asked:
        box = _numbers(asked["box"])
        options["box"] = (tuple(box[:3]), tuple(box[3:]))
    if "camera" in asked:
        camera = _numbers(asked["camera"])
        options.update(camera=tuple(camera[:3]), fov=camera[3], height=int(camera[4]), pixels=camera[5])
    if "error" in asked:
        options["error"] = float(asked["error"])
    try:
        if kind == "plane" and "plane" not in asked:
            return isonest.InvalidArgumentError  # lines, which are no mesh of this protocol
        if kind == "plane":
            return store.graph(scale=0, vertex_values=store, **options)
        if "plane" in asked:
            plane = _numbers(asked["plane"])
            return store.slice(tuple(plane[:3]), plane[3], **options)
        if "distance" in asked:
            options.update(distance=float(asked["distance"]), effort=asked.get("effort"))
        if asked.get("components") == "largest":
            options["components"] = "largest"
        if "label" in asked:
            for name in ("error", "camera", "fov", "height", "pixels"):
                options.pop(name, None)
            if float(asked.get("error", 0)) > 0 or "camera" in asked or "triangles" in asked:
                return isonest.InvalidArgumentError
            smooth = int(asked["smooth"]) if "smooth" in asked else None
            return store.label_surface(int(asked["label"]), smooth=smooth, normals=smooth is None, **options)
        return store.isosurface(float(asked["iso"]), **options)
    except isonest.Error as error:
        return error


def status_of(error, isonest):
    refusal = error if isinstance(error, type) else type(error)
    if issubclass(refusal, (isonest.InvalidArgumentError, isonest.NotFoundError, isonest.UnsupportedError)):
        return 400
    return 413 if issubclass(refusal, isonest.LimitError) else 500


def _wrong_surface(answer, asked, store, isonest, kind, library):
    if answer.status == 200:
        got = truth.decoded(answer.body, library)
        most = int(asked.get("triangles", asked.get("limit", 1 << 60)))
        if got["triangles"] > most and ("limit" not in asked or "label" not in asked):
            return f"{got['triangles']} triangles of at most {most}"
        chosen = "triangles" in asked or ("limit" in asked and got["stop"] == "error" and got["tolerance"] != float(asked.get("error", 0)))
        if chosen:  # an error that the server found
            asked = {name: asked[name] for name in asked if name not in ("triangles", "limit", "camera", "distance", "effort")}
            asked["error"] = repr(got["tolerance"])
        if "distance" in asked:
            if not got["distance_bound"] <= float(asked["distance"]):
                return f"within {got['distance_bound']} of {asked['distance']}"
            return None  # of a smaller distance, which leaves room for the rounding: its file is compared
        mesh = made(store, asked, isonest, kind)
        if isinstance(mesh, Exception) or isinstance(mesh, type):
            return f"a mesh, where the library says {mesh}"
        wrong = truth.wrong_mesh(got, mesh)
        # Threads round values of a slice in an order of their own, which is in its bound.
        if not wrong and "label" not in asked and abs(got["error_bound"] - mesh.report.error_bound) > 1e-6 * mesh.report.error_bound * ("plane" in asked):
            wrong = f"the bound {got['error_bound']}, not {mesh.report.error_bound}"
        return wrong
    if "triangles" in asked or "limit" in asked:
        return None if answer.status == 413 or isinstance(made(store, asked, isonest, kind), (Exception, type)) else f"{answer.status} {answer.body[:300]}"
    mesh = made(store, asked, isonest, kind)
    if not isinstance(mesh, (Exception, type)):
        return f"{answer.status} {answer.body[:300]}, where the library has a mesh"
    return None if status_of(mesh, isonest) == answer.status else f"{answer.status} {answer.body[:300]}, where the library says {mesh}"


def _wrong_file(answer, asked, store, isonest, kind, folder, name):
    mesh = made(store, asked, isonest, kind)
    path = folder / f"{name}.{asked['format']}"
    if not isinstance(mesh, (Exception, type)):
        try:
            mesh.save(path)
        except isonest.Error as error:
            mesh = error
    if isinstance(mesh, (Exception, type)):
        return None if answer.status == status_of(mesh, isonest) else f"{answer.status} {answer.body[:300]}, where the library says {mesh}"
    if answer.status != 200:
        return f"{answer.status} {answer.body[:300]}, where the library has a file"
    return None if answer.body == path.read_bytes() else "another file than the library's"


def _wrong_value(answer, asked, volume):
    if answer.status != 200:
        return f"{answer.status} {answer.body[:300]}"
    said, at = answer.json, _numbers(asked["at"])
    value, node = volume.value(at)
    if said["world"] != at or said["inside"] != (value is not None):
        near = volume.node(at)
        if np.abs(np.minimum(near, np.array(volume.values.shape[::-1]) - 1 - near)).min() < 1e-5:
            return None  # on the volume's face
        return f"{said} at {at}, where {value} is"
    if value is None or "name" in said:
        return None
    scale = max(float(np.nanmax(np.abs(volume.values.astype(float)), initial=0)), 1e-30)
    if (said["value"] is None) != (not np.isfinite(value)) or (np.isfinite(value) and abs(said["value"] - value) > 1e-6 * scale):
        if said["value"] is None or not np.isfinite(value):  # at a tetrahedron's face the missing corner has no weight
            return None if np.abs(node - np.round(node)).min() < 1e-9 else f"{said['value']}, not {value}"
        return f"{said['value']}, not {value}"
    return None


def wrong_answer(answer, path, asked, store, volume, isonest, kind, library, folder, name):
    if answer is None:
        return "no answer"
    if answer.wrong_form():
        return answer.wrong_form()
    if path == "/api/value":
        return _wrong_value(answer, asked, volume)
    if path == "/api/command":
        return None if answer.status in (200, 400) else f"{answer.status} {answer.body[:300]}"
    if path == "/api/export":
        return _wrong_file(answer, asked, store, isonest, kind, folder, name)
    return _wrong_surface(answer, asked, store, isonest, kind, library)


def attack(one):
    library = truth.codec()
    if library is None:
        return shared.refused("no meshoptimizer to decode with")
    isonest = shared.package(one.program)
    path, kind = questions.make_store(one, isonest)
    store = isonest.open(path)
    volume = truth.Volume(store)
    asked = [questions.sensible(one, volume, kind) for _ in range(24)]
    server = view.View(one.program, path, one.folder)
    try:
        before = server.holds()
        with concurrent.futures.ThreadPoolExecutor(int(one.random.integers(1, 9))) as pool:
            answers = list(pool.map(lambda q: server.ask(questions.target(*q)), asked))
        for i, ((where, parameters), answer) in enumerate(zip(asked, answers)):
            wrong = wrong_answer(answer, where, dict(parameters), store, volume, isonest, kind, library, one.folder, str(i))
            if wrong:
                return shared.wrong(f"{kind}: {questions.target(where, parameters)}\n{wrong}")
        said = server.ask("/api/store").json
        if said["nodes"] != list(volume.values.shape[::-1]):
            return shared.wrong(f"nodes {said['nodes']}")
        histogram = server.ask("/api/histogram")
        done = one.run("info", path, "--histogram", "--json")
        if histogram.status != 200 or done.code != 0 or json.loads(done.out)["histogram"] != histogram.json:
            return shared.wrong(f"{kind}: histogram {histogram.status} {histogram.body[:300]}")
        wrong = server.what_is_left(before) or server.wrong_end()
        return shared.wrong(f"{kind}: {wrong}") if wrong else shared.SAME
    finally:
        server.end()
