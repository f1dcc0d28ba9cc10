#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include <isonest/error.h>

#include "preprocess/sources/bytes/header_words.h"
#include "preprocess/sources/placement/placed_array.h"
#include "preprocess/sources/volume_format.h"
#include "preprocess/sources/wrapping/label_names.h"

namespace isonest::detail {
namespace {

// All numbers are big endian.
constexpr std::size_t kNumbers = 284;  ///< offset of the voxels
constexpr std::size_t kUsed = 90;      ///< bytes of the header; zeros follow up to the voxels

enum Type { kUchar = 0, kInt = 1, kFloat = 3, kShort = 4, kUshort = 10 };

std::int32_t whole(std::string_view head, std::size_t word) {
    return number_at<std::int32_t>(head, 4 * word, true);
}
double real(std::string_view head, std::size_t at) {
    return static_cast<double>(number_at<float>(head, at, true));
}

/// Checks version 1, four sizes, a type, and zeros in unused fields.
bool is_mgh(const VolumeInput& input) {
    const std::string_view head = input.unpacked;
    constexpr std::int32_t kMaxType = 10;
    if (input.folder || head.size() < kNumbers || whole(head, 0) != 1 || whole(head, 5) < 0 ||
        whole(head, 5) > kMaxType) {
        return false;
    }
    for (std::size_t axis = 1; axis <= 4; ++axis) {
        if (whole(head, axis) < 1) {
            return false;
        }
    }
    const std::string_view unused = head.substr(kUsed, kNumbers - kUsed);
    return unused.find_first_not_of('\0') == std::string_view::npos;
}

void set_type(std::int32_t type, PlacedArray& array) {
    switch (type) {
        case kUchar:
            array.layout.type = ValueType::u8;
            return;
        case kInt:
            array.layout.type = ValueType::i32;
            return;
        case kFloat:
            array.layout.type = ValueType::f32;
            return;
        case kShort:
            array.layout.type = ValueType::i16;
            return;
        case kUshort:
            array.layout.type = ValueType::u16;
            return;
        default:
            throw Error(ErrorKind::unsupported, {array.name, "type"},
                        fmt::format("{} is not supported; 0, 1, 3, 4 and 10 are (integers of 8 to "
                                    "32 bits, float32)",
                                    type));
    }
}

bool has_place(std::string_view head) {
    constexpr std::size_t kFlag = 28;
    return number_at<std::int16_t>(head, kFlag, true) > 0;
}

/// Places the volume by the directions and sizes of the voxels and its centre: the point that is
/// half the number of nodes from the first node, which is not a node if that number is odd.
void set_place(std::string_view head, PlacedArray& array) {
    std::array<Double3, 3> steps{{{-1, 0, 0}, {0, 0, -1}, {0, 1, 0}}};
    Double3 centre{0, 0, 0};
    if (has_place(head)) {
        constexpr std::size_t kSizes = 30;
        constexpr std::size_t kDirections = 42;
        constexpr std::size_t kCentre = 78;
        for (std::size_t axis = 0; axis < 3; ++axis) {
            for (std::size_t world = 0; world < 3; ++world) {
                steps.at(axis).at(world) = real(head, kDirections + 4 * (3 * axis + world)) *
                                           real(head, kSizes + 4 * axis);
            }
            centre.at(axis) = real(head, kCentre + 4 * axis);
        }
    }
    array.first = centre;
    for (std::size_t axis = 0; axis < 3; ++axis) {
        for (std::size_t world = 0; world < 3; ++world) {
            array.first.at(world) -= steps.at(axis).at(world) * whole(head, 1 + axis) / 2;
        }
    }
    array.steps = {{0, 0, 0}, steps[2], steps[1], steps[0]};
}

std::unique_ptr<VolumeSource> open_mgh(const VolumeInput& input, const SourceOptions& options) {
    const std::string_view head = input.unpacked;
    PlacedArray array;
    array.file = input.file;
    array.name = input.name();
    set_type(whole(head, 5), array);
    array.axes = {{"t", whole(head, 4), false},
                  {"z", whole(head, 3), true},
                  {"y", whole(head, 2), true},
                  {"x", whole(head, 1), true}};
    array.layout.offset = kNumbers;
    array.layout.big_endian = true;
    array.layout.exact_length = false;  // acquisition and tags may follow
    array.layout.packing = input.gzip() ? Packing::gzip : Packing::plain;
    array.layout.unit = LengthUnit::millimetre;
    array.layout.frame = AnatomicalFrame::ras;
    set_place(head, array);
    array.own_spacing = options.spacing.has_value();
    std::vector<std::string> notes;
    if (!has_place(head) && !options.spacing) {
        notes.emplace_back(
            "the file has no placement; coronal slices with voxels of 1 mm around the origin are "
            "assumed, as in FreeSurfer");
    }
    return with_notes(open_placed(array, options.index), std::move(notes));
}

}  // namespace

VolumeFormat mgh_format() {
    return {.about = {"FreeSurfer MGH", ".mgh .mgz", ""},
            .takes = {.index = true},
            .reads_urls = true,
            .recognises = is_mgh,
            .open = open_mgh};
}

}  // namespace isonest::detail
