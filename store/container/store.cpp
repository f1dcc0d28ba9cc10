#include <fmt/format.h>

#include <isonest/error.h>
#include <isonest/store.h>

#include "store/container/reader.h"

namespace isonest {

Store::Store(const std::filesystem::path& path)
    : reader_(std::make_unique<const detail::StoreReader>(path)) {}
Store::Store(Store&& other) noexcept = default;
Store& Store::operator=(Store&& other) noexcept = default;
Store::~Store() = default;

const std::filesystem::path& Store::path() const {
    return reader_->path();
}
Int3 Store::nodes() const {
    return reader_->layout().header().nodes;
}
ValueType Store::type() const {
    return reader_->layout().header().type;
}
Directions Store::direction() const {
    return reader_->layout().header().direction;
}
Double3 Store::spacing() const {
    return reader_->layout().header().spacing;
}
Double3 Store::origin() const {
    return reader_->layout().header().origin;
}
std::optional<LengthUnit> Store::unit() const {
    return reader_->layout().header().unit;
}
double Store::world_units(double length, LengthUnit given) const {
    if (!unit()) {
        throw Error(
            ErrorKind::invalid_argument, {path().string()},
            fmt::format("nothing says how many world units {:g} {} are: the volume's unit "
                        "of length is not known",
                        length, symbol_of(given)),
            {{RemedyKind::world_units}, {RemedyKind::say_unit, std::string(symbol_of(given))}});
    }
    return converted_length(length, given, *unit());
}
int Store::levels() const {
    return reader_->layout().lattice().top() + 1;
}
const std::vector<Field>& Store::fields() const {
    return reader_->layout().header().fields;
}
double Store::min_value() const {
    return reader_->min_value();
}
double Store::max_value() const {
    return reader_->max_value();
}
bool Store::has_missing() const {
    return reader_->has_missing();
}

}  // namespace isonest
