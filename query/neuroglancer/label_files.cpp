// https://github.com/google/neuroglancer/blob/master/src/datasource/precomputed/meshes.md

#include "query/neuroglancer/label_files.h"

#include <fmt/format.h>

#include <array>
#include <limits>
#include <string>

#include <isonest/error.h>

#include "query/neuroglancer/cut_mesh.h"
#include "query/neuroglancer/encode_fragment.h"
#include "store/base/json_text.h"
#include "store/files/output_file.h"

namespace isonest::detail {

/// Both lists are sorted. If two nodes are at the same position, the one with a fragment is kept.
DetailNodes::List DetailNodes::merged(std::span<const DetailNode> a,
                                      std::span<const DetailNode> b) const {
    auto all = std::make_unique<GrowingFile<DetailNode>>(folder_);
    std::size_t i = 0;
    std::size_t j = 0;
    while (i < a.size() || j < b.size()) {
        if (j == b.size()) {
            all->append(a[i++]);
        } else if (i == a.size()) {
            all->append(b[j++]);
        } else if (a[i].cell == b[j].cell) {
            all->append(a[i].bytes > 0 ? a[i] : b[j]);
            ++i;
            ++j;
        } else {
            all->append(z_order(a[i].cell) < z_order(b[j].cell) ? a[i++] : b[j++]);
        }
    }
    all->seal();
    return all;
}

/// The children in which the nodes have triangles.
DetailNodes::List DetailNodes::children_of(std::span<const DetailNode> nodes) const {
    auto children = std::make_unique<GrowingFile<DetailNode>>(folder_);
    for (const DetailNode& node : nodes) {
        for (unsigned eighth = 0; eighth < 8; ++eighth) {
            if ((node.eighths >> eighth & 1U) != 0) {
                const Int3 place{eighth & 1U, eighth >> 1U & 1U, eighth >> 2U & 1U};
                children->append({node.cell * 2 + place, 0, 0});
            }
        }
    }
    children->seal();
    return children;
}

DetailNodes::List DetailNodes::parents_of(std::span<const DetailNode> nodes) const {
    auto parents = std::make_unique<GrowingFile<DetailNode>>(folder_);
    Int3 last{-1, -1, -1};
    for (const DetailNode& node : nodes) {
        const Int3 parent{node.cell.x / 2, node.cell.y / 2, node.cell.z / 2};
        if (parent != last) {
            parents->append({parent, 0, 0});
            last = parent;
        }
    }
    parents->seal();
    return parents;
}

void DetailNodes::finish() {
    for (const List& level : levels_) {
        level->seal();
    }
    // Children come only from nodes with fragments: added nodes have none.
    std::vector<List> children;
    for (std::size_t i = 1; i < levels(); ++i) {
        children.push_back(children_of(of(i)));
    }
    for (std::size_t i = 0; i < children.size(); ++i) {
        levels_[i] = merged(of(i), children[i]->all());
    }
    for (std::size_t i = 1; i < levels(); ++i) {
        levels_[i] = merged(of(i), parents_of(of(i - 1))->all());
    }
    // A tree needs a node, even for a mesh without triangles.
    if (!levels_.empty() && of(0).empty() && levels() == 1) {
        auto root = std::make_unique<GrowingFile<DetailNode>>(folder_);
        root->append({});
        root->seal();
        levels_[0] = std::move(root);
    }
}

namespace {

void write_whole(const std::filesystem::path& path, const std::string& text) {
    OutputFile file(path, true);
    file.write_at(0, std::as_bytes(std::span(text)));
    file.publish_as_named();
}

}  // namespace

LabelFiles::LabelFiles(const std::filesystem::path& folder, std::int64_t label,
                       const ScratchFolder& scratch, Shards* shards)
    : label_(label),
      index_path_(folder / fmt::format("{}.index", label)),
      waiting_(scratch),
      shards_(shards),
      nodes_(scratch) {
    if (shards == nullptr) {
        data_.emplace(folder / fmt::format("{}", label), true);
    }
}

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
        if (data_) {
            data_->write_at(end_, bytes);
        } else {
            waiting_.write_at(end_, bytes);
        }
        end_ += bytes.size();
        nodes_.add({mesh.cell(i), static_cast<std::uint32_t>(bytes.size()),
                    mesh.grid().level > 0 ? eighths_of(triangles) : 0});
        level.triangles += triangles.size();
        level.bytes += bytes.size();
        ++level.fragments;
    }
    return level;
}

