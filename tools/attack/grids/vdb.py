"""Random OpenVDB files by pyopenvdb; the judges are the array that was written and pyopenvdb's own reading."""
import attack
import numpy as np
import pyopenvdb

from . import compare


def _transform(one):
    """A matrix of row vectors, index * matrix."""
    way = one.pick("uniform", "scale", "flip", "turn", "none", "mirror")
    matrix = np.eye(4)
    if way == "none":
        return matrix
    size = 10.0 ** one.random.uniform(-3, 3)
    scales = [size] * 3 if way in ("uniform", "turn", "mirror") or one.chance(0.3) else 10.0 ** one.random.uniform(-2, 2, 3)
    matrix[:3, :3] = np.diag(scales)
    if way == "flip":
        matrix[:3, :3] *= [one.pick(-1, 1) for _ in range(3)]
    elif way in ("turn", "mirror"):
        turn, _ = np.linalg.qr(one.random.normal(size=(3, 3)))
        turn *= np.linalg.det(turn) * (-1 if way == "mirror" else 1)
        matrix[:3, :3] = matrix[:3, :3] @ turn
    matrix[3, :3] = one.random.normal(size=3) * 10
    return matrix


def _grid(one, name):
    """A grid, and what it holds: the place of the first voxel, values [z, y, x], which of them are active."""
    way = one.pick("dense", "sparse", "sparse", "levelset", "filled", "tiles", "single")
    background = float(np.float32(one.pick(0, 0, 1.5, -3, 1e30)))
    grid = pyopenvdb.FloatGrid(background)
    if way == "levelset":
        radius, voxel = one.random.uniform(2, 5), one.pick(1.0, 0.5)
        grid = pyopenvdb.createLevelSetSphere(radius, tuple(one.random.uniform(-3, 3, 3)), voxel, one.random.uniform(2, 4))
    else:
        size = [int(one.random.integers(1, 20)) for _ in range(3)]  # x, y, z
        at = tuple(int(i) for i in one.random.integers(-20, 20, 3)) if one.chance(0.8) else (100000, -70000, 5)
        data = compare.numbers(one, size, "f4")
        if way == "sparse":
            data[one.random.random(size) < 0.9] = background
        elif way == "single":
            data = data[:1, :1, :1]
        grid.copyFromArray(data, ijk=at, tolerance=0)
        if way in ("filled", "tiles"):
            low = [int(i) for i in one.random.integers(-4, 4, 3)]
            long = 16 if way == "tiles" else 6
            grid.fill(low, [i + int(one.random.integers(1, long)) for i in low], float(np.float32(one.random.normal())), one.chance(0.7))
            if at[0] == 100000:
                grid.clear()
                grid.fill(low, [i + 9 for i in low], 2.5, True)
            if one.chance(0.5):
                grid.prune(0)
        for _ in range(one.pick(0, 0, 3)):  # single voxels, some of them inactive
            place = tuple(int(i) for i in np.array(at if way not in ("filled", "tiles") else (0, 0, 0)) + one.random.integers(-3, 3, 3))
            accessor = grid.getAccessor()
            (accessor.setValueOn if one.chance(0.6) else accessor.setValueOff)(place, 7.25)
    matrix = _transform(one)
    if way != "levelset" or one.chance(0.5):
        grid.transform = pyopenvdb.createLinearTransform(matrix.tolist())
    grid.name = name
    if one.chance(0.2):
        grid.saveFloatAsHalf = True
    return grid


def _expected(grid):
    low, high = (np.array(corner) for corner in grid.evalActiveVoxelBoundingBox())
    size = high - low + 1
    data = np.empty(size, np.float32)
    grid.copyToArray(data, ijk=tuple(int(i) for i in low))
    first = np.array(grid.transform.indexToWorld(tuple(float(i) for i in low)))
    steps = []
    for a in range(3):
        next_one = low.astype(float)
        next_one[a] += 1
        steps.append(np.array(grid.transform.indexToWorld(tuple(next_one))) - first)
    steps = np.array(steps)  # rows
    spacing = np.linalg.norm(steps, axis=1)
    values = data.transpose(2, 1, 0)
    directions = steps / spacing[:, None]
    cells = np.maximum(size - 1, 1)
    straight = np.diag(np.copysign(spacing, np.diag(steps)))
    along = ((np.abs(steps - straight) * cells[:, None]).sum(axis=0) < 0.1 * spacing).all()
    if along:
        for a in range(3):
            if steps[a, a] < 0:
                values = np.flip(values, 2 - a)
                first[a] -= spacing[a] * (size[a] - 1)
        directions = np.eye(3)
    elif np.linalg.det(directions) < 0:
        first = first + steps[0] * (size[0] - 1)
        directions[0] *= -1
        values = np.flip(values, 2)
    return compare.Expected(values=values, spacing=tuple(spacing), origin=tuple(first), direction=tuple(directions.ravel()), single=True)


def grid(one):
    path = one.folder / "v.vdb"
    names = ["density", "größe", "a b", "density[1]", ""]
    grids = [_grid(one, names[int(one.random.integers(len(names)))])]
    if one.chance(0.4):
        grids += [_grid(one, "other")]
    if one.chance(0.2):
        grids.append(one.pick(pyopenvdb.BoolGrid, pyopenvdb.Vec3SGrid)())
        grids[-1].name = "of another type"
    order = one.random.permutation(len(grids))
    wanted = grids[0]
    pyopenvdb.write(str(path), [grids[i] for i in order], metadata={"author": "a"} if one.chance(0.3) else None)
    floats = [g for g in grids if isinstance(g, pyopenvdb.FloatGrid)]
    options = {"dataset": wanted.name} if wanted.name and (len(floats) > 1 or one.chance(0.5)) else {}
    judge = pyopenvdb.read(str(path), wanted.name)
    if judge.activeVoxelCount() == 0:
        return compare.differs(one, path, compare.Expected(np.zeros((1, 1, 1)), refusals=("no active values", "must")), **options)
    expected = _expected(judge)
    if not wanted.saveFloatAsHalf and not np.array_equal(_expected(wanted).values, expected.values, equal_nan=True):
        return attack.wrong("the judges differ: pyopenvdb reads other values than it wrote")
    refusals = ("several", "there are 2 grids") if not options and len(floats) > 1 else ()
    expected.refusals = refusals
    return compare.differs(one, path, expected, **options)
