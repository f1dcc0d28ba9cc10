// Sequences that grow with a mesh, in temporary files.
#pragma once

#include <cstdint>
#include <filesystem>
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

/// A sequence of triangles that grows, and then is sorted by blocks. Not thread-safe; constant once
/// it is sorted.
class BlockTriangles {
  public:
    explicit BlockTriangles(const std::filesystem::path& folder)
        : file_(folder), sorted_(folder), begin_(folder) {}

    void append(const Sorted& triangle) { file_.append(triangle); }
    void append(std::span<const Sorted> triangles) {
        for (const Sorted& t : triangles) {
            append(t);
        }
    }
    /// Sorts what was appended; those of a block stay in their order.
    void sort(std::uint32_t blocks) {
        file_.seal();
        sorted_.map(file_.bytes());
        begin_.map((std::uint64_t{blocks} + 2) * sizeof(std::uint64_t));
        const auto to = sorted_.as<Sorted>();
        const auto begin = begin_.as<std::uint64_t>();
        for (const Sorted& t : file_.all()) {
            ++begin[t.block + 2];
        }
        for (std::size_t i = 2; i < begin.size(); ++i) {
            begin[i] += begin[i - 1];
        }
        for (const Sorted& t : file_.all()) {
            to[begin[t.block + 1]++] = t;
        }
    }
    [[nodiscard]] std::span<const Sorted> of(std::uint32_t block) const {
        const auto begin = begin_.as<const std::uint64_t>();
        return all().subspan(begin[block], begin[block + 1] - begin[block]);
    }
    [[nodiscard]] std::span<const Sorted> all() const {
        return {sorted_.as<Sorted>().data(), static_cast<std::size_t>(file_.size())};
    }
    [[nodiscard]] std::uint64_t count() const { return file_.size(); }
    [[nodiscard]] std::uint64_t bytes() const { return 2 * file_.bytes(); }

  private:
    GrowingFile<Sorted> file_;
    ScratchFile sorted_;
    ScratchFile begin_;
};

}  // namespace isonest::detail
