// Arrays in base64 whose rows are written in any order, each at a known place.
//
// Three bytes are four letters. Where a row ends within three bytes, the next row has the rest of
// them, and whoever writes it may come earlier or later: what is there of the three waits until the
// rest comes.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <map>
#include <mutex>
#include <span>
#include <string>
#include <string_view>

namespace isonest::detail {

/// Bytes that are one text in base64.
struct Base64Array {
    std::uint64_t text = 0;   ///< where in the file it begins
    std::uint64_t bytes = 0;  ///< that it stands for; 0: the array is not in base64

    [[nodiscard]] std::uint64_t letters() const { return (bytes + 2) / 3 * 4; }
};

/// Writes such arrays. It holds three bytes for each place at which one of two neighbours has come.
/// Thread-safe.
class Base64Rows {
  public:
    /// Writes letters into the file.
    using Write = std::function<void(std::uint64_t place, std::span<const std::byte> letters)>;

    /// `bytes`, from byte `at` of the array on. Each byte of an array is to come once. Throws what
    /// `write` throws.
    void put(const Base64Array& array, std::uint64_t at, std::span<const std::byte> bytes,
             const Write& write);
    /// What waits, for include() of one for the same file in another process; nothing waits here
    /// then.
    std::string take();
    void include(std::string_view taken, const Write& write);
    /// Whether all that came is written.
    [[nodiscard]] bool is_complete() const;

  private:
    /// Three bytes, or fewer at the end of an array.
    struct Group {
        std::array<std::uint8_t, 3> bytes{};
        std::uint8_t has = 0;  ///< a bit for each byte that has come
        std::uint8_t all = 0;  ///< a bit for each that there is
    };
    void add(std::uint64_t place, const Group& some, const Write& write);

    mutable std::mutex mutex_;
    std::map<std::uint64_t, Group> waiting_;  ///< by the place of its letters
};

}  // namespace isonest::detail
