#!/usr/bin/env python3
"""TIFF files and stacks as written by tifffile and libtiff's programs.

usage: tiff_input_test.py ISONEST PLUGIN_FOLDER
"""
import itertools
import pathlib
import shutil
import struct
import subprocess
import sys
import unittest

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1] / "support"))
import served  # noqa: E402

try:
    import numpy as np
    import tifffile
    from volume_inputs import ISONEST, RANDOM, TYPES, DamagedFiles, Input, is_read_as, numbers
except ImportError as error:
    print(f"skipped: {error}")
    sys.exit(77)


class Tiff(DamagedFiles, Input):
    def setUp(self):
        super().setUp()
        self.path = self.here / "v.tif"

    def test_types_orders_tiles_and_bigtiff(self):
        for kind, order, big, tile in itertools.product((*TYPES, "i8", "u8", "f2"), "<>", (False, True),
                                                        (None, (16, 32))):
            with self.subTest(kind=kind, order=order, big=big, tile=tile):
                data = numbers((5, 37, 41), kind)
                tifffile.imwrite(self.path, data, byteorder=order, bigtiff=big, tile=tile, photometric="minisblack",
                                 metadata=None)
                self.reads(is_read_as(data))
                self.lies([0, 0, 0], [1, 1, 1])

    def test_strips_of_any_height(self):
        data = numbers((5, 37, 41))
        for rows in (1, 2, 36, 37):
            tifffile.imwrite(self.path, data, rowsperstrip=rows, photometric="minisblack", metadata=None)
            self.reads(data)

    def test_compressions_and_predictors(self):
        if shutil.which("tiffcp") is None:
            self.skipTest("no tiffcp (Debian: libtiff-tools)")
        plain = self.here / "plain.tif"
        for kind, way in (("u1", "lzw"), ("i2", "lzw:2"), ("u2", "zip"), ("u2", "zip:2"), ("f4", "zip:3"), ("f4", "zstd"),
                          ("f8", "lzw:3"), ("u1", "packbits"), ("i4", "zip:2"), ("u2", "lzma")):
            for layout in (("-s", "-r", "7"), ("-t", "-w", "16", "-l", "32")):
                # With -B tiffcp itself stores the bytes of predictor 3 in the wrong order.
                for order in ("-L",) if way.endswith(":3") else ("-B", "-L"):
                    with self.subTest(kind=kind, way=way, layout=layout, order=order):
                        data = numbers((4, 37, 41), kind)
                        tifffile.imwrite(plain, data, photometric="minisblack", metadata=None)
                        subprocess.run(["tiffcp", "-c", way, order, *layout, plain, self.path], check=True,
                                       capture_output=True)
                        self.reads(data)

    def test_tiles_that_reach_beyond_the_page(self):
        for height, width in ((48, 16), (16, 64), (96, 64)):
            for compression, planar, samples in itertools.product((None, "zlib"), ("contig", "separate"), (1, 3)):
                if samples == 1 and planar == "separate":
                    continue
                with self.subTest(tile=(height, width), compression=compression, planar=planar, samples=samples):
                    data = numbers((3, 37, 41, samples), "u2")
                    tifffile.imwrite(self.path, np.moveaxis(data, -1, 1) if planar == "separate" else data.squeeze(),
                                     tile=(height, width), compression=compression,
                                     planarconfig=planar if samples == 3 else None, metadata=None,
                                     photometric="rgb" if samples == 3 else "minisblack")
                    for c in range(samples)[::2]:
                        self.reads(np.ascontiguousarray(data[..., c]), *(("--index", f"c={c}") if samples > 1 else ()))
        # Pages of one stack, each with tiles of a different height.
        data = numbers((3, 37, 41))
        with tifffile.TiffWriter(self.path) as file:
            for plane, tile in zip(data, ((16, 16), (64, 64), (48, 16))):
                file.write(plane, tile=tile, photometric="minisblack", metadata=None)
        self.reads(data)

    def stack(self, data, names):
        folder = self.here / "stack"
        shutil.rmtree(folder, ignore_errors=True)
        folder.mkdir()
        for plane, name in zip(data, names):
            tifffile.imwrite(folder / name, plane, photometric="minisblack", metadata=None)
        return folder

    def test_a_folder_and_a_list_are_in_natural_order(self):
        data = numbers((12, 7, 9))
        names = [f"slice{i}.tif" for i in range(12)]
        self.path = self.stack(data, names)
        (self.path / "readme.txt").write_text("notes")
        (self.path / ".hidden.tif").write_text("")
        self.reads(data)
        lost = self.path / "slice12.tif"
        lost.symlink_to(self.here / "nothing")
        self.refuses(3, "slice12.tif", "No such file")
        lost.unlink()
        files = [self.path / name for name in sorted(names)]
        done = served.run([ISONEST, "preprocess", *files, "-o", self.here / "s.isonest", "--chunk", "8", "--force"],
                          capture_output=True, text=True)
        self.assertEqual(done.returncode, 0, done.stderr)
        served.run([ISONEST, "export", self.here / "s.isonest", "--field", "values", "-o", self.here / "s.npy"],
                   check=True, capture_output=True)
        np.testing.assert_array_equal(np.load(self.here / "s.npy"), data)
        done = served.run([ISONEST, "check", self.here / "s.isonest", "--source", *files], capture_output=True)
        self.assertEqual(done.returncode, 0, done.stdout + done.stderr)
        before = files[3].read_bytes()
        self.assertEqual(self.preprocess(store=files[3]).returncode, 2)
        self.assertEqual(files[3].read_bytes(), before)
        # Files of several pages are concatenated.
        self.path = self.here / "pages"
        self.path.mkdir()
        for i in range(3):
            tifffile.imwrite(self.path / f"{i}.tiff", data[4 * i:4 * i + 4], photometric="minisblack", metadata=None)
        self.reads(data)

    def test_a_page_that_differs_is_named(self):
        data = list(numbers((4, 7, 9)))
        data[2] = numbers((7, 8))
        self.path = self.stack(data, [f"{i}.tif" for i in range(4)])
        self.refuses(5, "2.tif", "8 x 7 int16", "9 x 7 int16")
        data[2] = numbers((7, 9), "u1")
        self.path = self.stack(data, [f"{i}.tif" for i in range(4)])
        self.refuses(5, "2.tif", "9 x 7 uint8")
        (self.path / "1.tif").write_bytes((self.path / "1.tif").read_bytes()[:60])
        self.refuses(4, "1.tif")

    def test_channels_time_and_spacing_of_imagej(self):
        data = numbers((2, 5, 3, 7, 9), "u2")  # t z c y x
        tifffile.imwrite(self.path, data, imagej=True, resolution=(2, 4),
                         metadata={"axes": "TZCYX", "spacing": 3.5, "unit": "um"})
        self.refuses(5, "t 2, z 5, c 3, y 7, x 9")
        for t, c in ((0, 0), (1, 2)):
            self.reads(np.ascontiguousarray(data[t, :, c]), "--index", f"t={t},c={c}")
            self.lies([0, 0, 0], [0.5, 0.25, 3.5])
        self.reads(np.ascontiguousarray(data[1, 3, 2]), "--index", "1,3,2,:,:")
        self.refuses(5, "crop", options=("--index", "0,:,0,3,:"))

    def test_imagejs_large_files_have_one_page(self):
        data = numbers((6, 7, 9), "u2")
        description = "ImageJ=1.53t\nimages=6\nslices=6\nspacing=2\nunit=um\n"
        tifffile.imwrite(self.path, data[0], byteorder=">", description=description, metadata=None, photometric="minisblack")
        with tifffile.TiffFile(self.path) as t:
            offset = t.pages[0].dataoffsets[0]
        raw = self.path.read_bytes()
        self.path.write_bytes(raw[:offset] + data.astype(">u2").tobytes())
        self.assertLessEqual(len(raw), offset + data[0].nbytes)
        self.reads(data)
        self.lies([0, 0, 0], [1, 1, 2])

    def test_images_behind_one_page(self):
        data = numbers((5, 7, 9, 3), "u1")
        path = self.path
        for stack, options in ((data[..., 0].astype("i2"), {}), (data, {"photometric": "rgb"})):
            for order in "<>":
                tifffile.imwrite(path, stack, truncate=True, byteorder=order, **{"photometric": "minisblack", **options})
                with tifffile.TiffFile(path) as file:
                    self.assertEqual(len(file.pages), 1)
                np.testing.assert_array_equal(tifffile.imread(path), stack)
                if stack.ndim == 3:
                    self.reads(stack)
                else:
                    self.refuses(5, "c 3")
                    self.reads(np.ascontiguousarray(stack[..., 1]), "--index", "c=1")
        # Colours by ImageJ, for more than 4 GiB.
        tifffile.imwrite(path, data[0], photometric="rgb", description="ImageJ=1.53t\nimages=5\nslices=5\n", metadata=None)
        with tifffile.TiffFile(path) as file:
            offset = file.pages[0].dataoffsets[0]
        path.write_bytes(path.read_bytes()[:offset] + data.tobytes())
        self.reads(np.ascontiguousarray(data[..., 2]), "--index", "c=2")
        tifffile.imwrite(path, data[0, ..., 0], tile=(16, 16), photometric="minisblack", metadata=None,
                         description='{"shape": [5, 7, 9], "truncated": true}')
        self.refuses(5, "one page holds 5 images")

    def test_stacks_of_metamorph(self):
        data = numbers((5, 7, 9), "u2")
        for compression in (None, "zlib"):
            # For each plane a rational number and, after them, four times and dates.
            uic2 = (33629, 5, 5, (2, 1) * 5, True)
            tifffile.imwrite(self.path, data[0], photometric="minisblack", byteorder="<", metadata=None, compression=compression,
                             extratags=[uic2])
            with tifffile.TiffFile(self.path) as file:
                offset = file.pages[0].dataoffsets[0]
            if compression:
                self.refuses(5, "one page holds 5 images")
                continue
            self.assertEqual(len(self.path.read_bytes()), offset + data[0].nbytes)
            self.path.write_bytes(self.path.read_bytes()[:offset] + data.tobytes())
            self.reads(data)

    def test_pages_that_differ_say_in_what(self):
        plain, other = numbers((4, 5), "u2"), np.zeros((4, 5), "c8")
        with tifffile.TiffWriter(self.path) as file:
            for page in (plain, other, other):
                file.write(page, photometric="minisblack", contiguous=False)
        self.refuses(5, "page 1: complex numbers")
        with tifffile.TiffWriter(self.path) as file:
            for kind in ("i8", "u8", "u8"):
                file.write(numbers((4, 5), kind), photometric="minisblack", contiguous=False)
        self.refuses(5, "page 0: it is 5 x 4 int64, but most pages are 5 x 4 uint64")

    def test_what_is_no_plane_of_numbers_is_refused(self):
        for kind in ("c8", "c16"):
            tifffile.imwrite(self.path, np.zeros((3, 4, 5), kind), photometric="minisblack")
            self.refuses(5, "complex")
        for tile in (None, (16, 16, 16)):
            tifffile.imwrite(self.path, numbers((20, 7, 9)), volumetric=True, tile=tile, photometric="minisblack")
            self.refuses(5, "ImageDepth")

    def ome_file(self, planes, attributes="", elements="<TiffData/>", text=None, name="a.ome.tif", front="", uuid="urn:uuid:1", **options):
        """Pages in this order, and a description with T 2, Z 3 and C 2."""
        n, height, width = planes.shape[:3]
        text = text or (f'<?xml version="1.0" encoding="UTF-8"?><{front}OME xmlns:ome="http://www.openmicroscopy.org/Schemas/OME/2016-06" '
                        f'UUID="{uuid}"><{front}Image ID="Image:0"><{front}Pixels ID="Pixels:0" DimensionOrder="XYCZT" Type="uint16" '
                        f'SizeX="{width}" SizeY="{height}" SizeZ="3" SizeC="2" SizeT="2" {attributes}>{elements}'
                        f'</{front}Pixels></{front}Image></{front}OME>')
        self.path = self.here / name
        with tifffile.TiffWriter(self.path) as file:
            for i, plane in enumerate(planes):
                file.write(plane, description=text.encode() if i == 0 else None, metadata=None, contiguous=False,
                           **{"photometric": "minisblack", **options})
        return self.path

    def test_where_ome_says_that_planes_are(self):
        data = numbers((2, 3, 2, 7, 9), "u2")  # t z c y x
        planes = data.reshape(12, 7, 9)
        at = [int(i) for i in RANDOM.permutation(12)]

        def element(directory, plane, inside=""):
            t, z, c = np.unravel_index(plane, (2, 3, 2))
            return f'<TiffData IFD="{directory}" FirstT="{t}" FirstZ="{z}" FirstC="{c}">{inside}</TiffData>'
        each = [element(i, plane) for i, plane in enumerate(at)]
        self.ome_file(planes[at], elements="".join(each))
        self.reads(np.ascontiguousarray(data[1, :, 0]), "--index", "t=1,c=0")
        self.reads(np.ascontiguousarray(data[0, :, 1]), "--index", "t=0,c=1")
        blocks = '<TiffData IFD="6" PlaneCount="6"/><TiffData FirstT="1" IFD="0" PlaneCount="6"/>'
        self.ome_file(np.roll(planes, 6, 0), elements=blocks)
        self.reads(np.ascontiguousarray(data[1, :, 0]), "--index", "t=1,c=0")
        for elements in ("<TiffData/>", "", '<TiffData IFD="0" PlaneCount="12"/>', '<TiffData FirstZ="0"/>'):
            self.ome_file(planes, elements=elements)
            self.reads(np.ascontiguousarray(data[1, :, 0]), "--index", "t=1,c=0")
        # A renamed file.
        self.ome_file(planes[at], elements="".join(
            element(i, plane, '<UUID FileName="other.ome.tif">urn:uuid:2</UUID>') for i, plane in enumerate(at)))
        self.reads(np.ascontiguousarray(data[1, :, 0]), "--index", "t=1,c=0")
        for code, elements, word in ((5, each[1:], "is not given"), (4, [*each[1:], element(12, at[0])], "directory 12"),
                                     (4, [*each, '<TiffData FirstZ="3"/>'], "FirstZ is 3")):
            self.ome_file(planes[at], elements="".join(elements))
            self.refuses(code, word, options=("--index", "t=1,c=0"))

    def test_a_set_of_files_by_ome(self):
        data = numbers((2, 3, 2, 7, 9), "u2")
        # Each file has one time, the first file the later one.
        elements = "".join(f'<TiffData FirstT="{t}" FirstZ="{z}" FirstC="{c}" IFD="{z * 2 + c}"><UUID FileName="{1 - t}.ome.tif">'
                           f'urn:uuid:{1 - t}</UUID></TiffData>' for t, z, c in np.ndindex(2, 3, 2))
        files = [self.ome_file(data[1 - i].reshape(6, 7, 9), elements=elements, name=f"{i}.ome.tif", uuid=f"urn:uuid:{i}") for i in range(2)]
        self.refuses(5, "several files", options=("--index", "t=1,c=0"))
        folder = self.here / "set"
        folder.mkdir()
        for file in files:
            file.rename(folder / file.name)
        self.path = folder
        self.reads(np.ascontiguousarray(data[1, :, 0]), "--index", "t=1,c=0")
        self.reads(np.ascontiguousarray(data[0, :, 1]), "--index", "t=0,c=1")
        (folder / "1.ome.tif").rename(folder / "2.ome.tif")
        self.refuses(5, "'1.ome.tif'", options=("--index", "t=1,c=0"))

    def test_ome_in_any_spelling_of_xml(self):
        data = numbers((2, 3, 2, 7, 9), "u2")
        planes = data.reshape(12, 7, 9)
        for attributes, front in (("PhysicalSizeX='0.5' PhysicalSizeXUnit='nm' PhysicalSizeY=\"0.25\"\n\tPhysicalSizeYUnit = \"nm\" "
                                   "PhysicalSizeZ='2' PhysicalSizeZUnit='&#110;m'", ""),
                                  ('PhysicalSizeX="0.5" PhysicalSizeY="0.25" PhysicalSizeZ="2000" PhysicalSizeXUnit="&#181;m" '
                                   'PhysicalSizeYUnit="&#xB5;m" PhysicalSizeZUnit="nm"', "ome:")):
            with self.subTest(attributes=attributes):
                self.ome_file(planes, attributes, front=front,
                              elements='<!-- <Pixels SizeZ="9"> --><Channel Name="a > b &amp; \'c\'" ID="Channel:0:0"/><TiffData/>')
                self.reads(np.ascontiguousarray(data[1, :, 0]), "--index", "t=1,c=0")
                self.lies([0, 0, 0], [0.5, 0.25, 2])
        self.ome_file(planes, 'PhysicalSizeX="0.5')
        self.refuses(4, "OME-XML")
        # An axis without a size has no unit.
        self.ome_file(planes, 'PhysicalSizeX="0.5" PhysicalSizeY="0.5"')
        done = self.reads(np.ascontiguousarray(data[1, :, 0]), "--index", "t=1,c=0")
        self.assertIn("z: none", done.stdout + done.stderr)
        # Channels are samples of a page; there are fewer pages than channels.
        colours = numbers((1, 7, 9, 3), "u2")
        self.ome_file(colours, text='<OME><Image><Pixels DimensionOrder="XYCZT" SizeX="9" SizeY="7" SizeC="3" SizeZ="1" SizeT="1"><TiffData/></Pixels>'
                      '</Image></OME>', photometric="rgb")
        self.reads(np.ascontiguousarray(colours[..., 2]), "--index", "c=2")

    def test_ome(self):
        data = numbers((2, 3, 5, 7, 9), "u2")
        tifffile.imwrite(self.path, data, ome=True, photometric="minisblack",
                         metadata={"axes": "TCZYX", "PhysicalSizeX": 0.5, "PhysicalSizeY": 0.25, "PhysicalSizeZ": 2})
        self.refuses(5, "c 3", "t 2", "z 5")
        self.reads(np.ascontiguousarray(data[1, 2]), "--index", "t=1,c=2")
        self.lies([0, 0, 0], [0.5, 0.25, 2])

    def test_colours_are_chosen(self):
        data = numbers((4, 7, 9, 3), "u1")
        for planar in ("contig", "separate"):
            tifffile.imwrite(self.path, data if planar == "contig" else np.moveaxis(data, -1, 1), photometric="rgb",
                             planarconfig=planar, metadata=None)
            self.refuses(5, "c 3", "--index")
            for c in range(3):
                self.reads(np.ascontiguousarray(data[..., c]), "--index", f"c={c}")

    def test_what_cannot_be_read_is_refused(self):
        if shutil.which("tiffcp"):
            tifffile.imwrite(self.path, numbers((7, 9, 3), "u1"), photometric="rgb")
            subprocess.run(["tiffcp", "-c", "jpeg", self.path, self.here / "jpeg.tif"], check=True, capture_output=True)
            self.path, path = self.here / "jpeg.tif", self.path
            self.refuses(5, "YCbCr")
            self.path = path
        tifffile.imwrite(self.path, np.zeros((4, 2000, 2000), "u2"), photometric="minisblack", metadata=None,
                         rowsperstrip=2000, compression="zlib")
        self.refuses(7, "page 0", "MiB", options=("--memory", "48M"))
        empty = self.here / "empty"
        empty.mkdir()
        self.path = empty
        self.refuses(5, "the folder is empty")

    def test_a_spacing_that_nothing_says_is_named(self):
        data = numbers((5, 7, 9), "u2")
        for options, words in (({}, "the spacing;"), ({"resolution": (72, 72)}, "the spacing;"),
                               ({"imagej": True, "resolution": (2, 4), "metadata": {"axes": "ZYX", "spacing": 2, "unit": "um"}}, None),
                               ({"metadata": {"axes": "ZYX", "PhysicalSizeX": 1, "PhysicalSizeY": 1}, "ome": True}, "the spacing along z;")):
            with self.subTest(options=options):
                tifffile.imwrite(self.path, data, photometric="minisblack", **options)
                done = self.reads(data)
                text = done.stdout + done.stderr
                self.assertEqual("does not give the spacing" in text, words is not None)
                self.assertIn(words or "", text)

    def test_masks_of_one_bit(self):
        for width in (2, 8, 9, 33):
            data = RANDOM.random((3, 12, width)) < 0.4
            data[:, :2] = [[True], [False]]
            for photometric in ("minisblack", "miniswhite"):
                plain = self.here / "plain.tif"
                tifffile.imwrite(plain, data, photometric=photometric, metadata=None)
                np.testing.assert_array_equal(tifffile.imread(plain), data)  # as stored, for both photometric values
                ways = [()]
                if shutil.which("tiffcp"):
                    ways = [("-f", order, "-c", way, *layout) for order, way, layout in itertools.product(
                        ("lsb2msb", "msb2lsb"), ("none", "packbits", "g3", "g3:2d", "g4", "zip", "lzw"), (("-s", "-r", "5"), ("-t", "-w", "16", "-l", "16")))][width % 3::3]
                for way in ways:
                    with self.subTest(width=width, photometric=photometric, way=way):
                        self.path = plain
                        if way:
                            self.path = self.here / "v.tif"
                            subprocess.run(["tiffcp", *way, plain, self.path], check=True, capture_output=True)
                        done = self.reads(data.astype("u1"))
                        self.assertEqual("MinIsWhite" in done.stdout + done.stderr, photometric == "miniswhite")
        # Pillow can write and read such files itself.
        try:
            from PIL import Image
        except ImportError:
            self.skipTest("no Pillow (Debian: python3-pil)")
        self.path = self.here / "pil.tif"
        pages = [Image.fromarray(plane.astype("u1") * 255).convert("1", dither=Image.NONE) for plane in data]
        for compression in (None, "group4", "packbits"):
            pages[0].save(self.path, save_all=True, append_images=pages[1:], **({"compression": compression} if compression else {}))
            self.reads(data.astype("u1"))

    def test_previews_and_reduced_pages_are_left_out_and_named(self):
        data = numbers((4, 40, 30), "u2")
        small = numbers((20, 15, 3), "u1")

        def write(*pages):
            with tifffile.TiffWriter(self.path) as file:
                for page, kind in pages:
                    file.write(page, photometric="rgb" if page.ndim == 3 else "minisblack", subfiletype=kind, metadata=None)
        volume = [(plane, 0) for plane in data]
        for pages, words in (([(small, 0), *volume], ("1 page is left out", "page 0 (a preview of 15 x 20 x 3 samples uint8)")),
                             ([*volume, (small, 0)], ("page 4 (a preview",)),
                             ([(small, 0), *volume, (data[0, ::2, ::2], 0)], ("2 pages are left out", "page 0 (", "page 5 (a preview of 15 x 20 uint16")),
                             ([(data[0, ::2, ::2], 1), *volume], ("page 0 (a reduced image)",)),
                             ([*volume[:2], (small, 1), *volume[2:], (data[0] > 5, 4)], ("page 2 (a reduced image)", "page 5 (a mask)")),
                             ([v for plane in volume for v in (plane, (plane[0][::2, ::2], 1))], ("4 pages are left out",))):
            with self.subTest(words=words):
                write(*pages)
                with tifffile.TiffFile(self.path) as file:
                    self.assertEqual(len(file.pages), len(pages))
                done = self.reads(data)
                for word in words:
                    self.assertIn(word, done.stdout + done.stderr)
        # A plane with smaller copies that are not marked as such.
        write((data[0], 0), (data[0, ::2, ::2], 0), (data[0, ::4, ::4], 0))
        done = self.reads(data[:1])
        self.assertIn("2 pages are left out", done.stdout + done.stderr)
        for pages, words in (([*volume[:2], (small, 0), *volume[2:]], ("page 2: it is 15 x 20 x 3 samples uint8, but most pages are 30 x 40 uint16",)),
                             ([*volume, (data[0, :, :20], 0)], ("page 4: it is 20 x 40",)),
                             ([*volume, (data[0, :25, :20], 0)], ("page 4: it is 20 x 25",)),
                             ([*volume, (data[0].astype("u1"), 0)], ("page 4: it is 30 x 40 uint8",)),
                             ([(small, 1)], ("all pages are reduced",))):
            with self.subTest(words=words):
                write(*pages)
                self.refuses(5, *words)
        # A preview with unsupported colours does not end the set.
        if shutil.which("tiffcp"):
            jpeg, planes = self.here / "jpeg.tif", self.here / "planes.tif"
            tifffile.imwrite(jpeg, small, photometric="rgb")
            subprocess.run(["tiffcp", "-c", "jpeg", jpeg, self.here / "preview.tif"], check=True, capture_output=True)
            tifffile.imwrite(planes, data, photometric="minisblack", metadata=None)
            subprocess.run(["tiffcp", self.here / "preview.tif", self.path], check=True, capture_output=True)
            subprocess.run(["tiffcp", "-a", planes, self.path], check=True, capture_output=True)
            done = self.reads(data)
            self.assertIn("page 0 (a preview", done.stdout + done.stderr)
        # In a folder of single pages a smaller one is not a preview.
        self.path = self.stack([data[0], data[1], data[2, ::2, ::2]], ["0.tif", "1.tif", "2.tif"])
        self.refuses(5, "2.tif", "15 x 20 uint16")

    def test_whole_axes_of_pages_and_samples(self):
        data = numbers((5, 7, 9), "u2")
        for axes, name in (("TYX", "t"), ("CYX", "c")):
            tifffile.imwrite(self.path, data, imagej=True, metadata={"axes": axes})
            self.refuses(5, f"--index {name}=0", f"--index {name}=:")
            done = self.reads(data, "--index", f"{name}=:")
            self.assertIn("used as z, with a spacing of 1", done.stdout + done.stderr)
            self.reads(data[3], "--index", f"{name}=3")
        colours = numbers((7, 9, 3), "u2")
        for planar in ("contig", "separate"):
            tifffile.imwrite(self.path, colours if planar == "contig" else np.moveaxis(colours, -1, 0), photometric="rgb", planarconfig=planar, metadata=None)
            self.reads(np.ascontiguousarray(np.moveaxis(colours, -1, 0)), "--index", "c=:")
        tifffile.imwrite(self.path, numbers((4, 7, 9, 3), "u1"), photometric="rgb", truncate=True)
        self.reads(np.ascontiguousarray(np.moveaxis(tifffile.imread(self.path)[2], -1, 0)), "--index", "c=:,z=2")

    def test_a_damaged_tag_that_decides_numbers_is_not_left_out(self):
        data = numbers((3, 20, 17))
        for tag, options in ((317, {"compression": "zlib", "predictor": True}), (339, {}), (324, {"tile": (16, 16)}), (273, {})):
            with self.subTest(tag=tag):
                tifffile.imwrite(self.path, data.astype("i2"), photometric="minisblack", metadata=None, **options)
                with tifffile.TiffFile(self.path) as file:
                    at = file.pages[2].tags[tag].offset
                whole = bytearray(self.path.read_bytes())
                self.reads(data.astype("i2"))
                whole[at + 2:at + 4] = struct.pack("<H", 1 if tag in (273, 324) else 2)  # another type
                self.path.write_bytes(whole)
                self.refuses(4, "page 2: the directory", tifffile.TIFF.TAGS[tag])

    def test_damaged_files(self):
        for options in ({}, {"tile": (16, 16)}, {"bigtiff": True}):
            tifffile.imwrite(self.path, numbers((3, 20, 17)), photometric="minisblack", **options)
            whole = self.path.read_bytes()
            for i in range(60):
                data = bytearray(whole)
                for _ in range(RANDOM.integers(1, 4)):
                    data[RANDOM.integers(len(data))] = RANDOM.integers(256)
                if i % 4 == 0:
                    del data[RANDOM.integers(len(data)):]
                self.path.write_bytes(data)
                done = self.preprocess("--memory", "256M")
                self.assertIn(done.returncode, (0, 2, 3, 4, 5, 6, 7), (i, done.stderr))


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1])
