// Volumes in files: the supported formats and how to read them.
#pragma once

#include <array>
#include <cstdint>
#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include <isonest/int3.h>
#include <isonest/length_unit.h>
#include <isonest/remote.h>
#include <isonest/value_type.h>
#include <isonest/volume_source.h>

namespace isonest {

/// What to read of one axis of an array in a file: the whole axis, or one position on it.
struct AxisIndex {
    std::string axis = {};  ///< its name or number; empty: the entries are all axes, slowest first
    std::optional<std::int64_t> at =
        {};  ///< position; negative: from the end; none: the whole axis
};

/// Nodes [from, to) of an axis, as in a NumPy slice: negative numbers count from the end; without a
/// number, the range reaches to the end of the axis on that side.
struct NodeRange {
    std::optional<std::int64_t> from = {};
    std::optional<std::int64_t> to = {};
};

/// How to interpret an input that does not describe itself, or overrides for what it says.
struct SourceOptions {
    std::string dataset;  ///< the array in a file with several (HDF5, NetCDF, Zarr, OpenVDB, .npz):
                          ///< its path or name; empty = the only one
    std::string series;   ///< DICOM: the series' UID; empty = the only one
    std::vector<AxisIndex> index;         ///< for arrays with time steps, channels or components
    std::optional<Int3> dims;             ///< raw: nodes per axis
    std::optional<ValueType> type;        ///< raw: value type
    std::optional<bool> big_endian;       ///< raw: big instead of little endian
    std::optional<std::uint64_t> offset;  ///< raw: bytes to skip (of the decompressed stream)
    std::array<NodeRange, 3> crop = {};   ///< the part to read, along x, y and z
    Int3 every{1, 1, 1};  ///< then keep every `every`-th node, starting with the first
    /// Along x, y and z: what is left is one period, which `repeat` repeats. The first nodes follow
    /// once more after the last ones, so a surface closes across the seam.
    std::array<bool, 3> periodic{};
    Int3 repeat{1, 1, 1};            ///< number of periods; 1 along axes that are not periodic
    std::optional<Double3> spacing;  ///< overrides the file's (before `every`)
    std::optional<Double3> origin;   ///< overrides the file's (before the crop)
    /// Unit of spacing and origin; overrides the file's unit, the numbers do not change.
    std::optional<LengthUnit> unit;
    /// Frame of the world axes; overrides the file's frame, the numbers do not change.
    std::optional<AnatomicalFrame> frame;
    std::optional<double> missing;  ///< this value marks missing data
    /// The values are labels. 64-bit integers (from 0 to 2^62 - 1) are kept exactly instead of
    /// being rounded to the nearest float64; smaller integers do not change. Names and colours of
    /// labels in the input are read (VolumeSource::label_names()); invalid ones are skipped with a
    /// note.
    bool labels = false;
    /// A table of label names and colours, replacing those of the input: lines of 'ID NAME RED
    /// GREEN BLUE OPACITY' (FreeSurfer, 3D Slicer), ITK-SNAP label descriptions, or lines of 'ID
    /// NAME'. Requires `labels`.
    std::filesystem::path label_names = {};
    std::uint64_t max_heap = 256u << 20;  ///< maximum bytes that a source may hold
    /// Access to volumes at URLs. Its memory is not part of max_heap.
    RemoteAccess remote = {};
};

/// Opens one file, a folder, or several files that form one volume (slices). The format is detected
/// from the first bytes, or from the contents of the folder, never from a name. The exception is
/// raw numbers, which do not describe themselves: they need dims and type, and may be compressed
/// with gzip. Throws Error{not_found} for a missing file or dataset (listing the existing
/// datasets), Error{invalid_argument} for options that do not match the file (wrong size: with the
/// expected and the actual byte counts) or its format (dims for HDF5), Error{unsupported} for types
/// or encodings that isonest does not read, and for formats that this build does not read (naming
/// the missing package), Error{corrupt} for damaged headers, Error{limit} if one input chunk
/// exceeds max_heap.
std::unique_ptr<VolumeSource> open_volume(const std::vector<std::filesystem::path>& paths,
                                          const SourceOptions& options = {});
std::unique_ptr<VolumeSource> open_volume(const std::filesystem::path& path,
                                          const SourceOptions& options = {});

/// Opens a volume from a pipe or a terminal. All of it is first copied to an unnamed file in
/// `scratch_folder`. Runs that read it cannot be resumed. Throws as open_volume(), and Error{io}.
std::unique_ptr<VolumeSource> open_volume_stream(int descriptor,
                                                 const std::filesystem::path& scratch_folder,
                                                 const SourceOptions& options = {});

/// A format that open_volume() knows.
struct InputFormat {
    std::string name;        ///< "NRRD"
    std::string extensions;  ///< ".nrrd .nhdr": the usual extensions of such files
    std::string package;     ///< empty if this build reads the format; else the Debian package to
                             ///< install before building isonest
};
std::vector<InputFormat> input_formats();

/// The format of a local file or folder, detected from the first bytes and named as in
/// input_formats(): "NIfTI". Empty for raw numbers, unreadable files and unknown formats.
std::string input_format_of(const std::filesystem::path& path);

/// Whether the file is local and of a format in which each file holds a whole volume, so that
/// several files are several volumes. False for slices, folders, raw numbers, unreadable files and
/// unknown formats.
bool holds_whole_volume(const std::filesystem::path& path);

}  // namespace isonest
