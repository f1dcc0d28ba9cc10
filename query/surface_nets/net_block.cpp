#include "query/surface_nets/net_block.h"

#include <algorithm>
#include <cmath>

#include "query/mesh/zero_area.h"
#include "query/surface_nets/quad_diagonal.h"
#include "store/base/vector3.h"

namespace isonest::detail {
namespace {

constexpr int kCycle = 4;
constexpr float kForth = 0.6F;
constexpr float kBack = -static_cast<float>(kCycle - 1) * kForth;

/// Layers that are needed at a time: what is emitted, the one before it, and those of which each is
/// one pass behind the next. Of planes, one more is looked at.
std::size_t ring_of(const NetSetting& setting) {
    return static_cast<std::size_t>(setting.passes) + 2;
}

std::size_t place_in_ring(std::int64_t z, std::size_t ring) {
    // The plane before the first cell is -1.
    return static_cast<std::size_t>(z + 1) % ring;
}

Int3 piece_of(const Int3& cell) {
    return {cell.x / kPieceCells.x, cell.y / kPieceCells.y, cell.z / kPieceCells.z};
}

Int3 first_cell(const Int3& piece) {
    return {piece.x * kPieceCells.x, piece.y * kPieceCells.y, piece.z * kPieceCells.z};
}

double area_of(const std::array<float, 3>& a, const std::array<float, 3>& b,
               const std::array<float, 3>& c) {
    Double3 u{};
    Double3 v{};
    for (std::size_t axis = 0; axis < 3; ++axis) {
        u[axis] = static_cast<double>(b[axis]) - static_cast<double>(a[axis]);
        v[axis] = static_cast<double>(c[axis]) - static_cast<double>(a[axis]);
    }
    return length(cross(u, v)) / 2;
}

}  // namespace

float weight_of_pass(int pass, int passes) {
    return pass % kCycle == kCycle - 1 && pass + 2 < passes ? kBack : kForth;
}

std::uint64_t NetBlock::heap(const NetSetting& setting, const ArrayInfo& array, std::int64_t edge) {
    const std::int64_t around = edge + 2 * setting.halo();
    const Int3 cells = min({around, around, 1}, setting.cells());
    const auto area = static_cast<std::uint64_t>((cells.x + 1) * (cells.y + 1));
    const Int3 pieces = ceil_div(min({edge, edge, 1}, setting.cells()), kPieceCells);
    const auto columns = static_cast<std::uint64_t>(pieces.x * pieces.y);
    // Lists of cells grow to twice of what is in them; a piece is copied on its way to the file.
    return ring_of(setting) * area * (NetLayer::kBytesPerCell + 5) +
           (ring_of(setting) + 1) * area * sizeof(std::int64_t) + 2 * area +
           (columns + 1) * (NetPiece::kMostBytes + (setting.sides ? NetPiece::kMostSideBytes : 0)) +
           LabelPlanes::held_bytes(array, std::max(cells.x, cells.y) + 1);
}

NetLayer* NetBlock::layer(std::int64_t z) {
    return z < first_.z || z >= end_.z ? nullptr : &layers_[place_in_ring(z, layers_.size())];
}

std::span<std::int64_t> NetBlock::plane(std::int64_t z) {
    return labels_[place_in_ring(z, labels_.size())];
}

NetPiece& NetBlock::piece_at(std::int64_t x, std::int64_t y) {
    const std::int64_t columns = ceil_div(hi_.x - lo_.x, kPieceCells.x);
    return pieces_[static_cast<std::size_t>((y - lo_.y) / kPieceCells.y * columns +
                                            (x - lo_.x) / kPieceCells.x)];
}

void NetBlock::begin(const Int3& lo, const Int3& hi) {
    lo_ = lo;
    hi_ = hi;
    const std::int64_t halo = setting_.halo();
    const Int3 around{halo, halo, halo};
    first_ = max(lo - around, {0, 0, 0});
    end_ = min(hi + around, setting_.cells());
    plane_nodes_ = end_ - first_ + Int3{1, 1, 0};
    plane_nodes_.z = 1;
    planes_.begin();
    const std::size_t ring = ring_of(setting_);
    layers_.resize(ring);
    labels_.resize(ring + 1);
    for (auto& labels : labels_) {
        labels.resize(static_cast<std::size_t>(plane_nodes_.product()));
    }
    const Int3 pieces = ceil_div(hi - lo, kPieceCells);
    pieces_.resize(static_cast<std::size_t>(pieces.x * pieces.y));
}

void NetBlock::read_layer(std::int64_t z) {
    const Int3 nodes = first_ - Int3{1, 1, 1};  // the low corner of the first cell
    if (z == first_.z) {
        planes_.read({nodes.x, nodes.y, z - 1}, plane_nodes_, plane(z - 1));
        planes_.read({nodes.x, nodes.y, z}, plane_nodes_, plane(z));
        slim_[1].assign(static_cast<std::size_t>(plane_nodes_.product()), 0);
    }
    planes_.read({nodes.x, nodes.y, z + 1}, plane_nodes_, plane(z + 1));
    std::swap(slim_[0], slim_[1]);
    find_slim(plane(z - 1), plane(z), plane(z + 1), plane_nodes_, slim_[1]);
    const Int3 cells = setting_.cells();
    const unsigned held = (first_.x == 0 ? 1U : 0U) | (end_.x == cells.x ? 2U : 0U) |
                          (first_.y == 0 ? 4U : 0U) | (end_.y == cells.y ? 8U : 0U) |
                          (z == 0 || z + 1 == cells.z ? 48U : 0U);
    layer(z)->begin({plane(z - 1), slim_[0]}, {plane(z), slim_[1]}, plane_nodes_, held);
}

/// Each pass is made in the layer behind the one of the pass before, which is then just ahead.
void NetBlock::move_layers(std::int64_t newest) {
    for (int pass = 0; pass < setting_.passes; ++pass) {
        const std::int64_t z = newest - pass - 1;
        if (NetLayer* const moved = layer(z); moved != nullptr) {
            moved->move(layer(z - 1), layer(z + 1), weight_of_pass(pass, setting_.passes));
        }
    }
}

void NetBlock::make(const Int3& lo, const Int3& hi,
                    const std::function<void(const NetPiece&)>& done) {
    begin(lo, hi);
    for (std::int64_t newest = first_.z; newest < hi.z + setting_.passes; ++newest) {
        if (newest < end_.z) {
            read_layer(newest);
        }
        move_layers(newest);
        const std::int64_t z = newest - setting_.passes;
        if (z < lo.z) {
            continue;
        }
        if (z % kPieceCells.z == 0) {
            const Int3 all = ceil_div(setting_.cells(), kPieceCells);
            const Int3 first = piece_of({lo.x, lo.y, z});
            const std::int64_t columns = ceil_div(hi.x - lo.x, kPieceCells.x);
            for (std::size_t i = 0; i < pieces_.size(); ++i) {
                const auto n = static_cast<std::int64_t>(i);
                pieces_[i].begin(all.linear(first + Int3{n % columns, n / columns, 0}));
            }
        }
        emit_layer(z);
        if ((z + 1) % kPieceCells.z == 0 || z + 1 == hi.z) {
            for (const NetPiece& piece : pieces_) {
                done(piece);
            }
        }
    }
}

void NetBlock::emit_layer(std::int64_t z) {
    for (std::int64_t y = lo_.y; y < hi_.y; ++y) {
        emit_row(z, y);
    }
}

void NetBlock::emit_row(std::int64_t z, std::int64_t y) {
    NetLayer* const here = layer(z);
    NetLayer* const below = layer(z - 1);
    const std::int64_t row = y - first_.y;
    NetRowCursor front(here, row - 1);
    NetRowCursor under(below, row);
    NetRowCursor under_front(below, row - 1);
    const std::uint32_t begin = here->row(row);
    const std::uint32_t end = here->row(row + 1);
    const std::int64_t* const a = plane(z - 1).data() + row * plane_nodes_.x;
    const std::int64_t* const b = a + plane_nodes_.x;
    const std::int64_t* const c = plane(z).data() + row * plane_nodes_.x;
    const std::int64_t* const d = c + plane_nodes_.x;
    for (std::uint32_t i = begin; i < end; ++i) {
        const std::int64_t local = here->x(i);
        const std::int64_t x = local + first_.x;
        if (x < lo_.x || x >= hi_.x) {
            continue;
        }
        const CellLabels label{a[local], a[local + 1], b[local], b[local + 1],
                               c[local], c[local + 1], d[local], d[local + 1]};
        NetPiece& piece = piece_at(x, y);
        // The cells around this one's lowest corner, number x + 2 y + 4 z; this one is the last,
        // and the first touches none of its edges from there.
        std::array<Corner, 8> corner{};
        for (std::size_t n = 0; n < corner.size(); ++n) {
            const auto at = static_cast<std::int64_t>(n);
            corner.at(n).cell = {x - 1 + (at & 1), y - 1 + (at >> 1 & 1), z - 1 + (at >> 2)};
            corner.at(n).layer = n < 4 ? below : here;
        }
        corner[1].vertex = under_front.find(local);
        corner[2].vertex = under.find(local - 1);
        corner[3].vertex = under.find(local);
        corner[4].vertex = front.find(local - 1);
        corner[5].vertex = front.find(local);
        corner[6].vertex = i - 1;  // of the cell there, if labels cross it
        corner[7].vertex = i;
        emit_vertex(corner[7], label, piece);
        emit_quads(corner, label, piece);
    }
}

bool NetBlock::is_wanted(std::int64_t label) {
    Wanted& known = known_[static_cast<std::uint64_t>(label) % known_.size()];
    if (known.label != label) {
        known = {label, std::binary_search(setting_.wanted.begin(), setting_.wanted.end(), label)};
    }
    return known.is;
}

/// Whether the vertex of a cell is one of the mesh of a corner's label.
bool NetBlock::is_of(const CellLabels& label, std::size_t corner, bool at_border) const {
    if (setting_.closed || !at_border) {
        return true;  // the cell has another label, and edges lead from one to the other
    }
    for (std::size_t one = 0; one < label.size(); ++one) {
        for (std::size_t axis = 0; axis < 3; ++axis) {
            const std::int64_t other = label[one ^ (std::size_t{1} << axis)];
            if (label[one] == label[corner] && other != label[one] && other != kOutsideLabel) {
                return true;
            }
        }
    }
    return false;
}

std::array<float, 3> NetBlock::place_of(const Corner& corner) const {
    const std::array<float, 3>& moved = corner.layer->moved(corner.vertex);
    std::array<float, 3> place{};
    for (std::size_t axis = 0; axis < 3; ++axis) {
        const double at = static_cast<double>(corner.cell[static_cast<int>(axis)]) - 0.5 +
                          static_cast<double>(moved[axis]);
        // Of two zeros the positive one, as in all meshes.
        place[axis] =
            static_cast<float>(setting_.origin[axis] + setting_.spacing[axis] * at) + 0.0F;
    }
    return place;
}

void NetBlock::emit_vertex(const Corner& corner, const CellLabels& label, NetPiece& piece) {
    std::array<std::int64_t, 8> found{};
    std::size_t count = 0;
    const Int3 inside = min(corner.cell, setting_.nodes - corner.cell);
    const bool at_border = std::min({inside.x, inside.y, inside.z}) == 0;
    for (std::size_t i = 0; i < label.size(); ++i) {
        const bool is_known =
            std::find(found.begin(), found.begin() + count, label[i]) != found.begin() + count;
        if (!is_known && is_wanted(label[i]) && is_of(label, i, at_border)) {
            found.at(count++) = label[i];
        }
    }
    if (count == 0) {
        return;
    }
    double squares = 0;
    for (std::size_t axis = 0; axis < 3; ++axis) {
        const double moved =
            setting_.spacing[axis] * static_cast<double>(corner.layer->moved(corner.vertex)[axis]);
        squares += moved * moved;
    }
    const std::uint32_t number = piece.add_vertex(
        code_of(corner.cell - first_cell(piece_of(corner.cell))), place_of(corner));
    layer(corner.cell.z)->numbers()[corner.vertex] = number;
    for (std::size_t i = 0; i < count; ++i) {
        piece.add_to_label(found.at(i), number, static_cast<float>(std::sqrt(squares)));
    }
}

void NetBlock::emit_quads(const std::array<Corner, 8>& corner, const CellLabels& label,
                          NetPiece& piece) {
    for (std::size_t axis = 0; axis < 3; ++axis) {
        const std::int64_t one = label[0];
        const std::int64_t other = label[std::size_t{1} << axis];
        const bool is_cap = one == kOutsideLabel || other == kOutsideLabel;
        if (one == other || (is_cap && !setting_.closed)) {
            continue;
        }
        const bool has_one = is_wanted(one);
        const bool has_other = is_wanted(other);
        if (!has_one && !has_other) {
            continue;
        }
        const std::size_t along = std::size_t{1} << axis;
        const std::size_t u = std::size_t{1} << ((axis + 1) % 3);
        const std::size_t v = std::size_t{1} << ((axis + 2) % 3);
        const std::array<std::size_t, 4> around{along, along | u, along | u | v, along | v};
        NetQuad quad;
        std::array<std::array<float, 3>, 4> place{};
        const Int3 own = piece_of(corner[7].cell);
        for (std::size_t i = 0; i < around.size(); ++i) {
            const Corner& c = corner.at(around.at(i));
            place.at(i) = place_of(c);
            const Int3 before = own - piece_of(c.cell);
            const auto bits = static_cast<unsigned>(before.x + 2 * before.y + 4 * before.z);
            quad.corner.at(i) = bits == 0 ? c.layer->number(c.vertex)
                                          : kForeign | bits << kBeforeBit |
                                                code_of(c.cell - first_cell(own - before));
        }
        quad.diagonal = flatter_diagonal(place);
        std::uint32_t no_area = 0;
        double area = 0;
        for (const auto& t : triangles_of(quad)) {
            area += area_of(place.at(t[0]), place.at(t[1]), place.at(t[2]));
            no_area += has_no_area(place.at(t[0]), place.at(t[1]), place.at(t[2])) ? 1 : 0;
        }
        const std::uint32_t number = piece.add_quad(quad, no_area);
        if (setting_.sides) {
            piece.add_sides({one, other});
        }
        const auto share = [&](std::int64_t of, std::int64_t beside) {
            if (has_mesh(beside) || setting_.sides) {
                piece.add_shared({of, has_mesh(beside) ? beside : kOutsideLabel, area});
            }
        };
        if (has_one) {
            piece.add_quad_to_label(one, number, false, no_area);
            share(one, other);
        }
        if (has_other) {
            piece.add_quad_to_label(other, number, true, no_area);
            share(other, one);
        }
    }
}

}  // namespace isonest::detail
