// How ranks map the blocks of a mesh together: the messages between rank 0, which has the mesh, and
// the others.
//
//     once:       rank 0 says that there are blocks to map         broadcast
//                 each says what it offers                         gather
//     each step:  each says in how many messages its results come  gather
//                 rank 0 says what comes, or that all is done      broadcast
//                 results to rank 0, the next blocks to the others exchange
//
// Between two steps all ranks map; rank 0 makes the blocks after the next ones ready meanwhile.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <string>
#include <string_view>
#include <type_traits>
#include <vector>

#include "query/simplify/mapping/map_mesh.h"
#include "query/simplify/patch.h"
#include "store/base/memory_budget.h"
#include "store/ranks/communicator.h"

namespace isonest::detail {

/// What a rank has for the blocks of others.
struct MappingOffer {
    std::uint64_t threads = 0;
    std::uint64_t heap = 0;  ///< for blocks that wait, beside map_heap() for each thread
};

/// What rank 0 tells all others in each step.
struct MappingStep {
    bool is_end = false;
    CollapseLimits limits;                ///< of the blocks that come
    std::vector<std::uint64_t> messages;  ///< that each rank gets
};

/// The part of the memory in which blocks wait: a quarter, if a thread has enough in the rest.
inline std::uint64_t waiting_heap(std::uint64_t memory) {
    constexpr std::uint64_t kPart = 4;
    const std::uint64_t least = kLibraryHeap + map_heap();
    return memory <= least ? 0 : std::min((memory - kLibraryHeap) / kPart, memory - least);
}

template <class T>
std::string text_of_value(const T& value) {
    static_assert(std::is_trivially_copyable_v<T>);
    return {reinterpret_cast<const char*>(&value), sizeof(value)};
}

template <class T>
T value_of_text(std::string_view text) {
    static_assert(std::is_trivially_copyable_v<T>);
    T value{};
    std::memcpy(&value, text.data(), std::min(sizeof(value), text.size()));
    return value;
}

/// Collective, of rank 0.
void tell_step(Communicator& ranks, const MappingStep& step);
/// Collective, of the others.
MappingStep hear_step(Communicator& ranks);

}  // namespace isonest::detail
