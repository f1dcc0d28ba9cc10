"""Coordinates of the array and of the world if the axes are not at right angles."""
import numpy as np
import pytest
from conftest import ball, signed_volume

import isonest

STEPS = np.array([[1.0, -0.35, 0.2], [0.1, 0.9, -0.3], [0, 0.2, 1.1]])  # columns: along x, y and z
LENGTHS = np.linalg.norm(STEPS, axis=0)
ORIGIN = np.array([4.0, 5, -6])


def write(path, values):
    vectors = " ".join("(" + ",".join(map(repr, map(float, STEPS[:, a]))) + ")" for a in range(3))
    origin = ",".join(map(repr, map(float, ORIGIN)))
    path.write_bytes(f"NRRD0004\ntype: float\nendian: little\nencoding: raw\ndimension: 3\nspace dimension: 3\n"
                     f"sizes: {' '.join(map(str, values.shape[::-1]))}\nspace directions: {vectors}\n"
                     f"space origin: ({origin})\n\n".encode() + values.astype("<f4").tobytes())
    return path


@pytest.fixture
def sheared(tmp_path):
    isonest.preprocess(write(tmp_path / "v.nrrd", ball((20, 22, 24), 7)), tmp_path / "s.isonest")
    return isonest.open(tmp_path / "s.isonest")


def to_world(points):
    """(z, y, x) times the lengths of the steps."""
    return np.asarray(points, float)[:, ::-1] / LENGTHS @ STEPS.T + ORIGIN


def test_array_coordinates_are_those_along_the_axes(sheared, tmp_path):
    assert np.allclose(np.array(sheared.direction).T * sheared.spacing[::-1], STEPS)
    for volume in (sheared, tmp_path / "v.nrrd"):
        of = sheared.isosurface if volume is sheared else lambda *a, **k: isonest.isosurface(volume, *a, **k)
        array, world = (of(0.0, normals=True, coordinates=c) for c in ("array", "world"))
        assert len(array.vertices) == len(world.vertices)
        assert np.abs(to_world(array.vertices) - world.vertices).max() < 1e-4
        # A ball in lattice coordinates.
        middle = (np.array([20, 22, 24]) - 1) / 2
        assert np.abs(np.linalg.norm(array.vertices / LENGTHS[::-1] - middle, axis=1) - 7).max() < 0.1
        assert abs(signed_volume(world.vertices, world.faces)) == pytest.approx(world.report.volume, rel=1e-4)
        assert abs(world.report.volume / np.linalg.det(STEPS) / (4 / 3 * np.pi * 7**3) - 1) < 0.02
        # Normals are perpendicular to the triangles in both spaces.
        for mesh in (array, world):
            a, b, c = (np.asarray(mesh.vertices, float)[mesh.faces[:, i]] for i in range(3))
            across = np.cross(b - a, c - a)
            of_faces = np.asarray(mesh.normals, float)[mesh.faces].mean(1)
            cosine = np.einsum("ij,ij->i", across, of_faces) / np.linalg.norm(across, axis=1)
            assert np.quantile(np.abs(cosine), 0.05) > 0.9
            assert np.allclose(np.linalg.norm(mesh.normals, axis=1), 1, atol=1e-5)


def test_planes_and_points_are_in_array_coordinates(sheared):
    middle = (np.array([20, 22, 24]) - 1) / 2 * LENGTHS[::-1]
    normal = np.array([0.5, -0.2, 0.7])
    array = sheared.slice(tuple(normal), float(normal @ middle))
    assert len(array.faces) > 50
    assert np.abs(array.vertices @ normal - normal @ middle).max() < 1e-3
    cut = sheared.slice((1, 0, 0), 5 * LENGTHS[2])  # plane number 5 of the array
    assert np.allclose(cut.vertices[:, 0] / LENGTHS[2], 5, atol=1e-4)
    near = sheared.isosurface(0.0, error=0.05, focus=tuple(middle + [7, 0, 0]), falloff=5, cells="tet")
    assert 0 < len(near.faces) < len(sheared.isosurface(0.0, cells="tet").faces)
