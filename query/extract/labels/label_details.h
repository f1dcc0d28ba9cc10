// A label's mesh in several levels of detail, as files that Neuroglancer reads.
#pragma once

#include <cstddef>
#include <filesystem>

#include <isonest/labels.h>
#include <isonest/neuroglancer_meshes.h>
#include <isonest/progress.h>

#include "query/extract/labels/label_net.h"
#include "store/container/format.h"

namespace isonest::detail {

/// What a net of a store with this header is to be made for.
DetailSetting detail_setting(const StoreHeader& header);

/// Writes the files of labels[number] of the net, `label`. REQUIRES: the net has details, as of
/// detail_setting(). Throws Error{io, limit, cancelled}. Thread-safety: any number of calls at
/// once.
NeuroglancerReport write_label_details(const LabelNet& net, const StoreHeader& header,
                                       std::size_t number, const Label& label,
                                       const std::filesystem::path& folder,
                                       const Progress& progress);

}  // namespace isonest::detail
