#include <pybind11/numpy.h>
#include <pybind11/stl.h>

#include <cstddef>
#include <cstdint>
#include <cstring>
#include <limits>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include <isonest/extract.h>
#include <isonest/vertex_fields.h>

#include "tools/python/src/meshes.h"
#include "tools/python/src/progress.h"
#include "tools/python/src/stores.h"

namespace isonest::python {
namespace {

using Floats = py::array_t<float, py::array::c_style>;
using CornerNumbers = py::array_t<std::uint32_t, py::array::c_style>;

/// Collects the attributes of a mesh, one array each.
class FieldCollector : public MeshSink {
  public:
    void begin(const MeshLayout& layout) override {
        layout_ = layout;
        for (const VertexAttribute& attribute : layout.attributes) {
            rows_.emplace_back(layout.vertices * attribute.bytes());
        }
    }
    void add_vertices(const VertexBatch& batch) override {
        for (std::size_t a = 0; a < rows_.size(); ++a) {
            const VertexAttribute& attribute = layout_.attributes[a];
            for (std::size_t i = 0; i < batch.positions.size(); ++i) {
                std::memcpy(&rows_[a][(batch.first + i) * attribute.bytes()],
                            &batch.attributes[i * batch.row_bytes + attribute.offset],
                            attribute.bytes());
            }
        }
    }
    void add_elements(const ElementBatch& /*batch*/) override {}

    [[nodiscard]] const MeshLayout& layout() const { return layout_; }
    /// The numbers of an attribute, (vertices,) or (vertices, 3).
    [[nodiscard]] py::array array(std::size_t a) const {
        const VertexAttribute& attribute = layout_.attributes[a];
        std::vector<py::ssize_t> shape{static_cast<py::ssize_t>(layout_.vertices)};
        if (attribute.components > 1) {
            shape.push_back(attribute.components);
        }
        py::array array = attribute.is_double ? py::array(py::array_t<double>(shape))
                                              : py::array(py::array_t<float>(shape));
        if (!rows_[a].empty()) {
            std::memcpy(array.mutable_data(), rows_[a].data(), rows_[a].size());
        }
        return array;
    }

  private:
    MeshLayout layout_;
    std::vector<std::vector<std::byte>> rows_;
};

using FieldStores = std::vector<std::pair<std::string, std::vector<const OpenStore*>>>;

/// Returns the layout of the mesh with the fields, their arrays, and their bounds.
py::tuple fields_of_mesh(const MeshOrigin& origin, const Floats& positions,
                         const CornerNumbers& elements, const FieldStores& stores,
                         const ExtractOptions& options, const py::object& progress) {
    ArrayMesh mesh;
    mesh.vertices = static_cast<std::size_t>(positions.size()) / 3;
    mesh.positions = positions.data();
    mesh.elements =
        static_cast<std::size_t>(elements.size()) / static_cast<std::size_t>(origin.layout.corners);
    mesh.corners = elements.data();
    MeshOrigin bare = origin;
    bare.layout.attributes.clear();
    bare.layout.row_bytes = 0;
    bare.layout.has_sides = false;
    std::vector<std::shared_ptr<const Store>> open;
    std::vector<VertexField> fields;
    for (const auto& [name, components] : stores) {
        fields.push_back({name, {}});
        for (const OpenStore* const store : components) {
            open.push_back(store->get());
            fields.back().components.push_back(open.back().get());
        }
    }
    FieldCollector collector;
    std::vector<VertexFieldReport> reports;
    run_watched(progress, [&](Progress& p) {
        VertexFields all(fields, {options.memory, options.threads});
        write_mesh(mesh, bare, {}, *all.sink(collector), p);
        reports = all.reports();
    });
    MeshOrigin with = origin;
    py::list arrays;
    std::vector<double> bounds;
    for (std::size_t i = 0; i < reports.size(); ++i) {
        VertexAttribute attribute = collector.layout().attributes[i];
        attribute.offset = with.layout.row_bytes;
        with.layout.row_bytes += attribute.bytes();
        with.layout.attributes.push_back(std::move(attribute));
        arrays.append(collector.array(i));
        bounds.push_back(reports[i].bounded_elements > 0 || reports[i].unbounded_elements == 0
                             ? reports[i].linear_bound
                             : std::numeric_limits<double>::quiet_NaN());
    }
    for (const auto& store : open) {
        with.inputs.push_back(store->path());
    }
    return py::make_tuple(std::move(with), std::move(arrays), std::move(bounds));
}

}  // namespace

void add_mesh_fields(py::module_& module) {
    using namespace py::literals;
    module.def("fields_of_mesh", &fields_of_mesh, "layout"_a, "positions"_a, "elements"_a,
               "stores"_a, "options"_a, "progress"_a);
}

}  // namespace isonest::python
