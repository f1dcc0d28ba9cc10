"""Random images of VTK: legacy files and XML, by VTK's writers and by writers after the descriptions of the formats.

Sources: https://docs.vtk.org/en/latest/vtk_file_formats/vtk_legacy_file_format.html and
https://docs.vtk.org/en/latest/vtk_file_formats/vtkxml_file_format.html. VTK's readers read each file; the numbers and the
place that they find, which have to be those that were written, are what isonest has to find.
"""
import base64
import re
import struct
import zlib

import attack
import numpy as np
from vtkmodules.util import numpy_support
from vtkmodules.vtkCommonCore import vtkBitArray, vtkIdTypeArray, vtkObject, vtkStringArray
from vtkmodules.vtkCommonDataModel import vtkImageData
from vtkmodules.vtkIOLegacy import vtkDataSetReader, vtkDataSetWriter, vtkStructuredPointsReader, vtkStructuredPointsWriter
from vtkmodules.vtkIOXML import vtkXMLImageDataReader, vtkXMLImageDataWriter

from . import compare

vtkObject.GlobalWarningDisplayOff()
KINDS = compare.KINDS + ("i8", "u8")
NAMES = ("v", "density", "my_array", "groesse", "ab", "Scalars_", "Data", "my array", "größe", "a/b")
XML_TYPES = {"i1": "Int8", "u1": "UInt8", "i2": "Int16", "u2": "UInt16", "i4": "Int32", "u4": "UInt32", "i8": "Int64",
             "u8": "UInt64", "f4": "Float32", "f8": "Float64"}
LEGACY_TYPES = {"i1": "char", "u1": "unsigned_char", "i2": "short", "u2": "unsigned_short", "i4": "int",
                "u4": "unsigned_int", "i8": "vtktypeint64", "u8": "vtktypeuint64", "f4": "float", "f8": "double"}


class Image:
    """An image with several arrays, as numpy has them [z, y, x, component]."""

    def __init__(self, one, extents=True, turned=False):
        shape = [int(one.random.integers(1, 9)) if one.chance(0.9) else int(one.random.integers(9, 30)) for _ in range(3)]
        low = [int(i) for i in one.random.integers(-5, 20, 3)] if extents and one.chance(0.4) else [0, 0, 0]
        self.nodes = shape
        self.extent = [e for a in range(3) for e in (low[a], low[a] + shape[2 - a] - 1)]
        self.spacing = [float(s) for s in one.pick((1, 1, 1), 10.0 ** one.random.uniform(-3, 3, 3), (0.5, 0.25, 2))]
        self.origin = [float(o) for o in one.pick((0, 0, 0), one.random.normal(size=3) * 100)]
        self.direction = np.eye(3)
        if turned and one.chance(0.4):
            self.direction = _turn(one)
        self.arrays = []  # name, of cells, values
        names = [str(name) for name in one.random.permutation(NAMES)]
        for i in range(one.pick(1, 1, 2, 3)):
            cells = one.chance(0.25)
            size = [max(n - 1, 1) if cells else n for n in shape]
            parts = one.pick(1, 1, 1, 2, 3, 4)
            kind = one.pick(*KINDS)
            self.arrays.append((names[i], cells, compare.numbers(one, [*size, parts], kind)))

    def vtk(self, one):
        image = vtkImageData()
        image.SetExtent(*self.extent)
        image.SetSpacing(*self.spacing)
        image.SetOrigin(*self.origin)
        image.SetDirectionMatrix(np.ravel(self.direction))
        for name, cells, values in self.arrays:
            array = numpy_support.numpy_to_vtk(values.reshape(-1, values.shape[-1]), deep=True)
            array.SetName(name)
            if values.shape[-1] > 1 and one.chance(0.3):
                array.GetRange(-1)  # which adds keys with information to the array
                for part in range(values.shape[-1]):
                    array.SetComponentName(part, "part " + str(part))
            (image.GetCellData() if cells else image.GetPointData()).AddArray(array)
        for name, cells, values in self.arrays:
            data = image.GetCellData() if cells else image.GetPointData()
            if one.chance(0.5):
                data.SetActiveScalars(name)
            elif values.shape[-1] == 3 and one.chance(0.5):
                data.SetActiveVectors(name)
        if one.chance(0.15):
            more = one.pick(vtkBitArray, vtkIdTypeArray, vtkStringArray)()
            more.SetName("more")
            more.SetNumberOfValues(image.GetNumberOfPoints())
            for i in range(image.GetNumberOfPoints()):
                more.SetValue(i, "a" if isinstance(more, vtkStringArray) else i % 2)
            image.GetPointData().AddArray(more)
        if one.chance(0.3):
            field = numpy_support.numpy_to_vtk(one.random.normal(size=int(one.random.integers(1, 2000))), deep=True)
            field.SetName("TimeValue")
            image.GetFieldData().AddArray(field)
        return image


