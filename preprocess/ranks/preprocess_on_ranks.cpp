#include "preprocess/ranks/preprocess_on_ranks.h"

#include <array>
#include <chrono>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include <isonest/error.h>

#include "preprocess/levels/centre_store.h"
#include "preprocess/levels/pass_budget.h"
#include "preprocess/levels/run_ends.h"
#include "preprocess/ranks/agreement.h"
#include "preprocess/ranks/own_chunk_file.h"
#include "preprocess/ranks/partial_levels.h"
#include "preprocess/ranks/pencils.h"
#include "preprocess/ranks/rank_passes.h"
#include "preprocess/ranks/shared_ranges.h"
#include "preprocess/ranks/shared_table.h"
#include "store/base/workers.h"
#include "store/container/writer.h"
#include "store/files/output_file.h"

namespace isonest::detail {
namespace {

double seconds_since(std::chrono::steady_clock::time_point start) {
    return std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
}

void require_possible(const Communicator& ranks, const VolumeSource& source,
                      const PreprocessOptions& options) {
    if (options.resume) {
        throw Error(ErrorKind::unsupported, {source.describe().name},
                    "going on with an interrupted run is for a run of one process",
                    {{RemedyKind::no_resume}});
    }
    if (ranks.size() > 1 && source.sequential()) {
        throw Error(ErrorKind::unsupported, {source.describe().name},
                    "it can only be read from its beginning to its end, as one compressed stream, "
                    "and so not by several ranks at once; decompress it first, or use one rank");
    }
}

/// Of all ranks, at rank 0. Collective.
std::vector<PreprocessRank> gather_reports(Communicator& ranks, const PreprocessRank& mine) {
    struct Numbers {
        std::array<std::uint64_t, 4> counts;
        std::array<double, 3> seconds;
    };
    const Numbers numbers{{mine.input_bytes, mine.store_bytes, mine.messages_sent, mine.bytes_sent},
                          {mine.computing, mine.messages, mine.writing}};
    std::string text(sizeof(numbers), '\0');
    std::memcpy(text.data(), &numbers, sizeof(numbers));
    std::vector<PreprocessRank> all;
    for (const std::string& one : ranks.gather(text + mine.host)) {
        Numbers n{};
        std::memcpy(&n, one.data(), sizeof(n));
        all.push_back({one.substr(sizeof(n)), n.counts[0], n.counts[1], n.counts[2], n.counts[3],
                       n.seconds[0], n.seconds[1], n.seconds[2]});
    }
    return all;
}

}  // namespace

PreprocessReport preprocess_on_ranks(Communicator& ranks, VolumeSource& source,
                                     const std::filesystem::path& store,
                                     const PreprocessOptions& options,
                                     const std::filesystem::path& scratch, Progress& progress) {
    const auto start = std::chrono::steady_clock::now();
    const bool is_first = ranks.rank() == 0;
    require_same_work(ranks, source, options);
    require_possible(ranks, source, options);
    if (is_first) {
        check_output(store, options.force, source.files());
    }
    require_same_folder(ranks, store);

    StoreHeader header = header_of(source.describe(), options);
    const std::vector<LabelName> label_names = label_names_of(source);
    header.label_names = !label_names.empty();
    const StoreLayout layout(header);
    Workers workers(options.threads);
    const PassBudget budget = share_memory(layout, source, options, workers.count());
    std::optional<StoreWriter> writer;
    if (is_first) {
        writer.emplace(store, header, options.force, ChunkWriting::elsewhere);
    }
    StoreWriter* const table = is_first ? &*writer : nullptr;
    const std::filesystem::path unfinished =
        store.parent_path() /
        ranks.broadcast(is_first ? writer->temporary().filename().string() : "");

    const ScratchFolder folder(scratch.empty() ? store.parent_path() : scratch);
    const Pencils pencils(layout, ranks.size());
    CentreStore centres = CentreStore::partial(layout.lattice(), header.fields, folder);
    PartialLevels levels(layout, folder);
    OwnChunkFile chunks(folder);
    RankWork work{ranks,         layout,  pencils, budget, workers,
                  folder.path(), centres, levels,  chunks, progress};
    run_rank_passes(work, source);

    PreprocessReport report;
    report.nodes = header.nodes;
    PreprocessRank mine;
    gather_rows(ranks, layout, pencils, chunks.rows(), table);
    if (is_first) {
        const auto planning = std::chrono::steady_clock::now();
        plan_all_chunks(*writer);
        report.serial_seconds += seconds_since(planning);
    }
    spread_offsets(ranks, layout, pencils, chunks.rows(), table);
    const auto writing = std::chrono::steady_clock::now();
    mine.store_bytes = chunks.write_into(unfinished);
    mine.writing = seconds_since(writing);
    gather_cube_ranges(ranks, layout, pencils, centres);
    std::array<std::uint64_t, 1> on_disk{work.input_on_disk ? 1U : 0U};
    ranks.sum(on_disk);

    mine.host = ranks.host();
    mine.input_bytes = work.bytes_read;
    mine.messages_sent = ranks.traffic().messages_sent;
    mine.bytes_sent = ranks.traffic().bytes_sent;
    mine.computing = work.seconds_of_passes;
    mine.messages = ranks.traffic().seconds;
    report.ranks = gather_reports(ranks, mine);
    // All chunks are on the disk.
    ranks.meet();
    if (is_first) {
        const auto ending = std::chrono::steady_clock::now();
        write_cube_ranges(centres, *writer);
        if (!label_names.empty()) {
            writer->write_label_names(label_names);
        }
        progress.check();
        describe_store(*writer, report);
        report.label_names = label_names.size();
        report.input_on_disk = on_disk[0] > 0;
        writer->finish();
        report.serial_seconds += seconds_since(ending);
        report.store_bytes = std::filesystem::file_size(store);
    }
    // Nobody says that it is done before it is.
    ranks.meet();
    report.seconds = seconds_since(start);
    return report;
}

}  // namespace isonest::detail
