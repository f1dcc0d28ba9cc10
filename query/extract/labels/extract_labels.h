// A label's mesh at several levels of detail, as files in Neuroglancer's format.
#pragma once

#include <cstddef>
#include <filesystem>
#include <span>
#include <vector>

#include <isonest/label_name.h>
#include <isonest/labels.h>
#include <isonest/neuroglancer_meshes.h>
#include <isonest/progress.h>
#include <isonest/store.h>

#include "query/extract/labels/label_net.h"
#include "query/neuroglancer/shards.h"
#include "store/container/format.h"

namespace isonest::detail {

/// The settings of a net with details, for a store with this header.
DetailSetting detail_setting(const StoreHeader& header);

/// Writes labels[number] of the net, `label`, to its files, or to `shards` unless they are null.
/// REQUIRES: the net has details, as from detail_setting(). Throws Error{io, limit, cancelled}.
/// Thread-safety: any number of concurrent calls.
NeuroglancerReport write_label_details(const LabelNet& net, const StoreHeader& header,
                                       std::size_t number, const Label& label,
                                       const std::filesystem::path& folder, Shards* shards,
                                       const Progress& progress);

/// Names of these labels, in their order; empty if none has one.
std::vector<LabelName> names_of(const Store& store, std::span<const Label> labels);

}  // namespace isonest::detail
