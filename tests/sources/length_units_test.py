#!/usr/bin/env python3
"""The unit of length: as each format's own package writes it, from the store to reports, distances and meshes.

usage: length_units_test.py ISONEST PLUGIN_FOLDER
"""
import json
import pathlib
import re
import struct
import sys
import unittest
import warnings
import xml.etree.ElementTree
import zipfile

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1] / "support"))
import served  # noqa: E402

try:
    import h5py
    import mrcfile
    import netCDF4
    import nibabel
    import numpy as np
    import pydicom
    import tifffile
    import vtk
    from pydicom.dataset import FileDataset, FileMetaDataset
    from pydicom.uid import CTImageStorage, ExplicitVRLittleEndian, generate_uid
    from zarr_two import zarr
    from volume_inputs import ISONEST, Input, numbers
except ImportError as error:
    print(f"skipped: {error}")
    sys.exit(77)

warnings.filterwarnings("ignore")
DATA = numbers((4, 5, 6))  # [z, y, x]
# In metres, by the SI and the international yard, not by the program's own table.
METRES = {"km": 1e3, "m": 1.0, "dm": 1e-1, "cm": 1e-2, "mm": 1e-3, "um": 1e-6, "nm": 1e-9, "angstrom": 1e-10,
          "pm": 1e-12, "ft": 0.3048, "in": 0.0254}


class Units(Input):
    def says(self, unit, *options, spacing=None, origin=None, note=None):
        """Checks the unit of the store, and that a note has these words, or that there is no note about units."""
        done = self.preprocess("--json", *options)
        self.assertEqual(done.returncode, 0, done.stderr)
        report = json.loads(done.stdout)
        self.assertEqual(report["unit"], unit)
        about = [n for n in report["notes"] if "unit" in n]
        if note is None:
            self.assertEqual(about, [])
        else:
            self.assertEqual(len(about), 1)
            for word in note:
                self.assertIn(word, about[0])
        info = self.info()
        self.assertEqual(info["unit"], unit)
        if spacing is not None:
            np.testing.assert_allclose(info["spacing"], spacing, rtol=1e-14)
        if origin is not None:
            np.testing.assert_allclose(info["origin"], origin, rtol=1e-14, atol=0)

    def info(self, store="s.isonest"):
        return json.loads(served.run([ISONEST, "info", self.here / store, "--json"], check=True,
                                     capture_output=True).stdout)


