// Binary STL: 80 bytes of text, the number of triangles, and 50 bytes for each. The format: 3D
// Systems, "Stereolithography Interface Specification" (1988).
#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <cstring>

#include "query/formats/mesh_sections.h"
#include "store/base/vector3.h"

namespace isonest::detail {
namespace {

using Triangle = std::array<std::array<float, 3>, 3>;

std::array<float, 3> normal_of(const Triangle& p) {
    Double3 a{};
    Double3 b{};
    for (std::size_t i = 0; i < 3; ++i) {
        a[i] = static_cast<double>(p[1][i]) - static_cast<double>(p[0][i]);
        b[i] = static_cast<double>(p[2][i]) - static_cast<double>(p[0][i]);
    }
    const Double3 n = cross(a, b);
    const double size = std::hypot(n[0], n[1], n[2]);
    std::array<float, 3> out{};
    for (std::size_t i = 0; i < 3 && size > 0; ++i) {
        out[i] = static_cast<float>(n[i] / size);
    }
    return out;
}

class StlFile : public SectionedFile {
  public:
    using SectionedFile::SectionedFile;
    void begin(const MeshLayout& layout) override {
        constexpr std::size_t kHeader = 80;
        constexpr std::size_t kRow = 50;
        require_bits(32, layout.elements, "triangles", "STL");
        std::array<char, kHeader + sizeof(std::uint32_t)> header{"binary STL, isonest"};
        if (layout.unit) {
            const std::string unit =
                fmt::format("binary STL, isonest, unit {}", symbol_of(*layout.unit));
            std::copy(unit.begin(), unit.end(), header.begin());
        }
        const auto count = static_cast<std::uint32_t>(layout.elements);
        std::memcpy(header.data() + kHeader, &count, sizeof(count));
        create().write_at(0, std::as_bytes(std::span(header)));
        use({{}, {{header.size(), kRow, [](const ElementBatch& batch, std::byte* out) {
                       for (const auto& t : batch.nearby_corners) {
                           const auto& positions = batch.nearby.positions;
                           const Triangle p{positions[t[0]], positions[t[1]], positions[t[2]]};
                           const auto n = normal_of(p);
                           std::memcpy(out, n.data(), sizeof(n));
                           std::memcpy(out + sizeof(n), p.data(), sizeof(p));
                           std::memset(out + sizeof(n) + sizeof(p), 0, 2);
                           out += kRow;
                       }
                   }}}});
    }
};

}  // namespace

std::unique_ptr<MeshSink> stl_file(const std::filesystem::path& path, const MeshFileOptions& o) {
    return std::make_unique<StlFile>(path, o);
}

}  // namespace isonest::detail
