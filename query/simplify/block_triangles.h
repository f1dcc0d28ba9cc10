// Sequences that grow with a mesh, in temporary files.
#pragma once

#include <cstdint>
#include <span>

#include "query/mesh/scratch_mesh.h"
#include "query/simplify/growing_file.h"
#include "store/files/scratch_file.h"

namespace isonest::detail {

/// A triangle on its way into a block.
struct Sorted {
    ElementCorners corners{};
    std::uint32_t block = 0;
    std::uint32_t mark = 0;
};

/// A sequence of things with a `block` that grows, and then is sorted by blocks. Not thread-safe;
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
    /// Sorts what was appended; those of a block stay in their order. Nothing may be appended any
    /// more.
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

}  // namespace isonest::detail