class Formats(Units):
    def test_nifti(self):
        for maker in (nibabel.Nifti1Image, nibabel.Nifti2Image):
            for name, unit in (("meter", "m"), ("mm", "mm"), ("micron", "um"), ("unknown", None)):
                with self.subTest(maker=maker, name=name):
                    image = maker(DATA.T, np.diag([1, 2, 3, 1]))
                    image.header.set_xyzt_units(name, "sec")
                    self.path = self.here / "v.nii"
                    nibabel.save(image, self.path)
                    self.says(unit, spacing=(1, 2, 3))

    def test_dicom_is_in_millimetres_where_it_has_a_spacing(self):
        for with_spacing in (True, False):
            self.path = self.here / f"series{with_spacing}"
            self.path.mkdir()
            for z, plane in enumerate(DATA.astype("u2")):
                meta = FileMetaDataset()
                meta.MediaStorageSOPClassUID = CTImageStorage
                meta.MediaStorageSOPInstanceUID = generate_uid()
                meta.TransferSyntaxUID = ExplicitVRLittleEndian
                d = FileDataset(str(self.path / f"{z}.dcm"), {}, file_meta=meta, preamble=b"\0" * 128)
                d.is_little_endian, d.is_implicit_VR = True, False
                d.SOPClassUID, d.SOPInstanceUID = CTImageStorage, meta.MediaStorageSOPInstanceUID
                d.SeriesInstanceUID, d.InstanceNumber = "1.2.3", z + 1
                d.Rows, d.Columns = plane.shape
                d.SamplesPerPixel, d.PhotometricInterpretation = 1, "MONOCHROME2"
                d.BitsAllocated = d.BitsStored = 16
                d.HighBit, d.PixelRepresentation = 15, 0
                if with_spacing:
                    d.ImagePositionPatient, d.ImageOrientationPatient = [0, 0, 2 * z], [1, 0, 0, 0, 1, 0]
                    d.PixelSpacing = [0.5, 0.25]
                d.PixelData = plane.tobytes()
                d["PixelData"].VR = "OW"
                d.save_as(self.path / f"{z}.dcm")
            self.says("mm" if with_spacing else None, spacing=(0.25, 0.5, 2) if with_spacing else (1, 1, 1))

    def test_ome_zarr(self):
        def image(units):
            self.path = self.here / "v.zarr"
            group = zarr.open_group(str(self.path), mode="w")
            group.create_dataset("0", data=DATA)
            axes = [{"name": n, "type": "space", **({"unit": u} if u else {})} for n, u in zip("zyx", units)]
            group.attrs["multiscales"] = [{"version": "0.4", "axes": axes, "datasets": [
                {"path": "0", "coordinateTransformations": [{"type": "scale", "scale": [3, 2, 1]},
                                                            {"type": "translation", "translation": [30, 20, 10]}]}]}]
        image(["micrometer"] * 3)
        self.says("um", spacing=(1, 2, 3), origin=(10, 20, 30))
        image(["nanometer"] * 3)
        self.says("nm")
        image([None] * 3)
        self.says(None, spacing=(1, 2, 3))
        image(["micrometer", "nanometer", "nanometer"])  # the unit of x counts
        self.says("nm", spacing=(1, 2, 3000), origin=(10, 20, 30000), note=("x: nanometer", "z: micrometer", "nm"))
        image(["nanometer", "micrometer", "micrometer"])
        self.says("um", spacing=(1, 2, 0.003), origin=(10, 20, 0.03), note=("converted to um",))
        image([None, "micrometer", "micrometer"])
        self.says(None, spacing=(1, 2, 3), note=("z: none",))
        image(["second", "micrometer", "micrometer"])
        self.says(None, spacing=(1, 2, 3), note=("z: second",))

    def test_xarrays_zarr(self):
        self.path = self.here / "v.zarr"
        group = zarr.open_group(str(self.path), mode="w")
        group.create_dataset("data", data=DATA, fill_value=None).attrs["_ARRAY_DIMENSIONS"] = ["z", "y", "x"]
        for name, length, unit in zip("zyx", DATA.shape, ("km", "m", "m")):
            axis = group.create_dataset(name, data=np.arange(length) * 2.0, fill_value=None)
            axis.attrs.update(_ARRAY_DIMENSIONS=[name], units=unit)
        self.says("m", spacing=(2, 2, 2000), note=("converted to m",))

    def test_imagej(self):
        for written, unit in (("um", "um"), ("micron", "um"), ("\\u00B5m", "um"), ("nm", "nm"),
                              ("mm", "mm"), ("inch", "in"), ("pixel", None), ("", None)):
            with self.subTest(written):
                self.path = self.here / "v.tif"
                metadata = {"spacing": 3, "axes": "ZYX", **({"unit": written} if written else {})}
                tifffile.imwrite(self.path, DATA, imagej=True, resolution=(4, 2), metadata=metadata)
                self.says(unit, spacing=(0.25, 0.5, 3))
        tifffile.imwrite(self.path, DATA, imagej=True, resolution=(4, 2),
                         metadata={"spacing": 3, "axes": "ZYX", "unit": "nm", "zunit": "um"})
        self.says("nm", spacing=(0.25, 0.5, 3000), note=("z: um",))

    def test_ome_tiff(self):
        self.path = self.here / "v.ome.tif"
        sizes = {f"PhysicalSize{a}": s for a, s in zip("XYZ", (1, 2, 3))}
        tifffile.imwrite(self.path, DATA, metadata={"axes": "ZYX", **sizes})
        self.says("um", spacing=(1, 2, 3))
        units = {f"PhysicalSize{a}Unit": "nm" for a in "XYZ"}
        tifffile.imwrite(self.path, DATA, metadata={"axes": "ZYX", **sizes, **units})
        self.says("nm")
        units["PhysicalSizeZUnit"] = "\u00b5m"
        tifffile.imwrite(self.path, DATA, metadata={"axes": "ZYX", **sizes, **units})
        self.says("nm", spacing=(1, 2, 3000), note=("converted to nm",))
        tifffile.imwrite(self.path, DATA, metadata={"axes": "ZYX"})
        self.says(None, spacing=(1, 1, 1))

    def netcdf(self, kind, units):
        self.path = self.here / "v.nc"
        with netCDF4.Dataset(self.path, "w", format=kind) as f:
            for name, length, unit in zip("zyx", DATA.shape, units):
                f.createDimension(name, length)
                axis = f.createVariable(name, "f8", (name,))
                axis[:] = np.arange(length) * 2.0 + 4
                if unit:
                    axis.units = unit
            values = f.createVariable("v", "i2", ("z", "y", "x"))
            values[:] = DATA
            values.units = "K"

    def test_netcdf(self):
        for kind in ("NETCDF3_CLASSIC", "NETCDF4"):
            with self.subTest(kind):
                self.netcdf(kind, ("m", "m", "m"))
                self.says("m", spacing=(2, 2, 2), origin=(4, 4, 4))
                self.netcdf(kind, ("kilometers", "m", "m"))
                self.says("m", spacing=(2, 2, 2000), origin=(4, 4, 4000), note=("z: kilometers",))
                self.netcdf(kind, ("m", "degrees_north", "degrees_east"))
                self.says(None, spacing=(2, 2, 2), note=("x: degrees_east", "y: degrees_north", "z: m"))
                self.netcdf(kind, (None, None, None))
                self.says(None, spacing=(2, 2, 2))

    def test_hdf5(self):
        self.path = self.here / "v.h5"
        with h5py.File(self.path, "w") as f:
            f["data"] = DATA
            f["data"].attrs["element_size_um"] = [3.0, 2.0, 1.0]  # slowest first, as Fiji writes it
        self.says("um", spacing=(1, 2, 3))
        with h5py.File(self.path, "w") as f:
            f["data"] = DATA
            f["data"].attrs["spacing"] = [1.0, 2.0, 3.0]
            f["data"].attrs["unit"] = "nanometer"
        self.says("nm", spacing=(1, 2, 3))
        with h5py.File(self.path, "w") as f:
            f["data"] = DATA
            f["data"].attrs["units"] = "m"  # the unit of the values
        self.says(None, spacing=(1, 1, 1))

    def test_mrc_is_in_angstroms_where_it_has_a_cell(self):
        self.path = self.here / "v.mrc"
        with mrcfile.new(self.path, DATA, overwrite=True) as f:
            f.voxel_size = (1.5, 2.5, 3.5)
        self.says("angstrom", spacing=np.float32([1.5, 2.5, 3.5]))
        with mrcfile.new(self.path, DATA, overwrite=True) as f:
            f.voxel_size = 0
        self.says(None, spacing=(1, 1, 1))

    def nrrd(self, *lines):
        self.path = self.here / "v.nrrd"
        sizes = " ".join(map(str, DATA.shape[::-1]))
        head = ["NRRD0004", "type: int16", "dimension: 3", f"sizes: {sizes}", "endian: little", "encoding: raw", *lines]
        self.path.write_bytes("\n".join(head).encode() + b"\n\n" + DATA.astype("<i2").tobytes())

    def test_nrrd(self):
        directions = "space directions: (1,0,0) (0,2,0) (0,0,3)", "space origin: (10,20,30)"
        self.nrrd("space dimension: 3", *directions, 'space units: "mm" "mm" "mm"')
        self.says("mm", spacing=(1, 2, 3), origin=(10, 20, 30))
        self.nrrd("space dimension: 3", *directions, 'space units: "nm" "nm" "microns"')
        self.says("nm", spacing=(1, 2, 3000), origin=(10, 20, 30000), note=("z: microns",))
        self.nrrd("space: left-posterior-superior", *directions)
        self.says(None, spacing=(1, 2, 3))
        self.nrrd("spacings: 1 2 3", 'units: "um" "um" "um"')
        self.says("um", spacing=(1, 2, 3))
        self.nrrd("axis mins: 0 0 4", "axis maxs: 6 10 8", 'units: "mm" "mm" "cm"')
        self.says("mm", spacing=(1, 2, 10), origin=(0.5, 1, 45), note=("z: cm",))
        self.nrrd("spacings: 1 2 3", 'units: "" "um" "um"')
        self.says(None, spacing=(1, 2, 3), note=("x: none",))
        self.nrrd("spacings: 1 2 3", 'units: "um"')  # for another number of axes
        self.says(None, spacing=(1, 2, 3))

    def test_meta_image(self):
        self.path = self.here / "v.mha"
        for line, unit in (("DistanceUnits = um\n", "um"), ("DistanceUnits = cm\n", "cm"), ("DistanceUnits = ?\n", None),
                           ("", None)):
            sizes = " ".join(map(str, DATA.shape[::-1]))
            self.path.write_bytes(f"ObjectType = Image\nNDims = 3\n{line}DimSize = {sizes}\nElementSpacing = 1 2 3\n"
                                  "ElementType = MET_SHORT\nElementDataFile = LOCAL\n".encode() + DATA.tobytes())
            self.says(unit, spacing=(1, 2, 3))

    def test_formats_without_units(self):
        self.path = self.here / "v.npy"
        np.save(self.path, DATA)
        self.says(None)
        self.path = self.here / "v.raw"
        DATA.tofile(self.path)
        raw = "--dims", "6,5,4", "--type", "int16"
        self.says(None, *raw)
        self.says("nm", *raw, "--unit", "nanometre", "--spacing", "4,4,40", spacing=(4, 4, 40))

    def test_the_option_overrides_the_file_and_leaves_the_numbers(self):
        image = nibabel.Nifti1Image(DATA.T, np.diag([1, 2, 3, 1]))
        image.header.set_xyzt_units("mm", "sec")
        self.path = self.here / "v.nii"
        nibabel.save(image, self.path)
        self.says("um", "--unit", "um", spacing=(1, 2, 3))
        self.says("mm", "--spacing", "5,5,5", spacing=(5, 5, 5))
        self.says("mm", "--every", "2", "--crop", "1:,:,:", "--missing", "3", spacing=(2, 4, 6), origin=(1, 0, 0))
        for wrong in ("furlong", "", "Mm", "mm3"):
            self.refuses(2, "give a unit of length: km, m, dm, cm, mm, um, nm, angstrom, pm, ft, in",
                         options=("--unit", wrong))

    def test_another_unit_is_another_run(self):
        """The files of an interrupted run have the unit of that run."""
        self.path = self.here / "v.npy"
        np.save(self.path, DATA)
        self.says("um", "--unit", "um")
        first = (self.here / "s.isonest").read_bytes()
        self.says("um", "--unit", "micrometer")
        self.assertEqual((self.here / "s.isonest").read_bytes(), first)
        self.says("mm", "--unit", "mm")
        self.assertNotEqual((self.here / "s.isonest").read_bytes(), first)


