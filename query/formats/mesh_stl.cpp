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
    void begin_file(const MeshLayout& layout) override {
        constexpr std::size_t kHeader = 80;
        require_bits(32, layout.elements, "triangles", "STL");
        std::array<char, kHeader + sizeof(std::uint32_t)> header{"binary STL, isonest"};
        std::string text(header.data());
        if (layout.unit) {
            text += fmt::format(", unit {}", symbol_of(*layout.unit));
        }
        if (layout.frame != AnatomicalFrame::unknown) {
            text += ", " + space_text(layout.frame);
        }
        std::copy(text.begin(), text.end(), header.begin());
        const auto count = static_cast<std::uint32_t>(layout.elements);
        std::memcpy(header.data() + kHeader, &count, sizeof(count));
        create().write_at(0, std::as_bytes(std::span(header)));
        use({{}, {facet_section(header.size())}}, layout);
    }
};

}  // namespace

std::unique_ptr<MeshSink> stl_file(const std::filesystem::path& path, const MeshFileOptions& o) {
    return std::make_unique<StlFile>(path, o);
}

}  // namespace isonest::detail
