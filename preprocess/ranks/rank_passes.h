// The passes over a rank's own blocks.
#pragma once

#include <cstdint>
#include <filesystem>

#include <isonest/progress.h>
#include <isonest/volume_source.h>

#include "preprocess/levels/centre_store.h"
#include "preprocess/levels/pass_context.h"
#include "preprocess/ranks/block_journal.h"
#include "preprocess/ranks/partial_levels.h"
#include "preprocess/ranks/pencils.h"
#include "store/base/workers.h"
#include "store/container/format.h"
#include "store/ranks/communicator.h"

namespace isonest::detail {

/// Inputs and outputs of a rank's passes.
struct PassWork {
    Communicator& ranks;
    const StoreLayout& layout;
    const Pencils& pencils;
    const PassBudget& budget;
    Workers& workers;
    std::filesystem::path scratch;
    CentreStore& centres;
    PartialLevels& levels;
    OwnChunkFile& chunks;
    Progress& progress;
    const OwnIndicators* own = nullptr;      ///< null if there are none
    const EarlierBlocks* earlier = nullptr;  ///< blocks of an interrupted run, if any
    BlockJournal* journal = nullptr;         ///< if this run can be resumed after an interruption
    std::uint64_t bytes_read = 0;            ///< bytes of the input that were read
    bool input_on_disk = false;              ///< parts of it were first copied to `scratch`
    std::uint64_t resumed_chunks = 0;
    double seconds_of_passes = 0;
};

/// Makes all levels of the rank's pencils. Collective. Throws what preprocess() throws.
void run_rank_passes(PassWork& work, VolumeSource& source);

}  // namespace isonest::detail
