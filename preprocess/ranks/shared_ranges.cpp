#include "preprocess/ranks/shared_ranges.h"

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <span>
#include <vector>

#include "preprocess/ranks/run_messages.h"
#include "store/container/cube_range.h"

namespace isonest::detail {
namespace {

/// The rows of cubes that a rank's pencils made.
class RangeRuns {
  public:
    struct Run {
        std::size_t array = 0;
        std::uint64_t offset = 0;
        std::uint64_t bytes = 0;
    };
    RangeRuns(const StoreLayout& layout, const Pencils& pencils, int rank)
        : pencils_(pencils.of(rank, kBasePass)),
          cells_(layout.lattice().cells_at(kFirstRangeLevel)),
          rows_(cube_ranges_per_block(layout.header().chunk)) {}
    bool next(Run& run) {
        for (; pencil_ < pencils_.size(); ++pencil_, plane_ = 0) {
            const Pencil& p = pencils_[pencil_];
            const std::int64_t y = p.y * rows_;
            const std::int64_t z = p.z * rows_ + plane_;
            if (plane_ == rows_ || y >= cells_.y || z >= cells_.z) {
                continue;
            }
            ++plane_;
            const auto bytes_of = [&](std::int64_t cubes) {
                return static_cast<std::uint64_t>(cubes) * sizeof(CubeRange);
            };
            run = {0, bytes_of(cells_.linear({0, y, z})),
                   bytes_of(std::min(rows_, cells_.y - y) * cells_.x)};
            return true;
        }
        return false;
    }

    [[nodiscard]] static std::size_t element(std::size_t /*array*/) { return sizeof(float); }

  private:
    std::vector<Pencil> pencils_;
    Int3 cells_;
    std::int64_t rows_;
    std::size_t pencil_ = 0;
    std::int64_t plane_ = 0;
};

}  // namespace

void gather_cube_ranges(Communicator& ranks, const StoreLayout& layout, const Pencils& pencils,
                        CentreStore& centres) {
    if (!has_cube_ranges(layout.lattice(), kFirstRangeLevel)) {
        return;
    }
    const bool is_first = ranks.rank() == 0;
    if (is_first) {
        centres.reserve_all_cube_ranges();
    }
    const std::span<std::byte> bytes =
        std::as_writable_bytes(centres.cube_ranges(kFirstRangeLevel));
    std::uint64_t expected = 0;
    for (int r = 1; r < ranks.size() && is_first; ++r) {
        expected += RunMessages(RangeRuns(layout, pencils, r)).count();
    }
    RunMessages mine(RangeRuns(layout, pencils, ranks.rank()));
    ranks.exchange(
        [&](Communicator::Message& message) {
            message.to = 0;
            return !is_first &&
                   mine.next(message.bytes, [&](std::size_t /*array*/, std::uint64_t offset) {
                       return bytes.data() + offset;
                   });
        },
        expected,
        [&](int /*from*/, std::span<const std::byte> message) {
            unpack_runs(
                message, &RangeRuns::element,
                [&](std::size_t /*array*/, std::uint64_t offset, std::span<const std::byte> from) {
                    std::memcpy(bytes.data() + offset, from.data(), from.size());
                });
        });
}

}  // namespace isonest::detail
