// What a preprocessing run does before its passes and after them, however those are run.
#pragma once

#include <string>
#include <vector>

#include <isonest/label_name.h>
#include <isonest/preprocess.h>
#include <isonest/volume_source.h>

#include "preprocess/levels/centre_store.h"
#include "store/container/format.h"
#include "store/container/writer.h"

namespace isonest::detail {

/// Of the store that is asked for. Throws Error{invalid_argument} with the remedy to place the
/// input elsewhere.
StoreHeader header_of(const VolumeDescription& volume, const PreprocessOptions& options);

/// The names that the store gets. Throws Error{invalid_argument}.
std::vector<LabelName> label_names_of(const VolumeSource& source);

/// What must be the same for a run to go on with what another one has done, as lines of text.
/// Throws Error{invalid_argument}; if `resume`, also for a source that cannot tell.
std::string identity_of(const StoreHeader& header, const VolumeSource& source, bool resume);

/// All levels of them, from those of the finest in `centres`.
void write_cube_ranges(CentreStore& centres, StoreWriter& writer);

/// What the header and the table of all chunks say.
void describe_store(const StoreWriter& writer, PreprocessReport& report);

}  // namespace isonest::detail
