// A cube of the finest level is cut into six tetrahedra around the diagonal from the corner whose
// coordinates are even to the one whose are odd (Kuhn 1960; method of Maubach 1995): in
// coordinates that count from the even corner, the tetrahedron of a place is a walk along the axes
// in the order of its coordinates, largest first.
#include "tools/view/point_value.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstring>
#include <numeric>
#include <vector>

#include "store/base/memory_budget.h"
#include "store/container/announce/announcer.h"
#include "store/container/reader.h"

namespace isonest::detail::view {
namespace {

/// Values of single nodes; remembers the last chunk.
class Nodes {
  public:
    explicit Nodes(const StoreReader& store)
        : store_(&store), array_(&store.layout().array(0, Field::values)) {}

    double operator()(const Int3& node) {
        const Int3 chunk = array_->chunk_of(node);
        if (data_.empty() || !(chunk == chunk_)) {
            data_.resize(array_->chunk_bytes());
            store_->decode(*array_, chunk, data_);
            chunk_ = chunk;
        }
        const auto place =
            static_cast<std::size_t>(array_->chunk.linear(node - array_->first_node(chunk)));
        return dispatch(store_->layout().header().type, [&](auto tag) {
            typename decltype(tag)::type number{};
            std::memcpy(&number, data_.data() + place * sizeof number, sizeof number);
            return static_cast<double>(number);
        });
    }

  private:
    const StoreReader* store_;
    const ArrayInfo* array_;
    Int3 chunk_{};
    std::vector<std::byte> data_;
};

std::optional<double> finite(double value) {
    return std::isfinite(value) ? std::optional(value) : std::nullopt;
}

double linear_value(Nodes& nodes, const Int3& last, const Double3& place) {
    Int3 node{};     // the even corner, then on along the walk
    Int3 step{};     // to the odd corner
    Double3 part{};  // of the way there
    for (int axis = 0; axis < 3; ++axis) {
        const auto a = static_cast<std::size_t>(axis);
        const auto cell = std::clamp<std::int64_t>(static_cast<std::int64_t>(std::floor(place[a])),
                                                   0, std::max<std::int64_t>(last[axis] - 1, 0));
        const bool even = cell % 2 == 0;
        const double along = last[axis] == 0 ? 0 : place[a] - static_cast<double>(cell);
        node[axis] = even || last[axis] == 0 ? cell : cell + 1;
        step[axis] = last[axis] == 0 ? 0 : even ? 1 : -1;
        part[a] = even ? along : 1 - along;
    }
    std::array<int, 3> order{0, 1, 2};
    std::stable_sort(order.begin(), order.end(), [&](int a, int b) {
        return part[static_cast<std::size_t>(a)] > part[static_cast<std::size_t>(b)];
    });
    double before = nodes(node);
    double value = before;
    for (const int axis : order) {
        if (part[static_cast<std::size_t>(axis)] <= 0) {
            break;  // the rest of the tetrahedron has no weight
        }
        node[axis] += step[axis];
        const double next = nodes(node);
        value += part[static_cast<std::size_t>(axis)] * (next - before);
        before = next;
    }
    return value;
}

}  // namespace

PointValue value_at(const Store& store, const Double3& world, std::uint64_t memory) {
    const StoreReader& reader = store.reader();
    const ArrayInfo& array = reader.layout().array(0, Field::values);
    require_memory(store.path().string(), memory,
                   array.chunk_bytes() + decode_heap(array.chunk_bytes()), "this store's chunks");
    const Double3 spacing = store.spacing();
    const Double3 origin = store.origin();
    const Directions axes = store.direction();
    const Int3 last = store.nodes() - Int3{1, 1, 1};
    PointValue result;
    result.inside = true;
    Double3 place{};
    for (std::size_t axis = 0; axis < 3; ++axis) {
        double along = 0;
        for (std::size_t k = 0; k < 3; ++k) {
            along += axes[axis][k] * (world[k] - origin[k]);
        }
        // A place on the volume's face is inside, however it was rounded.
        constexpr double kRounding = 1e-6;
        const auto end = static_cast<double>(last[static_cast<int>(axis)]);
        const double at = along / spacing[axis];
        result.inside = result.inside && at >= -kRounding && at <= end + kRounding;
        place[axis] = std::isnan(at) ? 0 : std::clamp(at, 0.0, end);  // infinity times 0: outside
        result.node[static_cast<int>(axis)] = std::llround(place[axis]);
    }
    if (!result.inside) {
        return result;
    }
    // All that may be read, in one round trip.
    std::vector<WantedChunk> wanted;
    const Int3 low{static_cast<std::int64_t>(place[0]), static_cast<std::int64_t>(place[1]),
                   static_cast<std::int64_t>(place[2])};
    want_box(array, low, low + Int3{1, 1, 1}, wanted);
    if (reader.is_far()) {
        reader.prefetch_all(wanted);
    }
    Nodes nodes(reader);
    result.value = finite(linear_value(nodes, last, place));
    result.node_value = finite(nodes(result.node));
    return result;
}

}  // namespace isonest::detail::view
