"""Reading other formats: time compared with a Python package for each, and the heap with little memory.

usage: inputs.py BUILD FOLDER [SIZE [ROUNDS]]    (512 3)

A smooth volume with some noise, SIZE^3 int16, is written to FOLDER by a Python package for each format and read by it
into an array, in a separate process, without the time of imports. isonest preprocesses the same file, and the same
numbers as .npy, which it maps; the additional time of the former is that of reading. Every round runs all of them once,
in turn; figures are medians: wall-clock seconds and, in brackets, processor seconds. The last column is the peak heap
of preprocessing with --memory of an eighth of the numbers' bytes; if it is larger, or the store has other numbers, the
program ends. BUILD is a build folder, or a new one.
"""
import os
import pathlib
import re
import resource
import shutil
import statistics
import subprocess
import sys
import time

import needs

build, folder, *rest = needs.arguments(2, __doc__, 4)
build, folder = pathlib.Path(build).resolve(), pathlib.Path(folder)
size, rounds = int(rest[0]) if rest else 512, int(rest[1]) if len(rest) > 1 else 3
isonest, helper = build / "bin/isonest", build / "tools/bench/libisonest_peak_heap.so"
needs.require(*map(needs.module, ("numpy", "h5py", "tifffile", "zarr", "numcodecs", "nibabel", "mrcfile", "netCDF4", "pydicom", "vtk")),
              needs.folder(folder))
needs.require(needs.space(folder, 16 * 2 * size**3), needs.built(build, "isonest", "isonest_peak_heap"))
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

sys.path.insert(0, str(needs.ROOT / "tests" / "support"))
from zarr_two import zarr  # noqa: E402

DICOM = "1.2.840.10008.5.1.4.1.1.2"


def dicom_slice(path, data, z):
    meta = pydicom.dataset.FileMetaDataset()
    meta.MediaStorageSOPClassUID, meta.MediaStorageSOPInstanceUID = DICOM, f"1.2.3.{z + 1}"
    meta.TransferSyntaxUID = pydicom.uid.ExplicitVRLittleEndian
    d = pydicom.dataset.FileDataset(str(path), {}, file_meta=meta, preamble=bytes(128))
    d.is_little_endian, d.is_implicit_VR = True, False
    d.SOPClassUID, d.SOPInstanceUID, d.SeriesInstanceUID, d.Modality = DICOM, f"1.2.3.{z + 1}", "1.2.3", "CT"
    d.InstanceNumber, (d.Rows, d.Columns) = z + 1, data.shape
    d.SamplesPerPixel, d.PhotometricInterpretation, d.PixelRepresentation = 1, "MONOCHROME2", 1
    d.BitsAllocated, d.BitsStored, d.HighBit = 16, 16, 15
    d.ImagePositionPatient, d.ImageOrientationPatient, d.PixelSpacing = [0, 0, z], [1, 0, 0, 0, 1, 0], [1, 1]
    d.RescaleSlope, d.RescaleIntercept = 1, 0
    d.PixelData = data.tobytes()
    d["PixelData"].VR = "OW"
    d.save_as(path, write_like_original=False)


def dicom(path, data):
    path.mkdir()
    for z, plane in enumerate(data):
        dicom_slice(path / f"{z}.dcm", plane, z)


def tiff_stack(path, data):
    path.mkdir()
    for z, plane in enumerate(data):
        tifffile.imwrite(path / f"{z}.tif", plane, compression="zlib", photometric="minisblack", metadata=None)


def netcdf(path, data):
    with netCDF4.Dataset(path, "w", format="NETCDF3_64BIT_OFFSET") as file:
        for dim, length in zip("zyx", data.shape):
            file.createDimension(dim, length)
        file.createVariable("v", "i2", tuple("zyx"))[:] = data


def hdf5(path, data):
    with h5py.File(path, "w") as file:
        file.create_dataset("v", data=data, chunks=(64, 64, 64), compression="gzip", compression_opts=1, shuffle=True)


def vti(path, data):
    image = vtk.vtkImageData()
    image.SetDimensions(*data.shape[::-1])
    image.GetPointData().SetScalars(numpy_support.numpy_to_vtk(data.reshape(-1)))
    writer = vtk.vtkXMLImageDataWriter()
    writer.SetInputData(image)
    writer.SetFileName(str(path))
    writer.SetEncodeAppendedData(0)
    writer.Write()


