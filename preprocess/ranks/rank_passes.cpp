#include "preprocess/ranks/rank_passes.h"

#include <fmt/format.h>
#include <oneapi/tbb/task_group.h>

#include <algorithm>
#include <chrono>
#include <functional>
#include <optional>
#include <span>
#include <stdexcept>
#include <vector>

#include <isonest/field.h>
#include <isonest/value_type.h>

#include "preprocess/levels/base_block.h"
#include "preprocess/levels/coarse_block.h"
#include "preprocess/levels/indicator_chunks.h"
#include "preprocess/levels/pass_context.h"
#include "preprocess/ranks/halo.h"
#include "preprocess/ranks/own_chunks.h"
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

/// Completes the rows of a block's chunks, and keeps what coarser levels need of them.
void finish_chunks(const RankWork& work, int pass, const Int3& block,
                   std::vector<EncodedChunk>& chunks) {
    const std::vector<ChunkPlace> expected = chunks_of(work.layout, pass, block);
    const bool same =
        std::equal(chunks.begin(), chunks.end(), expected.begin(), expected.end(),
                   [](const EncodedChunk& chunk, const ChunkPlace& place) {
                       return chunk.array == place.array && chunk.chunk == place.chunk;
                   });
    if (!same) {
        throw std::logic_error("a block makes other chunks than all ranks expect");
    }
    for (EncodedChunk& chunk : chunks) {
        chunk.row.bytes = static_cast<std::uint32_t>(chunk.bytes.size());
        chunk.row.checksum = checksum_of(chunk.bytes);
        work.levels.put(chunk);
    }
}

/// Blocks in parallel; their chunks go to the rank's file in the order of the blocks.
template <class BlockAt>
void run_own_blocks(RankWork& work, int pass, std::int64_t count, const BlockAt& block_at,
                    const RankBlock& compute, std::uint64_t progress_per_block) {
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
            const std::uint64_t offset = work.chunks.end();
            for (EncodedChunk& chunk : chunks) {
                work.chunks.add(chunk);
                chunk.bytes = {};
            }
            if (work.journal != nullptr && pass == kBasePass) {
                work.journal->add(block_at(i), chunks, offset);
            }
            work.progress.advance(progress_per_block);
        });
}

/// Rows and planes of the volume that a box of pencils needs.
VolumePart part_of(const StoreLayout& layout, const PencilBox& box) {
    const std::int64_t k = layout.header().chunk;
    const Int3 nodes = layout.lattice().nodes();
    return {std::clamp<std::int64_t>(2 * k * box.y_begin - kMargin, 0, nodes.y - 1),
            std::clamp<std::int64_t>(2 * k * box.y_end + kMargin + 1, 1, nodes.y),
            base_planes(layout, box.z_begin).first, base_planes(layout, box.z_end - 1).second};
}

