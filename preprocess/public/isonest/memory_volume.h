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
#include <isonest/value_type.h>
#include <isonest/volume_source.h>

namespace isonest {

/// How an array lies in memory, and where it is in the world.
struct MemoryLayout {
    /// Bytes from a node to the next one along x, y and z, of either sign and any alignment. Not
    /// given: dense, x fastest. For an array [z][y][x] of NumPy these are its strides backwards.
    std::optional<Int3> strides = {};
    Double3 spacing{1, 1, 1};  ///< node distance per axis in world units
    Double3 origin{0, 0, 0};   ///< world position of node (0, 0, 0)
    std::string name = "memory";
    std::optional<LengthUnit> unit = {};  ///< that a world unit is, if known
    AnatomicalFrame frame = AnatomicalFrame::unknown;  ///< of the world's axes
};

/// Numbers that someone else owns, which must stay there and as they are for the volume's life.
/// What is dense and aligned is read where it lies; other layouts are copied a few planes at a
/// time. Thread-safety: one thread at a time.
///
///     std::vector<float> values(nx * ny * nz);
///     isonest::MemoryVolume volume(values.data(), {nx, ny, nz});
class MemoryVolume : public VolumeSource {
  public:
    /// `data`: node (0, 0, 0). `nodes`: per axis (x, y, z). T: one of the eight types of ValueType.
    /// Throws Error{invalid_argument} if there are no data or an axis has no node.
    template <class T>
    MemoryVolume(const T* data, const Int3& nodes, MemoryLayout layout = {})
        : MemoryVolume(data, value_type_of<T>, nodes, std::move(layout)) {}
    /// The same where the type is only known at run time.
    MemoryVolume(const void* data, ValueType type, const Int3& nodes, MemoryLayout layout = {});

    [[nodiscard]] VolumeDescription describe() const override;
    /// A digest (XXH64) of all values in the order of read(), so the same for any strides; made
    /// anew at every call.
    [[nodiscard]] std::string identity() const override;
    void read(std::int64_t z0, std::int64_t nz, std::int64_t y0, std::int64_t ny,
              std::byte* dst) override;
    [[nodiscard]] std::uint64_t heap() const override { return 0; }
    [[nodiscard]] std::span<const std::byte> mapped() const override;

  private:
    /// `count` values from (x, y, z) on, along x.
    void copy(const Int3& from, std::int64_t count, std::byte* dst) const;

    const std::byte* data_;
    ValueType type_;
    Int3 nodes_;
    Int3 strides_;
    MemoryLayout layout_;
};

}  // namespace isonest
