// The options shared by all commands that extract a mesh from a store.
#pragma once

#include <array>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include <isonest/extract.h>
#include <isonest/field.h>
#include <isonest/mesh_file.h>
#include <isonest/tileset.h>
#include <isonest/vertex_fields.h>

#include "tools/cli/program.h"

namespace isonest::detail::cli {

// Names of fields in options.

/// The indicator with this name. Throws Error{invalid_argument}, which lists the indicators.
Field parse_field(const std::string& option, const std::string& text);
/// The same, but also accepts the name of the values.
Field parse_field_or_values(const std::string& option, const std::string& text);
/// Several indicators, separated by commas; names of sets are accepted too
/// (indicators_from_name()). Returns them in the order of a store, without duplicates. Throws what
/// parse_field() throws.
std::vector<Field> parse_indicators(const std::string& option, const std::string& text);
/// note_on_name() for the names in the options of the parsed command, a line each; empty if there
/// are none.
std::string notes_on_names(const CLI::App& command);

/// A quantity by which vertices can be coloured, and its range.
struct ColoredField {
    std::string name;
    double low = 0;
    double high = 1;
};

/// The sink of a mesh for this file: it adds the fields, if there are any.
inline std::unique_ptr<MeshSink> with_fields(VertexFields* fields, std::unique_ptr<MeshSink> file) {
    return fields != nullptr ? fields->sink(std::move(file)) : std::move(file);
}

/// The parsed options.
struct ExtractArguments {
    std::string store;
    std::string mesh;
    ErrorBound error;
    std::optional<FieldThreshold> stop;  ///< replaces the error
    std::optional<Focus> focus;
    std::optional<Camera> camera;
    std::optional<WorldBox> box;
    bool normals = false;
    std::optional<Field> vertex_error;
    ExtractOptions options;
    std::optional<Cells> cells = {};
    std::string cells_name = {};  ///< as given
    bool is_slice = false;        ///< true for contour lines too
    bool is_graph = false;
    MeshSpace space = MeshSpace::automatic;    ///< space of the mesh file
    UpAxis up = UpAxis::z;                     ///< of the mesh file
    std::optional<LengthUnit> mesh_unit = {};  ///< of the positions in a mesh file
    std::string color_map = {};                ///< for colours of vertices; empty: none
    std::optional<std::array<double, 2>> color_range = {};
    std::optional<VertexColors> vertex_colors = {};  ///< set by choose_colors()
    /// Fields that are added to the meshes when they are written; null: none. Must live until all
    /// meshes are written.
    VertexFields* fields = nullptr;
    std::optional<ColoredField> field_to_color = {};  ///< the first scalar of `fields`
    bool tiles = false;                               ///< write 3D Tiles to the folder `mesh`
    std::optional<Georeference> georeference = {};    ///< of the tiles

    /// Options for writing the mesh file.
    [[nodiscard]] MeshFileOptions file_options() const {
        return {.replace = true,
                .title = {},
                .color = {},
                .space = space,
                .colors = vertex_colors,
                .up = up,
                .unit = mesh_unit};
    }
    template <class Stop>
    [[nodiscard]] Stop stop_test() const {
        return stop ? Stop(*stop) : Stop(error);
    }
    /// A query with the settings that all queries share.
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

/// Adds the options for the error, the stop test, focus and camera, --box, --memory and --threads.
void add_extract_options(CLI::App* command, ExtractArguments& a);

/// Sets vertex_colors from color_map and color_range; without the latter, the colours are from low
/// to high. Throws Error{invalid_argument} for an unknown map.
void choose_colors(ExtractArguments& a, const std::string& attribute, double low, double high);
/// The two values of --range, in ascending order, also by the name of a window.
std::array<double, 2> parse_range(const std::string& text);

/// Adds --space, --up and --mesh-unit, for the positions in a mesh file.
void add_space_options(CLI::App* command, ExtractArguments& a);
/// Adds "frame" (of the world) and "space" (of a mesh file with this name).
void add_space_json(AnatomicalFrame frame, const ExtractArguments& a, const std::string& mesh,
                    Json& json);
/// A line for the report if the positions in the mesh file differ from those of the store, else
/// empty.
std::string space_line(AnatomicalFrame frame, const ExtractArguments& a, const std::string& mesh);

/// Adds --cells, for surfaces, slices and graphs.
void add_cells_option(CLI::App* command, ExtractArguments& a);
/// Throws Error{invalid_argument} for hexahedra of a graph, or quadrilaterals of anything else.
void require_suitable_cells(const ExtractArguments& a);

/// "the trilinear function on hexahedra": the function to which a bound on the error refers.
std::string function_text(const ExtractReport& r);
/// "error at most 0.25 (asked for 0.3), of ...": what is known about the error of the mesh, in one
/// line.
/// "the store's values are rounded within 2\n"; empty if they are not.
std::string rounding_note(const Store& store);

/// "; the store's values are rounded within 2, which the error includes" (or the distance does
/// not); empty if they are not rounded.
std::string rounded_text(const ExtractReport& r);

std::string guarantee_text(const ExtractArguments& a, const ExtractReport& r);
/// Whether guarantee_text() states a bound on |U - iso| (for a slice, on |value - U|).
bool is_guaranteed(const ExtractReport& r);
/// A line that says which versions of other programs can read the mesh; empty if all can.
std::string version_text(const std::string& mesh);
/// Warns about files left by killed runs, and about coordinates that float32 rounds too coarsely;
/// may be empty.
std::string extract_warning(const ExtractArguments& a, const ExtractReport& r);
/// Whether box and volume overlap by more than a face, along every axis that is not flat.
bool reaches_volume(const Store& store, const WorldBox& box);
/// The range of the store's values: "0 to 255" or "labels 0 to 7".
std::string range_text(const Store& store);
/// "which lies between 0,0,0 and 9,9,9".
std::string volume_text(const Store& store);
/// Options for extract(); the scratch folder is the folder of the output.
ExtractOptions options_of(const ExtractArguments& a);
/// The members of the JSON report that all these commands have.
/// Where the mesh is not a manifold, and what was done about it, in lines; empty: nothing to say.
std::string manifold_text(const ExtractReport& r);
/// Adds the same; nothing if it was not counted.
void add_manifold_json(const ExtractReport& r, Json& json);
Json extract_json(const ExtractArguments& a, const ExtractReport& r);

}  // namespace isonest::detail::cli
