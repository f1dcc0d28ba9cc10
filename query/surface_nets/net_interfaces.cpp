#include "query/surface_nets/net_interfaces.h"

#include <oneapi/tbb/parallel_for.h>

#include <algorithm>
#include <array>
#include <utility>
#include <vector>

#include "query/surface_nets/net_cell.h"

namespace isonest::detail {
namespace {

/// Batches are handed over when they have so many triangles or vertices.
constexpr std::size_t kInterfaceBatch = 16384;
constexpr std::size_t kMostPieceTriangles = std::size_t{kMostPieceCells} * 3 * 2;
static_assert(kInterfaceBatch + kMostPieceTriangles <= MeshSink::kMostRows);

/// Whether the labels of a quad's edge are the other way round than the mesh has them.
bool is_reversed(const NetSides& sides) {
    return has_mesh(sides[0]) && has_mesh(sides[1]) ? sides[0] > sides[1] : !has_mesh(sides[0]);
}

/// Collects the triangles of pieces that follow each other, and the vertices that they need.
class InterfaceBatches {
  public:
    InterfaceBatches(const NetStore& store, std::int64_t outside, MeshSink& sink)
        : store_(store), outside_(outside), sink_(sink) {
        corners_.reserve(kInterfaceBatch + kMostPieceTriangles);
        nearby_corners_.reserve(kInterfaceBatch + kMostPieceTriangles);
        sides_.reserve(kInterfaceBatch + kMostPieceTriangles);
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
    /// The number of a vertex in another piece, whose position becomes the last of those nearby.
    std::uint64_t foreign(const NetPieceRecord& piece, NetCorner corner) {
        const NetPieceRecord& other = piece_before(piece, (corner >> kBeforeBit) & 7U);
        const auto codes = store_.codes(other);
        const auto code = static_cast<std::uint16_t>(corner & (kMostPieceCells - 1));
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

/// Calls work(pieces) with all of them, or, if the sink takes that, with runs of them in all
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
            continue;  // it came with the other label
        }
        if (is_second) {
            std::swap(sum.label, sum.other);
        }
        each(sum);
    }
}

}  // namespace isonest::detail
