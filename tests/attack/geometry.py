#!/usr/bin/env python3
"""Attacks what isonest promises of surfaces, slices and labels: random hard volumes, random queries, independent
judges.

The judges compute the data's function and its surface from the values alone (surfaces/function.py), and examine meshes
with VTK, scipy and brute force (surfaces/judges.py). Lengths are in units of the smallest distance between nodes.
"""
import sys

import attack

attack.require("numpy", "scipy", "vtk", "h5py")
from surfaces import near_surfaces, of_labels, parts, planes, studies, within_errors  # noqa: E402

KINDS = (within_errors.error, within_errors.simplify_error, within_errors.full, within_errors.exact_hexahedra,
         within_errors.several, within_errors.plane_data, near_surfaces.distance, near_surfaces.triangles, parts.closed,
         parts.components, parts.box, parts.view, planes.slices, planes.contours, of_labels.labels,
         of_labels.stepped_labels, of_labels.label_parts,
         studies.study)

if __name__ == "__main__":
    sys.exit(attack.main(__doc__, {tried.__name__: tried for tried in KINDS}))
