#include "query/labels/find_label.h"

#include <mutex>
#include <vector>

#include <isonest/value_type.h>

#include "store/base/workers.h"
#include "store/container/announce/announcer.h"

namespace isonest::detail {
namespace {

/// Widens `label` by the nodes of a chunk that have the value.
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
        Announcer announcer(store, 0, array.grid.product(), wanted);
        for_each_announced(store, announcer, 0, array.grid.product(), [&](std::int64_t i) {
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
