#include "query/neuroglancer/detail_nodes.h"

#include "query/neuroglancer/detail_grid.h"

namespace isonest::detail {

/// Both are sorted. Of two nodes in one place, that with a fragment stays.
DetailNodes::List DetailNodes::merged(std::span<const DetailNode> a,
                                      std::span<const DetailNode> b) const {
    auto all = std::make_unique<GrowingFile<DetailNode>>(folder_);
    std::size_t i = 0;
    std::size_t j = 0;
    while (i < a.size() || j < b.size()) {
        if (j == b.size()) {
            all->append(a[i++]);
        } else if (i == a.size()) {
            all->append(b[j++]);
        } else if (a[i].cell == b[j].cell) {
            all->append(a[i].bytes > 0 ? a[i] : b[j]);
            ++i;
            ++j;
        } else {
            all->append(z_order(a[i].cell) < z_order(b[j].cell) ? a[i++] : b[j++]);
        }
    }
    all->seal();
    return all;
}

/// Where the nodes have triangles.
DetailNodes::List DetailNodes::children_of(std::span<const DetailNode> nodes) const {
    auto children = std::make_unique<GrowingFile<DetailNode>>(folder_);
    for (const DetailNode& node : nodes) {
        for (unsigned eighth = 0; eighth < 8; ++eighth) {
            if ((node.eighths >> eighth & 1U) != 0) {
                const Int3 place{eighth & 1U, eighth >> 1U & 1U, eighth >> 2U & 1U};
                children->append({node.cell * 2 + place, 0, 0});
            }
        }
    }
    children->seal();
    return children;
}

DetailNodes::List DetailNodes::parents_of(std::span<const DetailNode> nodes) const {
    auto parents = std::make_unique<GrowingFile<DetailNode>>(folder_);
    Int3 last{-1, -1, -1};
    for (const DetailNode& node : nodes) {
        const Int3 parent{node.cell.x / 2, node.cell.y / 2, node.cell.z / 2};
        if (parent != last) {
            parents->append({parent, 0, 0});
            last = parent;
        }
    }
    parents->seal();
    return parents;
}

void DetailNodes::finish() {
    for (const List& level : levels_) {
        level->seal();
    }
    // All children come from fragments alone: those that are added have none themselves.
    std::vector<List> children;
    for (std::size_t i = 1; i < levels(); ++i) {
        children.push_back(children_of(of(i)));
    }
    for (std::size_t i = 0; i < children.size(); ++i) {
        levels_[i] = merged(of(i), children[i]->all());
    }
    for (std::size_t i = 1; i < levels(); ++i) {
        levels_[i] = merged(of(i), parents_of(of(i - 1))->all());
    }
    // A tree needs a node, also that of a mesh without triangles.
    if (!levels_.empty() && of(0).empty() && levels() == 1) {
        auto root = std::make_unique<GrowingFile<DetailNode>>(folder_);
        root->append({});
        root->seal();
        levels_[0] = std::move(root);
    }
}

}  // namespace isonest::detail
