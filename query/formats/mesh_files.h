// The mesh formats: each is a sink that writes a file.
#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <tuple>
#include <utility>
#include <vector>

#include <isonest/mesh_file.h>

#include "store/exports/polydata_file.h"
#include "store/files/open_file.h"
#include "store/files/output_file.h"

namespace isonest::detail {

/// An object of a file that holds several.
struct FileObject {
    MeshLayout layout = {};  ///< with the frame and the box of the mesh in the file
    std::string title = {};
    std::optional<LabelColor> color = {};
};

/// Opens, publishes and discards the file; a format writes into file(), which exists from create()
/// to end().
class MeshFile : public MeshSink {
  public:
    MeshFile(std::filesystem::path path, MeshFileOptions options)
        : path_(std::move(path)), options_(std::move(options)) {}
    void prepare(const MeshLayout& layout, std::span<const std::filesystem::path> inputs) override;
    void begin(const MeshLayout& layout) final;
    void end() override;

    /// Called in place of begin() for formats of several objects. For each object in turn, it is
    /// followed by begin_object(), all batches in ascending order, vertices first, and
    /// end_object(). The layouts are those of the meshes before any conversion of their frame.
    void begin_all(std::vector<FileObject> objects);
    virtual void begin_object(std::size_t object) { static_cast<void>(object); }
    virtual void end_object() {}
    /// Throws Error{limit} if the count (of "vertices", for example) is not below 2^bits.
    void require_bits(unsigned bits, std::uint64_t count, const char* what,
                      const char* format) const;

  protected:
    /// Like begin_all(), with the frames and the boxes of the meshes in the file.
    // NOLINTNEXTLINE(performance-unnecessary-value-param): formats with several objects keep them
    virtual void begin_objects(std::vector<FileObject> objects) { static_cast<void>(objects); }
    /// The only object of a file with one mesh.
    [[nodiscard]] std::vector<FileObject> single(const MeshLayout& layout) const {
        return {{layout, options_.title, options_.color}};
    }
    /// Like begin(), with the frame and the box of the mesh in the file.
    virtual void begin_file(const MeshLayout& layout) = 0;
    /// Whether positions and normals must be converted to the other frame for the file: x and y are
    /// then negated.
    [[nodiscard]] bool is_turned() const { return turned_; }
    [[nodiscard]] std::array<float, 3> in_file(const std::array<float, 3>& p) const {
        return turned_ ? std::array<float, 3>{0 - p[0], 0 - p[1], p[2]} : p;
    }
    [[nodiscard]] const std::filesystem::path& path() const { return path_; }
    /// Empty: none.
    [[nodiscard]] const std::string& title() const { return options_.title; }
    [[nodiscard]] const std::optional<LabelColor>& color() const { return options_.color; }
    [[nodiscard]] const Double3& shift() const { return options_.shift; }
    [[nodiscard]] const std::optional<VertexColors>& colors() const { return options_.colors; }
    /// Whether y points up in the file.
    [[nodiscard]] bool is_y_up() const { return options_.up == UpAxis::y; }
    /// Whether the format supports lines.
    [[nodiscard]] virtual bool holds_lines() const { return false; }
    /// Whether the format supports colours of vertices.
    [[nodiscard]] virtual bool holds_colors() const { return false; }
    /// Whether the format supports labels on both sides of triangles.
    [[nodiscard]] virtual bool holds_sides() const { return false; }
    /// Whether the format supports attributes of any name.
    [[nodiscard]] virtual bool holds_fields() const { return false; }
    /// `prepare`: as of OutputFile.
    OutputFile& create(
        const std::function<void(const std::filesystem::path& temporary)>& prepare = {});
    [[nodiscard]] OutputFile& file() { return *file_; }

  private:
    /// The layout in the file. Sets turned_.
    MeshLayout layout_in_file(const MeshLayout& layout);

