#include "query/surface_nets/net_mesh.h"

#include <oneapi/tbb/parallel_for.h>

#include <algorithm>
#include <array>
#include <span>
#include <utility>
#include <vector>

#include "query/surface_nets/net_block.h"

namespace isonest::detail {
namespace {

/// Batches are passed on when they have this many vertices or triangles; a piece has at most twice
/// as many of its own and other vertices, and twelve times as many triangles.
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

/// Collects triangles, with the vertices that they need, for a sink.
class TriangleBatches {
  public:
    TriangleBatches(const NetStore& store, std::span<const LabelPartRecord> parts, MeshSink& sink)
        : store_(store), parts_(parts), sink_(sink), places_(kMaxPieceCells) {}

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
        for (std::size_t at = 0; at < corners_.size(); at += MeshSink::kMaxRows) {
            const std::size_t count = std::min(MeshSink::kMaxRows, corners_.size() - at);
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
    /// The number of a vertex in another piece; its position is appended to the nearby vertices.
    std::uint64_t foreign(const LabelPartRecord& part, NetCorner corner) {
        const LabelPartRecord& other = part_before(part, (corner >> kBeforeBit) & 7U);
        const auto codes = store_.codes(other);
        const auto vertices = store_.part_vertices(other);
        const auto code = static_cast<std::uint16_t>(corner & (kMaxPieceCells - 1));
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
    std::vector<std::uint32_t> places_;  ///< of the piece's vertices, among the label's
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

namespace {

/// Batches are passed on when they have this many triangles or vertices.
constexpr std::size_t kInterfaceBatch = 16384;
constexpr std::size_t kMaxPieceTriangles = std::size_t{kMaxPieceCells} * 3 * 2;
static_assert(kInterfaceBatch + kMaxPieceTriangles <= MeshSink::kMaxRows);

/// Whether the labels of a quad's edge are in the opposite order to the mesh.
bool is_reversed(const NetSides& sides) {
    return has_mesh(sides[0]) && has_mesh(sides[1]) ? sides[0] > sides[1] : !has_mesh(sides[0]);
}

/// Collects the triangles of consecutive pieces, with the vertices that they need.
class InterfaceBatches {
  public:
    InterfaceBatches(const NetStore& store, std::int64_t outside, MeshSink& sink)
        : store_(store), outside_(outside), sink_(sink) {
        corners_.reserve(kInterfaceBatch + kMaxPieceTriangles);
        nearby_corners_.reserve(kInterfaceBatch + kMaxPieceTriangles);
        sides_.reserve(kInterfaceBatch + kMaxPieceTriangles);
    }

    void add(const NetPieceRecord& piece) {
        if (corners_.empty()) {
            first_ = 2 * piece.first_quad;
        }
        const auto first_place = static_cast<std::uint32_t>(nearby_.size());
        const auto positions = store_.positions(piece);
        nearby_.insert(nearby_.end(), positions.begin(), positions.end());
        before_.fill(nullptr);
        const auto quads = store_.quads(piece);
        const auto sides = store_.sides(piece);
        for (std::size_t q = 0; q < quads.size(); ++q) {
            const NetQuad& quad = quads[q];
            std::array<std::uint64_t, 4> number{};
            std::array<std::uint32_t, 4> place{};
            for (std::size_t i = 0; i < quad.corner.size(); ++i) {
                if ((quad.corner[i] & kForeign) == 0) {
                    number[i] = piece.first_vertex + quad.corner[i];
                    place[i] = first_place + quad.corner[i];
                } else {
                    place[i] = static_cast<std::uint32_t>(nearby_.size());
                    number[i] = foreign(piece, quad.corner[i]);
                }
            }
            const bool reversed = is_reversed(sides[q]);
            const std::array<std::int64_t, 2> labels{shown(sides[q][reversed ? 1 : 0]),
                                                     shown(sides[q][reversed ? 0 : 1])};
            for (const auto& t : triangles_of(quad)) {
                const std::size_t second = t[reversed ? 2 : 1];
                const std::size_t third = t[reversed ? 1 : 2];
                corners_.push_back({number[t[0]], number[second], number[third]});
                nearby_corners_.push_back({place[t[0]], place[second], place[third]});
                sides_.push_back(labels);
            }
        }
        if (corners_.size() >= kInterfaceBatch || nearby_.size() >= kInterfaceBatch) {
            flush();
        }
    }
    void flush() {
        if (!corners_.empty()) {
            sink_.add_elements({first_, corners_, nearby_corners_, {0, nearby_, {}, 0}, sides_});
        }
        corners_.clear();
        nearby_corners_.clear();
        sides_.clear();
        nearby_.clear();
    }

  private:
    [[nodiscard]] std::int64_t shown(std::int64_t label) const {
        return has_mesh(label) ? label : outside_;
    }
    /// The number of a vertex in another piece; its position is appended to the nearby vertices.
    std::uint64_t foreign(const NetPieceRecord& piece, NetCorner corner) {
        const NetPieceRecord& other = piece_before(piece, (corner >> kBeforeBit) & 7U);
        const auto codes = store_.codes(other);
        const auto code = static_cast<std::uint16_t>(corner & (kMaxPieceCells - 1));
        const auto at = std::lower_bound(codes.begin(), codes.end(), code) - codes.begin();
        nearby_.push_back(store_.positions(other)[static_cast<std::size_t>(at)]);
        return other.first_vertex + static_cast<std::uint64_t>(at);
    }
    /// The piece before this one along the axes of `bits`.
    const NetPieceRecord& piece_before(const NetPieceRecord& piece, std::size_t bits) {
        const NetPieceRecord*& known = before_[bits];
        if (known == nullptr) {
            const Int3& pieces = store_.pieces();
            const std::int64_t step =
                static_cast<std::int64_t>(bits & 1U) +
                static_cast<std::int64_t>(bits >> 1U & 1U) * pieces.x +
                static_cast<std::int64_t>(bits >> 2U & 1U) * pieces.x * pieces.y;
            const auto all = store_.all_pieces();
            known = &*std::lower_bound(
                all.begin(), all.end(), piece.piece - step,
                [](const NetPieceRecord& r, std::int64_t number) { return r.piece < number; });
        }
        return *known;
    }

    const NetStore& store_;
    std::int64_t outside_;
    MeshSink& sink_;
    std::array<const NetPieceRecord*, 8> before_{};
    std::uint64_t first_ = 0;
    std::vector<std::array<std::uint64_t, 3>> corners_;
    std::vector<std::array<std::uint32_t, 3>> nearby_corners_;
    std::vector<std::array<std::int64_t, 2>> sides_;
    std::vector<std::array<float, 3>> nearby_;
};

/// Calls work(pieces) with all pieces or, if the sink is concurrent, with runs of them in all
/// threads.
template <class Work>
void each_run(const NetStore& store, const MeshSink& sink, const Work& work) {
    const std::span<const NetPieceRecord> all = store.all_pieces();
    if (!sink.concurrent()) {
        work(all);
        return;
    }
    tbb::parallel_for(tbb::blocked_range<std::size_t>(0, all.size()),
                      [&](const tbb::blocked_range<std::size_t>& range) {
                          work(all.subspan(range.begin(), range.size()));
                      });
}

}  // namespace

NetMesh emit_net_interfaces(const NetStore& store, std::int64_t outside, MeshLayout layout,
                            MeshSink& sink, const Progress& progress) {
    NetMesh mesh;
    layout.lo = MeshLayout::kEmptyLo;
    layout.hi = MeshLayout::kEmptyHi;
    layout.has_sides = true;
    layout.sides_range = {outside, outside};
    for (const NetPieceRecord& piece : store.all_pieces()) {
        mesh.vertices += piece.vertices;
        mesh.triangles += 2 * std::uint64_t{piece.quads};
        mesh.no_area += piece.no_area;
        mesh.moved = std::max(mesh.moved, static_cast<double>(piece.moved));
        layout.sides_range = {std::min(layout.sides_range[0], piece.least),
                              std::max(layout.sides_range[1], piece.most)};
        for (std::size_t axis = 0; axis < 3; ++axis) {
            layout.lo[axis] = std::min(layout.lo[axis], piece.lo[axis]);
            layout.hi[axis] = std::max(layout.hi[axis], piece.hi[axis]);
        }
    }
    layout.vertices = mesh.vertices;
    layout.elements = mesh.triangles;
    sink.begin(layout);
    do {
        each_run(store, sink, [&](std::span<const NetPieceRecord> pieces) {
            for (const NetPieceRecord& piece : pieces) {
                progress.check();
                if (piece.vertices > 0) {
                    sink.add_vertices({piece.first_vertex, store.positions(piece), {}, 0});
                }
            }
        });
        each_run(store, sink, [&](std::span<const NetPieceRecord> pieces) {
            InterfaceBatches triangles(store, outside, sink);
            for (const NetPieceRecord& piece : pieces) {
                progress.check();
                triangles.add(piece);
            }
            triangles.flush();
        });
    } while (sink.again());
    sink.end();
    return mesh;
}

void each_interface(const NetStore& store, std::span<const std::int64_t> wanted,
                    const std::function<void(const SharedArea&)>& each) {
    const std::span<const SharedRecord> all = store.all_shared();
    for (std::size_t i = 0; i < all.size();) {
        SharedArea sum = all[i].shared;
        for (++i;
             i < all.size() && all[i].shared.label == sum.label && all[i].shared.other == sum.other;
             ++i) {
            sum.area += all[i].shared.area;
        }
        const bool is_second = has_mesh(sum.other) && sum.other < sum.label;
        if (is_second && std::binary_search(wanted.begin(), wanted.end(), sum.other)) {
            continue;  // was passed with the other label
        }
        if (is_second) {
            std::swap(sum.label, sum.other);
        }
        each(sum);
    }
}

}  // namespace isonest::detail
