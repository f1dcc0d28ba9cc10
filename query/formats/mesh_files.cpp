#include "query/formats/mesh_files.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <memory>
#include <type_traits>
#include <utility>

#include <isonest/error.h>
#include <isonest/vertex_fields.h>

#include "store/base/label_text.h"
#include "store/base/vectors.h"
#include "store/files/output_file.h"

namespace isonest::detail {
namespace {

/// A number of 16 bits for each of 8 bits.
constexpr int kPerByte = 257;

template <class T>
std::byte* put(const T& number, std::byte* out) {
    std::memcpy(out, &number, sizeof(number));
    return out + sizeof(number);
}

bool is_as_it_comes(const VertexSection& section) {
    return section.scale == 1 && section.shift == Double3{} && !section.turned;
}

std::array<float, 3> placed(std::array<float, 3> position, const VertexSection& section) {
    for (std::size_t axis = 0; axis < 3; ++axis) {
        const double at = static_cast<double>(position[axis]);
        // Adding 0 would change a negative zero.
        const double moved = section.shift[axis] == 0 ? at : at + section.shift[axis];
        const double there = section.turned && axis < 2 ? 0 - moved : moved;
        position[axis] = static_cast<float>(there * section.scale);
    }
    return position;
}

/// Rotates by 180 degrees about z. No coordinate becomes -0.
std::array<float, 3> turned(const std::array<float, 3>& p) {
    return {0 - p[0], 0 - p[1], p[2]};
}

std::byte* put_color(const ColorScale& scale, const std::byte* row, std::byte* out) {
    double value = 0;
    if (scale.is_double) {
        std::memcpy(&value, row + scale.first, sizeof(value));
    } else {
        float number = 0;
        std::memcpy(&number, row + scale.first, sizeof(number));
        value = static_cast<double>(number);
    }
    const auto color = [&scale](std::size_t i) {
        return Double3{static_cast<double>(scale.map[i][0]), static_cast<double>(scale.map[i][1]),
                       static_cast<double>(scale.map[i][2])};
    };
    // In numbers of 16 bits.
    for (const double number : color_between(scale.low, scale.high, value, color)) {
        out = scale.form == ColorForm::displayed8
                  ? put(static_cast<std::uint8_t>(std::lround(number / kPerByte)), out)
                  : put(static_cast<std::uint16_t>(std::lround(number)), out);
    }
    return scale.form == ColorForm::displayed8 ? out : put(std::uint16_t{0xFFFF}, out);
}

/// Writes the position, attributes and colour of a vertex, or one of several attributes.
void fill(const VertexSection& section, const VertexBatch& batch, std::byte* out) {
    const std::byte* attributes = batch.attributes.data() + section.first;
    for (const std::array<float, 3>& position : batch.positions) {
        if (section.position) {
            out = put(is_as_it_comes(section) ? position : placed(position, section), out);
        }
        if (section.turned && section.normal != VertexSection::kNoNormal) {
            std::array<float, 3> normal{};
            std::byte* const at = out + (section.normal - section.first);
            std::copy_n(attributes, section.bytes, out);
            std::memcpy(normal.data(), at, sizeof(normal));
            put(turned(normal), at);
            out += section.bytes;
        } else {
            out = std::copy_n(attributes, section.bytes, out);
        }
        if (section.color.form != ColorForm::none) {
            out = put_color(section.color, attributes - section.first, out);
        }
        attributes += batch.row_bytes;
    }
}

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

void fill_ends(const ElementSection& section, const ElementBatch& batch, std::byte* out) {
    std::uint64_t end = section.corners * batch.first;
    for (std::size_t i = 0; i < batch.corners.size(); ++i) {
        out = put(end += section.corners, out);
    }
}

void fill_corners(const ElementSection& section, const ElementBatch& batch, std::byte* out) {
    for (const auto& element : batch.corners) {
        for (std::size_t i = 0; i < section.corners; ++i) {
            out = put(element[i], out);
        }
    }
}

void fill_common(const ElementSection& section, const ElementBatch& batch, std::byte* out) {
    const std::byte* const rows = batch.nearby.attributes.data() + section.first;
    for (const auto& element : batch.nearby_corners) {
        out = std::copy_n(rows + element[0] * batch.nearby.row_bytes, section.bytes, out);
    }
}

void fill_corners32(const ElementSection& section, const ElementBatch& batch, std::byte* out) {
    for (std::size_t i = 0; i < batch.corners.size(); ++i) {
        if (section.has_prefix) {
            *out++ = section.prefix;
        }
        for (const std::uint64_t corner : batch.corners[i]) {
            out = put(static_cast<std::uint32_t>(corner), out);
        }
        if (section.has_sides) {
            for (const std::int64_t label : batch.sides[i]) {
                out = put(static_cast<std::int32_t>(label), out);
            }
        }
    }
}

void fill_facets(const ElementSection& section, const ElementBatch& batch, std::byte* out) {
    for (const auto& t : batch.nearby_corners) {
        const auto& positions = batch.nearby.positions;
        Triangle p{positions[t[0]], positions[t[1]], positions[t[2]]};
        if (section.turned) {
            std::transform(p.begin(), p.end(), p.begin(), turned);
        }
        out = put(p, put(normal_of(p), out));
        out = put(std::uint16_t{0}, out);
    }
}

void fill(const ElementSection& section, const ElementBatch& batch, std::byte* out) {
    switch (section.row) {
        case ElementRow::corners:
            return fill_corners(section, batch, out);
        case ElementRow::end:
            return fill_ends(section, batch, out);
        case ElementRow::common:
            return fill_common(section, batch, out);
        case ElementRow::sides:
            std::copy_n(std::as_bytes(batch.sides).data(), batch.sides.size_bytes(), out);
            return;
        case ElementRow::corners32:
            return fill_corners32(section, batch, out);
        case ElementRow::facet:
            return fill_facets(section, batch, out);
    }
}

/// Writes letters to an OutputFile or SharedFile.
template <class File>
Base64Rows::Write letters_into(const File& file) {
    return [&file](std::uint64_t place, std::span<const std::byte> letters) {
        file.write_at(place, letters);
    };
}

/// `at`: bytes from the start of the file, or of an array in base64.
template <class File>
void write(const File& file, Base64Rows& base64, const Base64Array& array, std::uint64_t at,
           std::span<const std::byte> rows) {
    if (array.bytes > 0) {
        base64.put(array, at, rows, letters_into(file));
    } else {
        file.write_at(at, rows);
    }
}

template <class File>
void write_rows(const File& file, const Sections& sections, Base64Rows& base64,
                const VertexBatch& batch) {
    for (const VertexSection& section : sections.vertices) {
        const std::uint64_t at = section.offset + batch.first * section.stride();
        const bool is_plain = section.color.form == ColorForm::none;
        if (is_plain && section.bytes == 0 && is_as_it_comes(section)) {
            write(file, base64, section.base64, at, std::as_bytes(batch.positions));
        } else if (is_plain && !section.position && section.bytes == batch.row_bytes &&
                   !section.turned) {
            write(file, base64, section.base64, at, batch.attributes);
        } else {
            const std::size_t bytes = batch.positions.size() * section.stride();
            const auto rows = std::make_unique_for_overwrite<std::byte[]>(bytes);
            fill(section, batch, rows.get());
            write(file, base64, section.base64, at, {rows.get(), bytes});
        }
    }
}

template <class File>
void write_rows(const File& file, const Sections& sections, Base64Rows& base64,
                const ElementBatch& batch) {
    for (const ElementSection& section : sections.elements) {
        const std::size_t bytes = batch.corners.size() * section.stride;
        const auto rows = std::make_unique_for_overwrite<std::byte[]>(bytes);
        fill(section, batch, rows.get());
        write(file, base64, section.base64, section.offset + batch.first * section.stride,
              {rows.get(), bytes});
    }
}

/// A shared file's tables and name, one after another.
struct SharedHead {
    std::uint64_t vertices = 0;
    std::uint64_t elements = 0;
};

std::string packed(const Sections& sections, const std::string& name) {
    const SharedHead head{sections.vertices.size(), sections.elements.size()};
    std::string text(reinterpret_cast<const char*>(&head), sizeof(head));
    const auto add = [&](const auto& rows) {
        static_assert(std::is_trivially_copyable_v<std::decay_t<decltype(rows[0])>>);
        text.append(reinterpret_cast<const char*>(rows.data()), rows.size() * sizeof(rows[0]));
    };
    add(sections.vertices);
    add(sections.elements);
    return text + name;
}

/// REQUIRES: `text` is the result of packed(). The rest of `text` is the name.
Sections unpacked(std::string_view& text) {
    SharedHead head;
    std::memcpy(&head, text.data(), sizeof(head));
    text.remove_prefix(sizeof(head));
    Sections sections;
    const auto take = [&](auto& rows, std::uint64_t count) {
        rows.resize(count);
        const std::size_t bytes = rows.size() * sizeof(rows[0]);
        if (bytes > 0) {
            std::memcpy(rows.data(), text.data(), bytes);
        }
        text.remove_prefix(bytes);
    };
    take(sections.vertices, head.vertices);
    take(sections.elements, head.elements);
    return sections;
}

std::filesystem::path name_in(std::string_view shared) {
    unpacked(shared);
    return shared;
}

}  // namespace

VertexSection position_section(std::uint64_t offset, double scale) {
    return {offset, true, 0, 0, scale};
}

VertexSection attribute_section(std::uint64_t offset, const VertexAttribute& attribute) {
    return {offset, false, attribute.offset, attribute.bytes()};
}

VertexSection color_section(std::uint64_t offset, const ColorScale& color) {
    VertexSection section{offset};
    section.color = color;
    return section;
}

ColorScale color_scale(const VertexColors& colors, const MeshLayout& layout, ColorForm form) {
    const VertexAttribute& attribute = *layout.find(colors.attribute);
    ColorScale scale{form, attribute.is_double, attribute.offset, colors.low, colors.high};
    for (std::size_t i = 0; i < scale.map.size(); ++i) {
        for (std::size_t c = 0; c < 3; ++c) {
            const std::uint8_t shown = colors.map[i][c];
            scale.map[i][c] = static_cast<std::uint16_t>(
                form == ColorForm::displayed8 ? kPerByte * shown
                                              : std::lround(0xFFFF * linear_of(shown)));
        }
    }
    return scale;
}

double linear_of(std::uint8_t shown) {
    constexpr double kMax = 255;
    const double part = shown / kMax;
    return part <= 0.04045 ? part / 12.92 : std::pow((part + 0.055) / 1.055, 2.4);
}

ElementSection connectivity_section(std::uint64_t offset, std::size_t corners) {
    return {offset, corners * sizeof(std::int64_t), ElementRow::corners, corners};
}

ElementSection ends_section(std::uint64_t offset, std::size_t corners) {
    return {offset, sizeof(std::int64_t), ElementRow::end, corners};
}

ElementSection common_section(std::uint64_t offset, const VertexAttribute& attribute) {
    return {offset, attribute.bytes(), ElementRow::common, 3, attribute.offset, attribute.bytes()};
}

ElementSection sides_section(std::uint64_t offset) {
    return {offset, 2 * sizeof(std::int64_t), ElementRow::sides};
}

ElementSection sided_indices32_section(std::uint64_t offset) {
    ElementSection section = indices32_section(offset, std::byte{3});
    section.stride += 2 * sizeof(std::int32_t);
    section.has_sides = true;
    return section;
}

ElementSection indices32_section(std::uint64_t offset, std::optional<std::byte> prefix) {
    ElementSection section{offset, (prefix ? 1 : 0) + 3 * sizeof(std::uint32_t),
                           ElementRow::corners32};
    section.has_prefix = prefix.has_value();
    section.prefix = prefix.value_or(std::byte{0});
    return section;
}

ElementSection facet_section(std::uint64_t offset) {
    constexpr std::size_t kRow = 50;
    return {offset, kRow, ElementRow::facet};
}

void Sections::shift(std::uint64_t by) {
    for (VertexSection& section : vertices) {
        section.offset += by;
    }
    for (ElementSection& section : elements) {
        section.offset += by;
    }
}

void SectionedFile::use(Sections sections, const MeshLayout& layout) {
    const VertexAttribute* const normal = layout.find("normal");
    for (VertexSection& section : sections.vertices) {
        section.turned = is_turned();
        if (normal != nullptr && section.first <= normal->offset &&
            normal->offset + normal->bytes() <= section.first + section.bytes) {
            section.normal = normal->offset;
        }
    }
    for (ElementSection& section : sections.elements) {
        section.turned = is_turned();
    }
    sections_ = std::move(sections);
    static_cast<void>(base64_.take());  // remains of a mesh that was not finished
}

void SectionedFile::put(const Base64Array& array, std::uint64_t at,
                        std::span<const std::byte> bytes) {
    base64_.put(array, at, bytes, letters_into(file()));
}

void SectionedFile::add_vertices(const VertexBatch& batch) {
    write_rows(file(), sections_, base64_, batch);
}

void SectionedFile::add_elements(const ElementBatch& batch) {
    write_rows(file(), sections_, base64_, batch);
}

void SectionedFile::include(std::string_view loose_ends) {
    base64_.include(loose_ends, letters_into(file()));
}

void SectionedFile::end() {
    if (!base64_.is_complete()) {
        throw Error(ErrorKind::invalid_argument, {path().string()},
                    "some rows of the mesh were never written");
    }
    MeshFile::end();
}

std::string SectionedFile::share() {
    const std::filesystem::path& name = file().share();
    return packed(sections_, std::filesystem::absolute(name).string());
}

RowWriter::RowWriter(std::string_view shared) : file_(name_in(shared)) {
    sections_ = unpacked(shared);
}

void RowWriter::add_vertices(const VertexBatch& batch) {
    write_rows(file_, sections_, base64_, batch);
}

void RowWriter::add_elements(const ElementBatch& batch) {
    write_rows(file_, sections_, base64_, batch);
}

}  // namespace isonest::detail

