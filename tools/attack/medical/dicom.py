"""Kinds of tries of DICOM: series of files, frames, times, enhanced images.

The numbers are the ones that were written, and pydicom reads those of plain files again. The place is by PS3.3, C.7.6.2.1.1, which
nibabel.nicom computes again for one image.
"""
import warnings

import numpy as np

import attack

from . import volumes
from .dicom_files import (SYNTAXES, BasicTextSRStorage, Bits, Dataset, Sequence, bits, image, meaning, place, position, pydicom, scale_elements, scales,
                          text, uid)

warnings.simplefilter("ignore")
dicomwrappers = attack.require("nibabel.nicom.dicomwrappers")


def _shape(one):
    return int(one.random.integers(1, 7)), int(one.random.integers(1, 9)), int(one.random.integers(1, 9))


def _names(one, count):
    """Names of files, in an order that says nothing."""
    way = int(one.random.integers(4))
    ids = one.random.permutation(count)
    return [(f"IM{i}", f"{i}.dcm", f"sub{i % 2}/I{i:04}", f"a{i}.ima")[way] for i in ids]


def _given(one, folder, files):
    """How the files are named to isonest."""
    way = one.random.random()
    if len(files) == 1:
        return folder if way < 0.9 else files[0]
    return folder if way < 0.7 else [files[i] for i in one.random.permutation(len(files))]


def _pydicom_differs(path, stored, b):
    if b.stored != b.allocated or b.floating:
        return None
    data = pydicom.dcmread(path).pixel_array
    return None if np.array_equal(np.atleast_2d(data.reshape(stored.shape)), stored) else f"{path.name}: values"


def _nibabel_differs(path, p, z):
    d = dicomwrappers.wrapper_from_file(str(path))
    affine = d.affine  # of row, column, slice
    want = p.affine()[:3, [1, 0, 2, 3]]
    if not np.allclose(affine[:3, :2], want[:, :2], rtol=1e-5, atol=1e-6) or not np.allclose(affine[:3, 3], p.at(z), atol=1e-6):
        return f"{path.name}: {affine.tolist()}, {want.tolist()}"
    return None


def dicom(one):
    """A series of single images, even along its normal."""
    n, ny, nx = _shape(one)
    b, p = bits(one), place(one)
    stored = b.numbers(one, (n, ny, nx))
    pairs = scales(one, n)
    folder = one.folder / "series"
    syntaxes = SYNTAXES if one.chance(0.2) else (one.pick(*SYNTAXES),)
    series = uid(one)
    step = {}
    if n == 1:
        p.size[2] = 1
        for name in ("SliceThickness", "SpacingBetweenSlices"):
            if one.chance(0.6):
                p.size[2] = float(text(one.random.uniform(0.5, 5)))
                step[name] = text(p.size[2])
    else:
        step = {"SliceThickness": text(p.size[2] * one.pick(0.5, 1, 2))} if one.chance(0.7) else {}
    numbers = one.random.permutation(n) + 1 if one.chance(0.5) else np.arange(n, 0, -1)
    jitter = 0.03 if one.chance(0.2) else 0
    files = [folder / name for name in _names(one, n)]
    unit = "mm"
    for z in range(n):
        aside = one.random.uniform(-jitter, jitter, 2) if 0 < z < n - 1 else (0, 0)
        forth = one.random.uniform(-jitter, jitter) if 0 < z < n - 1 else 0
        image(one, files[z], stored[z], b, syntax=one.pick(*syntaxes), series=series, **p.elements(), **scale_elements(pairs[z]), **step,
              ImagePositionPatient=position(p.at(z + forth, aside)), InstanceNumber=int(numbers[z]) if one.chance(0.95) else None)
    if one.chance(0.3):
        problem = _pydicom_differs(files[0], stored[0], b) or _nibabel_differs(files[0], p, 0)
        if problem:
            return attack.wrong("the judge and the attacker disagree: " + problem)
    values, dtype = meaning(stored, b, pairs)
    volume = volumes.Volume(values, p.affine(), unit, dtype)
    if one.chance(0.2):
        (folder / "notes.txt").write_text("nothing")
        image(one, folder / "report", stored[0], Bits(8, 8, 7, False), PixelData=None, series=uid(one), kind=BasicTextSRStorage)
    given = _given(one, folder, files)
    if one.chance(0.15):
        other = uid(one)
        for i in range(int(one.random.integers(1, 3))):
            image(one, folder / f"other{i}", np.zeros((4, 5), "i8"), Bits(8, 8, 7, False), series=other, **p.elements(),
                  ImagePositionPatient=position(p.at(i)))
        if given == folder:
            if one.chance(0.2):
                volume.must_refuse = ("several series, none named", "2 series")
            else:
                volume.options["series"] = series if one.chance(0.6) else series[-9:]
    return volumes.compared(one, given, volume)


