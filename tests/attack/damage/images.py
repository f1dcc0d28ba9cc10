"""VTK's formats, TIFF, NetCDF, HDF5 and OpenVDB: good files, damage specific to them, independent readers."""
import dataclasses
import re
import struct

import h5py
import netCDF4
import numpy as np
import tifffile
import vtk
from vtk.util import numpy_support

from damage.arrays import saved, values
from damage.case import LINK, FIFO, FOLDER, Case, astray


# VTK

def vtk_image(array):
    image = vtk.vtkImageData()
    image.SetDimensions(*array.shape[::-1])
    flat = numpy_support.numpy_to_vtk(array.ravel(), deep=True)
    flat.SetName("v")
    image.GetPointData().SetScalars(flat)
    image.SetSpacing(1, 2, 3)
    return image


def written_by(writer, name, array):
    """The bytes of the file that one of VTK's writers writes for an array."""
    writer.SetInputData(vtk_image(array))

    def write(path):
        writer.SetFileName(str(path))
        writer.Write()
    return saved(name, write)


def read_vtk(reader):
    def read(path):
        one, said = reader(), []
        for event in ("ErrorEvent", "WarningEvent"):
            one.AddObserver(event, lambda *_: said.append(True))
        one.SetFileName(str(path))
        one.Update()
        image = one.GetOutput()
        array = numpy_support.vtk_to_numpy(image.GetPointData().GetArray(0))
        if one.GetErrorCode() or said or array.ndim > 1:
            raise ValueError
        return array.reshape(image.GetDimensions()[::-1])
    return read


def vti(r):
    array = values(r)
    writer = vtk.vtkXMLImageDataWriter()
    way = int(r.integers(5))
    if way == 0:
        writer.SetDataModeToAscii()
    elif way == 1:
        writer.SetDataModeToBinary()
    else:
        writer.SetDataModeToAppended()
        writer.SetEncodeAppendedData(way == 2)
    if r.random() < 0.5:
        writer.SetCompressorTypeToNone()
    if r.random() < 0.3:
        writer.SetByteOrderToBigEndian()
    if r.random() < 0.5:
        writer.SetHeaderTypeToUInt64()
    data = written_by(writer, "v.vti", array)
    end = data.find(b"<AppendedData")
    at = data.find(b"_", end)
    fields = tuple((at + 1 + 4 * i, "<u4") for i in range(4)) if end >= 0 and way > 2 else ()
    return Case("v.vti", {"v.vti": data}, fields=fields, texts=((0, end if end >= 0 else len(data)),), values=array,
                close=True, read=read_vtk(vtk.vtkXMLImageDataReader), apart=True)


LAUGHS = b'<!DOCTYPE x [<!ENTITY a0 "0 0 0 0">' + b"".join(b'<!ENTITY a%d "%s">' % (i, b"&a%d;" % (i - 1) * 12) for i in range(1, 11)) + b"]>"


def xml_tricks(case, one):
    """XML that expands, nests deeply, or names other files."""
    data = case.data
    what = int(one.random.integers(7))
    head = b'<?xml version="1.0"?>\n'
    if data.startswith(b"<?xml"):
        head, data = data[:data.index(b"\n") + 1], data[data.index(b"\n") + 1:]
    root = re.match(rb"\s*<[^>]*>", data)
    inside = root.end() if root else 0
    if what == 0:
        data = LAUGHS + data[:inside] + b"<a>&a10;</a>" + data[inside:]
    elif what == 1:
        data = LAUGHS + data.replace(b'Origin="', b'Origin="&a10;')
    elif what == 2:
        data = b'<!DOCTYPE x [<!ENTITY e SYSTEM "file:///etc/passwd">]>' + data[:inside] + b"<a>&e;</a>" + data[inside:]
    elif what == 3:
        data = data[:inside] + one.pick(b"<a>", b"<a>", b"<a b='", b"<!--", b"<![CDATA[", b"&") * one.pick(100000, 1000000) + data[inside:]
    elif what == 4:
        data = data.replace(b"<", b"<" + b"n" * (1 << 20), 1)
    elif what == 5:
        data = data[:inside] + b" " * (6 << 20) + data[inside:]
    else:
        data = b'<!DOCTYPE x [<!ENTITY % p SYSTEM "../../outside/secret.raw"> %p; <!ENTITY a "&a;">]>' + data[:inside] + b"&a;" + data[inside:]
    return case.with_data(head + data, fields=(), texts=(), values=None, read=None)


