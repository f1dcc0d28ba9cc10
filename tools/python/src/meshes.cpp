#include "tools/python/src/meshes.h"

#include <pybind11/numpy.h>
#include <pybind11/stl.h>
#include <pybind11/stl/filesystem.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <filesystem>
#include <iterator>
#include <limits>
#include <map>
#include <memory>
#include <optional>
#include <set>
#include <span>
#include <string>
#include <tuple>
#include <type_traits>
#include <utility>
#include <variant>
#include <vector>

#include <isonest/error.h>
#include <isonest/extract.h>
#include <isonest/labels.h>
#include <isonest/march.h>
#include <isonest/mesh_file.h>

#include "query/extract/combinations.h"
#include "query/formats/mesh_files.h"
#include "tools/python/src/progress.h"
#include "tools/python/src/queries.h"
#include "tools/python/src/sources.h"
#include "tools/python/src/stores.h"

namespace isonest::python {
namespace {

using Position = std::array<float, 3>;

/// The layout with float64 attributes changed to float32.
MeshLayout in_float32(MeshLayout layout) {
    layout.row_bytes = 0;
    for (VertexAttribute& attribute : layout.attributes) {
        attribute.is_double = false;
        attribute.offset = layout.row_bytes;
        layout.row_bytes += attribute.bytes();
    }
    return layout;
}

/// Rows of a mesh in the form that batches have.
class Rows {
  public:
    Rows(const ArrayMesh& mesh, const MeshLayout& layout, const std::filesystem::path& path)
        : mesh_(mesh), layout_(layout), path_(path), fields_(layout.attributes.size()) {
        std::size_t next = 0;
        for (std::size_t i = 0; i < fields_.size(); ++i) {
            if (!detail::is_of_extraction(layout.attributes[i])) {
                fields_[i] = mesh.fields.at(next++);
            }
        }
    }

    void clear() {
        positions_.clear();
        attributes_.clear();
    }
    void add(std::size_t vertex) {
        const float* const p = mesh_.positions + 3 * vertex;
        positions_.push_back({p[0], p[1], p[2]});
        attributes_.resize(attributes_.size() + layout_.row_bytes);
        std::byte* const row = attributes_.data() + attributes_.size() - layout_.row_bytes;
        for (std::size_t i = 0; i < fields_.size(); ++i) {
            const VertexAttribute& attribute = layout_.attributes[i];
            if (fields_[i].rows != nullptr) {
                put(fields_[i], attribute, vertex, row + attribute.offset);
            } else {
                put(attribute, vertex, row + attribute.offset);
            }
        }
    }
    [[nodiscard]] VertexBatch batch(std::size_t first) const {
        return {first, positions_, attributes_, layout_.row_bytes};
    }

  private:
    void put(const VertexAttribute& attribute, std::size_t vertex, std::byte* to) const {
        if (attribute.name == "normal") {
            std::memcpy(to, mesh_.normals + 3 * vertex, attribute.bytes());
        } else if (attribute.name == "error") {
            std::memcpy(to, mesh_.errors + vertex, attribute.bytes());
        } else if (attribute.is_double) {
            std::memcpy(to, mesh_.values + vertex, attribute.bytes());
        } else {
            put_rounded(mesh_.values[vertex], to);
        }
    }
    void put(const ArrayField& field, const VertexAttribute& attribute, std::size_t vertex,
             std::byte* to) const {
        if (field.is_double == attribute.is_double) {
            std::memcpy(to, field.rows + vertex * attribute.bytes(), attribute.bytes());
            return;
        }
        const auto components = static_cast<std::size_t>(attribute.components);
        for (std::size_t c = 0; c < components; ++c) {
            double value = 0;
            std::memcpy(&value, field.rows + (vertex * components + c) * sizeof(value),
                        sizeof(value));
            put_rounded(value, to + c * sizeof(float));
        }
    }
    void put_rounded(double value, std::byte* to) const {
        if (std::fabs(value) > static_cast<double>(std::numeric_limits<float>::max())) {
            throw Error(ErrorKind::limit, {path_.string()},
                        "the values are beyond the range of the format's 32-bit floats",
                        {{RemedyKind::other_format, ".ply, .vtp, .vtkhdf"}});
        }
        const auto rounded = static_cast<float>(value);
        std::memcpy(to, &rounded, sizeof(rounded));
    }

