#include "query/simplify/by_value/value_tree.h"

#include <algorithm>
#include <cmath>
#include <limits>

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
    all_.reserve(kMost);
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
        if (all_.size() + 2 > kMost) {
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

}  // namespace isonest::detail
