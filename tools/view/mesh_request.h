// What the page asks for in a mesh, as numbers and as a query of the library.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <variant>

#include <isonest/extract.h>

#include "tools/view/request_target.h"

namespace isonest::detail::view {

/// As few triangles as the error that is chosen leaves.
struct AtMostTriangles {
    std::uint64_t most = 0;
};

struct MeshRequest {
    std::variant<double, LabelChoice, WorldPlane> what;  ///< an isovalue, a label, a slice
    std::variant<AtMostTriangles, ErrorBound, DistanceBound> stop;
    std::optional<Camera> camera = {};
    std::optional<std::uint64_t> limit = {};  ///< of triangles; beyond, AtMostTriangles
    std::optional<WorldBox> box = {};
    bool largest_component = false;
    std::optional<LabelSmoothing> smooth = {};  ///< of a label

    [[nodiscard]] bool is_slice() const { return std::holds_alternative<WorldPlane>(what); }
};

/// Takes the parameters of a surface or, if `is_slice`, a slice (PROTOCOL.md). Throws
/// Error{invalid_argument}, naming the parameter.
MeshRequest parse_mesh_request(RequestTarget& target, bool is_slice, bool are_labels);

/// The queries that give the mesh, at `stop` in place of AtMostTriangles. REQUIRES: it is one. Of
/// surfaces with normals, but those of smooth labels. Throws Error{invalid_argument} for what
/// labels do not have.
SurfaceQuery surface_query(const MeshRequest& request, const SurfaceStop& stop);
LabelQuery label_query(const MeshRequest& request, const SurfaceStop& stop);
SliceQuery slice_query(const MeshRequest& request, const StopTest& stop);
/// Of a store with one node along z: the data in their plane, with values, whatever plane is asked
/// for.
GraphQuery plane_query(const MeshRequest& request, const StopTest& stop, const Store& store);

/// The command line that makes the mesh `output` of the store, quoted for a shell. REQUIRES: the
/// stop is not AtMostTriangles.
std::string command_line(const MeshRequest& request, const Store& store, const std::string& output);

}  // namespace isonest::detail::view
