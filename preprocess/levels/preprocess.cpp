#include <fmt/format.h>

#include <algorithm>
#include <chrono>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include <isonest/error.h>
#include <isonest/preprocess.h>

#include "preprocess/levels/centre_store.h"
#include "preprocess/levels/level_blocks.h"
#include "preprocess/levels/level_sink.h"
#include "preprocess/levels/pass_context.h"
#include "preprocess/levels/resume.h"
#include "preprocess/levels/run_ends.h"
#include "preprocess/levels/write_positions.h"
#include "preprocess/sources/wrapping/plane_window.h"
#include "preprocess/sources/wrapping/rounded_source.h"
#include "store/base/in_order.h"
#include "store/base/workers.h"
#include "store/container/format.h"
#include "store/container/writer.h"
#include "store/files/output_file.h"

namespace isonest {
using namespace detail;
namespace {

using Block = std::function<std::vector<EncodedChunk>(const Int3&)>;

/// Destination of a run's results.
struct Outputs {
    StoreWriter& writer;
    RunJournal& journal;
    CentreStore& centres;

    void write(const EncodedChunk& chunk) const {
        const StoreLayout& layout = writer.layout();
        writer.write_chunk(*chunk.array, chunk.chunk, chunk.bytes, chunk.row);
        journal.chunk(static_cast<std::size_t>(chunk.array - layout.arrays().data()),
                      chunk.array->grid.linear(chunk.chunk), writer.row(*chunk.array, chunk.chunk));
    }
    void complete(int level, std::int64_t rows) const {
        const int chunk = writer.layout().header().chunk;
        journal.checkpoint({level, rows, checkpoint_checksum(centres, chunk, level, rows),
                            level == 2 ? ranges_checksum(centres, chunk, rows) : 0});
    }
};

/// Computes blocks in parallel and writes their chunks in the order of the blocks, so that the
/// bytes are the same for any number of threads.
void run_blocks(const Int3& grid, int tokens, const Block& compute, const Outputs& outputs,
                Progress& progress, std::uint64_t bytes_per_block) {
    in_order(
        grid.product(), tokens,
        [&](std::int64_t i) {
            progress.check();
            return compute(grid.unlinear(i));
        },
        [&](std::int64_t /*block*/, std::vector<EncodedChunk>& chunks) {
            for (EncodedChunk& chunk : chunks) {
                outputs.write(chunk);
                chunk.bytes = {};
            }
            progress.advance(bytes_per_block);
        });
}

/// `done`: what is already complete.
template <class T>
void run_levels(const Outputs& outputs, const OwnIndicators& own, PlaneWindow& window,
                const Checkpoint& done, const PassBudget& budget, Progress& progress) {
    const StoreLayout& layout = outputs.writer.layout();
    const Lattice& lattice = layout.lattice();
    const PassContext context{layout, outputs.centres, own.size() > 0 ? &own : nullptr};
    const Int3 grid = base_grid(layout);
    const auto volume_bytes = static_cast<std::uint64_t>(lattice.nodes().product()) * sizeof(T);
    const std::uint64_t per_block = volume_bytes / static_cast<std::uint64_t>(grid.product());
    const std::int64_t first = done.level > 2 ? grid.z : done.rows;
    progress.begin("levels 0-2", volume_bytes, "B");
    progress.advance(per_block * static_cast<std::uint64_t>(first * grid.x * grid.y));
    for (std::int64_t z = first; z < grid.z; ++z) {
        const auto [begin, end] = base_planes(layout, z);
        window.load(begin, end);
        const auto read_ahead = [&] {
            if (z + 1 < grid.z) {
                window.prefetch(base_planes(layout, z + 1).second);
            }
        };
        while_reading(read_ahead, [&] {
            run_blocks(
                {grid.x, grid.y, 1}, budget.tokens,
                [&](const Int3& b) {
                    return base_block<T>(context, window, {b.x, b.y, z});
                },
                outputs, progress, per_block);
        });
        outputs.complete(2, z + 1);
    }
    CachedLevels finer(outputs.writer, budget.cache(window.heap()));
    for (int level = std::max(3, done.level + 1); level <= lattice.top(); ++level) {
        const Int3 blocks = coarse_grid(layout, level);
        progress.begin(fmt::format("level {}", level), static_cast<std::uint64_t>(blocks.product()),
                       "blocks");
        run_blocks(
            blocks, budget.tokens,
            [&](const Int3& b) { return coarse_block<T>(context, finer, level, b); }, outputs,
            progress, 1);
        outputs.complete(level, 0);
        outputs.centres.release(level - 2);
    }
    if (lattice.top() >= 2) {
        for (const EncodedChunk& chunk : top_values<T>(context, finer)) {
            outputs.write(chunk);
        }
    }
}

/// Takes over the results of an interrupted run, if there is one. `worth_keeping` becomes true once
/// that run's files are removed, or if there are none.
Checkpoint take_over(const std::filesystem::path& store, const std::string& identity,
                     VolumeSource& source, const Outputs& outputs, PreprocessReport& report,
                     bool& worth_keeping, Progress& progress) {
    worth_keeping = false;
    std::optional<InterruptedRun> before = InterruptedRun::find(store, identity);
    Checkpoint done;
    if (before) {
        done = before->replay(outputs.writer, outputs.centres, outputs.journal, progress);
        report.resumed_chunks = before->chunks();
        require_same_values(source, outputs.writer, done);
        before->remove();
    }
    worth_keeping = true;
    return done;
}

}  // namespace

PreprocessReport preprocess(VolumeSource& volume, const std::filesystem::path& store,
                            const PreprocessOptions& options, Progress& progress) {
    const std::unique_ptr<VolumeSource> rounded = rounded_source(volume, options.rounding);
    VolumeSource& source = rounded ? *rounded : volume;
    const auto start = std::chrono::steady_clock::now();
    check_output(store, options.force, source.files());
    Workers workers(options.threads);
    StoreHeader header = header_of(source.describe(), options);
    const std::vector<LabelName> label_names = label_names_of(source);
    header.label_names = !label_names.empty();
    const OwnIndicators own(options.own, source.describe());
    const PassBudget budget = share_memory(StoreLayout(header), source, options, workers.count());
    StoreWriter writer(store, header, options.force);
    const StoreLayout& layout = writer.layout();
    const std::string identity = identity_of(header, source, options);
    RunJournal journal(writer.temporary(), identity);
    CentreStore centres(layout.lattice(), header.fields, centres_name(writer.temporary()));
    const Outputs outputs{writer, journal, centres};

    PreprocessReport report;
    bool worth_keeping = false;
    const auto run = [&] {
        Checkpoint done;
        if (options.resume) {
            done = take_over(store, identity, source, outputs, report, worth_keeping, progress);
        }
        {
            const std::int64_t planes = 2 * layout.header().chunk + 8;
            PlaneWindow window(source, planes, budget.rest, store.parent_path(), progress);
            report.input_on_disk = window.on_disk();
            dispatch(header.type, [&](auto tag) {
                run_levels<typename decltype(tag)::type>(outputs, own, window, done, budget,
                                                         progress);
            });
        }
        if (header.curved) {
            report.curved = std::make_shared<const CurvedNodes>(
                write_positions(*source.describe().curved, writer, options.memory - budget.fixed,
                                budget.tokens, store.parent_path(), progress));
        }
        write_cube_ranges(centres, writer);
        if (!label_names.empty()) {
            writer.write_label_names(label_names);
        }
        progress.check();
    };
    const auto keep = [&] {
        if (!worth_keeping || journal.checkpoints() == 0) {
            return false;
        }
        writer.keep();
        journal.keep();
        centres.keep();
        return true;
    };
    try {
        workers.execute(run);
        describe_store(writer, report);
        report.label_names = label_names.size();
        writer.finish();
    } catch (const Error& error) {
        if (keep()) {
            const bool cancelled = error.kind() == ErrorKind::cancelled;
            std::vector<Remedy> remedies = error.remedies();
            remedies.push_back({RemedyKind::resume});
            throw Error(error.kind(), error.place(),
                        (cancelled ? "interrupted" : error.problem()) +
                            "; the finished part is kept beside the store",
                        std::move(remedies));
        }
        throw;
    } catch (...) {
        keep();
        throw;
    }
    report.store_bytes = std::filesystem::file_size(store);
    report.seconds =
        std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
    return report;
}

}  // namespace isonest
