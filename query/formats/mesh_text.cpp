#include <fmt/format.h>
#include <oneapi/tbb/task_arena.h>

#include <algorithm>
#include <charconv>
#include <iterator>
#include <string_view>

#include "query/formats/mesh_files.h"
#include "query/formats/zip_writer.h"
#include "store/base/escaped_text.h"
#include "store/base/in_order.h"

namespace isonest::detail {

// Wavefront OBJ: text; the lines have no fixed positions, so they are written in order.

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
            const std::array<float, 3> p = upright(in_file(batch.positions[i]));
            fmt::format_to(out, "v {:.9g} {:.9g} {:.9g}\n", p[0], p[1], p[2]);
            if (normal_) {
                const std::array<float, 3> n =
                    upright(in_file({static_cast<float>(batch.number(i, *normal_, 0)),
                                     static_cast<float>(batch.number(i, *normal_, 1)),
                                     static_cast<float>(batch.number(i, *normal_, 2))}));
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
    [[nodiscard]] std::array<float, 3> upright(const std::array<float, 3>& p) const {
        return is_y_up() ? std::array<float, 3>{p[0], p[2], 0 - p[1]} : p;
    }
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

// 3MF: XML in a ZIP archive. Its lines have no fixed positions, so batches come in order; the slow
// steps, printing and compressing, are done by all threads. The format: 3MF Consortium, "3MF Core
// Specification" 1.4. (lib3mf holds the whole mesh in memory before writing.)

namespace {

constexpr std::string_view kTypes =
    "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n"
    "<Types xmlns=\"http://schemas.openxmlformats.org/package/2006/content-types\">\n"
    "<Default Extension=\"rels\" "
    "ContentType=\"application/vnd.openxmlformats-package.relationships+xml\"/>\n"
    "<Default Extension=\"model\" "
    "ContentType=\"application/vnd.ms-package.3dmanufacturing-3dmodel+xml\"/>\n"
    "</Types>\n";
constexpr std::string_view kRelations =
    "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n"
    "<Relationships xmlns=\"http://schemas.openxmlformats.org/package/2006/relationships\">\n"
    "<Relationship Id=\"rel0\" Target=\"/3D/3dmodel.model\" "
    "Type=\"http://schemas.microsoft.com/3dmanufacturing/2013/01/3dmodel\"/>\n"
    "</Relationships>\n";
constexpr std::string_view kBeforeUnit =
    "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n<model unit=\"";
constexpr std::string_view kBehindUnit =
    "\" xml:lang=\"en-US\" "
    "xmlns=\"http://schemas.microsoft.com/3dmanufacturing/core/2015/02\">\n"
    "<metadata name=\"Application\">isonest</metadata>\n";
constexpr std::string_view kResources = "<resources>\n";
/// The type is "model", which is the default and means a solid, although it is unknown whether the
/// mesh is closed: slicers repair an open "model", but omit other types or reject the file.
constexpr std::string_view kVerticesStart = ">\n<mesh>\n<vertices>\n";
constexpr std::string_view kTriangles = "</vertices>\n<triangles>\n";
constexpr std::string_view kBehindObject = "</triangles>\n</mesh>\n</object>\n";
constexpr std::string_view kBuild = "</resources>\n<build>\n";
constexpr std::string_view kBehindBuild = "</build>\n</model>\n";
/// A mesh must have at least one triangle, so without triangles there is no object.
constexpr std::string_view kNothing = "</resources>\n<build/>\n</model>\n";

/// 3MF's name of a unit, and the unit; coordinates are scaled to it.
struct ThreeMfUnit {
    std::string_view name;
    LengthUnit unit;
};
constexpr std::array<ThreeMfUnit, 6> kUnits{{{"micron", LengthUnit::micrometre},
                                             {"millimeter", LengthUnit::millimetre},
                                             {"centimeter", LengthUnit::centimetre},
                                             {"inch", LengthUnit::inch},
                                             {"foot", LengthUnit::foot},
                                             {"meter", LengthUnit::metre}}};

/// The same unit or, if 3MF lacks it, the next larger one; the metre for still larger units. If the
/// unit is unknown: millimetre, 3MF's default.
ThreeMfUnit unit_in_3mf(std::optional<LengthUnit> unit) {
    switch (unit.value_or(LengthUnit::millimetre)) {
        case LengthUnit::picometre:
        case LengthUnit::angstrom:
        case LengthUnit::nanometre:
            return kUnits.front();
        case LengthUnit::decimetre:
        case LengthUnit::kilometre:
            return kUnits.back();
        default:
            break;
    }
    return *std::find_if(kUnits.begin(), kUnits.end(), [&](const ThreeMfUnit& u) {
        return u.unit == unit.value_or(LengthUnit::millimetre);
    });
}

/// The number of an object in the file; the next one is that of its material.
std::size_t id_of(std::size_t object) {
    return 2 * object + 1;
}

/// The start of the object, preceded by the material that defines its colour, if it has one.
std::string object_of(std::size_t object, const std::string& title,
                      const std::optional<LabelColor>& color) {
    const std::size_t id = id_of(object);
    const std::string name = title.empty() ? "" : fmt::format(" name=\"{}\"", in_markup(title));
    std::string material;
    if (color) {
        material = fmt::format(
            "<basematerials id=\"{}\">\n<base name=\"{}\" "
            "displaycolor=\"#{:02X}{:02X}{:02X}\"/>\n</basematerials>\n",
            id + 1, title.empty() ? "surface" : in_markup(title), (*color)[0], (*color)[1],
            (*color)[2]);
    }
    return fmt::format("{}<object id=\"{}\"{}{}{}", material, id, name,
                       color ? fmt::format(" pid=\"{}\" pindex=\"0\"", id + 1) : "",
                       kVerticesStart);
}

/// Number of vertices or triangles per piece: pieces start at multiples of it, so the bytes do not
/// depend on the batches.
constexpr std::size_t kRows = 2048;
constexpr std::size_t kMaxText = 80;  ///< maximum length of one row

/// The text before each of the three numbers.
using Tag = std::array<std::string_view, 3>;
constexpr Tag kVertex{"<vertex x=\"", "\" y=\"", "\" z=\""};
constexpr Tag kTriangle{"<triangle v1=\"", "\" v2=\"", "\" v3=\""};
constexpr std::string_view kTagEnd = "\"/>\n";

/// Coordinates are not changed: the object is scaled where it is placed.
std::string transform_of(std::optional<LengthUnit> unit) {
    const ThreeMfUnit written = unit_in_3mf(unit);
    return !unit || *unit == written.unit
               ? ""
               : fmt::format(" transform=\"{0} 0 0 0 {0} 0 0 0 {0} 0 0 0\"",
                             converted_length(1, *unit, written.unit));
}

/// Prints float32 with the fewest digits that read back as the same number.
template <class Number>
DeflatedPiece piece_of(const Tag& tag, std::span<const std::array<Number, 3>> rows) {
    std::string text(rows.size() * kMaxText, '\0');
    char* out = text.data();
    for (const auto& row : rows) {
        for (std::size_t i = 0; i < row.size(); ++i) {
            out = std::copy(tag[i].begin(), tag[i].end(), out);
            out = std::to_chars(out, text.data() + text.size(), row[i]).ptr;
        }
        out = std::copy(kTagEnd.begin(), kTagEnd.end(), out);
    }
    return deflate_piece({text.data(), static_cast<std::size_t>(out - text.data())});
}

/// Divides batches into pieces.
template <class Number>
class Rows {
  public:
    using Row = std::array<Number, 3>;
    explicit Rows(const Tag& tag) : tag_(tag) {}

    void add(std::span<const Row> rows, ZipWriter& zip) {
        if (!begun_.empty()) {
            const std::size_t missing = std::min(kRows - begun_.size(), rows.size());
            begun_.insert(begun_.end(), rows.begin(), rows.begin() + missing);
            rows = rows.subspan(missing);
            if (begun_.size() == kRows) {
                flush(zip);
            }
        }
        const std::size_t whole = rows.size() / kRows;
        in_order(
            static_cast<std::int64_t>(whole), tbb::this_task_arena::max_concurrency() + 1,
            [&](std::int64_t i) {
                return piece_of<Number>(tag_,
                                        rows.subspan(static_cast<std::size_t>(i) * kRows, kRows));
            },
            [&](std::int64_t /*i*/, const DeflatedPiece& piece) { zip.add(piece); });
        rows = rows.subspan(whole * kRows);
        begun_.insert(begun_.end(), rows.begin(), rows.end());
    }
    void flush(ZipWriter& zip) {
        if (!begun_.empty()) {
            zip.add(piece_of<Number>(tag_, begun_));
            begun_.clear();
        }
    }

  private:
    const Tag& tag_;
    std::vector<Row> begun_;  ///< rows of an incomplete piece
};

class ThreeMfFile : public MeshFile {
  public:
    using MeshFile::MeshFile;
    void begin_file(const MeshLayout& layout) override {
        std::vector<FileObject> object = single(layout);
        if (layout.elements == 0) {
            object.clear();
        }
        begin_whole(layout.unit, layout.frame, std::move(object));
        if (layout.elements > 0) {
            begin_object(0);
        }
    }
    void begin_objects(std::vector<FileObject> objects) override {
        const MeshLayout first = objects.empty() ? MeshLayout{} : objects.front().layout;
        begin_whole(first.unit, first.frame, std::move(objects));
    }

    void begin_object(std::size_t object) override {
        const FileObject& now = objects_[object];
        vertices_.emplace(kVertex);
        triangles_.emplace(kTriangle);
        left_ = now.layout.vertices;
        zip_->add(object_of(object, now.title, now.color));
    }

    void add_vertices(const VertexBatch& batch) override {
        if (objects_.empty()) {
            return;  // vertices without triangles
        }
        if (is_turned()) {
            std::vector<std::array<float, 3>> positions(batch.positions.size());
            std::transform(batch.positions.begin(), batch.positions.end(), positions.begin(),
                           [this](const auto& p) { return in_file(p); });
            vertices_->add(positions, *zip_);
        } else {
            vertices_->add(batch.positions, *zip_);
        }
        left_ -= batch.positions.size();
        if (left_ == 0) {
            vertices_->flush(*zip_);
            zip_->add(kTriangles);
        }
    }

    void add_elements(const ElementBatch& batch) override { triangles_->add(batch.corners, *zip_); }

    void end_object() override {
        triangles_->flush(*zip_);
        zip_->add(kBehindObject);
        triangles_.reset();
    }

    void end() override {
        std::string text;
        if (triangles_) {
            triangles_->flush(*zip_);
            text = kBehindObject;
        }
        text += objects_.empty() ? kNothing : kBuild;
        for (std::size_t i = 0; i < objects_.size(); ++i) {
            text += fmt::format("<item objectid=\"{}\"{}/>\n", id_of(i),
                                transform_of(objects_[i].layout.unit));
        }
        text += objects_.empty() ? "" : kBehindBuild;
        zip_->add(text);
        zip_->end_entry();
        zip_->finish();
        zip_.reset();
        MeshFile::end();
    }

  private:
    /// The archive up to the first object.
    void begin_whole(std::optional<LengthUnit> unit, AnatomicalFrame frame,
                     std::vector<FileObject> objects) {
        constexpr int kBits = 31;
        for (const FileObject& object : objects) {
            require_bits(kBits, object.layout.vertices, "vertices", "3MF");
            require_bits(kBits, object.layout.elements, "triangles", "3MF");
        }
        objects_ = std::move(objects);
        triangles_.reset();
        ZipWriter& zip = zip_.emplace(create());
        zip.begin_entry("[Content_Types].xml");
        zip.add(kTypes);
        zip.end_entry();
        zip.begin_entry("_rels/.rels");
        zip.add(kRelations);
        zip.end_entry();
        zip.begin_entry("3D/3dmodel.model");
        zip.add(fmt::format("{}{}{}", kBeforeUnit, unit_in_3mf(unit).name, kBehindUnit));
        if (frame != AnatomicalFrame::unknown) {
            zip.add(
                fmt::format("<metadata name=\"Description\">{}</metadata>\n", space_text(frame)));
        }
        zip.add(kResources);
    }

    std::vector<FileObject> objects_;
    std::optional<ZipWriter> zip_;
    std::optional<Rows<float>> vertices_;
    std::optional<Rows<std::uint64_t>> triangles_;  ///< of the object that has begun
    std::uint64_t left_ = 0;                        ///< number of vertices still to come
};

}  // namespace

std::unique_ptr<MeshSink> threemf_file(const std::filesystem::path& path,
                                       const MeshFileOptions& o) {
    return std::make_unique<ThreeMfFile>(path, o);
}

}  // namespace isonest::detail
