// Quantities of other stores at the vertices of a mesh: a pressure on a surface of temperature, the
// CT values on the surface of an organ.
#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include <isonest/mesh_sink.h>
#include <isonest/values.h>

namespace isonest {

/// A quantity. Each vertex gets its value at the position of the vertex in the world. Its lattice
/// may differ from that of the mesh. Between the nodes of its store it is trilinear.
struct VertexField {
    /// Name of the attribute: up to 64 letters, digits and underscores, not starting with a digit.
    std::string name = {};
    /// One store, or three for the components x, y and z of a vector. They must outlive the
    /// VertexFields that uses them.
    std::vector<const Store*> components = {};
};

/// What is known of a field on all meshes that received it.
struct VertexFieldReport {
    std::string name = {};
    int components = 1;
    /// Vertices where a component is missing: they are outside the volume, or a value next to them
    /// is missing. Their attribute is NaN.
    std::uint64_t missing_vertices = 0;
    /// A proven bound: on every triangle (or line) without missing values near it, the linear
    /// function between its vertices differs from the field by at most this. The bound includes the
    /// rounding of the attributes to float32 and the rounding of the values in the store. For a
    /// vector, it holds for each component.
    double linear_bound = 0;
    /// Triangles (or lines) to which linear_bound does not apply, because of missing values.
    std::uint64_t unbounded_elements = 0;
    /// Those to which it applies; if there are none, linear_bound is 0.
    std::uint64_t bounded_elements = 0;
};

/// Adds fields to meshes on their way to a sink. Thread-safety: the sinks of one object may be used
/// at the same time; reports() may be called while none of them is used.
class VertexFields {
  public:
    /// Names that the attributes of a mesh or the columns of a mesh file already have.
    static bool is_reserved(const std::string& name);
    /// A name, in upper case, that two attributes or components of them have in formats that ignore
    /// case or add the axis to the name of a component; nothing if there is none.
    static std::optional<std::string> name_used_twice(std::span<const VertexAttribute> attributes);

    /// `options`: the memory is divided among the components. Throws Error{invalid_argument} for a
    /// name that is invalid, reserved or used twice (upper and lower case are the same in some
    /// formats), for a number of components other than 1 and 3; Error{unsupported} for labels;
    /// Error{limit} if there is too little memory.
    explicit VertexFields(std::vector<VertexField> fields, const ReadOptions& options = {});
    VertexFields(const VertexFields&) = delete;
    VertexFields& operator=(const VertexFields&) = delete;
    ~VertexFields();

    /// A sink that adds the fields to a mesh, after its other attributes, and passes it on. `inner`
    /// must outlive it. An attribute is float64 if the values are and `inner` holds float64, else
    /// float32. The sink is not concurrent. Throws what reading a store throws.
    [[nodiscard]] std::unique_ptr<MeshSink> sink(MeshSink& inner);
    [[nodiscard]] std::unique_ptr<MeshSink> sink(std::unique_ptr<MeshSink> inner);

    /// One report per field, on all meshes so far.
    [[nodiscard]] std::vector<VertexFieldReport> reports() const;

    struct Parts;

  private:
    std::unique_ptr<Parts> parts_;
};

}  // namespace isonest
