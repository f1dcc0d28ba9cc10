"""Volumes smoothed, with their edges kept."""
from __future__ import annotations

import os
from typing import Any, NamedTuple, Optional, Sequence

import numpy as np

from . import _core, _sources
from ._arguments import Bytes, Progress, reporting, to_bytes
from ._core import SmoothStep
from ._store import Store


class Smoothed(NamedTuple):
    """What :func:`isonest.smooth` makes. The arrays have the volume's shape."""

    values: np.ndarray
    """float32."""
    grid: Optional[np.ndarray]
    """True at the nodes of the result's grid; None if it was not asked for."""
    steps: "list[SmoothStep]"
    """What each of them did."""
    snapshots: "dict[int, np.ndarray]"
    """The values after these steps."""


def smooth(volume: Any, *, steps: int, tau: float, lambda_: float, sigma: Optional[float] = None,
           threshold: float = 0.0, snapshots: Sequence[int] = (), grid: bool = False,
           output: "os.PathLike[str] | str | None" = None, replace: bool = False, memory: Bytes = "1G",
           threads: int = 0, progress: Progress = None, **reading: Any) -> Smoothed:
    """Smooths a volume or an image and keeps its edges: nonlinear diffusion by linear finite elements.

    volume: an array or files as of :func:`isonest.preprocess`, or a :class:`isonest.Store`. reading: how it is read,
        the arguments of :func:`isonest.preprocess` from ``spacing`` to ``offset``, ``headers`` and ``cache``. All values have to be numbers.
    steps: how many. tau: time of a step, in squares of world units: without edges, N steps smooth as a Gaussian of
        standard deviation ``sqrt(2 * N * tau)`` does.
    lambda_: the gradient at which half flows, in values per world unit; well above it little does.
    sigma: the gradient is that of the function smoothed by this Gaussian, in world units; 0 is not smoothed, None is
        the smallest spacing.
    threshold: nodes are left out of a step's grid where the indicator grad_linf_bar is below, in values per world
        unit; 0 is all nodes.
    snapshots: steps after which the values are kept too, 0 is before the first.
    grid: also the grid of the result.
    output: a file for the result, .h5, .nrrd, .nii, .vti, .npy, .mha or .raw; replace: an existing one.
    memory: all unknowns are held in it, beside the arrays that are returned. threads: 0 is all cores.
    """
    options = _core.SmoothOptions()
    options.steps, options.tau, options.lambda_, options.sigma = int(steps), float(tau), float(lambda_), sigma
    options.threshold, options.snapshots, options.grid = float(threshold), {int(step) for step in snapshots}, bool(grid)
    options.output, options.replace = None if output is None else os.fspath(output), replace
    options.memory, options.threads = to_bytes(memory), int(threads)
    source: Any
    if isinstance(volume, Store):
        if reading:
            raise ValueError(f"{next(iter(reading))}= is for volumes, and this is a store")
        source = volume._core
    else:
        source = _sources.of_volume(volume, identified=False, memory=options.memory, **reading)
        options.memory -= _sources.for_fetching(volume, options.memory)
    with reporting(progress) as report:
        values, nodes, done, kept = _core.smooth(source, options, report)
    shape = values.shape if isinstance(volume, Store) else tuple(getattr(volume, "shape", values.shape))
    return Smoothed(values.reshape(shape), None if nodes is None else nodes.view(np.bool_).reshape(shape), done,
                    {step: array.reshape(shape) for step, array in kept})