def dicom_frames(one):
    """One file of several frames, as dose, nuclear medicine and ultrasound have it: steps and offsets along the normal."""
    n, ny, nx = _shape(one)
    n = max(n, 2)
    b, p = bits(one), place(one)
    stored = b.numbers(one, (n, ny, nx))
    pair = scales(one, 1)[0]
    elements = dict(scale_elements(pair))
    way = one.pick("between", "backward", "thickness", "offsets", "offsets from z", "offsets down")
    step = p.size[2]
    sign = 1
    if way == "between":
        elements |= {"SpacingBetweenSlices": text(step), "SliceThickness": text(9)}
    elif way == "backward":
        elements["SpacingBetweenSlices"] = text(-step)  # PS3.3, C.8.4.15: slices in front of the first
        sign = -1
    elif way == "thickness":
        elements["SliceThickness"] = text(step)
    else:
        sign = -1 if way == "offsets down" else 1
        begin = p.first[2] if way == "offsets from z" else 0
        offsets = [begin + sign * step * i for i in range(n)]
        elements["GridFrameOffsetVector"] = [text(v) for v in offsets]
        elements["SliceThickness"] = text(2.5 * step)
        if pair is None and one.chance(0.5):
            pair = (0.00125, 0.0)
            elements["DoseGridScaling"] = "0.00125"
    image(one, one.folder / "all.dcm", stored, b, syntax=one.pick(*SYNTAXES), **p.elements(), **elements,
          ImagePositionPatient=position(p.first), InstanceNumber=1)
    values, dtype = meaning(stored, b, [pair] * n)
    affine = p.affine()
    affine[:3, 2] *= sign
    return volumes.compared(one, one.folder / "all.dcm", volumes.Volume(values, affine, "mm", dtype))


def dicom_nuclear(one):
    """A reconstruction of nuclear medicine: its place is its detector's, its frames are slices of several gates."""
    n, ny, nx = _shape(one)
    n = max(n, 2)
    b, p = bits(one, floats=False), place(one)
    gates = one.pick(1, 1, 2, 3)
    stored = b.numbers(one, (gates, n, ny, nx))
    pair = scales(one, 1)[0]
    sign = one.pick(1, -1)
    detector, second = Dataset(), Dataset()
    detector.ImagePositionPatient = position(p.first)
    detector.ImageOrientationPatient = p.elements()["ImageOrientationPatient"]
    second.ImagePositionPatient, second.ImageOrientationPatient = ["7", "8", "9"], ["0", "1", "0", "0", "0", "1"]
    numbers = np.tile(np.arange(1, n + 1), gates)
    order = np.arange(n * gates) if one.chance(0.5) else np.argsort(numbers, kind="stable")  # gate by gate, or slice by slice
    d = image(one, one.folder / "nm.dcm", stored.reshape(-1, ny, nx)[order], b, syntax=one.pick(*SYNTAXES),
              PixelSpacing=p.elements()["PixelSpacing"], SpacingBetweenSlices=text(sign * p.size[2]), SliceThickness=text(p.size[2]),
              DetectorInformationSequence=Sequence([detector, second][:int(one.random.integers(1, 3))]),
              SliceVector=[int(numbers[i]) for i in order] if gates > 1 or one.chance(0.5) else None, **scale_elements(pair))
    d["DetectorInformationSequence"].is_undefined_length = one.chance(0.5)
    d.save_as(one.folder / "nm.dcm", write_like_original=False)
    gate = int(one.random.integers(gates))
    values, dtype = meaning(stored[gate], b, [pair] * n)
    affine = p.affine()
    affine[:3, 2] *= sign
    return volumes.compared(one, one.folder / "nm.dcm", volumes.Volume(values, affine, "mm", dtype,
                                                                      options={"index": {"t": gate}} if gates > 1 else {}))