def vtk_legacy(r):
    array = values(r)
    writer = vtk.vtkStructuredPointsWriter()
    text = r.random() < 0.4
    (writer.SetFileTypeToASCII if text else writer.SetFileTypeToBinary)()
    data = written_by(writer, "v.vtk", array)
    end = data.find(b"LOOKUP_TABLE")
    end = data.index(b"\n", end) + 1
    return Case("v.vtk", {"v.vtk": data}, texts=((0, end), (0, len(data) if text else end)),
                values=None if text else array, close=text,  # a text may end within its last number
                read=read_vtk(vtk.vtkStructuredPointsReader), apart=True)


def vtk_tricks(case, one):
    data = case.data
    line = one.pick(b"FIELD f 2000000000\n", b"FIELD f 1\na 3 1000000000000 float\n", b"METADATA\nINFORMATION 100000000\n", b"x" * (6 << 20) + b"\n",
                    b"DIMENSIONS 1048576 1048576 1048576\n", b"SPACING 0 0 0\n", b"SPACING 1e999 1 1\n", b"SCALARS v float 1000000000\n", b"POINT_DATA -1\n",
                    b"FIELD f 1\n" * 100000, b"LOOKUP_TABLE t 1000000000\n")
    at = data.find(one.pick(b"DATASET", b"POINT_DATA", b"LOOKUP_TABLE", b"FIELD"))
    return case.with_data(data[:at] + line + data[at:], texts=(), values=None, read=None)


# TIFF

def tiff_fields(data):
    """The numbers in the directories, and the offsets of the next directories."""
    order = ">" if data[:2] == b"MM" else "<"
    big = data[2:4] in (b"+\0", b"\0+")
    number, entry, count, width = (order + "u8", 20, order + "u8", 8) if big else (order + "u4", 12, order + "u2", 2)
    fields = [(2, order + "u2"), (8 if big else 4, number)]
    next_at, loops = (8 if big else 4), []
    for _ in range(20):
        at = int(np.frombuffer(data, number, 1, next_at)[0])
        if at == 0 or at + width > len(data):
            break
        entries = int(np.frombuffer(data, count, 1, at)[0])
        fields.append((at, count))
        for i in range(entries):
            place = at + width + entry * i
            fields += [(place, order + "u2"), (place + 2, order + "u2"), (place + 4, number), (place + (12 if big else 8), number)]
            fields += [(place + (12 if big else 8), order + "u2")]
        next_at = at + width + entry * entries
        fields.append((next_at, number))
        loops.append((at, next_at, number))
    return tuple(fields), loops


def read_tiff(path):
    with tifffile.TiffFile(path) as file:
        # tifffile reads a part of 0 bytes as zeros; libtiff computes its length.
        if len(file.series) != 1 or any(0 in page.databytecounts for page in file.pages):
            raise ValueError
        return file.asarray()


def tiff(r):
    array = values(r, ("u1", "u1", "u2", "u2", "i2", "u4", "f4", "f8"))
    array = np.repeat(np.repeat(array, 3, axis=1), 4, axis=2)
    way = int(r.integers(7))
    more = [{}, {"rowsperstrip": 5}, {"tile": (16, 16)}, {"compression": "zlib"}, {"compression": "zlib", "tile": (16, 16)},
            {"imagej": True}, {"ome": True}][way]
    if array.dtype.kind in "ui" and way in (3, 4) and r.random() < 0.5:
        more["predictor"] = 2
    if way == 5:
        array = array.astype("u2")
    elif r.random() < 0.3:
        more["byteorder"] = ">"
    if way != 5 and r.random() < 0.3:
        more["bigtiff"] = True
    if way not in (5, 6):
        more["metadata"] = None
    data = saved("v.tif", lambda path: tifffile.imwrite(path, array, photometric="minisblack", **more))
    fields, _ = tiff_fields(data)
    texts = []
    for word in (b"ImageJ=", b"<?xml"):
        at = data.find(word)
        if at >= 0:
            texts.append((at, data.index(b"\0", at)))
    return Case("v.tif", {"v.tif": data}, fields=fields, texts=tuple(texts), values=array, read=read_tiff if way not in (5, 6) else None)


