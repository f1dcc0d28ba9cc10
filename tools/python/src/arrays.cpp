#include "tools/python/src/arrays.h"

#include <optional>
#include <string>

namespace isonest::python {

py::dtype dtype_of(ValueType type) {
    return py::dtype(std::string(name_of(type)));
}

ValueType value_type_of(const py::dtype& dtype) {
    const auto name = dtype.attr("name").cast<std::string>();
    const std::optional<ValueType> type = value_type_from_name(name);
    if (!type) {
        throw py::type_error("a volume of " + name +
                             ": the types are integers of 8, 16 and 32 bits, float32 and float64");
    }
    return *type;
}

}  // namespace isonest::python
