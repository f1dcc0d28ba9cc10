#include "query/simplify/simplify_mesh.h"

#include <oneapi/tbb/task_arena.h>
#include <tsl/robin_map.h>

#include <algorithm>
#include <optional>
#include <vector>

#include "query/simplify/simplify_patch.h"
#include "store/base/in_order.h"

namespace isonest::detail {
namespace {

/// Fine triangles in a block.
constexpr std::uint32_t kMostInBlock = 1U << 15U;
constexpr int kPasses = 3;

/// A triangle on its way into a block.
struct Sorted {
    ElementCorners corners{};
    std::uint32_t block = 0;
    /// Of the mesh: it has to stay. Of the full surface: it has to be near to what becomes of its
    /// block's triangles.
    std::uint32_t mark = 0;
};

/// A sequence of triangles that grows, and then is sorted by blocks. Not thread-safe.
class BlockTriangles {
  public:
    explicit BlockTriangles(const std::filesystem::path& folder)
        : folder_(folder), file_(folder), sorted_(folder), begin_(folder) {}

    void append(const Sorted& triangle) {
        waiting_.push_back(triangle);
        if (waiting_.size() == kWaiting) {
            flush();
        }
    }
    void append(std::span<const Sorted> triangles) {
        for (const Sorted& t : triangles) {
            append(t);
        }
    }
    /// Sorts what was appended; those of a block stay in their order.
    void sort(std::uint32_t blocks) {
        flush();
        file_.map(count_ * sizeof(Sorted));
        sorted_.map(count_ * sizeof(Sorted));
        begin_.map((std::uint64_t{blocks} + 2) * sizeof(std::uint64_t));
        const auto from = std::span(file_.as<Sorted>()).first(count_);
        const auto to = sorted_.as<Sorted>();
        const auto begin = begin_.as<std::uint64_t>();
        for (const Sorted& t : from) {
            ++begin[t.block + 2];
        }
        for (std::size_t i = 2; i < begin.size(); ++i) {
            begin[i] += begin[i - 1];
        }
        for (const Sorted& t : from) {
            to[begin[t.block + 1]++] = t;
        }
    }
    [[nodiscard]] std::span<const Sorted> of(std::uint32_t block) const {
        const auto begin = begin_.as<const std::uint64_t>();
        return {sorted_.as<Sorted>().data() + begin[block],
                static_cast<std::size_t>(begin[block + 1] - begin[block])};
    }
    [[nodiscard]] std::uint64_t count() const { return count_; }
    [[nodiscard]] std::span<const Sorted> all() const {
        return {sorted_.as<Sorted>().data(), static_cast<std::size_t>(count_)};
    }
    [[nodiscard]] std::uint64_t bytes() const { return 2 * count_ * sizeof(Sorted); }

  private:
    static constexpr std::size_t kWaiting = std::size_t{1} << 14U;
    void flush() {
        file_.write_at(count_ * sizeof(Sorted), std::as_bytes(std::span(waiting_)));
        count_ += waiting_.size();
        waiting_.clear();
    }
    std::filesystem::path folder_;
    ScratchFile file_;
    ScratchFile sorted_;
    ScratchFile begin_;
    std::vector<Sorted> waiting_;
    std::uint64_t count_ = 0;
};

/// The mesh and the full surface, at the beginning of a pass.
struct Pass {
    explicit Pass(const std::filesystem::path& folder) : mesh(folder), fine(folder) {}
    BlockTriangles mesh;
    BlockTriangles fine;
};

/// How many triangles of the mesh have each vertex.
class Valences {
  public:
    Valences(std::uint64_t vertices, std::span<const Sorted> triangles,
             const std::filesystem::path& folder)
        : file_(folder) {
        file_.map(vertices * sizeof(std::uint32_t));
        const auto count = file_.as<std::uint32_t>();
        for (const Sorted& t : triangles) {
            for (const std::uint64_t v : t.corners) {
                ++count[v];
            }
        }
    }
    [[nodiscard]] std::uint32_t of(std::uint64_t vertex) const {
        return file_.as<const std::uint32_t>()[vertex];
    }

