#include "query/mesh/mesh_sinks.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <limits>
#include <utility>

#include <isonest/error.h>
#include <isonest/mesh_sink.h>

#include "query/mesh/vertex_stars.h"
#include "store/base/vectors.h"

namespace isonest {
namespace {

template <class T>
T read(const std::byte* at) {
    T number{};
    std::memcpy(&number, at, sizeof(number));
    return number;
}

}  // namespace

const VertexAttribute* MeshLayout::find(std::string_view name) const {
    for (const VertexAttribute& attribute : attributes) {
        if (attribute.name == name) {
            return &attribute;
        }
    }
    return nullptr;
}

double VertexBatch::number(std::size_t i, const VertexAttribute& attribute, int component) const {
    const std::byte* const at = attributes.data() + i * row_bytes + attribute.offset;
    const auto c = static_cast<std::size_t>(component);
    return attribute.is_double ? read<double>(at + c * sizeof(double))
                               : static_cast<double>(read<float>(at + c * sizeof(float)));
}

void MeshCollector::begin(const MeshLayout& layout) {
    if (layout.vertices > std::numeric_limits<std::uint32_t>::max()) {
        throw Error(
            ErrorKind::limit,
            fmt::format("the mesh has {} vertices, more than 32 bits can number", layout.vertices),
            {{RemedyKind::smaller_box}, {RemedyKind::larger_error}});
    }
    layout_ = layout;
    const auto count = [](bool is_there, std::uint64_t n) {
        return is_there ? static_cast<std::size_t>(n) : 0;
    };
    vertices.assign(count(true, layout.vertices), {});
    triangles.assign(count(layout.corners == 3, layout.elements), {});
    lines.assign(count(layout.corners == 2, layout.elements), {});
    normals.assign(count(layout.find("normal") != nullptr, layout.vertices), {});
    values.assign(count(layout.find("value") != nullptr, layout.vertices), 0);
    errors.assign(count(layout.find("error") != nullptr, layout.vertices), 0);
    sides.assign(count(layout.has_sides, layout.elements), {});
}

void MeshCollector::add_vertices(const VertexBatch& batch) {
    const auto first = static_cast<std::size_t>(batch.first);
    std::copy(batch.positions.begin(), batch.positions.end(),
              vertices.begin() + static_cast<std::ptrdiff_t>(first));
    const std::size_t count = batch.positions.size();
    if (const VertexAttribute* const normal = layout_.find("normal")) {
        for (std::size_t i = 0; i < count; ++i) {
            for (int c = 0; c < 3; ++c) {
                normals[first + i][static_cast<std::size_t>(c)] =
                    static_cast<float>(batch.number(i, *normal, c));
            }
        }
    }
    if (const VertexAttribute* const value = layout_.find("value")) {
        for (std::size_t i = 0; i < count; ++i) {
            values[first + i] = batch.number(i, *value);
        }
    }
    if (const VertexAttribute* const error = layout_.find("error")) {
        for (std::size_t i = 0; i < count; ++i) {
            errors[first + i] = static_cast<float>(batch.number(i, *error));
        }
    }
}

void MeshCollector::add_elements(const ElementBatch& batch) {
    auto i = static_cast<std::size_t>(batch.first);
    if (layout_.has_sides) {
        std::copy(batch.sides.begin(), batch.sides.end(),
                  sides.begin() + static_cast<std::ptrdiff_t>(i));
    }
    for (const auto& [a, b, c] : batch.corners) {
        if (layout_.corners == 3) {
            triangles[i++] = {static_cast<std::uint32_t>(a), static_cast<std::uint32_t>(b),
                              static_cast<std::uint32_t>(c)};
        } else {
            lines[i++] = {static_cast<std::uint32_t>(a), static_cast<std::uint32_t>(b)};
        }
    }
}

void CallbackSink::add_vertices(const VertexBatch& batch) {
    if (on_vertices_) {
        on_vertices_(batch);
    }
}

void CallbackSink::add_elements(const ElementBatch& batch) {
    if (on_elements_) {
        on_elements_(batch);
    }
}

}  // namespace isonest

