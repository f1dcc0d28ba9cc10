#include <fmt/format.h>

#include <algorithm>
#include <vector>

#include <isonest/error.h>
#include <isonest/extract.h>

#include "query/extract/run_extraction.h"
#include "store/container/format.h"

namespace isonest {
namespace {

void require_isovalues(const Store& store, std::span<const double> isovalues) {
    const std::string name = store.reader().path().string();
    if (isovalues.empty()) {
        throw Error(ErrorKind::invalid_argument, {name}, "no isovalues are given");
    }
    if (isovalues.size() > kMostIsovalues) {
        throw Error(ErrorKind::limit, {name},
                    fmt::format("{} isovalues; at most {} at once, more of them in several runs",
                                isovalues.size(), kMostIsovalues));
    }
    std::vector<double> sorted(isovalues.begin(), isovalues.end());
    std::sort(sorted.begin(), sorted.end());
    if (const auto twice = std::adjacent_find(sorted.begin(), sorted.end());
        twice != sorted.end()) {
        throw Error(ErrorKind::invalid_argument, {name},
                    fmt::format("the isovalue {} is given twice", *twice));
    }
}

/// Whether one traversal gives them all: neither a search for an error, nor a kept analysis or an
/// interval of the volume of each, nor a mesh that is turned.
bool are_together(const Store& store, const SurfaceQuery& query) {
    return !std::holds_alternative<ErrorBudget>(query.stop) && !query.analysis &&
           !query.volume_interval && store.reader().layout().header().direction == kAlongWorld;
}

}  // namespace

void extract_isovalues(const Store& store, std::span<const double> isovalues,
                       const SurfaceQuery& query,
                       const std::function<std::unique_ptr<MeshSink>(std::size_t number)>& sink,
                       const std::function<void(std::size_t number, const ExtractReport&)>& done,
                       const ExtractOptions& options, Progress& progress) {
    require_isovalues(store, isovalues);
    SurfaceQuery own = query;
    if (!are_together(store, query)) {
        for (std::size_t i = 0; i < isovalues.size(); ++i) {
            own.iso = isovalues[i];
            const std::unique_ptr<MeshSink> to = sink(i);
            done(i, extract(store, own, *to, options, progress));
        }
        return;
    }
    std::unique_ptr<MeshSink> first = sink(0);
    detail::ExtractQuery asked;
    for (const double iso : isovalues) {
        own.iso = iso;
        asked = detail::extract_query(store.reader(), own, first->holds_float64());
    }
    detail::run_extractions(
        store.reader(), asked, isovalues,
        [&](std::size_t i) { return i == 0 ? std::move(first) : sink(i); }, done, options,
        progress);
}

}  // namespace isonest
