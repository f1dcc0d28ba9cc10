#!/usr/bin/env python3
"""DICOM segmentations as volumes of labels: pydicom decodes the same bits, Pillow's colour management the same colours.

usage: dicom_segments_test.py ISONEST PLUGIN_FOLDER
"""
import json
import pathlib
import sys
import unittest

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1] / "support"))
import served  # noqa: E402

try:
    import numpy as np
    import pydicom
    from PIL import Image, ImageCms
    from pydicom.dataset import Dataset
    from pydicom.sequence import Sequence
    from pydicom.uid import ExplicitVRLittleEndian, ImplicitVRLittleEndian, RLELossless
    from dicom_inputs import DicomInput, text
    from volume_inputs import ISONEST, RANDOM, DamagedFiles
except ImportError as error:
    print(f"skipped: {error}")
    sys.exit(77)

SEGMENTATION = "1.2.840.10008.5.1.4.1.1.66.4"
LABEL_MAP = "1.2.840.10008.5.1.4.1.1.66.7"


def group(**elements):
    item = Dataset()
    for key, value in elements.items():
        setattr(item, key, value)
    return Sequence([item])


class DicomSegments(DamagedFiles, DicomInput):
    names = {1: "Liver", 2: "Left kidney", 5: "Niere (rechts)"}

    def setUp(self):
        super().setUp()
        # Segments of a volume of labels; there is no frame where a segment is empty.
        self.labels = np.where(RANDOM.random((6, 9, 11)) < 0.4, RANDOM.choice([1, 2, 5], (6, 9, 11)), 0).astype("u1")
        self.labels[2] = 0
        self.labels[4][self.labels[4] == 2] = 0

    def segmentation(self, frames, kind="BINARY", name="seg.dcm", syntax=ExplicitVRLittleEndian, between="2", step=(0, 0, 2), first=(1, 2, 3),
                     orientation=(1, 0, 0, 0, 1, 0), names=None, lab=None, most=None, overlap=None, shared_segment=None, **more):
        """`frames`: (z, segment, plane) each, in any order."""
        per_frame, planes = [], []
        for z, segment, plane in frames:
            item = Dataset()
            item.FrameContentSequence = group(DimensionIndexValues=[int(segment or 1), int(z + 1)])
            item.PlanePositionSequence = group(ImagePositionPatient=[text(v) for v in np.array(first, float) + z * np.array(step, float)])
            if shared_segment is None and kind != "LABELMAP":
                item.SegmentIdentificationSequence = group(ReferencedSegmentNumber=int(segment))
            per_frame.append(item)
            planes.append(plane)
        planes = np.stack(planes)
        shared = Dataset()
        shared.PlaneOrientationSequence = group(ImageOrientationPatient=[text(v) for v in orientation])
        shared.PixelMeasuresSequence = group(PixelSpacing=[0.5, 0.25], SliceThickness="0.7")
        if between is not None:
            shared.PixelMeasuresSequence[0].SpacingBetweenSlices = between
        if shared_segment is not None:
            shared.SegmentIdentificationSequence = group(ReferencedSegmentNumber=shared_segment)
        segments = []
        for number, label in (names or self.names).items():
            item = Dataset()
            item.SegmentNumber, item.SegmentLabel, item.SegmentAlgorithmType = number, label, "MANUAL"
            item.SegmentedPropertyTypeCodeSequence = group(CodeValue="1", CodeMeaning="organ")
            if lab and number in lab:
                item.RecommendedDisplayCIELabValue = lab[number]
            segments.append(item)
        if most is not None:
            more["MaximumFractionalValue"] = most
        if overlap is not None:
            more["SegmentsOverlap"] = overlap
        d = self.image(planes.astype("u1") if kind != "LABELMAP" else planes, name, syntax=syntax, position=None, PixelSpacing=None,
                       SOPClassUID=LABEL_MAP if kind == "LABELMAP" else SEGMENTATION, Modality="SEG", SegmentationType=kind,
                       SharedFunctionalGroupsSequence=Sequence([shared]), PerFrameFunctionalGroupsSequence=Sequence(per_frame),
                       SegmentSequence=Sequence(segments), **more)
        if kind == "BINARY":
            d.BitsAllocated = d.BitsStored = 1
            d.HighBit = 0
            bits = np.packbits(planes.astype(bool).ravel(), bitorder="little").tobytes()
            d.PixelData = bits + b"\0" * (len(bits) % 2)
            d["PixelData"].VR = "OB"
            d.save_as(self.path / name, write_like_original=False)
            np.testing.assert_array_equal(pydicom.dcmread(self.path / name).pixel_array.reshape(planes.shape), planes)
        return d

    def frames(self, labels=None):
        labels = self.labels if labels is None else labels
        found = [(z, s, labels[z] == s) for s in (1, 2, 5) for z in range(len(labels)) if (labels[z] == s).any()]
        return [found[i] for i in RANDOM.permutation(len(found))]

    def names_of(self):
        done = served.run([ISONEST, "info", self.here / "s.isonest", "--json"], check=True, capture_output=True)
        return json.loads(done.stdout)["label_names"]

    def test_segments_are_labels(self):
        for syntax in (ExplicitVRLittleEndian, ImplicitVRLittleEndian):
            for options in ((), ("--labels",)):
                with self.subTest(syntax=syntax.name, options=options):
                    self.segmentation(self.frames(), syntax=syntax)
                    done = self.reads(self.labels, *options)
                    self.lies([1, 2, 3], [0.25, 0.5, 2])
                    self.assertIn('1 "Liver", 2 "Left kidney", 5 "Niere (rechts)"', done.stdout + done.stderr)
                    self.assertIn("1 of 6 slices have no frame", done.stdout + done.stderr)
        # A single segment.
        for number in (1, 2, 5):
            self.reads(np.where(self.labels == number, number, 0).astype("u1"), "--index", f"segment={number}")
        for bad in (0, 3, -1):
            self.refuses(2, f"no segment {bad}", '1 "Liver"', options=("--index", f"segment={bad}"))
        self.refuses(2, "no axis", options=("--index", "t=0"))
        self.refuses(2, options=("--index", "segment=1,segment=2"))

    def test_the_only_segment_may_be_said_once_for_all_frames(self):
        frames = [(z, 1, self.labels[z] > 0) for z in (3, 0, 1, 5)]
        self.segmentation(frames, shared_segment=1, names={1: "All"})
        want = (self.labels > 0).astype("u1")
        want[4] = 0
        self.reads(want)

    def test_names_and_colours(self):
        rgb = {1: (200, 30, 40), 2: (10, 120, 250), 5: (255, 255, 255)}
        lab_profile, rgb_profile = ImageCms.createProfile("LAB"), ImageCms.createProfile("sRGB")
        to_lab = ImageCms.buildTransform(rgb_profile, lab_profile, "RGB", "LAB", renderingIntent=1)
        lab = {}
        for number, color in rgb.items():
            el, a, b = ImageCms.applyTransform(Image.new("RGB", (1, 1), color), to_lab).getpixel((0, 0))
            # Pillow stores L from 0 to 255, and a and b with an offset of 128.
            lab[number] = [round(v / 255 * 65535) for v in (el, a, b)]
        self.segmentation(self.frames(), lab=lab, SpecificCharacterSet="ISO_IR 100", names={**self.names, 5: "Nierenbecken (groß)"})
        self.reads(self.labels, "--labels")
        found = self.names_of()
        self.assertEqual([(n["id"], n["name"]) for n in found], [(1, "Liver"), (2, "Left kidney"), (5, "Nierenbecken (groß)")])
        for entry in found:
            np.testing.assert_allclose(entry["color"], rgb[entry["id"]], atol=4)  # a and b have 8 bits
        self.segmentation(self.frames(), SpecificCharacterSet="ISO_IR 192", names={**self.names, 2: "κεφαλή"})
        self.reads(np.where(self.labels == 2, 2, 0).astype("u1"), "--labels", "--index", "segment=2")
        self.assertEqual([(n["id"], n["name"]) for n in self.names_of()], [(2, "κεφαλή")])

    def test_segments_that_overlap_are_refused_but_one(self):
        frames = self.frames()
        both = RANDOM.random((9, 11)) < 0.5
        frames = [f for f in frames if f[0] != 3] + [(3, 1, both), (3, 2, both)]
        self.segmentation(frames)
        self.refuses(5, "segments 1 and 2 overlap", "--index")
        want = np.where(self.labels == 2, 2, 0).astype("u1")
        want[3] = both * 2
        self.reads(want, "--index", "segment=2")
        # If segments do not overlap, they can be labels.
        self.labels[3] = 0
        self.reads(self.labels[4:], "--crop", ":,:,4:")
        self.segmentation(self.frames() + [self.frames()[0]])
        self.refuses(5, "same position")

    def test_many_segments(self):
        labels = np.zeros((3, 20, 20), "u2")
        labels.flat[:1200] = np.arange(1200) % 700 + 1
        numbers = sorted({int(n) for n in np.unique(labels)} - {0})
        frames = [(z, n, labels[z] == n) for z in range(3) for n in numbers if (labels[z] == n).any()]
        self.segmentation(frames, names={n: f"s{n}" for n in numbers})
        self.reads(labels)

    def test_fractional_segments_are_volumes_of_their_own(self):
        stored = RANDOM.integers(0, 201, (2, 6, 9, 11)).astype("u1")
        frames = [(z, s + 1, stored[s, z]) for s in range(2) for z in (5, 0, 3, 1, 2, 4)]
        self.segmentation(frames, kind="FRACTIONAL", most=200, names={1: "a", 2: "b"}, SegmentationFractionalType="PROBABILITY")
        self.refuses(5, "FRACTIONAL", '1 "a", 2 "b"', "--index")
        for s in range(2):
            self.reads((stored[s] / 200).astype("f4"), "--index", f"segment={s + 1}")
        self.segmentation(frames[:6], kind="FRACTIONAL", most=200, names={1: "a"}, SegmentationFractionalType="OCCUPANCY")
        self.reads((stored[0] / 200).astype("f4"))
        d = pydicom.dcmread(self.path / "seg.dcm")
        d.compress(RLELossless, encoding_plugin="pydicom")
        d.save_as(self.path / "seg.dcm", write_like_original=False)
        self.reads((stored[0] / 200).astype("f4"))
        self.segmentation(frames[:6], kind="FRACTIONAL", most=0, names={1: "a"})
        self.refuses(4, "MaximumFractionalValue")

    def test_label_maps(self):
        for kind in ("u1", "u2"):
            labels = self.labels.astype(kind) * (100 if kind == "u2" else 1)
            self.segmentation([(z, None, labels[z]) for z in (4, 0, 1, 5, 3)], kind="LABELMAP",
                              names={n * (100 if kind == "u2" else 1): name for n, name in self.names.items()})
            self.reads(labels)
            number = 2 * (100 if kind == "u2" else 1)
            self.reads(np.where(labels == number, labels, 0).astype(kind), "--index", f"segment={number}")

    def test_planes_are_even_without_a_spacing_and_turned_as_the_header_says(self):
        self.segmentation(self.frames(), between=None)  # the thickness differs
        self.reads(self.labels)
        self.lies([1, 2, 3], [0.25, 0.5, 2])
        turn, _ = np.linalg.qr(np.random.default_rng(3).normal(size=(3, 3)))
        turn *= np.linalg.det(turn)
        self.segmentation(self.frames(), step=2 * turn[:, 2], orientation=(*turn[:, 0], *turn[:, 1]))
        self.reads(self.labels)
        np.testing.assert_allclose(np.array(self.directions()).reshape(3, 3), turn.T, atol=1e-8)
        self.lies([1, 2, 3], [0.25, 0.5, 2])
        # In the direction opposite to the normal.
        self.segmentation(self.frames(), step=(0, 0, -2))
        self.reads(np.ascontiguousarray(self.labels[::-1]))
        self.lies([1, 2, -7], [0.25, 0.5, 2])
        # A single plane.
        self.segmentation([(0, 1, self.labels[0] == 1)], names={1: "a"})
        self.reads((self.labels[:1] == 1).astype("u1"))
        self.lies([1, 2, 3], [0.25, 0.5, 2])

    def test_what_is_no_even_grid_is_refused(self):
        frames = [(z, 1, self.labels[0] > 0) for z in (0, 1, 2.4)]
        for between in (None, "2"):
            self.segmentation(frames, between=between, names={1: "a"})
            self.refuses(5, "evenly spaced")
        self.segmentation([(z, 1, self.labels[0] > 0) for z in (0, 1, 3e7)], names={1: "a"})
        self.refuses(5, "planes")
        self.segmentation([(z, 1, self.labels[0] > 0) for z in (0, 1, 2)], step=(0, 1.5, 2), names={1: "a"})
        self.assertEqual(self.preprocess().returncode, 0)
        np.testing.assert_allclose(self.directions()[2], [0, 0.6, 0.8], atol=1e-6)
        d = self.segmentation([(z, 1, self.labels[0] > 0) for z in (0, 1, 2)], names={1: "a"})
        d.PerFrameFunctionalGroupsSequence[1].PlanePositionSequence[0].ImagePositionPatient = ["1.5", "2", "5"]
        d.save_as(self.path / "seg.dcm")
        self.refuses(5, "frame 2 of the segmentation", "0.5")

    def test_what_contradicts_itself_is_refused(self):
        self.segmentation(self.frames(), names={1: "a", 2: "b"})
        self.refuses(4, "segment 5", "SegmentSequence")
        d = self.segmentation(self.frames())
        d.PixelData = d.PixelData[:-8]
        d.save_as(self.path / "seg.dcm")
        self.refuses(4, "seg.dcm", "bytes")
        d.SegmentationType = "OTHER"
        d.save_as(self.path / "seg.dcm")
        self.refuses(5, "'OTHER'")
        self.segmentation(self.frames())
        self.segmentation(self.frames(), name="other.dcm")
        self.refuses(5, "several segmentations", "other.dcm", "seg.dcm")

    def test_beside_its_images(self):
        self.stack(self.data)
        self.segmentation(self.frames(), SeriesInstanceUID="1.2.99", SeriesDescription="Organs")
        self.refuses(2, "2 series", '1.2.99  SEG "Organs"')
        self.reads(self.labels, "--series", "1.2.99")
        self.reads(self.data, "--series", pydicom.dcmread(self.path / "im0.dcm").SeriesInstanceUID)

    def test_damaged_files(self):
        self.segmentation(self.frames())
        whole = (self.path / "seg.dcm").read_bytes()
        self.path = self.path / "seg.dcm"
        self.damaged(whole)
        for i in range(60):
            data = bytearray(whole)
            for _ in range(3):
                data[RANDOM.integers(len(data))] = RANDOM.integers(256)
            self.path.write_bytes(data)
            done = self.preprocess("--memory", "256M", "--labels")
            self.assertIn(done.returncode, (0, 2, 4, 5, 7), (i, done.stderr))


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1])
