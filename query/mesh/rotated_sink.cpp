#include "query/mesh/rotated_sink.h"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <limits>

#include "query/mesh/zero_area.h"
#include "store/base/rotation.h"

namespace isonest::detail {
void RotatedSink::begin(const MeshLayout& layout) {
    layout_ = layout;
    layout_.lo = MeshLayout::kEmptyLo;
    layout_.hi = MeshLayout::kEmptyHi;
}

RotatedSink::Turned RotatedSink::turned(const VertexBatch& batch) const {
    Turned t;
    t.positions.resize(batch.positions.size());
    for (std::size_t i = 0; i < batch.positions.size(); ++i) {
        const auto& p = batch.positions[i];
        const Double3 world = rotated_about(
            about_, direction_,
            {static_cast<double>(p[0]), static_cast<double>(p[1]), static_cast<double>(p[2])});
        for (std::size_t a = 0; a < 3; ++a) {
            t.positions[i][a] = static_cast<float>(world[a]);
        }
    }
    t.attributes.assign(batch.attributes.begin(), batch.attributes.end());
    const VertexAttribute* const normal = layout_.find("normal");
    for (std::size_t i = 0; normal != nullptr && i < batch.positions.size(); ++i) {
        const Double3 world =
            rotated(direction_, {batch.number(i, *normal, 0), batch.number(i, *normal, 1),
                                 batch.number(i, *normal, 2)});
        std::array<float, 3> stored{};
        for (std::size_t a = 0; a < 3; ++a) {
            stored.at(a) = static_cast<float>(world[a]);
        }
        std::memcpy(t.attributes.data() + i * batch.row_bytes + normal->offset, stored.data(),
                    sizeof(stored));
    }
    return t;
}

void RotatedSink::add_vertices(const VertexBatch& batch) {
    const Turned t = turned(batch);
    if (measured_) {
        inner_.add_vertices({batch.first, t.positions, t.attributes, batch.row_bytes});
        return;
    }
    std::array<float, 3> lo = MeshLayout::kEmptyLo;
    std::array<float, 3> hi = MeshLayout::kEmptyHi;
    const auto widen = [](std::array<float, 3>& low, std::array<float, 3>& high,
                          const std::array<float, 3>& from, const std::array<float, 3>& to) {
        for (std::size_t a = 0; a < 3; ++a) {
            low[a] = std::min(low[a], from[a]);
            high[a] = std::max(high[a], to[a]);
        }
    };
    for (const auto& p : t.positions) {
        widen(lo, hi, p, p);
    }
    const std::lock_guard lock(box_);
    widen(layout_.lo, layout_.hi, lo, hi);
}

void RotatedSink::add_elements(const ElementBatch& batch) {
    if (!measured_ && layout_.corners != 3) {
        return;
    }
    const Turned t = turned(batch.nearby);
    if (!measured_) {
        zero_area_ += static_cast<std::uint64_t>(std::count_if(
            batch.nearby_corners.begin(), batch.nearby_corners.end(), [&t](const auto& c) {
                return has_no_area(t.positions[c[0]], t.positions[c[1]], t.positions[c[2]]);
            }));
        return;
    }
    ElementBatch turned_batch = batch;
    turned_batch.nearby = {batch.nearby.first, t.positions, t.attributes, batch.nearby.row_bytes};
    inner_.add_elements(turned_batch);
}

bool RotatedSink::again() {
    if (measured_) {
        return inner_.again();
    }
    measured_ = true;
    inner_.begin(layout_);
    return true;
}

double RotatedSink::rounding() const {
    double sum = 0;
    for (std::size_t a = 0; a < 3; ++a) {
        const float largest = std::max(std::fabs(layout_.lo[a]), std::fabs(layout_.hi[a]));
        const float next = std::nextafter(largest, std::numeric_limits<float>::infinity());
        const double half = (static_cast<double>(next) - static_cast<double>(largest)) / 2;
        sum += layout_.lo[a] <= layout_.hi[a] ? half * half : 0;
    }
    return std::sqrt(sum);
}

void report_turning(const RotatedSink& turning, const Double3& spacing, ExtractReport& report) {
    if (report.distance && report.distance->bound > 0) {
        report.distance->bound += turning.rounding();
    }
    report.coordinate_rounding +=
        turning.rounding() / *std::min_element(spacing.begin(), spacing.end());
    report.mending.zero_area = turning.zero_area_triangles();
}

}  // namespace isonest::detail
