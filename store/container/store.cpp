#include <cmath>

#include <isonest/store.h>

#include "store/base/label_bits.h"
#include "store/base/world_units.h"
#include "store/container/reader.h"
#include "store/remote/open_location.h"

namespace isonest {
namespace detail {
namespace {

/// The number that a store's value is to its user: of a label the label, rounded beyond 2^53.
double number_of(const StoreReader& store, double value) {
    return store.layout().header().labels && std::isfinite(value)
               ? static_cast<double>(label_of_value(value))
               : value;
}

}  // namespace
}  // namespace detail

Store::Store(const std::filesystem::path& location, const RemoteAccess& remote)
    : cache_(detail::open_cache(location, remote)),
      reader_(std::make_unique<const detail::StoreReader>(
          detail::open_location(location, remote, cache_))) {}
Store::Store(Store&& other) noexcept = default;
Store& Store::operator=(Store&& other) noexcept = default;
Store::~Store() = default;

const std::filesystem::path& Store::path() const {
    return reader_->path();
}
bool Store::is_remote() const {
    return reader_->bytes().is_far();
}
FetchedCounts Store::fetched() const {
    return reader_->bytes().fetched();
}
std::string Store::cache_warning() const {
    return detail::cache_warning(cache_.get());
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
AnatomicalFrame Store::frame() const {
    return reader_->layout().header().frame;
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
    return detail::number_of(*reader_, reader_->min_value());
}
double Store::max_value() const {
    return detail::number_of(*reader_, reader_->max_value());
}
bool Store::has_missing() const {
    return reader_->has_missing();
}
std::vector<LabelName> Store::label_names() const {
    const detail::LabelTable& table = reader_->label_names();
    std::vector<LabelName> names;
    names.reserve(table.size());
    for (std::size_t i = 0; i < table.size(); ++i) {
        names.push_back(table.at(i));
    }
    return names;
}
std::optional<LabelName> Store::label_name(std::int64_t id) const {
    return reader_->label_names().find(id);
}
std::vector<std::int64_t> Store::labels_named(std::string_view name) const {
    const detail::LabelTable& table = reader_->label_names();
    std::vector<std::int64_t> ids;
    for (std::size_t i = 0; !name.empty() && i < table.size(); ++i) {
        if (const LabelName label = table.at(i); label.name == name) {
            ids.push_back(label.id);
        }
    }
    return ids;
}

}  // namespace isonest
