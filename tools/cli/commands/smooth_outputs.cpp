#include "tools/cli/commands/smooth_outputs.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cstring>
#include <functional>
#include <vector>

#include <isonest/error.h>

#include "query/finite_elements/grid_elements.h"
#include "query/finite_elements/numbered_elements.h"
#include "store/base/rotation.h"
#include "store/exports/volume_file.h"
#include "store/files/output_file.h"
#include "tools/drawing/png_writer.h"
#include "tools/drawing/slice_picture.h"

namespace isonest::detail::cli {
namespace {

/// Hands rows of elements or vertices to a sink in batches.
template <class Row>
class Batch {
  public:
    explicit Batch(std::function<void(std::uint64_t first, std::span<const Row>)> send)
        : send_(std::move(send)) {}
    void add(const Row& row) {
        rows_.push_back(row);
        if (rows_.size() == MeshSink::kMostRows) {
            flush();
        }
    }
    void flush() {
        send_(first_, rows_);
        first_ += rows_.size();
        rows_.clear();
    }

  private:
    std::function<void(std::uint64_t, std::span<const Row>)> send_;
    std::uint64_t first_ = 0;
    std::vector<Row> rows_;
};

/// A grid in a plane as a mesh with the attribute "value".
class PlaneMesh {
  public:
    PlaneMesh(const SmoothedPlace& place, const NodeSet& grid, std::span<const float> values)
        : place_(place), grid_(grid), values_(values) {}

    void send(MeshSink& sink) const {
        MeshLayout layout;
        layout.vertices = grid_.count();
        layout.attributes = {{"value", 1, false, 0}};
        layout.row_bytes = sizeof(float);
        layout.unit = place_.unit;
        layout.frame = place_.frame;
        const Int3 last = grid_.nodes() - Int3{1, 1, 1};
        layout.lo = position({0, 0, 0});
        layout.hi = position(last);
        for_leaves([&](const NumberedElement<2>&) { ++layout.elements; });
        sink.prepare(layout, {});
        sink.begin(layout);
        do {
            send_vertices(sink);
            send_elements(sink);
        } while (sink.again());
        sink.end();
    }

  private:
    struct Vertex {
        std::array<float, 3> position;
        float value;
    };
    [[nodiscard]] std::array<float, 3> position(const Int3& p) const {
        Double3 shift{};
        for (std::size_t a = 0; a < 3; ++a) {
            shift.at(a) = place_.spacing.at(a) * static_cast<double>(p[static_cast<int>(a)]);
        }
        shift = rotated(place_.direction, shift);
        std::array<float, 3> out{};
        for (std::size_t a = 0; a < 3; ++a) {
            out.at(a) = static_cast<float>(place_.origin.at(a) + shift.at(a));
        }
        return out;
    }
    [[nodiscard]] Vertex vertex(const Int3& p) const {
        return {position(p), values_[static_cast<std::size_t>(grid_.nodes().linear(p))]};
    }
    template <class Action>
    void for_leaves(const Action& action) const {
        LatticeNumbering numbering(grid_.nodes());
        const ActiveNumbers active(grid_);
        for_each_element<2>(
            place_.lattice, WithinVolume{grid_.nodes() - Int3{1, 1, 1}},
            [&](const Element<2>& t) { return active.indicator(t.ref_node(), Field::values) != 0; },
            numbering, action);
    }
    static void split(std::span<const Vertex> rows, std::vector<std::array<float, 3>>& positions,
                      std::vector<std::byte>& attributes) {
        positions.clear();
        attributes.resize(rows.size() * sizeof(float));
        for (std::size_t i = 0; i < rows.size(); ++i) {
            positions.push_back(rows[i].position);
            std::memcpy(attributes.data() + i * sizeof(float), &rows[i].value, sizeof(float));
        }
    }
    void send_vertices(MeshSink& sink) const {
        std::vector<std::array<float, 3>> positions;
        std::vector<std::byte> attributes;
        Batch<Vertex> batch([&](std::uint64_t first, std::span<const Vertex> rows) {
            split(rows, positions, attributes);
            sink.add_vertices({first, positions, attributes, sizeof(float)});
        });
        const Int3 nodes = grid_.nodes();
        for (std::int64_t row = 0; row < nodes.y * nodes.z; ++row) {
            const Int3 p{0, row % nodes.y, row / nodes.y};
            grid_.for_row(p, nodes.x, [&](std::int64_t x, std::uint64_t) {
                batch.add(vertex({x, p.y, p.z}));
            });
        }
        batch.flush();
    }
    void send_elements(MeshSink& sink) const {
        std::vector<std::array<float, 3>> positions;
        std::vector<std::byte> attributes;
        std::vector<Vertex> corners;
        std::vector<std::array<std::uint32_t, 3>> nearby;
        Batch<std::array<Int3, 3>> batch([&](std::uint64_t first,
                                             std::span<const std::array<Int3, 3>> rows) {
            std::vector<std::array<std::uint64_t, 3>> numbers;
            corners.clear();
            nearby.clear();
            for (const auto& t : rows) {
                auto& n = numbers.emplace_back();
                auto& c = nearby.emplace_back();
                for (std::size_t i = 0; i < 3; ++i) {
                    n.at(i) = grid_.number(t.at(i));
                    c.at(i) = static_cast<std::uint32_t>(corners.size());
                    corners.push_back(vertex(t.at(i)));
                }
            }
            split(corners, positions, attributes);
            sink.add_elements({first, numbers, nearby, {0, positions, attributes, sizeof(float)}});
        });
        for_leaves([&](const NumberedElement<2>& t) { batch.add(t.simplex.v); });
        batch.flush();
    }

