// Smooth surfaces of labels: one surface net for all of them, and a mesh of each.
#pragma once

#include <filesystem>
#include <functional>
#include <memory>
#include <span>

#include <isonest/extract.h>
#include <isonest/neuroglancer_meshes.h>

#include "store/container/reader.h"

namespace isonest::detail {

/// As extract_labels(). REQUIRES: query.smooth.
void smooth_labels(const StoreReader& store, std::span<const Label> labels, const LabelQuery& query,
                   const std::function<std::unique_ptr<MeshSink>(const Label&)>& sink,
                   const std::function<void(std::size_t number, const ExtractReport&)>& done,
                   const ExtractOptions& options, Progress& progress);

/// As extract() of a label. REQUIRES: query.smooth.
ExtractReport smooth_label(const StoreReader& store, const LabelQuery& query, MeshSink& sink,
                           const ExtractOptions& options, Progress& progress);

/// The labels' own files of extract_neuroglancer_meshes(). REQUIRES: query.smooth, Draco, and no
/// label below 0.
void neuroglancer_labels(
    const StoreReader& store, std::span<const Label> labels, const LabelQuery& query,
    const std::filesystem::path& folder,
    const std::function<void(std::size_t number, const NeuroglancerReport&)>& done,
    const ExtractOptions& options, Progress& progress);

/// As extract_interfaces().
ExtractReport label_interfaces(const StoreReader& store, std::span<const Label> labels,
                               const LabelQuery& query, MeshSink& sink,
                               const std::function<void(const LabelInterface&)>& each,
                               const ExtractOptions& options, Progress& progress);

}  // namespace isonest::detail