def tiff_tricks(case, one):
    data = bytearray(case.data)
    _, loops = tiff_fields(bytes(data))
    what = int(one.random.integers(6))
    if what <= 1 and loops:
        at, next_at, number = loops[int(one.random.integers(len(loops)))]
        number = np.dtype(number)
        to = one.pick(*[loop[0] for loop in loops], at, next_at, 0xFFFFFFF0, 1, 8)
        data[next_at:next_at + number.itemsize] = int(to).to_bytes(number.itemsize, "big" if number.byteorder == ">" else "little")
        return case.with_data(data, values=None)
    if what == 2 and case.texts:
        start, end = case.texts[0]
        old = bytes(data[start:end])
        new = one.pick(old.replace(b"images=", b"images=1000000000\nx="), old.replace(b"slices=", b"slices=1000000000\nx="), b"ImageJ=1\nimages=-1\nslices=-1\n",
                       b"ImageJ=1\n" + b"=" * len(old), LAUGHS + b"<OME>&a10;</OME>", b"<OME>" * (len(old) // 5), b"<?xml" + b"<" * len(old),
                       re.sub(rb'SizeZ="\d+"', b'SizeZ="1000000000"', old), re.sub(rb'PhysicalSizeX="[^"]*"', b'PhysicalSizeX="1e999"', old),
                       b"<?xml version='1.0'?><!DOCTYPE OME [<!ENTITY e SYSTEM '/etc/passwd'>]><OME>&e;</OME>")
        data[start:end] = new[:end - start].ljust(end - start, b" ")
        return case.with_data(data, values=None, read=None)
    if what == 3:  # many directories of one entry each
        many = one.pick(1000, 60000)
        head = b"II*\0" + struct.pack("<I", 8)
        body = b"".join(struct.pack("<HHHIII", 1, 256, 4, 1, 5, 8 + 18 * (i + 1) if i < many - 1 else 0) for i in range(many))
        return case.with_data(head + body, values=None, fields=(), texts=())
    if what == 4:  # a folder of slices with links, FIFOs and folders among them
        name = case.name
        return dataclasses.replace(case, name="slices", target=f"slices/a{name}", fields=(), texts=(), values=None, read=None, files={
            f"slices/a{name}": bytes(data), f"slices/b{name}": one.pick((FIFO,), (LINK, "/dev/zero"), (LINK, f"b{name}"), (FOLDER,), (LINK, "."),
                                                                       (LINK, "../../../outside/secret.raw"), b"", bytes(data))})
    # one page of a huge size whose strips all have the same bytes
    side = one.pick(60000, 1 << 20, 0xFFFFFFFF)
    tags = [(256, 4, 1, side), (257, 4, 1, side), (258, 3, 1, 8), (259, 3, 1, one.pick(1, 8, 5, 32773)), (262, 3, 1, 1), (273, 4, 1, 8), (277, 3, 1, 1),
            (278, 4, 1, side), (279, 4, 1, 100)]
    page = struct.pack("<H", len(tags)) + b"".join(struct.pack("<HHII", *tag) for tag in tags) + bytes(4)
    return case.with_data(b"II*\0" + struct.pack("<I", 8) + page, values=None, fields=(), texts=(), read=None)


# NetCDF

def read_netcdf(path):
    with netCDF4.Dataset(path) as file:
        file.set_auto_maskandscale(False)
        return file["v"][:]


def write_netcdf(path, array, kind, unlimited):
    with netCDF4.Dataset(path, "w", format=kind) as file:
        for dim, length in zip("zyx", array.shape):
            file.createDimension(dim, None if unlimited and dim == "z" else length)
        x = file.createVariable("x", "f8", ("x",))
        x[:], x.units = np.arange(array.shape[2]) * 0.5, "mm"
        file.createVariable("v", array.dtype, tuple("zyx"))[:] = array
        file["v"].long_name = "temperature"


def netcdf3(r):
    kind = str(r.choice(["NETCDF3_CLASSIC", "NETCDF3_64BIT_OFFSET", "NETCDF3_64BIT_DATA"]))
    array = values(r, ("i1", "i2", "i4", "f4", "f8"))
    unlimited = r.random() < 0.5
    data = saved("v.nc", lambda path: write_netcdf(path, array, kind, unlimited))
    end = min(len(data), 400)
    fields = tuple((at, ">i4") for at in range(4, end - 4, 4))
    return Case("v.nc", {"v.nc": data}, fields=fields, values=array, read=read_netcdf, apart=True)


def netcdf_tricks(case, one):
    data = bytearray(case.data)
    if one.chance(0.1):  # an impossibly large number of items
        tag, item = one.pick((10, struct.pack(">ii", 0, 1)), (12, struct.pack(">iii", 0, 1, 0)), (12, struct.pack(">iii", 0, 1, 1024) + bytes(1024)))
        count = one.pick(1000, 150000, 900000) * 12 // len(item)
        lists = struct.pack(">ii", tag, count) + item * count
        return case.with_data(b"CDF\1" + bytes(4) + (lists if tag == 10 else bytes(8) + lists) + bytes(16), values=None, fields=())
    for word in (b"\0\0\0\x0a", b"\0\0\0\x0b", b"\0\0\0\x0c"):  # the lists of dimensions, variables and attributes
        at = data.find(word)
        if at >= 0 and one.chance(0.5):
            struct.pack_into(">i", data, at + 4, one.pick(-1, 0, 1 << 30, 0x7FFFFFFF, 1000, 65536))
    if one.chance(0.5):
        for word in (b"temperature", b"mm\0\0", b"long_name"):
            at = data.find(word)
            if at >= 4:
                struct.pack_into(">i", data, at - 4, one.pick(-1, 0, 1 << 30, 0x7FFFFFFF, 1 << 16, 3))
    return case.with_data(data)


# formats that libraries read, for which isonest promises less

def netcdf4(r):
    array = values(r)
    unlimited = r.random() < 0.5
    data = saved("v.nc", lambda path: write_netcdf(path, array, "NETCDF4", unlimited))
    return Case("v.nc", {"v.nc": data}, values=array)


def hdf5(r):
    array = values(r)
    chunked, newest = r.random() < 0.5, r.random() < 0.4

    def write(path):
        with h5py.File(path, "w", libver="latest" if newest else "earliest") as file:
            more = {"chunks": tuple(-(-n // 2) for n in array.shape), "compression": "gzip"} if chunked else {}
            v = file.create_dataset("a/v", data=array, **more)
            v.attrs["element_size_um"] = [1, 2, 3]
    data = saved("v.h5", write)
    return Case("v.h5", {"v.h5": data}, values=array, options=("--dataset", "/a/v") if r.random() < 0.3 else ())


def hdf5_tricks(case, one):
    """Links, external storage and virtual datasets that point elsewhere, loops of links, huge datasets, deep groups."""
    case, place = astray(case, one)
    place = place.replace("\0", "")
    what = int(one.random.integers(7))
    size = (4, 5, 6)

    def write(path):
        with h5py.File(path, "w", libver=one.pick("latest", "earliest")) as file:
            if what == 0:
                file["v"] = h5py.ExternalLink(place or "x", "/v")
            elif what == 1:
                file.create_dataset("v", size, "u1", external=[(place or "x", one.pick(0, 1 << 40), h5py.h5f.UNLIMITED)])
            elif what == 2:
                layout = h5py.VirtualLayout(size, "u1")
                layout[...] = h5py.VirtualSource(place or ".", "v", size)
                file.create_virtual_dataset("v", layout)
            elif what == 3:
                file["v"], file["w"] = h5py.SoftLink("/w"), h5py.SoftLink("/v")
                file["a"] = file["/"]
            elif what == 4:
                file.create_dataset("v", (1 << 20, 1 << 20, 1 << 20), "f8", chunks=(1, 1 << 14, 1 << 14))
            elif what == 5:
                group = file
                for _ in range(one.pick(50, 200)):
                    group = group.create_group("g")
                group.create_dataset("v", size, "u1")
            else:
                for i in range(500):
                    file[f"{i}"] = h5py.ExternalLink("v.h5", f"/{i + 1}")
    data = saved("v.h5", write)
    return case.with_data(data, values=None, options=one.pick((), ("--dataset", "v")))


def openvdb(r):
    import pyopenvdb
    array = r.normal(100, 50, size=(6, 7, 8)).astype("f4")
    grid = pyopenvdb.FloatGrid(0)
    grid.copyFromArray(np.ascontiguousarray(array.T), tolerance=0)
    grid.name = "v"
    data = saved("v.vdb", lambda path: pyopenvdb.write(str(path), grids=[grid]))
    fields = tuple((at, "<u8") for at in range(20, min(len(data) - 8, 900), 4))
    return Case("v.vdb", {"v.vdb": data}, values=array, fields=fields)
