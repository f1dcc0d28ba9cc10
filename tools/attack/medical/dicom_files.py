"""Random DICOM files as pydicom writes them: numbers in any bits, places, and what else a header may have in a reader's way."""
import dataclasses

import numpy as np

import attack

from . import volumes

pydicom = attack.require("pydicom")
from pydicom.dataset import Dataset, FileDataset, FileMetaDataset  # noqa: E402
from pydicom.sequence import Sequence  # noqa: E402
from pydicom.uid import BasicTextSRStorage, CTImageStorage, ExplicitVRBigEndian, ExplicitVRLittleEndian, ImplicitVRLittleEndian  # noqa: E402

SYNTAXES = (ImplicitVRLittleEndian, ExplicitVRLittleEndian, ExplicitVRBigEndian)


def text(value):
    """A decimal string: at most 16 characters."""
    return next(t for t in (f"{value:.{digits}g}" for digits in range(12, 0, -1)) if len(t) <= 16)


@dataclasses.dataclass
class Bits:
    allocated: int
    stored: int
    high: int
    signed: bool
    floating: bool = False

    def range(self):
        return (-2**(self.stored - 1), 2**(self.stored - 1) - 1) if self.signed else (0, 2**self.stored - 1)

    def dtype(self):
        kind = "f" if self.floating else "i" if self.signed else "u"
        return np.dtype(f"{kind}{self.allocated // 8}")

    def numbers(self, one, shape):
        """Stored numbers, their ends among them."""
        if self.floating:
            return volumes.numbers(one, self.dtype(), shape)
        low, high = self.range()
        values = one.random.integers(low, high, shape, endpoint=True, dtype="i8")
        if one.chance(0.3):
            values.flat[one.random.integers(values.size)] = one.pick(low, high)
        return values

    def packed(self, one, values, order, noise=True):
        """Bytes, with anything in the bits that are not used (overlays lay there once)."""
        if self.floating:
            return values.astype(self.dtype().newbyteorder(order)).tobytes()
        mask = (1 << self.stored) - 1
        shift = self.high + 1 - self.stored
        words = (values.astype("i8") & mask) << shift
        if noise:
            words |= one.random.integers(0, 1 << self.allocated, values.shape, dtype="i8") & ~(mask << shift) & ((1 << self.allocated) - 1)
        elif self.signed and shift == 0:
            words = values.astype("i8")  # the sign goes on to the top
        return words.astype("u8").astype(f"{order}u{self.allocated // 8}").tobytes()


