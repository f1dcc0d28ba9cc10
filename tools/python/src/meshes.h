// Meshes: from a store to arrays, and from arrays to files.
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

// A mesh that lies in arrays, handed to a sink.

/// What an extraction said of a mesh beside its arrays.
struct MeshOrigin {
    MeshLayout layout;
    std::vector<std::filesystem::path> inputs;  ///< the files that it was made from
    LabelName label = {};                       ///< that it is of: its name and colour
};

/// The arrays, which belong to somebody else; an attribute that the layout has not is null.
struct ArrayMesh {
    std::size_t vertices = 0;
    const float* positions = nullptr;  ///< x, y, z
    std::size_t elements = 0;
    const std::uint32_t* corners = nullptr;  ///< of an element as many as the layout says
    bool flip = false;                       ///< the corners of each element come backwards
    const float* normals = nullptr;
    const double* values = nullptr;
    const float* errors = nullptr;
    const std::array<std::int64_t, 2>* sides = nullptr;  ///< of each element
};

/// Hands the sink what the extraction would have handed it: a file has the same bytes. Values that
/// the sink holds as float32 alone are rounded. `path`: of the file, for messages. Throws
/// Error{invalid_argument} if a corner is no vertex, Error{limit} for values beyond float32,
/// Error{cancelled}, and what the sink throws.
void write_mesh(const ArrayMesh& mesh, const MeshOrigin& origin, const std::filesystem::path& path,
                MeshSink& sink, Progress& progress);

namespace py = pybind11;

/// Adds extract(), extract_labels(), MeshLayout and save_mesh(). REQUIRES: add_queries(),
/// add_stores() and add_reports() were called.
void add_meshes(py::module_& module);

}  // namespace isonest::python