def dicom_files_of_frames(one):
    """A series of files of several frames each, whose slices may lie between each other."""
    n, ny, nx = _shape(one)
    n = max(n, 2)
    b, p = bits(one, floats=False), place(one)
    files = int(one.random.integers(2, 4))
    stored = b.numbers(one, (n * files, ny, nx))
    pairs = scales(one, files)
    between = one.chance(0.5)  # slices of the files in turn, else one file behind the other
    series = uid(one)
    own = []
    for f in one.random.permutation(files):
        slices = np.arange(f, n * files, files) if between else np.arange(f * n, (f + 1) * n)
        step = p.size[2] * (files if between else 1)
        image(one, one.folder / "s" / f"{one.random.integers(10**9)}", stored[slices], b, syntax=one.pick(*SYNTAXES), series=series,
              **p.elements(), **scale_elements(pairs[f]), SpacingBetweenSlices=text(step), ImagePositionPatient=position(p.at(slices[0])))
        own += [(z, pairs[f]) for z in slices]
    values, dtype = meaning(stored, b, [pair for _, pair in sorted(own, key=lambda o: o[0])])
    return volumes.compared(one, one.folder / "s", volumes.Volume(values, p.affine(), "mm", dtype))


def dicom_unplaced(one):
    """Images that do not say where they lie: by their numbers, if all have different ones, else by their files' names."""
    n, ny, nx = _shape(one)
    b = bits(one, floats=False)
    stored = b.numbers(one, (n, ny, nx))
    pairs = scales(one, 1) * n
    size = np.array([float(text(v)) for v in volumes.spacing(one)])
    ids = one.random.permutation(200)[:n]
    way = one.pick("numbers", "names", "double", "some")
    spaced = one.chance(0.7)
    elements = {"PixelSpacing": [text(size[1]), text(size[0])]} if spaced else {}
    size = size if spaced else np.array([1, 1, size[2]])
    elements["SliceThickness"] = text(size[2])
    for z in range(n):
        number = int(ids[z])
        if way == "double" and n > 1 and z < 2:
            number = int(ids[0])
        if way == "names" or way == "some" and z == 0:
            number = None
        image(one, one.folder / "s" / f"im{(7 * z + 3) % 11}.dcm", stored[z], b, syntax=one.pick(*SYNTAXES), **elements, InstanceNumber=number,
              **scale_elements(pairs[z]))
    by_number = way == "numbers" or way == "double" and n == 1
    order = np.argsort(ids) if by_number else sorted(range(n), key=lambda z: (7 * z + 3) % 11)
    values, dtype = meaning(stored[order], b, pairs)
    return volumes.compared(one, one.folder / "s", volumes.Volume(values, volumes.affine_of(np.eye(3), size, np.zeros(3)),
                                                                 "mm" if spaced else None, dtype))


def dicom_times(one):
    """Several images at each place: an axis t."""
    n, ny, nx = _shape(one)
    times = int(one.random.integers(2, 4))
    b, p = bits(one), place(one)
    stored = b.numbers(one, (times, n, ny, nx))
    pairs = scales(one, 1)
    p.size[2] = p.size[2] if n > 1 else 1
    by_time, outer = one.chance(0.5), one.chance(0.5)
    moved = int(one.random.integers(times)) if one.chance(0.15) else None
    for t in range(times):
        for z in range(n):
            number = t * n + z if outer else z * times + t
            aside = (3.0, 0) if t == moved else (0, 0)
            image(one, one.folder / "s" / f"f{one.random.integers(10**9)}", stored[t, z], b, **p.elements(), **scale_elements(pairs[0]),
                  ImagePositionPatient=position(p.at(z, aside)), InstanceNumber=number + 1,
                  TemporalPositionIdentifier=t + 1 if by_time else None)
    t = int(one.random.integers(times))
    values, dtype = meaning(stored[t], b, pairs * n)
    volume = volumes.Volume(values, p.affine(), "mm", dtype, options={"index": {"t": t}})
    if moved is not None:
        volume.must_refuse = ("times that lie beside each other", "beside")
    elif one.chance(0.1):
        volume.options, volume.must_refuse = {}, ("several times, none named", "index")
    return volumes.compared(one, one.folder / "s", volume)