namespace isonest {
namespace {

using Open = std::unique_ptr<MeshSink> (*)(const std::filesystem::path&, const MeshFileOptions&);
struct Format {
    std::string_view extension;
    Open open;
};
constexpr std::array<Format, 8> kFormats{{{".ply", detail::ply_file},
                                          {".stl", detail::stl_file},
                                          {".obj", detail::obj_file},
                                          {".vtp", detail::vtp_file},
                                          {".vtkhdf", detail::vtkhdf_file},
                                          {".glb", detail::glb_file},
                                          {".3mf", detail::threemf_file},
                                          {".ngmesh", detail::ngmesh_file}}};

}  // namespace

std::unique_ptr<MeshSink> open_mesh_file(const std::filesystem::path& path,
                                         const MeshFileOptions& options) {
    if (!detail::is_printable_utf8(options.title)) {
        throw Error(ErrorKind::invalid_argument, {path.string()},
                    "the title of the mesh is not valid UTF-8, or has control characters");
    }
    const std::string end = detail::lower_extension(path);
    for (const Format& format : kFormats) {
        if (format.extension == end) {
            if (options.shift != Double3{} && end != ".ngmesh") {
                throw Error(ErrorKind::invalid_argument, {path.string()},
                            "only .ngmesh files can be shifted");
            }
            if (options.up == UpAxis::y && end != ".glb" && end != ".obj") {
                throw Error(ErrorKind::invalid_argument, {path.string()},
                            "only .glb and .obj files can have y up");
            }
            if (!options.unit) {
                return format.open(path, options);
            }
            detail::require_free_unit(path);
            return detail::converted(format.open(path, options), *options.unit);
        }
    }
    throw Error(ErrorKind::invalid_argument, {path.string()},
                "a mesh's name must end with .ply, .stl, .obj, .vtp, .vtkhdf, .glb, .3mf or "
                ".ngmesh, which chooses its format");
}

namespace detail {

AnatomicalFrame frame_in_file(AnatomicalFrame frame, MeshSpace space,
                              const std::filesystem::path& path) {
    const bool as_it_is = space == MeshSpace::automatic &&
                          (frame == AnatomicalFrame::unknown || path.extension() == ".ngmesh");
    if (space == MeshSpace::as_stored || as_it_is) {
        return frame;
    }
    const AnatomicalFrame wanted =
        space == MeshSpace::lps ? AnatomicalFrame::lps : AnatomicalFrame::ras;
    if (frame == AnatomicalFrame::unknown) {
        throw Error(
            ErrorKind::invalid_argument, {path.string()},
            fmt::format("cannot be written in {}: the patient axes of the volume are unknown",
                        name_of(wanted)),
            {{RemedyKind::place_in_world, "frame"}, {RemedyKind::preprocess_again}});
    }
    return wanted;
}

void MeshFile::prepare(const MeshLayout& layout, std::span<const std::filesystem::path> inputs) {
    check_output(path_, options_.replace, {inputs.begin(), inputs.end()});
    frame_in_file(layout.frame, options_.space, path_);
    if (layout.corners == 2 && !holds_lines()) {
        throw Error(ErrorKind::invalid_argument, {path_.string()},
                    "lines can only be written as .vtp or .obj");
    }
    if (options_.colors && !holds_colors()) {
        throw Error(ErrorKind::invalid_argument, {path_.string()},
                    "vertex colours can only be written to .glb or .ply");
    }
    const VertexAttribute* const colored =
        options_.colors ? layout.find(options_.colors->attribute) : nullptr;
    if (options_.colors && (colored == nullptr || colored->components != 1)) {
        throw Error(ErrorKind::invalid_argument, {path_.string()},
                    fmt::format("the mesh has no scalar vertex attribute {} to colour by",
                                options_.colors->attribute));
    }
    const auto field =
        std::find_if_not(layout.attributes.begin(), layout.attributes.end(), is_of_extraction);
    if (field != layout.attributes.end() && !holds_fields()) {
        throw Error(ErrorKind::invalid_argument, {path_.string()},
                    fmt::format("the format cannot store {} at the vertices", field->name),
                    {{RemedyKind::other_format, ".ply, .vtp, .vtkhdf, .glb"}});
    }
    if (const auto twice = VertexFields::name_used_twice(layout.attributes)) {
        throw Error(ErrorKind::invalid_argument, {path_.string()},
                    fmt::format("two attributes of the vertices have the name {} (upper and lower "
                                "case are the same in some formats)",
                                *twice));
    }
    const bool turns =
        sign_between(layout.frame, frame_in_file(layout.frame, options_.space, path_)) < 0;
    const auto vector =
        std::find_if(layout.attributes.begin(), layout.attributes.end(),
                     [](const auto& a) { return !is_of_extraction(a) && a.components > 1; });
    if (turns && vector != layout.attributes.end()) {
        throw Error(ErrorKind::invalid_argument, {path_.string()},
                    fmt::format("the vectors of {} are in {} coordinates, but the file would be in "
                                "{}: write the mesh with the space as-stored",
                                vector->name, name_of(layout.frame),
                                name_of(frame_in_file(layout.frame, options_.space, path_))));
    }
    if (options_.colors && !(options_.colors->low < options_.colors->high)) {
        throw Error(ErrorKind::invalid_argument, {path_.string()},
                    "the value of the first colour must be below that of the last one");
    }
    if (layout.has_sides && !holds_sides()) {
        throw Error(ErrorKind::invalid_argument, {path_.string()},
                    "interfaces (triangles with the labels on both sides) can only be written as "
                    ".vtp, .vtkhdf or .ply");
    }
}

MeshLayout MeshFile::layout_in_file(const MeshLayout& layout) {
    MeshLayout written = layout;
    written.frame = frame_in_file(layout.frame, options_.space, path_);
    turned_ = sign_between(layout.frame, written.frame) < 0;
    for (std::size_t axis = 0; turned_ && axis < 2 && layout.lo[axis] <= layout.hi[axis]; ++axis) {
        written.lo[axis] = 0 - layout.hi[axis];
        written.hi[axis] = 0 - layout.lo[axis];
    }
    return written;
}

void MeshFile::begin(const MeshLayout& layout) {
    begin_file(layout_in_file(layout));
}

void MeshFile::begin_all(std::vector<FileObject> objects) {
    for (FileObject& object : objects) {
        object.layout = layout_in_file(object.layout);
    }
    begin_objects(std::move(objects));
}

bool is_of_extraction(const VertexAttribute& attribute) {
    constexpr std::array<std::string_view, 4> kOwn{"normal", "value", "error", "isovalue"};
    return std::find(kOwn.begin(), kOwn.end(), attribute.name) != kOwn.end();
}

const VertexAttribute* main_scalar(const MeshLayout& layout) {
    for (const char* const name : {"value", "error"}) {
        if (const VertexAttribute* const found = layout.find(name)) {
            return found;
        }
    }
    const auto field =
        std::find_if(layout.attributes.begin(), layout.attributes.end(),
                     [](const auto& a) { return !is_of_extraction(a) && a.components == 1; });
    return field != layout.attributes.end() ? &*field : nullptr;
}

std::string semantic_of(const VertexAttribute& attribute) {
    if (attribute.name == "normal") {
        return "NORMAL";
    }
    std::string name = "_";
    for (const char c : attribute.name) {
        name += c >= 'a' && c <= 'z' ? static_cast<char>(c - 'a' + 'A') : c;
    }
    return name;
}

std::string space_text(AnatomicalFrame frame) {
    return frame == AnatomicalFrame::unknown ? "" : fmt::format("SPACE={}", name_of(frame));
}

OutputFile& MeshFile::create(
    const std::function<void(const std::filesystem::path& temporary)>& prepare) {
    file_.reset();
    return file_.emplace(path_, options_.replace, prepare);
}

void MeshFile::end() {
    file_->publish_as_named();
    file_.reset();
}

void MeshFile::require_bits(unsigned bits, std::uint64_t count, const char* what,
                            const char* format) const {
    if (count >= std::uint64_t{1} << bits) {
        throw Error(ErrorKind::limit, {path_.string()},
                    fmt::format("the surface has {} {}, more than {} can number (2^{} - 1)", count,
                                what, format, bits),
                    {{RemedyKind::other_format, ".vtp,.vtkhdf"},
                     {RemedyKind::smaller_box},
                     {RemedyKind::larger_error}});
    }
}

}  // namespace detail
}  // namespace isonest
