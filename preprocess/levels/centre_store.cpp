#include "preprocess/levels/centre_store.h"

#include <algorithm>
#include <utility>

namespace isonest::detail {
namespace {

/// Copies a box into an array of all cubes of a level.
template <class T>
void copy_box(const Box<T>& from, const Int3& cells, std::span<T> to) {
    for (std::int64_t z = from.lo.z; z < from.lo.z + from.size.z; ++z) {
        for (std::int64_t y = from.lo.y; y < from.lo.y + from.size.y; ++y) {
            std::copy_n(from.row(y, z), from.size.x, to.data() + cells.linear({from.lo.x, y, z}));
        }
    }
}

}  // namespace

CentreStore::CentreStore(const Lattice& lattice, std::vector<Field> fields, ScratchFile file)
    : lattice_(lattice),
      fields_(std::move(fields)),
      file_(std::move(file)),
      first_(static_cast<std::size_t>(std::max(lattice.top(), 2)) + 1, 0) {
    for (int level = 2; level < lattice.top(); ++level) {
        const auto l = static_cast<std::size_t>(level);
        first_[l + 1] =
            first_[l] + fields_.size() * sizeof(float) *
                            static_cast<std::uint64_t>(lattice.elements_at(level).product());
    }
}

CentreStore::CentreStore(const Lattice& lattice, std::vector<Field> fields,
                         const std::filesystem::path& file)
    : CentreStore(lattice, std::move(fields), ScratchFile::named(file)) {
    file_.map(ranges_offset(lattice.top() + 1));
}

CentreStore CentreStore::partial(const Lattice& lattice, std::vector<Field> fields,
                                 const ScratchFolder& folder) {
    CentreStore made(lattice, std::move(fields), ScratchFile(folder));
    made.file_.map_hole(made.ranges_offset(lattice.top() + 1));
    return made;
}

/// Reserves rows of planes of an array of all cubes of a level.
template <class T>
void CentreStore::reserve_rows(std::span<const T> all, const Int3& cells, std::int64_t y_begin,
                               std::int64_t y_end, std::int64_t z_begin, std::int64_t z_end) const {
    const std::int64_t last_y = std::min(y_end, cells.y);
    for (std::int64_t z = z_begin; z < std::min(z_end, cells.z) && y_begin < last_y; ++z) {
        const auto part = all.subspan(static_cast<std::size_t>(cells.linear({0, y_begin, z})),
                                      static_cast<std::size_t>((last_y - y_begin) * cells.x));
        file_.fill_hole(static_cast<std::uint64_t>(std::as_bytes(part).data() - bytes().data()),
                        part.size_bytes());
    }
}

void CentreStore::reserve(int level, std::int64_t y_begin, std::int64_t y_end, std::int64_t z_begin,
                          std::int64_t z_end) const {
    for (const Field field : fields_) {
        reserve_rows<float>(cubes(level, field), lattice_.elements_at(level), y_begin, y_end,
                            z_begin, z_end);
    }
}

void CentreStore::reserve_cube_ranges(std::int64_t y_begin, std::int64_t y_end,
                                      std::int64_t z_begin, std::int64_t z_end) const {
    reserve_rows<CubeRange>(cube_ranges(kFirstRangeLevel), lattice_.cells_at(kFirstRangeLevel),
                            y_begin, y_end, z_begin, z_end);
}

void CentreStore::reserve_all_cube_ranges() const {
    const std::uint64_t begin = ranges_offset(kFirstRangeLevel);
    file_.fill_hole(begin, ranges_offset(lattice_.top() + 1) - begin);
}

/// Offset of the ranges of a level in bytes; for a level above the coarsest, the end of all ranges.
std::uint64_t CentreStore::ranges_offset(int level) const {
    std::uint64_t offset =
        (first_.back() + sizeof(CubeRange) - 1) / sizeof(CubeRange) * sizeof(CubeRange);
    for (int l = kFirstRangeLevel; l < level && has_cube_ranges(lattice_, l); ++l) {
        offset += sizeof(CubeRange) * static_cast<std::uint64_t>(lattice_.cells_at(l).product());
    }
    return offset;
}

std::span<CubeRange> CentreStore::cube_ranges(int level) const {
    return file_.as<CubeRange>().subspan(
        ranges_offset(level) / sizeof(CubeRange),
        static_cast<std::size_t>(lattice_.cells_at(level).product()));
}

void CentreStore::put(const Box<CubeRange>& ranges) {
    copy_box(ranges, lattice_.cells_at(kFirstRangeLevel), cube_ranges(kFirstRangeLevel));
}

/// Planes `begin` to `end` - 1 of an array of all cubes of a level.
template <class T>
CentreStore::Range CentreStore::planes_of(std::span<const T> all, const Int3& cells,
                                          std::int64_t begin, std::int64_t end) const {
    const auto part = all.subspan(static_cast<std::size_t>(begin * cells.x * cells.y),
                                  static_cast<std::size_t>((end - begin) * cells.x * cells.y));
    return {static_cast<std::uint64_t>(std::as_bytes(part).data() - bytes().data()),
            part.size_bytes()};
}

CentreStore::Range CentreStore::cube_ranges_of(int chunk, std::int64_t rows) const {
    if (!has_cube_ranges(lattice_, kFirstRangeLevel)) {
        return {};
    }
    const Int3 cells = lattice_.cells_at(kFirstRangeLevel);
    const std::int64_t planes = cube_ranges_per_block(chunk);
    const std::int64_t begin = std::min((rows - 1) * planes, cells.z);
    return planes_of<CubeRange>(cube_ranges(kFirstRangeLevel), cells, begin,
                                std::min(begin + planes, cells.z));
}

std::span<float> CentreStore::cubes(int level, Field what) const {
    const auto count = static_cast<std::size_t>(lattice_.elements_at(level).product());
    const auto place =
        static_cast<std::size_t>(std::find(fields_.begin(), fields_.end(), what) - fields_.begin());
    return file_.as<float>().subspan(
        first_[static_cast<std::size_t>(level)] / sizeof(float) + place * count, count);
}

void CentreStore::release(int level) {
    const auto l = static_cast<std::size_t>(level);
    if (level >= 2) {
        file_.release(first_[l], first_[l + 1] - first_[l]);
    }
}

std::vector<CentreStore::Range> CentreStore::ranges_of(int chunk, int level,
                                                       std::int64_t rows) const {
    std::vector<Range> ranges;
    if (level >= lattice_.top()) {
        return ranges;
    }
    const Int3 cells = lattice_.elements_at(level);
    const std::int64_t planes = level == 2 ? chunk / 2 : cells.z;
    const std::int64_t begin = level == 2 ? std::min((rows - 1) * planes, cells.z) : 0;
    const std::int64_t end = std::min(begin + planes, cells.z);
    for (const Field field : fields_) {
        ranges.push_back(planes_of<float>(cubes(level, field), cells, begin, end));
    }
    return ranges;
}

void CentreStore::put(int level, Field what, const Box<float>& centres) {
    copy_box(centres, lattice_.elements_at(level), cubes(level, what));
}

void CentreStore::get(int level, Field what, float outside, Box<float>& centres) const {
    const Int3 cells = lattice_.elements_at(level);
    const auto from = cubes(level, what);
    std::fill(centres.data.begin(), centres.data.end(), outside);
    const Int3 first = max(centres.lo, {0, 0, 0});
    const Int3 end = min(centres.lo + centres.size, cells);
    for (std::int64_t z = first.z; z < end.z; ++z) {
        for (std::int64_t y = first.y; y < end.y && first.x < end.x; ++y) {
            std::copy_n(from.data() + cells.linear({first.x, y, z}), end.x - first.x,
                        centres.row(y, z) + (first.x - centres.lo.x));
        }
    }
}

}  // namespace isonest::detail