    const ArrayMesh& mesh_;
    const MeshLayout& layout_;
    const std::filesystem::path& path_;
    std::vector<ArrayField> fields_;  ///< of each attribute of the layout; null rows: none
    std::vector<Position> positions_;
    std::vector<std::byte> attributes_;
};

void send_vertices(const ArrayMesh& mesh, Rows& rows, MeshSink& sink, Progress& progress) {
    for (std::size_t at = 0; at < mesh.vertices; at += MeshSink::kMaxRows) {
        progress.check();
        rows.clear();
        for (std::size_t i = at; i < std::min(mesh.vertices, at + MeshSink::kMaxRows); ++i) {
            rows.add(i);
        }
        sink.add_vertices(rows.batch(at));
    }
}

/// The vertices of element i; for a line, the last one is repeated.
std::array<std::uint64_t, 3> corners_of(const ArrayMesh& mesh, std::size_t count, std::size_t i) {
    const std::uint32_t* const c = mesh.corners + count * i;
    std::array<std::uint64_t, 3> corners{};
    for (std::size_t k = 0; k < corners.size(); ++k) {
        const std::size_t forward = std::min(k, count - 1);
        corners.at(k) = c[mesh.flip ? count - 1 - forward : forward];
        if (corners.at(k) >= mesh.vertices) {
            throw Error(ErrorKind::invalid_argument, "a face has an invalid vertex index");
        }
    }
    return corners;
}

void send_elements(const ArrayMesh& mesh, std::size_t corners, Rows& rows, MeshSink& sink,
                   Progress& progress) {
    std::vector<std::array<std::uint64_t, 3>> numbers;
    std::vector<std::array<std::uint32_t, 3>> nearby;
    for (std::size_t at = 0; at < mesh.elements; at += MeshSink::kMaxRows) {
        progress.check();
        rows.clear();
        numbers.clear();
        nearby.clear();
        for (std::size_t i = at; i < std::min(mesh.elements, at + MeshSink::kMaxRows); ++i) {
            numbers.push_back(corners_of(mesh, corners, i));
            const auto first = static_cast<std::uint32_t>(3 * (i - at));
            nearby.push_back({first, first + 1, first + 2});
            for (const std::uint64_t vertex : numbers.back()) {
                rows.add(static_cast<std::size_t>(vertex));
            }
        }
        ElementBatch batch{at, numbers, nearby, rows.batch(0)};
        if (mesh.sides != nullptr) {
            batch.sides = {mesh.sides + at, numbers.size()};
        }
        sink.add_elements(batch);
        progress.advance(numbers.size());
    }
}

}  // namespace

void write_mesh(const ArrayMesh& mesh, const MeshOrigin& origin, const std::filesystem::path& path,
                MeshSink& sink, Progress& progress) {
    MeshLayout layout = sink.holds_float64() ? origin.layout : in_float32(origin.layout);
    layout.vertices = mesh.vertices;
    layout.elements = mesh.elements;
    sink.prepare(layout, origin.inputs);
    sink.begin(layout);
    Rows rows(mesh, layout, path);
    do {
        progress.begin("write mesh", mesh.elements, "triangles");
        send_vertices(mesh, rows, sink, progress);
        send_elements(mesh, static_cast<std::size_t>(layout.corners), rows, sink, progress);
    } while (sink.again());
    sink.end();
}

namespace {

/// Collects a mesh in memory, with what is needed to save it to a file later.
class Collector : public MeshCollector {
  public:
    void prepare(const MeshLayout& layout, std::span<const std::filesystem::path> inputs) override {
        MeshCollector::prepare(layout, inputs);
        origin_.inputs.assign(inputs.begin(), inputs.end());
    }
    void begin(const MeshLayout& layout) override {
        MeshCollector::begin(layout);
        origin_.layout = layout;
    }
    [[nodiscard]] const MeshOrigin& origin() const { return origin_; }
    /// Marks the mesh as the surface of this label.
    void set_label(const Store& store, std::int64_t id) {
        origin_.label = store.label_name(id).value_or(LabelName{id});
    }

