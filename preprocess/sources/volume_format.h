// What a file format must provide so that open_volume() can use it, and the list of formats.
#pragma once

#include <filesystem>
#include <memory>
#include <string>
#include <vector>

#include <isonest/error.h>
#include <isonest/open_volume.h>
#include <isonest/volume_source.h>

#include "preprocess/sources/bytes/input_file.h"
#include "preprocess/sources/bytes/remote_objects.h"

namespace isonest::detail {

/// What the caller specified: a file, a folder, or several files.
struct VolumeInput {
    std::vector<std::filesystem::path> paths;  ///< at least one, in the caller's order
    bool folder = false;                       ///< paths[0] is a folder
    bool remote = false;                       ///< paths are URLs
    /// How URLs are read; null for files.
    std::shared_ptr<RemoteObjects> elsewhere = nullptr;
    /// paths[0], or the object at that URL; empty for a URL that is taken for a folder.
    InputFile file = {};
    /// Why a URL that is taken for a folder names no object; null if its name says that it is one.
    std::shared_ptr<const Error> missing = nullptr;
    /// The first bytes of paths[0], up to kHeadBytes; empty for a folder.
    std::string head = {};
    /// The same after decompression if the file is gzip; otherwise equal to `head`.
    std::string unpacked = {};
    [[nodiscard]] bool gzip() const { return unpacked != head; }
    static constexpr std::size_t kHeadBytes = 1024;
    /// REQUIRES: not used in messages if remote, as it may contain credentials.
    [[nodiscard]] const std::filesystem::path& path() const { return paths.front(); }
    /// For messages.
    [[nodiscard]] std::string name() const;
    /// The files of a volume with a file for each slice, in natural order: those in the folder
    /// whose extension is one of these (files_in()), or all.
    [[nodiscard]] std::vector<std::filesystem::path> slices(
        const std::vector<std::string_view>& extensions) const;
    /// The name of such a volume, for messages. `files`: its slices.
    [[nodiscard]] std::string name_of_slices(const std::vector<std::filesystem::path>& files) const;
};

/// The members of SourceOptions that apply to a format; the others are refused.
struct FormatOptions {
    bool dataset = false;
    bool index = false;
    bool series = false;
    bool numbers = false;  ///< dims, type, big_endian, offset
};

struct VolumeFormat {
    InputFormat about;
    FormatOptions takes;
    bool several_files = false;  ///< several files can form one volume
    bool reads_urls = false;     ///< recognises() and open() also accept URLs
    /// Decides by the first bytes, or by what is in the folder. Reads little; never throws because
    /// of damage. Not called for remote folders if the format reads no URLs.
    bool (*recognises)(const VolumeInput&);
    /// Null if this build does not read the format. The caller handles crop, every, spacing, origin
    /// and missing; a format may use spacing only to decide what to refuse.
    std::unique_ptr<VolumeSource> (*open)(const VolumeInput&, const SourceOptions&);
};

/// All formats, in the order in which they are tried. Raw numbers come last because they recognise
/// everything.
const std::vector<VolumeFormat>& volume_formats();

// DICOM: a file, a folder or a list of files with the images of a series.

VolumeFormat dicom_format();

// A volume in an HDF5 dataset.

/// Whether the file has HDF5's signature: at its start, or after a user block of 512, 1024, 2048
/// ... bytes (MATLAB 7.3); in a remote object, of up to 32 KiB. Throws Error{io}.
bool is_hdf5(const InputFile& file);

VolumeFormat hdf5_format();

// MetaImage, the format of ITK.

/// Header and numbers in one file (.mha) or in two (.mhd).
/// Source: https://itk.org/Wiki/ITK/MetaIO/Documentation
VolumeFormat meta_image_format();

// FreeSurfer volumes: .mgh, and compressed by gzip .mgz.

/// Source: https://surfer.nmr.mgh.harvard.edu/fswiki/FsTutorial/MghFormat
VolumeFormat mgh_format();

// MRC/CCP4 maps of electron microscopy and crystallography.

/// Source: https://www.ccpem.ac.uk/mrc_format/mrc2014.php (MRC2014); IMOD's flag for unsigned
/// bytes: https://bio3d.colorado.edu/imod/doc/mrc_format.txt
VolumeFormat mrc_format();

// NetCDF classic files; NetCDF-4 files are HDF5.

VolumeFormat netcdf3_format();

// NIfTI-1 and NIfTI-2 images.

/// One file (.nii, .nii.gz), or a header and an image (.hdr, .img), either of which may be given.
VolumeFormat nifti_format();

// NRRD files, with attached or detached header.

/// Source: http://teem.sourceforge.net/nrrd/format.html
VolumeFormat nrrd_format();

// NumPy arrays: .npy, and .npz with several of them.

/// Source: https://numpy.org/doc/stable/reference/generated/numpy.lib.format.html
VolumeFormat npy_format();
/// An archive of such files, each stored or deflated.
VolumeFormat npz_format();

// OpenVDB: sparse grids of float32 or float64.

VolumeFormat vdb_format();

// Raw numbers: a file without a header.

/// The caller must describe the numbers; recognises every file.
VolumeFormat raw_format();

// Stacks of images: a folder or a list of PNG or BMP files, or a single one.

/// Grey images of 1 to 16 bits, and colour images whose pixels are all grey. Needs libpng.
VolumeFormat png_format();

/// Uncompressed; grey by a palette, and colour images whose pixels are all grey.
VolumeFormat bmp_format();

// TIFF: one file with one or many pages, a folder of files, or a list of them.

/// Also BigTIFF, tiles, and every compression that the installed libtiff decodes.
/// Sources: TIFF 6.0, https://www.itu.int/itudoc/itu-t/com16/tiff-fx/docs/tiff6.pdf;
/// https://docs.openmicroscopy.org/ome-model/6.2.2/ome-tiff/specification.html (OME-TIFF);
/// https://imagej.net/ij/docs/guide/146-6.html#sub:Image-Types-and-Formats (ImageJ's description).
VolumeFormat tiff_format();

// VTK images: legacy files (.vtk) and XML (.vti).

/// STRUCTURED_POINTS or RECTILINEAR_GRID, binary (big endian) or text.
/// Source: https://docs.vtk.org/en/latest/vtk_file_formats/vtk_legacy_file_format.html
VolumeFormat vtk_format();

/// One or several pieces. The numbers are appended (raw or base64), inline in base64, or text; they
/// are uncompressed or compressed by zlib, LZ4 or LZMA. Needs expat. Source:
/// https://docs.vtk.org/en/latest/design_documents/VTKFileFormats.html
VolumeFormat vti_format();

// Zarr arrays of versions 2 and 3, with shards, and OME-Zarr images.

/// A folder with an array or a group. Chunks are decoded by many threads.
VolumeFormat zarr_format();

}  // namespace isonest::detail
