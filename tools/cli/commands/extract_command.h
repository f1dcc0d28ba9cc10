// What the options of extract say, and what is said of what they gave.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include <isonest/extract.h>
#include <isonest/open_volume.h>

#include "tools/cli/commands/input_store.h"
#include "tools/cli/options/extract_options.h"
#include "tools/cli/options/label_options.h"
#include "tools/cli/options/surface_options.h"
#include "tools/cli/program.h"

namespace isonest::detail::cli {

/// What the options say.
struct ExtractCommand {
    ExtractArguments extract;
    Isovalues isovalues;
    double scale = 1;  ///< of the graph
    std::optional<Field> bound;
    std::optional<BackfaceCulling> culling;
    DistanceArguments distance;
    std::optional<ComponentChoice> components;
    std::optional<Outside> close;
    bool volume_interval = false;
    VertexPlace vertices = VertexPlace::linear;
    std::string values;  ///< a second store, or empty
    LabelArguments labels;
    InputArguments in;

    /// What surfaces and graphs have. `values`: the store of vertex values, or null.
    template <class Query>
    [[nodiscard]] Query begun(const Store* others) const {
        auto query = extract.query<Query>();
        query.attributes = {extract.normals, others, extract.vertex_error};
        return query;
    }
    /// The surface of a label, made as `like` says. Throws as isonest::label_query().
    [[nodiscard]] LabelQuery label_query(const SurfaceQuery& like, const LabelChoice& label) const {
        LabelQuery query = isonest::label_query(like, label);
        query.smooth = labels.smooth;
        if (query.smooth) {
            query.smooth->keep_nodes = labels.keep_nodes;
        }
        return query;
    }
    /// Whether the mesh of a surface is simplified, as far as the options alone tell.
    [[nodiscard]] bool is_simplified() const;
    /// Throws Error{invalid_argument} for options that cannot be combined.
    [[nodiscard]] SurfaceQuery surface_query(const Store* others) const;
};

/// What was extracted from: a store or a volume.
struct ExtractOrigin {
    const Store* store = nullptr;
    VolumeSource* volume = nullptr;
    std::optional<LengthUnit> unit = {};
    AnatomicalFrame frame = AnatomicalFrame::unknown;
    std::string why_empty = {};  ///< of a volume whose surface is
};

/// What is said of one mesh.
Result result_of(const ExtractOrigin& origin, const ExtractCommand& arguments,
                 const ExtractReport& r);

/// Whether what the options ask of a volume is found without a store.
bool needs_no_store(VolumeSource& volume, const ExtractCommand& arguments, bool has_iso);
/// The fields of the default store, and those that the options ask for.
std::vector<Field> fields_of(const ExtractCommand& arguments);
/// The surface straight from a volume. REQUIRES: needs_no_store(). Throws what open_volume() and
/// extract() throw.
Result extract_from_volume(VolumeSource& volume, ExtractCommand arguments, Progress& progress);

/// The store of vertex values, if one was asked for. It is open as long as `progress` is there.
/// Throws what open_store() throws.
std::optional<Store> open_values(ExtractCommand& arguments, Progress& progress);

}  // namespace isonest::detail::cli
