#include "tools/drawing/histogram_plot.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "tools/drawing/canvas.h"

namespace isonest::detail::cli {
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
// Of P. Tol's bright scheme: to be told apart by all eyes.
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
        constexpr double kOne = 2;  // pixels: what a single node is seen by
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
        entry(kNodes, "nodes of a bin");
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
    double span_ = 0;  ///< half of what the bins span
    double decades_ = 1;
};

}  // namespace

void draw_histogram(const std::filesystem::path& path, const std::string& title,
                    const Histogram& histogram, const ValueText& text) {
    draw_canvas(path, kWidth, kHeight,
                [&](Canvas& canvas) { HistogramPlot(canvas, histogram, text).draw(title); });
}

}  // namespace isonest::detail::cli
