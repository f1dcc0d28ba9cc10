// Wavefront OBJ: text, so the lines have no fixed places and are written in order.
#include <fmt/format.h>

#include <iterator>

#include "query/formats/mesh_files.h"

namespace isonest::detail {
namespace {

class ObjFile : public MeshFile {
  public:
    using MeshFile::MeshFile;
    void begin_file(const MeshLayout& layout) override {
        create();
        at_ = 0;
        lines_ = layout.corners == 2;
        const VertexAttribute* const normal = layout.find("normal");
        normal_ = normal != nullptr ? std::optional(*normal) : std::nullopt;
        write("# isonest\n");
        if (layout.unit) {
            write(fmt::format("# unit {}\n", symbol_of(*layout.unit)));
        }
        if (layout.frame != AnatomicalFrame::unknown) {
            write(fmt::format("# {}\n", space_text(layout.frame)));
        }
    }

    void add_vertices(const VertexBatch& batch) override {
        std::string text;
        auto out = std::back_inserter(text);
        for (std::size_t i = 0; i < batch.positions.size(); ++i) {
            const std::array<float, 3> p = in_file(batch.positions[i]);
            fmt::format_to(out, "v {:.9g} {:.9g} {:.9g}\n", p[0], p[1], p[2]);
            if (normal_) {
                const std::array<float, 3> n =
                    in_file({static_cast<float>(batch.number(i, *normal_, 0)),
                             static_cast<float>(batch.number(i, *normal_, 1)),
                             static_cast<float>(batch.number(i, *normal_, 2))});
                fmt::format_to(out, "vn {:.6g} {:.6g} {:.6g}\n", n[0], n[1], n[2]);
            }
        }
        write(text);
    }

    void add_elements(const ElementBatch& batch) override {
        std::string text;
        auto out = std::back_inserter(text);
        for (const auto& [a, b, c] : batch.corners) {
            if (lines_) {
                fmt::format_to(out, "l {} {}\n", a + 1, b + 1);
            } else if (normal_) {
                fmt::format_to(out, "f {0}//{0} {1}//{1} {2}//{2}\n", a + 1, b + 1, c + 1);
            } else {
                fmt::format_to(out, "f {} {} {}\n", a + 1, b + 1, c + 1);
            }
        }
        write(text);
    }

  protected:
    [[nodiscard]] bool holds_lines() const override { return true; }

  private:
    void write(const std::string& text) {
        file().write_at(at_, std::as_bytes(std::span(text)));
        at_ += text.size();
    }

    std::uint64_t at_ = 0;
    bool lines_ = false;
    std::optional<VertexAttribute> normal_;
};

}  // namespace

std::unique_ptr<MeshSink> obj_file(const std::filesystem::path& path, const MeshFileOptions& o) {
    return std::make_unique<ObjFile>(path, o);
}

}  // namespace isonest::detail