def _turn(one):
    """Directions of the axes, in columns: turned around, exchanged, or any rotation."""
    way = one.pick("flips", "exchange", "any")
    if way == "flips":
        return np.diag([one.pick(-1.0, 1.0) for _ in range(3)])
    if way == "exchange":
        return np.eye(3)[one.random.permutation(3)]
    turn, _ = np.linalg.qr(one.random.normal(size=(3, 3)))
    return turn


def placed(image, cells, values):
    """compare.Expected of an array by VTK's image: origin + direction * spacing * index, centres of cells."""
    spacing, turn = np.array(image.GetSpacing()), np.eye(3)
    if hasattr(image, "GetDirectionMatrix"):
        matrix = image.GetDirectionMatrix()
        turn = np.array([[matrix.GetElement(r, c) for c in range(3)] for r in range(3)])
    extent = image.GetExtent()
    low = np.array([extent[2 * a] + (0.5 if cells and extent[2 * a + 1] > extent[2 * a] else 0) for a in range(3)])
    steps = turn * spacing  # columns
    origin = np.array(image.GetOrigin()) + steps @ low
    signs = np.sign(np.diag(turn))
    along = np.allclose(np.abs(turn), np.eye(3), atol=1e-9)
    far = 0.0
    if not along:  # a turn of less than a tenth of a voxel counts as none
        cells_along = np.maximum(np.array(values.shape[::-1]) - 1, 1)
        straight = np.diag(np.copysign(spacing, signs))
        far = (np.abs(steps - straight) * cells_along).sum(axis=1) / spacing
        along = bool((far < 0.1).all())
    if along:
        for a in range(3):
            if turn[a, a] < 0:
                values = np.flip(values, 2 - a)
                origin[a] -= spacing[a] * (values.shape[2 - a] - 1)
        direction = np.eye(3)
    else:
        direction = turn.T.copy()  # a row for each axis
        if np.linalg.det(turn) < 0:
            origin = origin + steps[:, 0] * (values.shape[2] - 1)
            values = np.flip(values, 2)
            direction[0] *= -1
    return compare.Expected(values=values, spacing=tuple(spacing), origin=tuple(origin), direction=tuple(direction.ravel()),
                            single=values.dtype == np.float32)


def _check(one, path, reader, image, exact=True):
    """Chooses an array, lets VTK read it, and compares."""
    reader.SetFileName(str(path))
    reader.Update()
    read = reader.GetOutput()
    name, cells, values = image.arrays[int(one.random.integers(len(image.arrays)))]
    array = (read.GetCellData() if cells else read.GetPointData()).GetArray(name)
    if array is None:
        return attack.wrong(f"the judges differ: VTK finds no {name}")
    found = numpy_support.vtk_to_numpy(array).reshape(values.shape)
    if exact and not np.array_equal(found, values, equal_nan=True):
        return attack.wrong("the judges differ: VTK reads other numbers than were written")
    parts = values.shape[-1]
    options = {"dataset": name}
    if parts > 1:
        options["index"] = {"c": int(one.random.integers(parts))}
        found = found[..., options["index"]["c"]]
    else:
        found = found[..., 0]
    expected = placed(read, cells, found)
    if found.dtype.itemsize == 8 and found.dtype.kind in "iu" and np.abs(found.astype("f8")).max() > compare.MOST_EXACT:
        expected.refusals += ("beyond 2\\^53",)
    if sum(n == 0 for n in found.shape):
        expected.refusals += (".",)
    return expected, options, found


def legacy(one):
    """VTK's own writers, or lines in other cases, orders and places."""
    image = Image(one, extents=False)
    # VTK's writer encodes names of colours twice, so that its reader finds others.
    image.arrays = [("colours" + str(i) if values.dtype == np.uint8 else name, cells, values)
                    for i, (name, cells, values) in enumerate(image.arrays)]
    path = one.folder / "v.vtk"
    if one.chance(0.35):
        return _legacy_by_hand(one, path, image)
    made = image.vtk(one)
    writer = one.pick(vtkStructuredPointsWriter, vtkDataSetWriter)()
    writer.SetInputData(made)
    writer.SetFileName(str(path))
    text = one.chance(0.3)
    (writer.SetFileTypeToASCII if text else writer.SetFileTypeToBinary)()
    writer.SetFileVersion(one.pick(42, 51))
    writer.SetHeader(one.pick("vtk output", "", "binary", "ASCII art of a head", "Binary volume"))
    writer.Write()
    checked = _check(one, path, one.pick(vtkStructuredPointsReader, vtkDataSetReader)(), image, exact=not text)
    if not isinstance(checked, tuple):
        return checked
    expected, options, _ = checked
    if text:
        expected.refusals += ("text of colours",)
    return compare.differs(one, path, expected, **options)


