#!/usr/bin/env python3
"""Files that cannot be read as volumes are identified, with a program that converts them; unknown bytes are raw
numbers, which the user must describe.

The bytes are those of the formats' descriptions, or as other programs write them.

usage: known_formats_test.py ISONEST PLUGIN_FOLDER
"""
import bz2
import gzip
import io
import json
import lzma
import pathlib
import struct
import sys
import tarfile
import unittest
import zipfile

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1] / "support"))
import served  # noqa: E402

try:
    import nibabel
    import numpy as np
    import vtk
    from volume_inputs import ISONEST, RANDOM, Input
except ImportError as error:
    print(f"skipped: {error}")
    sys.exit(77)

UNKNOWN = "the format is not recognised"
MORE = bytes(range(256)) * 8


def packed_members():
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w") as archive:
        archive.writestr("v.raw", MORE)
    return file.getvalue()


def tar():
    file = io.BytesIO()
    with tarfile.open(fileobj=file, mode="w") as archive:
        member = tarfile.TarInfo("v.raw")
        member.size = len(MORE)
        archive.addfile(member, io.BytesIO(MORE))
    return file.getvalue()


def analyze():
    image = nibabel.AnalyzeImage(np.zeros((7, 6, 5), "i2"), np.eye(4))
    files = {key: nibabel.FileHolder(fileobj=io.BytesIO()) for key in ("header", "image")}
    image.to_file_map(files)
    return files["header"].fileobj.getvalue(), files["image"].fileobj.getvalue()


def stl(count):
    return b"exported by nobody".ljust(80) + struct.pack("<I", count) + bytes(50 * count)


def plot3d(records, big=False):
    order = ">" if big else "<"
    sizes, points = struct.pack(order + "3i", 7, 6, 5), struct.pack(order + "630f", *range(630))
    marks = [struct.pack(order + "i", len(part)) if records else b"" for part in (sizes, points)]
    return marks[0] + sizes + marks[0] + marks[1] + points + marks[1]


def spider():
    """A volume of 7 x 6 x 5; words of the header are numbered from 1."""
    words = np.zeros(7 * 37, "<f4")
    for at, value in ((1, 5), (2, 6), (5, 3), (12, 7), (13, 37), (22, 37 * 28), (23, 28)):
        words[at - 1] = value
    return words.tobytes() + np.arange(210, dtype="<f4").tobytes()


def klb():
    sizes, block = (64, 32, 16, 1, 1), (32, 32, 8, 1, 1)
    return (b"\2" + struct.pack("<5I", *sizes) + struct.pack("<5f", *[1] * 5) + b"\1\1" + bytes(256) + struct.pack("<5I", *block) + MORE)


def digital_micrograph(version):
    rest = MORE
    return (struct.pack(">iii", 3, len(rest) + 4, 1) if version == 3 else struct.pack(">iqi", 4, len(rest) + 4, 1)) + rest


