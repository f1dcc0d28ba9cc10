// The options of extract, and the report on its results.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include <isonest/extract.h>
#include <isonest/open_volume.h>

#include "tools/cli/commands/input_store.h"
#include "tools/cli/commands/vertex_values.h"
#include "tools/cli/options/extract_options.h"
#include "tools/cli/options/label_options.h"
#include "tools/cli/options/surface_options.h"
#include "tools/cli/program.h"

namespace isonest::detail::cli {

/// The parsed options.
struct ExtractCommand {
    ExtractArguments extract;
    Isovalues isovalues;
    double scale = 1;  ///< of the values of a graph
    std::optional<Field> bound;
    std::optional<BackfaceCulling> culling;
    DistanceArguments distance;
    std::optional<ComponentChoice> components;
    std::optional<Outside> close;
    bool volume_interval = false;
    bool manifold = false;  ///< separate sheets that touch
    VertexPlace vertices = VertexPlace::linear;
    std::string values;  ///< location of a second store, or empty
    std::vector<NamedValues> named_values;
    std::string times;  ///< the steps of a series; empty: all
    LabelArguments labels;
    InputArguments in;

    /// A query with the attributes that surfaces and graphs share. `others`: the store of vertex
    /// values, or null.
    template <class Query>
    [[nodiscard]] Query begun(const Store* others) const {
        auto query = extract.query<Query>();
        query.attributes = {extract.normals, others, extract.vertex_error};
        return query;
    }
    /// The query for the surface of a label, with the settings of `like`. Throws what
    /// isonest::label_query() throws.
    [[nodiscard]] LabelQuery label_query(const SurfaceQuery& like, const LabelChoice& label) const {
        LabelQuery query = isonest::label_query(like, label);
        query.smooth = labels.smooth;
        if (query.smooth) {
            query.smooth->keep_nodes = labels.keep_nodes;
        }
        return query;
    }
    /// Whether the mesh will be simplified, judging by the options alone.
    [[nodiscard]] bool is_simplified() const;
    /// Throws Error{invalid_argument} for options that cannot be combined.
    [[nodiscard]] SurfaceQuery surface_query(const Store* others) const;
};

/// The store or volume from which a mesh was extracted.
struct ExtractOrigin {
    const Store* store = nullptr;
    VolumeSource* volume = nullptr;
    std::optional<LengthUnit> unit = {};
    AnatomicalFrame frame = AnatomicalFrame::unknown;
    std::string why_empty = {};  ///< for a volume without a surface: the reason
};

/// The report on one mesh.
Result result_of(const ExtractOrigin& origin, const ExtractCommand& arguments,
                 const ExtractReport& r);

/// Whether the request can be answered from the volume without a store.
bool needs_no_store(VolumeSource& volume, const ExtractCommand& arguments, bool has_iso);
/// Extracts the surface directly from the volume. REQUIRES: needs_no_store(). Throws what
/// open_volume() and extract() throw.
Result extract_from_volume(VolumeSource& volume, ExtractCommand arguments, Progress& progress);

/// Opens the store of vertex values, if there is one. `progress` must outlive the store. Throws
/// what open_store() throws.
std::optional<Store> open_values(ExtractCommand& arguments, Progress& progress);

}  // namespace isonest::detail::cli
