// Targets that open bytes as inputs of `preprocess`.
#include <algorithm>
#include <cstddef>
#include <filesystem>
#include <optional>
#include <string>
#include <string_view>

#include <isonest/open_volume.h>

#include "tests/fuzz/scratch.h"
#include "tests/fuzz/targets.h"

namespace isonest::detail::fuzz {

void one_file(const char* name, Bytes bytes) {
    SourceOptions options;
    options.labels = true;
    options.max_heap = kMemory;
    if (!bytes.empty() && (bytes.back() & 0x80U) != 0) {  // the choice among several arrays
        options.dataset = "v";
        options.index = {AxisIndex{"c", 1}};
    }
    use_volume(written(name, bytes), options);
}

void dicom(Bytes bytes) {
    static const fs::path root = folder() / "dicom";
    fs::remove_all(root);
    fs::create_directories(root);
    constexpr std::size_t kMaxFiles = 4;
    for (std::size_t i = 0; i < kMaxFiles && bytes.size() > 2; ++i) {
        const std::size_t length = bytes[0] + std::size_t{256} * bytes[1];
        bytes = bytes.subspan(2);
        const Bytes file = bytes.first(std::min(length, bytes.size()));
        bytes = bytes.subspan(file.size());
        written(("dicom/" + std::to_string(i)).c_str(), file);
    }
    SourceOptions options;
    options.labels = true;
    options.max_heap = kMemory;
    use_volume(root, options);
    for (const auto& index : {AxisIndex{"stack", 0}, AxisIndex{"segment", 1}, AxisIndex{"t", -1}}) {
        options.index = {index};
        use_volume(root, options);
    }
}

void nrrd(Bytes bytes) {
    SourceOptions options;
    options.labels = true;
    options.max_heap = kMemory;
    use_volume(written("v.nrrd", bytes), options);
}

void volume(Bytes bytes) {
    one_file("v", bytes);
}

void zarr(Bytes bytes) {
    if (bytes.size() < 3) {
        return;
    }
    const std::size_t length = bytes[1] + std::size_t{256} * bytes[2];
    const Bytes rest = bytes.subspan(3);
    const Bytes description = rest.first(std::min(length, rest.size()));
    const Bytes chunk = rest.subspan(description.size());
    static const fs::path root = folder() / "v.zarr";
    fs::remove_all(root);
    fs::create_directories(root / "c" / "0" / "0");
    switch (bytes[0] % 3) {
        case 0:
            written("v.zarr/.zarray", description);
            written("v.zarr/0.0.0", chunk);
            break;
        case 1:
            written("v.zarr/zarr.json", description);
            written("v.zarr/c/0/0/0", chunk);
            break;
        default: {  // a group with a valid array
            constexpr std::string_view kArray =
                R"({"zarr_format": 3, "node_type": "array", "shape": [2, 3, 4], "data_type": "uint8",
                "chunk_grid": {"name": "regular", "configuration": {"chunk_shape": [2, 3, 4]}},
                "chunk_key_encoding": {"name": "default"}, "fill_value": 7, "codecs": [{"name": "bytes"}],
                "attributes": {}})";
            fs::create_directories(root / "0");
            written("v.zarr/zarr.json", description);
            written("v.zarr/0/zarr.json",
                    {reinterpret_cast<const std::uint8_t*>(kArray.data()), kArray.size()});
            break;
        }
    }
    SourceOptions options;
    options.labels = true;
    options.max_heap = kMemory;
    use_volume(root, options);
}

void raw(Bytes bytes) {
    if (bytes.size() < 8) {
        return;
    }
    SourceOptions options;
    options.max_heap = kMemory;
    options.dims = Int3{1 + bytes[0], 1 + bytes[1], 1 + bytes[2] % 8};
    options.type = static_cast<ValueType>(bytes[3] % 8);
    options.big_endian = (bytes[4] & 1U) != 0;
    options.offset = (bytes[4] & 2U) != 0 ? std::optional<std::uint64_t>(bytes[5]) : std::nullopt;
    if ((bytes[4] & 4U) != 0) {
        options.missing = bytes[6];
    }
    use_volume(written("v.raw", bytes.subspan(8)), options);
}

}  // namespace isonest::detail::fuzz
