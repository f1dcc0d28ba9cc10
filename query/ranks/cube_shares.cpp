#include "query/ranks/cube_shares.h"

#include <algorithm>
#include <cstring>
#include <numeric>
#include <string>
#include <vector>

#include <isonest/error.h>

#include "query/march/clip.h"
#include "query/traverse/bricks/finest_brick.h"
#include "query/values/blocks.h"
#include "query/values/topology.h"

namespace isonest::detail {
namespace {

constexpr Int3 kOne{1, 1, 1};
constexpr std::int64_t kMaxGroups = 1 << 16;
// The counts of one rank, possibly all counts, are one message.
static_assert(kMaxGroups * sizeof(std::uint64_t) <= Communicator::kMaxBytes);

/// Cubes of one level that cover the volume, in Morton order.
struct Groups {
    int level;
    std::vector<std::uint64_t> codes;

    explicit Groups(const StoreLayout& layout)
        : level(std::min(kFirstRangeLevel, chunk_level(layout))) {
        const Int3 cells = max(layout.header().nodes - kOne, kOne);
        const auto count_at = [&](int of_level) {
            return ceil_div(cells, kOne * (std::int64_t{1} << of_level));
        };
        while (count_at(level).product() > kMaxGroups) {
            ++level;
        }
        const Int3 count = count_at(level);
        codes.resize(static_cast<std::size_t>(count.product()));
        for (std::size_t i = 0; i < codes.size(); ++i) {
            codes[i] = morton_code(count.unlinear(static_cast<std::int64_t>(i)));
        }
        std::sort(codes.begin(), codes.end());
    }
    /// First cell of a group.
    [[nodiscard]] Int3 low(std::uint64_t code) const {
        return morton_point(code) * (std::int64_t{1} << level);
    }
};

/// Counts the cubes of 8^3 cells that may contain something to march.
class CubeCounts {
  public:
    CubeCounts(const ChunkSource& source, const ClipBox& box,
               const std::optional<LatticePlane>& plane, std::span<const double> isovalues)
        : source_(source),
          layout_(source.layout()),
          box_(box),
          plane_(plane),
          isovalues_(isovalues),
          cells_(max(layout_.header().nodes - kOne, kOne)) {}

    /// The number of those in the cube of `size`^3 cells starting at `low`.
    [[nodiscard]] std::uint64_t count(const Int3& low, std::int64_t size) const {
        const std::int64_t chunk = layout_.header().chunk;
        const Int3 first = floor_by(low, chunk);
        const Int3 bricks = ceil_div(min(low + kOne * size, cells_), kOne * chunk) - first;
        std::uint64_t found = 0;
        for (std::int64_t i = 0; i < bricks.product(); ++i) {
            const Int3 brick = first + bricks.unlinear(i);
            const Int3 from = max(low, brick * chunk);
            const Int3 to = min(min(low + kOne * size, (brick + kOne) * chunk), cells_);
            try {
                found += may_hold(brick) ? count_cubes(from, to) : 0;
            } catch (const Error& error) {
                if (error.kind() != ErrorKind::corrupt) {
                    throw;
                }
                ++found;
            }
        }
        return found;
    }

