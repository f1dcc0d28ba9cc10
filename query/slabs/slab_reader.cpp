#include "query/slabs/slab_reader.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <limits>

#include <isonest/error.h>

#include "query/mesh/vertex_stars.h"
#include "query/slabs/march_slab.h"
#include "store/base/memory.h"
#include "store/base/workers.h"
#include "store/container/format.h"

namespace isonest::detail {

void ValueRange::add(const ValueRange& other) {
    low = std::min(low, other.low);
    high = std::max(high, other.high);
}

ValueRange range_of(ValueType type, const SlabPlanes& planes, const Int3& nodes, std::int64_t begin,
                    std::int64_t end) {
    return dispatch(type, [&](auto tag) {
        using T = typename decltype(tag)::type;
        const SlabValues<T> values{reinterpret_cast<const T*>(planes.data), planes.first, nodes};
        ValueRange range;
        for (std::int64_t z = begin; z < end; ++z) {
            widen_range(values.at({0, 0, z}), nodes.x * nodes.y, range.low, range.high);
        }
        return range;
    });
}

namespace {

constexpr std::int64_t kMaxLayers = 16;  ///< per slab
/// A slab's vertices use at most three quarters of the 32-bit numbers.
constexpr std::int64_t kMaxNodes = std::int64_t{1} << 29U;

/// Memory of slabs with this many layers.
struct SlabNeeds {
    std::uint64_t all;   ///< fixed part, bytes
    std::uint64_t each;  ///< bytes per concurrent slab
};
SlabNeeds needs_of(const SlabReader& reader, const Int3& nodes, std::int64_t layers,
                   std::uint64_t each_more) {
    return {kLibraryHeap + reader.own_bytes(layers),
            reader.slab_bytes(layers) + march_slab_bytes(nodes) + each_more};
}

}  // namespace

bool is_marchable(const VolumeDescription& volume) {
    const Int3& n = volume.nodes;
    return !volume.labels && std::min({n.x, n.y, n.z}) > 1 && n.x * n.y <= kMaxNodes / 2;
}

void require_marchable(const VolumeDescription& volume, double iso) {
    const Int3& n = volume.nodes;
    if (!std::isfinite(iso)) {
        throw Error(ErrorKind::invalid_argument,
                    fmt::format("isovalue {}: must be a finite number", iso));
    }
    if (const std::string why = why_no_place(n, volume.spacing, volume.origin); !why.empty()) {
        throw Error(ErrorKind::invalid_argument, {volume.name}, why,
                    {{RemedyKind::place_in_world, "spacing,origin"}});
    }
    if (const std::string why = why_no_directions(n, volume.direction); !why.empty()) {
        throw Error(ErrorKind::invalid_argument, {volume.name}, why);
    }
    if (const std::string why =
            why_not_uneven(n, volume.spacing, volume.origin, volume.direction, volume.uneven);
        !why.empty()) {
        throw Error(ErrorKind::invalid_argument, {volume.name}, why);
    }
    require_not_curved(volume, "marching without a store");
    if (std::min({n.x, n.y, n.z}) < 2) {
        throw Error(ErrorKind::invalid_argument, {volume.name},
                    fmt::format("{} x {} x {} nodes have no cells", n.x, n.y, n.z));
    }
    if (volume.labels) {
        throw Error(ErrorKind::unsupported, {volume.name},
                    "its values are 64-bit labels, whose surfaces need a store",
                    {{RemedyKind::make_store}});
    }
    for (int axis = 0; axis < 3; ++axis) {
        const double most = largest_coordinate(n, header_of(volume).steps(), volume.origin, axis);
        if (!(most <= static_cast<double>(std::numeric_limits<float>::max()))) {
            throw Error(ErrorKind::limit, {volume.name},
                        fmt::format("the volume reaches {} = {:.6g}, beyond the range of a mesh's "
                                    "32-bit floats",
                                    "xyz"[axis], most),
                        {{RemedyKind::place_in_world, "spacing,origin"}});
        }
    }
    if (n.x * n.y > kMaxNodes / 2) {
        throw Error(ErrorKind::limit, {volume.name},
                    "a layer of cells can have more vertices than 32 bits can number");
    }
}

std::uint64_t min_slab_memory(const SlabReader& reader, const VolumeDescription& volume,
                              std::uint64_t each_more) {
    const SlabNeeds needs = needs_of(reader, volume.nodes, 1, each_more);
    return needs.all + needs.each;
}

SlabPlan slab_plan(const SlabReader& reader, const VolumeDescription& volume,
                   const MemoryShare& memory, std::uint64_t each_more) {
    const Int3& n = volume.nodes;
    memory.require(min_slab_memory(reader, volume, each_more) - kLibraryHeap,
                   "planes of this volume");
    SlabPlan plan;
    plan.threads = memory.threads();
    const auto needed = [&](std::int64_t layers, int slabs) {
        const SlabNeeds needs = needs_of(reader, n, layers, each_more);
        return needs.all + static_cast<std::uint64_t>(slabs) * needs.each;
    };
    const auto fits = [&](std::int64_t layers, int slabs) {
        return needed(layers, slabs) <= memory.bytes();
    };
    // Several slabs per thread, so that all threads are busy until the end.
    plan.layers = std::clamp<std::int64_t>((n.z - 1) / (4 * plan.threads), 2, kMaxLayers);
    plan.layers = std::clamp<std::int64_t>(kMaxNodes / (n.x * n.y), 1, plan.layers);
    while (plan.layers > 1 && !fits(plan.layers, plan.threads)) {
        plan.layers /= 2;
    }
    while (plan.threads > 1 && !fits(plan.layers, plan.threads)) {
        --plan.threads;
    }
    plan.slabs_at_once = fits(plan.layers, plan.threads + 1) ? plan.threads + 1 : plan.threads;
    plan.spare = memory.bytes() - needed(plan.layers, plan.slabs_at_once);
    return plan;
}

SlabReader::SlabReader(VolumeSource& volume)
    : volume_(volume),
      description_(volume.describe()),
      mapped_(volume.mapped()),
      plane_bytes_(static_cast<std::uint64_t>(description_.nodes.x * description_.nodes.y) *
                   size_of(description_.type)),
      at_once_(std::min(volume.granularity().planes, description_.nodes.z)) {}

std::uint64_t SlabReader::own_bytes(std::int64_t layers) const {
    return mapped_.empty()
               ? plane_bytes_ * static_cast<std::uint64_t>(layers + 3 + at_once_) + volume_.heap()
               : 0;
}

std::uint64_t SlabReader::slab_bytes(std::int64_t layers) const {
    return mapped_.empty() ? plane_bytes_ * static_cast<std::uint64_t>(layers + 3) : 0;
}

SlabPlanes SlabReader::read(const Slab& layers) {
    const std::int64_t planes = description_.nodes.z;
    const std::int64_t first = std::max<std::int64_t>(layers.begin - 1, 0);
    const std::int64_t end = std::min(layers.end + 2, planes);
    if (!mapped_.empty()) {
        return {mapped_.data(), 0, {}};
    }
    const auto bytes = [&](std::int64_t n) { return static_cast<std::size_t>(n) * plane_bytes_; };
    const std::int64_t dropped = std::min(first, window_end_) - window_first_;
    window_.erase(window_.begin(), window_.begin() + static_cast<std::ptrdiff_t>(bytes(dropped)));
    window_first_ += dropped;
    window_.reserve(bytes(layers.end - layers.begin + 3 + at_once_));
    while (window_end_ < end) {
        const std::int64_t next = std::min((window_end_ / at_once_ + 1) * at_once_, planes);
        window_.resize(bytes(next - window_first_));
        volume_.read(window_end_, next - window_end_, 0, description_.nodes.y,
                     window_.data() + bytes(window_end_ - window_first_));
        window_end_ = next;
    }
    SlabPlanes slab{nullptr, first, {}};
    const auto* const from = window_.data() + bytes(first - window_first_);
    slab.own.assign(from, from + bytes(end - first));
    slab.data = slab.own.data();
    return slab;
}

}  // namespace isonest::detail
