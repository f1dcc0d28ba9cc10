#!/usr/bin/env python3
"""Siemens mosaics: the slices of a volume next to each other in one image. Compared with nibabel.nicom.

usage: dicom_mosaic_test.py ISONEST PLUGIN_FOLDER
"""
import json
import shutil
import struct
import subprocess
import sys
import unittest
import warnings

try:
    import numpy as np
    import pydicom
    warnings.simplefilter("ignore")
    from nibabel.nicom import csareader, dicomwrappers
    from pydicom.uid import ExplicitVRBigEndian, ExplicitVRLittleEndian, ImplicitVRLittleEndian, MRImageStorage
    from dicom_inputs import DicomInput, text
    from volume_inputs import ISONEST, RANDOM, DamagedFiles
except ImportError as error:
    print(f"skipped: {error}")
    sys.exit(77)


def csa(tags, newer=True):
    """The header as Siemens writes it: six items each, including empty ones."""
    out = b"SV10\4\3\2\1" if newer else b""
    out += struct.pack("<II", len(tags), 77)
    for index, (name, values) in enumerate(tags):
        items = [f"{v}".encode() + b"\0" for v in values] + [b""] * (6 - len(values))
        out += struct.pack("<64si4s3i", name.encode(), len(values), {"A": b"SH\0\0", "N": b"US\0\0"}.get(name[0], b"FD\0\0"), 3, len(items), 77)
        for item in items:
            # In the older form lengths are increased by the number of items of the first tag.
            length = len(item) if newer else len(item) + 6
            out += struct.pack("<4i", length, len(item), 77, length) + item + b"\0" * (-len(item) % 4)
    return out + b"\0" * (len(out) % 2)


