#include "tests/fuzz/targets.h"

#include <hdf5.h>

#include <algorithm>
#include <cstring>
#include <filesystem>
#include <vector>

#include <isonest/error.h>

#include "preprocess/sources/wrapping/label_names.h"
#include "query/check/check.h"
#include "store/bytes/store_bytes.h"
#include "store/container/parts/footer.h"
#include "store/container/parts/hdf5_types.h"
#include "tests/fuzz/scratch.h"
#include "tests/support/test_support.h"
#include "tools/drawing/input/ply_reader.h"

namespace isonest::detail::fuzz {
namespace {

/// A complete small store with this name, made once and copied.
fs::path fresh_store(const char* name) {
    static const fs::path whole = [] {
        test::FunctionVolume<std::int16_t> volume({9, 10, 11}, [](const Int3& p) {
            return static_cast<std::int16_t>(90 * p.z + (p.x + 9 * p.y) * 7 % 90);
        });
        PreprocessOptions options = test::with_chunk(8);
        options.threads = 1;
        test::make_store(volume, folder() / "whole", options);
        return folder() / "whole";
    }();
    fs::copy_file(whole, folder() / name, fs::copy_options::overwrite_existing);
    return folder() / name;
}

void use_store(const fs::path& path) {
    try {
        const StoreReader store(path);
        if (store.layout().rows() > 100000) {
            return;  // valid, but slow
        }
        CheckOptions options;
        options.threads = 1;
        options.memory = kMemory;
        check(store, options, silent_progress());
        test::Extraction query;
        query.iso = 300;
        query.memory = kMemory;
        query.threads = 1;
        test::extract(store, folder() / "m.ply", query, silent_progress());
    } catch (const Error&) {
        // Refused.
    }
}

}  // namespace

void open_store(Bytes bytes) {
    use_store(written("open", bytes));
}

void store_header(Bytes bytes) {
    const fs::path path = fresh_store("header");
    const hid_t file = H5Fopen(path.c_str(), H5F_ACC_RDWR, H5P_DEFAULT);
    constexpr std::array<const char*, 9> kNames{
        "nodes", "spacing", "origin", "value_type", "chunk", "version", "fields", "range", "flags"};
    while (!bytes.empty()) {
        const char* const name = kNames[bytes[0] % kNames.size()];
        bytes = bytes.subspan(1);
        const hid_t attribute = H5Aopen(file, name, H5P_DEFAULT);
        const hid_t type = H5Aget_type(attribute);
        const hid_t space = H5Aget_space(attribute);
        std::vector<std::uint8_t> value(
            H5Tget_size(type) * static_cast<std::size_t>(H5Sget_simple_extent_npoints(space)));
        H5Aread(attribute, type, value.data());
        const std::size_t n = std::min(value.size(), bytes.size());
        std::copy_n(bytes.begin(), n, value.begin());
        H5Awrite(attribute, type, value.data());
        bytes = bytes.subspan(n);
        H5Sclose(space);
        H5Tclose(type);
        H5Aclose(attribute);
    }
    H5Fclose(file);
    use_store(path);
}

void chunk_table(Bytes bytes) {
    const fs::path path = fresh_store("table");
    const hid_t file = H5Fopen(path.c_str(), H5F_ACC_RDWR, H5P_DEFAULT);
    const hid_t table = H5Dopen2(file, "chunks", H5P_DEFAULT);
    const hid_t space = H5Dget_space(table);
    const hid_t type = H5Dget_type(table);
    std::vector<ChunkRow> rows(static_cast<std::size_t>(H5Sget_simple_extent_npoints(space)));
    H5Dread(table, type, H5S_ALL, H5S_ALL, H5P_DEFAULT, rows.data());
    auto* const raw = reinterpret_cast<std::uint8_t*>(rows.data());
    const std::size_t size = rows.size() * sizeof(ChunkRow);
    // Groups of a position (two bytes) and a word to write there.
    for (; bytes.size() >= 10; bytes = bytes.subspan(10)) {
        const std::size_t at = (bytes[0] + std::size_t{256} * bytes[1]) % size;
        std::copy_n(bytes.begin() + 2, std::min<std::size_t>(8, size - at), raw + at);
    }
    H5Dwrite(table, type, H5S_ALL, H5S_ALL, H5P_DEFAULT, rows.data());
    const std::uint64_t sum = checksum_of(std::as_bytes(std::span(rows)));
    const hid_t attribute = H5Aopen(table, "xxh64", H5P_DEFAULT);
    H5Awrite(attribute, H5T_NATIVE_UINT64, &sum);
    H5Aclose(attribute);
    H5Tclose(type);
    H5Sclose(space);
    H5Dclose(table);
    H5Fclose(file);
    use_store(path);
}

/// The first byte: whether the catalogue is changed, or the footer with a valid or an invalid
/// checksum.
void footer(Bytes bytes) {
    if (bytes.empty()) {
        return;
    }
    const fs::path path = fresh_store("footer");
    std::string whole = test::read_file(path);
    const FileBytes file(path);
    const FoundCatalogue found = *find_catalogue(file);
    const auto old = found.bytes.bytes();
    std::vector<std::byte> catalogue(old.begin(), old.end());
    const std::size_t choice = bytes[0] % 4;
    const auto patch = [&](std::byte* raw, std::size_t size) {
        // Groups of a position (two bytes) and a word to write there.
        for (Bytes rest = bytes.subspan(1); rest.size() >= 10; rest = rest.subspan(10)) {
            const std::size_t at = (rest[0] + std::size_t{256} * rest[1]) % size;
            std::memcpy(raw + at, rest.data() + 2, std::min<std::size_t>(8, size - at));
        }
    };
    if (choice < 2) {
        patch(catalogue.data(), catalogue.size());
    }
    whole.resize(found.footer.hdf5_end);
    std::vector<std::byte> tail = bytes_behind_hdf5(found.footer.hdf5_end, catalogue);
    if (choice == 2) {
        patch(tail.data() + tail.size() - kFooterBytes, kFooterBytes);
    } else if (choice == 3) {  // a footer of arbitrary bytes with a valid checksum
        std::byte* const last = tail.data() + tail.size() - kFooterBytes;
        constexpr std::size_t kSummed = 48;
        patch(last, 40);
        const std::uint64_t sum = checksum_of({last, kSummed});
        std::memcpy(last + kSummed, &sum, sizeof(sum));
    }
    whole.append(reinterpret_cast<const char*>(tail.data()), tail.size());
    use_store(
        written("footer", {reinterpret_cast<const std::uint8_t*>(whole.data()), whole.size()}));
}

void label_table(Bytes bytes) {
    static const fs::path whole = [] {
        const auto named = with_label_names(
            std::make_unique<test::FunctionVolume<std::int16_t>>(
                Int3{9, 9, 9}, [](const Int3& p) { return static_cast<std::int16_t>(p.x); }),
            {{3, "a", LabelColor{1, 2, 3}}});
        PreprocessOptions options = test::with_chunk(8);
        options.threads = 1;
        preprocess(*named, folder() / "named", options, silent_progress());
        return folder() / "named";
    }();
    if (bytes.empty()) {
        return;
    }
    const std::size_t name_bytes = 1 + bytes[0] % LabelName::kMaxBytes;
    const TypeHandle type = label_row_type(name_bytes);
    const std::size_t row = H5Tget_size(type.get());
    const hsize_t count = (bytes.size() - 1) / row;
    if (count == 0) {
        return;
    }
    const fs::path path = folder() / "names";
    fs::copy_file(whole, path, fs::copy_options::overwrite_existing);
    {
        const FileHandle file(H5Fopen(path.c_str(), H5F_ACC_RDWR, H5P_DEFAULT));
        H5Ldelete(file.get(), "label_names", H5P_DEFAULT);
        const SpaceHandle space(H5Screate_simple(1, &count, nullptr));
        const DatasetHandle table(H5Dcreate2(file.get(), "label_names", type.get(), space.get(),
                                             H5P_DEFAULT, H5P_DEFAULT, H5P_DEFAULT));
        const Bytes rows = bytes.subspan(1, count * row);
        H5Dwrite(table.get(), type.get(), H5S_ALL, H5S_ALL, H5P_DEFAULT, rows.data());
        write_attribute(table.get(), "xxh64", checksum_of(std::as_bytes(rows)));
    }
    try {
        const Store store(path);
        for (const LabelName& label : store.label_names()) {
            static_cast<void>(store.label_name(label.id + 1));
            static_cast<void>(store.labels_named(label.name));
        }
    } catch (const Error&) {
        // Refused.
    }
}

void label_file(Bytes bytes) {
    try {
        read_label_file(written("t.txt", bytes), kMemory);
    } catch (const Error&) {
        // Refused.
    }
}

void chunk_decode(Bytes bytes) {
    if (bytes.size() < 3) {
        return;
    }
    CodecSpec spec;
    spec.element_size = std::size_t{1} << (bytes[0] % 4U);
    spec.shuffle = (bytes[0] & 4U) != 0 && spec.element_size > 1;
    const std::size_t elements = bytes[1] + std::size_t{256} * bytes[2];
    std::vector<std::byte> raw(elements * spec.element_size);
    try {
        decode_chunk(std::as_bytes(bytes.subspan(3)), spec, raw, {"chunk"});
    } catch (const Error&) {
        // Refused.
    }
}

void ply(Bytes bytes) {
    try {
        const cli::PlyMesh mesh(written("f.ply", bytes));
        for (std::uint64_t i = 0; i < mesh.vertices(); ++i) {
            keep(mesh.vertex(i)[0] + mesh.value(i));
        }
        for (std::uint64_t i = 0; i < mesh.triangles(); ++i) {
            keep(mesh.triangle(i)[0]);
        }
    } catch (const Error&) {
        // Refused.
    }
}

const std::vector<Target>& targets() {
    static const std::vector<Target> all{
        {"open_store", open_store},
        {"store_header", store_header},
        {"chunk_table", chunk_table},
        {"footer", footer},
        {"label_table", label_table},
        {"label_file", label_file},
        {"chunk_decode", chunk_decode},
        {"nrrd", nrrd},
        {"raw", raw},
        {"volume", volume},
        {"zarr", zarr},
        {"dicom", dicom},
        {"nifti", [](Bytes bytes) { one_file("v.nii", bytes); }},
        {"meta_image", [](Bytes bytes) { one_file("v.mha", bytes); }},
        {"mrc", [](Bytes bytes) { one_file("v.mrc", bytes); }},
        {"mgh", [](Bytes bytes) { one_file("v.mgh", bytes); }},
        {"known", [](Bytes bytes) { one_file("v.img", bytes); }},
        {"tiff", [](Bytes bytes) { one_file("v.tif", bytes); }},
        {"numpy", [](Bytes bytes) { one_file("v.npy", bytes); }},
        {"netcdf3", [](Bytes bytes) { one_file("v.nc", bytes); }},
        {"vtk", [](Bytes bytes) { one_file("v.vtk", bytes); }},
        {"vti", [](Bytes bytes) { one_file("v.vti", bytes); }},
        {"remote_zarr", remote_zarr},
        {"answer", answer},
        {"object_url", object_url},
        {"cached_block", cached_block},
        {"ply", ply}};
    return all;
}

}  // namespace isonest::detail::fuzz
