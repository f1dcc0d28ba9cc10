// Volumes in files: which formats are read, and how.
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

/// What is taken of one axis of an array in a file: the whole axis, or one position on it.
struct AxisIndex {
    std::string axis = {};  ///< its name or number; empty: the entries are all axes, slowest first
    std::optional<std::int64_t> at =
        {};  ///< position; negative: from the end; none: the whole axis
};

/// Nodes [from, to) of an axis, as in a slice of NumPy: negative counts from the end, nothing is
/// the end itself.
struct NodeRange {
    std::optional<std::int64_t> from = {};
    std::optional<std::int64_t> to = {};
};

/// How to interpret an input that does not describe itself, or to override what it says.
struct SourceOptions {
    std::string dataset;  ///< the array in a file of several (HDF5, NetCDF, Zarr, OpenVDB, .npz):
                          ///< its path or name; empty = the only one
    std::string series;   ///< DICOM: the series' UID; empty = the only one
    std::vector<AxisIndex> index;         ///< of arrays with time steps, channels, components
    std::optional<Int3> dims;             ///< raw: nodes per axis
    std::optional<ValueType> type;        ///< raw: value type
    std::optional<bool> big_endian;       ///< raw: instead of little
    std::optional<std::uint64_t> offset;  ///< raw: bytes to skip (of the decompressed stream)
    std::array<NodeRange, 3> crop = {};   ///< the part that is taken, along x, y and z
    Int3 every{1, 1, 1};                  ///< of what is left, each `every`-th node, from the first
    std::optional<Double3> spacing;       ///< overrides the file's (before `every`)
    std::optional<Double3> origin;        ///< overrides the file's (before the crop)
    std::optional<LengthUnit> unit;       ///< of spacing and origin, overrides the file's: numbers
                                          ///< stay as they are
    std::optional<AnatomicalFrame> frame;  ///< of the world's axes, overrides the file's: numbers
                                           ///< stay as they are
    std::optional<double> missing;         ///< this value stands for missing data
    /// Integers of 64 bits are labels, the names of things: kept as they are, not as the float64
    /// that is nearest (from 0 to 2^62 - 1). Of smaller integers it changes no number. Names and
    /// colours that the input has for its labels are read (VolumeSource::label_names()); what of
    /// them makes no sense is left out, with a note.
    bool labels = false;
    /// A table of names and colours of labels, in place of what the input says of them: lines of
    /// 'ID NAME RED GREEN BLUE OPACITY' as FreeSurfer and 3D Slicer have them, of ITK-SNAP's label
    /// descriptions, or of 'ID NAME'. Needs `labels`.
    std::filesystem::path label_names = {};
    std::uint64_t max_heap = 256u << 20;  ///< a source may not hold more than this many bytes
    /// Of volumes at URLs: how they are reached. Its memory is beside max_heap.
    RemoteAccess remote = {};
};

/// Opens one file, a folder, or several files that are one volume (slices). What they are is told
/// by their first bytes, or what lies in the folder; never by a name, except raw numbers, which
/// nothing describes (they need dims and type, and may be gzip). Throws Error{not_found} for a
/// missing file or dataset (listing the datasets there are), Error{invalid_argument} for options
/// that do not fit the file (wrong size: says the expected and the actual byte counts) or its
/// format (dims for HDF5), Error{unsupported} for types or encodings we do not read, and for
/// formats that this build does not (naming the missing package), Error{corrupt} for damaged
/// headers, Error{limit} if one input chunk exceeds max_heap.
std::unique_ptr<VolumeSource> open_volume(const std::vector<std::filesystem::path>& paths,
                                          const SourceOptions& options = {});
std::unique_ptr<VolumeSource> open_volume(const std::filesystem::path& path,
                                          const SourceOptions& options = {});

/// Opens what a pipe or a terminal gives: all of it is first copied to an unnamed file in
/// `scratch_folder`. Runs from it cannot be resumed. Throws as open_volume(), and Error{io}.
std::unique_ptr<VolumeSource> open_volume_stream(int descriptor,
                                                 const std::filesystem::path& scratch_folder,
                                                 const SourceOptions& options = {});

/// A format that open_volume() knows.
struct InputFormat {
    std::string name;        ///< "NRRD"
    std::string extensions;  ///< ".nrrd .nhdr": how such files usually end
    std::string package;  ///< empty: this build reads it; else what has to be installed (Debian's
                          ///< name) before isonest is built
};
std::vector<InputFormat> input_formats();

}  // namespace isonest
