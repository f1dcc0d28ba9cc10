// What a cache on disk has of one block of an object, and the bytes of the file that holds it.
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <string_view>
#include <vector>

namespace isonest::detail {

/// Any parts of a block of kBytes bytes. A file has, in the machine's byte order: eight letters,
/// XXH64 of all that follows, the block's number, how long the object's name is and how many parts
/// there are, the parts (beginning and size) in order, the name, the parts' bytes.
class CachedBlock {
  public:
    static constexpr std::size_t kBytes = std::size_t{64} << 10U;
    /// Of a file, at most. A name that leaves no room for this is not kept.
    static constexpr std::size_t kMostFileBytes = 2 * kBytes;

    /// None of it is there.
    CachedBlock() = default;
    /// Nothing if `file` is damaged, or has another block, or one of another object.
    static std::optional<CachedBlock> decode(std::span<const std::byte> file,
                                             std::string_view object, std::uint64_t number);
    /// Empty if that would be more than kMostFileBytes.
    [[nodiscard]] std::vector<std::byte> encode(std::string_view object,
                                                std::uint64_t number) const;

    /// Copies [from, from + to.size()); false if a part of it is not there. REQUIRES: it lies
    /// within the block. The same for add().
    [[nodiscard]] bool copy(std::size_t from, std::span<std::byte> to) const;
    /// False if all of it was there already.
    bool add(std::size_t from, std::span<const std::byte> bytes);
    /// Nothing of [from, from + size) is there any more. REQUIRES: it lies within the block.
    void remove(std::size_t from, std::size_t size);
    [[nodiscard]] bool empty() const { return parts_.empty(); }

  private:
    struct Part {
        std::uint32_t from = 0;
        std::uint32_t size = 0;
        [[nodiscard]] std::size_t end() const { return std::size_t{from} + size; }
    };
    [[nodiscard]] bool has(std::size_t from, std::size_t size) const;

    std::vector<Part> parts_;       ///< in order, with gaps between them
    std::vector<std::byte> bytes_;  ///< of the whole block; empty if there are no parts
};

}  // namespace isonest::detail