JPEG2000 = b"\0\0\0\x0cjP  \r\n\x87\n" + MORE
XML = '<?xml version="1.0"?>\n'
VTK = XML + '<VTKFile type="{}" version="1.0" byte_order="LittleEndian" header_type="UInt64">'
LIF = b"\x70\0\0\0\x40\0\0\0\x2a\x1a\0\0\0<\0L\0M\0S\0" + MORE
# name, bytes, name of the format, required text in the advice
FILES = (
    ("v.czi", b"ZISRAWFILE" + MORE, "a Zeiss CZI file", "bfconvert 'v.czi' 'v.ome.tif'"),
    ("v.lif", LIF, "a Leica LIF file", "bfconvert"),
    ("v.nd2", b"\xda\xce\xbe\x0a" + MORE, "a Nikon ND2 file", "bfconvert"),
    ("v.oib", b"\xd0\xcf\x11\xe0\xa1\xb1\x1a\xe1" + MORE, "Olympus OIB", "bfconvert"),
    ("v.oif", b"\xff\xfe" + "[FileInformation]".encode("utf-16-le"), "an Olympus OIF file", "bfconvert"),
    ("v.ics", b"\t\nics_version\t1.0\nfilename\tv\n", "an ICS file", "bfconvert"),
    ("v.v3draw", b"raw_image_stack_by_hpengL" + MORE, "a Vaa3D stack", "bfconvert"),
    ("v.ser", b"II\x97\x01" + MORE, "a TIA SER file", "e2proc3d.py"),
    ("v.dm3", digital_micrograph(3), "a DigitalMicrograph file", "dm2mrc 'v.dm3' 'v.mrc'"),
    ("v.dm4", digital_micrograph(4), "a DigitalMicrograph file", "dm2mrc"),
    ("v.spi", spider(), "a SPIDER file", "e2proc3d.py"),
    ("v.klb", klb(), "a KLB file", "Fiji"),
    ("v.jpg", b"\xff\xd8\xff\xe0\0\x10JFIF" + MORE, "a JPEG image", "convert '*.jpg' -colorspace Gray 'v.tif'"),
    ("v.jp2", JPEG2000, "a JPEG 2000 image", "convert"),
    ("v.j2k", b"\xff\x4f\xff\x51" + MORE, "a JPEG 2000 codestream", "convert"),
    ("v.jxl", b"\xff\x0a" + MORE, "a JPEG XL image", "convert"),
    ("v.gif", b"GIF89a" + MORE, "a GIF image", "convert"),
    ("v.webp", b"RIFF\0\0\0\0WEBPVP8 " + MORE, "a WebP image", "convert"),
    ("v.exr", b"\x76\x2f\x31\x01" + MORE, "an OpenEXR image", "convert"),
    ("v.pgm", b"P5\n7 6 255\n" + bytes(42), "a portable bitmap", "convert"),
    ("v.pdf", b"%PDF-1.5\n" + MORE, "a PDF document", "give the volume"),
    ("v.mif", b"mrtrix image\ndim: 7,6,5\n", "an MRtrix image", "mrconvert 'v.mif' 'v.nii.gz'"),
    ("v.v", b"MATRIX72v" + MORE, "an ECAT file", "medcon"),
    ("v.hv", b"!INTERFILE :=\n!imaging modality := nucmed\n", "an Interfile header", "medcon -f 'v.hv' -c nifti"),
    ("v.PAR", b"# === DATA DESCRIPTION FILE ======\n", "a Philips PAR header", "parrec2nii"),
    ("lh.pial", b"\xff\xff\xfecreated by me on a day\n\n" + MORE, "a FreeSurfer surface", "no values to preprocess"),
    ("v+orig.HEAD", b"\ntype  = string-attribute\nname  = TYPESTRING\ncount = 15\n'3DIM_HEAD_ANAT~\n", "an AFNI header",
     "3dAFNItoNIFTI 'v+orig.HEAD'"),
    ("v.fits", b"SIMPLE  =                    T".ljust(80) + MORE, "a FITS file", "fits.getdata('v.fits')"),
    ("v.grib", b"GRIB\0\0\0\2" + MORE, "a GRIB file", "cdo -f nc copy 'v.grib' 'v.nc'"),
    ("v.hdf", b"\x0e\x03\x13\x01" + MORE, "an HDF4 file", "h4toh5"),
    ("v.root", b"root\0\0" + MORE, "a ROOT file", "uproot"),
    ("v.mat", b"MATLAB 5.0 MAT-file, Platform: GLNXA64".ljust(124) + b"\0\1IM" + MORE, "older than version 7.3", "scipy.io.loadmat('v.mat')"),
    ("v.plt", b"#!TDV112" + MORE, "a Tecplot file", "Resample To Image"),
    ("v.case", b"FORMAT\ntype: ensight gold\n", "an EnSight case", "Resample To Image"),
    ("v.nvdb", b"NanoVDB0" + MORE, "a NanoVDB file", "nanovdb_convert"),
    ("v.pvm", b"DDS v3d\n" + MORE, "a packed PVM volume", "pvm2raw"),
    ("v.am", b"# AmiraMesh BINARY-LITTLE-ENDIAN 2.1\n", "an Amira file", "Fiji"),
    ("v.surf", b"# HyperSurface 0.1 ASCII\n", "an Amira surface", "no values to preprocess"),
    ("v.bov", b"TIME: 1.0\nDATA_FILE: v.values\nDATA_SIZE: 10 20 30\nDATA_FORMAT: FLOAT\n", "a BOV header", "DATA_SIZE"),
    ("v.vgi", b"{volume1}\n[representation]\nsize = 10 20 30\n", "a VGStudio header", ".vol"),
    ("v.edf", b"{\nHeaderID = EH:000001:000000:000000 ;\nByteOrder = LowByteFirst ;\nDim_1 = 10 ;\n}\n", "an ESRF data file", "fabio"),
    ("v.xyz", plot3d(True), "a PLOT3D file", "Resample To Image"),
    ("v.p3d", plot3d(True, big=True), "a PLOT3D file", "Resample To Image"),
    ("v.p3dc", plot3d(False), "a PLOT3D file", "Resample To Image"),
    ("v.xmf", (XML + '<Xdmf Version="3.0"></Xdmf>').encode(), "an XDMF file", "HDF5 file that it describes"),
    ("v.xml", (XML + '<SpimData version="0.2"></SpimData>').encode(), "a BigDataViewer XML file", "t00000/s00/0/cells"),
    ("v.gii", (XML + "<!DOCTYPE GIFTI SYSTEM 'gifti.dtd'>\n<GIFTI Version='1.0'>").encode(), "a GIFTI mesh", "no values"),
    ("v.nii.gz", b"<!DOCTYPE html>\n<html><head>404</head></html>", "a web page", "download"),
    ("v.tif", b"version https://git-lfs.github.com/spec/v1\noid sha256:0\nsize 5\n", "a Git LFS pointer", "git lfs pull"),
    ("m.stl", stl(3), "an STL mesh", "no values to preprocess"),
    ("m_text.stl", b"solid m\n facet normal 0 0 1\n  outer loop\n", "an STL mesh", "no values"),
    ("m.ply", b"ply\nformat ascii 1.0\n", "a PLY mesh", "no values"),
    ("m.obj", b"# made by hand\nmtllib m.mtl\no m\nv 1.0 2.0 -3e1\nv 1 2 3\n", "an OBJ mesh", "no values"),
    ("m.off", b"OFF\n8 6 0\n", "an OFF mesh", "no values"),
    ("m.glb", b"glTF\2\0\0\0" + MORE, "a glTF mesh", "no values"),
    ("v.zip", packed_members(), "a ZIP archive", "unzip 'v.zip'"),
    ("v.7z", b"7z\xbc\xaf\x27\x1c" + MORE, "a 7z archive", "7z x 'v.7z'"),
    ("v.rar", b"Rar!\x1a\x07\0" + MORE, "a RAR archive", "unrar"),
    ("v.tar", tar(), "a tar archive", "tar xf 'v.tar'"),
    ("v.tar.gz", gzip.compress(tar()), "a tar archive", "tar xf 'v.tar.gz'"),
    ("v.nii.bz2", bz2.compress(MORE), "a bzip2 file", "bunzip2 -k 'v.nii.bz2'"),
    ("v.nii.xz", lzma.compress(MORE), "an xz file", "unxz -k"),
    ("v.nii.zst", b"\x28\xb5\x2f\xfd" + MORE, "a zstd file", "unzstd"),
    ("v.nii.Z", b"\x1f\x9d\x90" + MORE, "a compress (.Z) file", "uncompress"),
    ("v.hdr", analyze()[0], "an Analyze 7.5 header", "fslchfiletype NIFTI_GZ 'v.hdr' 'v'"),
    ("big.hdr", struct.pack(">i", 348) + bytes(36) + struct.pack(">4h", 3, 7, 6, 5) + bytes(300), "an Analyze 7.5 header", "fslchfiletype"),
    *((f"v.{kind.lower()}", VTK.format(kind).encode(), what, advice) for kind, what, advice in (
        ("UnstructuredGrid", "a VTK unstructured grid (.vtu)", "Resample To Image"),
        ("PolyData", "a VTK mesh (.vtp)", "no values"),
        ("PImageData", "pieces of a VTK image (.pvti)", "as one .vti"),
        ("PRectilinearGrid", "(.pvtr)", "Resample To Image"), ("vtkMultiBlockDataSet", "(.vtm)", "ParaView"),
        ("Collection", "(.pvd)", "one step"))),
)


