"""Shared by the DICOM tests: files as pydicom writes them.

REQUIRES: sys.argv[1] is the program; pydicom can be imported.
"""
import shutil

import pydicom  # noqa: F401
from pydicom.dataset import FileDataset, FileMetaDataset
from pydicom.uid import CTImageStorage, ExplicitVRBigEndian, ExplicitVRLittleEndian, ImplicitVRLittleEndian, generate_uid
from volume_inputs import RANDOM, Input

SERIES = generate_uid(entropy_srcs=["series"])


def text(value):
    return f"{value:.10g}"


class DicomInput(Input):
    def setUp(self):
        super().setUp()
        self.path = self.here / "series"
        self.path.mkdir()
        self.data = RANDOM.integers(0, 4096, (6, 9, 12)).astype("u2")

    def image(self, plane, name, syntax=ExplicitVRLittleEndian, position=(0, 0, 0), **more):
        """A file with one or several images."""
        meta = FileMetaDataset()
        meta.MediaStorageSOPClassUID = more.pop("SOPClassUID", CTImageStorage)
        meta.MediaStorageSOPInstanceUID = more.pop("SOPInstanceUID", None) or generate_uid(entropy_srcs=[str(name)])
        meta.TransferSyntaxUID = syntax
        d = FileDataset(str(self.path / name), {}, file_meta=meta, preamble=b"\0" * 128)
        d.is_little_endian = syntax != ExplicitVRBigEndian
        d.is_implicit_VR = syntax == ImplicitVRLittleEndian
        d.SOPClassUID, d.SOPInstanceUID = meta.MediaStorageSOPClassUID, meta.MediaStorageSOPInstanceUID
        d.SeriesInstanceUID, d.Modality, d.SeriesDescription = SERIES, "CT", "Thorax"
        d.StudyInstanceUID, d.PatientName = "1.2.3", "Nobody"
        d.Rows, d.Columns = plane.shape[-2:]
        if plane.ndim == 3:
            d.NumberOfFrames = len(plane)
        d.SamplesPerPixel, d.PhotometricInterpretation = 1, "MONOCHROME2"
        d.BitsAllocated = d.BitsStored = 8 * plane.dtype.itemsize
        d.HighBit = d.BitsStored - 1
        d.PixelRepresentation = int(plane.dtype.kind == "i")
        if position is not None:
            d.ImagePositionPatient = [text(p) for p in position]
            d.ImageOrientationPatient = [1, 0, 0, 0, 1, 0]
        d.PixelSpacing = [0.5, 0.25]
        order = "<" if d.is_little_endian else ">"
        d.PixelData = plane.astype(plane.dtype.newbyteorder(order)).tobytes()
        d["PixelData"].VR = "OB" if plane.dtype.itemsize == 1 else "OW"
        for key, value in more.items():
            if value is None:
                delattr(d, key)
            else:
                setattr(d, key, value)
        d.save_as(self.path / name, write_like_original=False)
        return d

    def stack(self, data, places=None, **more):
        """Files whose names are not in the order of their positions."""
        for z, plane in enumerate(data):
            place = 2 * z if places is None else places[z]
            self.image(plane, f"im{(z * 5) % 7}.dcm", position=(1, 2, 3 + place), InstanceNumber=len(data) - z, **more)

    def clear(self):
        shutil.rmtree(self.path)
        self.path.mkdir()
