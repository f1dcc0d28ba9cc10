#include "query/surface_nets/net_store.h"

#include <algorithm>
#include <cstring>
#include <tuple>
#include <vector>

#include <isonest/mesh_sink.h>

#include "query/surface_nets/net_block.h"
#include "store/base/memory.h"

namespace isonest::detail {

void NetPiece::begin(std::int64_t number) {
    // Frees many small lists, so that the next piece does not hold them for other labels.
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

namespace {

/// The start of each list of a piece, in bytes from its start; the labels' parts follow.
struct PieceLists {
    std::uint64_t codes;
    std::uint64_t quads;
    std::uint64_t sides;
    std::uint64_t end;
    PieceLists(std::uint64_t vertices, std::uint64_t quad_count, bool has_sides)
        : codes(aligned(vertices * sizeof(std::array<float, 3>))),
          quads(codes + aligned(vertices * sizeof(std::uint16_t))),
          sides(quads + aligned(quad_count * sizeof(NetQuad))),
          end(sides + (has_sides ? quad_count * sizeof(NetSides) : 0)) {}
};

/// The same for a part.
std::uint64_t quads_of_part(std::uint64_t vertices) {
    return aligned(vertices * sizeof(std::uint16_t));
}

template <class List>
void put(std::span<std::byte> bytes, std::uint64_t at, const List& list) {
    if (!list.empty()) {
        std::memcpy(bytes.data() + at, list.data(), list.size() * sizeof(list[0]));
    }
}

/// One record for each pair of labels, with the sum of their shared areas.
std::vector<SharedRecord> summed(const NetPiece& piece) {
    std::vector<SharedArea> all(piece.shared().begin(), piece.shared().end());
    // Equal pairs stay in order, so that sums are always computed in the same order.
    std::stable_sort(all.begin(), all.end(), [](const SharedArea& a, const SharedArea& b) {
        return a.label != b.label ? a.label < b.label : a.other < b.other;
    });
    std::vector<SharedRecord> sums;
    for (const SharedArea& shared : all) {
        if (sums.empty() || sums.back().shared.label != shared.label ||
            sums.back().shared.other != shared.other) {
            sums.push_back({shared, piece.number()});
        } else {
            sums.back().shared.area += shared.area;
        }
    }
    return sums;
}

/// Without its position in the file.
NetPieceRecord record_of(const NetPiece& piece) {
    NetPieceRecord r;
    r.piece = piece.number();
    r.vertices = static_cast<std::uint32_t>(piece.positions().size());
    r.quads = static_cast<std::uint32_t>(piece.quads().size());
    r.no_area = piece.no_area();
    r.lo = MeshLayout::kEmptyLo;
    r.hi = MeshLayout::kEmptyHi;
    for (const LabelPart& part : piece.labels()) {
        r.moved = std::max(r.moved, part.moved);
        for (std::size_t axis = 0; axis < 3 && !part.vertices.empty(); ++axis) {
            r.lo[axis] = std::min(r.lo[axis], part.lo[axis]);
            r.hi[axis] = std::max(r.hi[axis], part.hi[axis]);
        }
    }
    for (const NetSides& sides : piece.sides()) {
        for (const std::int64_t label : sides) {
            if (has_mesh(label)) {
                r.least = std::min(r.least, label);
                r.most = std::max(r.most, label);
            }
        }
    }
    return r;
}

}  // namespace

void NetStore::append(const NetPiece& piece) {
    if (piece.empty()) {
        return;
    }
    const PieceLists lists(piece.positions().size(), piece.quads().size(), has_sides_);
    std::vector<LabelPartRecord> records;
    records.reserve(piece.labels().size());
    std::uint64_t end = lists.end;
    for (const LabelPart& part : piece.labels()) {
        LabelPartRecord r;
        r.label = part.label;
        r.piece = piece.number();
        r.part_at = end;
        r.piece_vertices = static_cast<std::uint32_t>(piece.positions().size());
        r.piece_quads = static_cast<std::uint32_t>(piece.quads().size());
        r.vertices = static_cast<std::uint32_t>(part.vertices.size());
        r.quads = static_cast<std::uint32_t>(part.quads.size());
        r.no_area = part.no_area;
        r.lo = part.lo;
        r.hi = part.hi;
        r.moved = part.moved;
        end += quads_of_part(r.vertices) + aligned(r.quads * sizeof(std::uint32_t));
        records.push_back(r);
    }
    std::vector<std::byte> bytes(end);
    put(bytes, 0, piece.positions());
    put(bytes, lists.codes, piece.codes());
    put(bytes, lists.quads, piece.quads());
    put(bytes, lists.sides, piece.sides());
    for (std::size_t i = 0; i < records.size(); ++i) {
        const LabelPart& part = piece.labels()[i];
        put(bytes, records[i].part_at, part.vertices);
        put(bytes, records[i].part_at + quads_of_part(records[i].vertices), part.quads);
    }
    NetPieceRecord whole = record_of(piece);
    std::uint64_t which = 0;
    std::uint64_t first_record = 0;
    const std::vector<SharedRecord> sums = summed(piece);
    std::uint64_t first_area = 0;
    {
        const std::lock_guard lock(mutex_);
        whole.at = end_;
        end_ += end;
        which = piece_count_++;
        first_record = records_;
        records_ += records.size();
        first_area = areas_;
        areas_ += sums.size();
    }
    for (LabelPartRecord& r : records) {
        r.piece_at = whole.at;
        r.part_at += whole.at;
    }
    file_.write_at(whole.at, bytes);
    piece_file_.write_at(which * sizeof(whole), std::as_bytes(std::span(&whole, 1)));
    record_file_.write_at(first_record * sizeof(LabelPartRecord),
                          std::as_bytes(std::span(records)));
    shared_file_.write_at(first_area * sizeof(SharedRecord), std::as_bytes(std::span(sums)));
}

void NetStore::seal() {
    data_ = file_.map(end_);
    piece_file_.map(piece_count_ * sizeof(NetPieceRecord));
    all_pieces_ = piece_file_.as<NetPieceRecord>().first(static_cast<std::size_t>(piece_count_));
    std::sort(all_pieces_.begin(), all_pieces_.end(),
              [](const NetPieceRecord& a, const NetPieceRecord& b) { return a.piece < b.piece; });
    for (std::size_t i = 1; i < all_pieces_.size(); ++i) {
        const NetPieceRecord& before = all_pieces_[i - 1];
        all_pieces_[i].first_vertex = before.first_vertex + before.vertices;
        all_pieces_[i].first_quad = before.first_quad + before.quads;
    }
    record_file_.map(records_ * sizeof(LabelPartRecord));
    all_ = record_file_.as<LabelPartRecord>().first(static_cast<std::size_t>(records_));
    std::sort(all_.begin(), all_.end(), [](const LabelPartRecord& a, const LabelPartRecord& b) {
        return a.label != b.label ? a.label < b.label : a.piece < b.piece;
    });
    shared_file_.map(areas_ * sizeof(SharedRecord));
    all_shared_ = shared_file_.as<SharedRecord>().first(static_cast<std::size_t>(areas_));
    std::sort(all_shared_.begin(), all_shared_.end(),
              [](const SharedRecord& a, const SharedRecord& b) {
                  const SharedArea& s = a.shared;
                  const SharedArea& t = b.shared;
                  return std::tie(s.label, s.other, a.piece) < std::tie(t.label, t.other, b.piece);
              });
    for (std::size_t i = 1; i < all_.size(); ++i) {
        all_[i].first_vertex = all_[i].label == all_[i - 1].label
                                   ? all_[i - 1].first_vertex + all_[i - 1].vertices
                                   : 0;
    }
}

std::vector<SharedArea> NetStore::shared(std::int64_t label) const {
    auto at = std::lower_bound(
        all_shared_.begin(), all_shared_.end(), label,
        [](const SharedRecord& r, std::int64_t id) { return r.shared.label < id; });
    std::vector<SharedArea> sums;
    for (; at != all_shared_.end() && at->shared.label == label; ++at) {
        if (!has_mesh(at->shared.other)) {
            continue;
        }
        if (sums.empty() || sums.back().other != at->shared.other) {
            sums.push_back(at->shared);
        } else {
            sums.back().area += at->shared.area;
        }
    }
    return sums;
}

std::span<const LabelPartRecord> NetStore::parts(std::int64_t label) const {
    const auto begin =
        std::lower_bound(all_.begin(), all_.end(), label,
                         [](const LabelPartRecord& r, std::int64_t id) { return r.label < id; });
    const auto end =
        std::upper_bound(begin, all_.end(), label,
                         [](std::int64_t id, const LabelPartRecord& r) { return id < r.label; });
    return {begin, end};
}

std::span<const std::array<float, 3>> NetStore::positions(const NetPieceRecord& r) const {
    return slice<std::array<float, 3>>(r.at, r.vertices);
}
std::span<const std::uint16_t> NetStore::codes(const NetPieceRecord& r) const {
    const PieceLists lists(r.vertices, r.quads, has_sides_);
    return slice<std::uint16_t>(r.at + lists.codes, r.vertices);
}
std::span<const NetQuad> NetStore::quads(const NetPieceRecord& r) const {
    const PieceLists lists(r.vertices, r.quads, has_sides_);
    return slice<NetQuad>(r.at + lists.quads, r.quads);
}
std::span<const NetSides> NetStore::sides(const NetPieceRecord& r) const {
    const PieceLists lists(r.vertices, r.quads, has_sides_);
    return slice<NetSides>(r.at + lists.sides, r.quads);
}
std::span<const std::array<float, 3>> NetStore::positions(const LabelPartRecord& r) const {
    return slice<std::array<float, 3>>(r.piece_at, r.piece_vertices);
}
std::span<const std::uint16_t> NetStore::codes(const LabelPartRecord& r) const {
    const PieceLists lists(r.piece_vertices, r.piece_quads, has_sides_);
    return slice<std::uint16_t>(r.piece_at + lists.codes, r.piece_vertices);
}
std::span<const NetQuad> NetStore::quads(const LabelPartRecord& r) const {
    const PieceLists lists(r.piece_vertices, r.piece_quads, has_sides_);
    return slice<NetQuad>(r.piece_at + lists.quads, r.piece_quads);
}
std::span<const std::uint16_t> NetStore::part_vertices(const LabelPartRecord& r) const {
    return slice<std::uint16_t>(r.part_at, r.vertices);
}
std::span<const std::uint32_t> NetStore::part_quads(const LabelPartRecord& r) const {
    return slice<std::uint32_t>(r.part_at + quads_of_part(r.vertices), r.quads);
}

}  // namespace isonest::detail