  private:
    MeshOrigin origin_;
};

/// A sink that shares the mesh, which outlives the sink: the extraction owns and destroys the sink.
class SharedSink : public MeshSink {
  public:
    explicit SharedSink(std::shared_ptr<Collector> mesh) : mesh_(std::move(mesh)) {}
    void prepare(const MeshLayout& layout, std::span<const std::filesystem::path> inputs) override {
        mesh_->prepare(layout, inputs);
    }
    void begin(const MeshLayout& layout) override { mesh_->begin(layout); }
    void add_vertices(const VertexBatch& batch) override { mesh_->add_vertices(batch); }
    void add_elements(const ElementBatch& batch) override { mesh_->add_elements(batch); }
    [[nodiscard]] bool concurrent() const override { return mesh_->concurrent(); }

  private:
    std::shared_ptr<Collector> mesh_;
};

template <class T>
py::object array_or_none(std::vector<T>&& rows, const MeshLayout& layout, const char* name) {
    return layout.find(name) == nullptr ? py::object(py::none())
                                        : py::object(as_array(std::move(rows)));
}

/// Returns (positions, elements, normals, values, errors, origin, report); the arrays own the mesh.
py::tuple as_tuple(Collector& mesh, ExtractReport report) {
    const MeshLayout& layout = mesh.origin().layout;
    py::array elements =
        layout.corners == 2 ? as_array(std::move(mesh.lines)) : as_array(std::move(mesh.triangles));
    return py::make_tuple(as_array(std::move(mesh.vertices)), std::move(elements),
                          array_or_none(std::move(mesh.normals), layout, "normal"),
                          array_or_none(std::move(mesh.values), layout, "value"),
                          array_or_none(std::move(mesh.errors), layout, "error"), mesh.origin(),
                          std::move(report));
}

template <class Query>
ExtractReport extract_asked(const Store& store, const Asked<Query>& asked, MeshSink& mesh,
                            const ExtractOptions& options, Progress& progress) {
    return extract(store, asked.query, mesh, options, progress);
}
ExtractReport extract_asked(const Store& store, const AskedSurface& asked, MeshSink& mesh,
                            const ExtractOptions& options, Progress& progress) {
    return asked.label ? extract(store, asked.label_query(*asked.label), mesh, options, progress)
                       : extract(store, asked.query, mesh, options, progress);
}

template <class A>
py::tuple extract_mesh(const OpenStore& handle, const A& asked, const ExtractOptions& options,
                       const py::object& progress) {
    const std::shared_ptr<const Store> store = handle.get();
    Collector mesh;
    ExtractReport report;
    run_watched(progress,
                [&](Progress& p) { report = extract_asked(*store, asked, mesh, options, p); });
    if constexpr (std::is_same_v<A, AskedSurface>) {
        if (asked.label) {
            mesh.set_label(*store, asked.label->id);
        }
    }
    return as_tuple(mesh, std::move(report));
}

/// An uninitialised array (n, 3). NumPy requests huge pages for large ones.
template <class T>
py::array_t<T> rows_of_three(std::uint64_t n) {
    return py::array_t<T>(std::vector<py::ssize_t>{static_cast<py::ssize_t>(n), 3});
}
template <class T>
std::span<std::array<T, 3>> rows_in(py::array_t<T>& rows) {
    return {reinterpret_cast<std::array<T, 3>*>(rows.mutable_data()),
            static_cast<std::size_t>(rows.shape(0))};
}

/// Extracts the surface at full resolution directly into NumPy arrays.
py::tuple march_mesh(VolumeSource& volume, const MarchQuery& query, const ExtractOptions& options,
                     const py::object& progress) {
    MeshOrigin origin{{}, volume.files()};
    py::array_t<float> vertices;
    py::array_t<std::uint32_t> triangles;
    py::array_t<float> normal_rows;
    const auto make_room = [&](const MeshLayout& layout) {
        const py::gil_scoped_acquire with;
        origin.layout = layout;
        vertices = rows_of_three<float>(layout.vertices);
        triangles = rows_of_three<std::uint32_t>(layout.elements);
        normal_rows = rows_of_three<float>(query.normals ? layout.vertices : 0);
        return MeshRoom{rows_in(vertices), rows_in(triangles), rows_in(normal_rows)};
    };
    ExtractReport report;
    run_watched(progress, [&](Progress& p) {
        report = march_hexahedra(volume, query, make_room, options, p);
    });
    return py::make_tuple(
        std::move(vertices), std::move(triangles),
        query.normals ? py::object(std::move(normal_rows)) : py::object(py::none()), py::none(),
        py::none(), std::move(origin), std::move(report));
}

/// Whether the surface at full resolution is the result, without further stages.
bool is_marched_alone(const VolumeSource& volume, const SurfaceQuery& query) {
    return std::holds_alternative<ErrorBound>(query.stop) && detail::is_plain_surface(query) &&
           !query.stages.manifold &&
           query.effort.value_or(Effort::none) == Effort::none &&  // extract() throws for others
           volume.describe().direction == kAlongWorld;
}

/// Like extract_mesh(), but directly from a volume, which is consumed. REQUIRES: the query needs no
/// store.
py::tuple extract_volume_mesh(Source& source, const AskedSurface& asked,
                              const ExtractOptions& options, const py::object& progress) {
    const std::unique_ptr<VolumeSource> volume = source.take();
    if (is_marched_alone(*volume, asked.query)) {
        return march_mesh(*volume, {asked.query.iso, asked.query.attributes.normals}, options,
                          progress);
    }
    Collector mesh;
    ExtractReport report;
    run_watched(progress,
                [&](Progress& p) { report = extract(*volume, asked.query, mesh, options, p); });
    return as_tuple(mesh, std::move(report));
}

/// The smallest and largest finite value; none if there is none. Consumes the volume.
std::optional<std::pair<double, double>> range_of_source(Source& source,
                                                         const ExtractOptions& options,
                                                         const py::object& progress) {
    const std::unique_ptr<VolumeSource> volume = source.take();
    std::optional<std::pair<double, double>> range;
    run_watched(progress, [&](Progress& p) { range = finite_range(*volume, options, p); });
    return range;
}

std::vector<Label>::const_iterator place_of(const std::vector<Label>& labels, std::int64_t id) {
    return std::lower_bound(labels.begin(), labels.end(), id,
                            [](const Label& label, std::int64_t i) { return label.id < i; });
}

/// The labels with these ids; without `ids`, all but 0. REQUIRES: `all` is sorted. Throws
/// Error{not_found}.
std::vector<Label> chosen_labels(const Store& store, std::vector<Label> all,
                                 const std::optional<std::vector<std::int64_t>>& ids) {
    if (!ids) {
        all.erase(std::remove_if(all.begin(), all.end(), [](const Label& l) { return l.id == 0; }),
                  all.end());
        return all;
    }
    std::vector<Label> chosen;
    for (const std::int64_t id : std::set<std::int64_t>(ids->begin(), ids->end())) {
        const auto found = place_of(all, id);
        if (found == all.end() || found->id != id) {
            throw Error(ErrorKind::not_found, {store.path().string()},
                        "there is no label " + std::to_string(id));
        }
        chosen.push_back(*found);
    }
    return chosen;
}

/// A list of pairs of a label and its mesh, in the form of extract_mesh().
py::list extract_label_meshes(const OpenStore& handle,
                              const std::optional<std::vector<std::int64_t>>& ids,
                              const AskedSurface& asked, const ExtractOptions& options,
                              const py::object& progress) {
    const std::shared_ptr<const Store> store = handle.get();
    std::vector<Label> labels;
    std::vector<std::shared_ptr<Collector>> meshes;
    std::vector<ExtractReport> reports;
    run_watched(progress, [&](Progress& p) {
        labels =
            chosen_labels(*store, find_labels(*store, {options.memory, options.threads}, p), ids);
        std::generate_n(std::back_inserter(meshes), labels.size(),
                        [] { return std::make_shared<Collector>(); });
        reports.resize(labels.size());
        extract_labels(
            *store, labels, asked.label_query(LabelChoice{}),
            [&](const Label& label) {
                const auto number = place_of(labels, label.id) - labels.begin();
                return std::make_unique<SharedSink>(meshes[static_cast<std::size_t>(number)]);
            },
            [&](std::size_t number, const ExtractReport& report) { reports[number] = report; },
            options, p);
    });
    py::list result;
    for (std::size_t i = 0; i < labels.size(); ++i) {
        meshes[i]->set_label(*store, labels[i].id);
        result.append(py::make_tuple(labels[i].id, as_tuple(*meshes[i], std::move(reports[i]))));
    }
    return result;
}

/// Returns (mesh in the form of extract_mesh(), labels on both sides of its triangles, areas of
/// pairs of labels).
py::tuple extract_interface_mesh(const OpenStore& handle,
                                 const std::optional<std::vector<std::int64_t>>& ids,
                                 const AskedSurface& asked, const ExtractOptions& options,
                                 const py::object& progress) {
    const std::shared_ptr<const Store> store = handle.get();
    Collector mesh;
    ExtractReport report;
    std::map<std::pair<std::int64_t, std::int64_t>, double> areas;
    run_watched(progress, [&](Progress& p) {
        const std::vector<Label> labels =
            chosen_labels(*store, find_labels(*store, {options.memory, options.threads}, p), ids);
        report = extract_interfaces(
            *store, labels, asked.label_query(LabelChoice{}), mesh,
            [&](const LabelInterface& i) {
                areas.emplace(std::pair(i.behind, i.in_front), i.area);
            },
            options, p);
    });
    py::array sides = as_array(std::move(mesh.sides));
    return py::make_tuple(as_tuple(mesh, std::move(report)), std::move(sides), std::move(areas));
}

/// A mesh per isovalue, in the form of extract_mesh().
py::list extract_isovalue_meshes(const OpenStore& handle, const std::vector<double>& isovalues,
                                 const AskedSurface& asked, const ExtractOptions& options,
                                 const py::object& progress) {
    const std::shared_ptr<const Store> store = handle.get();
    std::vector<std::shared_ptr<Collector>> meshes;
    std::generate_n(std::back_inserter(meshes), isovalues.size(),
                    [] { return std::make_shared<Collector>(); });
    std::vector<ExtractReport> reports(isovalues.size());
    run_watched(progress, [&](Progress& p) {
        extract_isovalues(
            *store, isovalues, asked.query,
            [&](std::size_t number) { return std::make_unique<SharedSink>(meshes[number]); },
            [&](std::size_t number, const ExtractReport& report) { reports[number] = report; },
            options, p);
    });
    py::list result;
    for (std::size_t i = 0; i < isovalues.size(); ++i) {
        result.append(as_tuple(*meshes[i], std::move(reports[i])));
    }
    return result;
}

using Floats = py::array_t<float, py::array::c_style>;
using Doubles = py::array_t<double, py::array::c_style>;
using CornerNumbers = py::array_t<std::uint32_t, py::array::c_style>;
using LabelNumbers = py::array_t<std::int64_t, py::array::c_style>;

/// The rows of an attribute; null if the layout does not have it. Throws py::value_error unless the
/// array has one row per vertex.
template <class T>
const T* attribute_of(const MeshOrigin& origin, const char* name, std::size_t vertices,
                      const std::optional<py::array_t<T, py::array::c_style>>& array) {
    const VertexAttribute* const attribute = origin.layout.find(name);
    if (attribute == nullptr) {
        return nullptr;
    }
    if (!array || static_cast<std::size_t>(array->size()) !=
                      vertices * static_cast<std::size_t>(attribute->components)) {
        throw py::value_error("the arrays of the mesh are inconsistent");
    }
    return array->data();
}

/// Keeps the arrays alive whose rows a mesh uses.
std::vector<py::array> add_fields(const MeshOrigin& origin, const py::list& fields,
                                  ArrayMesh& mesh) {
    std::vector<py::array> kept;
    for (const VertexAttribute& attribute : origin.layout.attributes) {
        if (detail::is_of_extraction(attribute)) {
            continue;
        }
        if (kept.size() == fields.size()) {
            throw py::value_error("the arrays of the mesh are inconsistent");
        }
        const py::object array = fields[kept.size()];
        kept.push_back(attribute.is_double ? py::array(Doubles::ensure(array))
                                           : py::array(Floats::ensure(array)));
        if (!kept.back() ||
            static_cast<std::size_t>(kept.back().nbytes()) != mesh.vertices * attribute.bytes()) {
            throw py::value_error("the arrays of the mesh are inconsistent");
        }
        mesh.fields.push_back(
            {static_cast<const std::byte*>(kept.back().data()), attribute.is_double});
    }
    return kept;
}

MeshSpace space_of(const std::optional<std::string>& name) {
    const auto frame = name ? frame_from(*name) : std::nullopt;
    if (name && !frame && *name != "as-stored") {
        throw py::value_error("space='" + *name + "': give 'ras', 'lps' or 'as-stored'");
    }
    return !name                            ? MeshSpace::automatic
           : !frame                         ? MeshSpace::as_stored
           : *frame == AnatomicalFrame::ras ? MeshSpace::ras
                                            : MeshSpace::lps;
}

void save_mesh(const std::filesystem::path& path, const MeshOrigin& origin, const Floats& positions,
               const CornerNumbers& elements, bool flip, const std::optional<Floats>& normals,
               const std::optional<Doubles>& values, const std::optional<Floats>& errors,
               const py::list& fields, const std::optional<LabelNumbers>& labels,
               const std::optional<std::string>& space, const Double3& shift, const std::string& up,
               const std::optional<std::string>& unit, const py::object& progress) {
    const MeshSpace written = space_of(space);
    if (up != "y" && up != "z") {
        throw py::value_error("up='" + up + "': give 'y' or 'z'");
    }
    const std::optional<LengthUnit> in = unit ? length_unit_from(*unit) : std::nullopt;
    if (unit && !in) {
        throw py::value_error("mesh_unit='" + *unit + "': give one of " + list_of_length_units());
    }
    ArrayMesh mesh;
    mesh.vertices = static_cast<std::size_t>(positions.size()) / 3;
    mesh.positions = positions.data();
    mesh.elements =
        static_cast<std::size_t>(elements.size()) / static_cast<std::size_t>(origin.layout.corners);
    mesh.corners = elements.data();
    mesh.flip = flip;
    mesh.normals = attribute_of(origin, "normal", mesh.vertices, normals);
    mesh.values = attribute_of(origin, "value", mesh.vertices, values);
    mesh.errors = attribute_of(origin, "error", mesh.vertices, errors);
    const std::vector<py::array> kept = add_fields(origin, fields, mesh);
    if (origin.layout.has_sides) {
        if (!labels || static_cast<std::size_t>(labels->size()) != 2 * mesh.elements) {
            throw py::value_error("the arrays of the mesh are inconsistent");
        }
        mesh.sides = reinterpret_cast<const std::array<std::int64_t, 2>*>(labels->data());
    }
    run_watched(progress, [&](Progress& p) {
        const std::unique_ptr<MeshSink> sink =
            open_mesh_file(path, {.replace = true,
                                  .title = origin.label.name,
                                  .color = origin.label.color,
                                  .space = written,
                                  .up = up == "y" ? UpAxis::y : UpAxis::z,
                                  .unit = in,
                                  .shift = shift});
        write_mesh(mesh, origin, path, *sink, p);
    });
}

/// What a pickled mesh keeps of its origin.
py::tuple state_of(const MeshOrigin& origin) {
    const MeshLayout& l = origin.layout;
    py::list attributes;
    for (const VertexAttribute& a : l.attributes) {
        attributes.append(
            py::make_tuple(a.name, a.components, a.is_double, a.offset, a.same_in_element));
    }
    return py::make_tuple(l.vertices, l.elements, l.corners, std::move(attributes), l.row_bytes,
                          l.lo, l.hi, l.unit ? std::string(symbol_of(*l.unit)) : std::string(),
                          std::string(name_of(l.frame)), l.has_sides, l.sides_range, origin.inputs,
                          origin.label.id, origin.label.name, origin.label.color);
}

MeshOrigin origin_of(const py::tuple& state) {
    MeshOrigin origin;
    MeshLayout& l = origin.layout;
    std::size_t at = 0;
    const auto take = [&](auto& to) {
        to = state[at++].cast<std::remove_reference_t<decltype(to)>>();
    };
    using Attribute = std::tuple<std::string, int, bool, std::size_t, bool>;
    std::vector<Attribute> attributes;
    std::string unit;
    std::string frame;
    take(l.vertices);
    take(l.elements);
    take(l.corners);
    take(attributes);
    take(l.row_bytes);
    take(l.lo);
    take(l.hi);
    take(unit);
    take(frame);
    take(l.has_sides);
    take(l.sides_range);
    take(origin.inputs);
    take(origin.label.id);
    take(origin.label.name);
    take(origin.label.color);
    for (const auto& [name, components, is_double, offset, same] : attributes) {
        l.attributes.push_back({name, components, is_double, offset, same});
    }
    l.unit = length_unit_from(unit);
    l.frame = frame_from(frame).value_or(AnatomicalFrame::unknown);
    return origin;
}

}  // namespace

void add_meshes(py::module_& module) {
    using namespace py::literals;
    py::class_<MeshOrigin>(module, "MeshLayout").def(py::pickle(&state_of, &origin_of));
    const auto add = [&](auto function) {
        module.def("extract", function, "store"_a, "query"_a, "options"_a, "progress"_a);
    };
    add(&extract_mesh<AskedSurface>);
    add(&extract_mesh<AskedSlice>);
    add(&extract_mesh<AskedContours>);
    add(&extract_mesh<AskedGraph>);
    module.def("extract_volume", &extract_volume_mesh, "source"_a, "query"_a, "options"_a,
               "progress"_a);
    module.def("finite_range", &range_of_source, "source"_a, "options"_a, "progress"_a);
    module.def("extract_isovalues", &extract_isovalue_meshes, "store"_a, "isovalues"_a, "query"_a,
               "options"_a, "progress"_a);
    module.def("extract_labels", &extract_label_meshes, "store"_a, "labels"_a, "query"_a,
               "options"_a, "progress"_a);
    module.def("extract_interfaces", &extract_interface_mesh, "store"_a, "labels"_a, "query"_a,
               "options"_a, "progress"_a);
    module.def("save_mesh", &save_mesh, "path"_a, "layout"_a, "positions"_a, "elements"_a, "flip"_a,
               "normals"_a, "values"_a, "errors"_a, "fields"_a, "labels"_a, "space"_a, "shift"_a,
               "up"_a, "unit"_a, "progress"_a);
    add_mesh_fields(module);
}

}  // namespace isonest::python
