#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <set>
#include <string>
#include <unordered_map>
#include <utility>
#include <vector>

#include <isonest/error.h>
#include <isonest/grid_file.h>
#include <isonest/traverse.h>

#include "query/formats/mesh_files.h"
#include "store/exports/polydata_file.h"
#include "store/files/output_file.h"
#include "store/lattice/lattice.h"
#include "store/lattice/simplex.h"

namespace isonest::detail {

// VTK XML PolyData with binary data in the XML, which every version of VTK can read with every
// version of expat. This is not true of raw appended data, which is not valid XML. The format:
// Kitware, "VTK File Formats".

namespace {

/// Collects the XML and the positions of the arrays in it. Each array is the base64 encoding of its
/// length in bytes (uint64) followed by the numbers.
class Inline {
  public:
    /// `at`: place of the XML in the file.
    explicit Inline(std::string xml, std::uint64_t at = 0) : xml_(std::move(xml)), end_(at) {}

    Inline& operator+=(std::string_view xml) {
        xml_ += xml;
        return *this;
    }
    Base64Array add(const char* type, std::string_view name, std::size_t components,
                    std::uint64_t bytes) {
        xml_ += fmt::format(
            "<DataArray type=\"{}\" Name=\"{}\" NumberOfComponents=\"{}\" format=\"binary\">\n",
            type, name, components);
        keep_text();
        const Base64Array array{end_, kLength + bytes};
        end_ += array.letters();
        arrays_.push_back(array);
        xml_ = "\n</DataArray>\n";
        return array;
    }
    /// Adds an array with this number of rows.
    Base64Array add(const VertexAttribute& a, std::uint64_t rows) {
        return add(a.is_double ? "Float64" : "Float32", a.name,
                   static_cast<std::size_t>(a.components), rows * a.bytes());
    }
    /// Calls text(place, xml) for all XML, and array(array, length) for the lengths.
    template <class Text, class Array>
    void write(const Text& text, const Array& array) {
        keep_text();
        for (const auto& [place, xml] : texts_) {
            text(place, xml);
        }
        for (const Base64Array& a : arrays_) {
            array(a, a.bytes - kLength);
        }
    }
    /// After write(): the end of the XML in the file.
    [[nodiscard]] std::uint64_t end() const { return end_; }
    static constexpr std::uint64_t kLength = sizeof(std::uint64_t);

