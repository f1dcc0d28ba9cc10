// The flow of every extraction:
//
//     what is extracted -> parts          query/extract/find_parts.h
//     parts             -> mesh in a sink query/extract/extraction.h
#include "query/extract/run_extraction.h"

#include <algorithm>
#include <chrono>
#include <vector>

#include "query/extract/analysis/extract_analysed.h"
#include "query/extract/extract_on_ranks.h"
#include "query/extract/extraction.h"
#include "query/extract/find_parts.h"
#include "query/mesh/measuring_sink.h"
#include "store/base/workers.h"

namespace isonest::detail {
namespace {

using Clock = std::chrono::steady_clock;

std::vector<double> isovalues_of(std::span<const std::unique_ptr<Extraction>> extractions) {
    std::vector<double> isovalues;
    for (const auto& e : extractions) {
        isovalues.push_back(e->asked().traversal.iso);
    }
    return isovalues;
}

/// Of several isovalues, with one traversal for all of them.
void run_together(std::span<const std::unique_ptr<Extraction>> extractions,
                  const StoreReader& store, const ExtractOptions& options, Progress& progress,
                  const std::function<void(std::size_t, const ExtractReport&)>& done) {
    const auto start = Clock::now();
    for (const auto& e : extractions) {
        e->prepare({store.path()});
    }
    const ExtractQuery& asked = extractions.front()->asked();
    const TraversalBudget budget = parts_budget(store, asked, options, extractions.size());
    // While stages work on one mesh, which have all of the memory, the other parts wait.
    const bool has_room = extractions.size() == 1 || !asked.stages.any();
    RankTeam* const team = is_shared(asked) ? options.team : nullptr;
    if (team != nullptr) {
        begin_shared_traversal(*team, store, asked, isovalues_of(extractions));
    }
    std::vector<FoundParts> found;
    Workers(budget.threads).execute([&] {
        for (const auto& e : extractions) {
            found.push_back(e->begin_parts(has_room ? budget.parts / extractions.size() : 0));
        }
        find_parts(store, asked, budget, found, extractions.front()->scratch(), progress, team);
    });
    for (std::size_t i = 0; i < extractions.size(); ++i) {
        if (found[i].stay) {
            begin_shared_mesh(*team, i);
        }
        ExtractReport report = found[i].stay ? extractions[i]->finish_on_ranks(budget)
                                             : extractions[i]->finish(budget);
        report.seconds = std::chrono::duration<double>(Clock::now() - start).count();
        done(i, report);
    }
}

/// From a kept analysis, if there is to be one and it is fine enough; else from the store.
ExtractReport extracted(const StoreReader& store, ExtractQuery asked, MeshSink& sink,
                        const ExtractOptions& options, Progress& progress) {
    const bool is_analysed = asked.analysis_folder && asked.stages.simplifies();
    if (is_analysed) {
        if (std::optional<ExtractReport> report =
                extract_analysed(store, asked, sink, options, progress)) {
            return *report;
        }
    }
    ExtractReport report;
    const auto one = std::make_unique<Extraction>(store, std::move(asked), sink, options, progress);
    run_together({&one, 1}, store, options, progress,
                 [&](std::size_t, const ExtractReport& r) { report = r; });
    if (is_analysed) {
        report.analysis.emplace();
    }
    return report;
}

}  // namespace

ExtractReport run_extraction(const StoreReader& store, ExtractQuery asked, MeshSink& sink,
                             const ExtractOptions& options, Progress& progress) {
    if (asked.corners() != 3) {
        return extracted(store, std::move(asked), sink, options, progress);
    }
    MeasuringSink measuring(sink, options.quality);
    ExtractReport report = extracted(store, std::move(asked), measuring, options, progress);
    measuring.report(report);
    return report;
}

void run_extractions(const StoreReader& store, const ExtractQuery& asked,
                     std::span<const double> isovalues,
                     const std::function<std::unique_ptr<MeshSink>(std::size_t)>& sink,
                     const std::function<void(std::size_t, const ExtractReport&)>& done,
                     const ExtractOptions& options, Progress& progress) {
    const std::uint64_t most = isovalues_at_once(store, asked.traversal, asked.values,
                                                 options.memory, options.threads, isovalues.size());
    for (std::size_t first = 0; first < isovalues.size(); first += most) {
        const auto some =
            isovalues.subspan(first, std::min<std::size_t>(most, isovalues.size() - first));
        std::vector<std::unique_ptr<MeshSink>> sinks;
        std::vector<std::unique_ptr<MeasuringSink>> measuring(some.size());
        std::vector<std::unique_ptr<Extraction>> extractions;
        for (std::size_t i = 0; i < some.size(); ++i) {
            ExtractQuery own = asked;
            own.traversal.iso = some[i];
            sinks.push_back(sink(first + i));
            if (asked.corners() == 3) {
                measuring[i] = std::make_unique<MeasuringSink>(*sinks[i], options.quality);
            }
            extractions.push_back(std::make_unique<Extraction>(
                store, std::move(own), measuring[i] ? *measuring[i] : *sinks[i], options,
                progress));
        }
        run_together(extractions, store, options, progress,
                     [&](std::size_t i, ExtractReport report) {
                         if (measuring[i]) {
                             measuring[i]->report(report);
                         }
                         sinks[i].reset();
                         done(first + i, report);
                     });
    }
}

}  // namespace isonest::detail
