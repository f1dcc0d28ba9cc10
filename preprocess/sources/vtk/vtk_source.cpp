#include <fmt/format.h>

#include <array>
#include <string>
#include <utility>

#include <isonest/error.h>

#include "preprocess/sources/bytes/byte_reader.h"
#include "preprocess/sources/placement/placed_array.h"
#include "preprocess/sources/vtk/legacy_header.h"
#include "preprocess/sources/vtk/vtk_format.h"

namespace isonest::detail {
namespace {

bool is_vtk(const VolumeInput& input) {
    return input.head.starts_with("# vtk DataFile Version");
}

std::unique_ptr<VolumeSource> open_vtk(const VolumeInput& input, const SourceOptions& options) {
    const LegacyHeader header = read_legacy_header(input.file, options.dataset);
    const LegacyArray& found = header.array;
    PlacedArray array;
    array.file = input.file;
    array.name = input.name() + ":" + found.name;
    if (header.text && found.colours) {
        throw Error(ErrorKind::unsupported, {array.name}, "numbers of type 'text of colours'");
    }
    const LegacyType* const type = legacy_type(found.type);
    if (type == nullptr) {
        throw Error(ErrorKind::unsupported, {array.name},
                    fmt::format("numbers of type '{:.40}'", found.type));
    }
    array.layout.type = type->type;
    array.stored = type->stored;
    constexpr std::array<const char*, 3> kNames{"x", "y", "z"};
    array.first = header.origin;
    for (std::size_t i = 3; i-- > 0;) {
        const std::int64_t nodes = header.dimensions.at(i);
        const bool between = found.of_cells && nodes > 1;
        array.axes.push_back({kNames.at(i), between ? nodes - 1 : nodes, true});
        array.first.at(i) += between ? header.spacing.at(i) / 2 : 0;
        Double3 step{};
        step.at(i) = header.spacing.at(i);
        array.steps.push_back(step);
    }
    const std::uint64_t values = place_in_array(array.axes, {}, array.name).whole;
    if (values != static_cast<std::uint64_t>(found.tuples)) {
        throw Error(ErrorKind::corrupt, {array.name},
                    fmt::format("it has {} values, but there are [{}] {}", found.tuples,
                                text_of(array.axes), found.of_cells ? "cells" : "points"));
    }
    if (found.components > 1) {
        array.axes.push_back({"c", found.components, false});
        array.steps.push_back({0, 0, 0});
    }
    array.own_spacing = options.spacing.has_value();
    array.layout.exact_length = false;
    if (header.text) {
        const std::uint64_t count = place_in_array(array.axes, options.index, array.name).whole;
        return open_placed(
            array, options.index,
            array.stored
                ? text_integers(array.file, found.at, *array.stored == StoredNumber::i64, count)
                : text_numbers(array.file, found.at, array.layout.type, count));
    }
    array.layout.big_endian = true;
    array.layout.packing = Packing::plain;
    array.layout.offset = found.at;
    return open_placed(array, options.index);
}

}  // namespace

VolumeFormat vtk_format() {
    return {.about = {"VTK legacy image", ".vtk", ""},
            .takes = {.dataset = true, .index = true},
            .reads_urls = true,
            .recognises = is_vtk,
            .open = open_vtk};
}

}  // namespace isonest::detail
