#include "query/meshers/regions.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>

#include <isonest/error.h>

#include "store/base/box.h"

namespace isonest::detail {
namespace {

using RegionPoint = std::array<float, 3>;
constexpr std::uint64_t kAskEvery = std::uint64_t{1} << 13U;

struct EdgeOfTriangle {
    std::uint64_t low = 0;
    std::uint64_t high = 0;
    std::uint64_t triangle = 0;
    auto operator<=>(const EdgeOfTriangle&) const = default;
};

Double3 between(const RegionPoint& from, const RegionPoint& to) {
    Double3 d{};
    for (std::size_t axis = 0; axis < 3; ++axis) {
        d[axis] = static_cast<double>(to[axis]) - static_cast<double>(from[axis]);
    }
    return d;
}

/// A triangle seen along an edge, from its high end.
struct Turned {
    double along = 0;  ///< the direction of the first triangle
    double across = 0;
    std::uint64_t triangle = 0;
    bool goes_up = false;  ///< its side leads from the low to the high end

    [[nodiscard]] int half() const { return across > 0 || (across == 0 && along >= 0) ? 0 : 1; }
    bool operator<(const Turned& other) const {
        if (half() != other.half()) {
            return half() < other.half();
        }
        const double turn = along * other.across - across * other.along;
        return turn != 0 ? turn > 0 : triangle < other.triangle;
    }
};

bool has_side(const ElementCorners& t, std::uint64_t from, std::uint64_t to) {
    return (t[0] == from && t[1] == to) || (t[1] == from && t[2] == to) ||
           (t[2] == from && t[0] == to);
}

}  // namespace

bool Regions::is_wanted(std::int64_t label) const {
    return std::binary_search(wanted_.begin(), wanted_.end(), label);
}

Regions::Regions(const ScratchMesh& mesh, std::span<const TriangleSides> sides,
                 std::span<const std::int64_t> wanted, const ScratchFolder& folder,
                 const Progress& progress)
    : mesh_(mesh),
      sides_(sides),
      wanted_(wanted),
      folder_(folder),
      parent_file_(folder),
      shells_file_(folder) {
    const std::uint64_t count = 2 * mesh.corners().size();
    parent_file_.map(count * sizeof(std::uint64_t));
    const auto parent = parent_file_.as<std::uint64_t>();
    std::iota(parent.begin(), parent.end(), std::uint64_t{0});
    unite_sides(progress);
    shells_file_.map(count * sizeof(std::uint32_t));
    number_shells(progress);
    parent_file_.clear();
    join_shells(progress);
}

void Regions::unite_sides(const Progress& progress) {
    const CornerView& corners = mesh_.corners();
    ScratchFile file(folder_);
    file.map(3 * corners.size() * sizeof(EdgeOfTriangle));
    const auto edges = file.as<EdgeOfTriangle>();
    for (std::uint64_t t = 0; t < corners.size(); ++t) {
        const ElementCorners c = corners[t];
        for (std::size_t i = 0; i < 3; ++i) {
            edges[3 * t + i] = {std::min(c[i], c[(i + 1) % 3]), std::max(c[i], c[(i + 1) % 3]), t};
        }
    }
    progress.check();
    std::sort(edges.begin(), edges.end());
    std::vector<std::uint64_t> around;
    for (std::size_t first = 0, last = 0; first < edges.size(); first = last) {
        if (first % kAskEvery == 0) {
            progress.check();
        }
        around.clear();
        for (last = first; last < edges.size() && edges[last].low == edges[first].low &&
                           edges[last].high == edges[first].high;
             ++last) {
            around.push_back(edges[last].triangle);
        }
        unite_around(around, edges[first].low, edges[first].high);
    }
}

/// Unites the sides that face each other across each wedge around an edge. If every label has two
/// of them, these; else neighbours by their directions.
void Regions::unite_around(std::span<const std::uint64_t> triangles, std::uint64_t low,
                           std::uint64_t high) {
    const auto parent = parent_file_.as<std::uint64_t>();
    struct Side {
        std::int64_t label;
        std::uint64_t side;
        auto operator<=>(const Side&) const = default;
    };
    std::vector<Side> sides;
    for (const std::uint64_t t : triangles) {
        for (std::size_t k = 0; k < 2; ++k) {
            if (is_wanted(sides_[t][k])) {
                sides.push_back({sides_[t][k], 2 * t + k});
            }
        }
    }
    std::sort(sides.begin(), sides.end());
    bool is_simple = true;
    for (std::size_t first = 0, last = 0; first < sides.size(); first = last) {
        while (last < sides.size() && sides[last].label == sides[first].label) {
            ++last;
        }
        if ((last - first) % 2 != 0) {
            throw Error(ErrorKind::invalid_argument,
                        fmt::format("the surface of label {} is not closed, so it cannot be filled "
                                    "with tetrahedra; close it at the volume's border",
                                    sides[first].label));
        }
        is_simple = is_simple && last - first == 2;
    }
    if (is_simple) {
        for (std::size_t i = 0; i < sides.size(); i += 2) {
            unite(parent, sides[i].side, sides[i + 1].side);
        }
        return;
    }
    const auto at = mesh_.positions();
    const Double3 axis = between(at[low], at[high]);
    std::vector<Turned> turned;
    Double3 along{};
    Double3 across{};
    for (const std::uint64_t t : triangles) {
        const ElementCorners c = mesh_.corners()[t];
        const std::uint64_t apex = c[0] + c[1] + c[2] - low - high;
        const Double3 to = between(at[low], at[apex]);
        if (turned.empty()) {
            across = cross(axis, to);
            along = cross(across, axis);
        }
        turned.push_back({dot(to, along), dot(to, across), t, has_side(c, low, high)});
    }
    std::sort(turned.begin(), turned.end());
    for (std::size_t i = 0; i < turned.size(); ++i) {
        // A triangle whose side leads up faces the direction of rotation.
        const Turned& one = turned[i];
        const Turned& next = turned[(i + 1) % turned.size()];
        const std::uint64_t after = 2 * one.triangle + (one.goes_up ? 1 : 0);
        const std::uint64_t before = 2 * next.triangle + (next.goes_up ? 0 : 1);
        const std::int64_t label = sides_[one.triangle][after % 2];
        if (label == sides_[next.triangle][before % 2] && is_wanted(label)) {
            unite(parent, after, before);
        }
    }
}

void Regions::number_shells(const Progress& progress) {
    const CornerView& corners = mesh_.corners();
    const auto parent = parent_file_.as<std::uint64_t>();
    const auto shells = shells_file_.as<std::uint32_t>();
    const auto at = mesh_.positions();
    const RegionPoint origin = at.empty() ? RegionPoint{} : at[0];
    for (std::uint64_t side = 0; side < shells.size(); ++side) {
        if (side % kAskEvery == 0) {
            progress.check();
        }
        const std::uint64_t t = side / 2;
        const std::int64_t label = sides_[t][side % 2];
        if (!is_wanted(label)) {
            shells[side] = kNone;
            continue;
        }
        // The root of a set is its smallest member.
        const std::uint64_t root = root_of(parent, side);
        if (root == side) {
            if (shells_.size() >= kMax) {
                throw Error(ErrorKind::limit,
                            fmt::format("the labels have more than {} separate surfaces, too many "
                                        "parts to be filled with tetrahedra",
                                        kMax));
            }
            shells[side] = static_cast<std::uint32_t>(shells_.size());
            shells_.push_back({label});
        } else {
            shells[side] = shells[root];
        }
        Shell& shell = shells_[shells[side]];
        const ElementCorners c = corners[t];
        const Double3 a = between(origin, at[c[0]]);
        const Double3 normal = cross(between(at[c[0]], at[c[1]]), between(at[c[0]], at[c[2]]));
        shell.volume += (side % 2 == 0 ? 1 : -1) * dot(a, normal);
        if (std::fabs(normal[0]) > shell.largest) {
            shell.largest = std::fabs(normal[0]);
            shell.triangle = t;
            shell.side = side % 2;
        }
        for (const std::uint64_t v : c) {
            if (!shell.has_farthest || at[v][0] > shell.farthest[0]) {
                shell.farthest = at[v];
                shell.has_farthest = true;
            }
        }
    }
}

/// Finds the first triangle that each line meets.
void Regions::meet(std::span<Line> lines, const Progress& progress) const {
    if (lines.empty()) {
        return;
    }
    // Lines by squares of the plane across them, about one in each.
    constexpr double kMaxSquares = 256;
    const auto squares = static_cast<std::size_t>(
        std::clamp(std::sqrt(static_cast<double>(lines.size())), 1.0, kMaxSquares));
    const MeshLayout& layout = mesh_.layout();
    const auto square = [&](double p, std::size_t axis) {
        const double lo = layout.lo[axis];
        const double size = static_cast<double>(layout.hi[axis]) - lo;
        const double place = size > 0 ? (p - lo) / size * static_cast<double>(squares) : 0;
        return static_cast<std::size_t>(std::clamp(place, 0.0, static_cast<double>(squares - 1)));
    };
    std::vector<std::vector<std::uint32_t>> in_square(squares * squares);
    for (std::size_t i = 0; i < lines.size(); ++i) {
        in_square[square(lines[i].z, 2) * squares + square(lines[i].y, 1)].push_back(
            static_cast<std::uint32_t>(i));
    }
    const auto at = mesh_.positions();
    const CornerView& corners = mesh_.corners();
    for (std::uint64_t t = 0; t < corners.size(); ++t) {
        if (t % kAskEvery == 0) {
            progress.check();
        }
        std::array<Double3, 3> p{};
        const ElementCorners c = corners[t];
        for (std::size_t i = 0; i < 3; ++i) {
            p[i] = between({0, 0, 0}, at[c[i]]);
        }
        const auto reach = [&](std::size_t axis) {
            return std::array{square(std::min({p[0][axis], p[1][axis], p[2][axis]}), axis),
                              square(std::max({p[0][axis], p[1][axis], p[2][axis]}), axis)};
        };
        const auto [y0, y1] = reach(1);
        const auto [z0, z1] = reach(2);
        for (std::size_t z = z0; z <= z1; ++z) {
            for (std::size_t y = y0; y <= y1; ++y) {
                for (const std::uint32_t i : in_square[z * squares + y]) {
                    Line& line = lines[i];
                    const bool is_own = line.not_triangle ? *line.not_triangle == t
                                                          : shell_of(2 * t) == line.shell ||
                                                                shell_of(2 * t + 1) == line.shell;
                    if (is_own) {
                        continue;
                    }
                    const auto weight = [&](std::size_t from) {
                        const Double3& a = p[from];
                        const Double3& b = p[(from + 1) % 3];
                        return (a[1] - line.y) * (b[2] - line.z) -
                               (a[2] - line.z) * (b[1] - line.y);
                    };
                    const std::array w{weight(1), weight(2), weight(0)};
                    const double sum = w[0] + w[1] + w[2];
                    const bool is_met = (w[0] >= 0 && w[1] >= 0 && w[2] >= 0) ||
                                        (w[0] <= 0 && w[1] <= 0 && w[2] <= 0);
                    if (!is_met || sum == 0) {
                        continue;
                    }
                    const double x = (w[0] * p[0][0] + w[1] * p[1][0] + w[2] * p[2][0]) / sum;
                    const double far = line.to * (x - line.x);
                    if (far > 0 && (!line.hit || far < line.to * (line.hit_at - line.x))) {
                        line.hit = t;
                        line.hit_at = x;
                    }
                }
            }
        }
    }
}

void Regions::join_shells(const Progress& progress) {
    const auto at = mesh_.positions();
    const CornerView& corners = mesh_.corners();
    const MeshLayout& layout = mesh_.layout();
    double size = 0;
    for (std::size_t axis = 0; axis < 3; ++axis) {
        size = std::max(
            size, static_cast<double>(layout.hi[axis]) - static_cast<double>(layout.lo[axis]));
    }
    // Beside the vertex, so that a line does not pass exactly along edges.
    constexpr double kBeside = 1e-6;
    std::vector<Line> lines;
    for (std::uint32_t i = 0; i < shells_.size(); ++i) {
        const Shell& shell = shells_[i];
        Line line;
        line.shell = i;
        if (shell.volume <= 0) {
            line.x = shell.farthest[0];
            line.y = shell.farthest[1] + 0.61 * kBeside * size;
            line.z = shell.farthest[2] + 0.37 * kBeside * size;
            line.to = 1;
        } else {
            const ElementCorners c = corners[shell.triangle];
            const Double3 normal = cross(between(at[c[0]], at[c[1]]), between(at[c[0]], at[c[2]]));
            const auto place = [&](std::size_t axis) {
                return 0.5 * static_cast<double>(at[c[0]][axis]) +
                       0.31 * static_cast<double>(at[c[1]][axis]) +
                       0.19 * static_cast<double>(at[c[2]][axis]);
            };
            line.x = place(0);
            line.y = place(1);
            line.z = place(2);
            line.to = (normal[0] > 0) == (shell.side == 1) ? 1 : -1;
            line.not_triangle = shell.triangle;
        }
        lines.push_back(line);
    }
    meet(lines, progress);
    std::vector<std::uint32_t> parent(shells_.size());
    std::iota(parent.begin(), parent.end(), 0U);
    for (const Line& line : lines) {
        if (!line.hit || line.not_triangle) {
            continue;
        }
        const ElementCorners c = corners[*line.hit];
        const Double3 normal = cross(between(at[c[0]], at[c[1]]), between(at[c[0]], at[c[2]]));
        const std::uint32_t met = shell_of(2 * *line.hit + (normal[0] < 0 ? 1 : 0));
        if (met != kNone && shells_[met].label == shells_[line.shell].label) {
            unite(std::span(parent), line.shell, met);
        }
    }
    region_of_shell_.assign(shells_.size(), kNone);
    std::vector<std::uint32_t> of_root(shells_.size(), kNone);
    for (std::uint32_t i = 0; i < shells_.size(); ++i) {
        const std::uint32_t root = root_of(std::span(parent), i);
        if (of_root[root] == kNone) {
            of_root[root] = static_cast<std::uint32_t>(regions_.size());
            constexpr double kNowhere = std::numeric_limits<double>::quiet_NaN();
            regions_.push_back({shells_[i].label, {kNowhere, kNowhere, kNowhere}});
        }
        region_of_shell_[i] = of_root[root];
        if (const Line& line = lines[i]; line.not_triangle && line.hit) {
            regions_[of_root[root]].inside = {(line.x + line.hit_at) / 2, line.y, line.z};
        }
    }
    for (const Region& region : regions_) {
        if (!std::isfinite(region.inside[0])) {
            throw Error(ErrorKind::invalid_argument,
                        fmt::format("no point was found inside a part of label {}, which is too "
                                    "thin; a smaller distance may keep it thicker",
                                    region.label));
        }
    }
}

}  // namespace isonest::detail
