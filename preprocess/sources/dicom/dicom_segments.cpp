#include "preprocess/sources/dicom/dicom_segments.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <iterator>
#include <utility>

#include <isonest/error.h>

#include "preprocess/sources/bytes/input_file.h"
#include "preprocess/sources/dicom/dicom_frames.h"
#include "preprocess/sources/dicom/dicom_stack.h"
#include "preprocess/sources/placement/axis_choice.h"
#include "preprocess/sources/wrapping/cropped_source.h"
#include "preprocess/sources/wrapping/label_names.h"

namespace isonest::detail {
namespace {

using Kind = DicomSegmentation::Kind;

/// A frame with its plane on the grid.
struct SegmentFrame {
    std::int64_t z = 0;
    std::uint32_t frame = 0;
    std::uint16_t segment = 0;
};

struct SegmentVolume {
    DicomNumbers numbers;
    Kind kind = Kind::binary;
    double most = 1;
    std::vector<SegmentFrame> frames;  ///< by z, then by segment
    std::optional<std::int64_t> only;  ///< the selected segment
    std::vector<DicomSegment> segments;
    ValueType type = ValueType::u8;
    Int3 nodes;
    PlacedStack placed;
    std::string name;
    std::vector<std::string> notes;
};

class SegmentSource : public VolumeSource {
  public:
    SegmentSource(std::filesystem::path file, SegmentVolume volume)
        : frames_({std::move(file)}, volume.numbers), volume_(std::move(volume)) {}
    [[nodiscard]] VolumeDescription describe() const override {
        const Placement& place = volume_.placed.place;
        return {volume_.nodes, volume_.type,           place.spacing,
                place.origin,  volume_.name,           place.direction,
                false,         LengthUnit::millimetre, volume_.placed.frame};
    }
    [[nodiscard]] std::vector<std::filesystem::path> files() const override {
        return frames_.files();
    }
    [[nodiscard]] std::string identity() const override {
        return fmt::format("{}segment {}\n", identity_of(files()), volume_.only.value_or(0));
    }
    [[nodiscard]] Granularity granularity() const override { return {1, volume_.nodes.y}; }
    [[nodiscard]] std::uint64_t heap() const override {
        return (1U << 20U) + frames_.heap() + volume_.frames.size() * sizeof(SegmentFrame) +
               static_cast<std::uint64_t>(volume_.nodes.x * volume_.nodes.y) * sizeof(float);
    }
    [[nodiscard]] std::vector<std::string> notes() const override { return volume_.notes; }
    void read(std::int64_t z0, std::int64_t nz, std::int64_t y0, std::int64_t ny,
              std::byte* dst) override {
        const auto count = static_cast<std::size_t>(ny * volume_.nodes.x);
        const std::size_t plane = count * size_of(volume_.type);
        stored_.resize(count * size_of(volume_.numbers.type()));
        for (std::int64_t z = z0; z < z0 + nz; ++z, dst += plane) {
            std::memset(dst, 0, plane);
            auto frame = std::lower_bound(
                volume_.frames.begin(), volume_.frames.end(), z,
                [](const SegmentFrame& f, std::int64_t wanted) { return f.z < wanted; });
            for (; frame != volume_.frames.end() && frame->z == z; ++frame) {
                frames_.read(0, frame->frame, y0, ny, stored_.data());
                put(*frame, count, dst);
            }
        }
    }

