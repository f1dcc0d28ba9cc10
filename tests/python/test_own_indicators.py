"""Own indicators from functions of NumPy arrays and from volumes."""
import pathlib

import numpy as np
import pytest

import isonest


def bytes_of(path):
    return pathlib.Path(path).read_bytes()


def test_a_function_with_the_formula_of_linf_gives_its_numbers(noise, tmp_path):
    isonest.preprocess(noise, tmp_path / "s", indicators="linf_bar,linf_plus,deviation_bar",
                       own={"offset": lambda nodes: np.abs(nodes.offset)}, exact=True, chunk=8)
    store = isonest.open(tmp_path / "s")
    assert store.check().failures == 0
    for saturation in ("bar", "plus"):
        one, other = (store.isosurface(float(np.median(noise)), stop=f"{name}_{saturation}", threshold=0.1)
                      for name in ("own:offset", "linf"))
        assert len(one.faces) > 0 and np.array_equal(one.vertices, other.vertices)
        assert np.array_equal(one.faces, other.faces)


def test_a_function_and_a_volume_with_the_same_numbers_give_the_same_store(noise, tmp_path):
    importance = np.abs(noise) + np.arange(noise.shape[2])
    last = np.array(noise.shape) - 1

    def look_up(nodes):
        return importance[tuple(np.minimum(nodes.node, last).T)]

    isonest.preprocess(noise, tmp_path / "f", own={"importance": look_up}, threads=4)
    isonest.preprocess(noise, tmp_path / "v", own={"importance": importance}, threads=1)
    assert bytes_of(tmp_path / "f") == bytes_of(tmp_path / "v")
    np.save(tmp_path / "importance.npy", importance)
    isonest.preprocess(noise, tmp_path / "n", own={"importance": tmp_path / "importance.npy"})
    assert bytes_of(tmp_path / "n") == bytes_of(tmp_path / "v")


def test_a_function_sees_the_diamonds(noise, tmp_path):
    last = np.array(noise.shape) - 1
    seen = []

    def look(nodes):
        at = lambda p: noise[tuple(np.moveaxis(np.minimum(p, last), -1, 0))]
        assert np.array_equal(nodes.value, at(nodes.node)) and np.array_equal(nodes.end_values, at(nodes.ends))
        assert np.array_equal(nodes.values, at(nodes.vertices)) and nodes.vertices.shape[2:] == (4, 3)
        assert np.array_equal(nodes.node * 2, nodes.ends.sum(axis=1))
        assert np.array_equal(nodes.vertices[:, :, :2], np.broadcast_to(nodes.ends[:, None], nodes.vertices[:, :, :2].shape))
        assert np.allclose(nodes.offset, nodes.value - nodes.end_values.mean(axis=1))
        seen.append((nodes.level, nodes.odd_axes))
        return np.zeros(len(nodes.node))

    isonest.preprocess(noise, tmp_path / "s", own={"look": look})
    assert {kind for _, kind in seen} == {1, 2, 3} and min(seen)[0] == 1


def test_wrong_functions_are_refused(noise, tmp_path):
    def own(function):
        isonest.preprocess(noise, tmp_path / "s", own={"x": function})

    for function in (lambda nodes: -np.ones(len(nodes.node)), lambda nodes: np.full(len(nodes.node), np.nan),
                     lambda nodes: 1.0, lambda nodes: np.zeros((len(nodes.node), 2))):
        with pytest.raises(isonest.InvalidArgumentError):
            own(function)
    with pytest.raises(ZeroDivisionError):
        own(lambda nodes: 1 // 0)
    with pytest.raises(isonest.InvalidArgumentError):
        isonest.preprocess(noise, tmp_path / "s", own={"a b": noise})
    with pytest.raises(isonest.InvalidArgumentError):
        isonest.preprocess(noise, tmp_path / "s", own={"x": noise[1:]})
    with pytest.raises(isonest.InvalidArgumentError):  # a function has no identity
        isonest.preprocess(noise, tmp_path / "s", own={"x": lambda nodes: nodes.value}, resume=True)
    assert not (tmp_path / "s").exists()
