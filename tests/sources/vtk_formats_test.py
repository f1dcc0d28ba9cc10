#!/usr/bin/env python3
"""VTI files and VTK's legacy images as written by VTK.

usage: vtk_formats_test.py ISONEST PLUGIN_FOLDER
"""
import base64
import itertools
import json
import pathlib
import struct
import sys
import unittest
import xml.etree.ElementTree

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1] / "support"))
import served  # noqa: E402

try:
    import h5py
    import nibabel
    import numpy as np
    import vtk
    from vtk.util import numpy_support
    from volume_inputs import ISONEST, RANDOM, TYPES, DamagedFiles, Input, is_read_as, numbers
except ImportError as error:
    print(f"skipped: {error}")
    sys.exit(77)

ORIGIN, SPACING = (-1, 5, 7), (1, 2, 3)


def image_of(arrays, cells=False, extent=None, direction=None):
    """Arrays [z, y, x] or [z, y, x, component] of the same shape."""
    data = next(iter(arrays.values()))
    image = vtk.vtkImageData()
    more = 1 if cells else 0
    z, y, x = data.shape[:3]
    image.SetExtent(*(extent or (0, x - 1 + more, 0, y - 1 + more, 0, z - 1 + more)))
    image.SetSpacing(SPACING)
    image.SetOrigin(ORIGIN)
    if direction is not None:
        image.SetDirectionMatrix(np.ravel(direction))
    to = image.GetCellData() if cells else image.GetPointData()
    for name, values in arrays.items():
        array = numpy_support.numpy_to_vtk(values.reshape(x * y * z, -1) if values.ndim > 3 else values.ravel(), deep=True)
        array.SetName(name)
        to.AddArray(array)
    to.SetActiveScalars(next(iter(arrays)))
    return image


