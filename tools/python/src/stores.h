// Stores in Python: metadata, values, histogram, and checks.
#pragma once

#include <pybind11/pybind11.h>

#include <memory>
#include <utility>

#include <isonest/store.h>

namespace isonest::python {

namespace py = pybind11;

/// Adds check(), stored_arrays(), analyses() and what they return. REQUIRES: add_stores() and
/// add_sources() were called.
void add_checks(py::module_& module);

/// A store that Python may close while another thread queries it; the query keeps it open.
class OpenStore {
  public:
    explicit OpenStore(std::shared_ptr<const Store> store) : store_(std::move(store)) {}
    /// Throws py::value_error if the store is closed.
    [[nodiscard]] std::shared_ptr<const Store> get() const;
    void close() { store_.reset(); }
    [[nodiscard]] bool closed() const { return store_ == nullptr; }

  private:
    std::shared_ptr<const Store> store_;
};

/// Adds Store and Histogram.
void add_stores(py::module_& module);

}  // namespace isonest::python
