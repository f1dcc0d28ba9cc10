#include "preprocess/ranks/rank_passes.h"

#include <fmt/format.h>

#include <algorithm>
#include <chrono>
#include <functional>
#include <optional>
#include <span>
#include <stdexcept>
#include <utility>
#include <vector>

#include <isonest/field.h>
#include <isonest/value_type.h>

#include "preprocess/levels/level_blocks.h"
#include "preprocess/levels/level_sink.h"
#include "preprocess/levels/pass_context.h"
#include "preprocess/ranks/halo.h"
#include "preprocess/ranks/partial_levels.h"
#include "preprocess/ranks/pencils.h"
#include "preprocess/sources/wrapping/plane_window.h"
#include "store/base/in_order.h"
#include "store/container/codec.h"

namespace isonest::detail {
namespace {

using RankBlock = std::function<std::vector<EncodedChunk>(const Int3&)>;

class PassClock {
  public:
    explicit PassClock(double& seconds) : seconds_(seconds) {}
    PassClock(const PassClock&) = delete;
    PassClock& operator=(const PassClock&) = delete;
    ~PassClock() {
        seconds_ +=
            std::chrono::duration<double>(std::chrono::steady_clock::now() - start_).count();
    }

  private:
    double& seconds_;
    std::chrono::steady_clock::time_point start_ = std::chrono::steady_clock::now();
};

/// Completes the rows of a block's chunks, and keeps the parts that coarser levels need.
void finish_chunks(const PassWork& work, int pass, const Int3& block,
                   std::vector<EncodedChunk>& chunks) {
    const std::vector<ChunkPlace> expected = chunks_of(work.layout, pass, block);
    const bool is_kept = pass < last_pass(work.layout) && work.pencils.has_parts(pass);
    const bool same =
        std::equal(chunks.begin(), chunks.end(), expected.begin(), expected.end(),
                   [](const EncodedChunk& chunk, const ChunkPlace& place) {
                       return chunk.array == place.array && chunk.chunk == place.chunk;
                   });
    if (!same) {
        throw std::logic_error("a block produced chunks that the ranks do not expect");
    }
    for (EncodedChunk& chunk : chunks) {
        chunk.row.bytes = static_cast<std::uint32_t>(chunk.bytes.size());
        chunk.row.checksum = checksum_of(chunk.bytes);
        if (!is_kept) {
            work.levels.put(chunk);
        }
    }
}

/// Computes blocks in parallel; `keep` receives their chunks in the order of the blocks.
template <class BlockAt, class Keep>
void run_own_blocks(PassWork& work, int pass, std::int64_t count, const BlockAt& block_at,
                    const RankBlock& compute, const Keep& keep, std::uint64_t progress_per_block) {
    in_order(
        count, work.budget.tokens,
        [&](std::int64_t i) {
            work.progress.check();
            work.ranks.check();
            const Int3 block = block_at(i);
            std::vector<EncodedChunk> chunks = compute(block);
            finish_chunks(work, pass, block, chunks);
            return chunks;
        },
        [&](std::int64_t i, std::vector<EncodedChunk>& chunks) {
            keep(block_at(i), std::span<const EncodedChunk>(chunks));
            work.progress.advance(progress_per_block);
        });
}

/// The same; the chunks go to the rank's file.
template <class BlockAt>
void run_own_blocks(PassWork& work, int pass, std::int64_t count, const BlockAt& block_at,
                    const RankBlock& compute, std::uint64_t progress_per_block) {
    run_own_blocks(
        work, pass, count, block_at, compute,
        [&](const Int3& /*block*/, std::span<const EncodedChunk> chunks) {
            work.chunks.add(chunks);
        },
        progress_per_block);
}

/// Rows and planes of the volume that a box of pencils needs.
VolumePart part_of(const StoreLayout& layout, const PencilBox& box) {
    const std::int64_t k = layout.header().chunk;
    const Int3 nodes = layout.lattice().nodes();
    return {std::clamp<std::int64_t>(2 * k * box.y_begin - kMargin, 0, nodes.y - 1),
            std::clamp<std::int64_t>(2 * k * box.y_end + kMargin + 1, 1, nodes.y),
            base_planes(layout, box.z_begin).first, base_planes(layout, box.z_end - 1).second};
}

/// The blocks of a row that an interrupted run has already made.
std::vector<bool> blocks_made(PassWork& work, const Int3& grid, const Int3& first) {
    std::vector<bool> made(static_cast<std::size_t>(grid.product()));
    for (std::int64_t i = 0; i < grid.product() && work.earlier != nullptr; ++i) {
        const Int3 block = grid.unlinear(i) + first;
        made[static_cast<std::size_t>(i)] = work.earlier->has_whole(block);
        if (made[static_cast<std::size_t>(i)]) {
            work.resumed_chunks += chunks_of(work.layout, kBasePass, block).size();
        }
    }
    return made;
}

template <class T>
void run_box(PassWork& work, VolumeSource& source, const PassContext& context, const PencilBox& box,
             std::uint64_t progress_per_block) {
    const StoreLayout& layout = work.layout;
    std::optional<PlaneWindow> window;
    const Int3 grid{work.pencils.grid(kBasePass).x, box.y_end - box.y_begin, 1};
    for (std::int64_t z = box.z_begin; z < box.z_end; ++z) {
        const Int3 first{0, box.y_begin, z};
        const std::vector<bool> made = blocks_made(work, grid, first);
        bool reads_ahead = false;
        if (std::find(made.begin(), made.end(), false) != made.end()) {
            if (!window) {
                window.emplace(source, part_of(layout, box), 2 * layout.header().chunk + 8,
                               work.budget.rest, work.scratch, work.progress);
            }
            const auto [begin, end] = base_planes(layout, z);
            window->load(begin, end);
            reads_ahead = z + 1 < box.z_end;
        }
        const auto is_made = [&](const Int3& block) {
            return made[static_cast<std::size_t>(grid.linear(block - first))];
        };
        const auto read_ahead = [&] {
            if (reads_ahead) {
                window->prefetch(base_planes(layout, z + 1).second);
            }
        };
        while_reading(read_ahead, [&] {
            run_own_blocks(
                work, kBasePass, grid.product(),
                [&](std::int64_t i) { return grid.unlinear(i) + first; },
                [&](const Int3& block) {
                    return is_made(block) ? work.earlier->load(block, work.centres)
                                          : base_block<T>(context, *window, block);
                },
                [&](const Int3& block, std::span<const EncodedChunk> chunks) {
                    if (is_made(block)) {
                        work.chunks.add(chunks, work.earlier->place_of(block));
                    } else if (work.journal != nullptr) {
                        work.chunks.add(chunks, work.journal->add(block, chunks));
                    } else {
                        work.chunks.add(chunks);
                    }
                },
                progress_per_block);
        });
    }
    if (window) {
        work.bytes_read += window->bytes_read();
        work.input_on_disk = work.input_on_disk || window->on_disk();
    }
}

/// Reserves space for the centres and the ranges of cubes that the rank's pencils make in a pass.
void reserve_centres(const PassWork& work, int pass, std::span<const Pencil> pencils,
                     std::int64_t cells) {
    for (const Pencil& p : pencils) {
        if (pass < work.layout.lattice().top()) {
            work.centres.reserve(pass, p.y * cells, (p.y + 1) * cells, p.z * cells,
                                 (p.z + 1) * cells);
        }
        if (pass == kBasePass && has_cube_ranges(work.layout.lattice(), kFirstRangeLevel)) {
            const std::int64_t n = cube_ranges_per_block(work.layout.header().chunk);
            work.centres.reserve_cube_ranges(p.y * n, (p.y + 1) * n, p.z * n, (p.z + 1) * n);
        }
    }
}

/// The rows of nodes that pencils of a pass make.
HaloArray node_rows(const PartialArray& array, const PencilCut& made, std::int64_t rows) {
    HaloArray halo;
    halo.made = made;
    halo.rows = rows;
    halo.size = array.array().nodes;
    halo.row_bytes = array.row_bytes();
    halo.element = array.array().codec.element_size;
    halo.bytes = array.bytes();
    halo.reserve = [&array](std::uint64_t offset, std::uint64_t bytes) {
        array.reserve(offset, bytes);
    };
    return halo;
}

/// The arrays that the cubes of a level read.
std::vector<HaloArray> halo_arrays(const PassWork& work, int level) {
    const StoreLayout& layout = work.layout;
    std::vector<HaloArray> arrays;
    const auto add = [&](HaloArray halo, std::int64_t scale, std::int64_t before,
                         std::int64_t behind) {
        halo.scale = scale;
        halo.before = before;
        halo.behind = behind;
        arrays.push_back(std::move(halo));
    };
    const auto centres = [&](int of, Field field) {
        const std::span<std::byte> bytes = std::as_writable_bytes(work.centres.cubes(of, field));
        const auto first = static_cast<std::uint64_t>(bytes.data() - work.centres.bytes().data());
        HaloArray halo;
        halo.made = work.pencils.part_cut(of);
        halo.rows = halo.made.cells;
        halo.size = layout.lattice().elements_at(of);
        halo.row_bytes = static_cast<std::uint64_t>(halo.size.x) * sizeof(float);
        halo.element = sizeof(float);
        halo.bytes = bytes;
        halo.reserve = [&store = work.centres, first](std::uint64_t offset, std::uint64_t count) {
            store.reserve_bytes(first + offset, count);
        };
        return halo;
    };
    const PencilCut finer = work.pencils.part_cut(level - 1);
    add(node_rows(*work.levels.values(level - 2), finer, 2 * finer.cells), 4, kCoarseMargin,
        kCoarseMargin);
    for (const Field field : layout.header().fields) {
        add(centres(level - 1, field), 2, 1, 0);
    }
    if (carries_deviation(layout)) {
        // Of the cubes that follow, only those that begin less than the margin away.
        add(level == kBasePass + 1 ? node_rows(*work.levels.deviations(), finer, 2 * finer.cells)
                                   : centres(level - 2, deviation_carried(layout)),
            4, kCoarseMargin, kCoarseMargin - 1);
    }
    return arrays;
}

/// The arrays from which the chunks of a pass in parts are assembled.
std::vector<HaloArray> part_arrays(const PassWork& work, int pass) {
    const PencilCut cut = work.pencils.part_cut(pass);
    std::vector<HaloArray> arrays;
    const auto add = [&](const PartialArray& array, std::int64_t scale) {
        HaloArray& halo = arrays.emplace_back(node_rows(array, cut, scale * cut.cells));
        halo.scale = scale;
        halo.behind = -1;
    };
    add(*work.levels.values(pass - 1), 2);
    for (const auto& array : work.levels.indicators()) {
        add(*array, 1);
    }
    return arrays;
}

template <class T>
void run_base(PassWork& work, VolumeSource& source, const PassContext& context) {
    const PencilCut cut = work.pencils.part_cut(kBasePass);
    const std::vector<Pencil> pencils = work.pencils.of(work.ranks.rank(), cut);
    const auto volume_bytes =
        static_cast<std::uint64_t>(work.layout.lattice().nodes().product()) * sizeof(T);
    const auto blocks = static_cast<std::uint64_t>(cut.grid.x) * pencils.size();
    const PassClock clock(work.seconds_of_passes);
    work.levels.begin_pass(kBasePass, pencils, cut.cells, false);
    reserve_centres(work, kBasePass, pencils, cut.cells);
    work.progress.begin("levels 0-2", volume_bytes, "B");
    work.workers.execute([&] {
        for (const PencilBox& box : work.pencils.boxes(work.ranks.rank())) {
            run_box<T>(work, source, context, box, blocks > 0 ? volume_bytes / blocks : 0);
        }
    });
}

/// A level >= 3.
template <class T>
void run_level_pass(PassWork& work, const PassContext& context, int pass) {
    const bool in_parts = work.pencils.has_parts(pass);
    const PencilCut cut = work.pencils.part_cut(pass);
    const PencilCut chunk_cut = work.pencils.chunk_cut(pass);
    const int rank = work.ranks.rank();
    exchange_halos(work.ranks, work.pencils, cut, halo_arrays(work, pass));
    const std::vector<Pencil> parts = work.pencils.of(rank, cut);
    const std::vector<Pencil> chunks = in_parts ? work.pencils.of(rank, chunk_cut) : parts;
    const auto block_at = [&](const std::vector<Pencil>& pencils, std::int64_t i) {
        const Pencil& p = pencils[static_cast<std::size_t>(i / cut.grid.x)];
        return Int3{i % cut.grid.x, p.y, p.z};
    };
    const auto blocks = [&](const std::vector<Pencil>& pencils) {
        return static_cast<std::int64_t>(pencils.size()) * cut.grid.x;
    };
    std::optional<PassClock> clock(std::in_place, work.seconds_of_passes);
    work.levels.begin_pass(pass, parts, cut.cells, in_parts);
    reserve_centres(work, pass, parts, cut.cells);
    work.progress.begin(fmt::format("level {}", pass), static_cast<std::uint64_t>(blocks(parts)),
                        "blocks");
    if (in_parts) {
        const Int3 count{chunk_cut.cells, cut.cells, cut.cells};
        work.workers.execute([&] {
            in_order(
                blocks(parts), work.budget.tokens,
                [&](std::int64_t i) {
                    work.progress.check();
                    work.ranks.check();
                    const Int3 at = block_at(parts, i);
                    compute_part<T>(context, work.levels, pass,
                                    {at.x * count.x, at.y * count.y, at.z * count.z}, count);
                    return std::uint64_t{1};
                },
                [&](std::int64_t /*part*/, std::uint64_t blocks_done) {
                    work.progress.advance(blocks_done);
                });
        });
        clock.reset();
        exchange_halos(work.ranks, work.pencils, chunk_cut, part_arrays(work, pass));
        clock.emplace(work.seconds_of_passes);
    }
    work.workers.execute([&] {
        run_own_blocks(
            work, pass, blocks(chunks), [&](std::int64_t i) { return block_at(chunks, i); },
            [&](const Int3& block) {
                return in_parts ? assemble_block<T>(work.layout, work.levels, pass, block)
                                : coarse_block<T>(context, work.levels, pass, block);
            },
            in_parts ? 0 : 1);
    });
    work.levels.end_pass(pass);
    work.centres.release(pass - 2);
}

template <class T>
void run_all_passes(PassWork& work, VolumeSource& source) {
    const StoreLayout& layout = work.layout;
    const PassContext context{layout, work.centres, work.own};
    run_base<T>(work, source, context);
    const int last = last_pass(layout);
    for (int pass = kBasePass + 1; pass < last; ++pass) {
        run_level_pass<T>(work, context, pass);
    }
    if (last > kBasePass && work.pencils.owner(kBasePass, {0, 0}) == work.ranks.rank()) {
        const PassClock clock(work.seconds_of_passes);
        work.workers.execute([&] {
            run_own_blocks(
                work, last, 1,
                [](std::int64_t /*block*/) {
                    return Int3{0, 0, 0};
                },
                [&](const Int3& /*block*/) { return top_values<T>(context, work.levels); }, 0);
        });
    }
}

}  // namespace

void run_rank_passes(PassWork& work, VolumeSource& source) {
    dispatch(work.layout.header().type,
             [&](auto tag) { run_all_passes<typename decltype(tag)::type>(work, source); });
}

}  // namespace isonest::detail
