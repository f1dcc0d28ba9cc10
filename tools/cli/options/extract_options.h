// The options that all commands share which extract a mesh from a store.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include <isonest/extract.h>
#include <isonest/field.h>
#include <isonest/mesh_file.h>

#include "tools/cli/program.h"

namespace isonest::detail::cli {

// Names of fields in options.

/// An indicator's field. Throws Error{invalid_argument} listing those there are.
Field parse_field(const std::string& option, const std::string& text);
/// The same, or the values.
Field parse_field_or_values(const std::string& option, const std::string& text);
/// Several indicators, with commas, and names of sets of them (indicators_from_name()); in the
/// store's order, each once. Throws as parse_field().
std::vector<Field> parse_indicators(const std::string& option, const std::string& text);

/// What the options say.
struct ExtractArguments {
    std::string store;
    std::string mesh;
    ErrorBound error;
    std::optional<FieldThreshold> stop;  ///< in place of the error
    std::optional<Focus> focus;
    std::optional<Camera> camera;
    std::optional<WorldBox> box;
    bool normals = false;
    std::optional<Field> vertex_error;
    ExtractOptions options;
    std::optional<Cells> cells = {};
    std::string cells_name = {};  ///< as it was given
    bool is_slice = false;        ///< or contour lines
    bool is_graph = false;
    MeshSpace space = MeshSpace::automatic;  ///< of the mesh's file

    /// How the mesh's file is written.
    [[nodiscard]] MeshFileOptions file_options() const {
        return {.replace = true, .title = {}, .color = {}, .space = space};
    }
    template <class Stop>
    [[nodiscard]] Stop stop_test() const {
        return stop ? Stop(*stop) : Stop(error);
    }
    /// What all queries have.
    template <class Query>
    [[nodiscard]] Query query() const {
        Query query;
        query.stop = stop_test<decltype(query.stop)>();
        query.focus = focus;
        query.camera = camera;
        query.box = box;
        return query;
    }
};

/// The error, the stop test, focus and camera, --box, --memory, --threads.
void add_extract_options(CLI::App* command, ExtractArguments& a);

/// The fields of a default store, and those that the options ask for; some may be there twice.
/// `coarse_cells`: hexahedra or quadrilaterals are not all at full resolution.
std::vector<Field> fields_of(const ExtractArguments& a, bool coarse_cells);

/// --space, of what is written as a mesh.
void add_space_option(CLI::App* command, ExtractArguments& a);
/// "frame" of the world and "space" of a mesh in a file of this name.
void add_space_json(AnatomicalFrame frame, const ExtractArguments& a, const std::string& mesh,
                    Json& json);
/// A line that says that the mesh's positions are not the stored ones; or empty.
std::string space_line(AnatomicalFrame frame, const ExtractArguments& a, const std::string& mesh);

/// --cells, of surfaces, slices and graphs.
void add_cells_option(CLI::App* command, ExtractArguments& a);
/// Throws Error{invalid_argument} for hexahedra of a graph, and quadrilaterals of anything else.
void require_suitable_cells(const ExtractArguments& a);

/// "the trilinear function on hexahedra": what a bound on the values' error refers to.
std::string function_text(const ExtractReport& r);
/// "error at most 0.25 (asked for 0.3), of ...": what the error of the mesh is known to be, in one
/// line.
std::string guarantee_text(const ExtractArguments& a, const ExtractReport& r);
/// Whether the line above is a bound on |U - iso| (or on |value - U| in a slice).
bool is_guaranteed(const ExtractReport& r);
/// A line that says which versions of other programs read the mesh, where that is not all; or
/// empty.
std::string version_text(const std::string& mesh);
/// What was left behind by killed runs, and coordinates that float32 rounds too much; or empty.
std::string extract_warning(const ExtractArguments& a, const ExtractReport& r);
/// Whether the box and the volume have more than a face in common along each axis that the volume
/// has.
bool reaches_volume(const Store& store, const WorldBox& box);
/// "0 to 255", or "labels 0 to 7": of the store's values.
std::string range_text(const Store& store);
/// "which lies between 0,0,0 and 9,9,9".
std::string volume_text(const Store& store);
/// The folder of the output: what does not fit into the memory goes there too.
ExtractOptions options_of(const ExtractArguments& a);
/// What every such command reports.
Json extract_json(const ExtractArguments& a, const ExtractReport& r);

}  // namespace isonest::detail::cli