class Distances(Units):
    """A ball; spacing 500 um."""

    def setUp(self):
        super().setUp()
        z, y, x = np.mgrid[-8:9, -8:9, -8:9]
        self.path = self.here / "v.npy"
        np.save(self.path, np.sqrt(x * x + y * y + z * z).astype("f4"))

    def store(self, unit=None, spacing=500):
        done = self.preprocess("--spacing", f"{spacing},{spacing},{spacing}", *(("--unit", unit) if unit else ()))
        self.assertEqual(done.returncode, 0, done.stderr)

    def extract(self, name, *options):
        done = served.run([ISONEST, "extract", self.here / "s.isonest", "--iso", "5.3", "-o", self.here / name,
                           *options], capture_output=True, text=True)
        return done

    def mesh(self, distance, *options):
        done = self.extract("m.ply", "--distance", distance, *options)
        self.assertEqual(done.returncode, 0, done.stderr)
        return (self.here / "m.ply").read_bytes(), done.stdout

    def test_a_distance_is_converted(self):
        self.store("um")
        bare, text = self.mesh("150")
        self.assertIn(" um of the surface at full resolution", text)
        self.assertIn("(asked for", self.mesh("150", "--triangles", "1000000")[1] + "(asked for")
        for unit, metres in METRES.items():
            with self.subTest(unit):
                self.assertEqual(self.mesh(f"{150e-6 / metres!r}{unit}")[0], bare)
        for same in ("0.15mm", "0.15 mm", "150um", "150\u00b5m", "150micron", "0.3voxel"):
            self.assertEqual(self.mesh(same)[0], bare)
        self.assertNotEqual(self.mesh("0.3mm")[0], bare)

    def test_a_conversion_is_exact_to_rounding(self):
        for here in ("km", "mm", "um", "nm", "in"):
            self.store(here, 1)
            for there, metres in METRES.items():
                done = self.extract("m.ply", "--json", "--distance", f"0.7{there}")
                wanted = 0.7 * metres / METRES[here]
                if wanted < 8e-7:  # below the precision of float32
                    self.assertEqual(done.returncode, 7, done.stderr)
                    continue
                found = json.loads(done.stdout)["distance"]
                self.assertLess(abs(found - wanted), 1e-15 * wanted, (here, there))

    def test_a_unit_is_refused_where_that_of_the_store_is_not_known(self):
        self.store()
        done = self.extract("m.ply", "--distance", "0.5mm")
        self.assertEqual(done.returncode, 2)
        for words in ("0.5 mm", "has no unit", "give a plain number", "preprocess the volume again with --unit"):
            self.assertIn(words, done.stderr)
        self.assertFalse((self.here / "m.ply").exists())
        self.assertEqual(self.mesh("0.3voxel")[0], self.mesh("150")[0])
        self.assertNotIn(b"unit", self.mesh("150")[0][:300])
        done = self.extract("m.ply", "--distance", "0.5furlong")
        self.assertEqual(done.returncode, 2)
        self.assertIn("km, m, dm, cm, mm, um, nm, angstrom, pm, ft, in or voxel", done.stderr)

    def test_reports(self):
        for unit in ("um", None):
            self.store(unit)
            self.assertEqual(json.loads(self.extract("m.ply", "--json").stdout)["unit"], unit)
            text = served.run([ISONEST, "info", self.here / "s.isonest"], capture_output=True, text=True).stdout
            self.assertIn("unit um (micrometre)" if unit else "unknown unit", text)
            sliced = served.run([ISONEST, "slice", self.here / "s.isonest", "--plane", "0,0,1,800", "-o",
                                 self.here / "p.vtp", "--json"], capture_output=True, text=True)
            self.assertEqual(json.loads(sliced.stdout)["unit"], unit)

    def places(self, name):
        """Positions of the file's vertices, in metres as its format defines them; None if it defines no unit."""
        path = self.here / name
        kind = path.suffix
        if kind == ".3mf":
            names = {"micron": 1e-6, "millimeter": 1e-3, "centimeter": 1e-2, "inch": 0.0254, "foot": 0.3048, "meter": 1}
            with zipfile.ZipFile(path) as archive:
                model = xml.etree.ElementTree.fromstring(archive.read("3D/3dmodel.model"))
            space = {"m": "http://schemas.microsoft.com/3dmanufacturing/core/2015/02"}
            scale = [float(t) for t in model.find("m:build/m:item", space).get("transform", "1 0 0 0 1 0 0 0 1 0 0 0").split()]
            matrix = np.array(scale[:9]).reshape(3, 3)
            points = [[float(v.get(a)) for a in "xyz"] for v in model.iterfind(".//m:vertex", space)]
            return np.array(points) @ matrix * names[model.get("unit")]
        if kind == ".glb":
            data = path.read_bytes()
            length = struct.unpack_from("<I", data, 12)[0]
            scene = json.loads(data[20:20 + length])
            count, start = scene["accessors"][0]["count"], 20 + length + 8
            points = np.frombuffer(data, "<f4", 3 * count, start).reshape(-1, 3).astype(float)
            return points * scene["nodes"][0].get("scale", [1, 1, 1])
        data = path.read_bytes()
        count = struct.unpack_from("<I", data)[0]
        return np.frombuffer(data, "<f4", 3 * count, 4).reshape(-1, 3).astype(float) * 1e-9

    def test_formats_with_a_unit_of_their_own_place_the_mesh_by_it(self):
        self.store()
        self.extract("bare.ply")
        plain = {}
        for name in ("m.3mf", "m.glb", "m.ngmesh"):
            self.extract(name)
            plain[name] = (self.here / name).read_bytes()
        self.assertIn(b"model", plain["m.3mf"])
        unscaled = {"m.3mf": 1e-3, "m.glb": 1.0, "m.ngmesh": 1e-9}
        numbers_of = {name: self.places(name) / unscaled[name] for name in unscaled}
        for unit, metres in METRES.items():
            self.store(unit)
            for name, bare in numbers_of.items():
                with self.subTest(unit=unit, name=name):
                    self.extract(name)
                    np.testing.assert_allclose(self.places(name), bare * metres, rtol=2e-7)
        self.store()  # without a unit the bytes do not change
        for name, data in plain.items():
            self.extract(name)
            self.assertEqual((self.here / name).read_bytes(), data)

    def test_other_formats_say_it_and_keep_the_numbers(self):
        found = {}
        for unit in (None, "nm"):
            self.store(unit)
            for name in ("m.ply", "m.stl", "m.obj", "m.vtp", "m.vtkhdf"):
                self.assertEqual(self.extract(name).returncode, 0)
                found[unit, name] = (self.here / name).read_bytes()
            if unit:
                reader = vtk.vtkXMLPolyDataReader()
                reader.SetFileName(str(self.here / "m.vtp"))
                reader.Update()
                field = reader.GetOutput().GetFieldData().GetAbstractArray("unit")
                self.assertEqual(field.GetValue(0), unit)
                with h5py.File(self.here / "m.vtkhdf") as f:
                    self.assertEqual(f["VTKHDF"].attrs["unit"], unit.encode())
        ply = re.sub(rb"comment unit nm\n", b"", found["nm", "m.ply"])
        self.assertNotEqual(ply, found["nm", "m.ply"])
        self.assertEqual(ply, found[None, "m.ply"])
        self.assertEqual(found["nm", "m.obj"].replace(b"# unit nm\n", b""), found[None, "m.obj"])
        self.assertTrue(found["nm", "m.stl"].startswith(b"binary STL, isonest, unit nm\0"))
        self.assertEqual(found["nm", "m.stl"][80:], found[None, "m.stl"][80:])

    def test_volumes_that_are_written_keep_it(self):
        for unit in ("um", "mm", "cm", "nm", None):
            self.store(unit)
            kept = {"v2.h5": True, "v2.nrrd": True, "v2.nii": unit in ("um", "mm"), "v2.mha": unit in ("um", "mm", "cm"),
                    "v2.npy": False, "v2.vti": False}
            for name, keeps in kept.items():
                with self.subTest(unit=unit, name=name):
                    served.run([ISONEST, "export", self.here / "s.isonest", "--field", "values", "-o", self.here / name,
                                "--force"], check=True, capture_output=True)
                    done = served.run([ISONEST, "preprocess", self.here / name, "-o", self.here / "t.isonest", "--force"],
                                      capture_output=True, text=True)
                    self.assertEqual(done.returncode, 0, done.stderr)
                    self.assertEqual(self.info("t.isonest")["unit"], unit if keeps else None)
                    if name == "v2.nii":
                        self.assertEqual(nibabel.load(self.here / name).header.get_xyzt_units()[0],
                                         {"um": "micron", "mm": "mm"}.get(unit, "unknown"))


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1])
