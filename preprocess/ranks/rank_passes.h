// The passes over a rank's own blocks.
#pragma once

#include <cstdint>
#include <filesystem>

#include <isonest/progress.h>
#include <isonest/volume_source.h>

#include "preprocess/levels/centre_store.h"
#include "preprocess/levels/pass_budget.h"
#include "preprocess/ranks/block_journal.h"
#include "preprocess/ranks/own_chunk_file.h"
#include "preprocess/ranks/partial_levels.h"
#include "preprocess/ranks/pencils.h"
#include "store/base/workers.h"
#include "store/container/format.h"
#include "store/ranks/communicator.h"

namespace isonest::detail {

/// What a rank works with, and where its work goes.
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
    const EarlierBlocks* earlier = nullptr;  ///< those of an interrupted run, if any
    BlockJournal* journal = nullptr;  ///< if this run is to be resumed when it is interrupted
    std::uint64_t bytes_read = 0;     ///< of the input
    bool input_on_disk = false;       ///< some of it was first copied to `scratch`
    std::uint64_t resumed_chunks = 0;
    double seconds_of_passes = 0;
};

/// All levels of the rank's pencils. Collective. Throws what preprocess() throws.
void run_rank_passes(PassWork& work, VolumeSource& source);

}  // namespace isonest::detail
