// https://github.com/google/neuroglancer/blob/master/src/datasource/precomputed/meshes.md
#include "query/neuroglancer/label_files.h"

#include <fmt/format.h>

#include <array>
#include <limits>
#include <string>

#include <isonest/error.h>

#include "query/neuroglancer/encode_fragment.h"
#include "store/files/appended_file.h"

namespace isonest::detail {
namespace {

/// Numbers of the index, as they are stored.
class IndexOutput : public AppendedFile {
  public:
    using AppendedFile::AppendedFile;
    template <class T>
    void add(T number) {
        AppendedFile::add(std::as_bytes(std::span(&number, 1)));
    }
};

void write_whole(const std::filesystem::path& path, const std::string& text) {
    OutputFile file(path, true);
    file.write_at(0, std::as_bytes(std::span(text)));
    file.publish_as_named();
}

/// In JSON. `text`: UTF-8 without control characters.
std::string quoted(const std::string& text) {
    std::string out = "\"";
    for (const char c : text) {
        if (c == '"' || c == '\\') {
            out += '\\';
        }
        out += c;
    }
    return out + "\"";
}

}  // namespace

LabelFiles::LabelFiles(const std::filesystem::path& folder, std::int64_t label,
                       const ScratchFolder& scratch)
    : index_path_(folder / fmt::format("{}.index", label)),
      data_(folder / fmt::format("{}", label), true),
      nodes_(scratch) {}

DetailLevel LabelFiles::add_level(const CutMesh& mesh, const Progress& progress) {
    DetailLevel level;
    nodes_.begin_level();
    for (std::uint32_t i = 0; i < mesh.cells(); ++i) {
        const std::span<const CellTriangle> triangles = mesh.of(i);
        if (triangles.empty()) {
            continue;
        }
        progress.check();
        const std::vector<std::byte> bytes = encode_fragment(triangles);
        data_.write_at(end_, bytes);
        end_ += bytes.size();
        nodes_.add({mesh.cell(i), static_cast<std::uint32_t>(bytes.size()),
                    mesh.grid().level > 0 ? eighths_of(triangles) : 0});
        level.triangles += triangles.size();
        level.bytes += bytes.size();
        ++level.fragments;
    }
    return level;
}

void LabelFiles::publish(const DetailGrid& grid, std::span<const double> scales) {
    nodes_.finish();
    IndexOutput index(index_path_);
    for (int axis = 0; axis < 3; ++axis) {
        index.add(static_cast<float>(grid.chunk));
    }
    for (int axis = 0; axis < 3; ++axis) {
        index.add(static_cast<float>(grid.first[axis]));
    }
    index.add(static_cast<std::uint32_t>(nodes_.levels()));
    for (const double scale : scales) {
        index.add(static_cast<float>(scale));
    }
    for (std::size_t i = 0; i < 3 * nodes_.levels(); ++i) {
        index.add(0.0F);  // no level is moved
    }
    for (std::size_t i = 0; i < nodes_.levels(); ++i) {
        if (nodes_.of(i).size() > std::numeric_limits<std::uint32_t>::max()) {
            throw Error(ErrorKind::limit, {index_path_.string()},
                        "Neuroglancer's format numbers cells with 32 bits");
        }
        index.add(static_cast<std::uint32_t>(nodes_.of(i).size()));
    }
    for (std::size_t i = 0; i < nodes_.levels(); ++i) {
        for (int axis = 0; axis < 3; ++axis) {
            for (const DetailNode& node : nodes_.of(i)) {
                index.add(static_cast<std::uint32_t>(node.cell[axis]));
            }
        }
        for (const DetailNode& node : nodes_.of(i)) {
            index.add(node.bytes);
        }
    }
    data_.publish_as_named();
    index.publish();
}

void write_mesh_info(const std::filesystem::path& folder, const StoreHeader& header,
                     const Double3& shift, bool properties) {
    const double unit = header.unit ? converted_length(1, *header.unit, LengthUnit::nanometre) : 1;
    std::string transform;
    for (std::size_t row = 0; row < 3; ++row) {
        for (std::size_t axis = 0; axis < 3; ++axis) {
            transform +=
                fmt::format("{}, ", header.direction[axis][row] * header.spacing[axis] * unit);
        }
        transform +=
            fmt::format("{}{}", (header.origin[row] + shift[row]) * unit, row < 2 ? ", " : "");
    }
    // Of a scale of 1, so that a level is drawn where a pixel is as large as its distance.
    write_whole(folder / "info",
                fmt::format("{{\"@type\": \"neuroglancer_multilod_draco\", "
                            "\"vertex_quantization_bits\": {}, \"transform\": [{}], "
                            "\"lod_scale_multiplier\": 1{}}}\n",
                            kBitsInCell, transform,
                            properties ? ", \"segment_properties\": \"segment_properties\"" : ""));
}

void write_segment_properties(const std::filesystem::path& folder,
                              std::span<const LabelName> names) {
    std::string ids;
    std::string values;
    for (const LabelName& name : names) {
        const char* const before = ids.empty() ? "" : ", ";
        ids += fmt::format("{}\"{}\"", before, name.id);
        values += before + quoted(name.name);
    }
    const std::filesystem::path place = folder / "segment_properties";
    std::error_code error;
    std::filesystem::create_directory(place, error);
    if (std::error_code ignored; !std::filesystem::is_directory(place, ignored)) {
        throw Error(ErrorKind::io, {place.string()}, "cannot be made a folder: " + error.message());
    }
    write_whole(place / "info",
                fmt::format("{{\"@type\": \"neuroglancer_segment_properties\", \"inline\": "
                            "{{\"ids\": [{}], \"properties\": [{{\"id\": \"label\", \"type\": "
                            "\"label\", \"values\": [{}]}}]}}}}\n",
                            ids, values));
}

}  // namespace isonest::detail
