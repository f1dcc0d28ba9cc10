#include "query/distance/node_errors.h"

#include <algorithm>
#include <bit>

#include "query/march/vertex_key.h"

namespace isonest::detail {

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
    // The child's number is final when its own children's have been handed up.
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
