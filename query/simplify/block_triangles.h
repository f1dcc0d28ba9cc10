// Sequences that grow with a mesh, in temporary files.
#pragma once

#include <array>
#include <cstdint>
#include <filesystem>
#include <span>
#include <vector>

#include "query/mesh/scratch_mesh.h"
#include "store/files/scratch_file.h"

namespace isonest::detail {

/// A sequence that is appended to, and then read. Not thread-safe; constant once it is sealed.
template <class T>
class GrowingFile {
  public:
    explicit GrowingFile(const std::filesystem::path& folder) : file_(folder) {}

    void append(const T& item) {
        waiting_.push_back(item);
        if (waiting_.size() == kWaiting) {
            flush();
        }
    }
    void seal() {
        flush();
        file_.map(count_ * sizeof(T));
    }
    /// REQUIRES: seal() was called.
    [[nodiscard]] std::span<const T> all() const {
        return {file_.template as<T>().data(), static_cast<std::size_t>(count_)};
    }
    [[nodiscard]] std::uint64_t count() const { return count_; }
    [[nodiscard]] std::uint64_t bytes() const { return count_ * sizeof(T); }

  private:
    static constexpr std::size_t kWaiting = std::size_t{1} << 12U;
    void flush() {
        file_.write_at(count_ * sizeof(T), std::as_bytes(std::span(waiting_)));
        count_ += waiting_.size();
        waiting_.clear();
    }
    ScratchFile file_;
    std::vector<T> waiting_;
    std::uint64_t count_ = 0;
};

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
        return {sorted_.as<Sorted>().data(), static_cast<std::size_t>(file_.count())};
    }
    [[nodiscard]] std::uint64_t count() const { return file_.count(); }
    [[nodiscard]] std::uint64_t bytes() const { return 2 * file_.bytes(); }

  private:
    GrowingFile<Sorted> file_;
    ScratchFile sorted_;
    ScratchFile begin_;
};

}  // namespace isonest::detail