class Vti(DamagedFiles, Input):
    def setUp(self):
        super().setUp()
        self.path = self.here / "v.vti"

    def save(self, image, mode="appended", compressed=True, encoded=False, big=False, wide=True, block=4096, pieces=1):
        writer = vtk.vtkXMLImageDataWriter()
        writer.SetInputConnection(image.GetOutputPort()) if hasattr(image, "GetOutputPort") else writer.SetInputData(image)
        writer.SetFileName(str(self.path))
        {"appended": writer.SetDataModeToAppended, "binary": writer.SetDataModeToBinary,
         "ascii": writer.SetDataModeToAscii}[mode]()
        writer.SetEncodeAppendedData(encoded)
        {True: writer.SetCompressorTypeToZLib, False: writer.SetCompressorTypeToNone, "LZ4": writer.SetCompressorTypeToLZ4,
         "LZMA": writer.SetCompressorTypeToLZMA}[compressed]()
        (writer.SetByteOrderToBigEndian if big else writer.SetByteOrderToLittleEndian)()
        (writer.SetHeaderTypeToUInt64 if wide else writer.SetHeaderTypeToUInt32)()
        writer.SetBlockSize(block)
        writer.SetNumberOfPieces(pieces)
        self.assertEqual(writer.Write(), 1)

    def test_lz4_and_lzma(self):
        for compressor, mode, encoded, big, wide in itertools.product(
                ("LZ4", "LZMA"), ("appended", "binary"), (True, False), (True, False), (True, False)):
            if encoded and mode != "appended":
                continue
            for kind in ("u1", "f4", "i8"):
                with self.subTest(compressor=compressor, mode=mode, encoded=encoded, big=big, wide=wide, kind=kind):
                    data = numbers((11, 12, 13), kind)
                    self.save(image_of({"v": data}), mode, compressor, encoded, big, wide)
                    self.reads(is_read_as(data))
            whole = self.path.read_bytes()
            self.assertEqual(whole.count(compressor.encode()), 1)

    def test_a_damaged_block_of_lz4_or_lzma_is_an_error(self):
        for compressor in ("LZ4", "LZMA"):
            self.save(image_of({"v": np.zeros((11, 12, 13), "i4")}), compressed=compressor)
            whole = self.path.read_bytes()
            at = whole.index(b"_") + 1 + 8 * 5  # after the sizes of the two blocks
            for i in range(20):
                self.path.write_bytes(whole[:at + i] + bytes([whole[at + i] ^ 0xFF]) + whole[at + i + 1:])
                self.assertIn(self.preprocess().returncode, (0, 4))
            self.path.write_bytes(whole.replace(compressor.encode(), b"LZ5"))
            self.refuses(5, "vtkLZ5DataCompressor", "vtkLZ4DataCompressor")

    def test_several_pieces(self):
        """VTK writes the whole image in each piece if its source does not divide it."""
        for shape, cells, pieces in itertools.product(((11, 12, 13), (1, 12, 13), (5, 1, 7)), (False, True), (2, 3, 8, 13)):
            data = numbers(shape, "i2")
            image = image_of({"v": data}, cells=cells)
            for mode, compressed in (("appended", True), ("appended", False), ("binary", "LZ4"), ("ascii", False)):
                with self.subTest(shape=shape, cells=cells, pieces=pieces, mode=mode, compressed=compressed):
                    self.save(image, mode, compressed, pieces=pieces)
                    reader = vtk.vtkXMLImageDataReader()
                    reader.SetFileName(str(self.path))
                    reader.Update()
                    read = reader.GetOutput()
                    read = (read.GetCellData() if cells else read.GetPointData()).GetArray("v")
                    np.testing.assert_array_equal(numpy_support.vtk_to_numpy(read), data.ravel())
                    if self.path.read_bytes().count(b"<Piece") < 2:
                        continue
                    self.reads(data)

    def test_pieces_as_vtk_cuts_them(self):
        """Points on the faces between two pieces occur in both."""
        source = vtk.vtkRTAnalyticSource()
        source.SetWholeExtent(10, 22, -3, 8, 4, 14)
        source.Update()
        data = numpy_support.vtk_to_numpy(source.GetOutput().GetPointData().GetScalars()).reshape(11, 12, 13).copy()
        for pieces, (mode, compressed) in itertools.product((2, 3, 8, 13), (("appended", True), ("appended", False), ("binary", "LZ4"),
                                                                          ("ascii", False))):
            with self.subTest(pieces=pieces, mode=mode, compressed=compressed):
                self.save(source, mode, compressed, pieces=pieces)
                extents = {part.split(b">")[0] for part in self.path.read_bytes().split(b"<Piece Extent=")[1:]}
                self.assertEqual(len(extents), pieces)
                done = self.reads(data) if mode != "ascii" else self.preprocess()
                self.assertEqual(done.returncode, 0, done.stderr)
                self.lies([10, -3, 4], [1, 1, 1])

    def test_pieces_of_several_components_types_and_extents(self):
        data, other = numbers((5, 6, 7), "i8"), numbers((5, 6, 7, 3), "f4")
        for big in (False, True):
            self.save(image_of({"v": data, "w": other}, extent=(10, 16, -3, 2, 4, 8), direction=np.diag([-1, 1, -1])), big=big, pieces=4)
            self.refuses(2, "v Int64", "w Float32 x 3", "--dataset")
            self.reads(np.ascontiguousarray(is_read_as(data)[::-1, :, ::-1]), "--dataset", "v")
            for c in range(3):
                self.reads(np.ascontiguousarray(other[::-1, :, ::-1, c]), "--dataset", "w", "--index", f"c={c}")

    def test_pieces_that_do_not_make_the_image_are_refused(self):
        piece = ('<Piece Extent="{}"><PointData><DataArray Name="{}" type="Int32" format="ascii">' + "1 " * 12 + "</DataArray></PointData></Piece>").format
        for extents, code, words in ((("0 1 0 2 0 1", "2 3 0 1 0 1"), 4, "cover the whole image"),
                                     (("0 1 0 2 0 1", "2 4 0 2 0 1"), 4, "from 2 to 4, but the image from 0 to 3"),
                                     (("0 1 0 2 0 1", "0 1 0 2 0 1"), 4, "cover the whole image"),
                                     (("0 -1 0 2 0 1",), 4, "no piece that has points")):
            self.path.write_text('<VTKFile type="ImageData"><ImageData WholeExtent="0 3 0 2 0 1">'
                                 + "".join(piece(extent, "v") for extent in extents) + "</ImageData></VTKFile>")
            self.refuses(code, words)
        self.path.write_text('<VTKFile type="ImageData"><ImageData WholeExtent="0 3 0 2 0 1">'
                             + piece("0 1 0 2 0 1", "v") + piece("2 3 0 2 0 1", "w") + "</ImageData></VTKFile>")
        self.refuses(4, "lacks this array")

    def test_pieces_that_share_no_points(self):
        """As written by programs that do not follow VTK's rule."""
        data = numbers((2, 3, 4), "i4")
        piece = lambda lo, hi: (f'<Piece Extent="{lo} {hi} 0 2 0 1"><PointData><DataArray Name="v" type="Int32" format="ascii">'
                                + " ".join(map(str, data[..., lo:hi + 1].ravel())) + "</DataArray></PointData></Piece>")
        write = lambda *pieces: self.path.write_text('<VTKFile type="ImageData"><ImageData WholeExtent="0 3 0 2 0 1">'
                                                     + "".join(pieces) + "</ImageData></VTKFile>")
        write(piece(0, 1), '<Piece Extent="0 -1 0 -1 0 -1"><PointData><DataArray Name="x" type="Int8"/></PointData></Piece>', piece(2, 3))
        self.reads(data)
        write(piece(0, 0), piece(2, 3))
        self.refuses(4, "cover the whole image")
        write(piece(0, 2), piece(1, 3), piece(1, 2))
        self.reads(data)
        write(*[piece(0, 3)] * 300)
        self.refuses(5, "more than 256 pieces")

    def test_all_ways_to_store_numbers(self):
        for mode, compressed, encoded, big, wide in itertools.product(
                ("appended", "binary", "ascii"), (True, False), (True, False), (True, False), (True, False)):
            if (encoded and mode != "appended") or (mode == "ascii" and (compressed or big)):
                continue
            for kind in ("u1", "i2", "f4", "f8"):
                with self.subTest(mode=mode, compressed=compressed, encoded=encoded, big=big, wide=wide, kind=kind):
                    data = numbers((11, 12, 13), kind)
                    self.save(image_of({"v": data}), mode, compressed, encoded, big, wide)
                    self.reads(data)
                    self.lies(ORIGIN, SPACING)

    def test_all_types(self):
        for kind in (*TYPES, "i8", "u8"):
            data = numbers((5, 6, 7), kind)
            self.save(image_of({"v": data}))
            self.reads(is_read_as(data))

    def test_text_as_others_write_it(self):
        data = numbers((2, 3, 4), "i4")
        for kind, values in (("Int32", data), ("Int64", data.astype("i8") * 4096), ("UInt64", np.abs(data).astype("u8")),
                             ("Float64", data / 8)):
            words = " ".join(str(v) for v in values.ravel())
            for before, behind in (("", ""), ("\n ", "\n"), (" ", "")):
                self.path.write_text('<VTKFile type="ImageData"><ImageData WholeExtent="0 3 0 2 0 1"><Piece Extent="0 3 0 2 0 1">'
                                     f'<PointData><DataArray Name="v" type="{kind}" format="ascii">{before}{words}{behind}'
                                     '</DataArray></PointData></Piece></ImageData></VTKFile>')
                self.reads(is_read_as(values))
            self.path.write_text(self.path.read_text().replace(words, words.rsplit(" ", 1)[0]))
            self.assertIn(self.preprocess().returncode, (4,))

    def test_arrays_components_and_cells(self):
        data, other = numbers((5, 6, 7)), numbers((5, 6, 7, 3), "f4")
        for mode in ("appended", "binary", "ascii"):
            self.save(image_of({"v": data, "w": other}), mode)
            self.refuses(2, "v Int16", "w Float32 x 3", "--dataset")
            self.reads(data, "--dataset", "v")
            self.refuses(5, "axis 'c'", options=("--dataset", "w"))
            for c in range(3):
                self.reads(np.ascontiguousarray(other[..., c]), "--dataset", "w", "--index", f"c={c}")
            self.refuses(3, "v Int16", options=("--dataset", "x"))
        self.save(image_of({"v": data}, cells=True))
        self.reads(data)
        self.lies(np.array(ORIGIN) + np.array(SPACING) / 2, SPACING)

    def test_an_extent_that_does_not_begin_at_0(self):
        data = numbers((5, 6, 7))
        self.save(image_of({"v": data}, extent=(10, 16, -3, 2, 4, 8)))
        self.reads(data)
        self.lies([-1 + 10, 5 - 3 * 2, 7 + 4 * 3], SPACING)

    def test_directions(self):
        data = numbers((5, 6, 7))
        self.save(image_of({"v": data}, direction=np.diag([-1, 1, -1])))
        self.reads(np.ascontiguousarray(data[::-1, :, ::-1]))
        self.lies([-1 - 6, 5, 7 - 4 * 3], SPACING)

    def test_large_arrays_in_base64_within_the_xml(self):
        """The XML reader skips them by the length stored before them, which may be wrong."""
        data, other = numbers((60, 70, 80), "f8"), numbers((60, 70, 80), "u1")
        for big, wide in itertools.product((True, False), (True, False)):
            self.save(image_of({"v": data, "w": other}), "binary", False, big=big, wide=wide, pieces=1)
            self.reads(data, "--dataset", "v")
            self.reads(other, "--dataset", "w")
        whole = self.path.read_bytes()
        at = whole.index(b"<DataArray")
        at = whole.index(b">", at) + 1
        at += len(whole[at:]) - len(whole[at:].lstrip())
        for bytes_ in (0, 5, data.nbytes - 8, data.nbytes + 8, data.nbytes + 400000, 2**31 - 1, 2**32 - 1):
            lie = base64.b64encode(struct.pack("<I", bytes_) + base64.b64decode(whole[at:at + 8])[4:6])
            self.path.write_bytes(whole[:at] + lie + whole[at + 8:])
            self.refuses(4, options=("--dataset", "v"))

    def exported(self, data, *options):
        """The bytes of the export of `path`; checks that an XML parser, VTK and isonest itself read it as `data` [z, y,
        x]."""
        out = self.here / "e.vti"
        served.run([ISONEST, "export", self.here / "s.isonest", "--field", "values", "-o", out, "--force", *options], check=True, capture_output=True)
        root = xml.etree.ElementTree.parse(out).getroot()  # expat
        self.assertEqual(root.attrib, {"type": "ImageData", "version": "1.0", "byte_order": "LittleEndian", "header_type": "UInt64"})
        array = root.find("ImageData/Piece/PointData/DataArray")
        self.assertEqual(array.attrib["format"], "binary")
        packed = base64.b64decode(array.text.strip(), validate=True)
        self.assertEqual(int.from_bytes(packed[:8], "little"), data.nbytes)
        np.testing.assert_array_equal(np.frombuffer(packed[8:], data.dtype.newbyteorder("<")), data.ravel())
        reader = vtk.vtkXMLImageDataReader()
        reader.SetFileName(str(out))
        reader.Update()
        read = reader.GetOutput()
        self.assertEqual(read.GetDimensions(), data.shape[::-1])
        np.testing.assert_array_equal(numpy_support.vtk_to_numpy(read.GetPointData().GetScalars()), data.ravel())
        np.testing.assert_allclose((*read.GetOrigin(), *read.GetSpacing()), (*self.info()["origin"], *self.info()["spacing"]))
        return out.read_bytes()

    def test_exports_are_xml_that_vtk_and_isonest_read(self):
        for kind, shape in itertools.product(TYPES, ((5, 6, 7), (1, 3, 10), (3, 1, 1), (1, 1, 2), (9, 17, 19))):
            with self.subTest(kind=kind, shape=shape):
                data = numbers(shape, kind)
                self.path = self.here / "v.vti"
                self.save(image_of({"v": data}, direction=np.diag([1, -1, -1])))
                self.assertEqual(self.preprocess().returncode, 0)
                stored = np.ascontiguousarray(data[::-1, ::-1])
                whole = self.exported(stored)
                self.path = self.here / "e.vti"
                self.reads(stored)
                self.assertEqual(self.exported(stored), whole)

    def test_exports_in_boxes_are_the_same_bytes(self):
        """Rows that end in the middle of three bytes of base64, and boxes that end within rows, because of little
        memory."""
        data = numbers((3, 67, 2 * 64 * 64 + 1), "u1")
        self.save(image_of({"v": data}))
        served.run([ISONEST, "preprocess", self.path, "-o", self.here / "s.isonest", "--chunk", "64"], check=True, capture_output=True)
        whole = self.exported(data)
        self.assertEqual(self.exported(data, "--memory", "11M"), whole)

    def test_what_cannot_be_read_is_refused(self):
        image = image_of({"v": numbers((5, 6, 7))})
        self.save(image)
        whole = self.path.read_text("latin1")
        for code, old, new in ((5, 'type="ImageData"', 'type="ImageDatb"'), (4, 'WholeExtent="0 6', 'WholeExtent="0 x'),
                               (4, "<PointData", "<PointDat"), (4, 'Spacing="1 2', 'Spacing="0 2'),
                               (4, 'Piece Extent="0 6', 'Piece Extent="0 5')):
            self.assertIn(old, whole)
            self.path.write_bytes(whole.replace(old, new).encode("latin1"))
            done = self.preprocess()
            self.assertIn(done.returncode, (2, 3, code), done.stderr)

    def test_xml_that_would_take_much_memory(self):
        self.save(image_of({"v": numbers((5, 6, 7))}), mode="ascii")
        whole = self.path.read_bytes()
        at = whole.index(b"<PointData")
        for hostile, words in ((b"<a>" * 1000000, "more than 64 levels"), (b"<!--" + b"x" * (8 << 20) + b"-->", "more than 4 MiB"),
                               (b"<a b='" + b"x" * (8 << 20) + b"'/>", "more than 4 MiB"), (b"<a>" * 60 + b"</a>" * 60, None),
                               (b" " * (8 << 20), None)):
            self.path.write_bytes(whole[:at] + hostile + whole[at:])
            if words:
                self.refuses(4, words)
            else:
                self.assertEqual(self.preprocess().returncode, 0)

    def test_damaged_files(self):
        image = image_of({"v": numbers((5, 6, 7))})
        for options in ({}, {"compressed": False}, {"mode": "binary"}, {"mode": "ascii"}, {"encoded": True}):
            self.save(image, **options)
            # Possibly only the end of the XML is missing.
            whole = self.path.read_bytes()
            for i in range(30):
                data = bytearray(whole)
                for _ in range(RANDOM.integers(1, 4)):
                    data[RANDOM.integers(len(data))] = RANDOM.integers(256)
                if i % 4 == 0:
                    del data[RANDOM.integers(len(data)):]
                self.path.write_bytes(data)
                done = self.preprocess("--memory", "256M")
                self.assertIn(done.returncode, (0, 2, 3, 4, 5, 6, 7), (i, done.stderr))


