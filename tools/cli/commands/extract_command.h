// What the options of extract say, and what is said of what they gave.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include <isonest/extract.h>
#include <isonest/open_volume.h>

#include "tools/cli/command.h"
#include "tools/cli/options/distance_options.h"
#include "tools/cli/options/extract_options.h"
#include "tools/cli/options/isovalue_option.h"
#include "tools/cli/options/label_options.h"
#include "tools/cli/options/remote_options.h"

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
    std::vector<std::string> input;               ///< a store, or a volume
    SourceOptions source;                         ///< how to read a volume
    std::string source_option = {};               ///< one of them that was given, or empty
    std::vector<std::string> store_options = {};  ///< those given that are of stores alone
    RemoteArguments remote = {};

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
    /// Throws Error{invalid_argument} for options that do not go together.
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

/// The surface of a volume file. Throws what open_volume() and extract() throw, and
/// Error{invalid_argument} for what needs a store.
Result extract_volume_file(ExtractCommand arguments, bool has_iso, Progress& progress);

/// The store of vertex values, if one was asked for. It is open as long as `progress` is there.
/// Throws what open_store() throws.
std::optional<Store> open_values(ExtractCommand& arguments, Progress& progress);

}  // namespace isonest::detail::cli