READ_VTK = """reader = vtk.vtkXMLImageDataReader(); reader.SetFileName(p); reader.Update()
a = numpy_support.vtk_to_numpy(reader.GetOutput().GetPointData().GetScalars())"""
# Name, file, how it is written, with what it is read, how.
FORMATS = [
    ("TIFF, a file for each slice, deflate", "stack", tiff_stack, "import tifffile, glob, os",
     "a = tifffile.imread(sorted(glob.glob(p + '/*.tif'), key=lambda n: int(os.path.basename(n)[:-4])))", "tifffile"),
    ("TIFF, one file, as it is", "v.tif", lambda p, d: tifffile.imwrite(p, d, photometric="minisblack", metadata=None),
     "import tifffile", "a = tifffile.imread(p)", "tifffile"),
    ("Zarr, blosc (LZ4)", "v.zarr", lambda p, d: zarr.save_array(str(p), d, chunks=(64, 64, 64), compressor=numcodecs.Blosc("lz4")),
     "import zarr", "a = zarr.open(p, mode='r')[...]", "zarr"),
    ("DICOM, a file for each slice", "dicom", dicom, "import pydicom, glob, numpy",
     "a = numpy.stack([d.pixel_array for d in sorted(map(pydicom.dcmread, glob.glob(p + '/*')), "
     "key=lambda d: d.ImagePositionPatient[2])])", "pydicom"),
    ("NIfTI, gzip", "v.nii.gz", lambda p, d: nibabel.save(nibabel.Nifti1Image(d.T, np.eye(4)), p), "import nibabel, numpy",
     "a = numpy.asanyarray(nibabel.load(p).dataobj)", "nibabel"),
    ("MRC, as it is", "v.mrc", lambda p, d: mrcfile.new(p, d).close(), "import mrcfile", "a = mrcfile.read(p)", "mrcfile"),
    ("VTI, zlib", "v.vti", vti, "import vtk\nfrom vtk.util import numpy_support", READ_VTK, "VTK"),
    ("HDF5, shuffle and gzip", "v.h5", hdf5, "import h5py", "a = h5py.File(p, 'r')['v'][...]", "h5py"),
    ("NetCDF-3", "v.nc", netcdf, "import netCDF4", "f = netCDF4.Dataset(p); a = f['v'][...]", "netCDF4"),
]
READER = """import sys, time
{imports}
p = sys.argv[1]
start, cpu = time.perf_counter(), time.process_time()
{read}
print(time.perf_counter() - start, time.process_time() - cpu, a.size)"""


def by_python(path, imports, read):
    """Wall-clock and processor seconds."""
    done = subprocess.run([sys.executable, "-c", READER.format(imports=imports, read=read), path], check=True,
                          capture_output=True, text=True).stdout.split()
    assert int(done[2]) == size**3
    return float(done[0]), float(done[1])


def by_isonest(path):
    before, start = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
    subprocess.run([isonest, "preprocess", path, "-o", folder / "s.isonest", "--force", "-q"], check=True)
    seconds, after = time.perf_counter() - start, resource.getrusage(resource.RUSAGE_CHILDREN)
    return seconds, after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def heap_of(path, expected):
    """Peak heap of preprocessing within an eighth of the numbers' bytes."""
    budget = 2 * size**3 // 8
    store = folder / "s.isonest"
    done = subprocess.run([isonest, "preprocess", path, "-o", store, "--force", "-q", "--memory", str(budget), "--chunk",
                           "16"], env=dict(os.environ, LD_PRELOAD=str(helper)), capture_output=True, text=True)
    if done.returncode != 0:
        sys.exit(f"{path}: {done.stderr}")
    heap = int(re.search(r"peak heap (\d+) bytes", done.stderr)[1])
    if heap > budget:
        sys.exit(f"{path}: {heap:,} bytes of heap with --memory {budget}")
    subprocess.run([isonest, "export", store, "--field", "values", "-o", folder / "s.raw", "--force", "-q"], check=True)
    if not np.array_equal(np.memmap(folder / "s.raw", expected.dtype, "r"), expected.reshape(-1)):
        sys.exit(f"{path}: other numbers")
    return heap / (1 << 20)


x = np.arange(size, dtype=np.float32) * np.float32(20 / size)
volume = np.empty((size,) * 3, "i2")
random = np.random.default_rng(1)
for z in range(size):
    volume[z] = 1000 * (np.sin(x)[None, :] * np.cos(x)[:, None] + np.sin(x[z])) + random.normal(0, 3, (size, size))
np.save(folder / "v.npy", volume)
for _, name, write, *_ in FORMATS:
    path = folder / name
    if path.is_dir():
        shutil.rmtree(path)
    path.unlink(missing_ok=True)
    write(path, volume)

times = {name: ([], []) for _, name, *_ in FORMATS}
plain = []
for _ in range(rounds):
    plain.append(by_isonest(folder / "v.npy"))
    for _, name, _, imports, read, _ in FORMATS:
        times[name][0].append(by_python(folder / name, imports, read))
        times[name][1].append(by_isonest(folder / name))


def median(list_of_pairs):
    return [statistics.median(pair[i] for pair in list_of_pairs) for i in (0, 1)]


base = median(plain)
print(f"{size}^3 int16, {2 * size**3 / 1e6:.0f} MB; preprocess from .npy {base[0]:.2f} s ({base[1]:.2f} s)\n")
print("| format | read by | seconds | `preprocess` | beyond that from `.npy` | heap, `--memory "
      f"{2 * size**3 / 8 / (1 << 20):.4g}M` |\n|---|---|---|---|---|---|")
for title, name, _, _, _, package in FORMATS:
    python, ours = map(median, times[name])
    heap = heap_of(folder / name, volume)
    print(f"| {title} | {package} | {python[0]:.2f} ({python[1]:.2f}) | {ours[0]:.2f} ({ours[1]:.2f}) | "
          f"{ours[0] - base[0]:.2f} ({ours[1] - base[1]:.2f}) | {heap:.1f} MiB |", flush=True)