  private:
    void put(const SegmentFrame& frame, std::size_t count, std::byte* dst) const {
        if (volume_.kind == Kind::fractional) {
            dispatch(volume_.numbers.type(), [&](auto tag) {
                using T = typename decltype(tag)::type;
                for (std::size_t i = 0; i < count; ++i) {
                    T stored{};
                    std::memcpy(&stored, stored_.data() + i * sizeof(T), sizeof(T));
                    const auto value =
                        static_cast<float>(static_cast<double>(stored) / volume_.most);
                    std::memcpy(dst + i * sizeof(float), &value, sizeof(float));
                }
            });
            return;
        }
        dispatch(volume_.numbers.type(), [&](auto stored_tag) {
            dispatch(volume_.type, [&](auto tag) {
                put_labels<typename decltype(stored_tag)::type, typename decltype(tag)::type>(
                    frame, count, dst);
            });
        });
    }
    template <class From, class To>
    void put_labels(const SegmentFrame& frame, std::size_t count, std::byte* dst) const {
        for (std::size_t i = 0; i < count; ++i) {
            From stored{};
            std::memcpy(&stored, stored_.data() + i * sizeof(From), sizeof(From));
            if (stored == From{}) {
                continue;
            }
            To label = volume_.kind == Kind::binary ? static_cast<To>(frame.segment)
                                                    : static_cast<To>(stored);
            if (volume_.only && static_cast<std::int64_t>(label) != *volume_.only) {
                continue;
            }
            To there{};
            std::memcpy(&there, dst + i * sizeof(To), sizeof(To));
            if (there != To{} && there != label) {
                refuse_overlap(static_cast<std::int64_t>(there), static_cast<std::int64_t>(label));
            }
            std::memcpy(dst + i * sizeof(To), &label, sizeof(To));
        }
    }
    [[noreturn]] void refuse_overlap(std::int64_t a, std::int64_t b) const {
        throw Error(ErrorKind::unsupported, {volume_.name},
                    fmt::format("the segments {} and {} overlap, so they cannot be one volume of "
                                "labels; choose one segment",
                                a, b),
                    {{RemedyKind::choose_index, fmt::format("segment={}", a)}});
    }