class Known(Input):
    def write(self, name, data):
        self.path = self.here / name
        self.path.write_bytes(data)

    def test_each_is_named_with_what_converts_it(self):
        for name, data, what, advice in FILES:
            with self.subTest(name=name):
                self.write(name, data)
                self.refuses(5, "this is ", what, "which is not supported: ", advice)
                self.assertNotIn(UNKNOWN, self.preprocess().stderr)
                # Options for other formats do not change that, but a user who describes the numbers overrides it.
                self.refuses(5, what, options=("--dataset", "v"))
                done = self.preprocess("--dims", "5,4,2", "--type", "uint8", "--offset", "0")
                self.assertNotIn("this is", done.stderr)

    def test_in_gzip(self):
        for name, data, what, _ in FILES:
            if name in ("v.czi", "v.fits", "v.mif", "m.ply", "v.hdr", "v.am"):
                self.write(name + ".gz", gzip.compress(data))
                self.refuses(5, what)

    def test_what_vtk_writes(self):
        for maker, writer, what in ((vtk.vtkUnstructuredGrid, vtk.vtkXMLUnstructuredGridWriter, "unstructured grid"),
                                    (vtk.vtkPolyData, vtk.vtkXMLPolyDataWriter, "a VTK mesh")):
            made = writer()
            made.SetInputData(maker())
            made.SetFileName(str(self.here / "v.vt"))
            made.Write()
            self.path = self.here / "v.vt"
            self.refuses(5, what)

    def test_files_without_a_header_of_their_own(self):
        header, image = analyze()
        self.write("v.hdr", header)
        self.write("v.img", image)
        self.refuses(5, "an Analyze 7.5 image", "does not say which side is left")
        self.write("w+orig.HEAD", next(data for name, data, *_ in FILES if name.endswith(".HEAD")))
        self.write("w+orig.BRIK", MORE)
        self.refuses(5, "an AFNI dataset", "3dAFNItoNIFTI 'w+orig.HEAD'")

    def test_unknown_bytes_are_raw_numbers(self):
        for i in range(60):
            size = int(RANDOM.integers(1, 3000))
            self.write("v.raw" if i % 2 else "v", RANDOM.bytes(size))
            self.refuses(2, UNKNOWN, "raw numbers", "--dims")
        for data in (b"\0", bytes(5000), b"\xff" * 700, b"text that says nothing\n" * 9, np.arange(2000, dtype="<f4").tobytes(),
                     np.arange(4000, dtype=">i2").tobytes(), np.full(900, 3.5).tobytes(), b"BZh9" + MORE, b"root canal", b"solid ground",
                     b"v for volume", b"P5ych", b"<no known element/>", b"GRIB the rail", gzip.compress(MORE)):
            with self.subTest(data=data[:20]):
                self.write("v.raw", data)
                self.refuses(2, UNKNOWN)

    def test_names_that_no_command_could_have(self):
        self.write("it's.fits", b"SIMPLE  =".ljust(80))
        self.refuses(5, "fits.getdata('FILE')")

    def test_damaged_headers(self):
        for name, data, *_ in FILES:
            for _ in range(6):
                one = bytearray(data)
                one[int(RANDOM.integers(min(len(one), 60)))] = int(RANDOM.integers(256))
                self.write(name, bytes(one[:RANDOM.integers(1, len(one) + 1)]))
                self.assertIn(self.preprocess().returncode, (2, 3, 4, 5))


