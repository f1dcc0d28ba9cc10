#include "tools/python/src/own_indicators.h"

#include <pybind11/numpy.h>
#include <pybind11/stl/filesystem.h>

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <memory>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include <isonest/error.h>
#include <isonest/own_indicator.h>

#include "tools/python/src/progress.h"
#include "tools/python/src/sources.h"

namespace isonest::python {
namespace {

/// A dense array that is filled in order.
template <class T>
class Filled {
  public:
    explicit Filled(std::vector<py::ssize_t> shape)
        : array_(std::move(shape)), next_(array_.mutable_data()) {}
    void add(T number) { *next_++ = number; }
    /// In the order of an array's axes.
    void add(const Int3& node) {
        for (const std::int64_t coordinate : {node.z, node.y, node.x}) {
            add(coordinate);
        }
    }
    [[nodiscard]] const py::array& array() const { return array_; }

  private:
    py::array_t<T> array_;
    T* next_;
};

/// Calls a Python function with nodes that have equally many elements, so that all arrays are
/// dense. The GIL is held for one call at a time.
class PythonFunction {
  public:
    /// The destructor may run without the GIL.
    PythonFunction(std::string name, py::object function)
        : name_(std::move(name)), function_(new py::object(std::move(function)), [](py::object* f) {
              const py::gil_scoped_acquire with;
              delete f;
          }) {}

    void operator()(std::span<const RefinementNode> nodes, std::span<double> eta) const {
        for (std::size_t first = 0; first < nodes.size();) {
            const std::size_t elements = nodes[first].elements.size();
            std::size_t end = first + 1;
            while (end < nodes.size() && nodes[end].elements.size() == elements) {
                ++end;
            }
            call(nodes.subspan(first, end - first), eta.subspan(first, end - first));
            first = end;
        }
    }

  private:
    void call(std::span<const RefinementNode> nodes, std::span<double> eta) const {
        const RefinementNode& any = nodes.front();
        const auto n = static_cast<py::ssize_t>(nodes.size());
        const auto m = static_cast<py::ssize_t>(any.elements.size());
        const py::ssize_t corners = any.elements.front().count;
        const py::gil_scoped_acquire with;
        Filled<std::int64_t> node({n, 3});
        Filled<double> value({n});
        Filled<std::int64_t> ends({n, 2, 3});
        Filled<double> end_values({n, 2});
        Filled<std::int64_t> vertices({n, m, corners, 3});
        Filled<double> values({n, m, corners});
        for (const RefinementNode& x : nodes) {
            node.add(x.node);
            value.add(x.value);
            for (std::size_t e = 0; e < 2; ++e) {
                ends.add(x.ends[e]);
                end_values.add(x.end_values[e]);
            }
            for (const RefinedElement& t : x.elements) {
                for (std::size_t v = 0; v < static_cast<std::size_t>(t.count); ++v) {
                    vertices.add(t.vertices[v]);
                    values.add(t.values[v]);
                }
            }
        }
        const py::object result =
            (*function_)(any.level, any.odd_axes, node.array(), value.array(), ends.array(),
                         end_values.array(), vertices.array(), values.array());
        const auto numbers =
            py::array_t<double, py::array::c_style | py::array::forcecast>::ensure(result);
        if (!numbers) {
            throw py::error_already_set();
        }
        if (numbers.ndim() != 1 || numbers.shape(0) != n) {
            throw Error(ErrorKind::invalid_argument, {name_},
                        "the function must return one number for each of the " + std::to_string(n) +
                            " nodes");
        }
        std::copy_n(numbers.data(), eta.size(), eta.begin());
    }

    std::string name_;
    std::shared_ptr<py::object> function_;
};

void add_function(PreprocessOptions& options, const std::string& name, py::object function,
                  std::string identity) {
    options.own.push_back({name, PythonFunction(name, std::move(function)), std::move(identity)});
}

void add_volume(PreprocessOptions& options, std::string name, Source& source,
                const std::filesystem::path& scratch) {
    const std::shared_ptr<VolumeSource> volume = source.take();
    OwnIndicator made;
    run_watched(py::none(), [&](Progress& progress) {
        made = own_indicator(std::move(name), *volume, scratch, progress);
    });
    // An array is used in place.
    made.eta = [volume, eta = std::move(made.eta)](std::span<const RefinementNode> nodes,
                                                   std::span<double> to) { eta(nodes, to); };
    options.own.push_back(std::move(made));
}

}  // namespace

void add_own_indicators(py::class_<PreprocessOptions>& options) {
    using namespace py::literals;
    options.def("add_own_function", &add_function, "name"_a, "function"_a, "identity"_a)
        .def("add_own_volume", &add_volume, "name"_a, "source"_a, "scratch"_a);
}

}  // namespace isonest::python
