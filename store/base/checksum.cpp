#include "store/base/checksum.h"

#define XXH_STATIC_LINKING_ONLY  // for the size of its state
#include <xxhash.h>

namespace isonest::detail {

std::uint64_t checksum_of(std::span<const std::byte> bytes) {
    return XXH64(bytes.data(), bytes.size(), 0);
}

struct Checksum::State {
    XXH64_state_t xxh;
};

Checksum::Checksum() : state_(std::make_unique<State>()) {
    XXH64_reset(&state_->xxh, 0);
}

Checksum::~Checksum() = default;

void Checksum::add(std::span<const std::byte> bytes) {
    XXH64_update(&state_->xxh, bytes.data(), bytes.size());
}

std::uint64_t Checksum::value() const {
    return XXH64_digest(&state_->xxh);
}

}  // namespace isonest::detail
#undef XXH_STATIC_LINKING_ONLY
