// Plain volume files that are written slab by slab or box by box: HDF5, NRRD, NIfTI, VTI,
// NumPy, MetaImage, raw.
#pragma once

#include <cstdint>
#include <filesystem>
#include <memory>
#include <optional>
#include <string>

#include <isonest/frame.h>
#include <isonest/int3.h>
#include <isonest/length_unit.h>
#include <isonest/uneven_axes.h>
#include <isonest/value_type.h>

namespace isonest::detail {

/// A file that is filled with a volume in ascending planes, or in boxes in any order. It appears
/// complete under its name or not at all. Thread-safety: one thread.
class VolumeFile {
  public:
    VolumeFile() = default;
    VolumeFile(const VolumeFile&) = delete;
    VolumeFile& operator=(const VolumeFile&) = delete;
    virtual ~VolumeFile() = default;
    /// Appends `count` planes, x fastest. Throws Error{io}.
    virtual void write(const std::byte* planes, std::int64_t count) = 0;
    /// Writes `size` nodes starting at `lo`, x fastest. REQUIRES: the box lies in the volume;
    /// write() is not called for the same file. Throws Error{io}.
    virtual void write_box(const Int3& lo, const Int3& size, const std::byte* data) = 0;
    /// REQUIRES: all nodes were written. Throws Error{io, invalid_argument}.
    virtual void finish() = 0;
    /// Maximum bytes held between two calls of write_box(), if boxes come with x fastest and have
    /// this many rows along x.
    [[nodiscard]] virtual std::uint64_t held(std::uint64_t rows) const {
        static_cast<void>(rows);
        return 0;
    }
};

struct VolumeFileSpec {
    Int3 nodes{1, 1, 1};
    ValueType type = ValueType::f32;
    Double3 spacing{1, 1, 1};
    Double3 origin{0, 0, 0};
    Directions direction = kAlongWorld;
    bool force = false;
    std::optional<LengthUnit> unit = {};  ///< of spacing and origin; written if the format supports
                                          ///< it
    /// Frame of origin and direction. NIfTI files are in RAS and MetaImage files in LPS: the
    /// position is converted to that frame. NRRD and HDF5 name the frame. The others have no frame
    /// and keep the position unchanged, as do all formats if the frame is unknown.
    AnatomicalFrame frame = AnatomicalFrame::unknown;
    /// Formats with a place hold only even axes.
    UnevenAxesPtr uneven = {};
    bool is_curved = false;  ///< the nodes are those of a curvilinear grid
    bool is_int64 = false;   ///< the numbers are int64; `type` is another type of the same size
};

/// Chooses the format by the extension: .h5 or .hdf5 (dataset /data, [z, y, x], with attributes
/// spacing and origin in x, y, z order), .nrrd, .nii, .vti, .npy, .mha, .raw (no header). Throws
/// Error{invalid_argument, not_found, io}, and Error{unsupported} for uneven axes in a format with
/// a place.
std::unique_ptr<VolumeFile> create_volume_file(const std::filesystem::path& path,
                                               const VolumeFileSpec& spec);

// What precedes (and follows) the numbers in plain volume files.

/// The numbers follow `before`, little endian, x fastest, and are followed by `behind`.
struct VolumeHeader {
    std::string before;
    std::string behind = {};
    /// The numbers, preceded by their length in bytes (uint64), are one base64 text.
    bool in_base64 = false;
};

/// Source: http://teem.sourceforge.net/nrrd/format.html
VolumeHeader nrrd_file_header(const VolumeFileSpec& spec);
/// NIfTI-1; NIfTI-2 if an axis has more than 32767 nodes. World coordinates are in the sform.
/// Source: https://nifti.nimh.nih.gov/pub/dist/src/niftilib/nifti1.h, nifti2.h
VolumeHeader nifti_file_header(const VolumeFileSpec& spec);
/// Source: https://docs.vtk.org/en/latest/design_documents/VTKFileFormats.html
VolumeHeader vti_file_header(const VolumeFileSpec& spec);
/// An array [z, y, x], without a position in the world.
/// Source: https://numpy.org/doc/stable/reference/generated/numpy.lib.format.html
VolumeHeader npy_file_header(const VolumeFileSpec& spec);
/// Source: https://itk.org/Wiki/ITK/MetaIO/Documentation
VolumeHeader meta_image_file_header(const VolumeFileSpec& spec);

}  // namespace isonest::detail