  private:
    ScratchFile file_;
};

/// A patch and the numbers of its vertices in the mesh.
struct BlockPatch {
    Patch patch;
    std::vector<std::uint64_t> vertex;
};

BlockPatch patch_of(const ScratchMesh& mesh, const Valences& valences, const Pass& pass,
                    std::uint32_t block) {
    BlockPatch b;
    Patch& patch = b.patch;
    struct Hash {
        std::size_t operator()(std::uint64_t v) const {
            const std::uint64_t h = v * 0x9E3779B97F4A7C15ULL;
            return static_cast<std::size_t>(h ^ (h >> 32U));
        }
    };
    tsl::robin_map<std::uint64_t, std::uint32_t, Hash> place;
    const auto local = [&](const ElementCorners& corners) {
        PatchTriangle t{};
        for (std::size_t i = 0; i < 3; ++i) {
            const auto [slot, is_new] =
                place.try_emplace(corners[i], static_cast<std::uint32_t>(b.vertex.size()));
            t[i] = slot->second;
            if (is_new) {
                b.vertex.push_back(corners[i]);
                patch.positions.push_back(mesh.positions()[corners[i]]);
            }
        }
        return t;
    };
    for (const Sorted& t : pass.mesh.of(block)) {
        patch.triangles.push_back(local(t.corners));
        patch.kept.push_back(t.mark != 0);
    }
    for (const Sorted& t : pass.fine.of(block)) {
        patch.fine.push_back(local(t.corners));
        patch.attached.push_back(t.mark != 0);
    }
    std::vector<std::uint32_t> here(b.vertex.size());
    for (const PatchTriangle& t : patch.triangles) {
        for (const std::uint32_t v : t) {
            ++here[v];
        }
    }
    for (std::size_t v = 0; v < here.size(); ++v) {
        patch.shared.push_back(here[v] > 0 && here[v] != valences.of(b.vertex[v]));
    }
    return b;
}

/// What a block hands on to the next pass.
struct Outcome {
    std::vector<Sorted> mesh;
    std::vector<Sorted> fine;
    double largest = 0;
};

/// `next`: the blocks of the next pass; null after the last.
Outcome outcome_of(const BlockPatch& b, const SimplifiedPatch& simplified, const BlockGrid* next) {
    Outcome outcome;
    outcome.largest = simplified.largest;
    const auto global = [&](const PatchTriangle& t) {
        return ElementCorners{b.vertex[t[0]], b.vertex[t[1]], b.vertex[t[2]]};
    };
    for (std::size_t i = 0; i < simplified.triangles.size(); ++i) {
        const ElementCorners corners = global(simplified.triangles[i]);
        // Once kept, always: nobody looks any more at what is near to it.
        outcome.mesh.push_back({corners, next != nullptr ? next->block_of(corners) : 0,
                                simplified.kept[i] ? 1U : 0U});
    }
    if (next == nullptr) {
        return outcome;
    }
    std::vector<std::uint32_t> blocks;
    for (std::size_t i = 0; i < b.patch.fine.size(); ++i) {
        blocks.clear();
        for (const std::uint32_t server : simplified.servers_of(i)) {
            blocks.push_back(outcome.mesh[server].block);
        }
        std::sort(blocks.begin(), blocks.end());
        blocks.erase(std::unique(blocks.begin(), blocks.end()), blocks.end());
        const bool one = blocks.size() == 1;
        for (const std::uint32_t block : blocks) {
            outcome.fine.push_back({global(b.patch.fine[i]), block, one ? 1U : 0U});
        }
        if (!one) {
            // Nobody will look at it again: those that it is near to stay.
            for (const std::uint32_t server : simplified.servers_of(i)) {
                outcome.mesh[server].mark = 1;
            }
        }
    }
    return outcome;
}

}  // namespace

std::uint64_t simplify_heap() {
    return std::uint64_t{kMostInBlock} * 2 * kSimplifyBytesPerTriangle;
}

SimplifiedMesh::SimplifiedMesh(const ScratchMesh& mesh, const WorldLattice& lattice, double limit,
                               const std::filesystem::path& folder, Progress& progress)
    : corner_file_(folder) {
    std::optional<BlockGrid> grid;
    grid.emplace(lattice, mesh, 0, kMostInBlock, folder, progress);
    std::optional<Pass> pass;
    pass.emplace(folder);
    for (const ElementCorners& corners : mesh.corners()) {
        const Sorted t{corners, grid->block_of(corners), 0};
        pass->mesh.append(t);
        pass->fine.append({t.corners, t.block, 1});
    }
    for (int p = 0; p < kPasses; ++p) {
        std::optional<BlockGrid> after;
        if (p + 1 < kPasses) {
            after.emplace(lattice, mesh, p + 1, kMostInBlock, folder, progress);
        }
        pass->mesh.sort(grid->blocks());
        pass->fine.sort(grid->blocks());
        const Valences valences(mesh.layout().vertices, pass->mesh.all(), folder);
        std::optional<Pass> next;
        next.emplace(folder);
        progress.begin("simplify", pass->mesh.count(), "triangles");
        in_order(
            grid->blocks(), tbb::this_task_arena::max_concurrency() + 1,
            [&](std::int64_t i) {
                progress.check();
                const auto block = static_cast<std::uint32_t>(i);
                const BlockPatch b = patch_of(mesh, valences, *pass, block);
                const Outcome outcome =
                    b.patch.triangles.empty()
                        ? Outcome{}
                        : outcome_of(b, simplify_patch(b.patch, limit), after ? &*after : nullptr);
                progress.advance(b.patch.triangles.size());
                return outcome;
            },
            [&](std::int64_t /*i*/, const Outcome& outcome) {
                next->mesh.append(outcome.mesh);
                next->fine.append(outcome.fine);
                bound_ = std::max(bound_, outcome.largest);
            });
        scratch_bytes_ = std::max(scratch_bytes_, 2 * (pass->mesh.bytes() + pass->fine.bytes()));
        pass = std::move(next);
        grid = std::move(after);
    }
    pass->mesh.sort(1);
    count_ = pass->mesh.count();
    corner_file_.map(count_ * sizeof(ElementCorners));
    const auto all = pass->mesh.all();
    std::transform(all.begin(), all.end(), corner_file_.as<ElementCorners>().begin(),
                   [](const Sorted& t) { return t.corners; });
}

}  // namespace isonest::detail
