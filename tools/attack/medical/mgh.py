"""Random files of FreeSurfer: MGH and MGZ, types, frames, places, tags behind the numbers. The judge is nibabel."""
import gzip
import struct

import numpy as np

import attack

from . import volumes

nibabel = attack.require("nibabel")

CODES = {"u1": 0, "i4": 1, "f4": 3, "i2": 4, "u2": 10}  # nibabel knows no unsigned shorts


def mgh(one):
    kind = one.pick(*CODES)
    frames = int(one.random.integers(1, 4)) if one.chance(0.3) else 1
    shape = volumes.sizes(one)
    stored = volumes.numbers(one, np.dtype(kind), (*shape, frames))
    good = one.chance(0.85)
    size = np.float32(volumes.spacing(one))
    directions = np.float32(volumes.rotation(one))
    centre = np.float32(volumes.origin(one))
    header = struct.pack(">7ih", 1, *shape, frames, CODES[kind], int(one.random.integers(0, 9)), int(good))
    header += np.array([*size, *directions.T.ravel(), *centre], ">f4").tobytes()
    data = header.ljust(284, b"\0") + stored.astype(stored.dtype.newbyteorder(">")).tobytes(order="F")
    if one.chance(0.6):
        data += np.array([2000, 0.1, 3, 1000], ">f4").tobytes()  # of the acquisition
        if one.chance(0.5):
            data += struct.pack(">iq", 3, 5) + b"bert\0"
    path = one.folder / "v.mgh"
    if one.chance(0.4):
        path = one.folder / one.pick("v.mgz", "v.mgh.gz")
        data = gzip.compress(data, 1)
    path.write_bytes(data)

    options = {}
    must = None
    which = int(one.random.integers(frames))
    if frames > 1:
        if one.chance(0.1):
            must = ("several frames, none named", "index")
        else:
            options["index"] = {"t": which}
    if not good:
        # FreeSurfer's default; nibabel's has y and z the other way round.
        size, directions, centre = np.ones(3), np.array([[-1, 0, 0], [0, 0, 1], [0, -1, 0]]), np.zeros(3)
    steps = directions.astype("f8") * size.astype("f8")
    affine = volumes.affine_of(directions.astype("f8"), size.astype("f8"), centre - steps @ (np.array(shape) / 2))
    if kind != "u2":
        image = nibabel.freesurfer.mghformat.MGHImage.from_bytes(gzip.decompress(data) if path.suffix != ".mgh" else data)
        read = np.asarray(image.dataobj)
        if good and not np.allclose(image.affine, affine, rtol=1e-4, atol=1e-4 * np.abs(affine).max()):
            return attack.wrong(f"nibabel and the attacker disagree: affine {image.affine.tolist()} and {affine.tolist()}")
        if not np.array_equal(read.reshape(stored.shape), stored, equal_nan=stored.dtype.kind == "f"):
            return attack.wrong("nibabel and the attacker disagree: values")
    volume = volumes.Volume(np.ascontiguousarray(stored[..., which].T), affine, "mm", must_refuse=must, options=options)
    return volumes.compared(one, path, volume)
