#!/usr/bin/python3
"""isonest smooth compared with ITK's and VTK's anisotropic diffusion: noise of a known size is added to a volume,
each program removes it, and the result is compared with the volume without noise.

usage: diffusion_peers.py BUILD VOLUME.raw NX NY NZ TYPE [--noise PART] [--threads N] [--folder FOLDER]

BUILD contains bin/isonest and bin/isonest_itk_diffusion (-DISONEST_BENCH=ON). VOLUME: raw numbers of a NumPy type
(u1, >u2, <f4), optionally gzip. Noise: Gaussian, PART of the range (0.05). PSNR in dB, relative to the range. Each
program is tried with several parameters; the time is that of the fewest iterations (for isonest: steps) that reach
the named PSNR. ITK and isonest run as programs, VTK in this one; ITK and VTK without reading and writing files.
"""
import argparse
import gzip
import json
import os
import pathlib
import re
import subprocess
import sys
import time

import numpy

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1]))
import needs  # noqa: E402

parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
parser.add_argument("build", type=pathlib.Path)
parser.add_argument("volume", type=pathlib.Path)
parser.add_argument("dims", type=int, nargs=3)
parser.add_argument("type")
parser.add_argument("--noise", type=float, default=0.05)
parser.add_argument("--threads", type=int, default=2)
parser.add_argument("--folder", type=pathlib.Path, default=pathlib.Path("."))
options = parser.parse_args()
isonest, itk = options.build / "bin/isonest", options.build / "bin/isonest_itk_diffusion"
needs.require(needs.program(isonest), needs.program(itk), needs.module("vtk"))
from vtkmodules.util.numpy_support import numpy_to_vtk, vtk_to_numpy  # noqa: E402
from vtkmodules.vtkCommonDataModel import vtkImageData  # noqa: E402
from vtkmodules.vtkImagingGeneral import vtkImageAnisotropicDiffusion3D  # noqa: E402

nx, ny, nz = options.dims
data = options.volume.read_bytes()
data = gzip.decompress(data) if data[:2] == b"\x1f\x8b" else data
clean = numpy.frombuffer(data, options.type)[:nx * ny * nz].astype(numpy.float32).reshape(nz, ny, nx)
span = float(clean.max() - clean.min())
noisy = clean + numpy.random.default_rng(1).normal(0, options.noise * span, clean.shape).astype(numpy.float32)
source, result = options.folder / "noisy.raw", options.folder / "smooth.raw"
noisy.tofile(source)


def psnr(values):
    return 10 * numpy.log10(span**2 / float(numpy.mean((values.reshape(clean.shape) - clean)**2)))


def timed(*command):
    """(output, MB of memory)"""
    done = subprocess.run(["/usr/bin/time", "-f", "RSS %M", *map(str, command)], capture_output=True, text=True,
                          check=True)
    return done.stdout, int(re.search(r"RSS (\d+)", done.stderr)[1]) / 1000


def ours(part, tau, steps, threshold):
    """(PSNR, seconds of the steps, MB, share of active nodes in the last step)"""
    out, memory = timed(isonest, "smooth", source, "--dims", f"{nx},{ny},{nz}", "--type", "float32", "--steps",
                        steps, "--tau", tau, "--lambda", part * span, "--sigma", 0 if steps == 1 else 0.7,
                        "--threshold", threshold * span, "--memory", "20G", "--threads", options.threads, "--force",
                        "-o", result, "--json")
    report = json.loads(out)
    return (psnr(numpy.fromfile(result, numpy.float32)), report["seconds"], memory,
            report["steps"][-1]["unknowns"] / clean.size)


def by_itk(conductance, iterations):
    out, memory = timed(itk, source, nx, ny, nz, iterations, 0.0625, conductance, options.threads, result)
    return psnr(numpy.fromfile(result, numpy.float32)), float(out), memory


def by_vtk(threshold, iterations):
    image = vtkImageData()
    image.SetDimensions(nx, ny, nz)
    image.GetPointData().SetScalars(numpy_to_vtk(noisy.ravel()))
    diffusion = vtkImageAnisotropicDiffusion3D()
    diffusion.SetInputData(image)
    diffusion.SetNumberOfIterations(iterations)
    diffusion.SetDiffusionThreshold(threshold * span)
    diffusion.SetDiffusionFactor(1.0)
    diffusion.SetNumberOfThreads(options.threads)
    diffusion.EdgesOn(), diffusion.FacesOn(), diffusion.CornersOn()
    start = time.perf_counter()
    diffusion.Update()
    seconds = time.perf_counter() - start
    return psnr(vtk_to_numpy(diffusion.GetOutput().GetPointData().GetScalars())), seconds


print(f"noisy: {psnr(noisy):.2f} dB", flush=True)
for conductance in (1, 2, 4):
    for iterations in (2, 5, 10, 20):
        quality, seconds, memory = by_itk(conductance, iterations)
        print(f"ITK conductance {conductance} iterations {iterations}: {quality:.2f} dB {seconds:.2f} s "
              f"{memory:.0f} MB", flush=True)
for threshold in (0.1, 0.2, 0.4):
    for iterations in (2, 4, 8):
        quality, seconds = by_vtk(threshold, iterations)
        print(f"VTK threshold {threshold} iterations {iterations}: {quality:.2f} dB {seconds:.2f} s", flush=True)
for part in (0.03, 0.06, 0.12):
    for tau, steps in ((0.25, 2), (0.5, 2), (1, 2), (0.5, 4)):
        for threshold in (0, 0.03, 0.06):
            quality, seconds, memory, share = ours(part, tau, steps, threshold)
            print(f"isonest lambda {part} of the range tau {tau} steps {steps} threshold {threshold}: {quality:.2f} dB "
                  f"{seconds:.2f} s {memory:.0f} MB, {100 * share:.0f} % of the nodes", flush=True)
os.remove(source)
os.remove(result)