    std::filesystem::path path_;
    MeshFileOptions options_;
    std::optional<OutputFile> file_;
    bool turned_ = false;
};

/// The frame of a mesh's positions in a file of this name. Throws Error{invalid_argument} if a
/// frame is requested and the volume's is unknown.
AnatomicalFrame frame_in_file(AnatomicalFrame frame, MeshSpace space,
                              const std::filesystem::path& path);

/// The text read by 3D Slicer, for example "SPACE=RAS". Empty if the frame is unknown.
std::string space_text(AnatomicalFrame frame);

/// Whether the extraction itself makes this attribute. All others are fields (vertex_fields.h).
bool is_of_extraction(const VertexAttribute& attribute);

/// The attribute shown by default: the value, else the error, else the first scalar field; null if
/// there is none of these.
const VertexAttribute* main_scalar(const MeshLayout& layout);

/// The attribute's name in glTF: its own name, or an application-specific one, which must start
/// with an underscore.
std::string semantic_of(const VertexAttribute& attribute);

/// Throws Error{invalid_argument} if files of this name have a unit of their own.
void require_free_unit(const std::filesystem::path& path);

/// A sink that passes the mesh on with positions in another unit. Its prepare() throws
/// Error{invalid_argument} if the mesh's unit is unknown.
std::unique_ptr<MeshSink> converted(std::unique_ptr<MeshSink> sink, LengthUnit unit);

std::unique_ptr<MeshSink> ply_file(const std::filesystem::path& path, const MeshFileOptions& o);
std::unique_ptr<MeshSink> stl_file(const std::filesystem::path& path, const MeshFileOptions& o);
std::unique_ptr<MeshSink> obj_file(const std::filesystem::path& path, const MeshFileOptions& o);
std::unique_ptr<MeshSink> vtp_file(const std::filesystem::path& path, const MeshFileOptions& o);
std::unique_ptr<MeshSink> vtkhdf_file(const std::filesystem::path& path, const MeshFileOptions& o);
std::unique_ptr<MeshSink> glb_file(const std::filesystem::path& path, const MeshFileOptions& o);
std::unique_ptr<MeshSink> threemf_file(const std::filesystem::path& path, const MeshFileOptions& o);
std::unique_ptr<MeshSink> ngmesh_file(const std::filesystem::path& path, const MeshFileOptions& o);

// The common part of the binary mesh formats: tables with one row per vertex or element, each at a
// known place in the file, so that all batches can be written concurrently.

/// How a row stores a vertex's colour: not; red, green, blue as displayed, one byte each; or red,
/// green, blue and an alpha of 1 as linear numbers of 16 bits.
enum class ColorForm : std::uint32_t { none, displayed8, linear16 };

/// The colour of a value: linear between color(0) for `low` and color(255) for `high`, and all
/// those between.
template <class Color>
Double3 color_between(double low, double high, double value, const Color& color) {
    constexpr std::size_t kLast = std::tuple_size_v<decltype(VertexColors::map)> - 1;
    const double part = (value - low) / (high - low);
    // Not std::clamp, so that NaN gets the first colour.
    const double at = part > 0 ? std::min(part, 1.0) * static_cast<double>(kLast) : 0;
    const auto i = std::min(static_cast<std::size_t>(at), kLast - 1);
    const Double3 from = color(i);
    const Double3 to = color(i + 1);
    Double3 between{};
    for (std::size_t c = 0; c < 3; ++c) {
        between[c] = from[c] + (at - static_cast<double>(i)) * (to[c] - from[c]);
    }
    return between;
}

/// Colours by an attribute, as plain numbers.
struct ColorScale {
    ColorForm form = ColorForm::none;
    bool is_double = false;  ///< the attribute is
    std::size_t first = 0;   ///< first byte of the attribute in a vertex's row
    double low = 0;
    double high = 1;
    /// Evenly spaced, in the form's terms, in numbers of 16 bits.
    std::array<std::array<std::uint16_t, 3>, 256> map{};

    [[nodiscard]] std::size_t bytes() const {
        return form == ColorForm::none         ? 0
               : form == ColorForm::displayed8 ? 3
                                               : 4 * sizeof(std::uint16_t);
    }
};
/// REQUIRES: the layout has the colours' attribute, and low < high.
ColorScale color_scale(const VertexColors& colors, const MeshLayout& layout, ColorForm form);

/// Converts a display value from 0 to 255 to a linear one from 0 to 1. Source: IEC 61966-2-1.
double linear_of(std::uint8_t shown);

/// A table with a row for every vertex: its position, some bytes of its attributes, its colour, or
/// several of them.
struct VertexSection {
    std::uint64_t offset = 0;
    bool position = false;
    std::size_t first = 0;  ///< first byte of the attributes
    std::size_t bytes = 0;
    double scale = 1;    ///< of the position
    Double3 shift = {};  ///< added to the position before scaling
    /// If the rows are in base64: the whole array; `offset` then counts its bytes.
    Base64Array base64 = {};
    /// Whether x and y of the position are negated, and of the normal. `normal`: the normal's first
    /// byte in a row of attributes; kNoNormal if the section has none.
    bool turned = false;
    std::size_t normal = kNoNormal;
    static constexpr std::size_t kNoNormal = ~std::size_t{0};
    ColorScale color = {};  ///< follows the attributes

