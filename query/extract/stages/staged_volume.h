// What the stages of an extraction know of the volume.
#pragma once

#include <string>

#include "store/container/reader.h"

namespace isonest::detail {

struct StagedVolume {
    std::string name;    ///< for messages
    StoreHeader header;  ///< nodes, place and unit; of a volume without a store nothing else
    const StoreReader* store = nullptr;  ///< null: it has none

    StagedVolume(std::string name_, StoreHeader header_)
        : name(std::move(name_)), header(std::move(header_)) {}
    // NOLINTNEXTLINE(google-explicit-constructor,hicpp-explicit-conversions): where both are taken
    StagedVolume(const StoreReader& of)
        : name(of.path().string()), header(of.layout().header()), store(&of) {}
};

}  // namespace isonest::detail
