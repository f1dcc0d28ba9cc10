"""Edge-preserving smoothing of volumes."""
from __future__ import annotations

import os
from typing import Any, NamedTuple, Optional, Sequence

import numpy as np

from . import _core, _images, _sources
from ._arguments import Bytes, Progress, reporting, to_bytes
from ._core import SmoothStep
from ._store import Store


class Smoothed(NamedTuple):
    """The result of :func:`isonest.smooth`. The arrays have the shape of the volume."""

    values: np.ndarray
    """The result, float32."""
    grid: Optional[np.ndarray]
    """True at the nodes of the result's grid; None if not requested."""
    steps: "list[SmoothStep]"
    """A report per step."""
    snapshots: "dict[int, np.ndarray]"
    """The values after each of these steps."""


def smooth(volume: Any, *, steps: int, tau: float, lambda_: float, sigma: Optional[float] = None,
           threshold: float = 0.0, snapshots: Sequence[int] = (), grid: bool = False,
           output: "os.PathLike[str] | str | None" = None, replace: bool = False, memory: Bytes = "1G",
           threads: int = 0, progress: Progress = None, **reading: Any) -> Smoothed:
    """Smooths a volume or an image while preserving edges, by nonlinear diffusion with linear finite elements.

    volume: an array or files as for :func:`isonest.preprocess`, or a :class:`isonest.Store`. No value may be missing.
        reading: how to read it; the arguments of :func:`isonest.preprocess` from ``spacing`` to ``offset``,
        ``headers`` and ``cache``.
    steps: number of time steps. tau: length of a step in squared world units: without edges, N steps smooth like a
        Gaussian with the standard deviation ``sqrt(2 * N * tau)``.
    lambda_: the gradient, in values per world unit, at which diffusion is halved; far above it there is little.
    sigma: standard deviation, in world units, of the Gaussian that smooths the function before its gradient is
        computed; 0: not smoothed, None: the smallest spacing.
    threshold: a step's grid omits nodes where the indicator grad_linf_bar is below this, in values per world unit;
        0: no nodes.
    snapshots: steps after which the values are also returned; 0 is before the first step.
    grid: also return the grid of the result.
    output: a file for the result, .h5, .nrrd, .nii, .vti, .npy, .mha or .raw. replace: overwrite an existing file.
    memory: bytes; must hold all unknowns, but not the returned arrays. threads: 0 is all cores.
    progress: a function ``(phase, done, total, unit)``, or True for bars of tqdm.

    Raises ValueError and subclasses of :class:`isonest.Error`.
    """
    options = _core.SmoothOptions()
    options.steps, options.tau, options.lambda_, options.sigma = int(steps), float(tau), float(lambda_), sigma
    options.threshold, options.snapshots, options.grid = float(threshold), {int(step) for step in snapshots}, bool(grid)
    options.output, options.replace = None if output is None else os.fspath(output), replace
    options.memory, options.threads = to_bytes(memory), int(threads)
    _sources.refuse_unknown_reading("smooth", reading)
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
    ndim = 3 if isinstance(volume, Store) or _sources.is_files(volume) else len(_images.image_of(volume).values.shape)
    shape = values.shape[3 - ndim:]
    return Smoothed(values.reshape(shape), None if nodes is None else nodes.view(np.bool_).reshape(shape), done,
                    {step: array.reshape(shape) for step, array in kept})
