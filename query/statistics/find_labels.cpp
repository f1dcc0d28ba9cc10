#include "query/statistics/find_labels.h"

#include <fmt/format.h>

#include <algorithm>
#include <cstring>
#include <mutex>
#include <optional>
#include <unordered_map>
#include <vector>

#include <isonest/error.h>
#include <isonest/labels.h>
#include <isonest/value_type.h>

#include "store/base/memory.h"
#include "store/base/workers.h"
#include "store/container/chunk_cache.h"
#include "store/container/reader.h"

namespace isonest::detail {
namespace {

/// Extends `label` by the nodes of a chunk that have the value.
template <class T>
void add_nodes(const std::vector<std::byte>& raw, const ArrayInfo& array, const Int3& chunk,
               T value, Label& label) {
    const Int3 first = array.first_node(chunk);
    const Int3 size = min(array.chunk, array.nodes - first);
    for (std::int64_t i = 0; i < size.product(); ++i) {
        const Int3 node = size.unlinear(i);
        if (reinterpret_cast<const T*>(raw.data())[array.chunk.linear(node)] == value) {
            const Int3 at = first + node;
            label.low = label.nodes == 0 ? at : min(label.low, at);
            label.high = label.nodes == 0 ? at : max(label.high, at);
            ++label.nodes;
        }
    }
}

}  // namespace

std::optional<Label> find_label(const StoreReader& store, std::int64_t id, double value,
                                int threads, Progress& progress) {
    const ArrayInfo& array = store.layout().array(0, Field::values);
    Label found{id, 0, {}, {}};
    std::mutex mutex;
    progress.begin("find labels", static_cast<std::uint64_t>(array.grid.product()), "chunks");
    Workers(threads).execute([&] {
        const auto may_have = [&](const Int3& chunk) {
            const ChunkRow row = store.row(array, chunk);
            return row.min <= value && value <= row.max;
        };
        const auto wanted = [&](std::int64_t i, std::vector<WantedChunk>& chunks) {
            if (const Int3 chunk = array.grid.unlinear(i); may_have(chunk)) {
                chunks.push_back({&array, chunk});
            }
        };
        Prefetcher prefetcher(store, 0, array.grid.product(), wanted);
        for_each_prefetched(store, prefetcher, 0, array.grid.product(), [&](std::int64_t i) {
            progress.check();
            const Int3 chunk = array.grid.unlinear(i);
            if (may_have(chunk)) {
                std::vector<std::byte> raw(array.chunk_bytes());
                store.decode(array, chunk, raw);
                Label own{id, 0, {}, {}};
                dispatch(store.layout().header().type, [&](auto tag) {
                    using T = typename decltype(tag)::type;
                    add_nodes<T>(raw, array, chunk, static_cast<T>(value), own);
                });
                const std::lock_guard lock(mutex);
                if (own.nodes > 0) {
                    found.low = found.nodes == 0 ? own.low : min(found.low, own.low);
                    found.high = found.nodes == 0 ? own.high : max(found.high, own.high);
                    found.nodes += own.nodes;
                }
            }
            progress.advance(1);
        });
    });
    return found.nodes > 0 ? std::optional(found) : std::nullopt;
}

}  // namespace isonest::detail

namespace isonest {
namespace {

using namespace detail;

using Table = std::unordered_map<std::int64_t, Label>;
/// Size of a table entry, including the overhead of the table.
constexpr std::uint64_t kEntryBytes = sizeof(Label) + 64;
constexpr std::uint64_t kMinEntries = 1000;

void include(Label& label, const Label& other) {
    label.low = label.nodes == 0 ? other.low : min(label.low, other.low);
    label.high = label.nodes == 0 ? other.high : max(label.high, other.high);
    label.nodes += other.nodes;
}

void refuse_more(std::uint64_t labels, std::uint64_t most, const std::string& name) {
    if (labels > most) {
        throw Error(ErrorKind::limit, {name}, fmt::format("has more than {} labels", most),
                    {{RemedyKind::more_memory}});
    }
}

/// Runs of one label along x are added to the table at once.
template <class T>
void add_chunk(const std::vector<std::byte>& raw, const ArrayInfo& array, const Int3& chunk,
               bool bits, std::uint64_t most, Table& table, const std::string& name) {
    const Int3 first = array.first_node(chunk);
    const Int3 size = min(array.chunk, array.nodes - first);
    for (std::int64_t i = 0; i < size.y * size.z; ++i) {
        const std::int64_t y = i % size.y;
        const std::int64_t z = i / size.y;
        const T* const row =
            reinterpret_cast<const T*>(raw.data()) + (z * array.chunk.y + y) * array.chunk.x;
        for (std::int64_t x = 0; x < size.x;) {
            std::int64_t end = x + 1;
            while (end < size.x && row[end] == row[x]) {
                ++end;
            }
            const std::optional<std::int64_t> id = label_of(row[x], bits);
            if (id) {
                Label run{*id, static_cast<std::uint64_t>(end - x), first + Int3{x, y, z},
                          first + Int3{end - 1, y, z}};
                Label& label = table[*id];
                include(label, run);
                label.id = *id;
                refuse_more(table.size(), most, name);
            } else {
                require_missing(static_cast<double>(row[x]), name);
            }
            x = end;
        }
    }
}

}  // namespace

std::vector<Label> find_labels(const Store& store, const LabelOptions& options,
                               Progress& progress) {
    const StoreReader& reader = store.reader();
    const ArrayInfo& array = reader.layout().array(0, Field::values);
    const std::string name = reader.path().string();
    const auto threads = static_cast<std::uint64_t>(Workers::count_of(options.threads));
    const std::uint64_t chunks = threads * array.chunk_bytes();
    // Half is for the tables of single chunks.
    constexpr std::uint64_t kBeside = kLibraryHeap + 2 * kMinEntries * kEntryBytes;
    require_memory(name, options.memory, kBeside + chunks, "this store's chunks");
    const std::uint64_t most = (options.memory - kLibraryHeap - chunks) / kEntryBytes / 2;
    Table all;
    std::mutex mutex;
    progress.begin("find labels", static_cast<std::uint64_t>(array.grid.product()), "chunks");
    Workers(options.threads).execute([&] {
        const auto wanted = [&](std::int64_t i, std::vector<WantedChunk>& into) {
            into.push_back({&array, array.grid.unlinear(i)});
        };
        Prefetcher prefetcher(reader, 0, array.grid.product(), wanted);
        for_each_prefetched(reader, prefetcher, 0, array.grid.product(), [&](std::int64_t i) {
            progress.check();
            std::vector<std::byte> raw(array.chunk_bytes());
            const Int3 chunk = array.grid.unlinear(i);
            reader.decode(array, chunk, raw);
            Table own;
            dispatch(reader.layout().header().type, [&](auto tag) {
                add_chunk<typename decltype(tag)::type>(
                    raw, array, chunk, reader.layout().header().labels, most / threads, own, name);
            });
            {
                const std::lock_guard lock(mutex);
                for (const auto& [id, label] : own) {
                    Label& known = all[id];
                    include(known, label);
                    known.id = id;
                }
                refuse_more(all.size(), most, name);
            }
            progress.advance(1);
        });
    });
    std::vector<Label> labels;
    labels.reserve(all.size());
    for (const auto& [id, label] : all) {
        labels.push_back(label);
    }
    std::sort(labels.begin(), labels.end(),
              [](const Label& a, const Label& b) { return a.id < b.id; });
    return labels;
}

}  // namespace isonest