def _legacy_by_hand(one, path, image):
    text = one.chance(0.5)
    end = one.pick("\n", "\n", " \n") if not text else one.pick("\n", "\r\n", " \n")
    case = one.pick(str, str, str.lower)
    z, y, x = image.nodes
    lines = ["# vtk DataFile Version " + one.pick("1.0", "2.0", "3.0", "4.2"), one.pick("volume", "", "Binary data of 1998", "ascii"),
             case("ASCII" if text else "BINARY"), case("DATASET") + " STRUCTURED_POINTS"]
    geometry = [f"{case('DIMENSIONS')} {x} {y} {z}", f"{case('ORIGIN')} {' '.join(map(repr, image.origin))}",
                case(one.pick("SPACING", "ASPECT_RATIO")) + " " + " ".join(map(repr, image.spacing))]
    lines += [geometry[i] for i in one.random.permutation(3)]
    name, cells, values = image.arrays[0]
    name = re.sub(r"[^a-z]", "_", name.lower())
    image.arrays = [(name, cells, values)]
    data = values.reshape(-1, values.shape[-1])
    kind = LEGACY_TYPES[values.dtype.str[1:]]
    if text and kind.startswith("vtktype"):
        kind = {"vtktypeint64": "long", "vtktypeuint64": "unsigned_long"}[kind]
    lines.append(f"{case('CELL_DATA' if cells else 'POINT_DATA')} {len(data)}")
    if data.shape[1] <= 4 and one.chance(0.6):
        parts = f" {data.shape[1]}" if data.shape[1] > 1 or one.chance(0.5) else ""
        lines += [f"{case('SCALARS')} {name} {kind}{parts}", case("LOOKUP_TABLE") + " default"]
    else:
        lines += [f"{case('FIELD')} FieldData 1", f"{name} {data.shape[1]} {len(data)} {kind}"]
    head = end.join(lines) + end
    if text:
        blank = one.pick(" ", "  ", "\n", "\t", end)
        body = blank.join(repr(v.item()) for v in data.ravel()) + one.pick("\n", "", end)
        path.write_bytes((head + body).encode())
    else:
        path.write_bytes(head.encode() + data.astype(data.dtype.newbyteorder(">")).tobytes() + one.pick(b"\n", b""))
    checked = _check(one, path, vtkDataSetReader(), image, exact=not text or data.dtype.kind != "f")
    if not isinstance(checked, tuple):
        return checked
    expected, options, _ = checked
    return compare.differs(one, path, expected, **options)


def xml(one):
    """VTK's own writer, or XML in other orders, quotes and encodings."""
    image = Image(one, turned=True)
    path = one.folder / "v.vti"
    if one.chance(0.35):
        return _xml_by_hand(one, path, image)
    writer = vtkXMLImageDataWriter()
    writer.SetInputData(image.vtk(one))
    writer.SetFileName(str(path))
    text = one.chance(0.2)
    (writer.SetDataModeToAscii if text else one.pick(writer.SetDataModeToBinary, writer.SetDataModeToAppended))()
    writer.SetEncodeAppendedData(one.chance(0.5))
    packing = one.pick("none", "zlib", "lz4", "lz4", "lzma")
    {"none": writer.SetCompressorTypeToNone, "zlib": writer.SetCompressorTypeToZLib, "lz4": writer.SetCompressorTypeToLZ4,
     "lzma": writer.SetCompressorTypeToLZMA}[packing]()
    one.pick(writer.SetByteOrderToBigEndian, writer.SetByteOrderToLittleEndian)()
    one.pick(writer.SetHeaderTypeToUInt64, writer.SetHeaderTypeToUInt32)()
    writer.SetBlockSize(one.pick(8, 64, 128, 1024, 4096, 32768))
    pieces = one.pick(1, 1, 2, 3, 5, 8)
    writer.SetNumberOfPieces(pieces)
    writer.Write()
    checked = _check(one, path, vtkXMLImageDataReader(), image, exact=not text)
    if not isinstance(checked, tuple):
        return checked
    expected, options, found = checked
    expected.may_be_turned = True
    if packing == "lzma":
        options["memory"] = "1G"  # 80 MiB are set aside for its dictionary
    return compare.differs(one, path, expected, **options)


