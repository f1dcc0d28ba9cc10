#include "query/surface_nets/net_block.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <optional>

#include <isonest/value_type.h>

#include "query/mesh/vertex_stars.h"
#include "query/statistics/find_labels.h"
#include "query/surface_nets/net_mesh.h"
#include "store/base/vectors.h"

namespace isonest::detail {
namespace {

template <class T>
std::int64_t label_or_missing(T value, bool bits, const std::string& name) {
    const std::optional<std::int64_t> label = label_of(value, bits);
    if (!label) {
        require_missing(static_cast<double>(value), name);
    }
    return label.value_or(kMissingLabel);
}

}  // namespace

std::uint64_t LabelPlanes::held_bytes(const ArrayInfo& array, std::int64_t edge) {
    const Int3 chunks = min(ceil_div(Int3{edge, edge, 1}, array.chunk) + Int3{1, 1, 0}, array.grid);
    return static_cast<std::uint64_t>(chunks.x * chunks.y) * array.chunk_bytes();
}

void LabelPlanes::hold(const Int3& first, const Int3& last) {
    if (!held_.empty() && held_.front().chunk.z == first.z) {
        return;
    }
    held_.clear();
    for (std::int64_t y = first.y; y <= last.y; ++y) {
        for (std::int64_t x = first.x; x <= last.x; ++x) {
            const Int3 chunk{x, y, first.z};
            const ChunkRow row = cache_.source().row(array_, chunk);
            if (row.min == row.max && row.flags == 0) {
                held_.push_back({chunk, nullptr, label_or_missing(row.min, bits_, name_)});
            } else {
                held_.push_back({chunk, cache_.get(array_, chunk), 0});
            }
        }
    }
}

void LabelPlanes::copy(const Held& held, const Int3& low, const Int3& size,
                       std::span<std::int64_t> to) const {
    const Int3 base = array_.first_node(held.chunk);
    const Int3 begin = max(base, low);
    const Int3 end = min(min(base + array_.chunk, array_.nodes), low + size);
    for (std::int64_t y = begin.y; y < end.y; ++y) {
        std::int64_t* const row = to.data() + (y - low.y) * size.x + (begin.x - low.x);
        const std::int64_t count = end.x - begin.x;
        if (held.data == nullptr) {
            std::fill_n(row, count, held.all);
            continue;
        }
        dispatch(cache_.source().layout().header().type, [&](auto tag) {
            using T = typename decltype(tag)::type;
            const T* const from = reinterpret_cast<const T*>(held.data.get()) +
                                  array_.chunk.linear(Int3{begin.x, y, low.z} - base);
            std::transform(from, from + count, row,
                           [&](T value) { return label_or_missing(value, bits_, name_); });
        });
    }
}

void LabelPlanes::read(const Int3& low, const Int3& size, std::span<std::int64_t> to) {
    const Int3 begin = max(low, {0, 0, 0});
    const Int3 end = min(low + size, array_.nodes);
    if (begin != low || end != low + size) {
        std::fill(to.begin(), to.end(), kOutsideLabel);
    }
    if (low.z < 0 || low.z >= array_.nodes.z || begin.x >= end.x || begin.y >= end.y) {
        return;
    }
    hold(array_.chunk_of(begin), array_.chunk_of({end.x - 1, end.y - 1, low.z}));
    for (const Held& held : held_) {
        copy(held, low, size, to);
    }
}

namespace {

/// For a cell whose lowest corner is node `at`: bit 2 axis + side if a node on that side is slim
/// along the axis.
std::uint8_t slim_sides(std::span<const std::uint8_t> below, std::span<const std::uint8_t> above,
                        std::size_t at, std::size_t row) {
    // Corners by number x + 2 y + 4 z.
    const std::array<unsigned, 8> slim{below[at],           below[at + 1],      below[at + row],
                                       below[at + row + 1], above[at],          above[at + 1],
                                       above[at + row],     above[at + row + 1]};
    unsigned sides = 0;
    for (std::size_t corner = 0; corner < slim.size(); ++corner) {
        for (unsigned axis = 0; axis < 3; ++axis) {
            const auto side = static_cast<unsigned>(corner >> axis & 1U);
            sides |= (slim.at(corner) >> axis & 1U) << (2 * axis + side);
        }
    }
    return static_cast<std::uint8_t>(sides);
}

}  // namespace

void find_slim(std::span<const std::int64_t> before, std::span<const std::int64_t> plane,
               std::span<const std::int64_t> after, const Int3& nodes,
               std::vector<std::uint8_t>& slim) {
    slim.assign(plane.size(), 0);
    for (std::int64_t y = 1; y + 1 < nodes.y; ++y) {
        for (std::int64_t x = 1; x + 1 < nodes.x; ++x) {
            const auto i = static_cast<std::size_t>(y * nodes.x + x);
            const auto row = static_cast<std::size_t>(nodes.x);
            const std::int64_t label = plane[i];
            const unsigned axes = (plane[i - 1] != label && plane[i + 1] != label ? 1U : 0U) |
                                  (plane[i - row] != label && plane[i + row] != label ? 2U : 0U) |
                                  (before[i] != label && after[i] != label ? 4U : 0U);
            if (std::popcount(axes) > 1) {
                slim[i] = static_cast<std::uint8_t>(axes);
            }
        }
    }
}

void NetLayer::begin(const NetPlane& below, const NetPlane& above, const Int3& nodes,
                     unsigned held) {
    rows_.assign(1, 0);
    x_.clear();
    neighbours_.clear();
    held_.clear();
    slim_.clear();
    const std::int64_t width = nodes.x - 1;
    const std::int64_t height = nodes.y - 1;
    for (std::int64_t y = 0; y < height; ++y) {
        const std::int64_t* const a = below.label.data() + y * nodes.x;
        const std::int64_t* const b = a + nodes.x;
        const std::int64_t* const c = above.label.data() + y * nodes.x;
        const std::int64_t* const d = c + nodes.x;
        const auto same_at = [&](std::int64_t x) {
            return a[x] == b[x] && a[x] == c[x] && a[x] == d[x];
        };
        const unsigned held_y =
            (y == 0 && (held & 4U) != 0) || (y + 1 == height && (held & 8U) != 0) ? 2U : 0U;
        const unsigned held_yz = held_y | ((held & 48U) != 0 ? 4U : 0U);
        bool same = same_at(0);
        for (std::int64_t x = 0; x < width; ++x) {
            const bool same_next = same_at(x + 1);
            const bool uniform = same && same_next && a[x] == a[x + 1];
            same = same_next;
            if (uniform) {
                continue;
            }
            x_.push_back(static_cast<std::uint16_t>(x));
            neighbours_.push_back(
                neighbours_of({a[x], a[x + 1], b[x], b[x + 1], c[x], c[x + 1], d[x], d[x + 1]}));
            const bool held_x =
                (x == 0 && (held & 1U) != 0) || (x + 1 == width && (held & 2U) != 0);
            held_.push_back(static_cast<std::uint8_t>(held_yz | (held_x ? 1U : 0U)));
            const auto at = static_cast<std::size_t>(y * nodes.x + x);
            slim_.push_back(
                slim_sides(below.slim, above.slim, at, static_cast<std::size_t>(nodes.x)));
        }
        rows_.push_back(static_cast<std::uint32_t>(x_.size()));
    }
    at_.assign(x_.size(), {});
    before_.assign(x_.size(), {});
    number_.assign(x_.size(), 0);
}

void NetLayer::move(const NetLayer* below, const NetLayer* above, float weight) {
    using Point = std::array<float, 3>;
    for (std::int64_t y = 0; y < row_count(); ++y) {
        NetRowCursor front(this, y - 1);
        NetRowCursor back(this, y + 1);
        NetRowCursor under(below, y);
        NetRowCursor over(above, y);
        const std::uint32_t end = row(y + 1);
        for (std::uint32_t i = row(y); i < end; ++i) {
            const std::int64_t x = x_[i];
            const unsigned neighbours = neighbours_[i];
            Point sum{};
            unsigned count = 0;
            const auto add = [&](const std::vector<Point>& places, std::uint32_t vertex,
                                 std::size_t axis, float step) {
                if (vertex != NetRowCursor::kNone) {
                    const Point& p = places[vertex];
                    sum[0] += p[0];
                    sum[1] += p[1];
                    sum[2] += p[2];
                    sum[axis] += step;
                    ++count;
                }
            };
            // Always in this order, so that every block rounds identically.
            if ((neighbours & 1U) != 0 && i > row(y) && x_[i - 1] + 1 == x) {
                add(at_, i - 1, 0, -1);
            }
            if ((neighbours & 2U) != 0 && i + 1 < end && x_[i + 1] == x + 1) {
                add(at_, i + 1, 0, 1);
            }
            if ((neighbours & 4U) != 0) {
                add(at_, front.find(x), 1, -1);
            }
            if ((neighbours & 8U) != 0) {
                add(at_, back.find(x), 1, 1);
            }
            if ((neighbours & 16U) != 0 && below != nullptr) {
                add(below->before_, under.find(x), 2, -1);
            }
            if ((neighbours & 32U) != 0 && above != nullptr) {
                add(above->at_, over.find(x), 2, 1);
            }
            Point p = at_[i];
            if (count > 0) {
                const float share = 1.0F / static_cast<float>(count);
                for (std::size_t axis = 0; axis < 3; ++axis) {
                    const float to = p[axis] + weight * (sum[axis] * share - p[axis]);
                    const unsigned slim = slim_[i] >> (2 * axis);
                    p[axis] = (held_[i] >> axis & 1U) != 0
                                  ? 0.0F
                                  : std::clamp(to, (slim & 1U) != 0 ? -kMaxMovedToSlim : -kMaxMoved,
                                               (slim & 2U) != 0 ? kMaxMovedToSlim : kMaxMoved);
                }
            }
            before_[i] = p;
        }
    }
    std::swap(at_, before_);
}

namespace {

constexpr int kCycle = 4;
constexpr float kForth = 0.6F;
constexpr float kBack = -static_cast<float>(kCycle - 1) * kForth;

/// Number of layers needed at a time: the emitted one, the previous one, and one for each pass. One
/// more plane is needed.
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
    // Lists of cells grow to twice their contents; a piece is copied when it is written to the
    // file.
    return ring_of(setting) * area * (NetLayer::kBytesPerCell + 5) +
           (ring_of(setting) + 1) * area * sizeof(std::int64_t) + 2 * area +
           (columns + 1) * (NetPiece::kMaxBytes + (setting.sides ? NetPiece::kMaxSideBytes : 0)) +
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

/// Each pass is applied to the layer behind the one of the previous pass.
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
        // The cells around this one's lowest corner, number x + 2 y + 4 z; this cell is the last,
        // and the first shares none of its edges from there.
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
        corner[6].vertex = i - 1;  // of the cell there, if it has one
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

/// Whether the vertex of a cell belongs to the mesh of a corner's label.
bool NetBlock::is_of(const CellLabels& label, std::size_t corner, bool at_border) const {
    if (setting_.closed || !at_border) {
        return true;  // the cell also has another label, and edges connect the two
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
    Double3 at{};
    for (std::size_t axis = 0; axis < 3; ++axis) {
        at[axis] = static_cast<double>(corner.cell[static_cast<int>(axis)]) - 0.5 +
                   static_cast<double>(moved[axis]);
    }
    at = setting_.steps.vector(at);
    std::array<float, 3> place{};
    for (std::size_t axis = 0; axis < 3; ++axis) {
        // Zeros are positive, as in all meshes.
        place[axis] = static_cast<float>(setting_.origin[axis] + at[axis]) + 0.0F;
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
    const auto& steps = corner.layer->moved(corner.vertex);
    const Double3 moved =
        setting_.steps.vector({static_cast<double>(steps[0]), static_cast<double>(steps[1]),
                               static_cast<double>(steps[2])});
    const double squares = moved[0] * moved[0] + moved[1] * moved[1] + moved[2] * moved[2];
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
