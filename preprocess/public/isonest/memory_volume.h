// A volume in memory as a source.
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <utility>

#include <isonest/frame.h>
#include <isonest/int3.h>
#include <isonest/length_unit.h>
#include <isonest/uneven_axes.h>
#include <isonest/value_type.h>
#include <isonest/volume_source.h>

namespace isonest {

/// Memory layout of an array and its place in the world.
struct MemoryLayout {
    /// Bytes from a node to the next one along x, y and z; may be negative and need no alignment.
    /// Not given: dense, x fastest. For a NumPy array [z][y][x] these are its strides in reverse
    /// order.
    std::optional<Int3> strides = {};
    Double3 spacing{1, 1, 1};  ///< node distance per axis in world units
    Double3 origin{0, 0, 0};   ///< world position of node (0, 0, 0)
    std::string name = "memory";
    std::optional<LengthUnit> unit = {};               ///< length of a world unit, if known
    AnatomicalFrame frame = AnatomicalFrame::unknown;  ///< of the world axes
    Directions direction = kAlongWorld;
    UnevenAxesPtr uneven = {};  ///< spacing is then the mean step along these axes
};

/// A volume in memory owned by the caller, which must stay in place and unchanged for the lifetime
/// of this object. Dense, aligned data are read in place; other layouts are copied a few planes at
/// a time. Thread-safety: one thread at a time.
///
///     std::vector<float> values(nx * ny * nz);
///     isonest::MemoryVolume volume(values.data(), {nx, ny, nz});
class MemoryVolume : public VolumeSource {
  public:
    /// `data`: node (0, 0, 0). `nodes`: per axis (x, y, z). T: one of the eight types of ValueType.
    /// Throws Error{invalid_argument} if there is no data or an axis has no nodes.
    template <class T>
    MemoryVolume(const T* data, const Int3& nodes, MemoryLayout layout = {})
        : MemoryVolume(data, value_type_of<T>, nodes, std::move(layout)) {}
    /// The same with the type known only at run time.
    MemoryVolume(const void* data, ValueType type, const Int3& nodes, MemoryLayout layout = {});

    [[nodiscard]] VolumeDescription describe() const override;
    /// A digest (XXH64) of all values in the order of read(), therefore independent of the strides.
    /// Recomputed at every call.
    [[nodiscard]] std::string identity() const override;
    void read(std::int64_t z0, std::int64_t nz, std::int64_t y0, std::int64_t ny,
              std::byte* dst) override;
    [[nodiscard]] std::uint64_t heap() const override { return 0; }
    [[nodiscard]] std::span<const std::byte> mapped() const override;

  private:
    /// Copies `count` values along x, starting at (x, y, z).
    void copy(const Int3& from, std::int64_t count, std::byte* dst) const;

    const std::byte* data_;
    ValueType type_;
    Int3 nodes_;
    Int3 strides_;
    MemoryLayout layout_;
};

}  // namespace isonest
