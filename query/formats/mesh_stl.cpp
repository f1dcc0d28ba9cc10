// Binary STL: 80 bytes of text, the number of triangles, and 50 bytes for each. The format: 3D
// Systems, "Stereolithography Interface Specification" (1988).
#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cstring>

#include "query/formats/mesh_sections.h"

namespace isonest::detail {
namespace {

class StlFile : public SectionedFile {
  public:
    using SectionedFile::SectionedFile;
    void begin(const MeshLayout& layout) override {
        constexpr std::size_t kHeader = 80;
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
        use({{}, {facet_section(header.size())}});
    }
};

}  // namespace

std::unique_ptr<MeshSink> stl_file(const std::filesystem::path& path, const MeshFileOptions& o) {
    return std::make_unique<StlFile>(path, o);
}

}  // namespace isonest::detail
