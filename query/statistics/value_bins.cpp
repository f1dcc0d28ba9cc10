#include "query/statistics/value_bins.h"

namespace isonest::detail {

ValueBins::ValueBins(ValueType type, double lowest, double highest)
    : end(highest), integer(type != ValueType::f32 && type != ValueType::f64) {
    if (!(lowest <= highest)) {
        return;
    }
    if (integer) {
        const double numbers = highest - lowest + 1;
        const double width = std::ceil(numbers / kMostBins);
        const auto count = static_cast<int>(std::ceil(numbers / width));
        for (int k = 0; k < count; ++k) {
            low.push_back(lowest + k * width);
        }
        end = low.back() + width;
        return;
    }
    const int count = lowest < highest ? kMostBins : 1;
    for (int k = 0; k < count; ++k) {
        // Ascending, and finite where the difference of the ends is not.
        low.push_back(std::lerp(lowest, highest, static_cast<double>(k) / count));
    }
}

BinFinder::BinFinder(const ValueBins& bins)
    : bins_(&bins), first_(bins.low.front()), last_(bins.count() - 1) {
    per_half_ = bins.integer ? bins.count() / (bins.end - first_)
                             : bins.count() / (bins.end / 2 - first_ / 2);
}

}  // namespace isonest::detail