class Vtkhdf(Input):
    """Images in HDF5, which VTK 9.1 reads partially and does not write: the positions are those of the same image in
    VTI."""

    def save(self, data, cells, extent, direction):
        self.path = self.here / "v.vtkhdf"
        with h5py.File(self.path, "w") as file:
            group = file.create_group("VTKHDF")
            group.attrs["Version"] = (1, 0)
            group.attrs.create("Type", np.bytes_("ImageData"))
            group.attrs.update({"WholeExtent": extent, "Origin": np.float64(ORIGIN), "Spacing": np.float64(SPACING)})
            if direction is not None:
                group.attrs["Direction"] = np.ravel(direction)
            group[f"{'CellData' if cells else 'PointData'}/v"] = data

    def test_an_image_lies_where_the_same_image_in_vti_lies(self):
        turn, _ = np.linalg.qr(np.random.default_rng(3).normal(size=(3, 3)))
        for cells, direction in itertools.product((False, True), (None, np.diag([-1.0, 1, -1]), np.eye(3)[[1, 2, 0]], turn, -turn)):
            with self.subTest(cells=cells, direction=direction):
                data = numbers((5, 6, 7), "i2")
                extent = (3, 9 + cells, -2, 3 + cells, 0, 4 + cells)
                self.path = self.here / "v.vti"
                writer = vtk.vtkXMLImageDataWriter()
                writer.SetInputData(image_of({"v": data}, cells, extent, direction))
                writer.SetFileName(str(self.path))
                writer.SetCompressorTypeToNone()
                writer.EncodeAppendedDataOff()
                writer.Write()
                self.assertEqual(self.preprocess().returncode, 0)
                info = json.loads(served.run([ISONEST, "info", self.here / "s.isonest", "--json"], check=True,
                                             capture_output=True).stdout)
                served.run([ISONEST, "export", self.here / "s.isonest", "--field", "values", "-o", self.here / "t.raw", "--force"],
                           check=True, capture_output=True)
                self.save(data, cells, extent, direction)
                self.reads(np.fromfile(self.here / "t.raw", "i2").reshape(data.shape))
                self.lies(info["origin"], info["spacing"])
                np.testing.assert_allclose(self.directions(), info["direction"], atol=1e-12)

    def test_other_spacings_keep_the_first_sample_and_the_rest_is_checked(self):
        data = numbers((5, 6, 7), "i2")
        self.save(data, False, (3, 9, -2, 3, 0, 4), np.diag([-1.0, 1, -1]))
        self.reads(data, "--spacing", "4,5,6")
        self.save(data, False, (3, 9, -2, 3, 0, 4), [[1, 0.5, 0], [0, 1, 0], [0, 0, 1]])
        self.assertEqual(self.preprocess().returncode, 0)
        np.testing.assert_allclose(np.array(self.directions()).T * self.info()["spacing"],
                                   np.array([[1, 0.5, 0], [0, 1, 0], [0, 0, 1]]) * SPACING, atol=1e-9)
        self.save(data, False, (3, 8, -2, 3, 0, 4), None)  # another size
        self.reads(data)
        self.lies((0, 0, 0), (1, 1, 1))
        parts = numbers((5, 6, 7, 2), "i2")
        self.save(parts, False, (0, 6, 0, 5, 0, 4), None)
        self.reads(np.ascontiguousarray(parts[..., 1]), "--index", ":,:,:,1")
        self.lies(ORIGIN, SPACING)


