// A mesh requested by the page, as parameters and as a query of the library.
#pragma once

#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <string_view>
#include <variant>
#include <vector>

#include <isonest/extract.h>

namespace isonest::detail::view {

// The path and the parameters of a request.

/// Throws Error{invalid_argument}.
[[noreturn]] void fail(const std::string& problem);

/// The answering code must take every parameter; those that are left are unknown.
class RequestTarget {
  public:
    /// "/api/surface?iso=1&box=0,0,0,1,1,1". Throws Error{invalid_argument} if this is malformed,
    /// has more than 32 parameters, or a parameter twice.
    explicit RequestTarget(std::string_view target);

    [[nodiscard]] const std::string& path() const { return path_; }
    [[nodiscard]] bool has(const std::string& name) const;
    /// Takes a parameter; none if it is absent.
    std::optional<std::string> text(const std::string& name);
    // The same for numbers, which must be finite. These throw Error{invalid_argument}, naming the
    // parameter.
    std::optional<double> number(const std::string& name, double lowest, double highest);
    std::optional<std::int64_t> integer(const std::string& name, std::int64_t lowest,
                                        std::int64_t highest);
    std::optional<std::vector<double>> numbers(const std::string& name, std::size_t count,
                                               std::string_view form);
    /// Throws Error{invalid_argument} if parameters are left.
    void require_all_taken() const;

  private:
    std::string path_;
    std::map<std::string, std::string> parameters_;
};

/// The smallest error that gives at most this many triangles.
struct AtMostTriangles {
    std::uint64_t most = 0;
};

struct MeshRequest {
    std::variant<double, LabelChoice, WorldPlane> what;  ///< an isovalue, a label or a slice
    std::variant<AtMostTriangles, ErrorBound, DistanceBound> stop;
    Effort effort = Effort::best;  ///< for a distance
    std::optional<Camera> camera = {};
    std::optional<std::uint64_t> limit = {};  ///< of triangles; above it, as AtMostTriangles
    std::optional<WorldBox> box = {};
    bool largest_component = false;
    std::optional<LabelSmoothing> smooth = {};  ///< for a label
    std::string color = {};                     ///< the quantity by which a surface is coloured
    const Store* color_store = nullptr;         ///< its values; null: none

    [[nodiscard]] bool is_slice() const { return std::holds_alternative<WorldPlane>(what); }
};

/// Takes the parameters of a surface or, if `is_slice`, of a slice (PROTOCOL.md). Throws
/// Error{invalid_argument}, naming the parameter.
MeshRequest parse_mesh_request(RequestTarget& target, bool is_slice, bool are_labels);

/// The queries that make the mesh, with `stop` in place of AtMostTriangles. REQUIRES: the request
/// is of this kind. Surfaces have normals, except those of smooth labels. Throws
/// Error{invalid_argument} for what labels do not support.
SurfaceQuery surface_query(const MeshRequest& request, const SurfaceStop& stop);
LabelQuery label_query(const MeshRequest& request, const SurfaceStop& stop);
SliceQuery slice_query(const MeshRequest& request, const StopTest& stop);
/// For a store with one node along z: the whole plane of data, with values. The requested plane is
/// ignored.
GraphQuery plane_query(const MeshRequest& request, const StopTest& stop, const Store& store);

/// The shell command that makes the mesh `output` from the store; its words are quoted. REQUIRES:
/// the stop is not AtMostTriangles.
std::string command_line(const MeshRequest& request, const Store& store, const std::string& output);

/// The error itself, or if rounded values do not permit it, the smallest larger one that they
/// permit: sliders do not take the tolerance into account.
ErrorBound possible_error(const ErrorBound& asked, const Store& store);

}  // namespace isonest::detail::view
