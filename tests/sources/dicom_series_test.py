#!/usr/bin/env python3
"""Which DICOM files become the volume: one series, one stack, one time; copies, colours, localizers; tables of values.

usage: dicom_series_test.py ISONEST PLUGIN_FOLDER
"""
import shutil
import subprocess
import sys
import unittest

try:
    import numpy as np
    import pydicom
    from pydicom.dataset import Dataset
    from pydicom.pixel_data_handlers.util import apply_modality_lut
    from pydicom.sequence import Sequence
    from pydicom.uid import DeflatedExplicitVRLittleEndian, ExplicitVRBigEndian, ExplicitVRLittleEndian, ImplicitVRLittleEndian
    from dicom_inputs import DicomInput, text
    from volume_inputs import RANDOM
except ImportError as error:
    print(f"skipped: {error}")
    sys.exit(77)

SYNTAXES = (ExplicitVRLittleEndian, ImplicitVRLittleEndian, ExplicitVRBigEndian)


class DicomSeries(DicomInput):
    def said(self, done):
        return done.stdout + done.stderr

    def colours(self, name, **more):
        self.image(np.zeros((8, 24), "u1"), name, position=None, Columns=8, SamplesPerPixel=3, PhotometricInterpretation="RGB",
                   PlanarConfiguration=0, **more)

    def test_what_cannot_be_read_of_another_series_is_left_out_and_listed(self):
        self.stack(self.data)
        self.colours("report.dcm", SeriesInstanceUID="1.2.99", SeriesDescription="Dose report")
        series = pydicom.dcmread(self.path / "im0.dcm").SeriesInstanceUID
        for options in (("--series", series), ()):  # the other one has no scalar image, so there is only one choice
            said = self.said(self.reads(self.data, *options))
            self.assertIn('another series is left out: 1.2.99  CT "Dose report", 1 not read', said)
            self.assertIn("(RGB)", said)
        self.refuses(5, "report.dcm", "(RGB)", options=("--series", "1.2.99"))
        # A damaged slice of another series. Without --series there are two series.
        self.image(self.data[0], "cut.dcm", SeriesInstanceUID="1.2.77")
        whole = (self.path / "cut.dcm").read_bytes()
        (self.path / "cut.dcm").write_bytes(whole[:-len(self.data[0].tobytes()) - 12])
        self.refuses(2, "3 series", "cut.dcm", "--series")
        self.assertIn("cut.dcm", self.said(self.reads(self.data, "--series", series)))
        self.refuses(4, "cut.dcm", "no pixel data", options=("--series", "1.2.77"))
        # A deflated file, which says to which series it belongs.
        self.image(self.data[0], "deflated.dcm", syntax=DeflatedExplicitVRLittleEndian, SeriesInstanceUID="1.2.66")
        self.assertIn("deflated DICOM file", self.said(self.reads(self.data, "--series", series)))
        self.refuses(5, "deflated", "gdcmconv", options=("--series", "1.2.66"))
        # A file that does not say to which series it belongs may be part of any.
        at = whole.index(b"\x20\0\x0e\0UI")
        (self.path / "cut.dcm").write_bytes(whole[:at + 12])
        self.refuses(4, "cut.dcm", options=("--series", series))

    def test_colours_in_the_series_are_left_out_on_request(self):
        self.stack(self.data)
        self.colours("im9.dcm")
        self.refuses(5, "im9.dcm", "(RGB)", "stack=0: 6 of 12 x 9 of 16 bits", "--index")
        said = self.said(self.reads(self.data, "--index", "stack=0"))
        self.assertIn("1 file is left out: ", said)
        self.assertIn("im9.dcm", said)
        # The damaged file may be a slice of the stack.
        self.image(self.data[0], "im8.dcm", position=(1, 2, 3 + 12), PixelData=None)
        self.refuses(4, "im8.dcm", "no pixel data", options=("--index", "stack=0"))

    def test_a_localizer_is_named_and_left_out_on_request(self):
        self.stack(self.data)
        scout = RANDOM.integers(0, 99, (1, 7, 5)).astype("u2")
        cases = (dict(ImageOrientationPatient=[1, 0, 0, 0, 0, -1]), dict(ImageType=["ORIGINAL", "PRIMARY", "LOCALIZER"]), {})
        for more in cases:
            with self.subTest(more=more):
                self.image(scout[0], "scout.dcm", position=(9, 9, 9), **more)
                self.refuses(5, "2 stacks", "stack=0: 6 of 12 x 9", "stack=1: 1 of 5 x 7", "scout.dcm has 5 x 7", "--index")
                self.assertIn("scout.dcm has 5 x 7", self.said(self.reads(self.data, "--index", "stack=0")))
                self.lies([1, 2, 3], [0.25, 0.5, 2])
                for last in ("stack=1", "stack=-1"):
                    self.reads(scout, "--index", last)
                self.refuses(2, "no stack 2", options=("--index", "stack=2"))
        # A localizer that differs in nothing else.
        self.image(self.data[0], "scout.dcm", position=(1, 2, 3), ImageType=["ORIGINAL", "PRIMARY", "LOCALIZER"])
        self.refuses(5, "scout.dcm is a localizer", "--index")
        self.reads(self.data, "--index", "stack=0")
        self.refuses(2, "'stack'", options=("--index", "stack=0,stack=1"))
        self.refuses(2, "'stack'", options=("--index", "stack=:"))

    def test_stack_0_is_the_only_one_of_a_plain_series(self):
        self.stack(self.data)
        self.reads(self.data, "--index", "stack=0")
        self.refuses(2, "no stack 1", options=("--index", "stack=1"))

    def test_exact_copies_are_dropped_and_others_of_one_uid_refused(self):
        self.stack(self.data)
        (self.path / "sub").mkdir()
        for name in ("im0.dcm", "im5.dcm"):
            shutil.copy(self.path / name, self.path / "sub" / name)
        # A preamble and a file meta group by another program: the same object.
        d = pydicom.dcmread(self.path / "im3.dcm")
        d.file_meta.ImplementationVersionName = "OTHER"
        d.preamble = b"x" * 128
        d.save_as(self.path / "sub" / "zz", write_like_original=False)
        said = self.said(self.reads(self.data))
        self.assertIn("3 files are left out: exact copies", said)
        self.lies([1, 2, 3], [0.25, 0.5, 2])
        # Different content, in the pixels or before them.
        changed = pydicom.dcmread(self.path / "im3.dcm")
        changed.PixelData = changed.PixelData[:-1] + b"\x7f"
        other_text = pydicom.dcmread(self.path / "im3.dcm")
        other_text.PatientName = "Nobodx"
        packed = pydicom.dcmread(self.path / "im3.dcm")
        packed.compress(pydicom.uid.RLELossless, encoding_plugin="pydicom")
        for d in (changed, other_text, packed):
            d.save_as(self.path / "sub" / "zz", write_like_original=False)
            self.refuses(5, "zz", "im3.dcm", "the same SOP instance UID", "different contents")

    def test_copies_of_a_file_of_frames(self):
        self.image(self.data, "all.dcm", SpacingBetweenSlices="2")
        shutil.copy(self.path / "all.dcm", self.path / "again.dcm")
        self.assertIn("1 file is left out", self.said(self.reads(self.data)))

    def test_times_are_told_apart_by_what_differs_in_the_same_way_everywhere(self):
        series = RANDOM.integers(0, 99, (3, 4, 5, 6)).astype("u2")
        cases = {"TemporalPositionIdentifier": ("temporal position", [1, 2, 3]), "EchoNumbers": ("echo", [1, 2, 3]),
                 "AcquisitionNumber": ("acquisition", [4, 7, 9]), "TriggerTime": ("trigger time", ["0", "33.5", "70"]),
                 "DiffusionBValue": ("b value", [0.0, 500.0, 1000.0])}
        for keyword, (name, values) in cases.items():
            with self.subTest(keyword=keyword):
                self.clear()
                for z in range(4):
                    for t in range(3):
                        # Instance numbers and file names are in another order.
                        self.image(series[t, z], f"{(7 * z + 5 * t) % 29}.dcm", position=(0, 0, z),
                                   InstanceNumber=int((t * 7 + z * 5) % 13), **{keyword: values[t]})
                listed = ", ".join(f"{float(v):g}" for v in values)
                self.refuses(5, "t 3, z 4, y 5, x 6", f"t is {name} {listed}", "--index")
                for t in range(3):
                    self.assertIn(f"{name} {listed}", self.said(self.reads(series[t], "--index", f"t={t}")))
            self.reads(series[1], "--index", "time=1")
            self.reads(series[2], "--index", "0=2")
        # t is not an axis of the volume, even if there are as many times as slices.
        self.clear()
        for z in range(3):
            for t in range(3):
                self.image(series[t, z], f"{z}{t}.dcm", position=(0, 0, z), TemporalPositionIdentifier=t + 1)
        self.refuses(5, "choose a time", options=("--index", "t=:,z=0"))
        # Echoes of times: the times come first.
        self.clear()
        six = RANDOM.integers(0, 99, (2, 3, 4, 5, 6)).astype("u2")
        for z in range(4):
            for t in range(2):
                for echo in range(3):
                    self.image(six[t, echo, z], f"{(11 * z + 3 * t + 5 * echo) % 37}.dcm", position=(0, 0, z), InstanceNumber=echo,
                               TemporalPositionIdentifier=t + 1, EchoNumbers=echo + 1)
        for i in range(6):
            self.reads(six.reshape(6, 4, 5, 6)[i], "--index", f"t={i}")
        # An acquisition number that counts slices is ignored.
        self.clear()
        for z in range(4):
            for t in range(3):
                self.image(series[t, z], f"{z}{t}.dcm", position=(0, 0, z), InstanceNumber=t, AcquisitionNumber=(z * 3 + t) * 7 % 12)
        self.refuses(5, "the order of the image numbers")
        self.reads(series[1], "--index", "t=1")

    def test_times_in_frames(self):
        series = RANDOM.integers(0, 99, (2, 3, 4, 5)).astype("u2")
        for keyword, outer in (("TemporalPositionIndex", "FrameContentSequence"), ("EffectiveEchoTime", "MREchoSequence"),
                               ("DiffusionBValue", "MRDiffusionSequence")):
            for syntax in (ExplicitVRLittleEndian, ImplicitVRLittleEndian):
                with self.subTest(keyword=keyword, syntax=syntax.name):
                    groups, planes = [], []
                    for z, t in ((0, 1), (2, 0), (1, 1), (1, 0), (0, 0), (2, 1)):
                        frame, inner, place = Dataset(), Dataset(), Dataset()
                        setattr(inner, keyword, t + 1)
                        place.ImagePositionPatient = ["1", "2", text(3 * z)]
                        setattr(frame, outer, Sequence([inner]))
                        frame.PlanePositionSequence = Sequence([place])
                        groups.append(frame)
                        planes.append(series[t, z])
                    self.image(np.stack(planes), "all.dcm", syntax=syntax, PerFrameFunctionalGroupsSequence=Sequence(groups))
                    for t in range(2):
                        self.reads(series[t], "--index", f"t={t}")
                        self.lies([1, 2, 0], [0.25, 0.5, 3])

    def table(self, values, first, bits, data=None, vr="OW", kind="HU"):
        item = Dataset()
        item.add_new(0x00283002, "SS" if first < 0 else "US", [len(values) % 65536, first, bits])
        item.ModalityLUTType = kind
        item.add_new(0x00283006, vr, data if data is not None else np.asarray(values, "<u2").tobytes())
        return {"ModalityLUTSequence": Sequence([item])}

    def judged(self, name="a.dcm"):
        """The values by pydicom."""
        d = pydicom.dcmread(self.path / name)
        return apply_modality_lut(d.pixel_array, d)

    def test_a_table_of_values_is_applied(self):
        for kind, first in (("u2", 0), ("u2", 100), ("i2", -300), ("u1", 3), ("i1", -5)):
            for syntax in SYNTAXES[:2]:
                with self.subTest(kind=kind, first=first, syntax=syntax.name):
                    limits = np.iinfo(kind)
                    values = RANDOM.integers(0, 65536, 57)
                    plane = RANDOM.integers(max(limits.min, first - 20), min(limits.max, first + 77), (9, 11)).astype(kind)
                    plane[0, :2] = limits.min, limits.max + min(first, 0)  # pydicom overflows beyond these
                    self.image(plane, "a.dcm", syntax=syntax, **self.table(values, first, 16))
                    want = values[np.clip(plane.astype("i8") - first, 0, 56)].astype("u2")
                    np.testing.assert_array_equal(self.judged(), want)
                    self.assertIn("(Modality LUT) of type HU", self.said(self.reads(want)))
        # With a table the slope is ignored, but bits stored are not.
        plane = RANDOM.integers(0, 4096, (9, 11)).astype("u2")
        values = RANDOM.integers(0, 4096, 4096)
        self.image(plane | 0xA000, "a.dcm", BitsStored=12, HighBit=11, RescaleSlope="3", RescaleIntercept="5", **self.table(values, 0, 12))
        self.reads(values[plane].astype("u2"))
        # All 65,536 entries; big-endian; 8 bits, in one or two bytes each.
        plane = RANDOM.integers(0, 65536, (9, 11)).astype("u2")
        values = RANDOM.permutation(65536)
        self.image(plane, "a.dcm", **self.table(values, 0, 16))
        self.reads(values[plane].astype("u2"))
        self.image(plane, "a.dcm", syntax=ExplicitVRBigEndian, **self.table(values, 0, 16, np.asarray(values, ">u2").tobytes()))
        self.reads(values[plane].astype("u2"))
        plane, values = RANDOM.integers(0, 256, (9, 11)).astype("u1"), RANDOM.integers(0, 256, 255)
        for data in (values.astype("u1").tobytes() + b"\0", values.astype("<u2").tobytes()):
            self.image(plane, "a.dcm", **self.table(values, 0, 8, data))
            self.reads(values[np.minimum(plane, 254)].astype("u1"))
        self.image(plane, "a.dcm", syntax=ExplicitVRBigEndian,
                   **self.table(values, 0, 8, np.frombuffer(values.astype("u1").tobytes() + b"\0", "<u2").astype(">u2").tobytes()))
        self.reads(values[np.minimum(plane, 254)].astype("u1"))

    def test_slices_may_have_tables_of_their_own(self):
        tables = RANDOM.integers(0, 65536, (6, 4096))
        for z, plane in enumerate(self.data):
            self.image(plane, f"{z}.dcm", position=(0, 0, z), **self.table(tables[z], 0, 16))
        self.reads(np.stack([tables[z][plane] for z, plane in enumerate(self.data)]).astype("u2"))

    def test_tables_that_make_no_sense(self):
        plane = self.data[0]
        for bad in (self.table([1, 2, 3], 0, 16, b"\1\0\2\0"), self.table([1, 2, 3], 0, 0), self.table([1, 2, 3], 0, 17)):
            self.image(plane, "a.dcm", **bad)
            self.refuses(4, "a.dcm")
        bad = self.table([1, 2, 3], 0, 16)
        bad["ModalityLUTSequence"][0].LUTDescriptor = [3, 0]
        self.image(plane, "a.dcm", **bad)
        self.refuses(4, "a.dcm", "descriptor")
        self.image(plane.astype("u4"), "a.dcm", **self.table([1, 2, 3], 0, 16))
        self.refuses(5, "a.dcm", "32 bits")

    def without_preamble(self, path, own_group):
        """The file without its first bytes."""
        whole = path.read_bytes()
        d = pydicom.dcmread(path)
        start = 132 if own_group else 132 + 12 + d.file_meta.FileMetaInformationGroupLength
        path.write_bytes(whole[start:])

    def test_files_without_preamble(self):
        for syntax in SYNTAXES:
            for own_group in (True, False):
                with self.subTest(syntax=syntax.name, own_group=own_group):
                    self.clear()
                    self.stack(self.data, syntax=syntax, SpecificCharacterSet="ISO_IR 100", ImageType=["ORIGINAL", "PRIMARY"])
                    for file in self.path.glob("*.dcm"):
                        self.without_preamble(file, own_group)
                        if own_group or not syntax.is_implicit_VR:
                            continue
                        again = pydicom.dcmread(file, force=True)
                        again.file_meta.TransferSyntaxUID = syntax
                        self.assertEqual(again.pixel_array.shape, self.data.shape[1:])
                    self.reads(self.data)
                    self.lies([1, 2, 3], [0.25, 0.5, 2])
                    folder = self.path
                    self.path = folder / "alone" / "im0.dcm"  # next to the others it is refused
                    self.path.parent.mkdir()
                    shutil.copy(folder / "im0.dcm", self.path)
                    self.reads(self.data[:1])
                    if shutil.which("gdcminfo"):
                        done = subprocess.run(["gdcminfo", self.path], capture_output=True, text=True)
                        self.assertIn("Dimensions: (12,9,1)", done.stdout)
                    self.path = folder
        # Next to files with a preamble, one of which has a copy without it.
        self.clear()
        self.stack(self.data)
        self.without_preamble(self.path / "im0.dcm", False)
        shutil.copy(self.path / "im5.dcm", self.path / "im9.dcm")
        self.without_preamble(self.path / "im9.dcm", False)
        self.assertIn("1 file is left out: exact copies", self.said(self.reads(self.data)))

    def test_other_files_are_not_taken_for_dicom(self):
        """Raw numbers that start like elements, except for the class that DICOM defines."""
        self.image(self.data[0], "a.dcm")
        self.without_preamble(self.path / "a.dcm", False)
        whole = (self.path / "a.dcm").read_bytes()
        self.path = self.path / "a.raw"
        for other in (whole.replace(b"1.2.840.10008.", b"1.2.840.10009."), b"\x08\0" * 400, b"\x08\0\x16\0\x08\0\0\0" * 90,
                      whole[:8] + whole[4:8] + whole[8:], b"\x08\0\x16\0UI\x1a\0" + whole[8:20], b"\x02\0\0\0UL\4\0" + whole):
            self.path.write_bytes(other)
            self.refuses(2, "--dims")

    def test_a_tilted_gantry(self):
        """It is read as it is, and a note says what a user's spacing loses."""
        step = np.array([0, 2 * np.tan(np.radians(18.5)), 2])
        for z, plane in enumerate(self.data):
            self.image(plane, f"{z}.dcm", position=[10, 20, 30] + z * step, GantryDetectorTilt="-18.5")
        self.reads(self.data)
        self.lies([10, 20, 30], [0.25, 0.5, np.linalg.norm(step)])
        steps = np.array(self.directions()) * np.array(self.info()["spacing"])[:, None]
        np.testing.assert_allclose(steps, [[0.25, 0, 0], [0, 0.5, 0], step], atol=1e-6)
        self.assertEqual(self.info()["frame"], "LPS")
        said = self.said(self.reads(self.data, "--spacing", "0.25,0.5,2"))
        self.assertIn("18.5 degrees", said)
        self.assertIn("3.346 away", said)
        self.assertFalse(self.info()["sheared"])
        self.lies([10, 20, 30], [0.25, 0.5, 2])
        # Rotated as well.
        self.clear()
        for z, plane in enumerate(self.data):
            self.image(plane, f"{z}.dcm", position=(z, 2 * z, 0), ImageOrientationPatient=[1, 0, 0, 0, 0, -1])
        said = self.said(self.reads(self.data, "--spacing", "1,1,1"))
        self.assertIn("the directions of the axes", said)
        # With a user's spacing, reversed axes are still reversed, as in other formats.
        self.clear()
        for z, plane in enumerate(self.data):
            self.image(plane, f"{z}.dcm", position=(5, 6, z), ImageOrientationPatient=[-1, 0, 0, 0, -1, 0])
        self.reads(np.ascontiguousarray(self.data[:, ::-1, ::-1]), "--spacing", "1,2,3")
        self.lies([5 - 11 * 0.25, 6 - 8 * 0.5, 0], [1, 2, 3])
        # An upright one loses nothing.
        self.clear()
        self.stack(self.data)
        self.assertNotIn("tilt", self.said(self.reads(self.data, "--spacing", "0.25,0.5,2")))


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1])
