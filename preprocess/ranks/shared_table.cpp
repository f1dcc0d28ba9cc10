#include "preprocess/ranks/shared_table.h"

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <stdexcept>
#include <string>
#include <vector>

#include "preprocess/levels/base_block.h"
#include "preprocess/levels/coarse_block.h"
#include "preprocess/ranks/own_chunks.h"

namespace isonest::detail {
namespace {

constexpr std::uint64_t kRowsOfMessage = Communicator::kMostBytes / sizeof(ChunkRow);
constexpr std::uint64_t kOffsetsOfMessage = Communicator::kMostBytes / sizeof(std::uint64_t);

ChunkPlace next_of(OwnChunks& chunks) {
    ChunkPlace place;
    if (!chunks.next(place)) {
        throw std::logic_error("a rank has fewer chunks than it tells of");
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
    std::vector<OwnChunks> chunks;  // of that rank
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

}  // namespace isonest::detail
