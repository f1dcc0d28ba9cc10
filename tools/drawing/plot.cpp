#include "tools/drawing/plot.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <optional>

#include "tools/drawing/canvas.h"

namespace isonest::detail::cli {
namespace {

constexpr int kPlotWidth = 790;
constexpr int kPlotHeight = 480;
constexpr double kPlotLeft = 84;
constexpr double kPlotRight = 200;
constexpr double kPlotTop = 40;
constexpr double kPlotBottom = 58;

// P. Tol's bright, muted and vibrant schemes: to be told apart by all eyes.
constexpr std::array<Color, 12> kColors{{{0.27, 0.47, 0.67},
                                         {0.93, 0.40, 0.47},
                                         {0.13, 0.53, 0.20},
                                         {0.80, 0.73, 0.27},
                                         {0.40, 0.80, 0.93},
                                         {0.67, 0.20, 0.47},
                                         {0.20, 0.13, 0.53},
                                         {0.60, 0.60, 0.20},
                                         {0.53, 0.13, 0.33},
                                         {0.45, 0.45, 0.45},
                                         {0.93, 0.47, 0.20},
                                         {0.00, 0.60, 0.53}}};

/// Curves are told apart by dashes and markers too, in print without colours.
const std::vector<double>& dashes_of(std::size_t curve) {
    static const std::array<std::vector<double>, 5> kinds{
        {{}, {7, 3}, {2, 2.5}, {9, 3, 2, 3}, {4, 2}}};
    return kinds.at(curve % kinds.size());
}

/// A logarithmic axis from whole powers of ten to whole powers of ten.
struct Axis {
    double low = std::numeric_limits<double>::infinity();
    double high = -std::numeric_limits<double>::infinity();
    void include(double v) {
        low = std::min(low, std::log10(v));
        high = std::max(high, std::log10(v));
    }
    void finish() {
        low = std::isfinite(low) ? std::floor(low + 1e-9) : 0;
        high = std::isfinite(high) ? std::ceil(high - 1e-9) : 1;
        high = std::max(high, low + 1);
    }
    [[nodiscard]] double at(double v) const { return (std::log10(v) - low) / (high - low); }
};

/// Where a curve ends on the right, and at which height its name stands.
struct CurveEnd {
    std::size_t series;
    std::array<double, 2> at;
    double label;
};

/// The names beside the curves' ends, none on another one, each led to by a line.
void label_ends(Canvas& d, const Plot& plot, std::vector<CurveEnd>& ends, double right, double top,
                double bottom) {
    constexpr double kRow = 17;
    std::stable_sort(ends.begin(), ends.end(),
                     [](const CurveEnd& a, const CurveEnd& b) { return a.at[1] < b.at[1]; });
    double above = top - kRow;
    for (CurveEnd& end : ends) {
        above = end.label = std::max(end.label, above + kRow);
    }
    double below = bottom + kRow;
    for (auto end = ends.rbegin(); end != ends.rend(); ++end) {
        below = end->label = std::min(end->label, below - kRow);
    }
    for (const CurveEnd& end : ends) {
        const std::size_t i = end.series;
        d.color(kColors.at(i % kColors.size()));
        d.path({end.at, {right + 6, end.label}, {right + 14, end.label}}, 0.7);
        d.marker(right + 18, end.label, static_cast<int>(i) % Canvas::kMarkers);
        d.text(right + 26, end.label + 4, plot.series[i].name, 12, 0);
    }
}

void draw(Canvas& d, const Plot& plot) {
    Axis x;
    Axis y;
    const auto shown = [](const std::pair<double, double>& p) {
        return p.first > 0 && p.second > 0 && std::isfinite(p.first) && std::isfinite(p.second);
    };
    for (const PlotSeries& s : plot.series) {
        for (const auto& p : s.points) {
            if (shown(p)) {
                x.include(p.first);
                y.include(p.second);
            }
        }
    }
    x.finish();
    y.finish();
    const double w = kPlotWidth - kPlotLeft - kPlotRight;
    const double h = kPlotHeight - kPlotTop - kPlotBottom;
    const auto px = [&](double v) { return kPlotLeft + w * x.at(v); };
    const auto py = [&](double v) { return kPlotTop + h * (1 - y.at(v)); };
    const auto ticks = [&](const Axis& axis, auto&& draw_tick) {
        const double step = std::ceil((axis.high - axis.low) / 10);
        const auto count = static_cast<int>((axis.high - axis.low) / step);
        for (int i = 0; i <= count; ++i) {
            const double e = axis.low + i * step;
            draw_tick(std::pow(10, e), e);
        }
    };
    constexpr Color kPlotGrid{0.88, 0.88, 0.88};
    constexpr Color kPlotInk{0.2, 0.2, 0.2};
    ticks(x, [&](double v, double e) {
        d.color(kPlotGrid);
        d.line(px(v), kPlotTop, px(v), kPlotTop + h, 1);
        d.color(kPlotInk);
        d.text(px(v), kPlotTop + h + 18, fmt::format("1e{:g}", e), 12, 0.5);
    });
    ticks(y, [&](double v, double e) {
        d.color(kPlotGrid);
        d.line(kPlotLeft, py(v), kPlotLeft + w, py(v), 1);
        d.color(kPlotInk);
        d.text(kPlotLeft - 8, py(v) + 4, fmt::format("1e{:g}", e), 12, 1);
    });
    d.text(kPlotLeft + w / 2, kPlotTop - 14, plot.title, 15, 0.5);
    d.text(kPlotLeft + w / 2, kPlotHeight - 14, plot.x, 13, 0.5);
    d.text(22, kPlotTop + h / 2, plot.y, 13, 0.5, -1.5708);
    std::vector<CurveEnd> ends;
    for (std::size_t i = 0; i < plot.series.size(); ++i) {
        const PlotSeries& s = plot.series[i];
        d.color(kColors.at(i % kColors.size()));
        const std::vector<double>& dashes = dashes_of(i);
        std::vector<std::array<double, 2>> points;
        const auto draw_points = [&] {
            d.path(points, 1.6, dashes);
            for (const auto& [at_x, at_y] : points) {
                d.marker(at_x, at_y, static_cast<int>(i) % Canvas::kMarkers);
            }
        };
        std::optional<std::array<double, 2>> rightmost;
        for (const auto& p : s.points) {
            if (!shown(p)) {
                draw_points();
                points.clear();
                continue;
            }
            points.push_back({px(p.first), py(p.second)});
            if (!rightmost || points.back()[0] > (*rightmost)[0]) {
                rightmost = points.back();
            }
        }
        draw_points();
        if (rightmost) {
            ends.push_back({i, *rightmost, (*rightmost)[1]});
        }
    }
    label_ends(d, plot, ends, kPlotLeft + w, kPlotTop, kPlotTop + h);
}

}  // namespace

void draw_plot(const std::filesystem::path& path, const Plot& plot) {
    draw_canvas(path, kPlotWidth, kPlotHeight, [&](Canvas& canvas) { draw(canvas, plot); });
}

}  // namespace isonest::detail::cli
