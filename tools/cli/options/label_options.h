// The options of extract for labels, which replace the isovalue.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include <isonest/extract.h>
#include <isonest/neuroglancer_meshes.h>

#include "tools/cli/options/extract_options.h"
#include "tools/cli/program.h"

namespace isonest::detail::cli {

struct LabelArguments {
    std::optional<std::int64_t> one;
    /// Ranges, both ends included; empty: all labels but 0.
    std::optional<std::vector<std::pair<std::int64_t, std::int64_t>>> several;
    /// Names given in place of numbers. `one` or `several` is set too, but valid only after
    /// resolve_label_names().
    std::optional<std::string> one_name = {};
    std::vector<std::string> several_names = {};
    std::string format = "ply";  ///< also the format of an isovalue's tiles
    bool has_format = false;     ///< it was given
    /// --over: origin of the volume over which Neuroglancer shows the meshes.
    std::optional<VoxelOrigin> over = {};
    std::optional<LabelSmoothing> smooth = {};
    bool keep_nodes = false;  ///< when simplifying smooth meshes
    bool interfaces = false;  ///< write one mesh of the interfaces instead of one per label
};

/// Adds --label, --labels, --smooth, --keep-nodes, --interfaces, --format and --over. The first two
/// exclude all of `others`.
void add_label_options(CLI::App* command, LabelArguments& a,
                       const std::vector<std::string>& others);

/// Whether meshes are written in several levels of detail.
bool makes_detail_levels(const LabelArguments& a);

/// Replaces label names by the labels of this store. Throws what label_named() throws.
void resolve_label_names(LabelArguments& a, const Store& store);

/// "no point further than 0.8 from the voxels' faces".
std::string smooth_text(const SmoothReport& r);
/// For a simplified mesh "within 0.5 of 1000 triangles at full resolution; ", else empty.
std::string sheets_text(const ExtractReport& r, const std::string& unit);
/// For a closed mesh: "closed where the voxels at the volume's border end".
std::string smooth_close_text();
/// Adds the members of a report on smoothing.
void add_smooth_json(const SmoothReport& r, Json& json);

/// Writes the meshes of the labels and the file labels.json into the folder a.mesh. REQUIRES:
/// labels.several.
Result extract_label_meshes(const Store& store, const LabelArguments& labels,
                            const ExtractArguments& a, const LabelQuery& query, Progress& progress);

/// Writes the labels as features of one tileset, or as objects of one file. REQUIRES:
/// labels.several; makes_tiles() or makes_objects().
Result extract_labels_together(const Store& store, const LabelArguments& labels,
                               const ExtractArguments& a, const LabelQuery& query,
                               Progress& progress);

/// Writes the interfaces of the labels as one mesh, a.mesh. REQUIRES: labels.several.
Result extract_label_interfaces(const Store& store, const LabelArguments& labels,
                                const ExtractArguments& a, const LabelQuery& query,
                                Progress& progress);

}  // namespace isonest::detail::cli
