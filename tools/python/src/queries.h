// What is asked of a store: from the arguments of Python's functions to the library's queries.
#pragma once

#include <pybind11/pybind11.h>

#include <memory>
#include <optional>
#include <string>
#include <vector>

#include <isonest/extract.h>
#include <isonest/field.h>
#include <isonest/length_unit.h>

#include "tools/python/src/stores.h"

namespace isonest::python {

// Names in arguments: of fields and of units.

/// Throws Error{invalid_argument} listing the indicators that there are.
Field indicator_of_name(const std::string& name);
/// Several, sorted as in a store, none twice; "nodes" and "all" are groups of them. Throws as
/// above.
std::vector<Field> indicators_of_names(const std::vector<std::string>& names);
/// The same, or the values.
Field field_of_name(const std::string& name);

/// Throws Error{invalid_argument}, which lists the units.
LengthUnit unit_of_name(const std::string& name);

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
