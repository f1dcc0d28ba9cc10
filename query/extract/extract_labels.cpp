#include <oneapi/tbb/parallel_for.h>

#include <algorithm>

#include <isonest/extract.h>

#include "query/extract/labels/smooth_labels.h"
#include "query/labels/label_progress.h"
#include "store/base/workers.h"

namespace isonest {
namespace {

/// With less memory for each, fewer labels are worked on at the same time.
constexpr std::uint64_t kMemoryEach = 256U << 20U;

}  // namespace

void extract_labels(const Store& store, std::span<const Label> labels, const LabelQuery& query,
                    const std::function<std::unique_ptr<MeshSink>(const Label&)>& sink,
                    const std::function<void(std::size_t number, const ExtractReport&)>& done,
                    const ExtractOptions& options, Progress& progress) {
    if (query.smooth) {
        detail::smooth_labels(store.reader(), labels, query, sink, done, options, progress);
        return;
    }
    if (labels.empty()) {
        return;
    }
    const int threads = detail::Workers::count_of(options.threads);
    const auto most = std::min<std::uint64_t>(labels.size(), static_cast<std::uint64_t>(threads));
    const auto together =
        static_cast<int>(std::clamp<std::uint64_t>(options.memory / kMemoryEach, 1, most));
    ExtractOptions each = options;
    each.memory = options.memory / static_cast<std::uint64_t>(together);
    each.threads = std::max(threads / together, 1);
    each.team = nullptr;  // one thread may use it at a time
    progress.begin("extract", labels.size(), "labels");
    detail::LabelProgress silent(progress);
    detail::Workers(together).execute([&] {
        tbb::parallel_for(
            tbb::blocked_range<std::size_t>(0, labels.size(), 1),
            [&](const tbb::blocked_range<std::size_t>& range) {
                for (std::size_t i = range.begin(); i < range.end(); ++i) {
                    progress.check();
                    LabelQuery own = query;
                    own.label = LabelChoice{labels[i].id, {{labels[i].low, labels[i].high}}};
                    const std::unique_ptr<MeshSink> to = sink(labels[i]);
                    done(i, extract(store, own, *to, each, silent));
                    progress.advance(1);
                }
            },
            tbb::simple_partitioner{});
    });
}

ExtractReport extract_interfaces(const Store& store, std::span<const Label> labels,
                                 const LabelQuery& query, MeshSink& sink,
                                 const std::function<void(const LabelInterface&)>& each,
                                 const ExtractOptions& options, Progress& progress) {
    return detail::label_interfaces(store.reader(), labels, query, sink, each, options, progress);
}

}  // namespace isonest
