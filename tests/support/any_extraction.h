// All kinds of extraction with one interface, for tests that cover all of them: to a file, as in
// the program.
#pragma once

#include <filesystem>
#include <optional>
#include <vector>

#include <isonest/mesh_file.h>

#include "query/extract/extract.h"

namespace isonest::detail::test {

struct Extraction {
    double iso = 0;
    std::optional<double> graph_scale;  ///< the graph
    std::optional<WorldPlane> plane;    ///< a slice
    std::vector<double> contours;       ///< its contour lines
    std::optional<double> error;
    std::optional<double> error_relative;
    ErrorIndicator indicator = ErrorIndicator::deviation;
    std::optional<Field> stop;
    double threshold = 0;
    bool threshold_relative = false;
    std::optional<Field> bound;
    std::optional<Double3> view;
    std::optional<Field> cull_by;
    std::optional<Focus> focus;
    std::optional<Camera> camera;
    bool normals = false;
    std::optional<Field> vertex_error;
    const Store* values = nullptr;
    std::optional<WorldBox> box;
    std::optional<Outside> close;
    VertexPlace vertices = VertexPlace::linear;
    Cells cells = Cells::tetrahedra;
    std::uint64_t memory = std::uint64_t{1} << 30U;
    int threads = 0;

    /// StopTest or SurfaceStop.
    template <class Stop>
    [[nodiscard]] Stop stop_test() const {
        if (stop) {
            return FieldThreshold{*stop, threshold, threshold_relative};
        }
        return ErrorBound{error.value_or(error_relative.value_or(0)), error_relative.has_value(),
                          indicator};
    }
};

inline ExtractQuery query_of(const StoreReader& store, const Extraction& e, bool float64) {
    const auto start = [&](auto query) {
        query.stop = e.stop_test<decltype(query.stop)>();
        query.focus = e.focus;
        query.camera = e.camera;
        query.box = e.box;
        return query;
    };
    const auto with_attributes = [&](auto query) {
        query.attributes = {e.normals, e.values, e.vertex_error};
        return query;
    };
    if (!e.contours.empty()) {
        ContourQuery query = start(ContourQuery{});
        query.plane = e.plane.value();
        query.values = e.contours;
        return extract_query(store, query, float64);
    }
    if (e.plane) {
        SliceQuery query = with_attributes(start(SliceQuery{}));
        query.plane = *e.plane;
        query.cells = e.cells;
        return extract_query(store, query, float64);
    }
    if (e.graph_scale) {
        GraphQuery query = with_attributes(start(GraphQuery{}));
        query.scale = *e.graph_scale;
        query.cells = e.cells;
        return extract_query(store, query, float64);
    }
    SurfaceQuery query = with_attributes(start(SurfaceQuery{}));
    query.iso = e.iso;
    query.effort = Effort::none;
    query.grid = {e.cells, e.vertices, e.bound, {}};
    query.stages.close = e.close;
    if (e.view) {
        query.grid.culling = BackfaceCulling{*e.view, e.cull_by};
    }
    return extract_query(store, query, float64);
}

inline ExtractReport extract(const StoreReader& store, const Extraction& e, MeshSink& sink,
                             Progress& progress = silent_progress()) {
    return run_extraction(store, query_of(store, e, sink.holds_float64()), sink,
                          {e.memory, e.threads, {}}, progress);
}

/// Replaces the file. Temporary files are written next to it.
inline ExtractReport extract(const StoreReader& store, const std::filesystem::path& mesh,
                             const Extraction& e, Progress& progress) {
    const auto sink = open_mesh_file(mesh, {.replace = true});
    return run_extraction(store, query_of(store, e, sink->holds_float64()), *sink,
                          {e.memory, e.threads, mesh.parent_path()}, progress);
}

}  // namespace isonest::detail::test