namespace isonest::detail {
void RotatedSink::begin(const MeshLayout& layout) {
    layout_ = layout;
    layout_.lo = MeshLayout::kEmptyLo;
    layout_.hi = MeshLayout::kEmptyHi;
}

RotatedSink::Turned RotatedSink::turned(const VertexBatch& batch) const {
    Turned t;
    t.positions.resize(batch.positions.size());
    for (std::size_t i = 0; i < batch.positions.size(); ++i) {
        const auto& p = batch.positions[i];
        const Double3 world = rotated_about(
            about_, direction_,
            {static_cast<double>(p[0]), static_cast<double>(p[1]), static_cast<double>(p[2])});
        for (std::size_t a = 0; a < 3; ++a) {
            t.positions[i][a] = static_cast<float>(world[a]);
        }
    }
    t.attributes.assign(batch.attributes.begin(), batch.attributes.end());
    const VertexAttribute* const normal = layout_.find("normal");
    for (std::size_t i = 0; normal != nullptr && i < batch.positions.size(); ++i) {
        const Double3 world =
            rotated(direction_, {batch.number(i, *normal, 0), batch.number(i, *normal, 1),
                                 batch.number(i, *normal, 2)});
        std::array<float, 3> stored{};
        for (std::size_t a = 0; a < 3; ++a) {
            stored.at(a) = static_cast<float>(world[a]);
        }
        std::memcpy(t.attributes.data() + i * batch.row_bytes + normal->offset, stored.data(),
                    sizeof(stored));
    }
    return t;
}

void RotatedSink::add_vertices(const VertexBatch& batch) {
    const Turned t = turned(batch);
    if (measured_) {
        inner_.add_vertices({batch.first, t.positions, t.attributes, batch.row_bytes});
        return;
    }
    std::array<float, 3> lo = MeshLayout::kEmptyLo;
    std::array<float, 3> hi = MeshLayout::kEmptyHi;
    const auto widen = [](std::array<float, 3>& low, std::array<float, 3>& high,
                          const std::array<float, 3>& from, const std::array<float, 3>& to) {
        for (std::size_t a = 0; a < 3; ++a) {
            low[a] = std::min(low[a], from[a]);
            high[a] = std::max(high[a], to[a]);
        }
    };
    for (const auto& p : t.positions) {
        widen(lo, hi, p, p);
    }
    const std::lock_guard lock(box_);
    widen(layout_.lo, layout_.hi, lo, hi);
}

void RotatedSink::add_elements(const ElementBatch& batch) {
    if (!measured_ && layout_.corners != 3) {
        return;
    }
    const Turned t = turned(batch.nearby);
    if (!measured_) {
        zero_area_ += static_cast<std::uint64_t>(std::count_if(
            batch.nearby_corners.begin(), batch.nearby_corners.end(), [&t](const auto& c) {
                return has_no_area(t.positions[c[0]], t.positions[c[1]], t.positions[c[2]]);
            }));
        return;
    }
    ElementBatch turned_batch = batch;
    turned_batch.nearby = {batch.nearby.first, t.positions, t.attributes, batch.nearby.row_bytes};
    inner_.add_elements(turned_batch);
}

bool RotatedSink::again() {
    if (measured_) {
        return inner_.again();
    }
    measured_ = true;
    inner_.begin(layout_);
    return true;
}

double RotatedSink::rounding() const {
    double sum = 0;
    for (std::size_t a = 0; a < 3; ++a) {
        const float largest = std::max(std::fabs(layout_.lo[a]), std::fabs(layout_.hi[a]));
        const float next = std::nextafter(largest, std::numeric_limits<float>::infinity());
        const double half = (static_cast<double>(next) - static_cast<double>(largest)) / 2;
        sum += layout_.lo[a] <= layout_.hi[a] ? half * half : 0;
    }
    return std::sqrt(sum);
}

namespace {

bool is_rounded_by_float32(double isovalue) {
    return static_cast<double>(static_cast<float>(isovalue)) != isovalue;
}

/// Passes batches of one mesh to the joined one.
class Moved : public MeshSink {
  public:
    /// `number`: the isovalue as bytes.
    Moved(MeshSink& sink, std::uint64_t first_vertex, std::uint64_t first_element,
          std::vector<std::byte> number)
        : sink_(sink),
          first_vertex_(first_vertex),
          first_element_(first_element),
          number_(std::move(number)) {}

    void begin(const MeshLayout& /*layout*/) override {}
    void add_vertices(const VertexBatch& batch) override {
        widen(batch);
        sink_.add_vertices({first_vertex_ + batch.first, batch.positions, rows_,
                            batch.row_bytes + number_.size()});
    }
    void add_elements(const ElementBatch& batch) override {
        corners_.assign(batch.corners.begin(), batch.corners.end());
        for (auto& element : corners_) {
            for (std::uint64_t& vertex : element) {
                vertex += first_vertex_;
            }
        }
        widen(batch.nearby);
        sink_.add_elements({first_element_ + batch.first,
                            corners_,
                            batch.nearby_corners,
                            {batch.nearby.first, batch.nearby.positions, rows_,
                             batch.nearby.row_bytes + number_.size()}});
    }