/// The blocks of a row that an interrupted run has made.
std::vector<bool> blocks_made(RankWork& work, const Int3& grid, const Int3& first) {
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
void run_box(RankWork& work, VolumeSource& source, const PassContext& context, const PencilBox& box,
             std::uint64_t progress_per_block) {
    const StoreLayout& layout = work.layout;
    std::optional<PlaneWindow> window;
    const Int3 grid{work.pencils.grid(kBasePass).x, box.y_end - box.y_begin, 1};
    for (std::int64_t z = box.z_begin; z < box.z_end; ++z) {
        const Int3 first{0, box.y_begin, z};
        const std::vector<bool> made = blocks_made(work, grid, first);
        tbb::task_group reading;
        if (std::find(made.begin(), made.end(), false) != made.end()) {
            if (!window) {
                window.emplace(source, part_of(layout, box), 2 * layout.header().chunk + 8,
                               work.budget.rest, work.scratch, work.progress);
            }
            const auto [begin, end] = base_planes(layout, z);
            window->load(begin, end);
            if (z + 1 < box.z_end) {
                reading.run([&] { window->prefetch(base_planes(layout, z + 1).second); });
            }
        }
        try {
            run_own_blocks(
                work, kBasePass, grid.product(),
                [&](std::int64_t i) { return grid.unlinear(i) + first; },
                [&](const Int3& block) {
                    return made[static_cast<std::size_t>(grid.linear(block - first))]
                               ? work.earlier->load(block, work.centres)
                               : base_block<T>(context, *window, block);
                },
                progress_per_block);
        } catch (...) {
            try {
                reading.wait();
            } catch (...) {
                // The first failure is the one to report.
            }
            throw;
        }
        reading.wait();
    }
    if (window) {
        work.bytes_read += window->bytes_read();
        work.input_on_disk = work.input_on_disk || window->on_disk();
    }
}

/// Space for the centres, and the ranges of cubes, that the rank's pencils make in a pass.
void reserve_centres(const RankWork& work, int pass, std::span<const Pencil> pencils) {
    const std::int64_t k = work.layout.header().chunk;
    for (const Pencil& p : pencils) {
        if (pass < work.layout.lattice().top()) {
            const std::int64_t n = k / 2;
            work.centres.reserve(pass, p.y * n, (p.y + 1) * n, p.z * n, (p.z + 1) * n);
        }
        if (pass == kBasePass && has_cube_ranges(work.layout.lattice(), kFirstRangeLevel)) {
            const std::int64_t n = cube_ranges_per_block(k);
            work.centres.reserve_cube_ranges(p.y * n, (p.y + 1) * n, p.z * n, (p.z + 1) * n);
        }
    }
}

/// The arrays that blocks of a level read.
std::vector<HaloArray> halo_arrays(const RankWork& work, int level) {
    const StoreLayout& layout = work.layout;
    const std::int64_t k = layout.header().chunk;
    std::vector<HaloArray> arrays;
    const auto add_nodes = [&](const PartialArray& array) {
        arrays.push_back(
            {level - 1, k, array.array().nodes, array.row_bytes(), array.bytes(),
             [&array](std::uint64_t offset, std::uint64_t bytes) { array.reserve(offset, bytes); },
             4, kMargin, kMargin});
    };
    const auto add_centres = [&](int of, Field field, std::int64_t scale, std::int64_t before,
                                 std::int64_t behind) {
        const std::span<std::byte> bytes = std::as_writable_bytes(work.centres.cubes(of, field));
        const auto first = static_cast<std::uint64_t>(bytes.data() - work.centres.bytes().data());
        const Int3 cells = layout.lattice().elements_at(of);
        arrays.push_back(
            {of, k / 2, cells, static_cast<std::uint64_t>(cells.x) * sizeof(float), bytes,
             [&centres = work.centres, first](std::uint64_t offset, std::uint64_t count) {
                 centres.reserve_bytes(first + offset, count);
             },
             scale, before, behind});
    };
    add_nodes(*work.levels.values(level - 2));
    for (const Field field : layout.header().fields) {
        add_centres(level - 1, field, 2, 1, 0);
    }
    if (carries_deviation(layout)) {
        if (level == kBasePass + 1) {
            add_nodes(*work.levels.deviations());
        } else {
            add_centres(level - 2, deviation_carried(layout), 4, kMargin, kMargin);
        }
    }
    return arrays;
}

template <class T>
void run_all_passes(RankWork& work, VolumeSource& source) {
    const StoreLayout& layout = work.layout;
    const int rank = work.ranks.rank();
    const PassContext context{layout, work.centres};
    const auto volume_bytes =
        static_cast<std::uint64_t>(layout.lattice().nodes().product()) * sizeof(T);
    for (int pass = kBasePass; pass <= last_pass(layout); ++pass) {
        const bool is_last = pass > kBasePass && pass == last_pass(layout);
        std::vector<Pencil> pencils;
        if (!is_last) {
            pencils = work.pencils.of(rank, pass);
        } else if (work.pencils.owner(kBasePass, {0, 0}) == rank) {
            pencils = {{0, 0}};
        }
        const std::int64_t nx = is_last ? 1 : work.pencils.grid(pass).x;
        const auto blocks = static_cast<std::uint64_t>(nx) * pencils.size();
        if (pass > kBasePass && !is_last) {
            exchange_halos(work.ranks, layout, work.pencils, pass, halo_arrays(work, pass));
        }
        const PassClock clock(work.seconds_of_passes);
        if (!is_last) {
            work.levels.begin_pass(pass, pencils);
            reserve_centres(work, pass, pencils);
        }
        if (pass == kBasePass) {
            const std::uint64_t per_block = blocks > 0 ? volume_bytes / blocks : 0;
            work.progress.begin("levels 0-2", volume_bytes, "B");
            work.workers.execute([&] {
                for (const PencilBox& box : work.pencils.boxes(rank)) {
                    run_box<T>(work, source, context, box, per_block);
                }
            });
            continue;
        }
        if (!is_last) {
            work.progress.begin(fmt::format("level {}", pass), blocks, "blocks");
        }
        work.workers.execute([&] {
            run_own_blocks(
                work, pass, static_cast<std::int64_t>(blocks),
                [&](std::int64_t i) {
                    const Pencil& p = pencils[static_cast<std::size_t>(i / nx)];
                    return Int3{i % nx, p.y, p.z};
                },
                [&](const Int3& block) {
                    return is_last ? top_values<T>(context, work.levels)
                                   : coarse_block<T>(context, work.levels, pass, block);
                },
                is_last ? 0 : 1);
        });
        work.levels.end_pass(pass);
        if (!is_last) {
            work.centres.release(pass - 2);
        }
    }
}

}  // namespace

void run_rank_passes(RankWork& work, VolumeSource& source) {
    dispatch(work.layout.header().type,
             [&](auto tag) { run_all_passes<typename decltype(tag)::type>(work, source); });
}

}  // namespace isonest::detail
