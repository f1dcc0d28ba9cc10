#include "preprocess/sources/placement/placed_array.h"

#include <optional>
#include <utility>

#include "preprocess/sources/numbers/byte_source.h"
#include "preprocess/sources/numbers/raw_source.h"
#include "preprocess/sources/placement/placement.h"
#include "preprocess/sources/wrapping/mirrored_source.h"

namespace isonest::detail {
namespace {

void set_place(const Placement& place, RawLayout& layout) {
    layout.spacing = place.spacing;
    layout.origin = place.origin;
    layout.direction = place.direction;
}

}  // namespace

std::unique_ptr<VolumeSource> open_placed(const PlacedArray& array,
                                          std::span<const AxisIndex> index,
                                          std::unique_ptr<ByteReader> bytes) {
    RawLayout layout = array.layout;
    const ArrayPlace place = place_in_array(array.axes, index, array.name, array.strides);
    layout.nodes = place.nodes;
    layout.strides = place.strides;
    if (array.strides_in_bytes) {
        layout.strides_in_bytes = true;
        layout.strides = place.strides.value_or(Int3{1, 1, 1});  // of one node alone
    }
    layout.first = place.first;
    layout.whole = place.whole;
    if (array.stored) {
        layout.type = bits_type(*array.stored);
    }
    std::optional<Placement> placement;
    if (!array.steps.empty()) {
        const ChosenAxes chosen = choose_axes(array.axes, index, array.name);
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
        placement = place_in_world(layout.nodes, steps, first, array.name);
        set_place(*placement, layout);
    }
    auto source = bytes ? open_bytes(std::move(bytes), array.name, layout, array.file)
                        : open_raw(array.file, array.name, layout);
    if (placement && placement->backward[2] && source->sequential()) {
        placement = with_z_as_it_runs(*placement, layout.nodes);
        set_place(*placement, layout);
        source = open_raw(array.file, array.name, layout);
    }
    if (placement) {
        source = mirrored(std::move(source), placement->backward);
    }
    return array.stored ? converted(std::move(source), *array.stored) : std::move(source);
}

}  // namespace isonest::detail
