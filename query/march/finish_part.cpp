#include "query/march/finish_part.h"

#include <algorithm>

namespace isonest::detail {
namespace {

/// A bijection on 64-bit numbers that leaves no pattern (the finaliser of MurmurHash3).
std::uint64_t scrambled(std::uint64_t h) {
    h = (h ^ (h >> 33U)) * 0xFF51AFD7ED558CCDULL;
    h = (h ^ (h >> 33U)) * 0xC4CEB9FE1A85EC53ULL;
    return h ^ (h >> 33U);
}

/// For each vertex 0 if it is complete: if its triangles close up around it, the neighbours that
/// they enter and leave by are the same, and their (mixed) numbers cancel. An incomplete one may
/// continue in another part.
std::vector<std::uint64_t> open_vertices(const PartVertices& vertices,
                                         std::vector<CollectedTriangle>& triangles) {
    std::vector<std::uint64_t> open(vertices.size(), 0);
    for (CollectedTriangle& t : triangles) {
        std::array<std::uint64_t, 3> mixed{};
        for (std::size_t i = 0; i < 3; ++i) {
            t.v[i] = vertices.root(t.v[i]);
            mixed[i] = scrambled(t.v[i]);
        }
        open[t.v[0]] += mixed[1] - mixed[2];
        open[t.v[1]] += mixed[2] - mixed[0];
        open[t.v[2]] += mixed[0] - mixed[1];
    }
    vertices.for_incomplete(
        [&](const VertexKey&, std::uint32_t v) { open[vertices.root(v)] |= 1U; });
    return open;
}

class Finisher {
  public:
    Finisher(PartVertices& vertices, const ClipBox& box)
        : vertices_(vertices),
          first_new_(static_cast<std::uint32_t>(vertices.size())),
          clip_(
              box, [this](std::uint32_t v) -> const Double3& { return vertices_.position(v); },
              first_new_),
          number_(vertices.size(), MeshPart::kNoVertex) {}

    void add_triangles(const std::vector<CollectedTriangle>& triangles, bool lines) {
        part_.positions.reserve(vertices_.size());
        order_.reserve(vertices_.size());
        part_.triangles.reserve(triangles.size());
        for (const CollectedTriangle& t : triangles) {
            if (!t.cut) {
                part_.triangles.push_back({number(t.v[0]), number(t.v[1]), number(t.v[2])});
                continue;
            }
            for (const auto& piece : clip_.cut(t.v)) {
                if (lines && (piece[0] == piece[1] || piece[1] != piece[2])) {
                    continue;  // what a flat triangle leaves beside its line
                }
                number_.resize(std::max<std::size_t>(number_.size(),
                                                     std::max({piece[0], piece[1], piece[2]}) + 1),
                               MeshPart::kNoVertex);
                part_.triangles.push_back({number(piece[0]), number(piece[1]), number(piece[2])});
            }
        }
    }

    /// Names what other parts may share.
    void name(const std::vector<std::uint64_t>& open) {
        shared_.assign(number_.size(), MeshPart::kNoVertex);
        const auto is_shared = [&](std::uint32_t v) {
            return v < first_new_ ? open[v] != 0 : clip_.is_shared(v, open);
        };
        // Shared elements with a vertex come first, in the order of the vertices.
        for (const std::uint32_t v : order_) {
            if (is_shared(v)) {
                shared_[v] = static_cast<std::uint32_t>(part_.shared.size());
                part_.shared.push_back({number_[v]});
            }
        }
        for (const std::uint32_t v : order_) {
            if (v >= first_new_ && is_shared(v)) {
                const ClipContext::CutVertex& c = clip_.vertex(v);
                part_.cuts.push_back({shared_of(c.end0), shared_of(c.end1), c.plane, shared_[v]});
            }
        }
        for (std::uint32_t v = 0; v < first_new_; ++v) {
            if (open[v] != 0 && vertices_.key(v) != PartVertices::kNoKey) {
                part_.names.push_back({{vertices_.key(v), 0, VertexKind::edge}, shared_of(v)});
            }
        }
        vertices_.for_incomplete([&](const VertexKey& key, std::uint32_t v) {
            part_.names.push_back({key, shared_of(vertices_.root(v))});
        });
        vertices_.for_cuts([&](const VertexKey& key, std::uint32_t v) {
            if (open[v] != 0) {
                part_.names.push_back({key, shared_of(v)});
            }
        });
    }

    [[nodiscard]] MeshPart take() {
        part_.cut_fans = clip_.cut_fans();
        return std::move(part_);
    }

  private:
    std::uint32_t number(std::uint32_t v) {
        if (number_[v] == MeshPart::kNoVertex) {
            number_[v] = append(v);
        }
        return number_[v];
    }
    std::uint32_t append(std::uint32_t v) {
        const auto next = static_cast<std::uint32_t>(part_.positions.size());
        part_.positions.push_back(v < first_new_ ? vertices_.position(v) : clip_.position(v));
        if (v >= first_new_ || vertices_.key(v) == PartVertices::kNoKey) {
            part_.off_edges.push_back(next);
        }
        if (const auto width = static_cast<std::ptrdiff_t>(vertices_.width()); width > 0) {
            const VertexAttributes a = attributes(v);
            part_.attributes.insert(part_.attributes.end(), a.begin(), a.begin() + width);
        }
        order_.push_back(v);
        return next;
    }
    [[nodiscard]] VertexAttributes attributes(std::uint32_t v) const {
        if (v < first_new_) {
            return vertices_.attributes(v);
        }
        const ClipContext::CutVertex& c = clip_.vertex(v);
        return vertices_.mix(attributes(c.from), attributes(c.to), c.t);
    }
    std::uint32_t shared_of(std::uint32_t v) {
        if (shared_[v] == MeshPart::kNoVertex) {
            shared_[v] = static_cast<std::uint32_t>(part_.shared.size());
            part_.shared.emplace_back();
        }
        return shared_[v];
    }

    const PartVertices& vertices_;
    std::uint32_t first_new_;  ///< cut vertices are numbered from here on
    ClipContext clip_;
    std::vector<std::uint32_t> number_;  ///< in the part
    std::vector<std::uint32_t> order_;   ///< vertices by number
    std::vector<std::uint32_t> shared_;
    MeshPart part_;
};

}  // namespace

MeshPart finish_part(PartVertices& vertices, std::vector<CollectedTriangle>& triangles, bool lines,
                     const ClipBox& box) {
    vertices.flatten();
    std::vector<std::uint64_t> open = open_vertices(vertices, triangles);
    if (lines) {
        std::fill(open.begin(), open.end(), 1);  // any end may go on in another part
    }
    Finisher finisher(vertices, box);
    finisher.add_triangles(triangles, lines);
    finisher.name(open);
    return finisher.take();
}

}  // namespace isonest::detail
