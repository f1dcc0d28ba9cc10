"""Regenerates the seeds of the fuzzing corpus.   Usage: make_corpus.py ISONEST"""
import bz2
import gzip
import io
import json
import pathlib
import struct
import subprocess
import sys
import tempfile
import zipfile
import zlib

import h5py
import mrcfile
import netCDF4
import nibabel
import numcodecs
import numpy as np
import pydicom
import tifffile
import vtk
from vtk.util import numpy_support

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1] / "support"))
from zarr_two import zarr  # noqa: E402

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
seed("nrrd", "bzip2", header + b"bzip2\n\n" + bz2.compress(values))
seed("nrrd", "text", header + b"ascii\n\n" + b" ".join(b"%d" % i for i in range(-9, 15)))
seed("nrrd", "hex", header + b"hex\n\n" + values.hex().encode())
seed("nrrd", "list", header + b"raw\ndata file: LIST 2\nv.nrrd\nv.nrrd\n\n")
seed("nrrd", "pattern", header + b"raw\ndata file: v%01d.nrrd 1 2 1 3\n\n")
seed("nrrd", "vector", b"NRRD0004\ntype: uchar\ndimension: 4\nsizes: 3 2 2 2\nkinds: vector domain domain time\n"
     b"labels: \"v\" \"x\" \"y\" \"t\"\nencoding: raw\n\n" + bytes(range(24)))
