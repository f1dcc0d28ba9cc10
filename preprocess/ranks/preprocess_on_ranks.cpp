#include "preprocess/ranks/preprocess_on_ranks.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <array>
#include <chrono>
#include <cstdint>
#include <memory>
#include <optional>
#include <random>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include <isonest/error.h>
#include <isonest/field.h>

#include "preprocess/levels/centre_store.h"
#include "preprocess/levels/pass_context.h"
#include "preprocess/levels/run_ends.h"
#include "preprocess/ranks/block_journal.h"
#include "preprocess/ranks/partial_levels.h"
#include "preprocess/ranks/pencils.h"
#include "preprocess/ranks/rank_passes.h"
#include "preprocess/ranks/shared_table.h"
#include "preprocess/sources/wrapping/rounded_source.h"
#include "store/base/label_text.h"
#include "store/base/workers.h"
#include "store/container/codec.h"
#include "store/container/format.h"
#include "store/container/writer.h"
#include "store/files/output_file.h"
#include "store/ranks/agreement.h"

namespace isonest::detail {
namespace {

std::string digest_of(const std::string& text) {
    return fmt::format("{:016x}", checksum_of(std::as_bytes(std::span(text))));
}

/// Everything that determines which values lie where, except the name of the input.
std::string input_text(const VolumeSource& source) {
    const VolumeDescription v = source.describe();
    std::string text = fmt::format(
        "{}\n{} {} {} {} {} {} {} {}\n", source.identity(), v.nodes.x, v.nodes.y, v.nodes.z,
        name_of(v.type), v.labels, v.unit ? static_cast<int>(*v.unit) : -1, name_of(v.frame),
        fmt::format("{} {}", fmt::join(v.spacing, " "), fmt::join(v.origin, " ")));
    for (const Double3& axis : v.direction) {
        text += fmt::format("{}\n", fmt::join(axis, " "));
    }
    for (std::size_t a = 0; v.uneven && a < 3; ++a) {
        text += fmt::format("{}\n", fmt::join(v.uneven->offsets.at(a), " "));
    }
    for (const LabelName& name : source.label_names()) {
        text += fmt::format("{} {}\n", name.id, name.name);
    }
    return text;
}

std::string options_text(const PreprocessOptions& options) {
    return fmt::format("{} {} {} {} {} {} {}", options.chunk, options.compression, options.exact,
                       options.force, options.resume, options.rounding.step,
                       list_names(options.fields)) +
           "\n" + own_identities(options.own);
}

}  // namespace

void require_same_work(Communicator& ranks, const VolumeSource& source,
                       const PreprocessOptions& options) {
    const std::string input = digest_of(input_text(source));
    const std::string chosen = digest_of(options_text(options));
    const std::string other_inputs = who_differs(ranks, input, input);
    const std::string other_choices = who_differs(ranks, chosen, chosen);
    if (!other_inputs.empty()) {
        throw Error(ErrorKind::invalid_argument, {source.describe().name},
                    "the ranks read different inputs; these differ from rank 0: " + other_inputs);
    }
    if (!other_choices.empty()) {
        throw Error(ErrorKind::invalid_argument, {source.describe().name},
                    "the ranks have different options; these differ from rank 0: " + other_choices);
    }
    ranks.meet();
}

namespace {

double seconds_since(std::chrono::steady_clock::time_point start) {
    return std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
}

void require_possible(const Communicator& ranks, const VolumeSource& source) {
    if (ranks.size() > 1 && source.sequential()) {
        throw Error(ErrorKind::unsupported, {source.describe().name},
                    "a compressed stream can only be read from beginning to end, so several ranks "
                    "cannot share it; decompress it first, or use one rank");
    }
}

/// An unused name: ".STORE.ranks-RANK-", random digits, ".blocks".
std::filesystem::path journal_name(const std::filesystem::path& scratch,
                                   const std::filesystem::path& store, int rank) {
    std::random_device device;
    return rank_files_prefix(scratch, store) +=
           fmt::format("{}-{:08x}{:08x}.blocks", rank, device(), device());
}

/// From the first pass to the finished store.
RanksReport run_to_the_end(PassWork& work, VolumeSource& source, const std::filesystem::path& store,
                           const std::filesystem::path& unfinished,
                           std::span<const LabelName> label_names, StoreWriter* writer,
                           std::chrono::steady_clock::time_point start) {
    Communicator& ranks = work.ranks;
    run_rank_passes(work, source);

    RanksReport report;
    report.input_bytes = work.bytes_read;
    report.passes = work.seconds_of_passes;
    gather_rows(ranks, work.layout, work.pencils, work.chunks.rows(), writer);
    if (writer != nullptr) {
        const auto planning = std::chrono::steady_clock::now();
        plan_all_chunks(*writer, work.progress);
        report.alone += seconds_since(planning);
    }
    spread_offsets(ranks, work.layout, work.pencils, work.chunks.rows(), writer);
    const auto writing = std::chrono::steady_clock::now();
    report.store_bytes = work.chunks.write_into(unfinished);
    report.writing = seconds_since(writing);
    gather_cube_ranges(ranks, work.layout, work.pencils, work.centres);
    if (writer == nullptr) {
        // The rest is up to rank 0; once it has this rank's sum, it needs nothing more from it.
        ranks.ignore_stop(true);
    }
    std::array<std::uint64_t, 2> sums{work.input_on_disk ? 1U : 0U, work.resumed_chunks};
    ranks.sum(sums);  // by now all chunks are on disk
    report.whole.input_on_disk = sums[0] > 0;
    report.whole.resumed_chunks = sums[1];
    if (writer != nullptr) {
        const auto ending = std::chrono::steady_clock::now();
        write_cube_ranges(work.centres, *writer);
        if (!label_names.empty()) {
            writer->write_label_names(label_names);
        }
        work.progress.check();
        describe_store(*writer, report.whole);
        report.whole.label_names = label_names.size();
        ranks.ignore_stop(true);
        writer->finish();
        report.alone += seconds_since(ending);
        report.whole.store_bytes = std::filesystem::file_size(store);
    }
    // No rank reports success before the store is finished.
    ranks.meet();
    report.whole.seconds = seconds_since(start);
    return report;
}

}  // namespace

RanksReport preprocess_on_ranks(Communicator& ranks, VolumeSource& volume,
                                const std::filesystem::path& store,
                                const PreprocessOptions& options,
                                const std::filesystem::path& scratch, Progress& progress) {
    const std::unique_ptr<VolumeSource> rounded = rounded_source(volume, options.rounding);
    VolumeSource& source = rounded ? *rounded : volume;
    const auto start = std::chrono::steady_clock::now();
    const bool is_first = ranks.rank() == 0;
    require_same_work(ranks, source, options);
    require_possible(ranks, source);
    require_not_curved(source.describe(), "preprocessing by several processes");
    if (is_first) {
        check_output(store, options.force, source.files());
    }
    require_same_folder(ranks, store);

    const OwnIndicators own(options.own, source.describe());
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

    const std::filesystem::path beside = store.parent_path().empty() ? "." : store.parent_path();
    const ScratchFolder folder(scratch.empty() ? beside : scratch);
    const Pencils pencils(layout, ranks.size());
    CentreStore centres = CentreStore::partial(layout.lattice(), header.fields, folder);
    PartialLevels levels(layout, folder);
    std::optional<EarlierBlocks> earlier;
    std::optional<BlockJournal> journal;
    OwnChunkFile chunks(folder);
    if (options.resume) {
        const std::string identity = identity_of(header, source, options);
        earlier.emplace(folder.path(), store, identity, layout);
        // So that no rank takes the files of this run for old ones.
        ranks.meet();
        journal.emplace(journal_name(folder.path(), store, ranks.rank()), identity, layout,
                        centres);
    }
    PassWork work{ranks,         layout,  pencils, budget, workers,
                  folder.path(), centres, levels,  chunks, progress};
    work.own = own.size() > 0 ? &own : nullptr;
    work.earlier = earlier ? &*earlier : nullptr;
    work.journal = journal ? &*journal : nullptr;
    const auto keep = [&] {
        if (journal) {
            journal->keep();
        }
    };
    try {
        RanksReport report =
            run_to_the_end(work, source, store, unfinished, label_names, table, start);
        if (earlier) {
            earlier->remove();
        }
        return report;
    } catch (const Error& error) {
        keep();
        if (!journal) {
            throw;
        }
        std::vector<Remedy> remedies = error.remedies();
        remedies.push_back({RemedyKind::resume});
        throw Error(error.kind(), error.place(),
                    (error.kind() == ErrorKind::cancelled ? "interrupted" : error.problem()) +
                        "; the finished part is kept",
                    std::move(remedies));
    } catch (...) {
        keep();
        throw;
    }
}

}  // namespace isonest::detail
