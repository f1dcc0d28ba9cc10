#include "tools/drawing/contour_labels.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <tuple>

namespace isonest::detail::cli {

ContourLabels::ContourLabels(const Rectangle& r, const std::vector<double>& contours)
    : r_(r), contours_(contours), places_(contours.size() * kCells * kCells) {}

void ContourLabels::add(const std::array<Flat, 3>& t) {
    for (std::size_t c = 0; c < contours_.size(); ++c) {
        const double v = contours_[c];
        std::array<std::array<double, 2>, 2> ends{};
        std::size_t count = 0;
        for (std::size_t i = 0; i < 3 && count < 2; ++i) {
            const Flat& a = t[i];
            const Flat& b = t[(i + 1) % 3];
            if ((a.value < v) != (b.value < v)) {
                const double s = (v - a.value) / (b.value - a.value);
                ends.at(count++) = {a.x + s * (b.x - a.x), a.y + s * (b.y - a.y)};
            }
        }
        if (count < 2) {
            continue;
        }
        ContourLabel label{(ends[0][0] + ends[1][0]) / 2, (ends[0][1] + ends[1][1]) / 2, 0, v};
        label.turn = std::atan2(ends[1][1] - ends[0][1], ends[1][0] - ends[0][0]);
        constexpr double kHalfTurn = 3.14159265358979;
        if (label.turn > kHalfTurn / 2) {
            label.turn -= kHalfTurn;
        } else if (label.turn <= -kHalfTurn / 2) {
            label.turn += kHalfTurn;
        }
        const double x = (label.x - r_.left) / (r_.right - r_.left) * kCells;
        const double y = (label.y - r_.top) / (r_.bottom - r_.top) * kCells;
        if (!(x >= 0 && x < kCells && y >= 0 && y < kCells)) {
            continue;
        }
        const auto cell = static_cast<std::size_t>(y) * kCells + static_cast<std::size_t>(x);
        std::optional<Place>& known = places_[c * kCells * kCells + cell];
        const double distance = std::hypot(x - std::floor(x) - 0.5, y - std::floor(y) - 0.5);
        if (!known || std::tie(distance, label.x, label.y) <
                          std::tie(known->distance, known->label.x, known->label.y)) {
            known = Place{label, distance};
        }
    }
}

std::vector<ContourLabel> ContourLabels::choose(double size) const {
    std::vector<ContourLabel> chosen;
    const double apart = 4 * size;
    const double far = 0.35 * std::hypot(r_.right - r_.left, r_.bottom - r_.top);
    for (std::size_t c = 0; c < contours_.size(); ++c) {
        const std::size_t before = chosen.size();
        for (std::size_t n = 0; n < kMostEach; ++n) {
            // The place that is furthest from all that are taken, and from the border.
            const ContourLabel* best = nullptr;
            double largest = apart;
            for (std::size_t i = 0; i < kCells * kCells; ++i) {
                const std::optional<Place>& place = places_[c * kCells * kCells + i];
                if (!place) {
                    continue;
                }
                const ContourLabel& l = place->label;
                double free =
                    2 * std::min({l.x - r_.left, r_.right - l.x, l.y - r_.top, r_.bottom - l.y});
                bool is_near_own = false;
                for (std::size_t k = 0; k < chosen.size(); ++k) {
                    const double d = std::hypot(chosen[k].x - l.x, chosen[k].y - l.y);
                    free = std::min(free, d);
                    is_near_own = is_near_own || (k >= before && d < far);
                }
                if (!is_near_own && free > largest) {
                    largest = free;
                    best = &l;
                }
            }
            if (best == nullptr) {
                break;
            }
            chosen.push_back(*best);
        }
    }
    return chosen;
}

}  // namespace isonest::detail::cli