  private:
    void keep_text() {
        texts_.emplace_back(end_, xml_);
        end_ += xml_.size();
        xml_.clear();
    }
    std::string xml_;  ///< XML without a position yet
    std::vector<std::pair<std::uint64_t, std::string>> texts_;
    std::vector<Base64Array> arrays_;
    std::uint64_t end_ = 0;
};

/// For an array that was added to Inline.
template <class Section>
Section in_base64(Section section, const Base64Array& array) {
    section.offset = Inline::kLength;
    section.base64 = array;
    return section;
}

/// A text of the field data, byte by byte; empty if the text is empty.
std::string text_field(const char* name, std::string_view text) {
    if (text.empty()) {
        return "";
    }
    std::string bytes;
    for (const char c : text) {
        bytes += fmt::format("{} ", static_cast<int>(static_cast<unsigned char>(c)));
    }
    return fmt::format(
        "<Array type=\"String\" Name=\"{}\" NumberOfTuples=\"1\" format=\"ascii\">{}0</Array>\n",
        name, bytes);
}

/// Unit, frame, name and colour, as far as they are known.
std::string field_data(std::optional<LengthUnit> unit, AnatomicalFrame frame,
                       std::string_view title, const std::optional<LabelColor>& color) {
    std::string fields = text_field("unit", unit ? symbol_of(*unit) : std::string_view{}) +
                         text_field("SPACE", frame == AnatomicalFrame::unknown ? std::string_view{}
                                                                               : name_of(frame)) +
                         text_field("Name", title);
    if (color) {
        constexpr double kMax = 255;
        fields += fmt::format(
            "<DataArray type=\"Float32\" Name=\"Color\" NumberOfComponents=\"3\" "
            "NumberOfTuples=\"1\" format=\"ascii\">{:.9g} {:.9g} {:.9g}</DataArray>\n",
            (*color)[0] / kMax, (*color)[1] / kMax, (*color)[2] / kMax);
    }
    return fields.empty() ? "" : "<FieldData>\n" + fields + "</FieldData>\n";
}

class VtpFile : public SectionedFile {
  public:
    using SectionedFile::SectionedFile;
    void begin_file(const MeshLayout& layout) override {
        const std::uint64_t nv = layout.vertices;
        const std::uint64_t nt = layout.elements;
        const bool lines = layout.corners == 2;
        const std::size_t corners = lines ? 2 : 3;
        const std::string cells = lines ? "Lines" : "Polys";
        Sections sections;
        Inline data(
            fmt::format("<?xml version=\"1.0\"?>\n<VTKFile type=\"PolyData\" version=\"1.0\" "
                        "byte_order=\"LittleEndian\" header_type=\"UInt64\">\n<PolyData>\n{}"
                        "<Piece NumberOfPoints=\"{}\" NumberOfVerts=\"0\" NumberOfLines=\"{}\" "
                        "NumberOfStrips=\"0\" NumberOfPolys=\"{}\">\n",
                        field_data(layout.unit, layout.frame, title(), color()), nv, lines ? nt : 0,
                        lines ? 0 : nt));
        const VertexAttribute* const scalar = main_scalar(layout);
        data += fmt::format("<PointData{}{}>\n",
                            layout.find("normal") != nullptr ? " Normals=\"normal\"" : "",
                            scalar != nullptr ? fmt::format(" Scalars=\"{}\"", scalar->name) : "");
        for (const VertexAttribute& a : layout.attributes) {
            sections.vertices.push_back(in_base64(attribute_section(0, a), data.add(a, nv)));
        }
        data += fmt::format("</PointData>\n<CellData{}>\n",
                            layout.has_sides ? " Scalars=\"BoundaryLabels\"" : "");
        for (const VertexAttribute& a : layout.attributes) {
            if (a.same_in_element) {
                sections.elements.push_back(in_base64(common_section(0, a), data.add(a, nt)));
            }
        }
        if (layout.has_sides) {
            sections.elements.push_back(
                in_base64(sides_section(0),
                          data.add("Int64", "BoundaryLabels", 2, nt * 2 * sizeof(std::int64_t))));
        }
        data += "</CellData>\n<Points>\n";
        sections.vertices.push_back(in_base64(
            position_section(0), data.add("Float32", "points", 3, nv * 3 * sizeof(float))));
        data += fmt::format("</Points>\n<{}>\n", cells);
        sections.elements.push_back(
            in_base64(connectivity_section(0, corners),
                      data.add("Int64", "connectivity", 1, nt * corners * sizeof(std::int64_t))));
        sections.elements.push_back(in_base64(
            ends_section(0, corners), data.add("Int64", "offsets", 1, nt * sizeof(std::int64_t))));
        data += fmt::format("</{}>\n</Piece>\n</PolyData>\n</VTKFile>\n", cells);

        const OutputFile& out = create();
        use(std::move(sections), layout);
        data.write(
            [&](std::uint64_t place, const std::string& xml) {
                out.write_at(place, std::as_bytes(std::span(xml)));
            },
            [&](const Base64Array& array, std::uint64_t bytes) {
                put(array, 0, std::as_bytes(std::span(&bytes, 1)));
            });
    }

  protected:
    [[nodiscard]] bool holds_lines() const override { return true; }
    [[nodiscard]] bool holds_sides() const override { return true; }
    [[nodiscard]] bool holds_fields() const override { return true; }
};

}  // namespace

std::unique_ptr<MeshSink> vtp_file(const std::filesystem::path& path, const MeshFileOptions& o) {
    return std::make_unique<VtpFile>(path, o);
}

}  // namespace isonest::detail

// VTK XML UnstructuredGrid, piece by piece.

namespace isonest {

class GridFile::Writer {
  public:
    Writer(const std::filesystem::path& path, const Store& store, const GridFileOptions& options)
        : placement_(store), names_(options.numbers), file_(path, options.replace) {
        for (const std::string& name : names_) {
            if (name.find_first_of("<>&\"'\n") != std::string::npos || name.empty()) {
                throw Error(ErrorKind::invalid_argument, {path.string()},
                            fmt::format("'{}' cannot be the name of an array", name));
            }
        }
        put_text(
            fmt::format("<?xml version=\"1.0\"?>\n<VTKFile type=\"UnstructuredGrid\" "
                        "version=\"1.0\" byte_order=\"LittleEndian\" "
                        "header_type=\"UInt64\">\n<UnstructuredGrid>\n{}",
                        detail::field_data(store.unit(), store.frame(), {}, {})));
        numbers_.resize(names_.size());
    }

