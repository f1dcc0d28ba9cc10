#include "preprocess/sources/dicom/dicom_series.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <map>

#include <isonest/error.h>

namespace isonest::detail {
namespace {

/// Directions and spacings within this are the same: less than a tenth of a voxel over a thousand.
constexpr double kMostDifference = 1e-4;
/// What may be held for the slices whatever the memory is: of 90,000 of them.
constexpr std::uint64_t kSomeHeap = std::uint64_t{32} << 20U;
/// A list that grows is there twice, and so is one that is put in order.
constexpr std::uint64_t kBytesOfSlice = 3 * sizeof(DicomSlice);

template <class T>
std::optional<T> either(const std::optional<T>& own, const std::optional<T>& shared) {
    return own ? own : shared;
}

DicomPlace place_of_frame(const DicomHeader& header, std::size_t frame) {
    if (header.per_frame.empty()) {
        return header.shared;
    }
    const DicomPlace& own = header.per_frame[frame];
    const DicomPlace& all = header.shared;
    return {either(own.position, all.position),   either(own.orientation, all.orientation),
            either(own.spacing, all.spacing),     either(own.step, all.step),
            either(own.thickness, all.thickness), either(own.slope, all.slope),
            either(own.intercept, all.intercept), either(own.time, all.time)};
}

std::optional<double> step_of(const DicomPlace& place) {
    const std::optional<double>& step =
        place.step && *place.step != 0 ? place.step : place.thickness;
    return step && *step != 0 ? std::optional(std::fabs(*step)) : std::nullopt;
}

/// Where frames have no positions of their own: along the normal, as the offsets of a dose, or a
/// step between slices say.
std::optional<Double3> position_of(const DicomHeader& header, const DicomPlace& place,
                                   std::size_t frame) {
    const bool own = !header.per_frame.empty() && header.per_frame[frame].position.has_value();
    if (own || header.frames == 1 || !place.position) {
        return place.position;
    }
    double along = 0;
    if (static_cast<std::int64_t>(header.grid_offsets.size()) == header.frames) {
        along = header.grid_offsets[frame] - header.grid_offsets[0];
    } else if (const std::optional<double> step = step_of(place)) {
        // Spacing between slices has a sign: frames may lie in front of the first one (PS3.3,
        // C.8.4.15).
        const double slices =
            static_cast<std::int64_t>(header.slice_numbers.size()) == header.frames
                ? header.slice_numbers[frame] - header.slice_numbers[0]
                : static_cast<double>(frame);
        along = std::copysign(*step, place.step.value_or(1)) * slices;
    } else {
        return std::nullopt;
    }
    if (!place.orientation) {
        return std::nullopt;
    }
    const auto& [row, column] = *place.orientation;
    const Double3 normal{row[1] * column[2] - row[2] * column[1],
                         row[2] * column[0] - row[0] * column[2],
                         row[0] * column[1] - row[1] * column[0]};
    Double3 result = *place.position;
    for (std::size_t a = 0; a < 3; ++a) {
        result.at(a) += along * normal.at(a);
    }
    return result;
}

bool same(const std::optional<std::array<Double3, 2>>& a,
          const std::optional<std::array<Double3, 2>>& b) {
    if (!a || !b) {
        return a.has_value() == b.has_value();
    }
    double most = 0;
    for (std::size_t i = 0; i < 2; ++i) {
        for (std::size_t k = 0; k < 3; ++k) {
            most = std::max(most, std::fabs(a->at(i).at(k) - b->at(i).at(k)));
        }
    }
    return most <= kMostDifference;
}

bool same(const std::optional<std::array<double, 2>>& a,
          const std::optional<std::array<double, 2>>& b) {
    if (!a || !b) {
        return a.has_value() == b.has_value();
    }
    return std::fabs((*a)[0] - (*b)[0]) <= kMostDifference * (*a)[0] &&
           std::fabs((*a)[1] - (*b)[1]) <= kMostDifference * (*a)[1];
}

/// What a frame has otherwise than the series, or nothing.
std::string difference_of(const DicomSeries& series, const DicomNumbers& numbers,
                          const DicomPlace& place) {
    if (numbers != series.numbers) {
        return fmt::format("has {}, the first one {}", numbers.text(), series.numbers.text());
    }
    if (!same(place.orientation, series.orientation)) {
        return "lies in another direction than the first one";
    }
    if (!same(place.spacing, series.spacing)) {
        return "has another pixel spacing than the first one";
    }
    return {};
}

void add_frames(const DicomHeader& header, std::uint32_t file, const std::string& name,
                DicomSeries& series) {
    for (std::size_t i = 0; i < static_cast<std::size_t>(header.frames); ++i) {
        const DicomPlace place = place_of_frame(header, i);
        if (series.slices.empty()) {
            series.uid = header.series;
            series.description = header.description;
            series.modality = header.modality;
            series.numbers = header.numbers;
            series.orientation = place.orientation;
            series.spacing = place.spacing;
            series.step = step_of(place);
            series.dark_is_large = header.photometric == "MONOCHROME1";
            series.padding = header.padding;
        }
        series.has_modality_table |= header.has_modality_table;
        if (series.difference.empty()) {
            if (const std::string found = difference_of(series, header.numbers, place);
                !found.empty()) {
                series.difference =
                    fmt::format("{}{} {}", name,
                                header.frames > 1 ? fmt::format(", frame {}", i + 1) : "", found);
            }
        }
        DicomSlice slice;
        slice.file = file;
        slice.frame = static_cast<std::uint32_t>(i);
        slice.position = position_of(header, place, i);
        slice.slope = header.dose_scaling.value_or(place.slope.value_or(1));
        slice.intercept = place.intercept.value_or(0);
        slice.number = header.number;
        slice.time = place.time.value_or(0);
        slice.instance = std::hash<std::string>{}(header.instance) + i;
        series.slices.push_back(slice);
    }
}

std::string text_of(const std::vector<DicomSeries>& series) {
    std::string text;
    constexpr std::size_t kMost = 50;
    for (std::size_t i = 0; i < series.size() && i < kMost; ++i) {
        const DicomSeries& s = series[i];
        text += fmt::format("\n  {}  {} \"{}\", {} of {}", s.uid, s.modality, s.description,
                            s.slices.size(), s.numbers.text());
    }
    if (series.size() > kMost) {
        text += fmt::format("\n  and {} more", series.size() - kMost);
    }
    return text;
}

}  // namespace

DicomFolder find_dicom_series(const std::vector<std::filesystem::path>& files,
                              std::uint64_t max_heap) {
    const std::uint64_t most_bytes = std::max(max_heap, kSomeHeap);
    DicomFolder folder;
    std::map<std::string, std::size_t> known;
    std::size_t slices = 0;
    for (std::size_t i = 0; i < files.size(); ++i) {
        // A damaged file is an error: left out, it would make a series shorter without a word.
        if (!is_dicom_file(files[i]) && !was_dicom_file(files[i])) {
            ++folder.others;
            continue;
        }
        DicomFile file(files[i]);
        const DicomHeader header = read_dicom_header(file, most_bytes);
        if (header.pixels.tag == 0) {
            ++folder.others;
            continue;
        }
        slices += static_cast<std::size_t>(header.frames);
        if (slices > kMostDicomSlices) {
            throw Error(ErrorKind::limit, {files[i].string()},
                        fmt::format("there are more than {} slices", kMostDicomSlices));
        }
        if (slices * kBytesOfSlice > most_bytes) {
            throw Error(ErrorKind::limit, {files[i].string()},
                        fmt::format("what is kept of {} slices takes more than {} bytes", slices,
                                    most_bytes),
                        {{RemedyKind::more_memory}});
        }
        const auto [found, is_new] = known.try_emplace(header.series, folder.series.size());
        if (is_new) {
            folder.series.emplace_back();
        }
        add_frames(header, static_cast<std::uint32_t>(i), file.name(),
                   folder.series[found->second]);
    }
    return folder;
}

const DicomSeries& choose_series(const std::vector<DicomSeries>& series, const std::string& wanted,
                                 const std::string& name) {
    if (wanted.empty()) {
        if (series.size() == 1) {
            return series[0];
        }
        throw Error(ErrorKind::invalid_argument, {name},
                    fmt::format("there are {} series:{}", series.size(), text_of(series)),
                    {{RemedyKind::choose_series}});
    }
    const DicomSeries* found = nullptr;
    for (const DicomSeries& s : series) {
        if (s.uid == wanted) {
            return s;
        }
        if (s.uid.ends_with(wanted)) {
            if (found != nullptr) {
                throw Error(ErrorKind::invalid_argument, {name},
                            fmt::format("several series end with {}:{}", wanted, text_of(series)),
                            {{RemedyKind::choose_series}});
            }
            found = &s;
        }
    }
    if (found == nullptr) {
        throw Error(ErrorKind::not_found, {name},
                    fmt::format("there is no series {}; there are:{}", wanted, text_of(series)),
                    {{RemedyKind::choose_series}});
    }
    return *found;
}

}  // namespace isonest::detail
