// What is asked of a store: from the arguments of Python's functions to the library's queries.
#pragma once

#include <pybind11/pybind11.h>

#include <memory>
#include <optional>

#include <isonest/extract.h>

#include "tools/python/src/stores.h"

namespace isonest::python {

namespace py = pybind11;

/// A query, and the store that its vertices have their values from.
template <class Query>
struct Asked {
    Query query;
    std::shared_ptr<const Store> values;

    void set_values(const OpenStore& store) {
        values = store.get();
        query.attributes.values = values.get();
    }
};
/// With a label in place of an isovalue.
struct AskedSurface : Asked<SurfaceQuery> {
    std::optional<LabelChoice> label;
    std::optional<LabelSmoothing> smooth;  ///< of a label's surface

    /// As isonest::label_query().
    [[nodiscard]] LabelQuery label_query(const LabelChoice& choice) const {
        LabelQuery asked = isonest::label_query(query, choice);
        asked.smooth = smooth;
        return asked;
    }
};
using AskedSlice = Asked<SliceQuery>;
using AskedContours = Asked<ContourQuery>;
using AskedGraph = Asked<GraphQuery>;

/// Adds SurfaceQuery, SliceQuery, ContourQuery, GraphQuery and ExtractOptions. Everything is in
/// world coordinates, x, y, z. REQUIRES: add_stores() was called.
void add_queries(py::module_& module);

}  // namespace isonest::python