def _packed(one, data, header, mode):
    """Bytes of an array with their header, packed by blocks or not."""
    if mode == "zlib":
        size = one.pick(16, 96, 1024, 1 << 20)
        blocks = [data[i:i + size] for i in range(0, len(data), size)]
        packed = [zlib.compress(block, one.pick(0, 1, 9)) for block in blocks]
        head = struct.pack(header[0] + header[1] * (3 + len(packed)), len(packed), size, len(data) % size, *map(len, packed))
        return head, b"".join(packed)
    return struct.pack(header[0] + header[1], len(data)), data


def _xml_by_hand(one, path, image):
    order = one.pick("<", "<", ">")
    wide = one.chance(0.5)
    mode = one.pick("none", "zlib")
    quote = one.pick('"', "'")
    said = {"type": "ImageData", "version": one.pick("0.1", "1.0"), "byte_order": "LittleEndian" if order == "<" else "BigEndian"}
    if wide or one.chance(0.5):
        said["header_type"] = "UInt64" if wide else "UInt32"
        said["version"] = "1.0"
    if mode == "zlib":
        said["compressor"] = "vtkZLibDataCompressor"

    def tag(name, attributes):
        items = [f"{k}={quote}{_escaped(str(v), quote)}{quote}" for k, v in attributes.items()]
        items = [items[i] for i in one.random.permutation(len(items))]
        return f"<{name}" + "".join(one.pick(" ", " ", "\n   ") + item for item in items) + ">"
    extent = " ".join(map(str, image.extent))
    place = {"WholeExtent": extent, "Origin": " ".join(map(repr, image.origin)), "Spacing": " ".join(map(repr, image.spacing))}
    if not np.array_equal(image.direction, np.eye(3)) or one.chance(0.3):
        place["Direction"] = " ".join(repr(float(d)) for d in image.direction.ravel())
    encoding = one.pick("raw", "base64")
    parts, appended = {False: "", True: ""}, b""
    arrays = []
    if one.chance(0.3):  # which VTK's own writer writes as it is
        image.arrays[0] = ("x<y&z", *image.arrays[0][1:])
    for name, cells, values in image.arrays:
        flat = values.astype(values.dtype.newbyteorder(order)).tobytes()
        attributes = {"type": XML_TYPES[values.dtype.str[1:]], "Name": name, "format": one.pick("appended", "binary", "ascii")}
        if values.shape[-1] > 1 or one.chance(0.5):
            attributes["NumberOfComponents"] = values.shape[-1]
        if attributes["format"] == "ascii":
            body = one.pick(" ", "\n", "\n  ").join(repr(v.item()) for v in values.ravel())
            body = one.pick("", "\n   ", " ") + body + one.pick("", "\n", " ")
        elif attributes["format"] == "binary":
            head, data = _packed(one, flat, (order, "Q" if wide else "I"), mode)
            body = (base64.b64encode(head) + base64.b64encode(data) if mode == "zlib" else base64.b64encode(head + data)).decode()
            body = one.pick("", "\n   ") + body + one.pick("", "\n")
        else:
            head, data = _packed(one, flat, (order, "Q" if wide else "I"), mode)
            attributes["offset"] = len(appended)
            if encoding == "raw":
                appended += head + data
            else:
                appended += base64.b64encode(head) + base64.b64encode(data) if mode == "zlib" else base64.b64encode(head + data)
            body = one.pick("", "\n")
        arrays.append(attributes)
        parts[cells] += tag("DataArray", attributes) + body + "</DataArray>\n"
    comment = one.pick("", "<!-- AppendedData <DataArray> -->\n")
    text = one.pick('<?xml version="1.0"?>\n', "") + tag("VTKFile", said) + "\n" + comment + tag("ImageData", place) + "\n"
    text += tag("Piece", {"Extent": extent}) + "\n"
    sections = [f"<PointData>\n{parts[False]}</PointData>\n", f"<CellData>\n{parts[True]}</CellData>\n"]
    text += "".join(sections[i] for i in one.random.permutation(2)) + "</Piece>\n</ImageData>\n"
    data = text.encode()
    if appended or one.chance(0.2):
        data += f'<AppendedData encoding="{encoding}">'.encode() + one.pick(b"", b"\n  ") + b"_" + appended + b"\n</AppendedData>\n"
    path.write_bytes(data + b"</VTKFile>\n")
    checked = _check(one, path, vtkXMLImageDataReader(), image)
    if not isinstance(checked, tuple):
        return checked
    expected, options, _ = checked
    expected.may_be_turned = True
    return compare.differs(one, path, expected, **options)


def _escaped(text, quote):
    text = text.replace("&", "&amp;").replace("<", "&lt;")
    return text.replace('"', "&quot;") if quote == '"' else text.replace("'", "&apos;")
