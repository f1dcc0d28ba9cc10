// Which part of a check one rank does.
#pragma once

#include <cstdint>
#include <utility>

#include "store/ranks/communicator.h"

namespace isonest::detail {

/// Of a row of things, all or one rank's.
struct RankShare {
    Communicator* ranks = nullptr;  ///< null: one process does all

    [[nodiscard]] std::int64_t size() const { return ranks != nullptr ? ranks->size() : 1; }
    [[nodiscard]] bool is_first() const { return ranks == nullptr || ranks->rank() == 0; }
    /// This rank's of `count` things: the first, and the end.
    [[nodiscard]] std::pair<std::int64_t, std::int64_t> of(std::int64_t count) const {
        const std::int64_t rank = ranks != nullptr ? ranks->rank() : 0;
        return {count * rank / size(), count * (rank + 1) / size()};
    }
    /// Whether it holds on any rank. Collective.
    [[nodiscard]] bool any(bool holds) const {
        std::uint64_t sum = holds ? 1 : 0;
        if (ranks != nullptr) {
            ranks->sum({&sum, 1});
        }
        return sum > 0;
    }
};

}  // namespace isonest::detail
