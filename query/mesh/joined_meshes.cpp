#include "query/mesh/joined_meshes.h"

#include <algorithm>
#include <cstring>
#include <utility>

namespace isonest::detail {
namespace {

bool is_rounded_by_float32(double isovalue) {
    return static_cast<double>(static_cast<float>(isovalue)) != isovalue;
}

/// Batches of one mesh on their way into the joined one.
class Moved : public MeshSink {
  public:
    /// `number`: the bytes of the isovalue.
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
    /// Each row with the isovalue behind it.
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
