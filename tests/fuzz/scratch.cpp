#include "tests/fuzz/scratch.h"

#include <algorithm>
#include <cstddef>
#include <fstream>
#include <vector>

#include <isonest/error.h>

namespace isonest::detail::fuzz {

const test::TemporaryFolder& folder() {
    static const test::TemporaryFolder folder;
    return folder;
}

fs::path written(const char* name, Bytes bytes) {
    fs::path path = folder() / name;
    std::ofstream out(path, std::ios::binary | std::ios::trunc);
    out.write(reinterpret_cast<const char*>(bytes.data()),
              static_cast<std::streamsize>(bytes.size()));
    return path;
}

void keep(double value) {
    static volatile double sink = 0;
    sink = sink + value;
}

void use_volume(const fs::path& path, const SourceOptions& options) {
    try {
        const auto source = open_volume(path, options);
        const VolumeDescription volume = source->describe();
        const Int3 n = volume.nodes;
        const std::size_t row = static_cast<std::size_t>(n.x) * size_of(volume.type);
        if (row * static_cast<std::size_t>(n.y) > (std::size_t{1} << 22U)) {
            return;
        }
        std::vector<std::byte> plane(row * static_cast<std::size_t>(n.y));
        for (std::int64_t z = 0; z < std::min<std::int64_t>(n.z, 64); ++z) {
            source->read(z, 1, 0, n.y, plane.data());
        }
        std::uint64_t sum = 0;  // the mapping must be readable to its end
        for (const std::byte b : source->mapped().first(
                 std::min<std::size_t>(source->mapped().size(), std::size_t{1} << 22U))) {
            sum += static_cast<std::uint64_t>(b);
        }
        keep(static_cast<double>(sum));
        for (const LabelName& label : source->label_names()) {
            keep(static_cast<double>(label.id));
        }
    } catch (const Error&) {
        // Refused.
    }
}

}  // namespace isonest::detail::fuzz