  private:
    static Int3 floor_by(const Int3& p, std::int64_t edge) {
        return {p.x / edge, p.y / edge, p.z / edge};
    }
    /// By the chunk table alone.
    [[nodiscard]] bool may_hold(const Int3& brick) const {
        const Int3 low = brick * layout_.header().chunk;
        const Int3 high = low + kOne * layout_.header().chunk;
        if (overlap_of(box_, low, high) == Overlap::outside) {
            return false;
        }
        return plane_ ? is_cut(low, high)
                      : std::any_of(isovalues_.begin(), isovalues_.end(), [&](double iso) {
                            return may_hold_surface(source_, brick, iso, box_);
                        });
    }
    [[nodiscard]] std::uint64_t count_cubes(const Int3& low, const Int3& high) const {
        if (layout_.lattice().top() < kFirstRangeLevel) {
            return 1;
        }
        const Int3 first = floor_by(low, kFirstRangeEdge);
        const Int3 end = min(ceil_div(high, kOne * kFirstRangeEdge),
                             layout_.lattice().cells_at(kFirstRangeLevel));
        const Int3 cubes = end - first;
        std::uint64_t found = 0;
        for (std::int64_t i = 0; i < cubes.product(); ++i) {
            found += may_be_marched(first + cubes.unlinear(i)) ? 1 : 0;
        }
        return found;
    }
    [[nodiscard]] bool may_be_marched(const Int3& cube) const {
        if (plane_) {
            return is_cut(cube * kFirstRangeEdge, (cube + kOne) * kFirstRangeEdge);
        }
        if (!layout_.has_cube_ranges(kFirstRangeLevel)) {
            return true;
        }
        const auto range = source_.cube_range(kFirstRangeLevel, cube);
        return !range || std::any_of(isovalues_.begin(), isovalues_.end(),
                                     [&](double iso) { return range->may_hold(iso); });
    }
    [[nodiscard]] bool is_cut(const Int3& low, const Int3& high) const {
        bool below = false;
        bool above = false;
        for (unsigned corner = 0; corner < 8; ++corner) {
            const double distance =
                plane_->distance(low + corner_offset(corner) * (high.x - low.x));
            below = below || distance < 0;
            above = above || distance >= 0;
        }
        return below && above;
    }

    const ChunkSource& source_;
    const StoreLayout& layout_;
    const ClipBox& box_;
    const std::optional<LatticePlane>& plane_;
    std::span<const double> isovalues_;
    Int3 cells_;
};

using Numbers = std::vector<std::uint64_t>;

std::string text_of(const Numbers& numbers) {
    return {reinterpret_cast<const char*>(numbers.data()), numbers.size() * sizeof(std::uint64_t)};
}

Numbers numbers_of(const std::string& text) {
    Numbers numbers(text.size() / sizeof(std::uint64_t));
    if (!numbers.empty()) {
        std::memcpy(numbers.data(), text.data(), numbers.size() * sizeof(std::uint64_t));
    }
    return numbers;
}

/// Collects the counts of all groups on rank 0; each group is counted by one rank.
Numbers all_counts(Communicator& ranks, const Groups& groups, const CubeCounts& cubes) {
    const auto border = [&](int rank) {
        return groups.codes.size() * static_cast<std::size_t>(rank) /
               static_cast<std::size_t>(ranks.size());
    };
    Numbers counts;
    for (std::size_t i = border(ranks.rank()); i < border(ranks.rank() + 1); ++i) {
        counts.push_back(cubes.count(groups.low(groups.codes[i]), std::int64_t{1} << groups.level));
    }
    std::string text;
    for (const std::string& of_rank : ranks.gather(text_of(counts))) {
        text += of_rank;
    }
    return numbers_of(text);
}

/// The starts of the shares of this many ranks, and the end. A group belongs to the share that
/// contains its middle, by the number of counted cubes.
Numbers borders_of(const Groups& groups, const Numbers& counts, std::uint64_t ranks) {
    Numbers borders(ranks + 1, CubeShare::kEnd);
    const std::uint64_t all = std::accumulate(counts.begin(), counts.end(), std::uint64_t{0});
    std::uint64_t before = 0;
    std::uint64_t begun = 0;
    borders[begun++] = 0;
    for (std::size_t i = 0; i < counts.size() && all > 0; ++i) {
        const std::uint64_t rank =
            std::min((2 * before + counts[i]) * ranks / (2 * all), ranks - 1);
        while (begun <= rank) {
            borders[begun++] = groups.codes[i] << (3U * static_cast<unsigned>(groups.level));
        }
        before += counts[i];
    }
    return borders;
}

}  // namespace

CubeShare share_of(Communicator& ranks, const ChunkSource& source, const ClipBox& box,
                   const std::optional<LatticePlane>& plane, std::span<const double> isovalues) {
    if (ranks.size() == 1) {
        return {};
    }
    const Groups groups(source.layout());
    const Numbers counts = all_counts(ranks, groups, CubeCounts(source, box, plane, isovalues));
    Numbers borders;
    if (ranks.rank() == 0) {
        borders = borders_of(groups, counts, static_cast<std::uint64_t>(ranks.size()));
    }
    borders = numbers_of(ranks.broadcast(text_of(borders)));
    const auto own = static_cast<std::size_t>(ranks.rank());
    return {borders[own], borders[own + 1]};
}

}  // namespace isonest::detail
