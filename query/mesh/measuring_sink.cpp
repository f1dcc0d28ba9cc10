#include "query/mesh/measuring_sink.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <functional>
#include <numbers>
#include <type_traits>

#include "store/base/vectors.h"

namespace isonest::detail {

// Around a vertex without a border every neighbour occurs equally often as the first and as the
// second of a triangle's other two corners, so the signed sum of their mixed numbers is 0. At a
// border it is a difference of at least two numbers, which is 0 with a probability of 2^-64.

BorderCount::BorderCount(std::uint64_t vertices, const ScratchFolder& folder) : file_(folder) {
    file_.map(vertices * sizeof(std::uint64_t));
    balance_ = file_.as<std::uint64_t>();
}

void BorderCount::add(const ElementCorners& triangle) {
    for (std::size_t i = 0; i < 3; ++i) {
        balance_[triangle[i]] += mixed(triangle[(i + 1) % 3]) - mixed(triangle[(i + 2) % 3]);
    }
}

std::uint64_t BorderCount::vertices() const {
    return static_cast<std::uint64_t>(std::count_if(
        balance_.begin(), balance_.end(), [](std::uint64_t balance) { return balance != 0; }));
}

std::uint64_t border_vertices(const PartStore& parts, const VertexNumbers& weld,
                              const ScratchFolder& folder, Progress& progress) {
    progress.begin("count borders", weld.triangles(), "triangles");
    BorderCount count(weld.vertices(), folder);
    std::vector<std::uint64_t> number;
    std::vector<bool> owned;
    for (const PartRecord& r : parts.records()) {
        progress.check();
        weld.numbers(r, number, owned);
        for (const auto& t : parts.triangles(r)) {
            count.add({number[t[0]], number[t[1]], number[t[2]]});
        }
        progress.advance(r.triangles);
    }
    return count.vertices();
}

std::uint64_t border_vertices(const ScratchMesh& mesh, const CornerView& triangles,
                              const ScratchFolder& folder, Progress& progress) {
    constexpr std::size_t kOften = std::size_t{1} << 16U;
    progress.begin("count borders", triangles.size(), "triangles");
    BorderCount count(mesh.layout().vertices, folder);
    for (std::size_t at = 0; at < triangles.size(); at += kOften) {
        progress.check();
        const auto some = triangles.subspan(at, std::min(kOften, triangles.size() - at));
        for (const ElementCorners t : some) {
            count.add(t);
        }
        progress.advance(some.size());
    }
    return count.vertices();
}

// The volume within a closed surface is a sum over its triangles: C. Zhang and T. Chen, "Efficient
// feature extraction for 2D/3D objects in mesh representation", ICIP 2001.
//
// Sums are integer multiples of a power of two, at most 2^-61 of the box's diagonal squared or
// cubed, so the order of the triangles does not matter. 2^64 triangles do not overflow them.
//
// The mesh is closed if every edge is used as often in one direction as in the other. Vertex v has
// a number m(v), mixed from v. An edge from a to b adds m(a) m(b) modulo 2^64 if a < b, and
// subtracts it if a > b, so the sum of a closed mesh is 0. For a mesh with a border it is a
// polynomial that is linear in each m(v) and not 0: at most 2^k of the 2^64 values of one m(v) make
// it 0, where 2^k divides the factor of that m(v), which is itself a sum of such numbers. If they
// were random, the sum would be 0 with a probability below 2^-50.

namespace {

/// Relative to the box's diagonal, squared or cubed; a double has at most 53.
constexpr int kBits = 61;

Double3 less(const std::array<float, 3>& to, const Double3& from) {
    Double3 d{};
    for (std::size_t axis = 0; axis < 3; ++axis) {
        d[axis] = static_cast<double>(to[axis]) - from[axis];
    }
    return d;
}

/// The contribution of the edge between two vertices with these mixed numbers.
std::uint64_t of_edge(std::uint64_t a, std::uint64_t b, std::uint64_t mixed_a,
                      std::uint64_t mixed_b) {
    const std::uint64_t sign =
        static_cast<std::uint64_t>(a < b) - static_cast<std::uint64_t>(a > b);
    return sign * mixed_a * mixed_b;
}

}  // namespace

SurfaceSums::SurfaceSums(const MeshLayout& layout) {
    if (layout.elements == 0) {
        return;
    }
    Double3 size{};
    for (std::size_t axis = 0; axis < 3; ++axis) {
        const double lo = layout.lo[axis];
        const double hi = layout.hi[axis];
        centre_[axis] = (lo + hi) / 2;
        size[axis] = hi - lo;
    }
    const double diagonal = length(size);
    int exponent = 0;
    std::frexp(diagonal, &exponent);
    area_exponent_ = 2 * exponent - kBits;
    volume_exponent_ = 3 * exponent - kBits;
}

void SurfaceSums::add(const ElementBatch& batch) {
    const double per_area = std::ldexp(1.0, -area_exponent_);
    const double per_volume = std::ldexp(1.0, -volume_exponent_);
    const auto& at = batch.nearby.positions;
    for (std::size_t i = 0; i < batch.corners.size(); ++i) {
        const auto& t = batch.nearby_corners[i];
        const Double3 apex = less(at[t[0]], {0, 0, 0});
        const Double3 normal = cross(less(at[t[1]], apex), less(at[t[2]], apex));
        twice_area_ += static_cast<std::int64_t>(length(normal) * per_area);
        six_volumes_ +=
            static_cast<std::int64_t>(dot(less(at[t[0]], centre_), normal) * per_volume);
        const auto& v = batch.corners[i];
        const std::array<std::uint64_t, 3> m{mixed(v[0]), mixed(v[1]), mixed(v[2])};
        unmatched_ += of_edge(v[0], v[1], m[0], m[1]) + of_edge(v[1], v[2], m[1], m[2]) +
                      of_edge(v[2], v[0], m[2], m[0]);
    }
}

void SurfaceSums::add(const SurfaceSums& other) {
    twice_area_ += other.twice_area_;
    six_volumes_ += other.six_volumes_;
    unmatched_ += other.unmatched_;
}

SurfaceMeasures SurfaceSums::measures() const {
    constexpr double kOfParallelepiped = 1.0 / 6;
    SurfaceMeasures measures;
    measures.area = std::ldexp(static_cast<double>(twice_area_), area_exponent_) / 2;
    if (unmatched_ == 0) {
        measures.volume =
            std::fabs(std::ldexp(static_cast<double>(six_volumes_), volume_exponent_)) *
            kOfParallelepiped;
    }
    return measures;
}

SurfaceMeasures measures_of(const MeshLayout& layout,
                            std::span<const std::array<float, 3>> positions,
                            const CornerView& elements) {
    constexpr std::size_t kAtOnce = 1U << 12U;
    SurfaceSums sums(layout);
    std::vector<std::array<float, 3>> nearby;
    std::vector<std::array<std::uint32_t, 3>> places;
    std::vector<ElementCorners> corners;
    for (std::size_t at = 0; at < elements.size(); at += kAtOnce) {
        const auto some = elements.subspan(at, std::min(kAtOnce, elements.size() - at));
        nearby.clear();
        places.clear();
        corners.assign(some.begin(), some.end());
        for (const auto& t : corners) {
            const auto first = static_cast<std::uint32_t>(nearby.size());
            places.push_back({first, first + 1, first + 2});
            for (const std::uint64_t v : t) {
                nearby.push_back(positions[v]);
            }
        }
        sums.add({at, corners, places, {0, nearby, {}, 0}});
    }
    return sums.measures();
}

namespace {

using Point = std::array<float, 3>;
constexpr double kPerDegree = 100;

Double3 between(const Point& from, const Point& to) {
    Double3 d{};
    for (std::size_t axis = 0; axis < 3; ++axis) {
        d[axis] = static_cast<double>(to[axis]) - static_cast<double>(from[axis]);
    }
    return d;
}

}  // namespace

double smallest_angle(const Point& a, const Point& b, const Point& c) {
    const std::array<Double3, 3> side{between(b, c), between(c, a), between(a, b)};
    std::array<double, 3> size{};
    std::transform(side.begin(), side.end(), size.begin(),
                   [](const Double3& s) { return dot(s, s); });
    const auto shortest =
        static_cast<std::size_t>(std::min_element(size.begin(), size.end()) - size.begin());
    if (size[shortest] == 0) {
        return 0;
    }
    // The angle opposite the shortest side.
    const Double3& u = side[(shortest + 1) % 3];
    const Double3& v = side[(shortest + 2) % 3];
    const double angle = std::atan2(length(cross(u, v)), -dot(u, v)) * 180 / std::numbers::pi;
    return std::min(angle, kMaxAngle);
}

AngleCounts::AngleCounts() : counts_(static_cast<std::size_t>(kMaxAngle * kPerDegree) + 1) {}

void AngleCounts::add(double angle) {
    ++counts_[static_cast<std::size_t>(angle * kPerDegree)];
    ++triangles_;
    narrow_ += angle < TriangleQuality::kNarrow ? 1 : 0;
    min_ = std::min(min_, angle);
}

void AngleCounts::add(const AngleCounts& other) {
    std::transform(counts_.begin(), counts_.end(), other.counts_.begin(), counts_.begin(),
                   std::plus<>());
    triangles_ += other.triangles_;
    narrow_ += other.narrow_;
    min_ = std::min(min_, other.min_);
}

std::string AngleCounts::packed() const {
    std::string text;
    const auto add = [&](const auto& number) {
        text.append(reinterpret_cast<const char*>(&number), sizeof(number));
    };
    add(triangles_);
    add(narrow_);
    add(min_);
    for (const std::uint64_t count : counts_) {
        add(count);
    }
    return text;
}

AngleCounts AngleCounts::unpacked(std::string_view text) {
    AngleCounts counts;
    const auto take = [&](auto& number) {
        std::memcpy(&number, text.data(), sizeof(number));
        text.remove_prefix(sizeof(number));
    };
    take(counts.triangles_);
    take(counts.narrow_);
    take(counts.min_);
    for (std::uint64_t& count : counts.counts_) {
        take(count);
    }
    return counts;
}

double AngleCounts::quantile(double share) const {
    const auto wanted = static_cast<std::uint64_t>(share * static_cast<double>(triangles_));
    std::uint64_t below = 0;
    std::size_t bin = 0;
    while (below + counts_[bin] <= wanted) {
        below += counts_[bin++];
    }
    return std::max(static_cast<double>(bin) / kPerDegree, min_);
}

TriangleQuality AngleCounts::quality() const {
    if (triangles_ == 0) {
        return {};
    }
    TriangleQuality q;
    q.least = min_;
    q.per_mille = quantile(0.001);
    q.percent = quantile(0.01);
    q.five_percent = quantile(0.05);
    q.median = quantile(0.5);
    q.narrow_share = static_cast<double>(narrow_) / static_cast<double>(triangles_);
    return q;
}

void MeasuringSink::begin(const MeshLayout& layout) {
    no_sums_ = SurfaceSums(layout);
    sums_ = no_sums_;
    sink_.begin(layout);
}

void MeasuringSink::add_elements(const ElementBatch& batch) {
    if (is_first_pass_) {
        SurfaceSums sums = no_sums_;
        sums.add(batch);
        std::optional<AngleCounts> counts;
        if (counts_) {
            counts.emplace();
            for (const auto& t : batch.nearby_corners) {
                const auto& at = batch.nearby.positions;
                counts->add(smallest_angle(at[t[0]], at[t[1]], at[t[2]]));
            }
        }
        const std::lock_guard lock(mutex_);
        sums_.add(sums);
        if (counts) {
            counts_->add(*counts);
        }
    }
    sink_.add_elements(batch);
}

std::string MeasuringSink::sums() const {
    static_assert(std::is_trivially_copyable_v<SurfaceSums>);
    return std::string(reinterpret_cast<const char*>(&sums_), sizeof(sums_)) +
           (counts_ ? counts_->packed() : std::string());
}

void MeasuringSink::include(std::string_view sums) {
    SurfaceSums other;
    std::memcpy(&other, sums.data(), sizeof(other));
    sums_.add(other);
    if (counts_) {
        counts_->add(AngleCounts::unpacked(sums.substr(sizeof(other))));
    }
}

bool MeasuringSink::again() {
    is_first_pass_ = false;
    return sink_.again();
}

}  // namespace isonest::detail