    void add(std::span<const Int3> nodes, std::span<const double> values, int level,
             std::span<const double> numbers) {
        if (numbers.size() != names_.size() || (corners_ != 0 && corners_ != nodes.size())) {
            throw Error(ErrorKind::invalid_argument,
                        fmt::format("an element with {} corners and {} numbers in a grid of "
                                    "elements with {} corners and {} numbers",
                                    nodes.size(), numbers.size(), corners_, names_.size()));
        }
        corners_ = nodes.size();
        std::array<std::int64_t, 4> corner{};
        for (std::size_t i = 0; i < nodes.size(); ++i) {
            corner.at(i) = point(nodes[i], values[i]);
        }
        if (nodes.size() == 4 && detail::determinant(nodes[1] - nodes[0], nodes[2] - nodes[0],
                                                     nodes[3] - nodes[0]) < 0) {
            std::swap(corner[2], corner[3]);
        }
        connectivity_.insert(connectivity_.end(), corner.begin(),
                             corner.begin() + static_cast<std::ptrdiff_t>(nodes.size()));
        ends_.push_back(static_cast<std::int64_t>(connectivity_.size()));
        levels_.push_back(level);
        for (std::size_t i = 0; i < numbers.size(); ++i) {
            numbers_[i].push_back(numbers[i]);
        }
        ++cells_;
        if (levels_.size() == kCellsPerPiece) {
            put_piece();
        }
    }
    [[nodiscard]] std::uint64_t cells() const { return cells_; }
    void close() {
        if (!levels_.empty() || cells_ == 0) {
            put_piece();
        }
        put_text("</UnstructuredGrid>\n</VTKFile>\n");
        file_.publish_as_named();
    }

  private:
    static constexpr std::size_t kCellsPerPiece = 32768;

    std::int64_t point(const Int3& node, double value) {
        // Elements end at most one cube of the coarsest level behind the origin.
        static_assert(detail::kMaxNodesPerAxis <= std::int64_t{1} << 20U);
        const auto key = static_cast<std::uint64_t>((node.z << 42U) | (node.y << 21U) | node.x);
        const auto [found, is_new] =
            number_.try_emplace(key, static_cast<std::int64_t>(values_.size()));
        if (is_new) {
            const Double3 p = placement_(node);
            points_.insert(points_.end(), p.begin(), p.end());
            values_.push_back(value);
        }
        return found->second;
    }
    void put_text(std::string_view text) {
        file_.write_at(end_, std::as_bytes(std::span(text)));
        end_ += text.size();
    }
    void put_piece() {
        struct Array {
            detail::Base64Array place;
            std::span<const std::byte> bytes;
        };
        std::vector<Array> arrays;
        detail::Inline data(fmt::format("<Piece NumberOfPoints=\"{}\" NumberOfCells=\"{}\">\n"
                                        "<PointData Scalars=\"value\">\n",
                                        values_.size(), levels_.size()),
                            end_);
        const auto add = [&]<class T>(const char* type, std::string_view name,
                                      const std::vector<T>& numbers, std::size_t components = 1) {
            const auto bytes = std::as_bytes(std::span(numbers));
            arrays.push_back({data.add(type, name, components, bytes.size()), bytes});
        };
        add("Float64", "value", values_);
        data += "</PointData>\n<CellData Scalars=\"level\">\n";
        add("Int32", "level", levels_);
        for (std::size_t i = 0; i < names_.size(); ++i) {
            add("Float64", names_[i], numbers_[i]);
        }
        data += "</CellData>\n<Points>\n";
        add("Float64", "points", points_, 3);
        data += "</Points>\n<Cells>\n";
        add("Int64", "connectivity", connectivity_);
        add("Int64", "offsets", ends_);
        constexpr std::uint8_t kLine = 3;
        constexpr std::uint8_t kTriangle = 5;
        constexpr std::uint8_t kTetrahedron = 10;
        const std::vector<std::uint8_t> types(levels_.size(), corners_ == 2   ? kLine
                                                              : corners_ == 3 ? kTriangle
                                                                              : kTetrahedron);
        add("UInt8", "types", types);
        data += "</Cells>\n</Piece>\n";

        detail::Base64Rows rows;
        const auto write = [&](std::uint64_t place, std::span<const std::byte> letters) {
            file_.write_at(place, letters);
        };
        data.write(
            [&](std::uint64_t place, const std::string& xml) {
                file_.write_at(place, std::as_bytes(std::span(xml)));
            },
            [&](const detail::Base64Array& array, std::uint64_t bytes) {
                rows.put(array, 0, std::as_bytes(std::span(&bytes, 1)), write);
            });
        for (const Array& array : arrays) {
            rows.put(array.place, detail::Inline::kLength, array.bytes, write);
        }
        end_ = data.end();
        number_.clear();
        points_.clear();
        values_.clear();
        connectivity_.clear();
        ends_.clear();
        levels_.clear();
        for (std::vector<double>& numbers : numbers_) {
            numbers.clear();
        }
    }

