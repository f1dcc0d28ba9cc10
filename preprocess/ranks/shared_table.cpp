#include "preprocess/ranks/shared_table.h"

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <span>
#include <stdexcept>
#include <string>
#include <vector>

#include "preprocess/levels/level_blocks.h"
#include "preprocess/ranks/halo.h"
#include "preprocess/ranks/pencils.h"
#include "store/container/format.h"

namespace isonest::detail {
namespace {

constexpr std::uint64_t kRowsOfMessage = Communicator::kMaxBytes / sizeof(ChunkRow);
constexpr std::uint64_t kOffsetsOfMessage = Communicator::kMaxBytes / sizeof(std::uint64_t);

ChunkPlace next_of(OwnChunks& chunks) {
    ChunkPlace place;
    if (!chunks.next(place)) {
        throw std::logic_error("a rank has fewer chunks than it announced");
    }
    return place;
}

}  // namespace

void gather_rows(Communicator& ranks, const StoreLayout& layout, const Pencils& pencils,
                 std::span<const ChunkRow> own, StoreWriter* writer) {
    const std::vector<std::string> counts = ranks.gather(std::to_string(own.size()));
    std::uint64_t expected = 0;
    std::vector<OwnChunks> chunks;
    if (writer != nullptr) {
        for (int r = 0; r < ranks.size(); ++r) {
            chunks.emplace_back(layout, pencils, r);
            const std::uint64_t count = std::stoull(counts[static_cast<std::size_t>(r)]);
            expected += r > 0 ? (count + kRowsOfMessage - 1) / kRowsOfMessage : 0;
        }
        for (const ChunkRow& row : own) {
            const ChunkPlace place = next_of(chunks.front());
            writer->rows()[place.array->row_of(place.chunk)] = row;
        }
        own = {};
    }
    ranks.exchange(
        [&](Communicator::Message& message) {
            const auto some =
                std::as_bytes(own.first(std::min<std::size_t>(own.size(), kRowsOfMessage)));
            own = own.subspan(std::min<std::size_t>(own.size(), kRowsOfMessage));
            message.to = 0;
            message.bytes.assign(some.begin(), some.end());
            return !some.empty();
        },
        expected,
        [&](int from, std::span<const std::byte> bytes) {
            for (; !bytes.empty(); bytes = bytes.subspan(sizeof(ChunkRow))) {
                const ChunkPlace place = next_of(chunks[static_cast<std::size_t>(from)]);
                std::memcpy(&writer->rows()[place.array->row_of(place.chunk)], bytes.data(),
                            sizeof(ChunkRow));
            }
        });
}

void plan_all_chunks(StoreWriter& writer, const Progress& progress) {
    const StoreLayout& layout = writer.layout();
    for (int pass = kBasePass; pass <= last_pass(layout); ++pass) {
        const Int3 grid = pass == kBasePass           ? base_grid(layout)
                          : pass == last_pass(layout) ? Int3{1, 1, 1}
                                                      : coarse_grid(layout, pass);
        for (std::int64_t i = 0; i < grid.product(); ++i) {
            progress.check();
            for (const ChunkPlace& place : chunks_of(layout, pass, grid.unlinear(i))) {
                writer.plan_chunk(*place.array, place.chunk);
            }
        }
    }
}

void spread_offsets(Communicator& ranks, const StoreLayout& layout, const Pencils& pencils,
                    std::span<ChunkRow> own, StoreWriter* writer) {
    const auto offset_of = [&](const ChunkPlace& place) {
        return writer->rows()[place.array->row_of(place.chunk)].offset;
    };
    if (writer != nullptr) {
        OwnChunks chunks(layout, pencils, 0);
        for (ChunkRow& row : own) {
            row.offset = offset_of(next_of(chunks));
        }
    }
    int to = 0;
    std::vector<OwnChunks> chunks;  // of rank `to`
    std::size_t next = 0;
    ranks.exchange(
        [&](Communicator::Message& message) {
            message.bytes.clear();
            while (writer != nullptr && to < ranks.size()) {
                ChunkPlace place;
                while (!chunks.empty() && message.bytes.size() < kOffsetsOfMessage * 8 &&
                       chunks.back().next(place)) {
                    const std::uint64_t offset = offset_of(place);
                    const auto* const bytes = reinterpret_cast<const std::byte*>(&offset);
                    message.bytes.insert(message.bytes.end(), bytes, bytes + sizeof(offset));
                }
                if (!message.bytes.empty()) {
                    message.to = to;
                    return true;
                }
                chunks.clear();
                if (++to < ranks.size()) {
                    chunks.emplace_back(layout, pencils, to);
                }
            }
            return false;
        },
        writer != nullptr ? 0 : (own.size() + kOffsetsOfMessage - 1) / kOffsetsOfMessage,
        [&](int /*from*/, std::span<const std::byte> bytes) {
            for (; !bytes.empty(); bytes = bytes.subspan(sizeof(std::uint64_t))) {
                std::memcpy(&own[next++].offset, bytes.data(), sizeof(std::uint64_t));
            }
        });
}

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
