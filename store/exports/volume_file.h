// Plain volume files that are written slab by slab or box by box: HDF5, NRRD, NIfTI, VTI,
// NumPy, MetaImage, raw.
#pragma once

#include <filesystem>
#include <memory>
#include <optional>

#include <isonest/frame.h>
#include <isonest/int3.h>
#include <isonest/length_unit.h>
#include <isonest/value_type.h>

namespace isonest::detail {

/// A file that takes a volume in ascending planes, or in boxes in any order. It appears whole under
/// its name or not at all. Thread-safety: one thread.
class VolumeFile {
  public:
    VolumeFile() = default;
    VolumeFile(const VolumeFile&) = delete;
    VolumeFile& operator=(const VolumeFile&) = delete;
    virtual ~VolumeFile() = default;
    /// The next `count` planes, x fastest. Throws Error{io}.
    virtual void write(const std::byte* planes, std::int64_t count) = 0;
    /// `size` nodes from `lo` on, x fastest. REQUIRES: the box lies in the volume; write() is not
    /// called for the same file. Throws Error{io}.
    virtual void write_box(const Int3& lo, const Int3& size, const std::byte* data) = 0;
    /// REQUIRES: all nodes were written. Throws Error{io, invalid_argument}.
    virtual void finish() = 0;
};

struct VolumeFileSpec {
    Int3 nodes{1, 1, 1};
    ValueType type = ValueType::f32;
    Double3 spacing{1, 1, 1};
    Double3 origin{0, 0, 0};
    Directions direction = kAlongWorld;
    bool force = false;
    std::optional<LengthUnit> unit = {};  ///< of spacing and origin, written where it fits
    /// Of origin and direction. NIfTI files are of RAS, MetaImage files of LPS: they get the same
    /// place in that frame. NRRD and HDF5 say it; the others say no frame, and have the place as it
    /// is, as all have it where the frame is unknown.
    AnatomicalFrame frame = AnatomicalFrame::unknown;
    bool is_int64 = false;  ///< the numbers are int64; `type` is another one of their size
};

/// By the name's ending: .h5 or .hdf5 (dataset /data, [z, y, x], with attributes spacing and origin
/// in x, y, z order), .nrrd, .nii, .vti, .npy, .mha, .raw (no header). Throws
/// Error{invalid_argument, not_found, io}.
std::unique_ptr<VolumeFile> create_volume_file(const std::filesystem::path& path,
                                               const VolumeFileSpec& spec);

}  // namespace isonest::detail
