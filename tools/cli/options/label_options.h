// The options of extract that ask for labels in place of an isovalue.
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
    /// Ranges, both ends included; empty: all but 0.
    std::optional<std::vector<std::pair<std::int64_t, std::int64_t>>> several;
    /// Names in place of numbers, until resolve_label_names(); `one` and `several` are there then,
    /// too.
    std::optional<std::string> one_name = {};
    std::vector<std::string> several_names = {};
    std::string format = "ply";
    /// Of the volume with which Neuroglancer shows the meshes, if it was said.
    std::optional<VoxelOrigin> over = {};
    std::optional<LabelSmoothing> smooth = {};
    bool keep_nodes = false;  ///< where smooth ones are simplified
    bool interfaces = false;  ///< one mesh of what is between labels, in place of meshes
};

/// --label, --labels, --smooth, --keep-nodes, --interfaces, --format, --over. The first two exclude
/// all of `others`.
void add_label_options(CLI::App* command, LabelArguments& a,
                       const std::vector<std::string>& others);

/// Whether meshes are written in several levels of detail.
bool makes_detail_levels(const LabelArguments& a);

/// Puts the labels of this store in place of their names. Throws as label_named().
void resolve_label_names(LabelArguments& a, const Store& store);

/// "no point further than 0.8 from the voxels' faces".
std::string smooth_text(const SmoothReport& r);
/// "within 0.5 of 1000 triangles at full resolution; ", of one that was simplified; or empty.
std::string sheets_text(const ExtractReport& r, const std::string& unit);
/// Of one that is closed: "closed where the voxels at the volume's border end".
std::string smooth_close_text();
/// Adds what a report has of it.
void add_smooth_json(const SmoothReport& r, Json& json);

/// Writes a mesh for each of the labels, and the file labels.json, into the folder a.mesh.
/// REQUIRES: labels.several.
Result extract_label_meshes(const Store& store, const LabelArguments& labels,
                            const ExtractArguments& a, const LabelQuery& query, Progress& progress);

/// Writes the interfaces of the labels as the mesh a.mesh. REQUIRES: as above.
Result extract_label_interfaces(const Store& store, const LabelArguments& labels,
                                const ExtractArguments& a, const LabelQuery& query,
                                Progress& progress);

}  // namespace isonest::detail::cli
