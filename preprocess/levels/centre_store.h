// The centre values of each level's cubes (or squares, see Lattice::elements_at()) on disk; the
// next two levels need them.
#pragma once

#include <filesystem>
#include <span>
#include <vector>

#include <isonest/field.h>

#include "preprocess/indicators/layer.h"
#include "store/container/format.h"
#include "store/files/scratch_file.h"
#include "store/lattice/lattice.h"

namespace isonest::detail {

/// Cubes of level kFirstRangeLevel along an axis of a base block, which has 2 `chunk` nodes.
constexpr std::int64_t cube_ranges_per_block(std::int64_t chunk) {
    return 2 * chunk / kFirstRangeEdge;
}

/// Saturated values of cube centres per level, as binary32 in a temporary file, so that the 16-bit
/// rounding of the stored indicators does not accumulate over the levels. Also the ranges of the
/// cubes, until all are known.
/// Thread-safety: put() and get() on disjoint boxes from any thread; the rest from one.
class CentreStore {
  public:
    /// Has room for all `fields` of all levels that coarser ones are made from. Creates `file`, and
    /// removes it in the destructor unless keep() was called. Throws Error{io}, for example on a
    /// full disk.
    CentreStore(const Lattice& lattice, std::vector<Field> fields,
                const std::filesystem::path& file);

    /// The same in an unnamed file in `folder`, without reserved space: cubes may be put() only
    /// after their space was reserved.
    static CentreStore partial(const Lattice& lattice, std::vector<Field> fields,
                               const ScratchFolder& folder);
    /// For partial(): reserves rows [y_begin, y_end) of planes [z_begin, z_end) of the level's
    /// cubes, for all fields; or of the finest ranges of cubes. Throws Error{io}, for example on a
    /// full disk.
    void reserve(int level, std::int64_t y_begin, std::int64_t y_end, std::int64_t z_begin,
                 std::int64_t z_end) const;
    void reserve_cube_ranges(std::int64_t y_begin, std::int64_t y_end, std::int64_t z_begin,
                             std::int64_t z_end) const;
    /// Reserves the ranges of all levels.
    void reserve_all_cube_ranges() const;
    /// Reserves any part of bytes().
    void reserve_bytes(std::uint64_t offset, std::uint64_t bytes) const {
        file_.fill_hole(offset, bytes);
    }

    /// Frees the space of a level.
    void release(int level);
    void put(int level, Field what, const Box<float>& centres);
    /// Cubes outside the volume get `outside`.
    void get(int level, Field what, float outside, Box<float>& centres) const;
    void keep() { file_.keep(); }

    /// A part of the file.
    struct Range {
        std::uint64_t offset = 0;
        std::uint64_t bytes = 0;
    };
    /// The ranges of a level that has_cube_ranges(), [z][y][x].
    [[nodiscard]] std::span<CubeRange> cube_ranges(int level) const;
    /// Thread-safety: as above.
    void put(const Box<CubeRange>& ranges);
    /// The part of the file that row `rows` - 1 of base blocks fills with cube ranges.
    [[nodiscard]] Range cube_ranges_of(int chunk, std::int64_t rows) const;
    /// The parts of the file that row `rows` - 1 of base blocks (level 2), or all of a higher
    /// level, fills. `chunk`: of the store.
    [[nodiscard]] std::vector<Range> ranges_of(int chunk, int level, std::int64_t rows) const;
    [[nodiscard]] std::span<std::byte> bytes() const { return file_.as<std::byte>(); }

    /// One field of all cubes of a level, [z][y][x].
    [[nodiscard]] std::span<float> cubes(int level, Field what) const;

  private:
    CentreStore(const Lattice& lattice, std::vector<Field> fields, ScratchFile file);
    template <class T>
    void reserve_rows(std::span<const T> all, const Int3& cells, std::int64_t y_begin,
                      std::int64_t y_end, std::int64_t z_begin, std::int64_t z_end) const;
    [[nodiscard]] std::uint64_t ranges_offset(int level) const;
    template <class T>
    [[nodiscard]] Range planes_of(std::span<const T> all, const Int3& cells, std::int64_t begin,
                                  std::int64_t end) const;

    Lattice lattice_;
    std::vector<Field> fields_;
    ScratchFile file_;
    std::vector<std::uint64_t> first_;  ///< offset of each level in bytes; the last entry is the
                                        ///< end
};

}  // namespace isonest::detail
