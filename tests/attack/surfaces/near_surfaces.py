"""Surfaces within a distance, and with a given number of triangles."""
import numpy as np

from . import volumes
from .tries import Seen, ask, blurred, full_options, kind, near, require, some_box, store_of, surface, topology, whole, world_box
from .within_errors import on_surface


def ordinary(one, volume):
    """Options of a surface within a distance, and the box in nodes."""
    options = {"distance": float(one.pick(0, 1e-7, 0.01, 0.3, 0.5, 1, 3, 1e3, one.random.random() * 4) * volume.unit)}
    how = one.random.integers(4)
    if how == 0:
        options["effort"] = "fast"
    elif how == 1:
        options["effort"] = "none"
    if one.chance(0.4):
        options["cells"] = "tet" if options.get("effort") == "none" else one.pick("tet", "hex")
    if one.chance(0.2) and options.get("effort") != "none":
        options["close"] = one.pick("below", "above")
    box = some_box(one, volume) if one.chance(0.2) and not volume.turned else None
    if box:
        options["box"] = world_box(volume, *box)
    if one.chance(0.15) and options.get("effort") != "none":
        options |= one.pick({"components": 2}, {"min_component": 30}, {"min_volume": 3 * float(np.prod(volume.spacing))})
    return options, box


@kind
def distance(one):
    """Within a distance: near the full surface in both directions, and with its topology."""
    volume = volumes.volume(one, most=14)
    iso = volumes.isovalue(one, volume.u)
    store = store_of(one, volume)
    options, box = ordinary(one, volume)
    answer = surface
    if one.chance(0.25) and not volume.turned and volume.raw is None and options.get("effort") != "none" \
            and not {"box", "close"} & set(options):
        options["cells"], volume.origin = "hex", np.zeros(3)

        def answer(one, _store, iso, **asked):  # directly from the array, without a store
            return ask(one, one.isonest.isosurface, volume.u, iso, spacing=tuple(volume.spacing[::-1]), normals=False,
                       **asked).in_world()
    elif one.chance(0.2) and options.get("effort") not in ("none", "fast"):
        options["keep_analysis"] = True
    full = Seen(answer(one, store, iso, **full_options(options)), volume)
    blurred(full)
    seen = Seen(answer(one, store, iso, **options), volume)
    require(seen.report.distance_bound <= options["distance"] * (1 + 1e-12),
            f"distance_bound {seen.report.distance_bound} above {options['distance']}")
    near(one, volume, seen, full)
    whole(seen, volume, "close" in options, box)
    if options.get("effort") != "none":
        require(topology(seen) == topology(full), f"topology {topology(full)} -> {topology(seen)}")


@kind
def triangles(one):
    """A number of triangles: not exceeded, and within the distance that is reported."""
    volume = volumes.volume(one, most=12)
    iso = volumes.isovalue(one, volume.u)
    store = store_of(one, volume)
    options = {"triangles": int(one.pick(0, 1, 4, 20, int(one.random.integers(1, 3000)), int(one.random.integers(1, 3000))))}
    way = one.random.integers(5)
    if way == 0:
        options |= {"by": "error"}
    elif way == 1:
        options |= {"effort": "fast"}
    elif way == 2:
        options |= {"distance": one.random.random() * 3 * volume.unit}
    if way and one.chance(0.2):
        options["close"] = True
    if way and one.chance(0.3):
        options["cells"] = one.pick("tet", "hex")
    seen = Seen(surface(one, store, iso, **options), volume)
    blurred(seen)
    if way != 2 or seen.report.within_budget:
        require(len(seen.f) <= options["triangles"], f"{len(seen.f)} of {options['triangles']} triangles")
    if way == 2:
        require(seen.report.distance_bound <= options["distance"] * (1 + 1e-12), "beyond the distance")
    if way == 0:
        on_surface(one, volume, seen, iso, seen.report.error_bound)
    else:
        near(one, volume, seen, Seen(surface(one, store, iso, **full_options(options)), volume))
    whole(seen, volume, "close" in options)
