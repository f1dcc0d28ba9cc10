#include "query/simplify/simplify_mesh.h"

#include <oneapi/tbb/task_arena.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>
#include <optional>
#include <vector>

#include "query/mesh/vertex_stars.h"
#include "query/simplify/block_files.h"
#include "query/simplify/proof/point_triangle.h"
#include "query/simplify/simplify_patch.h"
#include "store/base/in_order.h"

namespace isonest::detail {
namespace {

using Point = std::array<float, 3>;

/// One of the six neighbours of a position, one unit in the last place away.
Point neighbour(const Point& p, std::size_t direction) {
    constexpr float kFar = std::numeric_limits<float>::infinity();
    Point q = p;
    const std::size_t axis = direction / 2 % 3;
    q[axis] = std::nextafterf(p[axis], direction % 2 == 0 ? kFar : -kFar);
    return q;
}

}  // namespace

void MovedVertices::add(Copies& copies) {
    copies.seal();
    mesh_.add_copies(copies.all());
    for (const ScratchMesh::MovedCopy& copy : copies.all()) {
        origins_.append(copy.of);
    }
    origins_.seal();
}

double MovedVertices::give_own_places(std::span<std::uint64_t> vertices, double most) {
    constexpr std::size_t kMaxRounds = 8;
    const auto at = mesh_.changeable_positions();
    double moved = 0;
    for (std::size_t round = 0; round < kMaxRounds; ++round) {
        std::sort(vertices.begin(), vertices.end(), [&](std::uint64_t a, std::uint64_t b) {
            return at[a] != at[b] ? at[a] < at[b] : a < b;
        });
        double furthest = 0;
        std::size_t same = 0;  // number of previous vertices at the same place
        Point place{};
        for (std::size_t i = 0; i < vertices.size(); ++i) {
            const std::uint64_t v = vertices[i];
            same = i > 0 && at[v] == place ? same + 1 : 0;
            place = at[v];
            if (same == 0 || v < first_) {
                continue;
            }
            const Point to = neighbour(place, round + same - 1);
            const double by = length(minus(point_at(place), point_at(to)));
            if (moved + by <= most) {
                at[v] = to;
                furthest = std::max(furthest, by);
            }
        }
        if (furthest == 0) {
            break;
        }
        moved += furthest;
    }
    return moved;
}

namespace {

/// Full triangles per block.
constexpr std::uint32_t kMaxFineInBlock = 1U << 15U;
constexpr int kPassesWithin = 3;

// Marks of triangles of the mesh.
constexpr std::uint16_t kForever = 1;  ///< it must be kept
constexpr std::uint16_t kTried = 2;    ///< Patch::tried

/// Numbers from here on are an outcome's own vertices.
constexpr std::uint64_t kOwn = std::uint64_t{1} << 63U;

/// A triangle of the mesh to be sorted into a block of the next pass.
struct MeshTriangle {
    ElementCorners corners{};
    std::uint32_t block = 0;
    std::uint16_t mark = 0;
    Displacement displacement;
};

/// A triangle of the full surface.
class FineTriangle {
  public:
    FineTriangle() = default;
    /// `witness`: as in the patch of the block.
    FineTriangle(std::uint64_t place, std::uint32_t witness)
        : low_(static_cast<std::uint32_t>(place)),
          high_(static_cast<std::uint32_t>(place >> kLow)),
          witness_(witness) {}
    [[nodiscard]] std::uint64_t place() const { return std::uint64_t{high_} << kLow | low_; }
    [[nodiscard]] std::uint32_t witness() const { return witness_; }

  private:
    static constexpr unsigned kLow = 32;
    std::uint32_t low_ = 0;
    std::uint32_t high_ = 0;
    std::uint32_t witness_ = kNoWitness;
};
static_assert(sizeof(FineTriangle) == 12);

/// A full triangle that is near triangles of several blocks: none of these alone can ensure that it
/// stays so. So they are kept while they are in several blocks.
struct Split {
    static constexpr std::size_t kMax = 4;
    std::uint64_t place = 0;
    std::uint64_t count = 0;
    std::array<ElementCorners, kMax> witnesses{};
};

/// A full triangle whose witnesses are in one block.
struct Attached {
    std::uint64_t place = 0;
    std::uint32_t witness = 0;  ///< in the outcome's mesh, one of them
    bool is_only = true;        ///< there is no other witness
};

/// What a block passes on to the next pass.
struct Outcome {
    std::vector<MeshTriangle> mesh;
    std::vector<ScratchMesh::MovedCopy> moved;  ///< vertices, numbered from kOwn
    std::vector<Attached> attached;
    std::vector<Split> splits;
    double largest = 0;