class Legacy(DamagedFiles, Input):
    def setUp(self):
        super().setUp()
        self.path = self.here / "v.vtk"

    def save(self, image, text=False, version=42):
        writer = vtk.vtkStructuredPointsWriter()
        writer.SetInputData(image)
        writer.SetFileName(str(self.path))
        (writer.SetFileTypeToASCII if text else writer.SetFileTypeToBinary)()
        writer.SetFileVersion(version)
        writer.Write()

    def test_what_vtk_writes(self):
        for kind, text, version in itertools.product((*TYPES, "i8"), (True, False), (42, 51)):
            if text and kind in ("f4", "f8", "u1"):
                continue  # rounded, or interpreted as colours
            with self.subTest(kind=kind, text=text, version=version):
                data = numbers((5, 6, 7), kind)
                self.save(image_of({"v": data}), text, version)
                self.reads(is_read_as(data))
                self.lies(ORIGIN, SPACING)

    def test_a_title_is_no_more_than_that(self):
        data = numbers((5, 6, 7))
        for text, title in itertools.product((False, True), ("Binary volume", "ASCII", "", "binary", "DATASET x")):
            self.save(image_of({"v": data}), text)
            magic, _, rest = self.path.read_bytes().split(b"\n", 2)
            self.path.write_bytes(b"\n".join((magic, title.encode(), rest)))
            self.reads(data)

    def test_an_array_behind_others_of_all_kinds(self):
        data = numbers((5, 6, 7))
        for text, version, cells in itertools.product((False, True), (42, 51), (False, True)):
            image = image_of({"first": numbers((5, 6, 7, 4)), "my data": data}, cells)
            of = image.GetCellData() if cells else image.GetPointData()
            for name, kind in (("bits", vtk.vtkBitArray), ("ids", vtk.vtkIdTypeArray), ("texts", vtk.vtkStringArray)):
                array = kind()
                array.SetName(name)
                array.SetNumberOfValues(data.size)
                for i in range(data.size):
                    array.SetValue(i, "a\nb" * (i % 30) if name == "texts" else i % 2)
                of.AddArray(array)
            for name, place in (("vectors", of.SetVectors), ("normals", of.SetNormals), ("tensors", of.SetTensors),
                                ("places", of.SetTCoords), ("global", of.SetGlobalIds)):
                parts = {"tensors": 9, "places": 2, "global": 1}.get(name, 3)
                array = numpy_support.numpy_to_vtk(np.ones((data.size, parts), "i8" if name == "global" else "f4"), deep=True,
                                                   array_type=vtk.VTK_ID_TYPE if name == "global" else None)
                array.SetName(name)
                place(array)
                if parts > 1:
                    array.GetRange(-1)  # this stores metadata in the array
                    array.SetComponentName(0, "a part")
            table = vtk.vtkLookupTable()
            table.Build()
            of.GetArray("first").SetLookupTable(table)
            field = numpy_support.numpy_to_vtk(np.linspace(0, 1, 3000), deep=True)
            field.SetName("of the file")
            image.GetFieldData().AddArray(field)
            last = numpy_support.numpy_to_vtk(data.ravel() // 2, deep=True)
            last.SetName("last")
            of.AddArray(last)
            with self.subTest(text=text, version=version, cells=cells):
                self.save(image, text, version)
                self.reads(data, "--dataset", "my data")
                self.reads(data, "--dataset", "my%20data")
                self.reads(data // 2, "--dataset", "last")
                self.reads(np.ones(data.shape, "f4"), "--dataset", "tensors", "--index", "c=8")
                self.refuses(3, "of the file'", "my data short", options=("--dataset", "of the file"))

    def test_an_array_of_another_length_is_refused(self):
        self.save(image_of({"v": numbers((5, 6, 7)), "w": numbers((5, 6, 7))}))
        whole = self.path.read_bytes()
        self.path.write_bytes(whole.replace(b"\nw 1 210 short", b"\nw 1 209 short"))
        self.refuses(4, "209", options=("--dataset", "w"))

    def test_arrays_of_another_length_than_the_image_are_refused(self):
        for fields, code in ((b"FIELD f 1\nv 1 24 char\n", 0), (b"FIELD f 1\nv 1 1 char\n", 4), (b"FIELD f 1\nv 1 25 char\n", 4)):
            self.path.write_bytes(b"# vtk DataFile Version 3.0\nx\nBINARY\nDATASET STRUCTURED_POINTS\nDIMENSIONS 4 3 2\nPOINT_DATA 24\n"
                                  + fields + bytes(range(30)))
            done = self.preprocess()
            self.assertEqual(done.returncode, code, done.stderr)
            self.assertIn("but there are [" if code else "", done.stderr)
        self.path.write_bytes(b"# vtk DataFile Version 3.0\nx\nBINARY\nDATASET STRUCTURED_POINTS\nDIMENSIONS 4 3 2\nPOINT_DATA 25\n"
                              b"SCALARS v char\nLOOKUP_TABLE default\n" + bytes(range(30)))
        self.refuses(4, "it has 25 values")

    def test_numbers_on_the_line_of_the_lookup_table_are_refused(self):
        self.save(image_of({"v": numbers((5, 6, 7), "i2")}), True)
        text = self.path.read_text()
        for line in ("LOOKUP_TABLE default 7", "LOOKUP_TABLE"):
            self.path.write_text(text.replace("LOOKUP_TABLE default", line))
            self.refuses(4, "LOOKUP_TABLE")

    def test_text_of_colours_is_refused(self):
        self.save(image_of({"v": numbers((5, 6, 7), "u1")}), True)
        self.refuses(5, "colours")

    def test_text_whose_z_runs_backward(self):
        for kind in ("i2", "i8"):
            data = numbers((5, 6, 7), kind)
            self.save(image_of({"v": data}), True)
            text = self.path.read_text()
            self.path.write_text(text.replace("SPACING 1 2 3", "SPACING 1 2 -3"))
            self.assertNotEqual(self.path.read_text(), text)
            self.reads(is_read_as(data[:, :, ::-1]))

    def test_text_of_floats(self):
        data = np.round(numbers((5, 6, 7), "f4"), 2)
        self.save(image_of({"v": data}), True)
        self.reads(data)

    def test_arrays_components_and_cells(self):
        data, other = numbers((5, 6, 7)), numbers((5, 6, 7, 3), "f4")
        self.save(image_of({"v": data, "w": other}))
        self.reads(data)
        self.reads(np.ascontiguousarray(other[..., 1]), "--dataset", "w", "--index", "c=1")
        self.refuses(3, "v short", options=("--dataset", "x"))
        self.save(image_of({"v": data}, cells=True))
        self.reads(data)
        self.lies(np.array(ORIGIN) + np.array(SPACING) / 2, SPACING)

    def test_damaged_files(self):
        for text in (False, True):
            self.save(image_of({"v": numbers((5, 6, 7))}), text)
            whole = self.path.read_bytes()
            for i in range(40):
                data = bytearray(whole)
                for _ in range(RANDOM.integers(1, 4)):
                    data[RANDOM.integers(min(len(data), 300))] = RANDOM.integers(256)
                if i % 4 == 0:
                    del data[RANDOM.integers(len(data)):]
                self.path.write_bytes(data)
                done = self.preprocess("--memory", "256M")
                self.assertIn(done.returncode, (0, 2, 3, 4, 5, 6, 7), (i, done.stderr))


class Export(Input):
    """What export writes, as other programs read it."""

    def setUp(self):
        super().setUp()
        self.path = self.here / "v.vti"

    def exported(self, name):
        done = served.run([ISONEST, "export", self.here / "s.isonest", "--field", "values", "-o",
                           self.here / name, "--force"], capture_output=True, text=True)
        self.assertEqual(done.returncode, 0, done.stderr)
        return self.here / name

    def by_vtk(self, reader, name):
        reader.SetFileName(str(self.exported(name)))
        reader.Update()
        image = reader.GetOutput()
        np.testing.assert_allclose(image.GetOrigin(), ORIGIN)
        np.testing.assert_allclose(image.GetSpacing(), SPACING)
        scalars = numpy_support.vtk_to_numpy(image.GetPointData().GetScalars())
        return scalars.reshape(image.GetDimensions()[::-1])

    def test_round_trips(self):
        for kind in TYPES:
            with self.subTest(kind=kind):
                data = numbers((9, 6, 7), kind)
                np.save(self.here / "v.npy", data)
                self.path = self.here / "v.npy"
                place = ("--spacing", ",".join(map(str, SPACING)), "--origin=" + ",".join(map(str, ORIGIN)))
                self.reads(data, *place)
                np.testing.assert_array_equal(np.load(self.exported("e.npy")), data)
                np.testing.assert_array_equal(self.by_vtk(vtk.vtkXMLImageDataReader(), "e.vti"), data)
                np.testing.assert_array_equal(self.by_vtk(vtk.vtkMetaImageReader(), "e.mha"), data)
                nifti = nibabel.load(self.exported("e.nii"))
                np.testing.assert_array_equal(np.asarray(nifti.dataobj).T, data)
                np.testing.assert_allclose(nifti.affine, [[1, 0, 0, -1], [0, 2, 0, 5], [0, 0, 3, 7], [0, 0, 0, 1]])
                for name in ("e.vti", "e.mha", "e.nii", "e.nrrd"):
                    self.path = self.exported(name)
                    self.reads(data)
                    self.lies(ORIGIN, SPACING)

    def test_a_long_axis_is_nifti_2(self):
        data = numbers((1, 2, 40000), "u1")
        np.save(self.here / "v.npy", data)
        self.path = self.here / "v.npy"
        self.reads(data)
        self.path = self.exported("e.nii")
        self.assertIsInstance(nibabel.load(self.path), nibabel.Nifti2Image)
        np.testing.assert_array_equal(np.asarray(nibabel.load(self.path).dataobj).T, data)
        self.reads(data)


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1])
