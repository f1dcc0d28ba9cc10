#include <fmt/format.h>

#include <string>
#include <utility>

#include <isonest/error.h>
#include <isonest/neuroglancer_meshes.h>

#include "query/extract/labels/smooth_labels.h"
#include "query/neuroglancer/encode_fragment.h"
#include "query/neuroglancer/label_files.h"

namespace isonest {
namespace {

/// Throws what extract_neuroglancer_meshes() does before any work.
void require_segments(const Store& store, std::span<const Label> labels) {
    const std::string name = store.reader().path().string();
    if (!has_neuroglancer_meshes()) {
        throw Error(ErrorKind::unsupported,
                    "Neuroglancer's meshes of several levels of detail are packed by Draco, which "
                    "this build does not have",
                    {{RemedyKind::install_package, "libdraco-dev"}});
    }
    for (const Label& label : labels) {
        if (label.id < 0) {
            throw Error(ErrorKind::invalid_argument, {name},
                        fmt::format("label {}: Neuroglancer has no labels below 0", label.id));
        }
    }
}

/// Names of these labels, if any has one.
std::vector<LabelName> names_of(const Store& store, std::span<const Label> labels) {
    std::vector<LabelName> names;
    bool has_name = false;
    for (const Label& label : labels) {
        LabelName name = store.label_name(label.id).value_or(LabelName{});
        name.id = label.id;
        has_name = has_name || !name.name.empty();
        names.push_back(std::move(name));
    }
    return has_name ? names : std::vector<LabelName>{};
}

}  // namespace

Double3 shift_of(const Store& store, VoxelOrigin origin) {
    Double3 shift{};
    const auto& header = store.reader().layout().header();
    for (std::size_t axis = 0; axis < 3 && origin == VoxelOrigin::corner; ++axis) {
        for (std::size_t row = 0; row < 3; ++row) {
            shift[row] += header.direction[axis][row] * header.spacing[axis] / 2;
        }
    }
    return shift;
}

bool has_neuroglancer_meshes() {
    return detail::has_draco();
}

void extract_neuroglancer_meshes(
    const Store& store, std::span<const Label> labels, const LabelQuery& query,
    const std::filesystem::path& folder,
    const std::function<void(std::size_t number, const NeuroglancerReport&)>& done,
    const ExtractOptions& options, Progress& progress, VoxelOrigin origin) {
    require_segments(store, labels);
    detail::neuroglancer_labels(store.reader(), labels, query, folder, done, options, progress);
    const std::vector<LabelName> names = names_of(store, labels);
    if (!names.empty()) {
        detail::write_segment_properties(folder, names);
    }
    detail::write_mesh_info(folder, store.reader().layout().header(), shift_of(store, origin),
                            !names.empty());
}

}  // namespace isonest
