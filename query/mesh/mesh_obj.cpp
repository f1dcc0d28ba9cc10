// Wavefront OBJ: text, so the lines have no fixed places and are written in order.
#include <fmt/format.h>

#include <bit>
#include <iterator>
#include <vector>

#include "query/mesh/mesh_sections.h"

namespace isonest::detail {

void write_obj(const std::filesystem::path& path, bool force, const MeshContent& mesh,
               Progress& progress) {
    OutputFile file(path, force);
    progress.begin("write mesh", 2 * mesh.weld.triangles(), "triangles");
    std::uint64_t at = 0;
    std::string text = "# isonest\n";
    const auto flush = [&] {
        file.write_at(at, std::as_bytes(std::span(text)));
        at += text.size();
        text.clear();
    };
    const auto each = [&](auto&& f) {
        std::vector<std::uint64_t> number;
        std::vector<bool> owned;
        for (const PartRecord& r : mesh.parts.records()) {
            progress.check();
            mesh.weld.numbers(r, number, owned);
            f(r, number, owned);
            flush();
            progress.advance(r.triangles);
        }
    };
    const std::size_t width = mesh.parts.attributes_per_vertex();
    each([&](const PartRecord& r, const auto&, const auto& owned) {
        const auto positions = mesh.parts.vertices(r);
        const auto attributes = mesh.parts.attributes(r);
        auto out = std::back_inserter(text);
        for (std::size_t v = 0; v < positions.size(); ++v) {
            if (!owned[v]) {
                continue;
            }
            const auto& p = positions[v];
            fmt::format_to(out, "v {:.9g} {:.9g} {:.9g}\n", p[0], p[1], p[2]);
            if (mesh.attributes.normal) {
                const auto n = attributes.subspan(v * width, 3);
                fmt::format_to(out, "vn {:.6g} {:.6g} {:.6g}\n", std::bit_cast<float>(n[0]),
                               std::bit_cast<float>(n[1]), std::bit_cast<float>(n[2]));
            }
        }
    });
    each([&](const PartRecord& r, const auto& number, const auto&) {
        auto out = std::back_inserter(text);
        for (const auto& t : mesh.parts.triangles(r)) {
            const auto a = number[t[0]] + 1;
            const auto b = number[t[1]] + 1;
            const auto c = number[t[2]] + 1;
            if (mesh.lines) {
                fmt::format_to(out, "l {} {}\n", a, b);
            } else if (mesh.attributes.normal) {
                fmt::format_to(out, "f {0}//{0} {1}//{1} {2}//{2}\n", a, b, c);
            } else {
                fmt::format_to(out, "f {} {} {}\n", a, b, c);
            }
        }
    });
    flush();
    file.publish_as_named();
}

}  // namespace isonest::detail
