#include "query/simplify/proof/value_cover.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "store/lattice/simplex.h"

namespace isonest::detail {
namespace {

Element<3> element_of(const ValueTetrahedron& t) {
    Element<3> element;
    for (std::size_t i = 0; i < t.node.size(); ++i) {
        element.v[i] = {t.node[i][0], t.node[i][1], t.node[i][2]};
    }
    element.value = t.value;
    // NOLINTBEGIN(bugprone-signed-char-misuse): small numbers, no characters
    element.kind = t.kind;
    element.level = t.level;
    // NOLINTEND(bugprone-signed-char-misuse)
    return element;
}

}  // namespace

ValueTree::ValueTree(GridNumbers& numbers, const Lattice& lattice, double iso)
    : numbers_(numbers), iso_(iso) {
    all_.reserve(kMax);
    for (Element<3>& element : coarsest_elements<3>(lattice)) {
        for (std::size_t i = 0; i < element.v.size(); ++i) {
            element.value[i] = numbers_.value(element.v[i], element.level) - iso_;
        }
        all_.push_back(described(element));
    }
}

ValueTetrahedron ValueTree::described(const Element<3>& element) {
    ValueTetrahedron t;
    t.value = element.value;
    t.kind = static_cast<std::int8_t>(element.kind);
    t.level = static_cast<std::int8_t>(element.level);
    for (std::size_t i = 0; i < t.node.size(); ++i) {
        t.node[i] = {static_cast<std::int32_t>(element.v[i].x),
                     static_cast<std::int32_t>(element.v[i].y),
                     static_cast<std::int32_t>(element.v[i].z)};
    }
    t.deviation = element.level > 0 ? numbers_.deviation(element.ref_node()) : 0;
    const auto [low, high] = element.range();
    t.most = element.is_complete() ? std::max(-low, high) + t.deviation
                                   : std::numeric_limits<double>::infinity();
    return t;
}

std::optional<std::uint32_t> ValueTree::children_of(std::uint32_t i) {
    if (all_[i].first_child == 0) {
        if (all_.size() + 2 > kMax) {
            return std::nullopt;
        }
        const Element<3> element = element_of(all_[i]);
        const double middle = numbers_.value(element.ref_node(), element.level - 1) - iso_;
        const auto first = static_cast<std::uint32_t>(all_.size());
        for (const Element<3>& half : element.bisect(middle)) {
            all_.push_back(described(half));
        }
        all_[i].first_child = first;
    }
    return all_[i].first_child;
}

void ValueTree::clear() {
    all_.resize(kRoots);
    for (ValueTetrahedron& root : all_) {
        root.first_child = 0;
    }
    numbers_.rest();
}

namespace {

using Corner = std::array<double, 4>;

/// The zero of f on the way from a to b, where f is fa > 0 and fb < 0, or vice versa.
Corner between(const Corner& a, const Corner& b, double fa, double fb) {
    const double t = fa / (fa - fb);
    Corner c;
    for (std::size_t i = 0; i < c.size(); ++i) {
        c[i] = a[i] + t * (b[i] - a[i]);
    }
    return c;
}

/// The part of a polygon where f >= 0. Returns false if it would have too many corners.
/// at_cut(corner) makes f exactly 0 where it is nearly 0.
template <class Polygon, class F, class AtCut>
bool cut(const Polygon& polygon, const F& f, const AtCut& at_cut, Polygon& part) {
    part.count = 0;
    const auto add = [&](const Corner& c) {
        if (part.count == Polygon::kMax) {
            return false;
        }
        part.corner[part.count++] = c;
        return true;
    };
    Corner last = polygon.corner[polygon.count - 1];
    double f_last = f(last);
    for (std::size_t i = 0; i < polygon.count; ++i) {
        const Corner& c = polygon.corner[i];
        const double f_here = f(c);
        if ((f_last < 0 && f_here > 0) || (f_last > 0 && f_here < 0)) {
            Corner middle = between(last, c, f_last, f_here);
            at_cut(middle);
            if (!add(middle)) {
                return false;
            }
        }
        if (f_here >= 0 && !add(c)) {
            return false;
        }
        last = c;
        f_last = f_here;
    }
    return true;
}

}  // namespace

ValueCover::ValueCover(ValueTree& tree, const WorldLattice& lattice, double limit)
    : tree_(tree), lattice_(lattice), limit_(limit), top_(tree.at(0).level) {
    scale_ = std::ldexp(1.0, -top_);
    for (int level = 0; level <= top_; ++level) {
        constexpr int kBits = 46;
        slack_.at(static_cast<std::size_t>(level)) =
            unevenness(lattice.steps) * std::ldexp(1.0, top_ - level - kBits);
    }
}

bool ValueCover::covers(const Triangle& t) {
    double largest = 0;
    const bool is_covered = lattice_.for_each_piece(t, [&](const Triangle& piece) {
        std::array<Double3, 3> unit{};
        for (std::size_t i = 0; i < 3; ++i) {
            for (std::size_t axis = 0; axis < 3; ++axis) {
                const auto last = static_cast<double>(lattice_.nodes[static_cast<int>(axis)] - 1);
                unit[i][axis] = scale_ * std::clamp(piece[i][axis], 0.0, last);
            }
        }
        Answer answer = ask(unit);
        if (answer == Answer::no_room) {
            // With an empty tree, a triangle always needs the same room.
            tree_.clear();
            answer = ask(unit);
        }
        largest = std::max(largest, largest_);
        return answer == Answer::yes;
    });
    largest_ = largest;
    return is_covered;
}

ValueCover::Answer ValueCover::ask(const std::array<Double3, 3>& unit) {
    largest_ = 0;
    const double slack = slack_of(top_);
    for (std::uint32_t root = 0; root < ValueTree::kRoots; ++root) {
        Polygon polygon;
        polygon.count = 3;
        for (std::size_t i = 0; i < 3; ++i) {
            std::array<double, 3> y{};
            for (std::size_t k = 0; k < 3; ++k) {
                y[k] = unit[i][static_cast<std::size_t>(kAxisOrders[root][k])];
            }
            polygon.corner[i] = {1 - y[0], y[0] - y[1], y[1] - y[2], y[2]};
        }
        bool is_there = true;
        for (const std::size_t side : {std::size_t{1}, std::size_t{2}}) {
            const auto f = [side](const Corner& c) { return c[side]; };
            const auto begin = polygon.corner.begin();
            const auto end = begin + static_cast<std::ptrdiff_t>(polygon.count);
            const auto [low, high] = std::minmax_element(
                begin, end, [&](const Corner& a, const Corner& b) { return f(a) < f(b); });
            // What may be here only because of rounding belongs to the neighbour.
            if (f(*high) < 0 || (f(*high) <= slack && f(*low) < -slack)) {
                is_there = false;
                break;
            }
            if (f(*low) < 0) {
                Polygon part;
                if (!cut(
                        polygon, f, [side](Corner& c) { c[side] = 0; }, part)) {
                    return Answer::no;
                }
                polygon = part;
                if (polygon.count == 0) {
                    is_there = false;
                    break;
                }
            }
        }
        if (is_there) {
            const Answer answer = inside(root, polygon);
            if (answer != Answer::yes) {
                return answer;
            }
        }
    }
    return Answer::yes;
}

ValueCover::Answer ValueCover::inside(std::uint32_t tetrahedron, const Polygon& polygon) {
    const ValueTetrahedron& t = tree_.at(tetrahedron);
    if (t.most <= limit_) {
        largest_ = std::max(largest_, t.most);
        return Answer::yes;
    }
    double most = 0;
    bool is_number = std::isfinite(t.most);
    if (is_number) {
        for (std::size_t i = 0; i < polygon.count; ++i) {
            const Corner& c = polygon.corner[i];
            most = std::max(most, std::fabs(c[0] * t.value[0] + c[1] * t.value[1] +
                                            c[2] * t.value[2] + c[3] * t.value[3]));
        }
        // A corner moved outside by rounding has a negative coordinate, for each of two sides.
        const double slack = 4 * slack_of(t.level) * t.most;
        const double bound = most + t.deviation + slack;
        if (bound <= limit_) {
            largest_ = std::max(largest_, bound);
            return Answer::yes;
        }
        if (most - t.deviation - slack > limit_) {
            return Answer::no;
        }
    }
    return t.level == 0 ? Answer::no : inside_children(tetrahedron, polygon);
}

ValueCover::Answer ValueCover::inside_children(std::uint32_t tetrahedron, const Polygon& polygon) {
    const std::size_t end = 3 - static_cast<std::size_t>(tree_.at(tetrahedron).kind);
    const double slack = slack_of(tree_.at(tetrahedron).level);
    const auto first = tree_.children_of(tetrahedron);
    if (!first) {
        return Answer::no_room;
    }
    const auto f = [end](const Corner& c) { return c[0] - c[end]; };
    double low = f(polygon.corner[0]);
    double high = low;
    for (std::size_t i = 1; i < polygon.count; ++i) {
        low = std::min(low, f(polygon.corner[i]));
        high = std::max(high, f(polygon.corner[i]));
    }
    // What may be beyond the cut only because of rounding stays on this side.
    const bool all_first = low >= -slack;
    const bool all_second = !all_first && high <= slack;
    const auto at_cut = [end](Corner& c) { c[0] = c[end] = (c[0] + c[end]) / 2; };
    Polygon part;
    if (!all_second) {
        if (all_first) {
            part = polygon;
        } else if (!cut(polygon, f, at_cut, part)) {
            return Answer::no;
        }
        for (std::size_t i = 0; i < part.count; ++i) {
            Corner& c = part.corner[i];
            c[0] -= c[end];
            c[end] *= 2;
        }
        const Answer answer = inside(*first, part);
        if (answer != Answer::yes) {
            return answer;
        }
    }
    if (!all_first) {
        if (all_second) {
            part = polygon;
        } else if (!cut(
                       polygon, [&](const Corner& c) { return -f(c); }, at_cut, part)) {
            return Answer::no;
        }
        for (std::size_t i = 0; i < part.count; ++i) {
            const Corner c = part.corner[i];
            Corner& half = part.corner[i];
            for (std::size_t k = 0; k + 1 < end; ++k) {
                half[k] = c[k + 1];
            }
            half[end - 1] = c[end] - c[0];
            half[end] = 2 * c[0];
        }
        return inside(*first + 1, part);
    }
    return Answer::yes;
}

}  // namespace isonest::detail
