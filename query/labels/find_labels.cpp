#include <fmt/format.h>

#include <algorithm>
#include <cstring>
#include <mutex>
#include <optional>
#include <unordered_map>

#include <isonest/error.h>
#include <isonest/labels.h>

#include "query/labels/label_of_value.h"
#include "store/base/memory_budget.h"
#include "store/base/workers.h"
#include "store/container/announce/announcer.h"
#include "store/container/reader.h"

namespace isonest {
namespace {

using namespace detail;

using Table = std::unordered_map<std::int64_t, Label>;
/// Of an entry of the table, with what the table itself takes.
constexpr std::uint64_t kEntryBytes = sizeof(Label) + 64;
constexpr std::uint64_t kLeastEntries = 1000;

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

/// Runs of one label along x go into the table at once.
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
    // Half for the tables of single chunks.
    constexpr std::uint64_t kBeside = kLibraryHeap + 2 * kLeastEntries * kEntryBytes;
    require_memory(name, options.memory, kBeside + chunks, "this store's chunks");
    const std::uint64_t most = (options.memory - kLibraryHeap - chunks) / kEntryBytes / 2;
    Table all;
    std::mutex mutex;
    progress.begin("find labels", static_cast<std::uint64_t>(array.grid.product()), "chunks");
    Workers(options.threads).execute([&] {
        const auto wanted = [&](std::int64_t i, std::vector<WantedChunk>& into) {
            into.push_back({&array, array.grid.unlinear(i)});
        };
        Announcer announcer(reader, 0, array.grid.product(), wanted);
        for_each_announced(reader, announcer, 0, array.grid.product(), [&](std::int64_t i) {
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
