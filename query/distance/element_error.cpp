#include "query/distance/element_error.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <limits>

#include "query/march/cube_cases.h"
#include "query/march/mesh_part.h"
#include "store/lattice/simplex.h"

namespace isonest::detail {
namespace {

class Builder {
  public:
    Builder(const Element<3>& t, double iso, const LatticeSteps& steps, FinestCrossing& crossing)
        : t_(t), iso_(iso), steps_(steps), crossing_(crossing) {}

    /// Adds the vertex between a corner that is not below the isovalue and one that is.
    void add(std::size_t above, std::size_t below) {
        Double3 p{};
        Barycentric place{};
        if (t_.value[above] == iso_) {
            p = point(t_.v[above]);
            place[above] = 1;
        } else {
            const FinestCrossing::Edge edge = crossing_.finest(FinestCrossing::between(
                t_.v[above], t_.value[above], t_.v[below], t_.value[below]));
            const double s = edge.crossing(iso_);
            p = along(point(edge.from), s, minus(point(edge.to), point(edge.from)));
            const Double3 a = point(t_.v[above]);
            const Double3 b = point(t_.v[below]);
            std::size_t axis = 0;
            for (std::size_t i = 1; i < 3; ++i) {
                axis = std::fabs(b[i] - a[i]) > std::fabs(b[axis] - a[axis]) ? i : axis;
            }
            place[below] = (p[axis] - a[axis]) / (b[axis] - a[axis]);
            place[above] = 1 - place[below];
        }
        polygon_.at[polygon_.count] = steps_.vector(p);
        polygon_.place[polygon_.count++] = place;
    }
    [[nodiscard]] ElementPolygon polygon(bool is_crossed) {
        polygon_.is_crossed = is_crossed;
        return polygon_;
    }

