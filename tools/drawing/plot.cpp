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

// P. Tol's bright, muted and vibrant schemes, which are safe for colour-blind readers.
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

/// Curves also differ in dashes and markers, for print without colours.
const std::vector<double>& dashes_of(std::size_t curve) {
    static const std::array<std::vector<double>, 5> kinds{
        {{}, {7, 3}, {2, 2.5}, {9, 3, 2, 3}, {4, 2}}};
    return kinds.at(curve % kinds.size());
}

/// A logarithmic axis between powers of ten.
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

/// The right end of a curve, and the height of its name.
struct CurveEnd {
    std::size_t series;
    std::array<double, 2> at;
    double label;
};

/// Draws the names beside the curves' ends without overlaps, each connected to its curve by a line.
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

namespace {

constexpr int kWidth = 900;
constexpr int kHeight = 480;
constexpr double kLeft = 70;
constexpr double kRight = 190;
constexpr double kTop = 40;
constexpr double kBottom = 58;
constexpr double kWide = kWidth - kLeft - kRight;
constexpr double kHigh = kHeight - kTop - kBottom;

constexpr Color kGrid{0.88, 0.88, 0.88};
constexpr Color kInk{0.2, 0.2, 0.2};
// From P. Tol's bright scheme, which is safe for colour-blind readers.
constexpr Color kNodes{0.60, 0.73, 0.85};
constexpr Color kCubes{0.93, 0.40, 0.47};
constexpr Color kSuggested{0.13, 0.53, 0.20};

class HistogramPlot {
  public:
    HistogramPlot(Canvas& canvas, const Histogram& histogram, const ValueText& text)
        : c_(canvas), h_(histogram), text_(text) {
        if (h_.bins.count() > 0) {
            first_ = h_.bins.low.front();
            span_ = h_.bins.end / 2 - first_ / 2;
        }
        std::uint64_t most = 1;
        for (const auto* counts : {&h_.nodes, &h_.cubes}) {
            for (const std::uint64_t count : *counts) {
                most = std::max(most, count);
            }
        }
        decades_ = std::max(1.0, std::ceil(std::log10(static_cast<double>(most)) - 1e-9));
    }

    void draw(const std::string& title) {
        for (int e = 0; e <= static_cast<int>(decades_); ++e) {
            const double y = kTop + kHigh * (1 - e / decades_);
            c_.color(kGrid);
            c_.line(kLeft, y, kLeft + kWide, y, 1);
            c_.color(kInk);
            c_.text(kLeft - 8, y + 4, fmt::format("1e{}", e), 12, 1);
        }
        bars();
        surfaces();
        values_axis();
        c_.text(kLeft + kWide / 2, kTop - 14, title, 15, 0.5);
        c_.text(kLeft + kWide / 2, kHeight - 14, "value", 13, 0.5);
        c_.text(22, kTop + kHigh / 2, "number", 13, 0.5, -1.5708);
        suggestions();
        legend();
    }

  private:
    [[nodiscard]] double px(double value) const {
        return kLeft + (span_ > 0 ? kWide * ((value / 2 - first_ / 2) / span_) : kWide / 2);
    }
    [[nodiscard]] double py(std::uint64_t count) const {
        return kTop + kHigh * (1 - std::log10(static_cast<double>(count)) / decades_);
    }
    [[nodiscard]] double end_of(std::size_t bin) const {
        return bin + 1 < h_.bins.low.size() ? h_.bins.low[bin + 1] : h_.bins.end;
    }

    void bars() {
        constexpr double kOne = 2;  // pixels, so that a single node is visible
        c_.color(kNodes);
        for (std::size_t k = 0; k < h_.nodes.size(); ++k) {
            if (h_.nodes[k] > 0) {
                const double x = px(h_.bins.low[k]);
                c_.area(x, std::min(py(h_.nodes[k]), kTop + kHigh - kOne),
                        std::max(px(end_of(k)), x + 1), kTop + kHigh);
            }
        }
    }

    void surfaces() {
        c_.color(kCubes);
        const auto some = [&](std::size_t k) { return k < h_.cubes.size() && h_.cubes[k] > 0; };
        for (std::size_t k = 1; k < h_.cubes.size(); ++k) {  // none below the smallest value
            const double x = px(h_.bins.low[k]);
            if (some(k) && some(k + 1)) {
                c_.line(x, py(h_.cubes[k]), px(h_.bins.low[k + 1]), py(h_.cubes[k + 1]), 1.8);
            } else if (some(k) && !some(k - 1)) {
                c_.marker(x, py(h_.cubes[k]), 0);
            }
        }
    }

    void values_axis() {
        c_.color(kInk);
        c_.line(kLeft, kTop + kHigh, kLeft + kWide, kTop + kHigh, 1);
        if (h_.bins.count() == 0) {
            return;
        }
        constexpr int kTicks = 4;
        for (int i = 0; i <= (span_ > 0 ? kTicks : 0); ++i) {
            const double value = std::lerp(first_, h_.bins.end, static_cast<double>(i) / kTicks);
            c_.line(px(value), kTop + kHigh, px(value), kTop + kHigh + 4, 1);
            c_.text(px(value), kTop + kHigh + 18, text_(value), 12, 0.5);
        }
    }

    void suggestions() {
        c_.color(kSuggested);
        for (const SuggestedIsovalue& s : h_.suggested) {
            c_.line(px(s.isovalue), kTop, px(s.isovalue), kTop + kHigh, 1.4, true);
        }
    }

    void legend() {
        const double x = kLeft + kWide + 14;
        double y = kTop + 12;
        const auto entry = [&](const Color& color, const std::string& words) {
            c_.color(color);
            c_.area(x, y - 9, x + 14, y + 1);
            c_.color(kInk);
            c_.text(x + 20, y, words, 12, 0);
            y += 18;
        };
        entry(kNodes, "nodes per bin");
        if (h_.cube_level) {
            const int edge = 1 << *h_.cube_level;
            entry(kCubes,
                  edge == 1 ? "cubes with surface" : fmt::format("cubes of {}^3 cells", edge));
        }
        if (!h_.suggested.empty()) {
            entry(kSuggested, "suggested isovalues:");
        }
        for (const SuggestedIsovalue& s : h_.suggested) {
            c_.text(x + 20, y, text_(s.isovalue), 12, 0);
            y += 16;
        }
    }

    Canvas& c_;
    const Histogram& h_;
    const ValueText& text_;
    double first_ = 0;
    double span_ = 0;  ///< half the range of the bins
    double decades_ = 1;
};

}  // namespace

void draw_histogram(const std::filesystem::path& path, const std::string& title,
                    const Histogram& histogram, const ValueText& text) {
    draw_canvas(path, kWidth, kHeight,
                [&](Canvas& canvas) { HistogramPlot(canvas, histogram, text).draw(title); });
}

}  // namespace isonest::detail::cli
