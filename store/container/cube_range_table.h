// The ranges of cubes in a store's file.
#pragma once

#include <atomic>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <mutex>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "store/bytes/store_bytes.h"
#include "store/container/footer/catalogue.h"
#include "store/container/format.h"

namespace isonest::detail {

/// A plane of cubes is compared with its checksum when it is first asked for. Of a store that is
/// far away, only levels whose ranges are at most kMostFar bytes are read, all of them when one is
/// first asked for: ranges only leave out work, and those of finer levels can be more bytes than
/// the chunks that they would leave out (of 2049^3 nodes of a byte 32 MiB on level 3, 64 KiB on
/// level 6). Thread-safety: const methods from any thread.
class CubeRangeTable {
  public:
    static constexpr std::uint64_t kMostFar = std::uint64_t{256} << 10U;

    CubeRangeTable() = default;
    /// Places from HDF5's structures; `file`: its handle of the open store. `bytes` must outlive
    /// this. Throws Error{corrupt, io}.
    CubeRangeTable(std::int64_t file, const StoreLayout& layout, const StoreBytes& bytes);
    /// Places from the catalogue, which must outlive this, as `bytes` must. Throws Error{corrupt,
    /// io}.
    CubeRangeTable(const Catalogue& catalogue, const StoreLayout& layout, const StoreBytes& bytes);

    /// Nothing where the level has no ranges, where they are not read, and outside of the volume.
    /// Throws Error{corrupt, io}.
    [[nodiscard]] std::optional<CubeRange> at(int level, const Int3& cube) const;
    /// Of all cubes of a plane, x fastest, also where at() reads none. REQUIRES: the level has
    /// ranges and such a plane. Throws Error{corrupt, io}.
    [[nodiscard]] std::vector<CubeRange> plane(int level, std::int64_t z) const;
    /// Tells a store that is far that all planes of a level are needed soon.
    void want(int level) const;

  private:
    struct Level {
        Int3 cells;
        std::uint64_t plane_bytes = 0;
        std::uint64_t offset = 0;
        HeldBytes sums;
        HeldBytes ranges;                           ///< of a store that is far: read later
        bool is_read = true;                        ///< at some time
        std::unique_ptr<std::atomic<bool>[]> seen;  ///< planes that are known to be whole

        [[nodiscard]] std::uint64_t bytes() const {
            return static_cast<std::uint64_t>(cells.z) * plane_bytes;
        }
        [[nodiscard]] ByteRange plane(std::int64_t z) const {
            return {offset + static_cast<std::uint64_t>(z) * plane_bytes, plane_bytes};
        }
    };
    /// `offset`: of the ranges; nothing if they are not as the layout says.
    void add(const StoreLayout& layout, int level, std::optional<std::uint64_t> offset,
             HeldBytes sums);
    void require_whole(const Level& l, int level, std::int64_t z) const;
    [[noreturn]] void fail_plane(int level, std::int64_t z) const;
    static std::uint64_t sum_of(const Level& l, std::int64_t z);
    [[nodiscard]] CubeRange range_in(std::span<const std::byte> bytes, std::int64_t cube) const;
    [[nodiscard]] HeldBytes read_plane(const Level& l, int level, std::int64_t z) const;
    void read_far() const;

    const StoreBytes* bytes_ = nullptr;
    ValueType type_ = ValueType::f32;
    mutable std::vector<Level> levels_;     ///< from kFirstRangeLevel on
    std::unique_ptr<std::once_flag> read_;  ///< of a store that is far: the ranges
};

}  // namespace isonest::detail