    [[nodiscard]] std::size_t stride() const {
        return (position ? sizeof(std::array<float, 3>) : 0) + bytes + color.bytes();
    }
};
VertexSection position_section(std::uint64_t offset, double scale = 1);
VertexSection attribute_section(std::uint64_t offset, const VertexAttribute& attribute);
VertexSection color_section(std::uint64_t offset, const ColorScale& color);

/// Contents of an element's row.
enum class ElementRow : std::uint32_t { corners, end, common, sides, corners32, facet };

/// A table with a row of `stride` bytes for every element.
struct ElementSection {
    std::uint64_t offset = 0;
    std::size_t stride = 0;
    ElementRow row = ElementRow::corners;
    std::size_t corners = 3;
    std::size_t first = 0;  ///< first byte of the attributes that the vertices have in common
    std::size_t bytes = 0;
    bool has_prefix = false;  ///< corners32: preceded by the byte `prefix`
    bool has_sides = false;   ///< corners32: followed by the labels of both sides, int32
    std::byte prefix{};
    bool turned = false;      ///< facet: x and y of the corners are negated
    Base64Array base64 = {};  ///< as in VertexSection
};
/// The numbers of the first `corners` corners, int64; and, for each cell, the running total of
/// corners.
ElementSection connectivity_section(std::uint64_t offset, std::size_t corners);
ElementSection ends_section(std::uint64_t offset, std::size_t corners);
/// An attribute that the vertices of each element have in common.
ElementSection common_section(std::uint64_t offset, const VertexAttribute& attribute);
/// The labels behind and in front of each element, int64.
ElementSection sides_section(std::uint64_t offset);
/// The numbers of three corners, uint32, preceded by the byte `prefix` if given.
ElementSection indices32_section(std::uint64_t offset, std::optional<std::byte> prefix = {});
/// The same, preceded by a byte with the number of corners, and followed by the labels of both
/// sides, int32.
ElementSection sided_indices32_section(std::uint64_t offset);
/// As in STL: normal, three corners, two bytes.
ElementSection facet_section(std::uint64_t offset);

/// The tables of a file, as plain numbers.
struct Sections {
    std::vector<VertexSection> vertices;
    std::vector<ElementSection> elements;

    /// Adds the length of what precedes them to all offsets. REQUIRES: none is in base64.
    void shift(std::uint64_t by);
};

/// A file of sections. The format's begin() creates it, writes everything around them, and sets
/// them.
class SectionedFile : public MeshFile {
  public:
    using MeshFile::MeshFile;
    void add_vertices(const VertexBatch& batch) override;
    void add_elements(const ElementBatch& batch) override;
    [[nodiscard]] bool concurrent() const override { return true; }
    void end() override;
    /// After begin(): lets other processes write some of the rows, by RowWriter, until end().
    /// Returns the data that they need. Throws Error{io}.
    std::string share();
    /// Adds the result of RowWriter::loose_ends() of another process, after its end() and before
    /// that of the file. Throws Error{io}.
    void include(std::string_view loose_ends);

  protected:
    /// Sets the sections once the file exists. `layout`: of the mesh.
    void use(Sections sections, const MeshLayout& layout);
    /// Writes bytes of an array in base64 that belong to no row.
    void put(const Base64Array& array, std::uint64_t at, std::span<const std::byte> bytes);

  private:
    Sections sections_;
    Base64Rows base64_;
};

/// Writes rows of a file that another process has created and publishes. The layout passed to
/// begin() is ignored; end() syncs the rows to disk.
class RowWriter : public MeshSink {
  public:
    /// `shared`: result of SectionedFile::share() there. Throws Error{io}.
    explicit RowWriter(std::string_view shared);
    void begin(const MeshLayout& /*layout*/) override {}
    void add_vertices(const VertexBatch& batch) override;
    void add_elements(const ElementBatch& batch) override;
    void end() override { file_.close(); }
    [[nodiscard]] bool concurrent() const override { return true; }
    /// What other processes have to complete in the file, for SectionedFile::include() there.
    [[nodiscard]] std::string loose_ends() { return base64_.take(); }

  private:
    SharedFile file_;
    Sections sections_;
    Base64Rows base64_;
};

}  // namespace isonest::detail
