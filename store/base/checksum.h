// Checksums that detect damage: XXH64, https://github.com/Cyan4973/xxHash.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>

namespace isonest::detail {

/// XXH64 with seed 0.
std::uint64_t checksum_of(std::span<const std::byte> bytes);
/// The same for bytes that arrive in pieces.
class Checksum {
  public:
    Checksum();
    Checksum(const Checksum&) = delete;
    Checksum& operator=(const Checksum&) = delete;
    ~Checksum();
    void add(std::span<const std::byte> bytes);
    [[nodiscard]] std::uint64_t value() const;

  private:
    struct State;
    std::unique_ptr<State> state_;
};

}  // namespace isonest::detail