def bits(one, floats=True):
    if floats and one.chance(0.05):
        size = one.pick(32, 64)
        return Bits(size, size, size - 1, True, True)
    allocated = int(one.pick(8, 16, 16, 16, 32))
    stored = allocated if one.chance(0.4) else int(one.random.integers(max(1, allocated // 2), allocated + 1))
    high = stored - 1 if one.chance(0.8) else int(one.random.integers(stored - 1, allocated))
    return Bits(allocated, stored, high, one.chance(0.4))


def stored_as(values, b):
    """Stored numbers in the type that they have as they are."""
    return values.astype(b.dtype())


def clutter(one, d):
    """Elements that a reader has to get across: sequences of every kind of length, private ones, an icon, overlays."""
    if one.chance(0.3):
        inner = Dataset()
        inner.CodeValue, inner.CodeMeaning = "1", "something"
        inner.Rows, inner.Columns, inner.ImagePositionPatient = 3, 4, [9, 9, 9]
        outer = Dataset()
        outer.PurposeOfReferenceCodeSequence = Sequence([inner, inner])
        outer.PixelSpacing, outer.RescaleSlope, outer.BitsStored = [7, 7], 9, 3
        d.SourceImageSequence = Sequence([outer] * int(one.random.integers(0, 3)))
        d["SourceImageSequence"].is_undefined_length = one.chance(0.5)
        for item in d.SourceImageSequence:
            item.is_undefined_length_sequence_item = one.chance(0.5)
    if one.chance(0.2):
        icon = Dataset()
        icon.Rows = icon.Columns = 2
        icon.BitsAllocated = icon.BitsStored = 8
        icon.HighBit, icon.PixelRepresentation, icon.SamplesPerPixel = 7, 0, 1
        icon.PixelData = b"\1\2\3\4"
        icon["PixelData"].VR = "OB"
        d.IconImageSequence = Sequence([icon])
        d["IconImageSequence"].is_undefined_length = one.chance(0.5)
    if one.chance(0.2):
        block = d.private_block(0x0029, "SOME MAKER", create=True)
        block.add_new(0x10, "OB", one.random.bytes(2 * int(one.random.integers(1, 400))))
        block.add_new(0x11, "UN", one.random.bytes(2 * int(one.random.integers(1, 40))))
        block.add_new(0x12, "LO", "text")
    if one.chance(0.1):
        d.add_new(0x60000010, "US", 4)
        d.add_new(0x60003000, "OW", b"\0\0")
    if one.chance(0.1):
        d.add_new(0xFFFCFFFC, "OB", b"\0" * 20)  # behind the numbers
    if one.chance(0.1):
        d.ImageComments = "x" * int(one.random.integers(1, 9000))
    if one.chance(0.1):
        d.SpecificCharacterSet, d.PatientName = "ISO_IR 192", "Ü^é"


def uid(one):
    return "1.2." + ".".join(str(int(one.random.integers(1, 10**8))) for _ in range(3))


def image(one, path, values, b, *, syntax=ExplicitVRLittleEndian, series="1.2.3", kind=CTImageStorage, noise=True, clutters=True, **elements):
    """Writes a file of an image, [y, x], or of frames, [frame, y, x]. Elements that are None are left out."""
    meta = FileMetaDataset()
    meta.MediaStorageSOPClassUID = kind
    meta.MediaStorageSOPInstanceUID = elements.get("SOPInstanceUID") or uid(one)
    meta.TransferSyntaxUID = syntax
    d = FileDataset(str(path), {}, file_meta=meta, preamble=b"\0" * 128)
    d.is_little_endian, d.is_implicit_VR = syntax != ExplicitVRBigEndian, syntax == ImplicitVRLittleEndian
    d.SOPClassUID, d.SOPInstanceUID = kind, meta.MediaStorageSOPInstanceUID
    d.SeriesInstanceUID, d.StudyInstanceUID, d.Modality, d.PatientName = series, "1.2.9", "CT", "Nobody"
    d.Rows, d.Columns = values.shape[-2:]
    if values.ndim == 3:
        d.NumberOfFrames = len(values)
    d.SamplesPerPixel, d.PhotometricInterpretation = 1, one.pick("MONOCHROME2", "MONOCHROME2", "MONOCHROME1")
    d.BitsAllocated, d.BitsStored, d.HighBit, d.PixelRepresentation = b.allocated, b.stored, b.high, int(b.signed)
    order = "<" if d.is_little_endian else ">"
    data = b.packed(one, values, order, noise)
    data += b"\0" * (len(data) % 2)
    if b.floating:
        for name in ("BitsStored", "HighBit", "PixelRepresentation"):
            delattr(d, name)
        d.add_new(0x7FE00008 if b.allocated == 32 else 0x7FE00009, "OF" if b.allocated == 32 else "OD", data)
    else:
        d.PixelData = data
        d["PixelData"].VR = "OB" if b.allocated == 8 and syntax != ImplicitVRLittleEndian and (
            syntax == ExplicitVRBigEndian or one.chance(0.5)) else "OW"
    if clutters:
        clutter(one, d)
    for key, value in elements.items():
        if value is not None:
            setattr(d, key, value)
        elif key in d:
            delattr(d, key)
    if clutters and syntax != ImplicitVRLittleEndian and one.chance(0.1):
        for name in one.random.choice(["ImagePositionPatient", "PixelSpacing", "RescaleSlope", "SliceThickness", "PatientName"], 3):
            if isinstance(elements.get(name), (str, list)):  # as tools that do not know an element leave it
                value = elements[name] if isinstance(elements[name], str) else "\\".join(elements[name])
                tag = pydicom.datadict.tag_for_keyword(name)
                d[tag] = pydicom.DataElement(tag, "UN", value.encode() + b" " * (len(value) % 2))
    path.parent.mkdir(exist_ok=True, parents=True)
    d.save_as(path, write_like_original=False)
    return d


@dataclasses.dataclass
class Place:
    """Where images lie: rows along `turn`'s first column, columns along the second, slices along the third or against it."""
    turn: np.ndarray
    size: np.ndarray  # of a voxel along columns (x), rows (y), slices
    first: np.ndarray

    def elements(self):
        return {"ImageOrientationPatient": [text(v) for v in (*self.turn[:, 0], *self.turn[:, 1])],
                "PixelSpacing": [text(self.size[1]), text(self.size[0])]}

    def at(self, z, aside=(0, 0)):
        """In the world: slice z, moved by parts of the smaller side of a pixel within it."""
        return self.first + self.turn[:, 2] * self.size[2] * z + self.turn[:, :2] @ (self.size[:2].min() * np.asarray(aside, float))

    def affine(self):
        return volumes.affine_of(self.turn, self.size, self.first)


def place(one):
    turn = volumes.rotation(one)
    turn[:, 2] = np.cross(turn[:, 0], turn[:, 1])
    size = np.array([float(text(v)) for v in volumes.spacing(one)])
    return Place(turn, size, volumes.origin(one))


def position(at):
    return [text(v) for v in at]


def scales(one, count):
    """Slope and intercept of each slice, or None where it has none; whether they differ."""
    way = one.random.random()
    if way < 0.35:
        return [None] * count
    if way < 0.75:
        whole = one.chance(0.6)
        pair = (float(one.random.integers(-3, 4) or 1), float(one.random.integers(-1100, 1100))) if whole else \
            (float(text(one.random.normal() or 1)), float(text(one.random.normal() * 100)))
        return [pair] * count
    return [(float(text(abs(one.random.normal()) + 0.01)), float(text(one.random.normal() * 10))) for _ in range(count)]


def scale_elements(pair):
    return {} if pair is None else {"RescaleSlope": text(pair[0]), "RescaleIntercept": text(pair[1])}


def meaning(stored, b, pairs):
    """Values [z, y, x] and their type in the store."""
    typed = stored_as(stored, b)
    pairs = [p or (1, 0) for p in pairs]
    if len(set(pairs)) <= 1:
        return volumes.scaled(typed, *pairs[0], None if b.floating else b.range())
    to = "f4" if typed.dtype.itemsize <= 2 or typed.dtype == np.float32 else "f8"
    with np.errstate(over="ignore"):
        return np.stack([p[0] * plane.astype("f8") + p[1] for p, plane in zip(pairs, typed)]).astype(to), np.dtype(to)