    Placement placement_;
    std::vector<std::string> names_;
    detail::OutputFile file_;
    std::uint64_t end_ = 0;
    std::uint64_t cells_ = 0;
    std::size_t corners_ = 0;
    // The current piece.
    std::unordered_map<std::uint64_t, std::int64_t> number_;
    std::vector<double> points_;
    std::vector<double> values_;
    std::vector<std::int64_t> connectivity_;
    std::vector<std::int64_t> ends_;
    std::vector<std::int32_t> levels_;
    std::vector<std::vector<double>> numbers_;
};

GridFile::GridFile(const std::filesystem::path& path, const Store& store,
                   const GridFileOptions& options) {
    const std::string extension = detail::lower_extension(path);
    if (extension != ".vtu") {
        throw Error(ErrorKind::invalid_argument, {path.string()},
                    "grids are written as .vtu files only", {{RemedyKind::other_format, ".vtu"}});
    }
    writer_ = std::make_unique<Writer>(path, store, options);
}
GridFile::~GridFile() = default;

void GridFile::add(std::span<const Int3> nodes, std::span<const double> values, int level,
                   std::span<const double> numbers) {
    writer_->add(nodes, values, level, numbers);
}
std::uint64_t GridFile::cells() const {
    return writer_->cells();
}
void GridFile::close() {
    writer_->close();
}

}  // namespace isonest

namespace isonest::detail {

// VTKHDF PolyData: HDF5 whose arrays are written in place.

namespace {

PolyDataShape shape_of(const MeshLayout& layout) {
    PolyDataShape shape;
    shape.points = layout.vertices;
    shape.triangles = layout.elements;
    shape.labels_of_triangles = layout.has_sides;
    shape.unit = layout.unit ? symbol_of(*layout.unit) : "";
    shape.space = layout.frame == AnatomicalFrame::unknown ? "" : name_of(layout.frame);
    for (const VertexAttribute& a : layout.attributes) {
        shape.attributes.push_back({a.name, a.components, a.is_double, a.same_in_element});
    }
    return shape;
}

/// A title as the name of a block: VTK's assemblies have letters, digits, "_" and "-".
std::string block_name(const std::string& title, std::set<std::string>& used) {
    std::string name = title.empty() ? "mesh" : title;
    for (char& c : name) {
        const bool is_plain =
            (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') || c == '-';
        c = is_plain ? c : '_';
    }
    if ((name[0] >= '0' && name[0] <= '9') || name[0] == '-' || name == "Assembly") {
        name = "_" + name;
    }
    std::string unique = name;
    for (int i = 2; !used.insert(unique).second; ++i) {
        unique = fmt::format("{}_{}", name, i);
    }
    return unique;
}

class VtkhdfFile : public SectionedFile {
  public:
    using SectionedFile::SectionedFile;
    void begin_file(const MeshLayout& layout) override {
        objects_ = single(layout);
        offsets_.resize(1);
        create([&](const std::filesystem::path& temporary) {
            offsets_[0] = create_polydata(temporary, shape_of(layout));
        });
        begin_object(0);
    }

    void begin_objects(std::vector<FileObject> objects) override {
        objects_ = std::move(objects);
        std::vector<PolyDataBlock> blocks;
        std::set<std::string> names;
        for (const FileObject& object : objects_) {
            blocks.push_back({shape_of(object.layout), block_name(object.title, names),
                              object.title, object.color});
        }
        create([&](const std::filesystem::path& temporary) {
            offsets_ = create_polydata_collection(temporary, blocks);
        });
        use({}, {});
    }

    void begin_object(std::size_t object) override {
        const MeshLayout& layout = objects_[object].layout;
        const PolyDataOffsets& offsets = offsets_[object];
        Sections sections{
            {position_section(offsets.points)},
            {connectivity_section(offsets.connectivity, 3), ends_section(offsets.ends, 3)}};
        for (std::size_t i = 0; i < layout.attributes.size(); ++i) {
            sections.vertices.push_back(
                attribute_section(offsets.attributes[i], layout.attributes[i]));
            if (layout.attributes[i].same_in_element) {
                sections.elements.push_back(
                    common_section(offsets.attributes_of_triangles[i], layout.attributes[i]));
            }
        }
        if (layout.has_sides) {
            sections.elements.push_back(sides_section(offsets.labels_of_triangles));
        }
        if (layout.elements > 0) {
            const std::uint64_t zero = 0;
            file().write_at(offsets.ends - sizeof(zero), std::as_bytes(std::span(&zero, 1)));
        }
        use(std::move(sections), layout);
    }

  protected:
    [[nodiscard]] bool holds_sides() const override { return true; }
    [[nodiscard]] bool holds_fields() const override { return true; }

  private:
    std::vector<FileObject> objects_;
    std::vector<PolyDataOffsets> offsets_;
};

}  // namespace

std::unique_ptr<MeshSink> vtkhdf_file(const std::filesystem::path& path, const MeshFileOptions& o) {
    return std::make_unique<VtkhdfFile>(path, o);
}

}  // namespace isonest::detail
