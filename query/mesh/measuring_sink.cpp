#include "query/mesh/measuring_sink.h"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <functional>
#include <numbers>
#include <type_traits>

#include "store/base/vector3.h"

namespace isonest::detail {
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
    // Opposite to the shortest side.
    const Double3& u = side[(shortest + 1) % 3];
    const Double3& v = side[(shortest + 2) % 3];
    const double angle = std::atan2(length(cross(u, v)), -dot(u, v)) * 180 / std::numbers::pi;
    return std::min(angle, kMostAngle);
}

AngleCounts::AngleCounts() : counts_(static_cast<std::size_t>(kMostAngle * kPerDegree) + 1) {}

void AngleCounts::add(double angle) {
    ++counts_[static_cast<std::size_t>(angle * kPerDegree)];
    ++triangles_;
    narrow_ += angle < TriangleQuality::kNarrow ? 1 : 0;
    least_ = std::min(least_, angle);
}

void AngleCounts::add(const AngleCounts& other) {
    std::transform(counts_.begin(), counts_.end(), other.counts_.begin(), counts_.begin(),
                   std::plus<>());
    triangles_ += other.triangles_;
    narrow_ += other.narrow_;
    least_ = std::min(least_, other.least_);
}

std::string AngleCounts::packed() const {
    std::string text;
    const auto add = [&](const auto& number) {
        text.append(reinterpret_cast<const char*>(&number), sizeof(number));
    };
    add(triangles_);
    add(narrow_);
    add(least_);
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
    take(counts.least_);
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
    return std::max(static_cast<double>(bin) / kPerDegree, least_);
}

TriangleQuality AngleCounts::quality() const {
    if (triangles_ == 0) {
        return {};
    }
    TriangleQuality q;
    q.least = least_;
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

void MeasuringSink::report(ExtractReport& report) const {
    report.measures = sums_.measures();
    if (counts_) {
        report.quality = counts_->quality();
    }
}

}  // namespace isonest::detail