class Folders(Input):
    def setUp(self):
        super().setUp()
        self.path = self.here / "folder"
        self.path.mkdir()

    def test_empty(self):
        self.refuses(5, "the folder is empty")

    def test_folders_that_are_a_volume_of_others(self):
        for name, files, what, advice in (
                ("v.n5", {"attributes.json": '{"n5": "2.5.0"}'}, "an N5 folder", "N5Store('v.n5')"),
                ("p", {"info": json.dumps({"type": "image", "data_type": "uint8", "scales": []})}, "precomputed volume", "cloudvolume"),
                ("b", {"2dseq": "", "visu_pars": ""}, "Bruker ParaVision", "brkraw"),
                ("a.bp", {"md.idx": "", "data.0": ""}, "an ADIOS2 BP folder", "adios2")):
            self.path = self.here / name
            self.path.mkdir()
            for file, text in files.items():
                (self.path / file).write_text(text)
            self.refuses(5, "this is ", what, "which is not supported: ", advice)

    def test_folders_of_files(self):
        (self.path / "a.txt").write_text("nothing")
        (self.path / "s10.jpg").write_bytes(b"\xff\xd8\xff\xe0" + MORE)
        (self.path / "s2.jpg").write_bytes(b"\xff\xd8\xff\xe0" + MORE)
        self.refuses(5, "'s2.jpg', which is a JPEG image", "convert '*.jpg'")
        nibabel.save(nibabel.Nifti1Image(np.zeros((3, 4, 5), "i2"), np.eye(4)), self.path / "b.nii")
        self.refuses(5, "'b.nii', which is NIfTI: give that file")

    def test_folders_without_anything_known(self):
        (self.path / "v.raw").write_bytes(MORE)
        (self.path / "info").write_text("no JSON")
        (self.path / "attributes").mkdir()
        self.refuses(5, "there is no volume in this folder", "NRRD")


def several_files_of_a_known_kind(case):
    pictures = []
    for i in range(3):
        pictures.append(case.here / f"{i}.jpg")
        pictures[-1].write_bytes(b"\xff\xd8\xff\xe0" + MORE)
    return served.run([ISONEST, "preprocess", *pictures, "-o", case.here / "s.isonest"], capture_output=True, text=True)


class Lists(Input):
    def test_a_list_of_pictures(self):
        done = several_files_of_a_known_kind(self)
        self.assertEqual(done.returncode, 5)
        self.assertIn("a JPEG image", done.stderr)


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1])