    /// Numbers the outcome's own vertices, starting with this number.
    void number_from(std::uint64_t first) {
        const auto number = [&](ElementCorners& corners) {
            for (std::uint64_t& v : corners) {
                v = v >= kOwn ? v - kOwn + first : v;
            }
        };
        for (MeshTriangle& t : mesh) {
            number(t.corners);
        }
        for (Split& split : splits) {
            std::for_each_n(split.witnesses.begin(), split.count, number);
        }
    }
};

/// The distance between consecutive float32 numbers at the volume's largest coordinates.
double unit_of(const WorldLattice& lattice) {
    double most = 0;
    for (int axis = 0; axis < 3; ++axis) {
        most =
            std::max(most, largest_coordinate(lattice.nodes, lattice.steps, lattice.origin, axis));
    }
    const auto largest = static_cast<float>(most);
    return static_cast<double>(std::nextafterf(largest, std::numeric_limits<float>::infinity()) -
                               largest);
}

}  // namespace

std::uint64_t simplify_heap() {
    return std::uint64_t{kMaxFineInBlock} * 2 * kSimplifyBytesPerTriangle;
}

/// A block of a run.
struct MeshSimplifier::Block {
    BlockPatch numbered;
    std::vector<std::uint64_t> full;  ///< indices of full triangles

    /// `next`: the blocks of the next pass.
    [[nodiscard]] Outcome outcome(const SimplifiedPatch& simplified, const BlockGrid& next,
                                  const MovedVertices& vertices) const;
};

Outcome MeshSimplifier::Block::outcome(const SimplifiedPatch& simplified, const BlockGrid& next,
                                       const MovedVertices& vertices) const {
    Outcome outcome;
    outcome.largest = simplified.largest;
    std::vector<std::uint64_t> number = numbered.vertex;
    std::vector<std::array<float, 3>> positions = numbered.patch.positions;
    for (const SimplifiedPatch::Moved& moved : simplified.moved) {
        outcome.moved.push_back({moved.to, vertices.origin_of(number[moved.vertex])});
        number[moved.vertex] = kOwn + outcome.moved.size() - 1;
        positions[moved.vertex] = moved.to;
    }
    for (std::size_t i = 0; i < simplified.triangles.size(); ++i) {
        const PatchTriangle& t = simplified.triangles[i];
        const auto mark = static_cast<std::uint16_t>((simplified.kept[i] ? kForever : 0) |
                                                     (simplified.tried[i] ? kTried : 0));
        outcome.mesh.push_back({{number[t[0]], number[t[1]], number[t[2]]},
                                next.block_of({positions[t[0]], positions[t[1]], positions[t[2]]}),
                                mark,
                                simplified.displacements[i]});
    }
    for (std::size_t i = 0; i < full.size(); ++i) {
        const auto witnesses = simplified.witnesses_of(i);
        if (witnesses.empty()) {
            continue;
        }
        const std::uint32_t block = outcome.mesh[witnesses.front()].block;
        if (std::all_of(witnesses.begin(), witnesses.end(),
                        [&](std::uint32_t s) { return outcome.mesh[s].block == block; })) {
            outcome.attached.push_back({full[i], witnesses.front(), witnesses.size() == 1});
        } else if (witnesses.size() <= Split::kMax) {
            Split split{full[i], witnesses.size(), {}};
            std::transform(witnesses.begin(), witnesses.end(), split.witnesses.begin(),
                           [&](std::uint32_t s) { return outcome.mesh[s].corners; });
            outcome.splits.push_back(split);
        } else {
            // It cannot be checked again, so the triangles near it are kept forever.
            for (const std::uint32_t s : witnesses) {
                outcome.mesh[s].mark |= kForever;
            }
        }
    }
    return outcome;
}

struct MeshSimplifier::Run {
    explicit Run(const ScratchFolder& folder)
        : mesh(folder),
          whole(folder),
          full(folder),
          held(folder),
          splits(folder),
          in_block(folder) {}
    /// `blocks`: number of blocks into which they will be sorted.
    void begin(std::uint32_t blocks) {
        in_block.map(std::uint64_t{blocks} * sizeof(std::uint32_t));
    }
    void add(const Outcome& outcome);
    /// `grid`: of the blocks of the next pass.
    void add(const Split& split, const BlockGrid& grid);
    /// Declares that a block will not be read any more. REQUIRES: !is_full.
    void consume(std::uint32_t block) {
        mesh.consume(block);
        full.consume(block);
    }

