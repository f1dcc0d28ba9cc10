// The steps of a preprocessing run before and after its passes, independent of how those are run.
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

/// The header of the requested store. Throws Error{invalid_argument} with the remedy to place the
/// input elsewhere.
StoreHeader header_of(const VolumeDescription& volume, const PreprocessOptions& options);

/// The label names for the store. Throws Error{invalid_argument}.
std::vector<LabelName> label_names_of(const VolumeSource& source);

/// The names of own indicators with digests of their identities, as lines of text.
std::string own_identities(const std::vector<OwnIndicator>& own);

/// What must be the same for a run to continue an interrupted one, as lines of text. Throws
/// Error{invalid_argument}; with resume, also for a source or an own indicator without identity.
std::string identity_of(const StoreHeader& header, const VolumeSource& source,
                        const PreprocessOptions& options);

/// Writes the cube ranges of all levels, computed from those of the finest one in `centres`.
void write_cube_ranges(CentreStore& centres, StoreWriter& writer);

/// Fills the report from the header and the chunk table.
void describe_store(const StoreWriter& writer, PreprocessReport& report);

}  // namespace isonest::detail