pixels = bytes(range(6)) + b"\0\0"  # rows of six bytes, padded to eight
for bits, name, palette, rows in ((8, "bmp", bytes(0 if i % 4 == 3 else i // 4 for i in range(1024)), pixels * 3),
                                  (24, "bmp_colours", b"", (b"\7\7\7" * 6 + b"\0\0") * 3), (1, "bmp_bits", b"\0\0\0\0\xff\xff\xff\0", b"\x54\0\0\0" * 3)):
    start = 54 + len(palette)
    seed("volume", name, struct.pack("<2sIHHI", b"BM", start + len(rows), 0, 0, start)
         + struct.pack("<IiiHHIIiiII", 40, 6, 3, 1, bits, 0, len(rows), 0, 0, 0, 0) + palette + rows)


def png_chunk(kind, body):
    return struct.pack(">I", len(body)) + kind + body + struct.pack(">I", zlib.crc32(kind + body))


for interlaced in (0, 1):
    rows = b"".join(b"\0" + bytes(range(i, i + 12)) for i in range(2))
    seed("volume", f"png_{interlaced}", b"\x89PNG\r\n\x1a\n" + png_chunk(b"IHDR", struct.pack(">IIBBBBB", 6, 2, 16, 0, 0, 0, interlaced))
         + png_chunk(b"IDAT", zlib.compress(rows + bytes(8 * interlaced))) + png_chunk(b"IEND", b""))
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
    """Files as other programs write them."""
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
seed("numpy", "npy", saved("v.npy", lambda p: np.save(p, grid)))
seed("numpy", "npy_fortran", saved("v.npy", lambda p: np.save(p, np.asfortranarray(grid[None]))))
seed("numpy", "npz", saved("v.npz", lambda p: np.savez(p, v=grid)))
seed("numpy", "npz_deflated", saved("v.npz", lambda p: np.savez_compressed(p, v=grid)))
seed("mrc", "mrc", saved("v.mrc", lambda p: mrcfile.new(p, grid).close()))
packed_map = bytearray(saved("v.mrc", lambda p: mrcfile.new(p, grid).close()))
packed_map[64:76] = struct.pack("<3i", 3, 1, 2)
seed("mrc", "mrc_gzip_axes", gzip.compress(packed_map, mtime=0))
seed("mgh", "mgh", saved("v.mgh", lambda p: nibabel.save(nibabel.MGHImage(grid.T, np.diag([1, 2, 3, 1])), p)))
seed("mgh", "mgz", gzip.compress(saved("v.mgh", lambda p: nibabel.save(nibabel.MGHImage(grid.T, np.eye(4)), p)), mtime=0))
for name, known in (("analyze", nibabel.AnalyzeHeader().binaryblock), ("dm3", struct.pack(">iii", 3, 104, 1) + bytes(100)),
                    ("plot3d", struct.pack("<5i", 12, 2, 2, 2, 12) + bytes(104)), ("stl", bytes(80) + struct.pack("<I", 1) + bytes(50)),
                    ("vtr", b'<?xml version="1.0"?><VTKFile type="RectilinearGrid">'), ("obj", b"# a mesh\nv 1 2 3\n"),
                    ("edf", b"{\nByteOrder = LowByteFirst ;\nDim_1 = 4 ;\n}\n"), ("head", b"\ntype = string-attribute\nname = A\n")):
    seed("known", name, known)
for name, kind in (("nifti", nibabel.Nifti1Image), ("nifti2", nibabel.Nifti2Image)):
    seed("nifti", name, saved("v.nii", lambda p: nibabel.save(kind(grid.T, np.diag([1, 2, 3, 1])), p)))
seed("nifti", "nifti_gzip", saved("v.nii.gz", lambda p: nibabel.save(nibabel.Nifti1Image(grid.T, np.eye(4)), p)))
meta = b"ObjectType = Image\nNDims = 3\nDimSize = 4 3 2\nElementType = MET_SHORT\n"
seed("meta_image", "meta", meta + b"ElementSpacing = 1 2 3\nTransformMatrix = -1 0 0 0 1 0 0 0 1\n"
     b"ElementDataFile = LOCAL\n" + values)
seed("meta_image", "meta_zlib", meta + b"CompressedData = True\nElementDataFile = LOCAL\n" + zlib.compress(values))
for name, calls in (("vti", {}), ("vti_raw", {"SetCompressorTypeToNone": ()}),
                    ("vti_base64", {"SetEncodeAppendedData": (1,)}), ("vti_binary", {"SetDataModeToBinary": ()}),
                    ("vti_text", {"SetDataModeToAscii": ()}), ("vti_lz4", {"SetCompressorTypeToLZ4": ()}),
                    ("vti_lzma", {"SetCompressorTypeToLZMA": ()}), ("vti_pieces", {"SetNumberOfPieces": (2,)})):
    seed("vti", name, saved("v.vti", lambda p: vtk_file(vtk.vtkXMLImageDataWriter(), p, **{
        "SetEncodeAppendedData": (0,), **calls})))
seed("vtk", "vtk", saved("v.vtk", lambda p: vtk_file(vtk.vtkStructuredPointsWriter(), p, SetFileTypeToBinary=())))
seed("vtk", "vtk_text", saved("v.vtk", lambda p: vtk_file(vtk.vtkStructuredPointsWriter(), p)))


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


def dicom_slice(path, z, way=None):
    dicom_file(path)
    d = pydicom.dcmread(path)
    del d.NumberOfFrames, d.PerFrameFunctionalGroupsSequence
    d.ImagePositionPatient, d.InstanceNumber, d.SOPInstanceUID = [0, 0, z], z, f"1.2.3.4.{z}"
    d.PixelData = d.PixelData[:128]
    d["PixelData"].VR = "OW"
    d.save_as(path)
    if way is not None:
        subprocess.run(["gdcmconv", way, path, str(path) + ".new"], check=True)
        pathlib.Path(str(path) + ".new").replace(path)


def several(*files):
    return b"".join(struct.pack("<H", len(file)) + file for file in files)


seed("dicom", "frames", several(saved("v.dcm", dicom_file)))
seed("dicom", "slices", several(*(saved("v.dcm", lambda p: dicom_slice(p, z)) for z in (2, 1, 3))))
seed("dicom", "gap", several(*(saved("v.dcm", lambda p: dicom_slice(p, z)) for z in (1, 2, 4))))
seed("dicom", "rle", several(*(saved("v.dcm", lambda p: dicom_slice(p, z, "--rle")) for z in (1, 2))))
seed("dicom", "implicit", several(*(saved("v.dcm", lambda p: dicom_slice(p, z, "--implicit")) for z in (1, 2))))


def changed_dicom(path, change, z=1):
    """A slice with other elements."""
    dicom_slice(path, z)
    d = pydicom.dcmread(path)
    change(d)
    d.save_as(path)


def dataset(**elements):
    item = pydicom.dataset.Dataset()
    for key, value in elements.items():
        setattr(item, key, value)
    return item


def with_table(d):
    d.ModalityLUTSequence = [dataset(LUTDescriptor=[3, 5, 16], ModalityLUTType="HU")]
    d.ModalityLUTSequence[0].add_new(0x00283006, "OW", b"\1\0\2\0\3\4")


def as_mosaic(d, newer=True):
    tags = (("NumberOfImagesInMosaic", b"US\0\0", ["3"]), ("SliceNormalVector", b"FD\0\0", ["0.0", "0.0", "1.0"]))
    header = b"SV10\4\3\2\1" * newer + struct.pack("<II", len(tags), 77)
    for name, vr, items in tags:
        header += struct.pack("<64si4s3i", name.encode(), len(items), vr, 3, len(items), 77)
        for item in items:
            length = len(item) + (0 if newer else len(tags[0][2]))
            header += struct.pack("<4i", length, length, 77, length) + item.encode() + bytes(-len(item) % 4)
    d.ImageType, d.SpacingBetweenSlices = ["ORIGINAL", "PRIMARY", "MOSAIC"], 3
    d.add_new(0x00290010, "LO", "SIEMENS CSA HEADER")
    d.add_new(0x00291010, "OB", header)


def as_segmentation(d, kind="BINARY"):
    d.SegmentationType, d.MaximumFractionalValue = kind, 200
    d.SegmentSequence = [dataset(SegmentNumber=n, SegmentLabel=f"s{n}", RecommendedDisplayCIELabValue=[30000, 40000, 20000])
                         for n in (1, 2)]
    d.PerFrameFunctionalGroupsSequence = [
        dataset(SegmentIdentificationSequence=[dataset(ReferencedSegmentNumber=n)],
                PlanePositionSequence=[dataset(ImagePositionPatient=[0, 0, z])]) for n, z in ((1, 0), (2, 0), (1, 3))]
    d.NumberOfFrames, d.SpacingBetweenSlices = 3, 1
    d.BitsAllocated = d.BitsStored = 1 if kind == "BINARY" else 8
    d.HighBit = d.BitsStored - 1
    d.PixelData = bytes(range(24)) if kind == "BINARY" else bytes(range(192))
    d["PixelData"].VR = "OB"


def bare(data):
    """Without preamble and file meta group."""
    return data[132 + 12 + struct.unpack_from("<I", data, 140)[0]:]


for name, change in (("table", with_table), ("mosaic", as_mosaic), ("mosaic_csa1", lambda d: as_mosaic(d, False)),
                     ("segments", as_segmentation), ("fractions", lambda d: as_segmentation(d, "FRACTIONAL")),
                     ("label_map", lambda d: as_segmentation(d, "LABELMAP"))):
    seed("dicom", name, several(saved("v.dcm", lambda p: changed_dicom(p, change))))
seed("dicom", "bare", several(*(bare(saved("v.dcm", lambda p: dicom_slice(p, z))) for z in (2, 1))))
seed("dicom", "copies", several(*(saved("v.dcm", lambda p: dicom_slice(p, z)) for z in (2, 1, 2))))


def echo_image(path, z, echo):
    def change(d):
        d.EchoNumbers, d.SOPInstanceUID = echo, f"1.2.{echo}.{z}"

    changed_dicom(path, change, z)


seed("dicom", "times", several(*(saved("v.dcm", lambda p: echo_image(p, z, echo)) for z, echo in ((1, 2), (1, 1), (2, 1), (2, 2)))))
for way in ("jpeg", "jpegls", "j2k", "rle"):
    seed("volume", f"dicom_{way}", saved("v.dcm", lambda p: dicom_file(p, f"--{way}")))
stack = np.arange(3 * 20 * 17, dtype="u2").reshape(3, 20, 17)
for name, options in (("strips", {"rowsperstrip": 7}), ("tiles", {"tile": (16, 16)}), ("big", {"bigtiff": True}),
                      ("big_endian", {"byteorder": ">"}), ("deflate", {"compression": "zlib", "predictor": 2})):
    seed("tiff", f"{name}", saved("v.tif", lambda p: tifffile.imwrite(p, stack, photometric="minisblack",
                                                                            metadata=None, **options)))
seed("tiff", "imagej", saved("v.tif", lambda p: tifffile.imwrite(
    p, stack[None, :, None], imagej=True, resolution=(2, 4), metadata={"axes": "TZCYX", "spacing": 3.5, "unit": "um"})))
seed("tiff", "ome", saved("v.tif", lambda p: tifffile.imwrite(
    p, stack, ome=True, photometric="minisblack", metadata={"axes": "ZYX", "PhysicalSizeX": 0.5})))
seed("tiff", "colours", saved("v.tif", lambda p: tifffile.imwrite(
    p, np.zeros((2, 8, 8, 3), "u1"), photometric="rgb", planarconfig="contig", metadata=None)))
for way in ("lzw:2", "packbits", "zstd", "jpeg"):
    def packed(path):
        plain = path.with_name("plain.tif")
        tifffile.imwrite(plain, stack.astype("u1"), photometric="minisblack", metadata=None)
        subprocess.run(["tiffcp", "-c", way, plain, path], check=True)
    seed("tiff", f"{way.split(':')[0]}", saved("v.tif", packed))


def netcdf(path, kind):
    with netCDF4.Dataset(path, "w", format=kind) as file:
        for dim, length in (("time", None), ("y", 3), ("x", 4)):
            file.createDimension(dim, length)
        file.createVariable("y", "f8", ("y",))[:] = [3, 2, 1]
        v = file.createVariable("t", "i2", ("time", "y", "x"), fill_value=-9)
        v.scale_factor, v.add_offset, v.long_name = 0.5, 10.0, "temperature"
        v[:] = grid


for kind in ("NETCDF3_CLASSIC", "NETCDF3_64BIT_OFFSET", "NETCDF3_64BIT_DATA"):
    seed("netcdf3", kind.lower().removeprefix("netcdf3_"), saved("v.nc", lambda p: netcdf(p, kind)))


def records(path):
    """The length is not a multiple of all of its numbers; coordinates are packed."""
    with netCDF4.Dataset(path, "w", format="NETCDF3_64BIT_DATA") as file:
        for dim, length in (("time", None), ("y", 3)):
            file.createDimension(dim, length)
        file.createVariable("step", "i4", ("time",))[:] = [1, 2]
        file.createVariable("time", "i8", ("time",))[:] = [5, 6]
        y = file.createVariable("y", "u1", ("y",))
        y.set_auto_maskandscale(False)
        y.scale_factor, y.units = -0.5, "mm"
        y[:] = [1, 2, 3]
        file.createVariable("v", "f8", ("time", "y"))[:] = [[1, 2, 3], [4, 5, 6]]


def zarr_folder(kind, description, chunk):
    text = json.dumps(description).encode()
    return bytes([kind]) + struct.pack("<H", len(text)) + text + chunk


with tempfile.TemporaryDirectory() as name:
    for codec in (None, numcodecs.Blosc("lz4"), numcodecs.Zlib(), numcodecs.Zstd(), numcodecs.GZip(), numcodecs.LZ4(), numcodecs.BZ2(),
                  numcodecs.LZMA()):
        zarr.save_array(name, grid, chunks=(2, 3, 4), compressor=codec)
        description = json.loads((pathlib.Path(name) / ".zarray").read_text())
        seed("zarr", f"v2_{codec.codec_id if codec else 'plain'}",
             zarr_folder(0, description, (pathlib.Path(name) / "0.0.0").read_bytes()))
with tempfile.TemporaryDirectory() as name:
    zarr.save_array(name, grid, chunks=(2, 3, 4), compressor=None, filters=[
        numcodecs.FixedScaleOffset(1, 2, "i2"), numcodecs.Delta("i2", "i4"), numcodecs.Shuffle(4), numcodecs.CRC32()])
    seed("zarr", "v2_filters", zarr_folder(0, json.loads((pathlib.Path(name) / ".zarray").read_text()),
                                           (pathlib.Path(name) / "0.0.0").read_bytes()))
    archive = io.BytesIO()
    with zipfile.ZipFile(archive, "w", zipfile.ZIP_DEFLATED) as file:
        for part in (".zarray", "0.0.0"):
            file.writestr(zipfile.ZipInfo(part), (pathlib.Path(name) / part).read_bytes())
    seed("volume", "zipped_zarr", archive.getvalue())
array = {"zarr_format": 3, "node_type": "array", "shape": [2, 3, 4], "data_type": "int16", "fill_value": -1,
         "chunk_grid": {"name": "regular", "configuration": {"chunk_shape": [2, 3, 4]}},
         "chunk_key_encoding": {"name": "default", "configuration": {"separator": "/"}},
         "codecs": [{"name": "transpose", "configuration": {"order": [2, 0, 1]}},
                    {"name": "bytes", "configuration": {"endian": "little"}}, {"name": "gzip"}],
         "dimension_names": ["z", "y", "x"], "attributes": {"scale_factor": 0.5, "_FillValue": "AAAAAAAA8D8="}}
seed("zarr", "v3", zarr_folder(1, array, gzip.compress(grid.transpose(2, 0, 1).tobytes(), mtime=0)))
shard = [{"name": "sharding_indexed", "configuration": {
    "chunk_shape": [1, 3, 2], "codecs": [{"name": "bytes", "configuration": {"endian": "big"}}],
    "index_codecs": [{"name": "bytes", "configuration": {"endian": "little"}}]}}]
entries = [(0, 12), (12, 12), (2**64 - 1, 2**64 - 1), (24, 12)]
seed("zarr", "v3_shard", zarr_folder(1, {**array, "codecs": shard},
                                     bytes(36) + b"".join(struct.pack("<QQ", *e) for e in entries)))
image = {"axes": [{"name": a, "type": "space"} for a in "zyx"], "datasets": [{"path": "0", "coordinateTransformations": [
    {"type": "scale", "scale": [2, 1, 1]}, {"type": "translation", "translation": [3, 0, 0]}]}]}
seed("zarr", "ome", zarr_folder(2, {"zarr_format": 3, "node_type": "group",
                                    "attributes": {"ome": {"version": "0.5", "multiscales": [image]}}}, b""))
image_label = {"colors": [{"label-value": 1, "rgba": [255, 0, 10, 128]}, {"label-value": 4, "rgba": [0, 255, 255]}],
               "properties": [{"label-value": 1, "class": "cell", "name": "a"}, {"label-value": 2, "class": "b"}]}
seed("zarr", "ome_labels", zarr_folder(2, {"zarr_format": 3, "node_type": "group", "attributes": {"ome": {
    "version": "0.5", "multiscales": [image], "image-label": image_label}}}, b""))
seed("nrrd", "segments", b"NRRD0004\ntype: uint8\ndimension: 3\nsizes: 3 2 4\nencoding: raw\nSegment0_Name:=a\\nb\n"
     b"Segment0_Color:=0.5 0.25 1\nSegment0_LabelValue:=2\nSegment0_Layer:=0\nSegment1_Name:=c\n\n" + bytes(range(24)))
caret = (b'<?xml version="1.0" encoding="UTF-8"?><CaretExtension><VolumeInformation Index="0"><LabelTable><Label Key="1" '
         b'Red="0.5" Green="0" Blue="1" Alpha="1"><![CDATA[a]]></Label><Label Key="2">b&amp;</Label></LabelTable>'
         b'</VolumeInformation></CaretExtension>')


def with_extension(path):
    nifti = nibabel.Nifti1Image(grid.T, np.eye(4))
    nifti.header.extensions.append(nibabel.nifti1.Nifti1Extension(30, caret))
    nibabel.save(nifti, path)


seed("nifti", "nifti_labels", saved("v.nii", with_extension))
seed("nifti", "nifti_labels_gzip", saved("v.nii.gz", with_extension))
seed("label_file", "freesurfer", b"#No. Label Name: R G B A\n0 Unknown 0 0 0 0\n3 Left-Cortex 205 62 78 0\n")
seed("label_file", "itk_snap", b'\xef\xbb\xbf 1 255 0 0 1 1 1 "left lung"\r\n 2 0 255 0 0.5 1 1 ""\n')
seed("label_file", "plain", "5 fünf\n-3 minus 1 2 3".encode())
row = struct.Struct("<qB3B4s")
seed("label_table", "two", bytes([3]) + row.pack(-5, 1, 255, 0, 10, b"ab") + row.pack(7, 0, 0, 0, 0, "äc".encode()))
seed("label_table", "unordered", bytes([3]) + row.pack(7, 1, 255, 0, 10, b"ab") + row.pack(-5, 1, 0, 0, 0, b""))
seed("store_header", "nodes", bytes([0]) + struct.pack("<QQQ", 9, 10, 1 << 20))
seed("store_header", "chunk", bytes([4]) + struct.pack("<I", 256))
seed("store_header", "fields", bytes([6]) + b"linf_plus,l1_bar")
seed("store_header", "range", bytes([7]) + struct.pack("<dd", float("nan"), 1e308))
seed("chunk_table", "offset", struct.pack("<HQ", 0, 1 << 40))
seed("chunk_table", "size", struct.pack("<HQ", 8, 0xFFFFFFFF))
seed("footer", "table_place", struct.pack("<BHQ", 0, 1200, 1 << 40))
seed("footer", "attribute_size", struct.pack("<BHQ", 1, 8, 0xFFFFFFFFFFFFFFF8))
seed("footer", "catalogue_place", struct.pack("<BHQ", 3, 0, 1 << 40))
seed("footer", "magic", struct.pack("<BHQ", 2, 56, 0))
seed("chunk_table", "swapped", struct.pack("<HQ", 40, 4096) + struct.pack("<HQ", 80, 4096))


def vtk_of_all_kinds(path, text):
    image = vtk.vtkImageData()
    image.SetDimensions(3, 2, 1)
    of = image.GetPointData()
    for name, parts, place in (("a", 4, of.SetScalars), ("b", 3, of.SetVectors), ("c", 2, of.SetTCoords), ("v", 3, of.AddArray)):
        array = numpy_support.numpy_to_vtk(np.ones((6, parts), "f4"), deep=True)
        array.SetName(name)
        place(array)
        array.GetRange(-1)
        array.SetComponentName(0, "part")
    for kind in (vtk.vtkBitArray, vtk.vtkStringArray, vtk.vtkIdTypeArray):
        array = kind()
        array.SetName(array.GetClassName())
        array.SetNumberOfValues(6)
        for i in range(6):
            array.SetValue(i, "text" if kind is vtk.vtkStringArray else i % 2)
        of.AddArray(array)
    writer = vtk.vtkStructuredPointsWriter()
    writer.SetInputData(image)
    writer.SetFileName(str(path))
    (writer.SetFileTypeToASCII if text else writer.SetFileTypeToBinary)()
    writer.Write()


chosen = b"\xff"  # then the targets for one file choose the array v and its component 1
for text in (False, True):
    seed("vtk", f"kinds_{'text' if text else 'binary'}", saved("v.vtk", lambda p: vtk_of_all_kinds(p, text)) + chosen)
seed("netcdf3", "records", saved("v.nc", lambda p: records(p)))


def objects(**of):
    """Input for the target remote_zarr: objects by their numbers."""
    return b"".join(bytes([int(n[1:])]) + struct.pack("<H", len(text)) + text
                    for n, text in ((n, json.dumps(value).encode()) for n, value in of.items()))


group3 = {"zarr_format": 3, "node_type": "group", "attributes": {"ome": {"version": "0.5", "multiscales": [image]}}}
array2 = {"zarr_format": 2, "shape": [2, 3, 4], "chunks": [2, 3, 4], "dtype": "<i2", "compressor": None, "fill_value": 0,
          "order": "C", "filters": None}
seed("remote_zarr", "v3", objects(_0={**group3, "consolidated_metadata": {"kind": "inline", "must_understand": False,
                                                                       "metadata": {"0": array}}}))
seed("remote_zarr", "v2", objects(_4={"zarr_consolidated_format": 1, "metadata": {
    ".zgroup": {"zarr_format": 2}, ".zattrs": {"multiscales": [image]}, "0/.zarray": array2}}, _3={"zarr_format": 2}))
seed("remote_zarr", "plain", objects(_1=array2, _2={"a": 1}, _5=array2))
asked = bytes([10, 20, 2, 0, 0, 200, 0, 1])
reply = b"HTTP/1.1 206 Partial Content\r\nContent-Range: bytes 10-29/200\r\nContent-Length: 20\r\nETag: \"a\"\r\n"
seed("answer", "part", asked + reply + b"Last-Modified: Thu, 26 Nov 2026 20:00:00 GMT\r\n\r\n")
seed("answer", "opening", bytes([0, 0, 0, 64, 0, 0, 0, 0]) + reply.replace(b"10-29", b"136-199").replace(b": 20", b": 64"))
seed("answer", "whole", bytes([0, 0, 1, 0, 99, 0, 0, 0]) + b"HTTP/2 200\r\ncontent-length: 7\r\ncontent-encoding: gzip\r\n")
seed("answer", "redirect", asked + b"HTTP/1.1 301 Moved\nLocation: https://example.org/b\nx-amz-bucket-region: eu-west-1\n\n")
seed("answer", "no_range", asked + b"HTTP/1.1 416 Range Not Satisfiable\r\nContent-Range: bytes */200\r\n")
for name, url, beside in (("https", "https://user:p%40ss@Example.org:8443/a%20b/c.nhdr?sig=1&X=2#f", "d e.raw"),
                          ("s3", "s3://bucket/key with space/v.zarr", "0/c/0/1"), ("escape", "http://[::1]/a/", "../b"),
                          ("other", "http://h/a?b", "//other/c"), ("none", "ftp://x", "http://y/z")):
    seed("object_url", name, struct.pack("<H", len(url)) + url.encode() + beside.encode())
place = b"https://example.org/a"
seed("cached_block", "two", b"isorng01" + struct.pack("<QQII4I", 0, 3, len(place), 2, 0, 8, 100, 4) + place + b"abcdefghijkl")
seed("cached_block", "none", b"isorng01" + struct.pack("<QQII", 0, 3, len(place), 0) + place)