class DicomMosaic(DamagedFiles, DicomInput):
    def tags(self, count, normal, **more):
        tags = [("EchoLinePosition", ["32"]), ("AcquisitionMatrixText", ["9*11"]), ("NumberOfImagesInMosaic", [f"{count:8}"]),
                ("SliceNormalVector", [f"{v:.8f}" for v in normal]), ("Empty", [])]
        return [(name, more.get(name, values)) for name, values in tags if more.get(name, values) is not None]

    def mosaic(self, volume, name="m.dcm", turn=np.eye(3), sign=1, newer=True, header=None, syntax=ExplicitVRLittleEndian, block=0x10, **more):
        """`volume`: [z, y, x]."""
        count, rows, columns = volume.shape
        side = int(np.ceil(np.sqrt(count)))
        plane = np.zeros((side * rows, side * columns), volume.dtype)
        for z in range(count):
            y, x = divmod(z, side)
            plane[y * rows:(y + 1) * rows, x * columns:(x + 1) * columns] = volume[z]
        more = {"SpacingBetweenSlices": "3.5", "SliceThickness": "3", **more}
        d = self.image(plane, name, syntax=syntax, SOPClassUID=MRImageStorage, Modality="MR", Manufacturer="SIEMENS", position=(-100, -90, 40),
                       ImageType=["ORIGINAL", "PRIMARY", "M", "ND", "MOSAIC"],
                       **{"ImageOrientationPatient": [text(v) for v in (*turn[:, 0], *turn[:, 1])], **more})
        if header is None:
            header = csa(self.tags(count, sign * turn[:, 2]), newer)
        if header:
            for at in range(0x10, block + 1):
                d.add_new(0x00290000 + at, "LO", "SIEMENS CSA HEADER" if at == block else "SOMETHING ELSE")
            d.add_new(0x00290000 + (block << 8) + 0x10, "OB", header)
        d.save_as(self.path / name, write_like_original=False)
        return d

    def judged(self, name="m.dcm", header=None):
        """Values [z, y, x] and the affine of (x, y, z) by nibabel. `header`: the newer form of an older header, which
        nibabel cannot read if its first tag has items."""
        wrapper = dicomwrappers.wrapper_from_file(str(self.path / name)) if header is None else dicomwrappers.MosaicWrapper(
            pydicom.dcmread(self.path / name), csareader.read(header))
        self.assertTrue(wrapper.is_mosaic)
        return wrapper.get_data().transpose(2, 0, 1), wrapper.affine[:, [1, 0, 2, 3]]

    def lies_as(self, affine):
        """Checks the first node and the steps, for axes that were not reversed."""
        done = subprocess.run([ISONEST, "info", self.here / "s.isonest", "--json"], check=True, capture_output=True)
        info = json.loads(done.stdout)
        np.testing.assert_allclose(info["origin"], affine[:3, 3], atol=1e-5)
        steps = (np.array(info["direction"]).reshape(3, 3).T if "direction" in info else np.eye(3)) * np.array(info["spacing"])
        np.testing.assert_allclose(steps, affine[:3, :3], atol=1e-5)

    def test_slices_are_cut_out_and_lie_where_nibabel_says(self):
        turn, _ = np.linalg.qr(np.random.default_rng(3).normal(size=(3, 3)))
        turn *= np.linalg.det(turn)
        for count in (2, 4, 5, 12, 16):
            for axes, newer, syntax, block in ((np.eye(3), True, ExplicitVRLittleEndian, 0x10), (turn, False, ImplicitVRLittleEndian, 0x11),
                                               (turn, True, ExplicitVRBigEndian, 0x10)):
                with self.subTest(count=count, newer=newer, syntax=syntax.name):
                    volume = RANDOM.integers(0, 4096, (count, 9, 11)).astype("u2")
                    self.mosaic(volume, turn=axes, newer=newer, syntax=syntax, block=block)
                    values, affine = self.judged(header=None if newer else csa(self.tags(count, axes[:, 2])))
                    np.testing.assert_array_equal(values, volume)
                    self.reads(volume)
                    self.lies_as(affine)

    def test_slices_against_the_normal(self):
        volume = RANDOM.integers(0, 4096, (5, 9, 11)).astype("u2")
        self.mosaic(volume, sign=-1)
        _, affine = self.judged()
        self.assertLess(affine[2, 2], 0)
        self.reads(np.ascontiguousarray(volume[::-1]))
        self.lies(affine[:3, 3] + 4 * affine[:3, 2], [0.25, 0.5, 3.5])

    def test_an_image_of_one_slice_and_scalings(self):
        volume = RANDOM.integers(0, 4096, (1, 9, 11)).astype("u2")
        self.mosaic(volume)
        self.reads(volume)
        volume = RANDOM.integers(0, 4096, (7, 9, 11)).astype("u2")
        self.mosaic(volume, BitsStored=12, HighBit=11, RescaleSlope="2", RescaleIntercept="-5")
        self.reads((volume.astype("i4") * 2 - 5).astype("i2"))

    def test_a_series_of_mosaics_is_of_times(self):
        series = RANDOM.integers(0, 4096, (3, 5, 9, 11)).astype("u2")
        for t in range(3):
            self.mosaic(series[t], f"{(t * 2) % 3}.dcm", AcquisitionNumber=t + 1, InstanceNumber=t + 1)
        self.refuses(5, "t 3, z 5, y 9, x 11", "acquisition 1, 2, 3", "--index")
        for t in range(3):
            self.reads(series[t], "--index", f"t={t}")

    def test_packed_mosaics(self):
        if shutil.which("gdcmconv") is None:
            self.skipTest("no gdcmconv (Debian: libgdcm-tools)")
        volume = (np.arange(5 * 9 * 11).reshape(5, 9, 11) * 7 % 4096).astype("u2")
        for way in ("--jpeg", "--jpegls", "--j2k", "--rle"):
            with self.subTest(way=way):
                self.mosaic(volume)
                subprocess.run(["gdcmconv", way, self.path / "m.dcm", self.path / "m.new"], check=True, capture_output=True)
                (self.path / "m.new").rename(self.path / "m.dcm")
                self.reads(volume)

    def test_a_mosaic_without_its_header_is_refused(self):
        volume = RANDOM.integers(0, 4096, (5, 9, 11)).astype("u2")
        good = self.tags(5, (0, 0, 1))
        for header in (b"", b"SV10\4\3\2\1", csa(good)[:300], csa([]), csa(self.tags(0, (0, 0, 1))), csa(self.tags(5, (0, 0, 1), SliceNormalVector=None)),
                       csa(self.tags(5, (0, 0, 1), NumberOfImagesInMosaic=["many"])), csa(self.tags(5, (0, 0, 1), SliceNormalVector=["0", "0"]))):
            with self.subTest(header=header[:20]):
                self.mosaic(volume, header=header + b"\0" * (len(header) % 2))
                self.refuses(5, "m.dcm", "MOSAIC", "private header")
        for header in (csa(self.tags(5, (1, 0, 0))), csa(self.tags(17, (0, 0, 1))), csa(self.tags(999999, (0, 0, 1)))):
            self.mosaic(volume, header=header)
            self.refuses(4, "m.dcm")
        for element in ("ImagePositionPatient", "ImageOrientationPatient", "PixelSpacing"):
            self.mosaic(volume, **{element: None})
            self.refuses(5, "m.dcm", "MOSAIC")

    def test_counts_in_the_header_that_are_hostile(self):
        volume = RANDOM.integers(0, 4096, (5, 9, 11)).astype("u2")
        good = csa(self.tags(5, (0, 0, 1)))
        for newer in (True, False):
            good = csa(self.tags(5, (0, 0, 1)), newer)
            start = 8 if newer else 0
            for at in (start, start + 8 + 76, start + 8 + 84, start + 8 + 88, start + 8 + 64):
                for number in (0xFFFFFFFF, 0x7FFFFFFF, 0x80000000, 1001, 1 << 20):
                    data = bytearray(good)
                    struct.pack_into("<I", data, at, number)
                    self.mosaic(volume, header=bytes(data))
                    done = self.preprocess("--memory", "256M")
                    self.assertIn(done.returncode, (0, 4, 5), (at, number, done.stderr))

    def test_damaged_files(self):
        volume = RANDOM.integers(0, 4096, (5, 9, 11)).astype("u2")
        self.mosaic(volume)
        whole = (self.path / "m.dcm").read_bytes()
        self.path = self.path / "m.dcm"
        self.damaged(whole)
        at = whole.index(b"SV10")
        for i in range(100):
            data = bytearray(whole)
            for _ in range(3):
                data[at + RANDOM.integers(700)] = RANDOM.integers(256)
            self.path.write_bytes(data)
            done = self.preprocess("--memory", "256M")
            self.assertIn(done.returncode, (0, 4, 5), (i, done.stderr))


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1])