template <class Add>
void LabelFiles::write_manifest(const DetailGrid& grid, std::span<const double> scales,
                                const Add& add) {
    const auto number = [&](auto n) { add(std::as_bytes(std::span(&n, 1))); };
    for (int axis = 0; axis < 3; ++axis) {
        number(static_cast<float>(grid.chunk));
    }
    for (int axis = 0; axis < 3; ++axis) {
        number(static_cast<float>(grid.first[axis]));
    }
    number(static_cast<std::uint32_t>(nodes_.levels()));
    for (const double scale : scales) {
        number(static_cast<float>(scale));
    }
    for (std::size_t i = 0; i < 3 * nodes_.levels(); ++i) {
        number(0.0F);  // no level is moved
    }
    for (std::size_t i = 0; i < nodes_.levels(); ++i) {
        if (nodes_.of(i).size() > std::numeric_limits<std::uint32_t>::max()) {
            throw Error(ErrorKind::limit, {index_path_.string()},
                        "Neuroglancer's format numbers cells with 32 bits");
        }
        number(static_cast<std::uint32_t>(nodes_.of(i).size()));
    }
    for (std::size_t i = 0; i < nodes_.levels(); ++i) {
        for (int axis = 0; axis < 3; ++axis) {
            for (const DetailNode& node : nodes_.of(i)) {
                number(static_cast<std::uint32_t>(node.cell[axis]));
            }
        }
        for (const DetailNode& node : nodes_.of(i)) {
            number(node.bytes);
        }
    }
}

void LabelFiles::publish(const DetailGrid& grid, std::span<const double> scales) {
    nodes_.finish();
    if (data_) {
        AppendedFile index(index_path_);
        write_manifest(grid, scales, [&](std::span<const std::byte> bytes) { index.add(bytes); });
        data_->publish_as_named();
        index.publish();
        return;
    }
    const std::uint64_t fragments = end_;
    write_manifest(grid, scales, [&](std::span<const std::byte> bytes) {
        waiting_.write_at(end_, bytes);
        end_ += bytes.size();
    });
    const std::span<const std::byte> all = waiting_.map(end_);
    shards_->add(static_cast<std::uint64_t>(label_), all.first(fragments), all.subspan(fragments));
}

void write_mesh_info(const std::filesystem::path& folder, const StoreHeader& header,
                     const Double3& shift, bool properties,
                     const std::optional<Sharding>& sharding) {
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
    // A scale of 1: a level is drawn when a pixel is as large as its distance.
    write_whole(folder / "info",
                fmt::format("{{\"@type\": \"neuroglancer_multilod_draco\", "
                            "\"vertex_quantization_bits\": {}, \"transform\": [{}], "
                            "\"lod_scale_multiplier\": 1{}{}}}\n",
                            kBitsInCell, transform,
                            properties ? ", \"segment_properties\": \"segment_properties\"" : "",
                            sharding ? ", \"sharding\": " + sharding->json() : ""));
}

void write_segment_colors(const std::filesystem::path& folder, std::span<const LabelName> names) {
    std::string colors;
    for (const LabelName& name : names) {
        if (const auto& color = name.color) {
            colors += fmt::format("{}\"{}\": \"#{:02x}{:02x}{:02x}\"", colors.empty() ? "" : ", ",
                                  name.id, (*color)[0], (*color)[1], (*color)[2]);
        }
    }
    if (!colors.empty()) {
        write_whole(folder / "segment_colors.json",
                    fmt::format("{{\"segmentColors\": {{{}}}}}\n", colors));
    }
}

void write_segment_properties(const std::filesystem::path& folder,
                              std::span<const LabelName> names) {
    std::string ids;
    std::string values;
    for (const LabelName& name : names) {
        const char* const before = ids.empty() ? "" : ", ";
        ids += fmt::format("{}\"{}\"", before, name.id);
        values += before + json_string(name.name);
    }
    const std::filesystem::path place = folder / "segment_properties";
    std::error_code error;
    std::filesystem::create_directory(place, error);
    if (std::error_code ignored; !std::filesystem::is_directory(place, ignored)) {
        throw Error(ErrorKind::io, {place.string()},
                    "cannot create the folder: " + error.message());
    }
    write_whole(place / "info",
                fmt::format("{{\"@type\": \"neuroglancer_segment_properties\", \"inline\": "
                            "{{\"ids\": [{}], \"properties\": [{{\"id\": \"label\", \"type\": "
                            "\"label\", \"values\": [{}]}}]}}}}\n",
                            ids, values));
}

}  // namespace isonest::detail
