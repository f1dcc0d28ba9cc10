"""Fixtures shared by the tests of the Python package."""
import numpy as np
import pytest


def ball(shape, radius, dtype=np.float32, spacing=(1, 1, 1)):
    """radius minus the distance from the middle: the surface at 0 is a sphere, values inside are larger."""
    axes = np.meshgrid(*[(np.arange(n) - (n - 1) / 2) * s for n, s in zip(shape, spacing)], indexing="ij")
    return (radius - np.sqrt(sum(a * a for a in axes))).astype(dtype)


def area(vertices, faces):
    a, b, c = (np.asarray(vertices, float)[faces[:, i]] for i in range(3))
    return np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2


def signed_volume(vertices, faces):
    a, b, c = (np.asarray(vertices, float)[faces[:, i]] for i in range(3))
    return np.einsum("ij,ij->", a, np.cross(b, c)) / 6


def euler_number(vertices, faces):
    edges = np.sort(np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]), axis=1)
    return len(vertices) - len(np.unique(edges, axis=0)) + len(faces)


@pytest.fixture
def store_path(tmp_path):
    return tmp_path / "x.isonest"


@pytest.fixture(scope="session")
def noise():
    """Smooth enough for a surface of few components, with different numbers of nodes along each axis."""
    rng = np.random.default_rng(1)
    z, y, x = np.mgrid[:40, :33, :27] / 8.0
    field = sum(np.sin(z * a + p) * np.cos(y * b + q) + np.sin(x * c + r)
                for a, b, c, p, q, r in rng.uniform(0.5, 1.5, (4, 6)))
    return field.astype(np.float32)