  private:
    /// Appends the isovalue to each row.
    void widen(const VertexBatch& batch) {
        rows_.clear();
        for (std::size_t i = 0; i < batch.positions.size(); ++i) {
            const auto row = batch.attributes.subspan(i * batch.row_bytes, batch.row_bytes);
            rows_.insert(rows_.end(), row.begin(), row.end());
            rows_.insert(rows_.end(), number_.begin(), number_.end());
        }
    }

    MeshSink& sink_;
    std::uint64_t first_vertex_;
    std::uint64_t first_element_;
    std::vector<std::byte> number_;
    std::vector<std::byte> rows_;
    std::vector<std::array<std::uint64_t, 3>> corners_;
};

template <class T>
std::vector<std::byte> bytes_of(T number) {
    std::vector<std::byte> bytes(sizeof(number));
    std::memcpy(bytes.data(), &number, sizeof(number));
    return bytes;
}

}  // namespace

class JoinedMeshes::Part : public MeshSink {
  public:
    Part(JoinedMeshes& joined, std::size_t number) : joined_(joined), number_(number) {}

    void prepare(const MeshLayout& layout, std::span<const std::filesystem::path> inputs) override {
        if (number_ == 0) {
            joined_.sink_.prepare(joined_.with_isovalue(layout), inputs);
        }
    }
    void begin(const MeshLayout& layout) override {
        mesh_ = std::make_unique<ScratchMesh>(joined_.scratch_);
        mesh_->begin(layout);
    }
    void add_vertices(const VertexBatch& batch) override { mesh_->add_vertices(batch); }
    void add_elements(const ElementBatch& batch) override { mesh_->add_elements(batch); }
    void end() override {
        mesh_->end();
        joined_.meshes_[number_] = std::move(mesh_);
    }
    [[nodiscard]] bool concurrent() const override { return true; }
    [[nodiscard]] bool holds_float64() const override { return joined_.sink_.holds_float64(); }

  private:
    JoinedMeshes& joined_;
    std::size_t number_;
    std::unique_ptr<ScratchMesh> mesh_;
};

JoinedMeshes::JoinedMeshes(MeshSink& sink, std::span<const double> isovalues, ScratchFolder scratch)
    : sink_(sink),
      isovalues_(isovalues.begin(), isovalues.end()),
      scratch_(std::move(scratch)),
      is_double_(sink.holds_float64() &&
                 std::any_of(isovalues.begin(), isovalues.end(), is_rounded_by_float32)),
      meshes_(isovalues.size()) {}

std::unique_ptr<MeshSink> JoinedMeshes::part(std::size_t i) {
    return std::make_unique<Part>(*this, i);
}

MeshLayout JoinedMeshes::with_isovalue(MeshLayout layout) const {
    layout.attributes.push_back({"isovalue", 1, is_double_, layout.row_bytes, true});
    layout.row_bytes += layout.attributes.back().bytes();
    return layout;
}

void JoinedMeshes::emit(Progress& progress) {
    MeshLayout layout = with_isovalue(meshes_.front()->layout());
    for (std::size_t i = 1; i < meshes_.size(); ++i) {
        const MeshLayout& own = meshes_[i]->layout();
        const bool is_first = layout.vertices == 0;
        layout.vertices += own.vertices;
        layout.elements += own.elements;
        for (std::size_t a = 0; a < 3 && own.vertices > 0; ++a) {
            layout.lo[a] = is_first ? own.lo[a] : std::min(layout.lo[a], own.lo[a]);
            layout.hi[a] = is_first ? own.hi[a] : std::max(layout.hi[a], own.hi[a]);
        }
    }
    const auto for_each = [&](const auto& hand_over) {
        std::uint64_t vertices = 0;
        std::uint64_t elements = 0;
        for (std::size_t i = 0; i < meshes_.size(); ++i) {
            Moved moved(
                sink_, vertices, elements,
                is_double_ ? bytes_of(isovalues_[i]) : bytes_of(static_cast<float>(isovalues_[i])));
            hand_over(*meshes_[i], moved);
            vertices += meshes_[i]->layout().vertices;
            elements += meshes_[i]->layout().elements;
        }
    };
    sink_.begin(layout);
    do {
        progress.begin("write mesh", layout.elements,
                       layout.corners == 2 ? "line segments" : "triangles");
        for_each([&](const ScratchMesh& mesh, MeshSink& to) { emit_vertices(mesh, to, progress); });
        for_each([&](const ScratchMesh& mesh, MeshSink& to) { emit_elements(mesh, to, progress); });
    } while (sink_.again());
    sink_.end();
}

}  // namespace isonest::detail