  private:
    static Double3 point(const Int3& p) {
        return {static_cast<double>(p.x), static_cast<double>(p.y), static_cast<double>(p.z)};
    }
    const Element<3>& t_;
    double iso_;
    const LatticeSteps& steps_;
    FinestCrossing& crossing_;
    ElementPolygon polygon_;
};

}  // namespace

bool is_positive(const Element<3>& t) {
    return determinant(t.v[1] - t.v[0], t.v[2] - t.v[0], t.v[3] - t.v[0]) > 0;
}

ElementPolygon element_polygon(const Element<3>& t, double iso, const LatticeSteps& steps,
                               FinestCrossing& crossing) {
    unsigned mask = 0;
    for (unsigned i = 0; i < 4; ++i) {
        mask |= t.value[i] < iso ? 1U << i : 0U;
    }
    const Crossing& c = kCrossings[mask];
    const auto is_hit = [&](std::size_t i) { return t.value[c.order[i]] == iso; };
    Builder builder(t, iso, steps, crossing);
    if (c.below == 1) {
        for (std::size_t i = 1; i < 4; ++i) {
            builder.add(c.order[i], c.order[0]);
        }
    } else if (c.below == 2 && !(is_hit(0) && is_hit(1))) {
        const bool outward = is_positive(t) != c.flip;
        const std::size_t r1 = c.order[outward ? 2 : 3];
        const std::size_t r2 = c.order[outward ? 3 : 2];
        builder.add(c.order[0], r1);
        builder.add(c.order[0], r2);
        builder.add(c.order[1], r2);
        builder.add(c.order[1], r1);
    } else if (c.below == 3 && !is_hit(0)) {
        for (std::size_t i = 1; i < 4; ++i) {
            builder.add(c.order[0], c.order[i]);
        }
    }
    return builder.polygon(c.below != 0 && c.below != 4);
}

namespace {

constexpr double kInfinity = std::numeric_limits<double>::infinity();
/// Larger than the rounding error of a distance.
constexpr double kUp = 1 + 1e-12;

}  // namespace

ElementErrors::Mark ElementErrors::mark(const Element<3>& t) const {
    const std::size_t at = slot(std::max(height_of(t) - kBelow, 0));
    return {nodes_[at].size(), triangles_[at].size()};
}

std::int32_t ElementErrors::add_finest(const ElementPolygon& polygon) {
    Node node;
    node.has_triangles = polygon.count > 0;
    return polygon.is_crossed ? push(0, polygon, node) : kNoSurface;
}

std::int32_t ElementErrors::push(int height, const ElementPolygon& polygon, const Node& node) {
    std::vector<Node>& nodes = nodes_[slot(height)];
    std::vector<Candidate>& triangles = triangles_[slot(height)];
    nodes.push_back(node);
    nodes.back().first = static_cast<std::uint32_t>(triangles.size());
    nodes.back().count = static_cast<std::uint32_t>(polygon.triangles());
    for (std::size_t i = 0; i < polygon.triangles(); ++i) {
        triangles.push_back({polygon.triangle(i), node.error});
    }
    return static_cast<std::int32_t>(nodes.size()) - 1;
}

std::int32_t ElementErrors::add(const Element<3>& t, const ElementPolygon& polygon,
                                const std::array<std::int32_t, 2>& children, const Mark& mark,
                                bool bounded) {
    const int height = height_of(t);
    Node node;
    node.children = children;
    bool is_known = bounded;
    for (const std::int32_t child : children) {
        is_known = is_known && std::isfinite(error(height - 1, child));
        node.has_triangles =
            node.has_triangles ||
            (child != kNoSurface &&
             nodes_[slot(height - 1)][static_cast<std::size_t>(child)].has_triangles);
    }
    if (!polygon.is_crossed && children[0] == kNoSurface && children[1] == kNoSurface) {
        return kNoSurface;
    }
    is_known = is_known && node.has_triangles == (polygon.count > 0);
    base_ = std::max(height - kBelow, 0);
    first_ = mark.triangles;
    node.error = is_known ? measure(t, polygon, children) : Error{kInfinity, kInfinity};
    if (height >= kBelow) {
        nodes_[slot(base_)].resize(mark.nodes);
        triangles_[slot(base_)].resize(mark.triangles);
    }
    return push(height, polygon, node);
}

double ElementErrors::error(int height, std::int32_t element) const {
    if (element == kNoSurface) {
        return 0;
    }
    const Error& e = nodes_[slot(height)][static_cast<std::size_t>(element)].error;
    return std::max(e.to, e.from);
}

std::span<const ElementErrors::Candidate> ElementErrors::candidates() const {
    return std::span(triangles_[slot(base_)]).subspan(first_);
}

double ElementErrors::furthest(const Corners& corners, const Triangle& triangle) {
    double most = 0;
    for (std::size_t i = 0; i < corners.count; ++i) {
        most = std::max(most, square_distance(corners.at[i], triangle));
    }
    return std::sqrt(most) * kUp;
}

ElementErrors::Fold ElementErrors::fold_of(const Triangle& a, const Triangle& b) {
    const Double3 edge = minus(a[2], a[0]);
    const Double3 up =
        along(cross(minus(a[1], a[0]), edge), 1, cross(minus(b[1], b[0]), minus(b[2], b[0])));
    const Double3 normal = cross(edge, up);
    return {normal, dot(normal, a[0])};
}

/// The parts on both sides of the fold; points in the fold belong to both.
std::array<ElementErrors::Corners, 2> ElementErrors::cut(const Corners& corners, const Fold& fold) {
    std::array<Corners, 2> sides;
    for (std::size_t i = 0; i < corners.count; ++i) {
        const Double3& p = corners.at[i];
        const Double3& q = corners.at[(i + 1) % corners.count];
        const double f = dot(fold.normal, p) - fold.offset;
        const double g = dot(fold.normal, q) - fold.offset;
        if (f >= 0) {
            sides[0].add(p);
        }
        if (f <= 0) {
            sides[1].add(p);
        }
        if ((f < 0 && g > 0) || (f > 0 && g < 0)) {
            const Double3 middle = along(p, f / (f - g), minus(q, p));
            sides[0].add(middle);
            sides[1].add(middle);
        }
    }
    return sides;
}

ElementErrors::Error ElementErrors::measure(const Element<3>& t, const ElementPolygon& polygon,
                                            const std::array<std::int32_t, 2>& children) {
    const Error none{kInfinity, kInfinity};
    Error error;
    const std::size_t triangles = polygon.triangles();
    for (const Candidate& c : candidates()) {
        Corners corners;
        for (const Double3& p : c.triangle) {
            corners.add(p);
        }
        double most = furthest(corners, polygon.triangle(0));
        if (triangles == 2 && most + c.error.to > error.to) {
            most = 0;
            for (const Corners& side :
                 cut(corners, fold_of(polygon.triangle(0), polygon.triangle(1)))) {
                most = std::max(most, std::min(furthest(side, polygon.triangle(0)),
                                               furthest(side, polygon.triangle(1))));
            }
        }
        error.to = std::max(error.to, most + c.error.to);
        if (error.to > limit_) {
            return none;
        }
    }
    from_ = 0;
    for (std::size_t i = 0; i < triangles; ++i) {
        Piece piece;
        piece.place[0] = polygon.place[0];
        piece.place[1] = polygon.place[i + 1];
        piece.place[2] = polygon.place[i + 2];
        piece.count = 3;
        if (!follow(t, children, piece)) {
            return none;
        }
    }
    error.from = from_;
    return error;
}

/// Divides the piece as the element is bisected, and tests the children; returns false if the
/// distance is above the limit.
bool ElementErrors::follow(const Element<3>& t, const std::array<std::int32_t, 2>& children,
                           const Piece& piece) {
    const std::size_t end = t.ref_end();
    const std::array<Element<3>, 2> halves = t.bisect(0);
    for (std::size_t half = 0; half < 2; ++half) {
        // Closer to the end that the half contains.
        const std::size_t kept = half == 0 ? 0 : end;
        const std::size_t left = half == 0 ? end : 0;
        Piece inside;
        const auto add = [&](const Barycentric& p) {
            Barycentric& q = inside.place[inside.count++];
            q = p;
            q[kept] = p[kept] - p[left];
            if (half == 1) {
                for (std::size_t i = 0; i < end; ++i) {
                    q[i] = i + 1 == end ? p[end] - p[0] : p[i + 1];
                }
            }
            q[end] = 2 * p[left];
        };
        for (std::size_t i = 0; i < piece.count; ++i) {
            const Barycentric& p = piece.place[i];
            const Barycentric& q = piece.place[(i + 1) % piece.count];
            const double f = p[kept] - p[left];
            const double g = q[kept] - q[left];
            if (f >= 0) {
                add(p);
            }
            if ((f < 0 && g > 0) || (f > 0 && g < 0)) {
                const double s = f / (f - g);
                Barycentric middle{};
                for (std::size_t k = 0; k < 4; ++k) {
                    middle[k] = p[k] + s * (q[k] - p[k]);
                }
                middle[left] = middle[kept];
                add(middle);
            }
        }
        if (inside.count == 0) {
            continue;
        }
        const Element<3>& child = halves[half];
        const int height = height_of(child);
        const std::int32_t element = children[half];
        const bool good =
            element == kNoSurface || height == base_
                ? compare(child, element, inside)
                : follow(child, nodes_[slot(height)][static_cast<std::size_t>(element)].children,
                         inside);
        if (!good) {
            return false;
        }
    }
    return true;
}

bool ElementErrors::compare(const Element<3>& t, std::int32_t element, const Piece& piece) {
    Corners corners;
    for (std::size_t i = 0; i < piece.count; ++i) {
        Double3 p{};
        for (std::size_t k = 0; k < 4; ++k) {
            const double share = piece.place[i][k];
            const Int3& v = t.v[k];
            const Double3 part =
                steps_.vector({share * static_cast<double>(v.x), share * static_cast<double>(v.y),
                               share * static_cast<double>(v.z)});
            for (std::size_t axis = 0; axis < 3; ++axis) {
                p[axis] += part[axis];
            }
        }
        corners.add(p);
    }
    const auto look = [&](const Corners& side, std::span<const Candidate> own) {
        if (side.count == 0) {
            return;
        }
        double distance = from_nearest(side, own);
        if (distance > from_) {
            distance = std::min(distance, from_nearest(side, candidates()));
        }
        from_ = std::max(from_, distance);
    };
    std::span<const Candidate> own;
    if (element != kNoSurface) {
        const Node& node = nodes_[slot(base_)][static_cast<std::size_t>(element)];
        own = std::span<const Candidate>(triangles_[slot(base_)]).subspan(node.first, node.count);
    }
    if (own.size() == 2) {
        for (const Corners& side : cut(corners, fold_of(own[0].triangle, own[1].triangle))) {
            look(side, own);
        }
    } else {
        look(corners, own);
    }
    return from_ <= limit_;
}

double ElementErrors::from_nearest(const Corners& corners,
                                   std::span<const Candidate> candidates) const {
    double least = kInfinity;
    for (const Candidate& c : candidates) {
        least = std::min(least, furthest(corners, c.triangle) + c.error.from);
    }
    return least;
}

NodeErrors::NodeErrors(ScratchFolder folder)
    : folder_(std::move(folder)), errors_(folder_), table_(folder_) {
    for (int h = 0; h < kHeights; ++h) {
        links_.push_back(std::make_unique<GrowingFile<Pair>>(folder_));
    }
}

void NodeErrors::append(std::span<const NodeError> errors, std::span<const NodeLink> links) {
    for (const NodeError& e : errors) {
        errors_.append(e);
    }
    for (const NodeLink& link : links) {
        links_[static_cast<std::size_t>(link.height)]->append({link.parent, link.child});
    }
}

NodeError& NodeErrors::place(std::uint64_t node) const {
    const auto table = table_.as<NodeError>();
    for (std::uint64_t at = HalfLatticeHash{}(node)&mask_;; at = (at + 1) & mask_) {
        if (table[at].node == node || table[at].node == 0) {
            return table[at];
        }
    }
}

void NodeErrors::saturate() {
    errors_.seal();
    const std::uint64_t size = std::bit_ceil(2 * errors_.size() + 2);
    mask_ = size - 1;
    table_.map(size * sizeof(NodeError));
    for (const NodeError& e : errors_.all()) {
        NodeError& to = place(e.node);
        to.node = e.node;
        to.error = std::max(to.error, e.error);
    }
    // A child's number is final when its own children's numbers have been passed up.
    for (const auto& links : links_) {
        links->seal();
        for (const Pair& link : links->all()) {
            float& parent = place(link.parent).error;
            parent = std::max(parent, place(link.child).error);
        }
    }
}

double NodeErrors::at(std::uint64_t node) const {
    return static_cast<double>(place(node).error);
}

}  // namespace isonest::detail
