#!/usr/bin/env python3
"""--index chooses axes in the same way for every format: by name in upper or lower case, synonym or number; whole
axes."""
import json
import pathlib
import sys
import unittest

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1] / "support"))

try:
    import h5py
    import mrcfile
    import nibabel
    import numpy as np
    import tifffile
    import vtk
    from vtk.util import numpy_support
    from zarr_two import zarr
    from volume_inputs import Input, numbers
except ImportError as error:
    print(f"skipped: {error}")
    sys.exit(77)


class Axes(Input):
    """`data` is [t, z, y, x] or [z, y, x, c], stored in each format as the format stores such arrays."""

    def note(self, done, *words):
        text = done.stdout + done.stderr
        for word in words:
            self.assertIn(word, text)

    def in_time(self, data):
        """Formats whose first axis, slowest first, is a time: its name, and the file."""
        path = self.here / "t.nii"
        image = nibabel.Nifti1Image(data.T, np.diag([0.5, 2, 3, 1]))
        image.header.set_zooms((0.5, 2, 3, 4))
        nibabel.save(image, path)
        yield "t", path, (0.5, 2, 3), 4
        path = self.here / "t.mha"
        size = " ".join(map(str, data.shape[::-1]))
        path.write_bytes(f"ObjectType = Image\nNDims = 4\nDimSize = {size}\nElementSpacing = 0.5 2 3 4\nElementType = MET_SHORT\n"
                         "ElementDataFile = LOCAL\n".encode() + data.astype("<i2").tobytes())
        yield "t", path, (0.5, 2, 3), 4
        path = self.here / "t.h5"
        with h5py.File(path, "w") as file:
            file["v"] = data
            for i, name in enumerate(("Time", "z", "y", "x")):
                file["v"].dims[i].label = name
        yield "Time", path, (1, 1, 1), 1
        path = self.here / "t.npy"
        np.save(path, data)
        yield None, path, (1, 1, 1), 1
        path = self.here / "t.zarr"
        zarr.save_array(str(path), data)
        yield None, path, (1, 1, 1), 1
        path = self.here / "ome.zarr"
        zarr.save_array(str(path / "0"), data)
        (path / ".zgroup").write_text('{"zarr_format": 2}')
        (path / ".zattrs").write_text(json.dumps({"multiscales": [{
            "version": "0.4", "axes": [{"name": "t", "type": "time"}] + [{"name": name, "type": "space"} for name in "zyx"],
            "datasets": [{"path": "0", "coordinateTransformations": [{"type": "scale", "scale": [4, 3, 2, 0.5]}]}]}]}))
        yield "t", path, (0.5, 2, 3), 4
        path = self.here / "t.mrc"
        with mrcfile.new(path, overwrite=True) as file:
            file.set_data(data)
        yield "volume", path, (1, 1, 1), 1

        path = self.here / "t.nrrd"
        size = " ".join(map(str, data.shape[::-1]))
        path.write_bytes(f"NRRD0004\ntype: short\ndimension: 4\nsizes: {size}\nspacings: 0.5 2 3 4\nkinds: space space space time\n"
                         "endian: little\nencoding: raw\n\n".encode() + data.astype("<i2").tobytes())
        yield "t", path, (0.5, 2, 3), 4
        path = self.here / "t.tif"
        tifffile.imwrite(path, data[:, :, None], imagej=True, resolution=(2, 0.5), metadata={"axes": "TZCYX", "spacing": 3, "unit": "um"})
        yield "t", path, (0.5, 2, 3), 1
        path = self.here / "t.ome.tif"
        tifffile.imwrite(path, data, photometric="minisblack",
                         metadata={"axes": "TZYX", "PhysicalSizeX": 0.5, "PhysicalSizeY": 2, "PhysicalSizeZ": 3})
        yield "t", path, (0.5, 2, 3), 1

    def test_a_position_on_a_time_axis(self):
        data = numbers((3, 4, 5, 6))
        for name, self.path, spacing, _ in self.in_time(data):
            with self.subTest(path=self.path.name):
                rest = ",:" * (3 if self.path.suffix != ".tif" else 4)
                count = rest.count(":") + 1
                ways = ["1" + rest, " 1" + rest.replace(",", ", ") + " ", "0=1", f"-{count}=1", f"-{count}=-2", "0=1,1=:", "0=-2,-1=:"]
                self.refuses(5, f"--index {name or 0}=0")
                if name is not None:
                    ways += [f"{name}=1", f"{name.upper()}=1", f"{name.lower()} = 1"]
                if name in ("t", "Time"):
                    ways += ["t=1", "time=1", "TIME=1", "frames=1"]
                for way in ways:
                    self.reads(data[1], "--index", way)
                self.lies((0, 0, 0), spacing)
                # The suggested command is complete.
                self.reads(data[0], "--index", f"{name or 0}=0")
                for words, way in (("no axis 'nothing'", "nothing=1"), ("no axis '5'", "5=1"), ("no axis '-6'", "-6=1"),
                                   ("has no position 3", "0=3"), ("has no position -4", "0=-4"), ("twice", f"0=1,-{count}=1"),
                                   (f"3 entries for {count} axes", ":,:,:")):
                    self.refuses(2, words, options=("--index", way))
                self.refuses(5, "4 axes", options=("--index", "0=:"))

    def test_a_whole_time_axis_is_an_axis_of_the_volume(self):
        data = numbers((3, 4, 5, 6))
        for name, self.path, spacing, apart in self.in_time(data):
            with self.subTest(path=self.path.name):
                done = self.reads(np.ascontiguousarray(data[:, 2]), "--index", f"{name or 0}=:,1=2")
                info = self.info()
                np.testing.assert_allclose(info["spacing"], (*spacing[:2], apart))
                if name in ("t", "volume"):
                    self.note(done, f"axis '{name}' is not a direction in space", "used as z")
                if self.path.suffix == ".tif":  # rows of pages are cropped
                    self.refuses(5, "crop", options=("--index", f"{name}=:,y=3"))
                    continue
                done = self.reads(np.ascontiguousarray(data[:, :, 3]), "--index", ":,:,3,:")
                if name in ("t", "volume"):
                    self.note(done, f"axis '{name}' is not a direction in space")
        # z has one position, and is dropped: a stack that was stored as times.
        data = data[:, :1]
        for name, self.path, spacing, apart in self.in_time(data):
            if name == "volume":
                continue  # a stack of sections
            with self.subTest(path=self.path.name, flat=True):
                if name == "t" and self.path.suffix != ".nrrd":  # its times are axes if fewer than three others are
                    self.refuses(5, "--index t=0", "--index t=:")
                self.reads(data[:, 0], "--index", f"{name or 0}=:")
                np.testing.assert_allclose(self.info()["spacing"], (*spacing[:2], apart))

    def components(self, data):
        path = self.here / "c.mha"
        size = " ".join(map(str, data.shape[2::-1]))
        path.write_bytes(f"ObjectType = Image\nNDims = 3\nDimSize = {size}\nElementSpacing = 0.5 2 3\nElementType = MET_SHORT\n"
                         f"ElementNumberOfChannels = {data.shape[3]}\nElementDataFile = LOCAL\n".encode() + data.astype("<i2").tobytes())
        yield path
        image = vtk.vtkImageData()
        image.SetDimensions(*data.shape[2::-1])
        image.SetSpacing(0.5, 2, 3)
        array = numpy_support.numpy_to_vtk(np.ascontiguousarray(data.reshape(-1, data.shape[3])))
        array.SetName("v")
        image.GetPointData().AddArray(array)
        for name, writer in (("c.vti", vtk.vtkXMLImageDataWriter()), ("c.vtk", vtk.vtkStructuredPointsWriter())):
            path = self.here / name
            writer.SetFileName(str(path))
            writer.SetInputData(image)
            if name == "c.vti":
                writer.SetCompressorTypeToNone()
            else:
                writer.SetFileTypeToBinary()
            writer.Write()
            yield path

    def test_components(self):
        data = numbers((4, 5, 6, 3))
        for self.path in self.components(data):
            with self.subTest(path=self.path.name):
                self.refuses(5, "3 volumes along axis 'c'", "--index c=0")
                for way in ("c=2", "C=2", "channel=2", "Component=2", "components=-1", "3=2", "-1=2", ":,:,:,2"):
                    self.reads(np.ascontiguousarray(data[..., 2]), "--index", way)
                self.lies((0, 0, 0), (0.5, 2, 3))
                done = self.reads(np.ascontiguousarray(data[2]), "--index", "c=:,z=2")  # x is that of the components
                self.assertEqual(self.info()["nodes"], [3, 6, 5])
                self.note(done, "axis 'c' is not a direction in space", "used as x, with a spacing of 1")
                self.assertEqual(sorted(self.info()["spacing"]), [0.5, 1, 2])

    def test_names_that_mean_several_axes_are_refused(self):
        data = numbers((3, 4, 5, 6))
        self.path = self.here / "v.h5"
        for names, way, code in ((("a", "a", "y", "x"), "a=1", 2), (("A", "a", "y", "x"), "a=1", 0), (("A", "a", "y", "x"), "B=1", 2),
                                 (("AB", "Ab", "y", "x"), "ab=1", 2), (("t", "time", "y", "x"), "frame=1", 2),
                                 (("t", "time", "y", "x"), "time=1", 0), (("3", "z", "y", "x"), "3=1", 0),
                                 (("a=b", "z", "y", "x"), "a=b=1", 0), (("the time", "z", "y", "x"), "The Time=1", 0)):
            with self.subTest(names=names, way=way):
                with h5py.File(self.path, "w") as file:
                    file["v"] = data
                    for i, name in enumerate(names):
                        file["v"].dims[i].label = name
                if code:
                    self.refuses(2, "--index", options=("--index", way))
                else:
                    axis = 1 if names[1] == way[:-2] else 0
                    self.reads(np.ascontiguousarray(np.take(data, 1, axis)), "--index", way)
        with h5py.File(self.path, "w") as file:
            file["v"] = data
            for i, name in enumerate(("a", "a", "the time", "frame")):
                file["v"].dims[i].label = name
        # A time axis is suggested in preference to a slower axis, and a number where a name is ambiguous.
        self.refuses(5, "--index frame=0")
        self.refuses(5, "--index 0=0", options=("--dataset", "v", "--index", "frame=:"))

    def test_indices_that_are_none(self):
        self.path = self.here / "v.npy"
        np.save(self.path, numbers((2, 3, 4, 5)))
        for way in ("", ",", "1", "1,:,:,:,:", "a", "1.5,:,:,:", "=1", "0=", "0=a", "0=1,:", ":,0=1", "0=1=", "1:2,:,:,:", "é=1"):
            with self.subTest(way=way):
                self.refuses(2, options=("--index", way))


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1])
