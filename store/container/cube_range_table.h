// The ranges of cubes in a store's file.
#pragma once

#include <atomic>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "store/container/format.h"

namespace isonest::detail {

/// Reads from a map of the file; a plane of cubes is compared with its checksum when it is first
/// asked for. Thread-safety: const methods from any thread.
class CubeRangeTable {
  public:
    CubeRangeTable() = default;
    /// `file`: HDF5's handle of the open store; `bytes`: its map, which must outlive this; `name`:
    /// of the store, for errors. Throws Error{corrupt}.
    CubeRangeTable(std::int64_t file, const StoreLayout& layout, std::span<const std::byte> bytes,
                   std::string name);

    /// Nothing where the level has no ranges, and outside of the volume. Throws Error{corrupt}.
    [[nodiscard]] std::optional<CubeRange> at(int level, const Int3& cube) const;

  private:
    struct Level {
        Int3 cells;
        std::size_t plane_bytes = 0;
        std::span<const std::byte> ranges;
        std::span<const std::byte> sums;
        std::unique_ptr<std::atomic<bool>[]> seen;  ///< planes that are known to be whole
    };
    void require_whole(const Level& l, int level, std::int64_t z) const;

    std::string name_;  ///< of the store
    ValueType type_ = ValueType::f32;
    std::vector<Level> levels_;  ///< from kFirstRangeLevel on
};

}  // namespace isonest::detail
