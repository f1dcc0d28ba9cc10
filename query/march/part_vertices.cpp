#include "query/march/part_vertices.h"

#include <algorithm>
#include <cmath>

#include "query/march/cube_cases.h"
#include "query/values/topology.h"
#include "store/base/box.h"

namespace isonest::detail {
namespace {

/// Numbers in the table of points are vertices or, with these bits, links.
constexpr std::uint32_t kTag = 0xC0000000U;
constexpr std::uint32_t kFanTag = 0x80000000U;
constexpr std::uint32_t kRunTag = 0xC0000000U;
constexpr bool is_vertex(std::uint32_t slot) {
    return slot < kFanTag;
}

bool precedes(const Int3& a, const Int3& b) {
    return a.z != b.z ? a.z < b.z : a.y != b.y ? a.y < b.y : a.x < b.x;
}

constexpr Int3 kLinkBox{5, 5, 5};

/// Numbers the edges around a node by the sums of their ends, with the node at {2, 2, 2}: no node
/// is halfway between nodes of the same cube.
constexpr std::array<std::uint8_t, 125> number_link_edges() {
    std::array<std::uint8_t, 125> number{};
    std::uint8_t next = 0;
    for (std::size_t i = 0; i < number.size(); ++i) {
        const Int3 p = kLinkBox.unlinear(static_cast<std::int64_t>(i));
        const bool between = ((p.x | p.y | p.z) & 1) != 0;
        number[i] = between ? next++ : kLinkEdges;
    }
    return number;
}
constexpr std::array<std::uint8_t, 125> kLinkEdge = number_link_edges();

}  // namespace

void PartVertices::clear() {
    points_.clear();
    fans_.clear();
    runs_.clear();
    rare_.clear();
    cuts_.clear();
    parents_.clear();
    keys_.clear();
    positions_.clear();
    values_.clear();
}

void PartVertices::flatten() {
    // Parents precede their children.
    for (std::uint32_t& parent : parents_) {
        parent = parents_[parent];
    }
}

std::uint32_t PartVertices::add(std::uint64_t key, const Double3& position) {
    const auto next = static_cast<std::uint32_t>(parents_.size());
    parents_.push_back(next);
    keys_.push_back(key);
    positions_.push_back(position);
    return next;
}

std::uint32_t PartVertices::edge(const Int3& a, double a_value, const Int3& b, double b_value,
                                 double iso) {
    std::uint32_t& slot = points_.at(a + b);
    if (!is_vertex(slot)) {
        slot = add_edge(a, a_value, b, b_value, iso);
    }
    return slot;
}

std::uint32_t PartVertices::edge_of_cube(const Cube& cube, std::size_t edge, double iso) {
    const CubeEdge& e = kCubeEdge[edge];
    std::uint32_t& slot = points_.at(cube.low * 2 + node_offset(e.midpoint, cube.mirror));
    if (!is_vertex(slot)) {
        const auto node = [&](unsigned corner) {
            return cube.low + corner_offset(corner ^ cube.mirror);
        };
        slot = add_edge(node(e.low), cube.value[e.low], node(e.high), cube.value[e.high], iso);
    }
    return slot;
}

/// The ends in a fixed order: bit for bit the same from every tetrahedron.
PartVertices::OnEdge PartVertices::on_edge(const Int3& a, double a_value, const Int3& b,
                                           double b_value, double iso) const {
    return crossing(FinestCrossing::between(finest(a), a_value, finest(b), b_value), iso);
}

PartVertices::OnEdge PartVertices::crossing(const FinestCrossing::Edge& edge, double iso) {
    OnEdge at{edge.from, edge.to, edge.crossing(iso), {}};
    const Double3 from = as_point(at.from);
    const Double3 to = as_point(at.to);
    for (std::size_t axis = 0; axis < 3; ++axis) {
        at.position[axis] = from[axis] + at.t * (to[axis] - from[axis]);
    }
    return at;
}

std::uint32_t PartVertices::add_edge(const Int3& a, double a_value, const Int3& b, double b_value,
                                     double iso) {
    const FinestCrossing::Edge edge =
        FinestCrossing::between(finest(a), a_value, finest(b), b_value);
    const OnEdge at = crossing(finest_ != nullptr ? finest_->finest(edge) : edge, iso);
    if (attributes_ != nullptr) {
        values_.push_back(attributes_->edge(at.from, at.to, at.t));
    }
    return add(key_of(a + b), at.position);
}

std::uint32_t PartVertices::node(const Int3& node, std::optional<double> height) {
    std::uint32_t& slot = points_.at(node * 2);
    if (!is_vertex(slot)) {
        Double3 position = as_point(finest(node));
        position[2] = height.value_or(position[2]);
        slot = add(key_of(node * 2), position);
        if (attributes_ != nullptr) {
            values_.push_back(attributes_->node(finest(node)));
        }
    }
    return slot;
}

std::uint32_t PartVertices::add_node(const Int3& node) {
    const std::uint32_t vertex = add(kNoKey, as_point(finest(node)));
    if (attributes_ != nullptr) {
        values_.push_back(attributes_->node(finest(node)));
    }
    return vertex;
}

std::uint32_t PartVertices::add_middle(const Int3& a, const Int3& b) {
    const Double3 twice = as_point(finest(a + b));
    const std::uint32_t vertex = add(kNoKey, {twice[0] / 2, twice[1] / 2, twice[2] / 2});
    if (attributes_ != nullptr) {
        const bool in_order = precedes(a, b);
        values_.push_back(
            attributes_->edge(finest(in_order ? a : b), finest(in_order ? b : a), 0.5));
    }
    return vertex;
}

template <class Make>
std::uint32_t PartVertices::use(Use& use, const Make& make) {
    use = use == kNone ? make() : use | kComplete;
    return use & ~kComplete;
}

template <class Make>
std::uint32_t PartVertices::join(Use& a, Use& b, const Make& make) {
    const bool known = b != kNone;
    if (!known) {
        b = use(a, make);
        return b;
    }
    const std::uint32_t vertex = b & ~kComplete;
    b |= kComplete;
    if (const std::uint32_t other = use(a, [&] { return vertex; }); other != vertex) {
        unite(std::span(parents_), other, vertex);
    }
    return vertex;
}

std::size_t PartVertices::link_edge(const Int3& twice, const Int3& sum) {
    const Int3 at = sum - twice + Int3{2, 2, 2};
    const bool near = min(max(at, {0, 0, 0}), {4, 4, 4}) == at;
    return near ? kLinkEdge[static_cast<std::size_t>(kLinkBox.linear(at))] : kLinkEdges;
}

Int3 PartVertices::offset_of(std::size_t link_edge) {
    const auto* const at = std::find(kLinkEdge.begin(), kLinkEdge.end(), link_edge);
    return kLinkBox.unlinear(at - kLinkEdge.begin()) - Int3{2, 2, 2};
}

PartVertices::FanLink* PartVertices::fan_link(const Int3& twice) {
    std::uint32_t& slot = points_.at(twice);
    if (slot == kNone) {
        slot = kFanTag | static_cast<std::uint32_t>(fans_.size());
        FanLink& link = fans_.emplace_back();
        link.twice = twice;
        link.uses.fill(kNone);
    }
    return (slot & kTag) == kFanTag ? &fans_[slot & ~kTag] : nullptr;
}

PartVertices::Use& PartVertices::fan_use(const Int3& twice, const Int3& sum) {
    if (const std::size_t edge = link_edge(twice, sum); edge != kLinkEdges) {
        if (FanLink* const link = fan_link(twice)) {
            return link->uses[edge];
        }
    }
    const VertexKey key{key_of(twice), key_of(sum), VertexKind::fan};
    return rare_.try_emplace(key, kNone).first.value();
}

std::uint32_t PartVertices::fan(const Int3& node, const Int3& in, const Int3& out) {
    const Int3 twice = node * 2;
    const auto make = [&] { return add_node(node); };
    const std::size_t in_edge = link_edge(twice, in);
    const std::size_t out_edge = link_edge(twice, out);
    if (in_edge != kLinkEdges && out_edge != kLinkEdges) {
        if (FanLink* const link = fan_link(twice)) {
            return join(link->uses[in_edge], link->uses[out_edge], make);
        }
    }
    static_cast<void>(fan_use(twice, in));  // the second call may move the first
    Use& second = fan_use(twice, out);
    return join(fan_use(twice, in), second, make);
}

PartVertices::Use& PartVertices::run_use(const Int3& sum, const Int3& below) {
    const std::uint64_t second = key_of(below * 2);
    std::uint32_t& slot = points_.at(sum);
    if (slot == kNone) {
        slot = kRunTag | static_cast<std::uint32_t>(runs_.size());
        runs_.emplace_back().sum = sum;
    }
    if ((slot & kTag) == kRunTag) {
        RunLink& link = runs_[slot & ~kTag];
        const auto* const found =
            std::find(link.below.begin(), link.below.begin() + link.count, second);
        const auto i = static_cast<std::size_t>(found - link.below.begin());
        if (i < link.count) {
            return link.uses[i];
        }
        if (i < RunLink::kMax) {
            ++link.count;
            link.below[i] = second;
            link.uses[i] = kNone;
            return link.uses[i];
        }
    }
    return rare_.try_emplace({key_of(sum), second, VertexKind::run}, kNone).first.value();
}

std::uint32_t PartVertices::run(const Int3& a, const Int3& b, const Int3& below) {
    return use(run_use(a + b, below), [&] { return add_middle(a, b); });
}

void PartVertices::run_between(const Int3& a, const Int3& b, const Int3& below1,
                               const Int3& below2) {
    const Int3 sum = a + b;
    static_cast<void>(run_use(sum, below1));  // the second call may move the first
    Use& second = run_use(sum, below2);
    join(run_use(sum, below1), second, [&] { return add_middle(a, b); });
}

std::uint32_t PartVertices::centre(const std::array<std::uint32_t, 3>& v) {
    Double3 position{};
    for (std::size_t axis = 0; axis < 3; ++axis) {
        position[axis] =
            (positions_[v[0]][axis] + positions_[v[1]][axis] + positions_[v[2]][axis]) / 3;
    }
    const std::uint32_t vertex = add(kNoKey, position);
    if (attributes_ != nullptr) {
        values_.push_back(attributes_->with_unit_normal(
            attributes_->mean(values_[v[0]], values_[v[1]], values_[v[2]])));
    }
    return vertex;
}

std::uint32_t PartVertices::centre(std::span<const std::uint32_t> v) {
    Double3 position{};
    for (std::size_t axis = 0; axis < 3; ++axis) {
        for (const std::uint32_t at : v) {
            position[axis] += positions_[at][axis];
        }
        position[axis] /= static_cast<double>(v.size());
    }
    const std::uint32_t vertex = add(kNoKey, position);
    if (attributes_ != nullptr) {
        VertexAttributes mean = values_[v[0]];
        for (std::size_t i = 1; i < v.size(); ++i) {
            mean = attributes_->mix(mean, values_[v[i]], 1 / static_cast<double>(i + 1));
        }
        values_.push_back(attributes_->with_unit_normal(mean));
    }
    return vertex;
}

std::uint32_t PartVertices::edge_cut(const Int3& a, const Int3& b, std::uint32_t planes, double t,
                                     const Double3& position) {
    const VertexKey key{key_of(a + b), 0, VertexKind::edge, planes};
    const auto [it, is_new] = cuts_.try_emplace(key, static_cast<std::uint32_t>(size()));
    if (is_new) {
        if (attributes_ != nullptr) {
            values_.push_back(attributes_->edge(finest(a), finest(b), t));
        }
        add(kNoKey, position);
    }
    return it->second;
}

std::uint32_t PartVertices::face_cut(std::array<Int3, 3> face, std::uint32_t planes,
                                     const Between& between, const Double3& position) {
    std::sort(face.begin(), face.end(), precedes);
    const VertexKey key{key_of(face[0] + face[1]), key_of(face[2] * 2), VertexKind::face, planes};
    const auto [it, is_new] = cuts_.try_emplace(key, static_cast<std::uint32_t>(size()));
    return is_new ? inner_cut(between, position) : it->second;
}

std::uint32_t PartVertices::inner_cut(const Between& between, const Double3& position) {
    if (attributes_ != nullptr) {
        values_.push_back(attributes_->with_unit_normal(
            attributes_->mix(values_[between.from], values_[between.to], between.t)));
    }
    return add(kNoKey, position);
}

namespace {

/// A bijection on 64-bit numbers that removes patterns (the finaliser of MurmurHash3).
std::uint64_t scrambled(std::uint64_t h) {
    h = (h ^ (h >> 33U)) * 0xFF51AFD7ED558CCDULL;
    h = (h ^ (h >> 33U)) * 0xC4CEB9FE1A85EC53ULL;
    return h ^ (h >> 33U);
}

/// 0 for each complete vertex. If the triangles of a vertex close up around it, the neighbours
/// where they enter and leave are the same, and their (mixed) numbers cancel. An incomplete vertex
/// may continue in another part.
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
                    continue;  // a remainder of a flat triangle beside its line
                }
                number_.resize(std::max<std::size_t>(number_.size(),
                                                     std::max({piece[0], piece[1], piece[2]}) + 1),
                               MeshPart::kNoVertex);
                part_.triangles.push_back({number(piece[0]), number(piece[1]), number(piece[2])});
            }
        }
    }

    /// Names the elements that other parts may share.
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
    std::uint32_t first_new_;  ///< cut vertices are numbered from here
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
        std::fill(open.begin(), open.end(), 1);  // any end may continue in another part
    }
    Finisher finisher(vertices, box);
    finisher.add_triangles(triangles, lines);
    finisher.name(open);
    return finisher.take();
}

}  // namespace isonest::detail
