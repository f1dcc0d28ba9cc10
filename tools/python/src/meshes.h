// Extraction from stores to arrays, and writing meshes in arrays to files.
#pragma once

#include <pybind11/pybind11.h>

#include <array>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <vector>

#include <isonest/label_name.h>
#include <isonest/mesh_sink.h>
#include <isonest/progress.h>

namespace isonest::python {

/// What is known about an extracted mesh besides its arrays.
struct MeshOrigin {
    MeshLayout layout;
    std::vector<std::filesystem::path> inputs;  ///< the files from which it was made
    LabelName label = {};  ///< name and colour of the label, for the surface of a label
};

/// The rows of a field (vertex_fields.h) that somebody else owns.
struct ArrayField {
    const std::byte* rows = nullptr;
    bool is_double = false;
};

/// A mesh in arrays that it does not own. Attributes that the layout lacks are null.
struct ArrayMesh {
    std::size_t vertices = 0;
    const float* positions = nullptr;  ///< x, y, z
    std::size_t elements = 0;
    const std::uint32_t* corners = nullptr;  ///< the layout says how many per element
    bool flip = false;                       ///< reverse the corners of each element
    const float* normals = nullptr;
    const double* values = nullptr;
    const float* errors = nullptr;
    std::vector<ArrayField> fields = {};                 ///< in the order of the layout
    const std::array<std::int64_t, 2>* sides = nullptr;  ///< labels on both sides of each element
};

/// Sends the mesh to the sink like the extraction did, so that a file has the same bytes. Values
/// are rounded if the sink stores float32 only. `path`: of the file, for messages. Throws
/// Error{invalid_argument} if a corner is not a vertex, Error{limit} for values too large for
/// float32, Error{cancelled}, and what the sink throws.
void write_mesh(const ArrayMesh& mesh, const MeshOrigin& origin, const std::filesystem::path& path,
                MeshSink& sink, Progress& progress);

namespace py = pybind11;

/// Adds the functions for extraction, MeshLayout and save_mesh(). REQUIRES: add_queries(),
/// add_stores() and add_reports() were called.
void add_meshes(py::module_& module);
/// Adds the function for values of other stores at the vertices of a mesh. REQUIRES: as
/// add_meshes(), which calls it.
void add_mesh_fields(py::module_& module);

}  // namespace isonest::python
