// Containers for data that grows with a mesh: in temporary files, and by blocks of space.
#pragma once

#include <tsl/robin_map.h>

#include <array>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <span>
#include <vector>

#include "query/mesh/scratch_mesh.h"
#include "query/simplify/patch.h"
#include "store/base/box.h"
#include "store/files/scratch_file.h"

namespace isonest::detail {

// A sequence that grows in a temporary file and is then read or changed as an array.

/// Thread-safety: append() and seal() from one thread; all() from any.
template <class T>
class GrowingFile {
  public:
    explicit GrowingFile(const ScratchFolder& folder) : file_(folder) {}

    /// Throws Error{io}.
    void append(const T& item) {
        waiting_.push_back(item);
        if (waiting_.size() == kWaiting) {
            flush();
        }
    }
    /// Call after the last append(), or after the last one for now. Throws Error{io}.
    void seal() {
        flush();
        waiting_ = {};
        file_.map(bytes());
    }
    /// REQUIRES: seal() was called.
    [[nodiscard]] std::span<T> all() const {
        return {file_.as<T>().data(), static_cast<std::size_t>(flushed_)};
    }
    /// Declares that these items will not be read any more; call once per item. REQUIRES: seal()
    /// was called.
    void release(std::uint64_t first, std::uint64_t count) {
        file_.release(first * sizeof(T), count * sizeof(T));
    }
    /// Frees all the space; afterwards only size() may be used.
    void clear() { file_.clear(); }
    /// Number of appended items.
    [[nodiscard]] std::uint64_t size() const { return flushed_ + waiting_.size(); }
    [[nodiscard]] std::uint64_t bytes() const { return size() * sizeof(T); }

  private:
    static constexpr std::size_t kWaiting = std::size_t{1} << 12U;
    void flush() {
        file_.write_at(flushed_ * sizeof(T), std::as_bytes(std::span(waiting_)));
        flushed_ += waiting_.size();
        waiting_.clear();
    }
    PiecedFile file_;
    std::vector<T> waiting_;
    std::uint64_t flushed_ = 0;
};

// A compact form of a triangle, for a mesh in a temporary file.

/// REQUIRES: vertex numbers are below 2^48.
struct PackedTriangle {
    std::array<std::uint32_t, 3> low{};   ///< low bits of the corners
    std::array<std::uint16_t, 3> high{};  ///< high bits of the corners
    std::uint16_t mark = 0;
    Displacement displacement;

    PackedTriangle() = default;
    PackedTriangle(const ElementCorners& corners, std::uint16_t of, const Displacement& by)
        : mark(of), displacement(by) {
        for (std::size_t i = 0; i < corners.size(); ++i) {
            low[i] = static_cast<std::uint32_t>(corners[i]);
            high[i] = static_cast<std::uint16_t>(corners[i] >> kLow);
        }
    }
    [[nodiscard]] ElementCorners corners() const {
        ElementCorners c{};
        for (std::size_t i = 0; i < c.size(); ++i) {
            c[i] = std::uint64_t{high[i]} << kLow | low[i];
        }
        return c;
    }

  private:
    static constexpr unsigned kLow = 32;
};
static_assert(sizeof(PackedTriangle) == 48);

// Sequences that grow with a mesh, in temporary files.

/// A triangle to be sorted into a block.
struct Sorted {
    ElementCorners corners{};
    std::uint32_t block = 0;
    std::uint32_t mark = 0;
};

/// A growing sequence of items with a `block`, which is then sorted by blocks. Not thread-safe;
/// constant once it is sorted.
template <class T>
class SortedByBlocks {
  public:
    explicit SortedByBlocks(const ScratchFolder& folder)
        : file_(folder), sorted_(folder), begin_(folder) {}

