#include "query/surface_nets/net_mesh.h"

#include <algorithm>
#include <array>
#include <span>
#include <vector>

namespace isonest::detail {
namespace {

/// Batches are handed over when they have so many vertices or triangles; a piece has at most twice
/// as many of its own and of others, and twelve times as many triangles.
constexpr std::size_t kBatch = 16384;

/// Collects vertices for a sink.
class VertexBatches {
  public:
    explicit VertexBatches(MeshSink& sink) : sink_(sink) {}
    void add(const std::array<float, 3>& position) {
        positions_.push_back(position);
        if (positions_.size() == kBatch) {
            flush();
        }
    }
    void flush() {
        if (!positions_.empty()) {
            sink_.add_vertices({first_, positions_, {}, 0});
            first_ += positions_.size();
            positions_.clear();
        }
    }

  private:
    MeshSink& sink_;
    std::uint64_t first_ = 0;
    std::vector<std::array<float, 3>> positions_;
};

/// Collects triangles, and the vertices that they need, for a sink.
class TriangleBatches {
  public:
    TriangleBatches(const NetStore& store, std::span<const LabelPartRecord> parts, MeshSink& sink)
        : store_(store), parts_(parts), sink_(sink), places_(kMostPieceCells) {}

    void add(const LabelPartRecord& part) {
        const auto positions = store_.positions(part);
        const auto vertices = store_.part_vertices(part);
        const auto first_place = static_cast<std::uint32_t>(nearby_.size());
        for (std::uint32_t i = 0; i < vertices.size(); ++i) {
            places_[vertices[i]] = i;
            nearby_.push_back(positions[vertices[i]]);
        }
        before_.fill(nullptr);
        const auto quads = store_.quads(part);
        for (const std::uint32_t which : store_.part_quads(part)) {
            const NetQuad& quad = quads[which & ~LabelPart::kReversed];
            std::array<std::uint64_t, 4> number{};
            std::array<std::uint32_t, 4> place{};
            for (std::size_t i = 0; i < quad.corner.size(); ++i) {
                if ((quad.corner[i] & kForeign) == 0) {
                    const std::uint32_t own = places_[quad.corner[i]];
                    number[i] = part.first_vertex + own;
                    place[i] = first_place + own;
                } else {
                    place[i] = static_cast<std::uint32_t>(nearby_.size());
                    number[i] = foreign(part, quad.corner[i]);
                }
            }
            const bool reversed = (which & LabelPart::kReversed) != 0;
            for (const auto& t : triangles_of(quad)) {
                const std::size_t second = t[reversed ? 2 : 1];
                const std::size_t third = t[reversed ? 1 : 2];
                corners_.push_back({number[t[0]], number[second], number[third]});
                nearby_corners_.push_back({place[t[0]], place[second], place[third]});
            }
        }
        if (corners_.size() >= kBatch || nearby_.size() >= kBatch) {
            flush();
        }
    }
    void flush() {
        for (std::size_t at = 0; at < corners_.size(); at += MeshSink::kMostRows) {
            const std::size_t count = std::min(MeshSink::kMostRows, corners_.size() - at);
            sink_.add_elements({first_ + at,
                                std::span(corners_).subspan(at, count),
                                std::span(nearby_corners_).subspan(at, count),
                                {0, nearby_, {}, 0}});
        }
        first_ += corners_.size();
        corners_.clear();
        nearby_corners_.clear();
        nearby_.clear();
    }

  private:
    /// The number of a vertex in another piece, whose position becomes the last of those nearby.
    std::uint64_t foreign(const LabelPartRecord& part, NetCorner corner) {
        const LabelPartRecord& other = part_before(part, (corner >> kBeforeBit) & 7U);
        const auto codes = store_.codes(other);
        const auto vertices = store_.part_vertices(other);
        const auto code = static_cast<std::uint16_t>(corner & (kMostPieceCells - 1));
        const auto at =
            std::lower_bound(vertices.begin(), vertices.end(), code,
                             [&](std::uint16_t v, std::uint16_t c) { return codes[v] < c; });
        nearby_.push_back(store_.positions(other)[*at]);
        return other.first_vertex + static_cast<std::uint64_t>(at - vertices.begin());
    }
    /// The label's part of the piece before this one along the axes of `bits`.
    const LabelPartRecord& part_before(const LabelPartRecord& part, std::size_t bits) {
        const LabelPartRecord*& known = before_[bits];
        if (known == nullptr) {
            const std::int64_t step = static_cast<std::int64_t>(bits & 1U) +
                                      static_cast<std::int64_t>(bits >> 1U & 1U) * row_ +
                                      static_cast<std::int64_t>(bits >> 2U & 1U) * plane_;
            known = &*std::lower_bound(
                parts_.begin(), parts_.end(), part.piece - step,
                [](const LabelPartRecord& r, std::int64_t piece) { return r.piece < piece; });
        }
        return *known;
    }

    const NetStore& store_;
    std::span<const LabelPartRecord> parts_;
    MeshSink& sink_;
    std::int64_t row_ = store_.pieces().x;
    std::int64_t plane_ = store_.pieces().x * store_.pieces().y;
    std::vector<std::uint32_t> places_;  ///< of the piece's vertices among the label's
    std::array<const LabelPartRecord*, 8> before_{};
    std::uint64_t first_ = 0;
    std::vector<std::array<std::uint64_t, 3>> corners_;
    std::vector<std::array<std::uint32_t, 3>> nearby_corners_;
    std::vector<std::array<float, 3>> nearby_;
};

}  // namespace

NetMesh emit_net_mesh(const NetStore& store, std::int64_t label, MeshLayout layout, MeshSink& sink,
                      const Progress& progress) {
    const std::span<const LabelPartRecord> parts = store.parts(label);
    NetMesh mesh;
    layout.lo = MeshLayout::kEmptyLo;
    layout.hi = MeshLayout::kEmptyHi;
    for (const LabelPartRecord& part : parts) {
        mesh.vertices += part.vertices;
        mesh.triangles += 2 * std::uint64_t{part.quads};
        mesh.no_area += part.no_area;
        mesh.moved = std::max(mesh.moved, static_cast<double>(part.moved));
        for (std::size_t axis = 0; axis < 3 && part.vertices > 0; ++axis) {
            layout.lo[axis] = std::min(layout.lo[axis], part.lo[axis]);
            layout.hi[axis] = std::max(layout.hi[axis], part.hi[axis]);
        }
    }
    layout.vertices = mesh.vertices;
    layout.elements = mesh.triangles;
    sink.begin(layout);
    do {
        VertexBatches vertices(sink);
        for (const LabelPartRecord& part : parts) {
            progress.check();
            const auto positions = store.positions(part);
            for (const std::uint16_t v : store.part_vertices(part)) {
                vertices.add(positions[v]);
            }
        }
        vertices.flush();
        TriangleBatches triangles(store, parts, sink);
        for (const LabelPartRecord& part : parts) {
            progress.check();
            triangles.add(part);
        }
        triangles.flush();
    } while (sink.again());
    sink.end();
    return mesh;
}

}  // namespace isonest::detail
