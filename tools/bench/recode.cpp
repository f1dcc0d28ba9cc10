// A lower bound for any preprocessing: reads a dataset /data, decodes it if it is compressed,
// compresses it in chunks of 64^3 with shuffle and zstd (level 1 by default), all on all cores, and
// writes the chunks to another HDF5 file, which any HDF5 program with the zstd filter can read.
// Prints the seconds.
#include <fmt/format.h>
#include <hdf5.h>
#include <oneapi/tbb/parallel_for.h>
#include <oneapi/tbb/task_group.h>

#include <array>
#include <chrono>
#include <cstdlib>
#include <cstring>
#include <string>
#include <vector>

#include <isonest/open_volume.h>

#include "store/container/codec.h"
#include "store/container/format.h"
#include "store/container/parts/hdf5_types.h"
#include "store/hdf5/zstd_filter.h"
#include "tools/bench/run_program.h"

namespace {

using namespace isonest;
using namespace isonest::detail;

constexpr std::int64_t kChunk = 64;

int run(int argc, char** argv) {
    const auto start = std::chrono::steady_clock::now();
    SourceOptions options;
    options.dataset = "/data";
    const auto source = open_volume(argv[1], options);
    const VolumeDescription volume = source->describe();
    const Int3 n = volume.nodes;
    const std::size_t size = size_of(volume.type);
    const CodecSpec codec{size, size > 1, argc == 4 ? std::atoi(argv[3]) : 1};

    register_zstd_filter();
    const PropertyHandle access(H5Pcreate(H5P_FILE_ACCESS));
    H5Pset_libver_bounds(access.get(), H5F_LIBVER_V110, H5F_LIBVER_V110);
    const FileHandle out(H5Fcreate(argv[2], H5F_ACC_TRUNC, H5P_DEFAULT, access.get()));
    const PropertyHandle creation(H5Pcreate(H5P_DATASET_CREATE));
    const std::array<hsize_t, 3> chunk{kChunk, kChunk, kChunk};
    H5Pset_chunk(creation.get(), 3, chunk.data());
    H5Pset_fill_time(creation.get(), H5D_FILL_TIME_NEVER);
    if (codec.shuffle) {
        H5Pset_shuffle(creation.get());
    }
    const auto level = static_cast<unsigned>(codec.level);
    H5Pset_filter(creation.get(), kZstdFilter, H5Z_FLAG_MANDATORY, 1, &level);
    const auto dims = dims_of(n, 1);
    const SpaceHandle space(H5Screate_simple(3, dims.data(), nullptr));
    const TypeHandle type = file_type(volume.type);
    const DatasetHandle to(H5Dcreate2(out.get(), "data", type.get(), space.get(), H5P_DEFAULT,
                                      creation.get(), H5P_DEFAULT));

    const Int3 grid = ceil_div(n, {kChunk, kChunk, kChunk});
    std::vector<std::vector<std::byte>> encoded(static_cast<std::size_t>(grid.x * grid.y));
    // Reads the next layer while this one is compressed.
    std::array<std::vector<std::byte>, 2> slabs;
    const auto read = [&](std::int64_t layer) {
        std::vector<std::byte>& slab = slabs[static_cast<std::size_t>(layer % 2)];
        slab.resize(static_cast<std::size_t>(kChunk * n.x * n.y) * size);
        const std::int64_t z = layer * kChunk;
        source->read(z, std::min(kChunk, n.z - z), 0, n.y, slab.data());
    };
    read(0);
    for (std::int64_t layer = 0; layer < grid.z; ++layer) {
        tbb::task_group reading;
        if (layer + 1 < grid.z) {
            reading.run([&] { read(layer + 1); });
        }
        const std::vector<std::byte>& slab = slabs[static_cast<std::size_t>(layer % 2)];
        tbb::parallel_for(std::int64_t{0}, grid.x * grid.y, [&](std::int64_t i) {
            std::vector<std::byte> raw(static_cast<std::size_t>(kChunk * kChunk * kChunk) * size);
            const Int3 low{i % grid.x * kChunk, i / grid.x * kChunk, layer * kChunk};
            const Int3 count = min(low + Int3{kChunk, kChunk, kChunk}, n) - low;
            for (std::int64_t row = 0; row < count.y * count.z; ++row) {
                const std::int64_t y = row % count.y;
                const std::int64_t z = row / count.y;
                std::memcpy(
                    raw.data() + static_cast<std::size_t>((z * kChunk + y) * kChunk) * size,
                    slab.data() +
                        static_cast<std::size_t>((z * n.y + low.y + y) * n.x + low.x) * size,
                    static_cast<std::size_t>(count.x) * size);
            }
            encode_chunk(raw, codec, encoded[static_cast<std::size_t>(i)]);
        });
        for (std::int64_t i = 0; i < grid.x * grid.y; ++i) {
            const auto& bytes = encoded[static_cast<std::size_t>(i)];
            const auto at = dims_of({i % grid.x * kChunk, i / grid.x * kChunk, layer * kChunk}, 1);
            if (H5Dwrite_chunk(to.get(), H5P_DEFAULT, 0, at.data(), bytes.size(), bytes.data()) <
                0) {
                fmt::print(stderr, "{}: cannot write\n", argv[2]);
                return 6;
            }
        }
        reading.wait();
    }
    fmt::print("{:.3f}\n",
               std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count());
    return 0;
}

}  // namespace

int main(int argc, char** argv) {
    if (argc != 3 && argc != 4) {
        fmt::print(stderr, "usage: isonest_recode IN.h5 OUT.h5 [ZSTD_LEVEL]\n");
        return 2;
    }
    return bench::run_program("isonest_recode", [&] { return run(argc, argv); });
}
