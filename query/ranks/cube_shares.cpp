#include "query/ranks/cube_shares.h"

#include <algorithm>
#include <bit>
#include <cstring>
#include <string>
#include <vector>

#include <isonest/error.h>

#include "query/march/clip.h"
#include "query/traverse/bricks/surface_cubes.h"

namespace isonest::detail {
namespace {

constexpr Int3 kOne{1, 1, 1};
/// Whose counts are told to all at once.
constexpr std::int64_t kMostGroups = 1 << 16;
static_assert(kMostGroups * sizeof(std::uint64_t) <= Communicator::kMostBytes);

/// Counts the bricks of level 0 that may have something to be marched.
class BrickCounts {
  public:
    BrickCounts(const ChunkSource& source, const TraversalQuery& query,
                std::span<const double> isovalues)
        : source_(source),
          query_(query),
          isovalues_(isovalues),
          grid_(source.layout().array(0, Field::values).grid),
          chunk_(source.layout().header().chunk) {}

    /// Those of the `size`^3 from `first` on.
    [[nodiscard]] std::uint64_t count(const Int3& first, std::int64_t size) const {
        const Int3 end = min(first + kOne * size, grid_);
        const Int3 bricks = end - first;
        std::uint64_t found = 0;
        for (std::int64_t i = 0; i < bricks.product(); ++i) {
            found += may_hold(first + bricks.unlinear(i)) ? 1 : 0;
        }
        return found;
    }

  private:
    [[nodiscard]] bool may_hold(const Int3& brick) const {
        const Int3 low = brick * chunk_;
        const Int3 high = low + kOne * chunk_;
        if (overlap_of(query_.box, low, high) == Overlap::outside) {
            return false;
        }
        if (query_.plane) {
            return is_cut(low, high);
        }
        try {
            return std::any_of(isovalues_.begin(), isovalues_.end(), [&](double iso) {
                return may_hold_surface(source_, brick, iso, query_.box);
            });
        } catch (const Error& error) {
            if (error.kind() != ErrorKind::corrupt) {
                throw;
            }
            return true;
        }
    }
    [[nodiscard]] bool is_cut(const Int3& low, const Int3& high) const {
        bool below = false;
        bool above = false;
        for (unsigned corner = 0; corner < 8; ++corner) {
            const double distance =
                query_.plane->distance(low + corner_offset(corner) * (high.x - low.x));
            below = below || distance < 0;
            above = above || distance >= 0;
        }
        return below && above;
    }

    const ChunkSource& source_;
    const TraversalQuery& query_;
    std::span<const double> isovalues_;
    Int3 grid_;
    std::int64_t chunk_;
};

/// Cubes of `edge`^3 bricks, in Morton order.
struct Groups {
    std::int64_t edge = 1;
    std::vector<std::uint64_t> codes;

    explicit Groups(const Int3& grid) {
        while (ceil_div(grid, kOne * edge).product() > kMostGroups) {
            edge *= 2;
        }
        const Int3 count = ceil_div(grid, kOne * edge);
        codes.resize(static_cast<std::size_t>(count.product()));
        for (std::size_t i = 0; i < codes.size(); ++i) {
            codes[i] = morton_code(count.unlinear(static_cast<std::int64_t>(i)));
        }
        std::sort(codes.begin(), codes.end());
    }
};

/// The counts of all groups, each counted by one rank.
std::vector<std::uint64_t> all_counts(Communicator& ranks, const Groups& groups,
                                      const BrickCounts& bricks) {
    const auto border = [&](int rank) {
        return groups.codes.size() * static_cast<std::size_t>(rank) /
               static_cast<std::size_t>(ranks.size());
    };
    std::vector<std::uint64_t> counts;
    for (std::size_t i = border(ranks.rank()); i < border(ranks.rank() + 1); ++i) {
        counts.push_back(bricks.count(morton_point(groups.codes[i]) * groups.edge, groups.edge));
    }
    const auto text_of = [](const std::vector<std::uint64_t>& numbers) {
        return std::string(reinterpret_cast<const char*>(numbers.data()),
                           numbers.size() * sizeof(std::uint64_t));
    };
    std::string text;
    for (const std::string& of_rank : ranks.gather(text_of(counts))) {
        text += of_rank;
    }
    text = ranks.broadcast(std::move(text));
    counts.resize(text.size() / sizeof(std::uint64_t));
    std::memcpy(counts.data(), text.data(), text.size());
    return counts;
}

}  // namespace

CubeShare share_of(Communicator& ranks, const ChunkSource& source, const TraversalQuery& query,
                   std::span<const double> isovalues) {
    if (ranks.size() == 1) {
        return {};
    }
    const StoreLayout& layout = source.layout();
    const Groups groups(layout.array(0, Field::values).grid);
    const std::vector<std::uint64_t> counts =
        all_counts(ranks, groups, BrickCounts(source, query, isovalues));
    std::uint64_t all = 0;
    for (const std::uint64_t count : counts) {
        all += count;
    }
    // A group goes where its middle lies among all bricks that were counted.
    const auto size = static_cast<std::uint64_t>(ranks.size());
    const auto cells = static_cast<std::uint64_t>(groups.edge * layout.header().chunk);
    const int bits = 3 * std::countr_zero(cells);
    CubeShare share{CubeShare::kEnd, CubeShare::kEnd};
    std::uint64_t before = 0;
    const auto own = static_cast<std::uint64_t>(ranks.rank());
    for (std::size_t i = 0; i < counts.size(); ++i) {
        const std::uint64_t rank =
            all == 0 ? 0 : std::min((2 * before + counts[i]) * size / (2 * all), size - 1);
        const std::uint64_t code = groups.codes[i] << static_cast<unsigned>(bits);
        share.begin = rank >= own ? std::min(share.begin, code) : share.begin;
        share.end = rank > own ? std::min(share.end, code) : share.end;
        before += counts[i];
    }
    share.begin = own == 0 ? 0 : share.begin;
    return share;
}

}  // namespace isonest::detail
