#include "preprocess/sources/placement/placed_array.h"

#include <array>
#include <cmath>
#include <optional>
#include <string>
#include <utility>

#include <isonest/error.h>

#include "preprocess/sources/numbers/raw_source.h"
#include "preprocess/sources/placement/placement.h"
#include "preprocess/sources/wrapping/cropped_source.h"
#include "preprocess/sources/wrapping/label_names.h"
#include "store/base/vectors.h"

namespace isonest::detail {
namespace {

void set_place(const Placement& place, RawLayout& layout) {
    layout.spacing = place.spacing;
    layout.origin = place.origin;
    layout.direction = place.direction;
}

/// Places axes that are not directions in space at right angles to the others. Returns the
/// distances of their positions.
Double3 place_what_is_no_space(const PlacedArray& array, const ChosenAxes& chosen,
                               std::array<Double3, 3>& steps) {
    Double3 apart{1, 1, 1};
    Int3 nodes = chosen.nodes;
    for (std::size_t a = 0; a < 3; ++a) {
        if (chosen.no_space.at(a)) {
            nodes[static_cast<int>(a)] = 1;
            steps.at(a) = {0, 0, 0};
            const double said = array.apart.empty() ? 0 : array.apart[*chosen.axis.at(a)];
            apart.at(a) = said > 0 && std::isfinite(said) ? said : 1;
        }
    }
    complete_steps(nodes, steps);
    for (std::size_t a = 0; a < 3; ++a) {
        for (double& part : steps.at(a)) {
            part *= apart.at(a);
        }
    }
    return apart;
}

}  // namespace

std::unique_ptr<VolumeSource> open_placed(const PlacedArray& array,
                                          std::span<const AxisIndex> index,
                                          std::unique_ptr<ByteReader> bytes) {
    RawLayout layout = array.layout;
    const ChosenAxes chosen = choose_axes(array.axes, index, array.name);
    const ArrayPlace place = place_in_array(array.axes, index, array.name, array.strides);
    layout.nodes = place.nodes;
    layout.strides = place.strides;
    if (array.strides_in_bytes) {
        layout.strides_in_bytes = true;
        layout.strides = place.strides.value_or(Int3{1, 1, 1});  // a single node
    }
    layout.first = place.first;
    layout.whole = place.whole;
    if (chosen.no_space != std::array<bool, 3>{}) {
        layout.frame = AnatomicalFrame::unknown;
    }
    if (array.stored) {
        layout.type = bits_type(*array.stored);
    }
    std::optional<Placement> placement;
    std::optional<Double3> apart;
    std::string lost;
    if (!array.steps.empty()) {
        std::array<Double3, 3> steps{};
        Double3 first = array.first;
        for (std::size_t a = 0; a < 3; ++a) {
            if (chosen.axis.at(a)) {
                steps.at(a) = array.steps[*chosen.axis.at(a)];
            }
        }
        for (std::size_t i = 0; i < array.axes.size(); ++i) {
            for (std::size_t w = 0; w < 3; ++w) {
                first.at(w) += array.steps[i].at(w) * static_cast<double>(chosen.at[i]);
            }
        }
        if (array.own_spacing) {
            place_what_is_no_space(array, chosen, steps);
            if (std::isfinite(first[0] + first[1] + first[2])) {
                layout.origin = first;
            }
            lost = lost_by_own_spacing(layout.nodes, steps);
            if (!lost.empty()) {
                layout.frame = AnatomicalFrame::unknown;
            }
        } else {
            apart = place_what_is_no_space(array, chosen, steps);
            try {
                placement = place_in_world(layout.nodes, steps, first, array.name);
            } catch (const Error&) {
                if (!array.spacing_is_given) {
                    throw;
                }
            }
            if (array.spacing_is_given && (!placement || !are_directions(placement->direction))) {
                placement.emplace().origin = first;
                lost = lost_by_own_spacing(layout.nodes, steps);
            }
            set_place(*placement, layout);
        }
    }
    const bool is_stream = bytes != nullptr && bytes->sequential();
    if (placement && is_stream) {
        placement = with_z_as_it_runs(*placement, layout.nodes);
        set_place(*placement, layout);
    }
    auto source = bytes ? open_bytes(std::move(bytes), array.name, layout, array.file)
                        : open_raw(array.file, array.name, layout);
    if (placement && placement->backward[2] && source->sequential()) {
        placement = with_z_as_it_runs(*placement, layout.nodes);
        set_place(*placement, layout);
        source = open_raw(array.file, array.name, layout);
    }
    if (array.scaling) {
        source = scaled_by_slices(std::move(source), *array.scaling);
    }
    if (placement) {
        source = mirrored(std::move(source), placement->backward);
    }
    source = with_notes(std::move(source), notes_of(chosen, array.axes, apart));
    if (array.stored) {
        source = converted(std::move(source), *array.stored);
    }
    if (const auto axis = time_axis(array.axes, chosen)) {
        source = with_time(std::move(source), {{}, {}, array.axes[*axis].length});
    }
    return lost.empty() ? std::move(source) : with_notes(std::move(source), {lost});
}

CoordinatePlace place_rectilinear(
    PlacedArray& array, const std::array<std::int64_t, 3>& points, bool of_cells,
    const SourceOptions& options,
    const std::function<std::vector<double>(std::size_t along)>& read) {
    constexpr std::int64_t kMax = std::int64_t{1} << 24U;
    const ChosenAxes chosen = choose_axes(array.axes, options.index, array.name);
    std::array<std::optional<AxisCoordinates>, 3> said;
    for (std::size_t a = 0; a < 3; ++a) {
        const std::optional<std::size_t> axis = chosen.axis.at(a);
        if (!axis || *axis > 2 || points.at(2 - *axis) > kMax) {
            continue;
        }
        const std::size_t along = 2 - *axis;
        std::vector<double> numbers = read(along);
        if (of_cells && numbers.size() > 1) {
            for (std::size_t i = 0; i + 1 < numbers.size(); ++i) {
                numbers[i] = (numbers[i] + numbers[i + 1]) / 2;
            }
            numbers.pop_back();
        }
        said.at(a) = {std::string(1, "xyz"[along]), std::move(numbers), ""};
    }
    CoordinatePlace by = place_by_coordinates(said, chosen.nodes, options, array.name);
    array.first = by.first;
    for (std::size_t a = 0; a < 3; ++a) {
        if (said.at(a)) {
            array.steps[*chosen.axis.at(a)] = {};
            array.steps[*chosen.axis.at(a)].at(a) = by.step.at(a);
        }
    }
    return by;
}

}  // namespace isonest::detail
