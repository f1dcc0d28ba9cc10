// The floor for any preprocessing: read a dataset /data, compress it in chunks of 64^3 with shuffle
// and zstd (level 1 unless told) on all cores, write the chunks to another HDF5 file. Prints the
// seconds.
#include <fmt/format.h>
#include <hdf5.h>
#include <oneapi/tbb/parallel_for.h>

#include <array>
#include <chrono>
#include <cstdlib>
#include <cstring>
#include <string>
#include <vector>

#include "store/codec.h"

int main(int argc, char** argv) {
    if (argc != 3 && argc != 4) {
        fmt::print(stderr, "usage: isonest_recode IN.h5 OUT.h5 [ZSTD_LEVEL]\n");
        return 2;
    }
    const auto start = std::chrono::steady_clock::now();
    constexpr hsize_t kChunk = 64;
    const hid_t in = H5Fopen(argv[1], H5F_ACC_RDONLY, H5P_DEFAULT);
    const hid_t data = in < 0 ? -1 : H5Dopen2(in, "data", H5P_DEFAULT);
    if (data < 0) {
        fmt::print(stderr, "{}: no dataset /data\n", argv[1]);
        return 3;
    }
    const hid_t type = H5Dget_type(data);
    const hid_t space = H5Dget_space(data);
    const std::size_t size = H5Tget_size(type);
    std::array<hsize_t, 3> n{};
    H5Sget_simple_extent_dims(space, n.data(), nullptr);

    const hid_t access = H5Pcreate(H5P_FILE_ACCESS);
    H5Pset_libver_bounds(access, H5F_LIBVER_V110, H5F_LIBVER_V110);
    const hid_t out = H5Fcreate(argv[2], H5F_ACC_TRUNC, H5P_DEFAULT, access);
    const hid_t creation = H5Pcreate(H5P_DATASET_CREATE);
    const std::array<hsize_t, 3> chunk{kChunk, kChunk, kChunk};
    H5Pset_chunk(creation, 3, chunk.data());
    H5Pset_fill_time(creation, H5D_FILL_TIME_NEVER);
    const hid_t to = H5Dcreate2(out, "data", type, space, H5P_DEFAULT, creation, H5P_DEFAULT);

    const isonest::CodecSpec codec{size, size > 1, argc == 4 ? std::atoi(argv[3]) : 1};
    std::vector<std::byte> slab(kChunk * n[1] * n[2] * size);
    const hsize_t gy = (n[1] + kChunk - 1) / kChunk;
    const hsize_t gx = (n[2] + kChunk - 1) / kChunk;
    std::vector<std::vector<std::byte>> encoded(gy * gx);
    for (hsize_t z = 0; z < n[0]; z += kChunk) {
        const std::array<hsize_t, 3> at{z, 0, 0};
        const std::array<hsize_t, 3> count{std::min(kChunk, n[0] - z), n[1], n[2]};
        H5Sselect_hyperslab(space, H5S_SELECT_SET, at.data(), nullptr, count.data(), nullptr);
        const hid_t memory = H5Screate_simple(3, count.data(), nullptr);
        if (H5Dread(data, type, memory, space, H5P_DEFAULT, slab.data()) < 0) {
            return 6;
        }
        H5Sclose(memory);
        tbb::parallel_for(hsize_t{0}, gy * gx, [&](hsize_t i) {
            std::vector<std::byte> raw(kChunk * kChunk * kChunk * size);
            const hsize_t y0 = i / gx * kChunk;
            const hsize_t x0 = i % gx * kChunk;
            for (hsize_t dz = 0; dz < count[0]; ++dz) {
                for (hsize_t dy = 0; dy < std::min(kChunk, n[1] - y0); ++dy) {
                    std::memcpy(raw.data() + (dz * kChunk + dy) * kChunk * size,
                                slab.data() + ((dz * n[1] + y0 + dy) * n[2] + x0) * size,
                                std::min(kChunk, n[2] - x0) * size);
                }
            }
            isonest::encode_chunk(raw, codec, encoded[i]);
        });
        for (hsize_t i = 0; i < gy * gx; ++i) {
            const std::array<hsize_t, 3> offset{z, i / gx * kChunk, i % gx * kChunk};
            H5Dwrite_chunk(to, H5P_DEFAULT, 0, offset.data(), encoded[i].size(), encoded[i].data());
        }
    }
    H5Dclose(to);
    H5Fclose(out);
    H5Dclose(data);
    H5Fclose(in);
    fmt::print("{:.3f}\n",
               std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count());
    return 0;
}
