#include "preprocess/indicators/deviation_table.h"

#include <array>
#include <bit>
#include <map>
#include <mutex>
#include <set>
#include <tuple>

#include "preprocess/indicators/diamond.h"
#include "store/lattice/bisection.h"
#include "store/lattice/lattice.h"

namespace isonest::detail {
namespace {

using Key = std::tuple<std::int64_t, std::int64_t, std::int64_t>;
Key key_of(const Int3& p) {
    return {p.z, p.y, p.x};
}

std::int64_t determinant(const Int3& a, const Int3& b, const Int3& c) {
    return a.x * (b.y * c.z - b.z * c.y) - a.y * (b.x * c.z - b.z * c.x) +
           a.z * (b.x * c.y - b.y * c.x);
}

/// Barycentric coordinates of p in t times the volume; all >= 0 if p lies in t.
std::array<std::int64_t, 4> barycentric(const Tetrahedron& t, const Int3& p) {
    const std::int64_t volume = determinant(t.v[1] - t.v[0], t.v[2] - t.v[0], t.v[3] - t.v[0]);
    const std::int64_t sign = volume < 0 ? -1 : 1;
    const std::int64_t b1 = sign * determinant(p - t.v[0], t.v[2] - t.v[0], t.v[3] - t.v[0]);
    const std::int64_t b2 = sign * determinant(t.v[1] - t.v[0], p - t.v[0], t.v[3] - t.v[0]);
    const std::int64_t b3 = sign * determinant(t.v[1] - t.v[0], t.v[2] - t.v[0], p - t.v[0]);
    return {sign * volume - b1 - b2 - b3, b1, b2, b3};
}

/// The Kuhn tetrahedra of cubes of edge 1 inside t.
std::vector<Tetrahedron> finest(const Tetrahedron& t) {
    std::vector<Tetrahedron> level{t};
    while (true) {
        std::vector<Tetrahedron> next;
        for (const Tetrahedron& parent : level) {
            const Int3 diagonal = parent.ref_end1() - parent.ref_end0();
            if (parent.kind == 0 && diagonal.x * diagonal.x == 1) {
                next.push_back(parent);
                continue;
            }
            for (const Tetrahedron& child : parent.bisect()) {
                next.push_back(child);
            }
        }
        if (next.size() == level.size()) {
            return level;
        }
        level = std::move(next);
    }
}

DeviationSupport make_support(int slot, const Int3& parity, unsigned flat) {
    // A cube index with these parities, away from the origin so that all coordinates are positive.
    const Int3 cube = parity + Int3{4, 4, 4};
    const Int3 base = cube * 4;
    const Int3 node = base + slot_offset(slot) * 2;

    std::map<Key, DeviationSupport::Point> points;
    std::map<Key, std::pair<Int3, std::set<Key>>> cubes;
    const auto full = static_cast<std::size_t>(4 - std::popcount(flat));
    for (const Tetrahedron& t : tetrahedra_around(cube, 4, node, flat)) {
        for (const Tetrahedron& small : finest(t)) {
            Int3 low = small.v[0];
            for (const Int3& v : small.v) {
                low = min(low, v);
            }
            const std::vector<Int3> traced = trace(small, node, flat);
            if (traced.size() != full) {
                continue;
            }
            auto& [corner, vertices] = cubes[key_of(low)];
            corner = low - base;
            for (const Int3& v : traced) {
                vertices.insert(key_of(v));
                if (points.contains(key_of(v))) {
                    continue;
                }
                DeviationSupport::Point point{v - base, {}};
                const auto weights = barycentric(t, v);
                std::int64_t total = 0;
                for (const std::int64_t w : weights) {
                    total += w;
                }
                for (std::size_t i = 0; i < 4; ++i) {
                    if (weights[i] != 0 && weights[i] != total) {
                        point.terms.push_back({t.v[i] - base, static_cast<double>(weights[i]) /
                                                                  static_cast<double>(total)});
                    }
                }
                points.emplace(key_of(v), std::move(point));
            }
        }
    }
    DeviationSupport support;
    std::map<Key, std::uint16_t> index;
    for (auto& [key, point] : points) {
        index[key] = static_cast<std::uint16_t>(support.points.size());
        support.points.push_back(std::move(point));
    }
    for (const auto& [key, cube_and_vertices] : cubes) {
        DeviationSupport::Cube c{cube_and_vertices.first, {}};
        for (const Key& v : cube_and_vertices.second) {
            c.points.push_back(index.at(v));
        }
        support.cubes.push_back(std::move(c));
    }
    return support;
}

}  // namespace

const DeviationSupport& deviation_support(int slot, int parity_x, int parity_y, int parity_z,
                                          unsigned flat) {
    constexpr std::size_t kKinds = 8;
    static std::array<std::vector<DeviationSupport>, kKinds> tables;
    static std::array<std::once_flag, kKinds> made;
    std::call_once(made.at(flat), [flat] {
        for (int s = 0; s < kSlots; ++s) {
            for (std::int64_t p = 0; p < 8; ++p) {
                const bool exists =
                    ((static_cast<unsigned>(s + 1) | static_cast<unsigned>(p)) & flat) == 0;
                tables[flat].push_back(exists ? make_support(s, {p & 1, (p >> 1) & 1, p >> 2}, flat)
                                              : DeviationSupport{});
            }
        }
    });
    return tables[flat]
                 [static_cast<std::size_t>(slot * 8 + parity_x + 2 * parity_y + 4 * parity_z)];
}

}  // namespace isonest::detail
