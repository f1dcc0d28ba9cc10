#include "query/surface_nets/net_piece.h"

#include <algorithm>

namespace isonest::detail {

void NetPiece::begin(std::int64_t number) {
    // Many small lists are given back, so that the next piece does not hold them for other labels.
    constexpr std::size_t kKept = 64;
    number_ = number;
    positions_.clear();
    codes_.clear();
    quads_.clear();
    sides_.clear();
    no_area_ = 0;
    shared_.clear();
    if (labels_.size() > kKept) {
        labels_ = {};
        place_ = {};
    }
    place_.clear();
    used_ = 0;
    last_ = 0;
}

std::uint32_t NetPiece::add_vertex(std::uint16_t code, const std::array<float, 3>& position) {
    positions_.push_back(position);
    codes_.push_back(code);
    return static_cast<std::uint32_t>(positions_.size() - 1);
}

LabelPart& NetPiece::part_of(std::int64_t label) {
    if (last_ < used_ && labels_[last_].label == label) {
        return labels_[last_];
    }
    const auto [found, is_new] = place_.try_emplace(label, used_);
    last_ = found->second;
    if (is_new) {
        if (used_ == labels_.size()) {
            labels_.emplace_back();
        }
        LabelPart& part = labels_[used_++];
        part.label = label;
        part.moved = 0;
        part.no_area = 0;
        part.vertices.clear();
        part.quads.clear();
    }
    return labels_[last_];
}

void NetPiece::add_to_label(std::int64_t label, std::uint32_t vertex, float moved) {
    LabelPart& part = part_of(label);
    const std::array<float, 3>& p = positions_[vertex];
    if (part.vertices.empty()) {
        part.lo = part.hi = p;
    }
    for (std::size_t axis = 0; axis < 3; ++axis) {
        part.lo[axis] = std::min(part.lo[axis], p[axis]);
        part.hi[axis] = std::max(part.hi[axis], p[axis]);
    }
    part.moved = std::max(part.moved, moved);
    part.vertices.push_back(static_cast<std::uint16_t>(vertex));
}

std::uint32_t NetPiece::add_quad(const NetQuad& quad, std::uint32_t no_area) {
    quads_.push_back(quad);
    no_area_ += no_area;
    return static_cast<std::uint32_t>(quads_.size() - 1);
}

void NetPiece::add_quad_to_label(std::int64_t label, std::uint32_t quad, bool reversed,
                                 std::uint32_t no_area) {
    LabelPart& part = part_of(label);
    part.quads.push_back(quad | (reversed ? LabelPart::kReversed : 0));
    part.no_area += no_area;
}

}  // namespace isonest::detail
