// The error indicators are saturated, so a smaller error makes no fewer triangles but for a few.
// The search comes from large errors, whose meshes cost little to make: all that it tries together
// cost a few times what the result does, however large the volume is.
#include "query/extract/error_budget.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include <isonest/error.h>

namespace isonest::detail {
namespace {

/// A mesh with this share of the triangles asked for is near enough.
constexpr double kNearBudget = 0.9;
constexpr int kMostErrorTries = 7;  ///< between an error that is too small and one that is not
constexpr double kStep = 4;         ///< from one error to the next
/// Of the data's range: the next smaller error is none.
constexpr double kLeast = 1e-7;

/// Keeps nothing of a mesh but how large it is.
class CountingSink : public MeshSink {
  public:
    explicit CountingSink(const MeshSink& like) : like_(like) {}
    void begin(const MeshLayout& layout) override { elements_ = layout.elements; }
    void add_vertices(const VertexBatch& /*batch*/) override {}
    void add_elements(const ElementBatch& /*batch*/) override {}
    [[nodiscard]] bool concurrent() const override { return true; }
    [[nodiscard]] bool holds_float64() const override { return like_.holds_float64(); }
    [[nodiscard]] std::uint64_t elements() const { return elements_; }

  private:
    const MeshSink& like_;
    std::uint64_t elements_ = 0;
};

}  // namespace

ExtractReport extract_within_error_budget(const Store& store, const SurfaceQuery& query,
                                          MeshSink& sink, const ExtractOptions& options,
                                          Progress& progress) {
    const ErrorBudget budget = std::get<ErrorBudget>(query.stop);
    if (budget.most == 0) {
        throw Error(ErrorKind::invalid_argument, "a mesh of no triangles is no surface");
    }
    const double range = std::max(store.max_value() - store.min_value(), 0.0);
    SurfaceQuery tried = query;
    ExtractReport report;
    const auto stop_within = [&](double error) {
        const ErrorBound bound{error, false, budget.guarantee};
        return budget.simplified ? SurfaceStop(SimplifiedErrorBound{bound}) : SurfaceStop(bound);
    };
    const auto triangles = [&](double error) {
        tried.stop = stop_within(error);
        CountingSink counter(sink);
        report = extract(store, tried, counter, options, progress);
        return counter.elements();
    };
    double enough = 2 * range;
    if (const std::uint64_t least = triangles(enough); least > budget.most) {
        throw Error(ErrorKind::limit, {store.path().string()},
                    fmt::format("the coarsest mesh of this surface has {} triangles, within {:.4g} "
                                "of the values; more than {}",
                                least, report.error_bound, budget.most));
    }
    double too_small = -1;  // none is, yet
    std::uint64_t count = 0;
    while (too_small < 0 && enough > 0) {
        const double step = enough / kStep;
        const double next = step > kLeast * range ? step : 0;
        const std::uint64_t n = triangles(next);
        if (n > budget.most) {
            too_small = next;
        } else {
            enough = next;
            count = n;
        }
    }
    for (int i = 0; i < kMostErrorTries && too_small >= 0 &&
                    static_cast<double>(count) < kNearBudget * static_cast<double>(budget.most);
         ++i) {
        const double middle = too_small > 0 ? std::sqrt(too_small * enough) : enough / kStep;
        const std::uint64_t n = triangles(middle);
        if (n > budget.most) {
            too_small = middle;
        } else {
            enough = middle;
            count = n;
        }
    }
    tried.stop = stop_within(enough);
    report = extract(store, tried, sink, options, progress);
    report.within_budget = true;
    return report;
}

}  // namespace isonest::detail
