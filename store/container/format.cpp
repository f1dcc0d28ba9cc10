#include "store/container/format.h"

#include <fmt/format.h>

#include <algorithm>
#include <bit>
#include <cmath>
#include <limits>
#include <numbers>

#include <isonest/error.h>

#include "store/base/vectors.h"
#include "store/container/codec.h"

namespace isonest::detail {

std::string why_no_place(const Int3& nodes, const Double3& spacing, const Double3& origin) {
    const std::string given = fmt::format("spacing {} {} {} and origin {} {} {}", spacing[0],
                                          spacing[1], spacing[2], origin[0], origin[1], origin[2]);
    for (int axis = 0; axis < 3; ++axis) {
        const auto a = static_cast<std::size_t>(axis);
        const double last = origin[a] + spacing[a] * static_cast<double>(nodes[axis] - 1);
        if (!(spacing[a] >= kMinSpacing && spacing[a] <= kMaxSpacing) ||
            !(std::fabs(origin[a]) <= kMaxCoordinate && std::fabs(last) <= kMaxCoordinate)) {
            return fmt::format(
                "{}: spacings from {:g} to {:g} and coordinates from {:g} to {:g} are "
                "possible",
                given, kMinSpacing, kMaxSpacing, -kMaxCoordinate, kMaxCoordinate);
        }
        const double reach = std::max(std::fabs(origin[a]), std::fabs(last));
        if (nodes[axis] > 1 && reach <= std::numeric_limits<float>::max() &&
            static_cast<float>(last) == static_cast<float>(origin[a])) {
            const auto at = static_cast<float>(reach);
            return fmt::format(
                "{}: all {} coordinates of {} round to the same 32-bit float (floats there are "
                "{:.3g} apart); use a larger spacing or an origin near 0",
                given, nodes[axis], "xyz"[axis], at - std::nextafter(at, 0.0F));
        }
    }
    return {};
}

std::string why_not_uneven(const Int3& nodes, const Double3& spacing, const Double3& origin,
                           const Directions& direction, const UnevenAxesPtr& uneven) {
    if (!uneven) {
        return {};
    }
    if (!are_directions(direction)) {
        return "a sheared volume has even axes";
    }
    bool any = false;
    for (std::size_t a = 0; a < 3; ++a) {
        const std::vector<double>& offsets = uneven->offsets.at(a);
        if (offsets.empty()) {
            continue;
        }
        any = true;
        const std::int64_t count = nodes[static_cast<int>(a)];
        if (std::ssize(offsets) != count || count < 2 || offsets.size() > kMaxUnevenNodes) {
            return fmt::format(
                "{} offsets for {} nodes along {}: an uneven axis has 2 to {} nodes, with an "
                "offset each",
                offsets.size(), count, "xyz"[a], kMaxUnevenNodes);
        }
        const auto cells = static_cast<double>(count - 1);
        constexpr double kRounding = 1e-12;
        if (offsets.front() != 0 || !std::isfinite(offsets.back()) ||
            !(std::fabs(offsets.back() - spacing[a] * cells) <=
              kRounding * std::fabs(offsets.back()))) {
            return fmt::format(
                "offsets along {} from {} to {}: they must start with 0 and end with the "
                "spacing times the number of cells, {}",
                "xyz"[a], offsets.front(), offsets.back(), spacing[a] * cells);
        }
        for (std::size_t i = 0; i + 1 < offsets.size(); ++i) {
            const double low = origin[a] + offsets[i];
            const double high = origin[a] + offsets[i + 1];
            const bool is_small = std::fabs(high) <= std::numeric_limits<float>::max();
            if (!(offsets[i + 1] - offsets[i] >= kMinSpacing) ||
                (is_small && !(static_cast<float>(low) < static_cast<float>(high)))) {
                return fmt::format(
                    "nodes {} and {} along {} at {} and {}: coordinates must increase, also as "
                    "32-bit floats",
                    i, i + 1, "xyz"[a], low, high);
            }
        }
    }
    return any ? std::string() : "no axis is uneven";
}

std::string why_no_directions(const Int3& nodes, const Directions& direction) {
    if (!span_space(direction)) {
        return "its directions are not a right-handed basis of unit vectors";
    }
    if (are_directions(direction)) {
        return {};
    }
    constexpr double kRounding = 1e-12;
    for (std::size_t a = 0; a < 3; ++a) {
        const double off = std::max(std::fabs(dot(direction[a], direction[(a + 1) % 3])),
                                    std::fabs(dot(direction[a], direction[(a + 2) % 3])));
        if (nodes[static_cast<int>(a)] == 1 && off > kRounding) {
            return fmt::format(
                "its direction along {}, where it has one node, is not at right angles to the "
                "others",
                "xyz"[a]);
        }
    }
    return {};
}

double diagonal_of(const StoreHeader& header) {
    if (header.curved) {
        const Double3& low = header.curved->low;
        const Double3& high = header.curved->high;
        return hypot3(high[0] - low[0], high[1] - low[1], high[2] - low[2]);
    }
    const LatticeSteps steps = header.steps();
    if (steps.is_sheared()) {
        LatticeSteps whole = steps;
        const Int3 cells = header.nodes - Int3{1, 1, 1};
        const auto x = static_cast<double>(cells.x);
        const auto y = static_cast<double>(cells.y);
        const auto z = static_cast<double>(cells.z);
        whole.along = {steps.along[0] * x, steps.along[1] * y, steps.along[2] * z};
        whole.y_along_x *= y;
        whole.z_along_x *= z;
        whole.z_along_y *= z;
        return whole.diagonal();
    }
    const Double3 last = last_position(header);
    return hypot3(last[0] - header.origin[0], last[1] - header.origin[1],
                  last[2] - header.origin[2]);
}

std::string sheared_axes(const Int3& nodes, const std::array<Double3, 3>& steps) {
    double worst = 0;
    std::string text;
    for (std::size_t a = 0; a < 2; ++a) {
        for (std::size_t b = a + 1; b < 3; ++b) {
            const double cosine =
                dot(steps.at(a), steps.at(b)) / (length(steps.at(a)) * length(steps.at(b)));
            const double angle = std::acos(std::clamp(cosine, -1.0, 1.0)) * 180 / std::numbers::pi;
            constexpr double kRight = 90;
            const bool flat = nodes[static_cast<int>(a)] == 1 || nodes[static_cast<int>(b)] == 1;
            if (!flat && std::fabs(angle - kRight) > worst) {
                worst = std::fabs(angle - kRight);
                text = fmt::format("{} and {} meet at {:.4g} degrees", "xyz"[a], "xyz"[b], angle);
            }
        }
    }
    return text;
}

void require_right_angles(const Directions& direction, const std::string& name,
                          const std::string& what) {
    if (!are_directions(direction)) {
        throw Error(ErrorKind::unsupported, {name},
                    fmt::format("{} needs axes at right angles, but this volume is sheared; "
                                "resample it on an orthogonal lattice",
                                what));
    }
}

namespace {

void require_even(bool is_uneven, const std::string& name, const std::string& what) {
    if (is_uneven) {
        throw Error(ErrorKind::unsupported, {name},
                    fmt::format("{} needs evenly spaced axes, but the nodes of this volume lie at "
                                "uneven distances; resample it, or preprocess it with a spacing",
                                what),
                    {{RemedyKind::place_in_world, "spacing"}});
    }
}

void require_straight(bool is_curved, const std::string& name, const std::string& what) {
    if (is_curved) {
        throw Error(ErrorKind::unsupported, {name},
                    fmt::format("{} needs straight axes, but the grid is curvilinear; resample it, "
                                "or preprocess it with a spacing",
                                what),
                    {{RemedyKind::place_in_world, "spacing"}});
    }
}

}  // namespace

void require_even_axes(const StoreHeader& header, const std::string& name,
                       const std::string& what) {
    require_even(header.uneven != nullptr, name, what);
    require_straight(header.curved != nullptr, name, what);
}

void require_even_axes(const VolumeDescription& volume, const std::string& what) {
    require_even(volume.uneven != nullptr, volume.name, what);
    require_straight(volume.curved != nullptr, volume.name, what);
}

void require_not_curved(const StoreHeader& header, const std::string& name,
                        const std::string& what) {
    require_straight(header.curved != nullptr, name, what);
}

void require_not_curved(const VolumeDescription& volume, const std::string& what) {
    require_straight(volume.curved != nullptr, volume.name, what);
}

CurvedNodesPtr curved_of(const VolumeDescription& volume) {
    if (!volume.curved) {
        return nullptr;
    }
    const auto fits = [](const std::shared_ptr<VolumeSource>& source) {
        const ValueType type = source->describe().type;
        return type == ValueType::f32 || size_of(type) <= 2;
    };
    const auto& axes = volume.curved->coordinates;
    CurvedNodes nodes;
    nodes.type = std::all_of(axes.begin(), axes.end(), fits) ? ValueType::f32 : ValueType::f64;
    return std::make_shared<const CurvedNodes>(nodes);
}

namespace {

void validate(const StoreHeader& header) {
    for (int axis = 0; axis < 3; ++axis) {
        if (header.nodes[axis] < 1 || header.nodes[axis] > kMaxNodesPerAxis) {
            throw Error(
                ErrorKind::unsupported,
                fmt::format("a volume of {} x {} x {} nodes: each axis must have 1 to {}",
                            header.nodes.x, header.nodes.y, header.nodes.z, kMaxNodesPerAxis));
        }
    }
    if (const std::string why = why_no_place(header.nodes, header.spacing, header.origin);
        !why.empty()) {
        throw Error(ErrorKind::invalid_argument, why);
    }
    if (header.curved) {
        const Int3& n = header.nodes;
        if (std::min({n.x, n.y, n.z}) < 2) {
            throw Error(ErrorKind::unsupported,
                        fmt::format("a curvilinear grid of {} x {} x {} nodes: there must be at "
                                    "least two along each axis",
                                    n.x, n.y, n.z));
        }
        if (header.uneven || header.direction != kAlongWorld ||
            header.spacing != Double3{1, 1, 1} || header.origin != Double3{0, 0, 0} ||
            (header.curved->type != ValueType::f32 && header.curved->type != ValueType::f64)) {
            throw Error(ErrorKind::invalid_argument,
                        "a curvilinear grid has positions of float32 or float64, and no other "
                        "placement");
        }
    }
    if (const std::string why = why_not_uneven(header.nodes, header.spacing, header.origin,
                                               header.direction, header.uneven);
        !why.empty()) {
        throw Error(ErrorKind::invalid_argument, why);
    }
    if (header.chunk < kMinChunk || header.chunk > kMaxChunk ||
        !std::has_single_bit(static_cast<unsigned>(header.chunk))) {
        throw Error(ErrorKind::invalid_argument,
                    fmt::format("chunk {}: must be a power of two from {} to {}", header.chunk,
                                kMinChunk, kMaxChunk));
    }
    if (header.compression < 1 || header.compression > 19) {
        throw Error(
            ErrorKind::invalid_argument,
            fmt::format("compression {}: give a zstd level from 1 to 19", header.compression));
    }
}

}  // namespace

std::string ArrayInfo::place(const Int3& c) const {
    if (coordinate >= 0) {
        return fmt::format("positions, {}, chunk {} {} {}",
                           "xyz"[static_cast<std::size_t>(coordinate)], c.x, c.y, c.z);
    }
    return fmt::format("level {}, {}, chunk {} {} {}", level, name_of(field), c.x, c.y, c.z);
}

StoreLayout::StoreLayout(const StoreHeader& header) : header_(header) {
    validate(header);
    std::sort(header_.fields.begin(), header_.fields.end(), precedes);
    header_.fields.erase(std::unique(header_.fields.begin(), header_.fields.end()),
                         header_.fields.end());
    lattice_ = Lattice(header_.nodes);
    const std::size_t value_size = size_of(header_.type);
    const std::size_t code_size = header_.exact ? sizeof(float) : sizeof(IndicatorCode);
    for (int level = 0; level <= lattice_.top(); ++level) {
        ArrayInfo values;
        values.level = level;
        values.nodes = lattice_.nodes_at(level);
        const std::int64_t k = header_.chunk;
        values.chunk = min(values.nodes, {k, k, k});
        values.grid = ceil_div(values.nodes, values.chunk);
        values.first_row = rows_;
        values.codec = {value_size, value_size > 1, header_.compression};
        values.skips_shuffle = header_.skips_shuffle && values.codec.shuffle;
        rows_ += static_cast<std::uint64_t>(values.grid.product());
        arrays_.push_back(values);
        if (level == 0) {
            continue;
        }
        for (const Field field : header_.fields) {
            ArrayInfo indicator = values;
            indicator.field = field;
            const int centre = lattice_.centre_slot();
            const bool centre_only =
                is_of_cells(field) || (level == 1 && centre_suffices_at_level_1(field));
            indicator.first_slot = centre_only ? centre : 0;
            indicator.components = centre + 1 - indicator.first_slot;
            indicator.chunk = min(values.nodes, {k / 2, k / 2, k / 2});
            indicator.grid = ceil_div(values.nodes, indicator.chunk);
            indicator.codec = {code_size, true, header_.compression};
            indicator.skips_shuffle = header_.skips_shuffle;
            const Field source = level == 1 ? source_at_level_1(field) : field;
            if (source != field && has(source)) {
                indicator.alias = true;
                indicator.first_row = array(level, source).first_row;
            } else {
                indicator.first_row = rows_;
                rows_ += static_cast<std::uint64_t>(indicator.grid.product());
            }
            arrays_.push_back(indicator);
        }
        // Unknown fields have the chunk grid of an indicator.
        rows_ += header_.unknown_fields.size() *
                 static_cast<std::uint64_t>(
                     ceil_div(values.nodes, min(values.nodes, {k / 2, k / 2, k / 2})).product());
    }
    for (int axis = 0; header_.curved && axis < 3; ++axis) {
        ArrayInfo positions = arrays_.front();
        positions.coordinate = axis;
        positions.first_row = rows_;
        positions.codec = {size_of(header_.curved->type), true, header_.compression};
        positions.skips_shuffle = header_.skips_shuffle;
        rows_ += static_cast<std::uint64_t>(positions.grid.product());
        arrays_.push_back(positions);
        ++positions_;
    }
}

bool StoreLayout::has(Field field) const {
    return field == Field::values ||
           std::find(header_.fields.begin(), header_.fields.end(), field) != header_.fields.end();
}

std::optional<Field> StoreLayout::tightest_bound() const {
    for (const Field field :
         {Field::deviation_bar, Field::deviation_plus, Field::linf_plus, Field::grad_linf_plus}) {
        if (has(field)) {
            return field;
        }
    }
    return std::nullopt;
}

const ArrayInfo& StoreLayout::array(int level, Field field) const {
    for (const ArrayInfo& array : arrays()) {
        if (array.level == level && array.field == field) {
            return array;
        }
    }
    if (has(field)) {
        throw Error(ErrorKind::not_found,
                    fmt::format("there is no level {} of {}: levels {} to {} exist", level,
                                name_of(field), field == Field::values ? 0 : 1, lattice_.top()));
    }
    std::string wanted;
    for (const Field there : header_.fields) {
        wanted += is_own(there) ? "" : std::string(name_of(there)) + ",";
    }
    std::vector<Remedy> remedies;
    if (!is_own(field)) {
        remedies.push_back({RemedyKind::make_fields, wanted + std::string(name_of(field))});
    }
    throw Error(ErrorKind::not_found,
                fmt::format("the store has no field {}; it has {}", name_of(field),
                            list_names(header_.fields)),
                std::move(remedies));
}

std::string StoreLayout::cube_ranges_path(int level) {
    return fmt::format("/levels/{}/cube_ranges", level);
}

std::string StoreLayout::cube_range_sums_path(int level) {
    return fmt::format("/levels/{}/cube_range_sums", level);
}

std::string StoreLayout::path_of(const ArrayInfo& array) {
    if (array.coordinate >= 0) {
        return fmt::format("/positions/{}", "xyz"[static_cast<std::size_t>(array.coordinate)]);
    }
    return fmt::format("/levels/{}/{}", array.level, stored_name_of(array.field));
}

std::size_t largest_chunk_bytes(const StoreLayout& layout) {
    std::size_t largest = 0;
    for (const ArrayInfo& array : layout.all_arrays()) {
        largest = std::max(largest, array.chunk_bytes());
    }
    return largest;
}

}  // namespace isonest::detail