    const SmoothedPlace& place_;
    const NodeSet& grid_;
    std::span<const float> values_;
};

/// Draws the grid's triangles, with their edges or without.
void draw(const std::filesystem::path& path, const SmoothedPlace& place, const NodeSet& grid,
          std::span<const float> values, bool edges) {
    SlicePictureOptions options;
    for (std::size_t a = 0; a < 3; ++a) {
        options.normal.at(a) = (place.lattice.flat_axes() >> a & 1U) != 0 ? 1 : 0;
    }
    options.low = place.low;
    options.high = place.high > place.low ? place.high : place.low + 1;
    options.colors = place.colors;
    options.width = place.width;
    options.height = place.height;
    options.grid = edges;
    SlicePicture picture(path, options);
    PlaneMesh(place, grid, values).send(picture);
}

NodeSet all_nodes(const Lattice& lattice) {
    NodeSet all(lattice.nodes());
    for (std::int64_t i = 0; i < lattice.nodes().product(); ++i) {
        all.insert(lattice.nodes().unlinear(i));
    }
    all.finish();
    return all;
}

VolumeFileSpec spec_of(const SmoothedPlace& place, ValueType type) {
    return {place.lattice.nodes(), type,        place.spacing, place.origin,
            place.direction,       place.force, place.unit,    place.frame};
}

}  // namespace

std::filesystem::path name_of_step(const std::filesystem::path& path, int step) {
    return path.parent_path() /
           fmt::format("{}-{}{}", path.stem().string(), step, path.extension().string());
}

void write_values(const std::filesystem::path& path, const SmoothedPlace& place,
                  std::span<const float> values) {
    if (is_png(path)) {
        return draw(path, place, all_nodes(place.lattice), values, false);
    }
    const auto file = create_volume_file(path, spec_of(place, ValueType::f32));
    file->write(reinterpret_cast<const std::byte*>(values.data()), place.lattice.nodes().z);
    file->finish();
}

void write_grid(const std::filesystem::path& path, const SmoothedPlace& place, const NodeSet& grid,
                std::span<const float> values) {
    if (is_png(path)) {
        return draw(path, place, grid, values, true);
    }
    const Int3 nodes = grid.nodes();
    const auto file = create_volume_file(path, spec_of(place, ValueType::u8));
    std::vector<std::uint8_t> plane(static_cast<std::size_t>(nodes.x * nodes.y));
    for (std::int64_t z = 0; z < nodes.z; ++z) {
        std::fill(plane.begin(), plane.end(), std::uint8_t{0});
        for (std::int64_t y = 0; y < nodes.y; ++y) {
            grid.for_row({0, y, z}, nodes.x, [&](std::int64_t x, std::uint64_t) {
                plane[static_cast<std::size_t>(x + nodes.x * y)] = 1;
            });
        }
        file->write(reinterpret_cast<const std::byte*>(plane.data()), 1);
    }
    file->finish();
}

void check_smoothed(const std::filesystem::path& path, const SmoothedPlace& place,
                    const std::vector<std::filesystem::path>& inputs) {
    std::string ending = path.extension().string();
    std::transform(ending.begin(), ending.end(), ending.begin(),
                   [](unsigned char c) { return static_cast<char>(std::tolower(c)); });
    const bool plane = place.lattice.dimension() == 2;
    if (ending == ".png" && !plane) {
        throw Error(ErrorKind::invalid_argument, {path.string()},
                    "a picture shows data in a plane, and this is a volume",
                    {{RemedyKind::other_format, ".h5, .nrrd, .raw"}});
    }
    if (ending != ".png" && ending != ".h5" && ending != ".hdf5" && ending != ".nrrd" &&
        ending != ".raw") {
        throw Error(
            ErrorKind::invalid_argument, {path.string()}, "the name says no format",
            {{RemedyKind::other_format, plane ? ".h5, .nrrd, .raw, .png" : ".h5, .nrrd, .raw"}});
    }
    check_output(path, place.force, inputs);
}

}  // namespace isonest::detail::cli
