#include <isonest/store.h>

#include "store/container/reader.h"
#include "store/container/world_units.h"

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
    return detail::world_units(length, given, unit(), path().string());
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
