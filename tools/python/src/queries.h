// Queries of a store: converts arguments of Python functions to queries of the library.
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

// Names of fields and units.

/// Throws Error{invalid_argument}, which lists the indicators.
Field indicator_of_name(const std::string& name);
/// Several indicators in the order of a store, without duplicates; "nodes" and "all" are groups.
/// Throws what indicator_of_name() throws.
std::vector<Field> indicators_of_names(const std::vector<std::string>& names);
/// An indicator or the values. Throws what indicator_of_name() throws.
Field field_of_name(const std::string& name);

/// Throws Error{invalid_argument}, which lists the units.
LengthUnit unit_of_name(const std::string& name);

namespace py = pybind11;

/// A query, and the store that supplies the vertex values, which it keeps open.
template <class Query>
struct Asked {
    Query query;
    std::shared_ptr<const Store> values;

    void set_values(const OpenStore& store) {
        values = store.get();
        query.attributes.values = values.get();
    }
};
/// A query for a surface, of an isovalue or of a label.
struct AskedSurface : Asked<SurfaceQuery> {
    std::optional<LabelChoice> label;
    std::optional<LabelSmoothing> smooth;  ///< for the surface of a label

    /// Throws what isonest::label_query() throws.
    [[nodiscard]] LabelQuery label_query(const LabelChoice& choice) const {
        LabelQuery asked = isonest::label_query(query, choice);
        asked.smooth = smooth;
        return asked;
    }
};
using AskedSlice = Asked<SliceQuery>;
using AskedContours = Asked<ContourQuery>;
using AskedGraph = Asked<GraphQuery>;

/// Adds SurfaceQuery, SliceQuery, ContourQuery, GraphQuery and ExtractOptions. Coordinates are x,
/// y, z in the world. REQUIRES: add_stores() was called.
void add_queries(py::module_& module);

}  // namespace isonest::python
