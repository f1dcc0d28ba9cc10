#include "query/extract/info.h"

#include <limits>

#include "query/view/label_view.h"

namespace isonest::detail {

std::vector<ArrayReport> describe_arrays(const StoreReader& store) {
    std::vector<ArrayReport> reports;
    for (const ArrayInfo& array : store.layout().arrays()) {
        ArrayReport report;
        report.level = array.level;
        report.field = array.field;
        report.nodes = array.nodes;
        report.chunk = array.chunk;
        report.alias = array.alias;
        report.chunks = static_cast<std::uint64_t>(array.grid.product());
        report.raw_bytes = static_cast<std::uint64_t>(array.nodes.product() * array.components) *
                           array.codec.element_size;
        const ArrayTotals totals = store.totals(array);
        report.stored_bytes = totals.bytes;
        report.min = totals.min;
        report.max = totals.max;
        if (const StoreHeader& header = store.layout().header(); header.labels) {
            const auto low = wide_label(header, totals.min);
            const auto high = wide_label(header, totals.max);
            if (array.field != Field::values) {
                report.min = report.max = std::numeric_limits<double>::quiet_NaN();
            } else if (low && high) {
                report.labels = {*low, *high};
                report.min = static_cast<double>(*low);
                report.max = static_cast<double>(*high);
            }
        }
        reports.push_back(report);
    }
    return reports;
}

std::uint64_t cube_range_bytes(const StoreReader& store) {
    std::uint64_t bytes = 0;
    for (int level = kFirstRangeLevel; store.layout().has_cube_ranges(level); ++level) {
        bytes += static_cast<std::uint64_t>(store.layout().lattice().cells_at(level).product()) *
                 cube_range_bytes(store.layout().header().type);
    }
    return bytes;
}

}  // namespace isonest::detail
