#include "query/finite_elements/volume_values.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include <isonest/error.h>
#include <isonest/remote.h>

#include "store/base/box.h"
#include "store/container/chunk_cache.h"
#include "store/container/reader.h"

namespace isonest::detail {
namespace {

constexpr std::uint64_t kSlab = std::uint64_t{8} << 20U;  ///< bytes of input read at once

/// Planes per slab, a multiple of `multiple` if there are that many.
std::int64_t planes_at_once(const VolumeDescription& d, std::int64_t multiple) {
    const auto plane = static_cast<std::uint64_t>(d.nodes.x * d.nodes.y) * size_of(d.type);
    const auto fit = static_cast<std::int64_t>(std::max<std::uint64_t>(1, kSlab / plane));
    return std::min(d.nodes.z, ceil_div(fit, multiple) * multiple);
}

}  // namespace

VolumeDescription VolumeValues::describe() const {
    if (source_ != nullptr) {
        return source_->describe();
    }
    const StoreHeader& h = store_->layout().header();
    require_not_curved(h, store_->path().string(), "reading a store as a volume");
    return {h.nodes,     h.type,   h.spacing, h.origin, store_->path().string(),
            h.direction, h.labels, h.unit,    h.frame,  {},
            h.uneven,    {}};
}

std::vector<std::filesystem::path> VolumeValues::files() const {
    return source_ != nullptr ? source_->files()
                              : std::vector<std::filesystem::path>{store_->path()};
}

std::uint64_t VolumeValues::heap() const {
    const VolumeDescription d = describe();
    const std::int64_t multiple = source_ != nullptr ? source_->granularity().planes : 1;
    const std::uint64_t slab =
        static_cast<std::uint64_t>(d.nodes.x * d.nodes.y * planes_at_once(d, multiple)) *
        size_of(d.type);
    return slab + (source_ != nullptr ? source_->heap()
                                      : kSlab + 4 * largest_chunk_bytes(store_->layout()));
}

std::vector<float> VolumeValues::read(Progress& progress) const {
    const VolumeDescription d = describe();
    if (d.labels) {
        throw Error(
            ErrorKind::unsupported, {d.name},
            "its values are 64-bit labels, which cannot be smoothed as numbers; smooth surfaces of "
            "labels can be extracted");
    }
    std::vector<float> values(static_cast<std::size_t>(d.nodes.product()));
    const std::int64_t planes =
        planes_at_once(d, source_ != nullptr ? source_->granularity().planes : 1);
    progress.begin("read", static_cast<std::uint64_t>(d.nodes.z), "planes");
    std::unique_ptr<ChunkCache> cache;
    std::unique_ptr<Prefetcher> prefetcher;
    if (store_ != nullptr) {
        cache = std::make_unique<ChunkCache>(*store_, kSlab);
        const ArrayInfo& array = store_->layout().array(0, Field::values);
        prefetcher = std::make_unique<Prefetcher>(
            *store_, 0, (d.nodes.z + planes - 1) / planes,
            [&array, planes](std::int64_t i, std::vector<WantedChunk>& chunks) {
                // A chunk is requested with the first slab that it intersects.
                const std::int64_t depth = array.chunk.z;
                const Int3 begin{0, 0, (i * planes + depth - 1) / depth};
                const std::int64_t last = std::min((i + 1) * planes, array.nodes.z) - 1;
                const Int3 size{array.grid.x, array.grid.y, last / depth + 1 - begin.z};
                for (std::int64_t c = 0; size.z > 0 && c < size.product(); ++c) {
                    chunks.push_back({&array, begin + size.unlinear(c)});
                }
            });
    }
    dispatch(d.type, [&](auto tag) {
        using T = typename decltype(tag)::type;
        for (std::int64_t z = 0; z < d.nodes.z; z += planes) {
            progress.check();
            const std::int64_t count = std::min(planes, d.nodes.z - z);
            Box<T> slab({0, 0, z}, {d.nodes.x, d.nodes.y, count});
            if (source_ != nullptr) {
                source_->read(z, count, 0, d.nodes.y,
                              reinterpret_cast<std::byte*>(slab.data.data()));
            } else {
                prefetcher->reach(z / planes);
                gather_values(*cache, store_->layout().array(0, Field::values), slab);
            }
            float* const to = values.data() + d.nodes.linear({0, 0, z});
            for (std::size_t i = 0; i < slab.data.size(); ++i) {
                to[i] = static_cast<float>(slab.data[i]);
                if (!std::isfinite(to[i])) {
                    const Int3 p = slab.size.unlinear(static_cast<std::int64_t>(i)) + slab.lo;
                    throw Error(ErrorKind::unsupported,
                                {d.name, fmt::format("node ({}, {}, {})", p.x, p.y, p.z)},
                                "the value is missing or too large for float32; smoothing needs "
                                "numbers everywhere");
                }
            }
            progress.advance(static_cast<std::uint64_t>(count));
        }
    });
    return values;
}

}  // namespace isonest::detail