    DicomFrames frames_;
    SegmentVolume volume_;
    std::vector<std::byte> stored_;
};

/// "1 \"Liver\", 2 \"Spleen\""
std::string text_of(const std::vector<DicomSegment>& segments) {
    constexpr std::size_t kMax = 12;
    std::string text;
    for (std::size_t i = 0; i < segments.size() && i < kMax; ++i) {
        text +=
            fmt::format("{}{} \"{}\"", i == 0 ? "" : ", ", segments[i].number, segments[i].label);
    }
    return segments.size() > kMax ? text + ", ..." : text;
}

double along_normal(const Double3& normal, const Double3& v) {
    return normal[0] * v[0] + normal[1] * v[1] + normal[2] * v[2];
}

/// The distance of the grid's planes: that of the file if all places lie on its planes, otherwise
/// the smallest gap. `places` are in ascending order. Throws Error{unsupported} if neither works.
double grid_step(const std::vector<double>& places, const std::optional<double>& between,
                 const std::string& name) {
    constexpr double kMaxShift = 0.1;  // of a step
    if (places.size() < 2) {
        return between.value_or(1);
    }
    double least = places[1] - places[0];
    for (std::size_t i = 1; i < places.size(); ++i) {
        least = std::min(least, places[i] - places[i - 1]);
    }
    const double whole = places.back() - places.front();
    for (const double guess : {between.value_or(least), least}) {
        const double planes = std::round(whole / guess);
        const double step = whole / planes;
        const bool even =
            planes >= 1 && std::all_of(places.begin(), places.end(), [&](double place) {
                const double at = (place - places.front()) / step;
                return std::fabs(at - std::round(at)) < kMaxShift;
            });
        if (even && least > (1 - 2 * kMaxShift) * step) {
            return step;
        }
    }
    throw Error(
        ErrorKind::unsupported, {name},
        fmt::format(
            "the frames of the segmentation are not evenly spaced; the smallest distance is {:.6g}",
            least));
}

/// Assigns frames to the planes of a grid. Returns the stack's place; its slices stay empty.
DicomStack on_grid(const DicomGroup& group, SegmentVolume& volume) {
    const auto refuse = [&](const std::string& problem) {
        throw Error(ErrorKind::unsupported, {volume.name}, problem);
    };
    const bool placed = group.orientation && group.spacing &&
                        std::all_of(group.slices.begin(), group.slices.end(),
                                    [](const DicomSlice& s) { return s.position.has_value(); });
    if (!placed) {
        refuse("the frames of the segmentation lack a position, orientation or pixel spacing");
    }
    const auto& [row, column] = *group.orientation;
    Double3 normal{row[1] * column[2] - row[2] * column[1], row[2] * column[0] - row[0] * column[2],
                   row[0] * column[1] - row[1] * column[0]};
    const double length = std::hypot(normal[0], normal[1], normal[2]);
    if (!(length > 0.5)) {
        refuse("rows and columns are parallel (ImageOrientationPatient)");
    }
    for (double& v : normal) {
        v /= length;
    }
    const double pixel = std::min((*group.spacing)[0], (*group.spacing)[1]);
    constexpr double kSamePlane = 1e-3;  // of a pixel
    constexpr double kMaxAside = 0.1;
    std::vector<DicomSlice> slices = group.slices;
    std::stable_sort(slices.begin(), slices.end(), [&](const DicomSlice& a, const DicomSlice& b) {
        return along_normal(normal, *a.position) < along_normal(normal, *b.position);
    });
    std::vector<double> places;
    for (const DicomSlice& slice : slices) {
        const double at = along_normal(normal, *slice.position);
        if (places.empty() || at - places.back() > kSamePlane * pixel) {
            places.push_back(at);
        }
    }
    const double step = grid_step(
        places, places.size() < 2 && !group.between ? group.step : group.between, volume.name);
    const double planes = std::round((places.back() - places.front()) / step) + 1;
    constexpr double kMaxPlanes = 1 << 20U;
    if (!(planes <= kMaxPlanes)) {
        refuse(fmt::format("the frames of the segmentation span {:.0f} planes, which is too many",
                           planes));
    }
    DicomStack stack;
    stack.placed = true;
    stack.normal = normal;
    stack.count = static_cast<std::int64_t>(planes);
    stack.first = *slices.front().position;
    for (std::size_t a = 0; a < 3; ++a) {
        stack.steps[0].at(a) = row.at(a) * (*group.spacing)[0];
        stack.steps[1].at(a) = column.at(a) * (*group.spacing)[1];
        stack.steps[2].at(a) =
            stack.count > 1 ? (slices.back().position->at(a) - stack.first.at(a)) / (planes - 1)
                            : normal.at(a) * step;
    }
    for (const DicomSlice& slice : slices) {
        SegmentFrame frame;
        frame.z = std::llround((along_normal(normal, *slice.position) - places.front()) / step);
        frame.frame = slice.frame;
        frame.segment = slice.segment;
        Double3 aside = *slice.position;
        for (std::size_t a = 0; a < 3; ++a) {
            aside.at(a) -= stack.first.at(a) + static_cast<double>(frame.z) * stack.steps[2].at(a);
        }
        const double forth = along_normal(normal, aside);
        const double shift = std::hypot(aside[0] - forth * normal[0], aside[1] - forth * normal[1],
                                        aside[2] - forth * normal[2]);
        if (shift > kMaxAside * pixel) {
            refuse(fmt::format("frame {} of the segmentation is shifted sideways by {:.3g}",
                               slice.frame + 1, shift));
        }
        volume.frames.push_back(frame);
    }
    if (const auto empty = stack.count - static_cast<std::int64_t>(places.size()); empty > 0) {
        volume.notes.push_back(
            fmt::format("{} of {} slices have no frame in the segmentation; their values are 0",
                        empty, stack.count));
    }
    return stack;
}

/// Sets the selected segment, and the type of the values.
void choose_segment(const DicomSegmentation& about, std::optional<std::int64_t> chosen,
                    SegmentVolume& volume) {
    const auto refuse = [&](ErrorKind kind, const std::string& problem) {
        throw Error(
            kind, {volume.name},
            fmt::format("{}; the segments are: {}", problem, text_of(volume.segments)),
            {{RemedyKind::choose_index,
              fmt::format("segment={}", volume.segments.empty() ? 1 : volume.segments[0].number)}});
    };
    volume.kind = about.kind;
    volume.most = about.most;
    const auto is_listed = [&](std::int64_t number) {
        return std::any_of(volume.segments.begin(), volume.segments.end(),
                           [&](const DicomSegment& s) { return s.number == number; });
    };
    if (chosen && !is_listed(*chosen)) {
        refuse(ErrorKind::invalid_argument, fmt::format("there is no segment {}", *chosen));
    }
    if (volume.kind == Kind::fractional && !chosen && volume.segments.size() > 1) {
        refuse(ErrorKind::unsupported,
               "each segment is a separate volume (SegmentationType FRACTIONAL)");
    }
    if (volume.kind == Kind::fractional && !(volume.most >= 1)) {
        throw Error(ErrorKind::corrupt, {volume.name, "MaximumFractionalValue"},
                    fmt::format("{}", volume.most));
    }
    volume.only = chosen;
    if (volume.kind != Kind::label_map) {
        for (const SegmentFrame& frame : volume.frames) {
            if (!is_listed(frame.segment)) {
                throw Error(
                    ErrorKind::corrupt, {volume.name},
                    fmt::format("frame {} belongs to segment {}, which is not in SegmentSequence",
                                frame.frame + 1, frame.segment));
            }
        }
        if (chosen) {
            std::erase_if(volume.frames,
                          [&](const SegmentFrame& frame) { return frame.segment != *chosen; });
        }
    }
    constexpr std::int64_t kMaxU8 = 255;
    const bool small = std::all_of(volume.segments.begin(), volume.segments.end(),
                                   [&](const DicomSegment& s) { return s.number <= kMaxU8; });
    volume.type = volume.kind == Kind::fractional  ? ValueType::f32
                  : volume.kind == Kind::label_map ? volume.numbers.type()
                  : small                          ? ValueType::u8
                                                   : ValueType::u16;
    std::sort(volume.frames.begin(), volume.frames.end(),
              [](const SegmentFrame& a, const SegmentFrame& b) {
                  return std::pair{a.z, a.segment} < std::pair{b.z, b.segment};
              });
    const auto twice = std::adjacent_find(volume.frames.begin(), volume.frames.end(),
                                          [](const SegmentFrame& a, const SegmentFrame& b) {
                                              return a.z == b.z && a.segment == b.segment;
                                          });
    if (twice != volume.frames.end()) {
        throw Error(ErrorKind::unsupported, {volume.name},
                    fmt::format("the frames {} and {} of one segment have the same position",
                                twice->frame + 1, std::next(twice)->frame + 1));
    }
}

}  // namespace

std::optional<std::int64_t> taken_entry(std::vector<AxisIndex>& index, std::string_view axis,
                                        const std::string& name) {
    std::optional<std::int64_t> at;
    for (const AxisIndex& entry : index) {
        if (entry.axis == axis) {
            if (at || !entry.at) {
                throw Error(ErrorKind::invalid_argument, {name},
                            fmt::format("the index needs exactly one position of '{}'", axis),
                            {{RemedyKind::choose_index, fmt::format("{}=0", axis)}});
            }
            at = entry.at;
        }
    }
    std::erase_if(index, [&](const AxisIndex& entry) { return entry.axis == axis; });
    return at;
}

LabelColor color_of_lab(const std::array<std::uint16_t, 3>& lab) {
    constexpr double kFull = 65535;
    const double lightness = lab[0] / kFull * 100;
    const double a = lab[1] / kFull * 255 - 128;
    const double b = lab[2] / kFull * 255 - 128;
    const double fy = (lightness + 16) / 116;
    const auto cube = [](double f) {
        constexpr double kEdge = 6.0 / 29;
        return f > kEdge ? f * f * f : 3 * kEdge * kEdge * (f - 4.0 / 29);
    };
    const std::array<double, 3> xyz{0.96422 * cube(fy + a / 500), cube(fy),
                                    0.82521 * cube(fy - b / 200)};
    // XYZ (D50) to linear sRGB, with Bradford's adaptation (http://www.brucelindbloom.com).
    constexpr std::array<std::array<double, 3>, 3> kToRgb{{{3.1338561, -1.6168667, -0.4906146},
                                                           {-0.9787684, 1.9161415, 0.0334540},
                                                           {0.0719453, -0.2289914, 1.4052427}}};
    LabelColor color{};
    for (std::size_t i = 0; i < 3; ++i) {
        const double linear = std::clamp(
            kToRgb.at(i)[0] * xyz[0] + kToRgb.at(i)[1] * xyz[1] + kToRgb.at(i)[2] * xyz[2], 0.0,
            1.0);
        const double part =
            linear <= 0.0031308 ? 12.92 * linear : 1.055 * std::pow(linear, 1 / 2.4) - 0.055;
        color.at(i) = static_cast<std::uint8_t>(std::lround(part * 255));
    }
    return color;
}

std::unique_ptr<VolumeSource> open_dicom_segments(const DicomGroup& group,
                                                  const std::vector<std::filesystem::path>& files,
                                                  const SourceOptions& options,
                                                  std::vector<AxisIndex> index,
                                                  std::vector<std::string> notes,
                                                  const std::string& name) {
    const auto other =
        std::find_if(group.slices.begin(), group.slices.end(),
                     [&](const DicomSlice& slice) { return slice.file != group.slices[0].file; });
    if (other != group.slices.end()) {
        throw Error(
            ErrorKind::unsupported, {name},
            fmt::format("the series has several segmentations; give one file, such as {} or {}",
                        files[group.slices[0].file].string(), files[other->file].string()));
    }
    SegmentVolume volume;
    volume.name = name;
    volume.numbers = group.numbers;
    volume.segments = group.segmentation->segments;
    const std::optional<std::int64_t> chosen = taken_entry(index, "segment", name);
    const DicomStack stack = on_grid(group, volume);
    choose_segment(*group.segmentation, chosen, volume);
    volume.nodes = {group.numbers.columns, group.numbers.rows, stack.count};
    const std::array<ArrayAxis, 3> axes{ArrayAxis{"z", stack.count},
                                        ArrayAxis{"y", group.numbers.rows},
                                        ArrayAxis{"x", group.numbers.columns}};
    if (!(choose_axes(axes, index, name).nodes == volume.nodes)) {
        throw Error(
            ErrorKind::unsupported, {name},
            "an index can only choose a segment; to read a part of the slices, crop the volume",
            {{RemedyKind::choose_index, "segment=1"}});
    }
    volume.placed = place_stack(volume.nodes, stack, options.spacing.has_value(), name);
    const bool fractional = volume.kind == Kind::fractional;
    notes.push_back(
        fractional
            ? fmt::format("values are fractions of a segment, from 0 to 1; the segments are: {}",
                          text_of(volume.segments))
            : fmt::format("values are segment numbers (labels): {}", text_of(volume.segments)));
    std::move(volume.notes.begin(), volume.notes.end(), std::back_inserter(notes));
    std::move(volume.placed.notes.begin(), volume.placed.notes.end(), std::back_inserter(notes));
    FoundLabels labels;
    if (options.labels && !fractional) {
        for (const DicomSegment& segment : volume.segments) {
            if (!chosen || segment.number == *chosen) {
                labels.add(segment.number, segment.label,
                           segment.lab ? std::optional(color_of_lab(*segment.lab)) : std::nullopt);
            }
        }
        const std::vector<std::string> left = labels.notes();
        notes.insert(notes.end(), left.begin(), left.end());
    }
    volume.notes = std::move(notes);
    const std::array<bool, 3> backward = volume.placed.place.backward;
    auto source = std::make_unique<SegmentSource>(files[group.slices[0].file], std::move(volume));
    if (source->heap() > options.max_heap) {
        throw Error(ErrorKind::limit, {name},
                    fmt::format("the frames of the segmentation need {} bytes", source->heap()),
                    {{RemedyKind::more_memory}});
    }
    return mirrored(with_label_names(std::move(source), labels.names()), backward);
}

}  // namespace isonest::detail