    /// The mesh is the full surface, or a sample of it: only `whole` is used.
    bool is_full = false;
    std::uint64_t triangles = 0;  ///< of the mesh
    BlockItems<PackedTriangle> mesh;
    BlockRuns whole;
    BlockItems<FineTriangle> full;
    BlockTriangles held;  ///< triangles of the mesh to be kept in the next pass
    GrowingFile<Split> splits;
    ScratchFile in_block;  ///< number of triangles of the mesh in each block so far
    int third = 0;         ///< shift of the blocks into which they are sorted next
    double bound = 0;
};

void MeshSimplifier::Run::add(const Outcome& outcome) {
    const auto count = in_block.as<std::uint32_t>();
    std::vector<std::uint32_t> place;
    for (const MeshTriangle& t : outcome.mesh) {
        place.push_back(count[t.block]++);
        mesh.append({t.corners, t.mark, t.displacement}, t.block);
    }
    triangles += outcome.mesh.size();
    for (const Attached& t : outcome.attached) {
        full.append({t.place, place[t.witness] | (t.is_only ? 0U : kWithOthers)},
                    outcome.mesh[t.witness].block);
    }
}

void MeshSimplifier::Run::add(const Split& split, const BlockGrid& grid) {
    const auto witnesses = std::span(split.witnesses).first(split.count);
    const std::uint32_t block = grid.block_of(witnesses.front());
    if (std::all_of(witnesses.begin(), witnesses.end(),
                    [&](const ElementCorners& s) { return grid.block_of(s) == block; })) {
        full.append({split.place, kSomeWitnesses}, block);
        return;
    }
    splits.append(split);
    for (const ElementCorners& witness : witnesses) {
        const std::uint32_t of = grid.block_of(witness);
        held.append({witness, of, 0});
        full.append({split.place, kNoWitness}, of);
    }
}

MeshSimplifier::MeshSimplifier(ScratchMesh& mesh, const CornerView& triangles,
                               const WorldLattice& lattice, const PatchBox& box,
                               ScratchFolder folder, Progress& progress)
    : mesh_(mesh),
      moved_(mesh, folder),
      triangles_(triangles),
      unit_(unit_of(lattice)),
      box_(box),
      folder_(std::move(folder)),
      progress_(progress) {
    for (int third = 0; third < kBlockShifts; ++third) {
        grids_.push_back(std::make_unique<BlockGrid>(lattice, mesh, triangles, third,
                                                     kMaxFineInBlock, folder_, progress));
    }
    full_ = std::make_shared<Run>(folder_);
    full_->is_full = true;
    full_->triangles = triangles.size();
    for (const ElementCorners t : triangles) {
        full_->whole.add(grids_.front()->block_of(t));
    }
    finish(*full_);
}

MeshSimplifier::~MeshSimplifier() = default;

void MeshSimplifier::finish(Run& run) const {
    const std::uint32_t blocks = grids_[static_cast<std::size_t>(run.third)]->blocks();
    run.mesh.seal();
    run.full.seal();
    run.splits.seal();
    run.mesh.sort(blocks);
    run.whole.sort(blocks);
    run.full.sort(blocks);
    run.held.sort(blocks);
}

/// Visits the triangles of the mesh, also if it is the full surface.
template <class Visit>
void MeshSimplifier::each(const Run& run, const Visit& visit) const {
    for (const BlockRun& some : run.whole.all()) {
        for (const ElementCorners t : triangles_.subspan(some.first, some.count)) {
            visit(t);
        }
    }
    for (const PackedTriangle& t : run.mesh.all()) {
        visit(t.corners());
    }
}

/// `afresh`: earlier results of `tried` were for other limits and are ignored.
MeshSimplifier::Block MeshSimplifier::load(const Run& run, const Valences& valences,
                                           std::uint32_t block, bool afresh) const {
    Block b;
    Patch& patch = b.numbered.patch;
    patch.box = box_;
    PatchNumbering numbering(mesh_, b.numbered);
    std::vector<ElementCorners> held;
    for (const Sorted& t : run.held.of(block)) {
        held.push_back(from_smallest(t.corners));
    }
    std::sort(held.begin(), held.end());
    run.mesh.each(block, [&](const PackedTriangle& t) {
        const ElementCorners corners = t.corners();
        patch.triangles.push_back(numbering.local(corners));
        const bool is_held = std::binary_search(held.begin(), held.end(), from_smallest(corners));
        patch.stay.push_back((t.mark & kForever) != 0 ? Stay::forever
                             : is_held                ? Stay::now
                                                      : Stay::no);
        patch.tried.push_back(!afresh && (t.mark & kTried) != 0);
        patch.displacements.push_back(t.displacement);
    });
    run.full.each(block, [&](const FineTriangle& t) {
        b.full.push_back(t.place());
        patch.fine.push_back(numbering.local(triangles_[t.place()]));
        patch.witnesses.push_back(t.witness());
    });
    for (const BlockRun& some : run.whole.of(block)) {
        for (std::uint64_t i = some.first; i < some.first + some.count; ++i) {
            b.full.push_back(i);
            patch.fine.push_back(numbering.local(triangles_[i]));
        }
    }
    if (run.is_full) {
        patch.set_full();
    }
    for (const std::uint64_t v : b.numbered.vertex) {
        patch.near.push_back(numbering.number_of(moved_.origin_of(v)));
    }
    patch.shared = shared_vertices(valences, b.numbered.vertex, patch.triangles);
    return b;
}

/// `is_last`: `from` will not be read any more.
std::shared_ptr<MeshSimplifier::Run> MeshSimplifier::pass(Run& from, const CollapseLimits& limits,
                                                          bool afresh, bool is_last) {
    const BlockGrid& grid = *grids_[static_cast<std::size_t>(from.third)];
    auto next = std::make_shared<Run>(folder_);
    next->third = (from.third + 1) % kBlockShifts;
    next->bound = from.bound;
    const BlockGrid& after = *grids_[static_cast<std::size_t>(next->third)];
    next->begin(after.blocks());
    MovedVertices::Copies moved(folder_);
    GrowingFile<Split> splits(folder_);
    Valences valences(mesh_.layout().vertices, folder_);
    each(from, [&](const ElementCorners& t) { valences.count(t); });
    progress_.begin("simplify", from.triangles, "triangles");
    in_order(
        grid.blocks(), tbb::this_task_arena::max_concurrency() + 1,
        [&](std::int64_t i) {
            progress_.check();
            const Block b = load(from, valences, static_cast<std::uint32_t>(i), afresh);
            if (b.numbered.patch.triangles.empty()) {
                return Outcome{};
            }
            Outcome outcome = b.outcome(simplify_patch(b.numbered.patch, limits), after, moved_);
            progress_.advance(b.numbered.patch.triangles.size());
            return outcome;
        },
        [&](std::int64_t i, Outcome& outcome) {
            outcome.number_from(moved_.next() + moved.size());
            next->add(outcome);
            std::for_each(outcome.moved.begin(), outcome.moved.end(),
                          [&](const auto& copy) { moved.append(copy); });
            std::for_each(outcome.splits.begin(), outcome.splits.end(),
                          [&](const Split& split) { splits.append(split); });
            next->bound = std::max(next->bound, outcome.largest);
            if (is_last) {
                from.consume(static_cast<std::uint32_t>(i));
            }
        });
    moved_.add(moved);
    splits.seal();
    for (const auto& some : {splits.all(), from.splits.all()}) {
        for (const Split& split : some) {
            next->add(split, after);
        }
    }
    finish(*next);
    return next;
}

Simplified MeshSimplifier::full() const {
    return {full_, triangles_.size(), 0, 0};
}

Simplified MeshSimplifier::sample(std::uint64_t most) const {
    const std::uint64_t stride = triangles_.size() / std::max<std::uint64_t>(most, 1);
    if (stride < 2) {
        return full();
    }
    auto run = std::make_shared<Run>(folder_);
    run->is_full = true;
    const std::uint32_t blocks = grids_.front()->blocks();
    for (std::uint32_t block = 0; block < blocks; ++block) {
        if (block % stride == stride / 2) {
            for (const BlockRun& some : full_->whole.of(block)) {
                run->whole.add(some);
                run->triangles += some.count;
            }
        }
    }
    finish(*run);
    return {run, run->triangles, 0, 0};
}

/// The part of a limit that is reserved for separating vertices at the same place.
double MeshSimplifier::reserve(double limit) const {
    constexpr double kUnits = 4;
    constexpr double kMax = 0x1p-8;
    return std::min(kUnits * unit_, kMax * limit);
}

double MeshSimplifier::give_own_places(const Run& run, double most) {
    if (moved_.empty()) {
        return 0;
    }
    ScratchFile seen_file(folder_);
    seen_file.map(mesh_.layout().vertices);
    const auto seen = seen_file.as<std::uint8_t>();
    GrowingFile<std::uint64_t> vertices(folder_);
    for (const PackedTriangle& t : run.mesh.all()) {
        for (const std::uint64_t v : t.corners()) {
            if (seen[v] == 0) {
                seen[v] = 1;
                vertices.append(v);
            }
        }
    }
    vertices.seal();
    progress_.check();
    return moved_.give_own_places(vertices.all(), most);
}

Simplified MeshSimplifier::within(const Simplified& from, double limit) {
    std::shared_ptr<Run> run = from.run;
    const double kept = reserve(limit);
    for (int i = 0; i < kPassesWithin; ++i) {
        const bool is_own = i > 0;
        run = pass(*run, simplify_limits(limit - kept), i == 0, is_own);
    }
    const double moved = give_own_places(*run, kept);
    return {run, run->triangles, run->bound + moved, limit};
}

CornerFile MeshSimplifier::corners(const Simplified& of) const {
    return corner_file(folder_, mesh_.layout().vertices, of.triangles,
                       [&](const auto& visit) { each(*of.run, visit); });
}

}  // namespace isonest::detail
