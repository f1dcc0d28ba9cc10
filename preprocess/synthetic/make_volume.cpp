#include "preprocess/synthetic/make_volume.h"

#include <fmt/format.h>
#include <oneapi/tbb/parallel_for.h>

#include <cmath>
#include <limits>
#include <vector>

#include <isonest/error.h>

#include "preprocess/synthetic/synthetic.h"
#include "store/base/workers.h"
#include "store/exports/volume_file.h"
#include "store/files/output_file.h"
#include "store/lattice/lattice.h"

namespace isonest::detail {
namespace {

template <class T>
T convert(double value, double low, double high) {
    if constexpr (std::is_floating_point_v<T>) {
        return static_cast<T>(value);
    } else {
        const auto from = static_cast<double>(std::numeric_limits<T>::min());
        const auto to = static_cast<double>(std::numeric_limits<T>::max());
        const double scaled = from + (value - low) / (high - low) * (to - from);
        return static_cast<T>(std::round(std::clamp(scaled, from, to)));
    }
}

template <class T>
void fill(const SyntheticVolume& volume, const Int3& nodes, VolumeFile& file, Progress& progress) {
    const std::int64_t plane = nodes.x * nodes.y;
    constexpr std::int64_t kSlabBytes = std::int64_t{32} << 20;
    const std::int64_t slab = std::clamp<std::int64_t>(
        kSlabBytes / (plane * static_cast<std::int64_t>(sizeof(T))), 1, nodes.z);
    std::vector<T> values(static_cast<std::size_t>(plane * slab));
    for (std::int64_t z = 0; z < nodes.z; z += slab) {
        progress.check();
        const std::int64_t n = std::min(slab, nodes.z - z);
        tbb::parallel_for(std::int64_t{0}, n * nodes.y, [&](std::int64_t r) {
            thread_local std::vector<double> row;
            row.resize(static_cast<std::size_t>(nodes.x));
            volume.row(r % nodes.y, z + r / nodes.y, row.data());
            T* const to = values.data() + r * nodes.x;
            for (std::int64_t x = 0; x < nodes.x; ++x) {
                to[x] = convert<T>(row[static_cast<std::size_t>(x)], volume.low(), volume.high());
            }
        });
        file.write(reinterpret_cast<const std::byte*>(values.data()), n);
        progress.advance(static_cast<std::uint64_t>(n * plane) * sizeof(T));
    }
}

}  // namespace

void make_volume(const std::filesystem::path& path, const MakeVolumeOptions& options,
                 Progress& progress) {
    for (int axis = 0; axis < 3; ++axis) {
        if (options.nodes[axis] < 1 || options.nodes[axis] > kMaxNodesPerAxis) {
            throw Error(
                ErrorKind::invalid_argument,
                fmt::format("size {} x {} x {}: each axis must have 1 to {} nodes", options.nodes.x,
                            options.nodes.y, options.nodes.z, kMaxNodesPerAxis));
        }
    }
    check_output(path, options.force, {});
    Workers workers(options.threads);
    const auto volume =
        workers.execute([&] { return make_synthetic(options.name, options.nodes, options.seed); });
    VolumeFileSpec spec;
    spec.nodes = options.nodes;
    spec.type = options.type;
    spec.force = options.force;
    const auto file = create_volume_file(path, spec);
    progress.begin(options.name,
                   static_cast<std::uint64_t>(options.nodes.product()) * size_of(options.type),
                   "B");
    workers.execute([&] {
        dispatch(options.type, [&](auto tag) {
            fill<typename decltype(tag)::type>(*volume, options.nodes, *file, progress);
        });
    });
    file->finish();
}

}  // namespace isonest::detail