    void append(const T& item) { file_.append(item); }
    void append(std::span<const T> items) {
        for (const T& item : items) {
            append(item);
        }
    }
    /// Sorts what was appended, keeping the order within a block. Nothing may be appended
    /// afterwards.
    void sort(std::uint32_t blocks) {
        file_.seal();
        sorted_.map(file_.bytes());
        begin_.map((std::uint64_t{blocks} + 2) * sizeof(std::uint64_t));
        const auto to = sorted_.as<T>();
        const auto begin = begin_.as<std::uint64_t>();
        for (const T& t : file_.all()) {
            ++begin[t.block + 2];
        }
        for (std::size_t i = 2; i < begin.size(); ++i) {
            begin[i] += begin[i - 1];
        }
        for (const T& t : file_.all()) {
            to[begin[t.block + 1]++] = t;
        }
        file_.clear();
    }
    [[nodiscard]] std::span<const T> of(std::uint32_t block) const {
        const auto begin = begin_.as<const std::uint64_t>();
        return all().subspan(begin[block], begin[block + 1] - begin[block]);
    }
    [[nodiscard]] std::span<const T> all() const {
        return {sorted_.as<T>().data(), static_cast<std::size_t>(file_.size())};
    }
    [[nodiscard]] std::uint64_t count() const { return file_.size(); }

  private:
    GrowingFile<T> file_;
    ScratchFile sorted_;
    ScratchFile begin_;
};
using BlockTriangles = SortedByBlocks<Sorted>;

// Which items of a sequence belong to which block, in temporary files.

/// Consecutive items of a block in the sequence.
struct BlockRun {
    std::uint64_t first = 0;
    std::uint32_t count = 0;
    std::uint32_t block = 0;
};

/// A sequence in the order of a traversal has much fewer runs than items. Not thread-safe; constant
/// once it is sorted.
class BlockRuns {
  public:
    explicit BlockRuns(const ScratchFolder& folder) : runs_(folder) {}

    /// Adds the block of the next item.
    void add(std::uint32_t block) {
        if (run_.count == std::numeric_limits<std::uint32_t>::max() ||
            (run_.count > 0 && run_.block != block)) {
            put();
        }
        run_.block = block;
        ++run_.count;
    }
    void add(const BlockRun& run) { runs_.append(run); }
    /// Call after all were added. Throws Error{io}.
    void sort(std::uint32_t blocks) {
        put();
        runs_.sort(blocks);
    }
    /// The runs of a block, in the order of the sequence. REQUIRES for everything below: sort() was
    /// called.
    [[nodiscard]] std::span<const BlockRun> of(std::uint32_t block) const {
        return runs_.of(block);
    }
    [[nodiscard]] std::span<const BlockRun> all() const { return runs_.all(); }

  private:
    void put() {
        if (run_.count > 0) {
            runs_.append(run_);
            run_ = {run_.first + run_.count, 0, 0};
        }
    }
    SortedByBlocks<BlockRun> runs_;
    BlockRun run_;
};

// A sequence of items in blocks of space, in temporary files.

/// Items stay in the order in which they came; runs of them record the blocks. Not thread-safe;
/// constant once it is sorted, except for consume().
template <class T>
class BlockItems {
  public:
    explicit BlockItems(const ScratchFolder& folder) : items_(folder), runs_(folder) {}

    void append(const T& item) { items_.append(item); }
    void append(const T& item, std::uint32_t block) {
        items_.append(item);
        runs_.add(block);
    }
    /// Call after the last append(). Throws Error{io}.
    void seal() { items_.seal(); }
    /// Sets the block of the next item that was appended without one. REQUIRES: seal() was called.
    void add_block(std::uint32_t block) { runs_.add(block); }
    /// REQUIRES: seal() was called, each item has a block. Throws Error{io}.
    void sort(std::uint32_t blocks) { runs_.sort(blocks); }

    [[nodiscard]] std::uint64_t count() const { return items_.size(); }
    /// All items, in order. REQUIRES: seal() was called.
    [[nodiscard]] std::span<const T> all() const { return items_.all(); }
    /// Calls visit(item) for the items of a block, in order. REQUIRES: sort() was called.
    template <class Visit>
    void each(std::uint32_t block, const Visit& visit) const {
        for (const BlockRun& run : runs_.of(block)) {
            for (const T& item : all().subspan(run.first, run.count)) {
                visit(item);
            }
        }
    }
    [[nodiscard]] std::uint64_t count_in(std::uint32_t block) const {
        std::uint64_t count = 0;
        for (const BlockRun& run : runs_.of(block)) {
            count += run.count;
        }
        return count;
    }
    /// Declares that the items of a block will not be read any more; their space is freed sooner or
    /// later. REQUIRES: sort() was called; call once per block. May be called while other threads
    /// read other blocks.
    void consume(std::uint32_t block) {
        for (const BlockRun& run : runs_.of(block)) {
            items_.release(run.first, run.count);
        }
    }

