#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include <isonest/error.h>

#include "preprocess/sources/bytes/header_words.h"
#include "preprocess/sources/placement/placed_array.h"
#include "preprocess/sources/volume_format.h"
#include "preprocess/sources/wrapping/label_names.h"

namespace isonest::detail {
namespace {

constexpr std::size_t kHeaderBytes = 1024;

bool is_mrc(const VolumeInput& input) {
    return !input.folder && input.unpacked.size() >= kHeaderBytes &&
           input.unpacked.compare(208, 4, "MAP ") == 0;
}

void set_type(int mode, bool unsigned_bytes, const std::string& name, PlacedArray& array) {
    switch (mode) {
        case 0:
            array.layout.type = unsigned_bytes ? ValueType::u8 : ValueType::i8;
            return;
        case 1:
            array.layout.type = ValueType::i16;
            return;
        case 2:
            array.layout.type = ValueType::f32;
            return;
        case 6:
            array.layout.type = ValueType::u16;
            return;
        case 12:
            array.stored = StoredNumber::f16;
            return;
        default:
            throw Error(ErrorKind::unsupported, {name, "mode"},
                        fmt::format("{} is not supported; 0, 1, 2, 6 and 12 are (8 and 16 bit "
                                    "integers, 16 and 32 bit floating point numbers)",
                                    mode));
    }
}

constexpr Double3 kRightAngles{90, 90, 90};

/// The steps along a cell's axes: a along x, b in the plane of x and y. None for impossible angles.
/// Source: International Tables for Crystallography B, 3.3.1; as in the CCP4 library.
std::optional<std::array<Double3, 3>> steps_of_cell(const Double3& spacing, const Double3& angles) {
    std::array<Double3, 3> steps{{{spacing[0], 0, 0}, {0, spacing[1], 0}, {0, 0, spacing[2]}}};
    if (angles == kRightAngles) {
        return steps;
    }
    // Exactly 0 for a right angle.
    const auto cosine = [](double angle) {
        return angle == kRightAngles[0] ? 0 : std::cos(angle * std::numbers::pi / 180);
    };
    const double a = cosine(angles[0]);
    const double b = cosine(angles[1]);
    const double c = cosine(angles[2]);
    const double sine = std::sqrt(1 - c * c);
    const double y = (a - b * c) / sine;
    const double square = 1 - b * b - y * y;
    if (!(sine > 0 && square > 0)) {
        return std::nullopt;
    }
    steps[1] = {spacing[1] * c, spacing[1] * sine, 0};
    steps[2] = {spacing[2] * b, spacing[2] * y, spacing[2] * std::sqrt(square)};
    return steps;
}

std::unique_ptr<VolumeSource> open_mrc(const VolumeInput& input, const SourceOptions& options) {
    const std::string_view head = input.unpacked;
    PlacedArray array;
    array.file = input.file;
    array.name = input.name();
    constexpr char kBig = 0x11;
    const bool big = head[212] == kBig;
    const auto whole = [&](std::size_t word) {
        return number_at<std::int32_t>(head, 4 * word, big);
    };
    const auto real = [&](std::size_t word) {
        return static_cast<double>(number_at<float>(head, 4 * word, big));
    };
    constexpr std::int32_t kImodStamp = 1146047817;
    set_type(whole(3), whole(38) == kImodStamp && (whole(39) & 1) == 0, array.name, array);
    array.layout.big_endian = big;
    array.layout.exact_length = false;
    const std::int32_t extended = whole(23);
    if (extended < 0) {
        throw Error(ErrorKind::corrupt, {array.name, "nsymbt"},
                    fmt::format("invalid size of the extended header: {} bytes", extended));
    }
    array.layout.offset = kHeaderBytes + static_cast<std::uint64_t>(extended);
    // The world axes (1 to 3) of columns, rows and sections.
    std::array<int, 3> along{whole(16), whole(17), whole(18)};
    std::array<int, 3> sorted = along;
    std::sort(sorted.begin(), sorted.end());
    if (along == std::array{0, 0, 0}) {
        along = {1, 2, 3};
    } else if (sorted != std::array{1, 2, 3}) {
        throw Error(ErrorKind::corrupt, {array.name, "mapc, mapr, maps"},
                    fmt::format("{}, {}, {} are not 1, 2 and 3 in any order", along[0], along[1],
                                along[2]));
    }
    const std::array<std::int64_t, 3> count{whole(0), whole(1), whole(2)};
    const std::array<double, 3> sampling{static_cast<double>(whole(7)),
                                         static_cast<double>(whole(8)),
                                         static_cast<double>(whole(9))};
    constexpr std::array<const char*, 3> kNames{"x", "y", "z"};
    // A stack of volumes: all sections of one volume, then the next.
    const int group = whole(22);
    const auto sections = static_cast<std::int64_t>(sampling[2]);
    constexpr int kStackOfVolumes = 401;
    const bool stack = group >= kStackOfVolumes && sections > 0 && count[2] % sections == 0;
    Double3 spacing{1, 1, 1};
    Double3 angles = kRightAngles;  // alpha, beta and gamma
    for (std::size_t a = 0; a < 3; ++a) {
        const double length = real(10 + a);
        if (length > 0 && sampling.at(a) > 0 && std::isfinite(length)) {
            spacing.at(a) = length / sampling.at(a);
            array.layout.unit = LengthUnit::angstrom;  // of a cell
        }
        const double angle = real(13 + a);
        if (length > 0 && angle != 0 && !(std::fabs(angle - 90) < 1e-3)) {
            angles.at(a) = angle;
        }
    }
    std::vector<std::string> notes;
    const std::array<Double3, 3> cell_steps = [&] {
        if (const auto steps = steps_of_cell(spacing, angles)) {
            return *steps;
        }
        const std::string no_cell = fmt::format("no cell has the angles {}, {} and {} degrees",
                                                angles[0], angles[1], angles[2]);
        if (!options.spacing) {
            throw Error(ErrorKind::corrupt, {array.name, "cellb"}, no_cell,
                        {{RemedyKind::place_in_world, "spacing"}});
        }
        notes.push_back(no_cell + "; the axes are taken to be at right angles");
        return *steps_of_cell(spacing, kRightAngles);
    }();
    const Double3 origin{real(49), real(50), real(51)};
    const bool has_origin =
        std::any_of(origin.begin(), origin.end(), [](double o) { return o != 0; });
    if (stack) {
        array.axes.push_back({"volume", count[2] / sections, false});
        array.steps.push_back({0, 0, 0});
    }
    array.axes.resize(array.axes.size() + 3);
    array.steps.resize(array.axes.size());
    array.strides.assign(array.axes.size(), 1);
    // In the world's order, whatever the order in the file: the strides say where the values are.
    std::array<std::uint64_t, 3> strides{
        1, static_cast<std::uint64_t>(std::max<std::int64_t>(count[0], 1)), 0};
    strides[2] = strides[1] * static_cast<std::uint64_t>(std::max<std::int64_t>(count[1], 1));
    if (stack) {
        array.strides[0] = strides[2] * static_cast<std::uint64_t>(sections);
    }
    for (std::size_t i = 0; i < 3; ++i) {
        const auto world = static_cast<std::size_t>(along.at(i) - 1);
        const std::size_t axis = array.axes.size() - 1 - world;
        array.axes[axis] = {kNames.at(world), stack && i == 2 ? sections : count.at(i)};
        array.strides[axis] = strides.at(i);
        array.steps[axis] = cell_steps.at(world);
        // The origin is a position in space, the start a number of steps.
        for (std::size_t w = 0; w < 3 && !has_origin; ++w) {
            array.first.at(w) += static_cast<double>(whole(4 + i)) * cell_steps.at(world).at(w);
        }
    }
    if (has_origin) {
        array.first = origin;
    }
    array.own_spacing = options.spacing.has_value();
    return with_notes(open_placed(array, options.index), std::move(notes));
}

}  // namespace

VolumeFormat mrc_format() {
    return {.about = {"MRC", ".mrc .map .ccp4 .rec .st", ""},
            .takes = {.index = true},
            .reads_urls = true,
            .recognises = is_mrc,
            .open = open_mrc};
}

}  // namespace isonest::detail
