#!/usr/bin/python3
"""Regenerates color_map_tables.inc: the usual maps of Matplotlib (CC0, or as noted there; python3-matplotlib) and of
cmocean (K. Thyng, MIT License, https://github.com/matplotlib/cmocean), each as 33 evenly spaced colours.

usage: make_color_maps.py FOLDER_OF_CMOCEANS_RGB_TEXTS
"""
import pathlib
import sys

import matplotlib
import numpy as np

COUNT = 33
MATPLOTLIB = ["viridis", "plasma", "inferno", "magma", "cividis", "turbo", "gray", "bone", "hot", "jet", "coolwarm", "RdBu",
              "Spectral", "PuOr", "twilight", "terrain"]
CMOCEAN = ["thermal", "haline", "ice", "deep", "dense", "matter", "balance", "delta", "curl", "topo", "phase"]


def line(name, colors):
    text = "".join("%02x%02x%02x" % tuple(np.rint(255 * np.asarray(c[:3])).astype(int)) for c in colors)
    parts = [text[i:i + 66] for i in range(0, len(text), 66)]
    return "{\"%s\",\n %s}," % (name, "\n ".join(f'"{part}"' for part in parts))


places = np.linspace(0, 1, COUNT)
lines = [line(name, matplotlib.colormaps[name](places)) for name in MATPLOTLIB]
lines.append(line("blue-red", [np.array([59, 76, 192]) / 255 * (1 - 2 * t) + np.array([221] * 3) / 255 * 2 * t if t < 0.5 else
                               np.array([221] * 3) / 255 * (2 - 2 * t) + np.array([180, 4, 38]) / 255 * (2 * t - 1)
                               for t in places]))
for name in CMOCEAN:
    table = np.loadtxt(pathlib.Path(sys.argv[1]) / f"{name}-rgb.txt")
    at = places * (len(table) - 1)
    lines.append(line(name, np.stack([np.interp(at, np.arange(len(table)), column) for column in table.T], 1)))
header = "// Made by make_color_maps.py from Matplotlib's and cmocean's maps; their licences: CC0 and BSD-like, MIT.\n"
pathlib.Path(__file__).with_name("color_map_tables.inc").write_text(header + "// clang-format off\n" + "\n".join(lines)
                                                                    + "\n// clang-format on\n")
