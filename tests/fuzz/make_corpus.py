"""Makes the seeds of the fuzzing corpus anew.   Usage: make_corpus.py ISONEST"""
import gzip
import pathlib
import struct
import subprocess
import sys
import tempfile
import zlib

import h5py
import mrcfile
import nibabel
import numpy as np
import pydicom
import vtk
from vtk.util import numpy_support

isonest = sys.argv[1]
corpus = pathlib.Path(__file__).with_name("corpus")


def seed(target, name, data):
    (corpus / target).mkdir(parents=True, exist_ok=True)
    (corpus / target / name).write_bytes(data)


with tempfile.TemporaryDirectory() as name:
    folder = pathlib.Path(name)
    subprocess.run([isonest, "make-volume", "sphere", "--size", "9", "--type", "uint8", "-o",
                    folder / "v.h5", "-q"], check=True)
    subprocess.run([isonest, "preprocess", folder / "v.h5", "-o", folder / "s", "--chunk", "8", "-q"],
                   check=True)
    seed("open_store", "sphere", (folder / "s").read_bytes())
    with h5py.File(folder / "s") as store:
        rows = store["chunks"][:]
        stored = [(folder / "s").read_bytes()[r["offset"]:r["offset"] + r["bytes"]] for r in rows]
    seed("chunk_decode", "values", bytes([0, 512 % 256, 512 // 256]) + stored[0])
    seed("chunk_decode", "indicators", bytes([5, 0, 1]) + stored[-1])
    subprocess.run([isonest, "extract", folder / "s", "--iso", "128", "--error", "30", "-o",
                    folder / "m.ply", "-q"], check=True)
    seed("ply", "sphere", (folder / "m.ply").read_bytes())

seed("ply", "quad", b"ply\nformat binary_little_endian 1.0\nelement vertex 3\nproperty double x\n"
     b"property float y\nproperty float value\nproperty float z\nelement face 1\nproperty uchar tag\n"
     b"property list uchar uint vertex_indices\nend_header\n"
     + struct.pack("<dfff", 0, 0, 1, 0) * 3 + struct.pack("<BBIII", 7, 3, 0, 1, 2))
header = (b"NRRD0004\n# c\ntype: short\ndimension: 3\nsizes: 4 3 2\nspacings: 1 1 2\n"
          b"space origin: (1,2,3)\nendian: little\nencoding: ")
values = struct.pack("<24h", *range(24))
seed("nrrd", "raw", header + b"raw\n\n" + values)
seed("nrrd", "gzip", header + b"gzip\n\n" + gzip.compress(values, mtime=0))
seed("nrrd", "skip", header + b"raw\nbyte skip: -1\n\n" + values)
seed("nrrd", "detached", header + b"raw\ndata file: v.nrrd\n\n")
seed("nrrd", "directions", b"NRRD0005\ntype: float\ndimension: 3\nspace: left-posterior-superior\n"
     b"sizes: 2 2 2\nspace directions: (1,0,0) (0,2,0) (0,0,3)\nendian: big\nencoding: raw\n\n"
     + struct.pack(">8f", *range(8)))
seed("nrrd", "backward", b"NRRD0005\ntype: uint8\ndimension: 4\nsizes: 1 3 2 4\nspace origin: (1,2,3)\n"
     b"space directions: none (-1,0,0) (0,-2,0) (0,0,-3)\nencoding: raw\n\n" + bytes(range(24)))
seed("nrrd", "spacings", b"NRRD0005\ntype: uint8\ndimension: 3\nsizes: 3 2 4\nspacings: -1 nan -2\n"
     b"encoding: gzip\n\n" + gzip.compress(bytes(range(24)), mtime=0))
seed("nrrd", "ends", b"NRRD0005\ntype: uint8\ndimension: 3\nsizes: 3 2 4\naxis mins: 1 nan 3\n"
     b"axis maxs: -4 2 1e308\ncenters: cell ??? node\nencoding: raw\n\n" + bytes(range(24)))
seed("nrrd", "skips", header + b"raw\nbyte skip: 3\nline skip: 2\n\na\nb\nxyz" + values)
seed("nrrd", "skips_gzip", header + b"gz\nline skip: 1\nbyte skip: 3\n\na\n"
     + gzip.compress(b"xyz" + values, mtime=0))
seed("nrrd", "skip_from_end_gzip", header + b"gzip\nbyte skip: -1\n\n" + gzip.compress(values, mtime=0))
seed("nrrd", "cut_trailer", header + b"gzip\n\n" + gzip.compress(values, mtime=0)[:-5])
seed("nrrd", "members", header + b"gzip\n\n" + gzip.compress(values[:9], mtime=0)
     + gzip.compress(values[9:], mtime=0) + bytes(9))
seed("nrrd", "no_magic", header + b"gzip\n\n" + b"\x1e" + gzip.compress(values, mtime=0)[1:] * 2)
seed("nrrd", "out_of_range", header.replace(b"1 1 2", b"1e400 1 1") + b"raw\n\n" + values)
seed("nrrd", "twice", header + b"raw\nbyte skip: 0\nbyteskip: 1\n\n" + values + b"x")
seed("nrrd", "kinds", header + b"raw\nkinds: 4-vector domain domain\n\n" + values)
seed("nrrd", "tilted", header.replace(b"spacings: 1 1 2", b"space directions: (1,1e-2,0) (0,1,0) (0,0,2)")
     + b"raw\n\n" + values)
seed("raw", "plain", bytes([3, 2, 1, 2, 0, 0, 0, 0]) + values)
seed("raw", "gzip", bytes([3, 2, 1, 2, 3, 2, 0, 0]) + gzip.compress(b"ab" + values, mtime=0))
seed("raw", "missing", bytes([3, 2, 1, 2, 5, 0, 9, 0]) + values)
seed("raw", "cut_trailer", bytes([3, 2, 1, 2, 0, 0, 0, 0]) + gzip.compress(values, mtime=0)[:-8])
seed("raw", "behind", bytes([3, 2, 1, 2, 0, 0, 0, 0]) + gzip.compress(values, mtime=0) + b"x")


def saved(name, write):
    """What other programs write to a file."""
    with tempfile.TemporaryDirectory() as folder:
        path = pathlib.Path(folder) / name
        write(path)
        return path.read_bytes()


def vtk_file(writer, path, **calls):
    image = vtk.vtkImageData()
    image.SetDimensions(4, 3, 2)
    array = numpy_support.numpy_to_vtk(np.arange(24, dtype="i2"), deep=True)
    array.SetName("v")
    image.GetPointData().SetScalars(array)
    writer.SetInputData(image)
    writer.SetFileName(str(path))
    for call, value in calls.items():
        getattr(writer, call)(*value)
    writer.Write()


grid = np.arange(24, dtype="i2").reshape(2, 3, 4)
seed("volume", "npy", saved("v.npy", lambda p: np.save(p, grid)))
seed("volume", "npy_fortran", saved("v.npy", lambda p: np.save(p, np.asfortranarray(grid[None]))))
seed("volume", "npz", saved("v.npz", lambda p: np.savez(p, v=grid)))
seed("volume", "npz_deflated", saved("v.npz", lambda p: np.savez_compressed(p, v=grid)))
seed("volume", "mrc", saved("v.mrc", lambda p: mrcfile.new(p, grid).close()))
for name, kind in (("nifti", nibabel.Nifti1Image), ("nifti2", nibabel.Nifti2Image)):
    seed("volume", name, saved("v.nii", lambda p: nibabel.save(kind(grid.T, np.diag([1, 2, 3, 1])), p)))
seed("volume", "nifti_gzip", saved("v.nii.gz", lambda p: nibabel.save(nibabel.Nifti1Image(grid.T, np.eye(4)), p)))
meta = b"ObjectType = Image\nNDims = 3\nDimSize = 4 3 2\nElementType = MET_SHORT\n"
seed("volume", "meta", meta + b"ElementSpacing = 1 2 3\nTransformMatrix = -1 0 0 0 1 0 0 0 1\n"
     b"ElementDataFile = LOCAL\n" + values)
seed("volume", "meta_zlib", meta + b"CompressedData = True\nElementDataFile = LOCAL\n" + zlib.compress(values))
for name, calls in (("vti", {}), ("vti_raw", {"SetCompressorTypeToNone": ()}),
                    ("vti_base64", {"SetEncodeAppendedData": (1,)}), ("vti_binary", {"SetDataModeToBinary": ()}),
                    ("vti_text", {"SetDataModeToAscii": ()})):
    seed("volume", name, saved("v.vti", lambda p: vtk_file(vtk.vtkXMLImageDataWriter(), p, **{
        "SetEncodeAppendedData": (0,), **calls})))
seed("volume", "vtk", saved("v.vtk", lambda p: vtk_file(vtk.vtkStructuredPointsWriter(), p, SetFileTypeToBinary=())))
seed("volume", "vtk_text", saved("v.vtk", lambda p: vtk_file(vtk.vtkStructuredPointsWriter(), p)))


def dicom_file(path, way=None):
    meta = pydicom.dataset.FileMetaDataset()
    meta.MediaStorageSOPClassUID, meta.MediaStorageSOPInstanceUID = pydicom.uid.CTImageStorage, "1.2.3.4"
    meta.TransferSyntaxUID = pydicom.uid.ExplicitVRLittleEndian
    d = pydicom.dataset.FileDataset(str(path), {}, file_meta=meta, preamble=bytes(128))
    d.is_little_endian, d.is_implicit_VR = True, False
    d.SOPClassUID, d.SOPInstanceUID, d.SeriesInstanceUID = meta.MediaStorageSOPClassUID, "1.2.3.4", "1.2.3"
    d.Modality, d.InstanceNumber, d.NumberOfFrames, d.Rows, d.Columns = "CT", 1, 2, 8, 8
    d.SamplesPerPixel, d.PhotometricInterpretation, d.PixelRepresentation = 1, "MONOCHROME2", 0
    d.BitsAllocated, d.BitsStored, d.HighBit = 16, 12, 11
    groups = []
    for z in range(2):
        frame = pydicom.dataset.Dataset()
        frame.PlanePositionSequence = [pydicom.dataset.Dataset()]
        frame.PlanePositionSequence[0].ImagePositionPatient = [0, 0, z]
        groups.append(frame)
    d.PerFrameFunctionalGroupsSequence = groups
    d.ImageOrientationPatient, d.PixelSpacing = [1, 0, 0, 0, 1, 0], [1, 2]
    d.RescaleSlope, d.RescaleIntercept = 2, -1024
    d.PixelData = (np.arange(128, dtype="u2") * 30).tobytes()
    d["PixelData"].VR = "OW"
    d.save_as(path, write_like_original=False)
    if way is not None:
        subprocess.run(["gdcmconv", way, path, str(path) + ".new"], check=True)
        pathlib.Path(str(path) + ".new").replace(path)


seed("volume", "dicom", saved("v.dcm", dicom_file))
for way in ("jpeg", "jpegls", "j2k", "rle"):
    seed("volume", f"dicom_{way}", saved("v.dcm", lambda p: dicom_file(p, f"--{way}")))
seed("store_header", "nodes", bytes([0]) + struct.pack("<QQQ", 9, 10, 1 << 20))
seed("store_header", "chunk", bytes([4]) + struct.pack("<I", 256))
seed("store_header", "fields", bytes([6]) + b"linf_plus,l1_bar")
seed("store_header", "range", bytes([7]) + struct.pack("<dd", float("nan"), 1e308))
seed("chunk_table", "offset", struct.pack("<HQ", 0, 1 << 40))
seed("chunk_table", "size", struct.pack("<HQ", 8, 0xFFFFFFFF))
seed("chunk_table", "swapped", struct.pack("<HQ", 40, 4096) + struct.pack("<HQ", 80, 4096))