def _group(**elements):
    """A functional group of one item."""
    item = Dataset()
    for key, value in elements.items():
        setattr(item, key, value)
    return Sequence([item])


def dicom_enhanced(one):
    """An enhanced image: what frames have in common, and what each has of its own, in functional groups."""
    n, ny, nx = _shape(one)
    b, p = bits(one, floats=False), place(one)
    times = int(one.random.integers(2, 4)) if one.chance(0.2) else 1
    stored = b.numbers(one, (times, n, ny, nx))
    pairs = scales(one, n)
    p.size[2] = p.size[2] if n > 1 else 1
    own_orientation, own_measures, own_scale = one.chance(0.4), one.chance(0.4), one.chance(0.5) or len(set(pairs)) > 1
    way = one.random.random()
    must = None
    moved = None
    if way < 0.08 and n > 2:
        must, moved = ("slices are missing", "missing"), {n - 1: n + 1.0}
    elif way < 0.16 and n > 3:
        must, moved = ("slices at uneven distances", "even distances|beside"), {1: 1.4}
    shared = Dataset()
    undefined = one.chance(0.5)
    orientation = {"PlaneOrientationSequence": _group(ImageOrientationPatient=p.elements()["ImageOrientationPatient"])}
    measures = {"PixelMeasuresSequence": _group(PixelSpacing=p.elements()["PixelSpacing"], SliceThickness=text(p.size[2]))}
    if n == 1 and one.chance(0.5):
        p.size[2] = 3.5
        measures["PixelMeasuresSequence"][0].SpacingBetweenSlices = "3.5"
    elif n == 1:
        p.size[2] = float(text(p.size[2]))

    def scale_group(pair):
        return {} if pair is None else {"PixelValueTransformationSequence": _group(**scale_elements(pair), RescaleType="US")}

    for there, groups in ((not own_orientation, orientation), (not own_measures, measures), (not own_scale, scale_group(pairs[0]))):
        for key, value in groups.items():
            if there:
                setattr(shared, key, value)
    frames, planes = [], []
    order = one.random.permutation(n * times)
    for i in order:
        t, z = divmod(int(i), n)
        frame = Dataset()
        groups = {"PlanePositionSequence": _group(ImagePositionPatient=position(p.at((moved or {}).get(z, z))))}
        content = {"FrameAcquisitionNumber": 1, "InStackPositionNumber": z + 1, "StackID": "1"}
        if times > 1:
            content["TemporalPositionIndex"] = t + 1
        groups["FrameContentSequence"] = _group(**content)
        if own_orientation:
            groups |= orientation
        if own_measures:
            groups |= measures
        if own_scale:
            groups |= scale_group(pairs[z])
        if one.chance(0.2):
            groups["DerivationImageSequence"] = _group(SourceImageSequence=_group(ReferencedSOPInstanceUID="1.2"))
        for key, value in groups.items():
            setattr(frame, key, value)
        frame.is_undefined_length_sequence_item = undefined
        frames.append(frame)
        planes.append(stored[t, z])
    path = one.folder / "e.dcm"
    d = image(one, path, np.stack(planes), b, syntax=one.pick(*SYNTAXES), SharedFunctionalGroupsSequence=Sequence([shared]),
              PerFrameFunctionalGroupsSequence=Sequence(frames), NumberOfFrames=n * times, InstanceNumber=1)
    for tag in (0x52009229, 0x52009230):
        d[tag].is_undefined_length = undefined
    d.save_as(path, write_like_original=False)
    t = int(one.random.integers(times))
    values, dtype = meaning(stored[t], b, pairs if own_scale else pairs[:1] * n)
    volume = volumes.Volume(values, p.affine(), "mm", dtype, must_refuse=must)
    if times > 1 and not must:
        volume.options["index"] = {"t": t}
    return volumes.compared(one, path, volume)