  private:
    GrowingFile<T> items_;
    BlockRuns runs_;
};

// A block of a mesh as a patch, with its own vertex numbers.

/// The number of triangles at each vertex of the mesh, in a temporary file; very large numbers are
/// not recorded. Thread-safety: constant once all are counted.
class Valences {
  public:
    Valences(std::uint64_t vertices, const ScratchFolder& folder) : file_(folder) {
        file_.map(vertices * sizeof(std::uint16_t));
    }
    /// Counts `triangles`, which have `corners`.
    template <class T>
    Valences(std::uint64_t vertices, std::span<const T> triangles, const ScratchFolder& folder)
        : Valences(vertices, folder) {
        for (const T& t : triangles) {
            count(t.corners);
        }
    }
    void count(const ElementCorners& triangle) {
        for (const std::uint64_t v : triangle) {
            std::uint16_t& n = file_.as<std::uint16_t>()[v];
            n = static_cast<std::uint16_t>(n + (n < kMany ? 1 : 0));
        }
    }
    /// Number of triangles at the vertex; for 65,535 and more, a number larger than any possible
    /// one.
    [[nodiscard]] std::uint32_t of(std::uint64_t vertex) const {
        const std::uint16_t n = file_.as<const std::uint16_t>()[vertex];
        return n < kMany ? n : std::numeric_limits<std::uint32_t>::max();
    }

  private:
    static constexpr std::uint16_t kMany = std::numeric_limits<std::uint16_t>::max();
    ScratchFile file_;
};

/// A patch and the numbers of its vertices in the mesh.
struct BlockPatch {
    Patch patch;
    std::vector<std::uint64_t> vertex;
};

/// Assigns patch numbers to vertices of a mesh, in the order in which they come. Not thread-safe.
class PatchNumbering {
  public:
    /// Both must outlive it.
    PatchNumbering(const ScratchMesh& mesh, BlockPatch& block) : mesh_(mesh), block_(block) {}

    PatchTriangle local(const ElementCorners& corners) {
        PatchTriangle t{};
        for (std::size_t i = 0; i < 3; ++i) {
            const auto [slot, is_new] =
                place_.try_emplace(corners[i], static_cast<std::uint32_t>(block_.vertex.size()));
            t[i] = slot->second;
            if (is_new) {
                block_.vertex.push_back(corners[i]);
                block_.patch.positions.push_back(mesh_.positions()[corners[i]]);
            }
        }
        return t;
    }
    /// kNoVertex: the vertex has not come yet.
    [[nodiscard]] std::uint32_t number_of(std::uint64_t vertex) const {
        const auto slot = place_.find(vertex);
        return slot == place_.end() ? kNoVertex : slot->second;
    }

  private:
    const ScratchMesh& mesh_;
    BlockPatch& block_;
    tsl::robin_map<std::uint64_t, std::uint32_t, MixedHash> place_;
};

/// For each vertex of a patch, whether triangles outside the patch also use it; `vertex`: its
/// number in the mesh. False for vertices that no triangle of the patch uses.
inline std::vector<bool> shared_vertices(const Valences& valences,
                                         std::span<const std::uint64_t> vertex,
                                         std::span<const PatchTriangle> triangles) {
    std::vector<std::uint32_t> here(vertex.size());
    for (const PatchTriangle& t : triangles) {
        for (const std::uint32_t v : t) {
            ++here[v];
        }
    }
    std::vector<bool> shared(here.size());
    for (std::size_t v = 0; v < here.size(); ++v) {
        shared[v] = here[v] > 0 && here[v] != valences.of(vertex[v]);
    }
    return shared;
}

}  // namespace isonest::detail
