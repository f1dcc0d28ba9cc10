#include "preprocess/sources/dicom/dicom_series.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <map>

#include <isonest/error.h>

namespace isonest::detail {
namespace {

/// Tolerance for equal directions and spacings: less than a tenth of a voxel over a thousand
/// voxels.
constexpr double kMaxDifference = 1e-4;
/// Bytes for slices that are always allowed, whatever the memory budget: enough for 90,000 of them.
constexpr std::uint64_t kSomeHeap = std::uint64_t{32} << 20U;
/// A list that grows or is sorted exists twice for a moment.
constexpr std::uint64_t kBytesOfSlice = 3 * sizeof(DicomSlice);

template <class T>
std::optional<T> either(const std::optional<T>& own, const std::optional<T>& shared) {
    return own ? own : shared;
}

DicomMoment moment_of(const DicomMoment& own, const DicomMoment& shared) {
    DicomMoment result;
    for (std::size_t i = 0; i < result.size(); ++i) {
        result.at(i) = either(own.at(i), shared.at(i));
    }
    return result;
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
            either(own.intercept, all.intercept), moment_of(own.moment, all.moment),
            either(own.segment, all.segment)};
}

std::optional<double> step_of(const DicomPlace& place) {
    const std::optional<double>& step =
        place.step && *place.step != 0 ? place.step : place.thickness;
    return step && *step != 0 ? std::optional(std::fabs(*step)) : std::nullopt;
}

/// The position of a frame. Frames without their own are placed along the normal by the offsets of
/// a dose or by a step between slices.
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
        // The spacing between slices has a sign: frames may lie in front of the first one (PS3.3,
        // C.8.4.15).
        const double slices =
            static_cast<std::int64_t>(header.slice_numbers.size()) == header.frames
                ? header.slice_numbers[frame] - header.slice_numbers[0]
                : static_cast<double>(frame);
        along = std::copysign(*step, place.step.value_or(1)) * slices;
        if (header.numbers.mosaic != 1) {
            along = (header.mosaic_backward ? -*step : *step) * slices;
        }
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
    return most <= kMaxDifference;
}

bool same(const std::optional<std::array<double, 2>>& a,
          const std::optional<std::array<double, 2>>& b) {
    if (!a || !b) {
        return a.has_value() == b.has_value();
    }
    return std::fabs((*a)[0] - (*b)[0]) <= kMaxDifference * (*a)[0] &&
           std::fabs((*a)[1] - (*b)[1]) <= kMaxDifference * (*a)[1];
}

/// How `b` differs from `a`, which is called `name`; empty if they are alike.
std::string difference_of(const DicomGroup& a, const DicomGroup& b, const std::string& name) {
    if (b.numbers != a.numbers) {
        return fmt::format("has {}, but {} has {}", b.numbers.text(), name, a.numbers.text());
    }
    if (!same(b.orientation, a.orientation)) {
        return fmt::format("has another orientation than {}", name);
    }
    if (!same(b.spacing, a.spacing)) {
        return fmt::format("has another pixel spacing than {}", name);
    }
    if ((b.segmentation == nullptr) != (a.segmentation == nullptr)) {
        return fmt::format("is {} segmentation", b.segmentation == nullptr ? "not a" : "a");
    }
    if (b.localizer != a.localizer) {
        return fmt::format("is {} localizer, but {} is {}", b.localizer ? "a" : "not a", name,
                           a.localizer ? "one" : "not");
    }
    return {};
}

/// The group of the series for such an image; null if there would be too many groups.
DicomGroup* group_of(const DicomGroup& image, DicomSeries& series) {
    constexpr std::size_t kMaxGroups = 100;
    for (DicomGroup& group : series.groups) {
        if (difference_of(group, image, "").empty()) {
            return &group;
        }
    }
    return series.groups.size() < kMaxGroups ? &series.groups.emplace_back(image) : nullptr;
}

void refuse_file(DicomRefused& refused, const Error& error) {
    ++refused.files;
    if (refused.first == nullptr) {
        refused.first = std::make_shared<const Error>(error);
    }
}

void add_frames(const DicomHeader& header, std::uint32_t file, const std::string& name,
                DicomSeries& series) {
    const auto segmentation = header.segmentation.kind == DicomSegmentation::Kind::none
                                  ? nullptr
                                  : std::make_shared<const DicomSegmentation>(header.segmentation);
    for (std::size_t i = 0; i < static_cast<std::size_t>(header.frames); ++i) {
        const DicomPlace place = place_of_frame(header, i);
        DicomGroup image;
        image.numbers = header.numbers;
        image.orientation = place.orientation;
        image.spacing = place.spacing;
        image.step = step_of(place);
        image.between =
            place.step && *place.step != 0 ? std::optional(std::fabs(*place.step)) : std::nullopt;
        image.segmentation = segmentation;
        image.localizer = header.localizer;
        image.dark_is_large = header.photometric == "MONOCHROME1";
        image.table_type = header.table.type;
        image.padding = header.padding;
        DicomGroup* const group = group_of(image, series);
        if (group == nullptr) {
            refuse_file(series.damaged,
                        Error(ErrorKind::unsupported, {name},
                              fmt::format("the images of the series {} have more than {} "
                                          "orientations; give only the files that belong together",
                                          series.uid, series.groups.size())));
            return;
        }
        DicomSlice slice;
        slice.file = file;
        slice.frame = static_cast<std::uint32_t>(i);
        slice.position = position_of(header, place, i);
        if (header.table.values.empty()) {
            slice.slope = header.dose_scaling.value_or(place.slope.value_or(1));
            slice.intercept = place.intercept.value_or(0);
        }
        slice.number = header.number;
        slice.segment = static_cast<std::uint16_t>(place.segment.value_or(0));
        std::transform(place.moment.begin(), place.moment.end(), slice.moment.begin(),
                       [](const auto& part) { return part.value_or(-HUGE_VAL); });
        slice.instance =
            header.instance.empty() ? 0 : std::hash<std::string>{}(header.instance) + i;
        group->slices.push_back(slice);
    }
}

/// "6 of 512 x 512 of 16 bits", and what of the series is not read.
std::string text_of(const DicomSeries& s) {
    std::string text = fmt::format("{}  {} \"{}\"", s.uid, s.modality, s.description);
    for (const DicomGroup& group : s.groups) {
        text += fmt::format(", {} of {}", group.slices.size(), group.numbers.text());
    }
    for (const DicomRefused* refused : {&s.unsupported, &s.damaged}) {
        if (refused->files > 0) {
            text += fmt::format(", {} not read ({})", refused->files, refused->first->what());
        }
    }
    return text;
}

std::string text_of(const std::vector<DicomSeries>& series) {
    std::string text;
    constexpr std::size_t kMax = 50;
    for (std::size_t i = 0; i < series.size() && i < kMax; ++i) {
        text += "\n  " + text_of(series[i]);
    }
    if (series.size() > kMax) {
        text += fmt::format("\n  and {} more", series.size() - kMax);
    }
    return text;
}

/// The groups of a series, as the user can choose them.
std::string text_of_groups(const DicomSeries& series,
                           const std::vector<std::filesystem::path>& files) {
    constexpr std::size_t kMax = 20;
    const auto& groups = series.groups;
    std::string text;
    for (std::size_t i = 0; i < groups.size() && i < kMax; ++i) {
        const DicomGroup& group = groups[i];
        text += fmt::format("\n  stack={}: {} of {}", i, group.slices.size(), group.numbers.text());
        if (i > 0) {
            text += fmt::format("; {}{} {}", files[group.slices[0].file].string(),
                                group.slices[0].frame > 0
                                    ? fmt::format(", frame {}", group.slices[0].frame + 1)
                                    : "",
                                difference_of(groups[0], group, "stack 0"));
        }
    }
    if (groups.size() > kMax) {
        text += fmt::format("\n  and {} more", groups.size() - kMax);
    }
    return text;
}

/// "1 file is left out", "3 files are left out"
std::string left_out(std::int64_t count, const char* what) {
    return fmt::format("{} {}{} left out", count, what, count == 1 ? " is" : "s are");
}

/// The entry of a series in the folder; added if it is new.
DicomSeries& series_of(const DicomHeader& header, DicomFolder& folder,
                       std::map<std::string, std::size_t>& known) {
    const auto [found, is_new] = known.try_emplace(header.series, folder.series.size());
    if (is_new) {
        DicomSeries& series = folder.series.emplace_back();
        series.uid = header.series;
        series.description = header.description;
        series.modality = header.modality;
    }
    return folder.series[found->second];
}

/// Reads a header. If the file cannot be read but its series is known, records the error there and
/// returns false.
bool read_member(const std::filesystem::path& path, std::uint64_t max_bytes, DicomFolder& folder,
                 std::map<std::string, std::size_t>& known, DicomHeader& header) {
    try {
        DicomFile file(path);
        read_dicom_header(file, max_bytes, header);
        return true;
    } catch (const Error& error) {
        const bool unsupported = error.kind() == ErrorKind::unsupported;
        if (header.series.empty() || (error.kind() != ErrorKind::corrupt && !unsupported)) {
            throw;
        }
        DicomSeries& series = series_of(header, folder, known);
        refuse_file(unsupported ? series.unsupported : series.damaged, error);
        return false;
    }
}

}  // namespace

DicomFolder find_dicom_series(const std::vector<std::filesystem::path>& files,
                              std::uint64_t max_heap) {
    const std::uint64_t max_bytes = std::max(max_heap, kSomeHeap);
    DicomFolder folder;
    std::map<std::string, std::size_t> known;
    std::size_t slices = 0;
    for (std::size_t i = 0; i < files.size(); ++i) {
        // A damaged file is an error: ignoring it would silently shorten a series.
        if (!is_dicom_file(files[i]) && !was_dicom_file(files[i])) {
            ++folder.others;
            continue;
        }
        DicomHeader header;
        if (!read_member(files[i], max_bytes, folder, known, header)) {
            continue;
        }
        if (header.pixels.tag == 0) {
            ++folder.others;
            continue;
        }
        slices += static_cast<std::size_t>(header.frames);
        if (slices > kMaxDicomSlices) {
            throw Error(
                ErrorKind::limit, {files[i].string()},
                fmt::format("there are more than {} slices, which is the limit", kMaxDicomSlices));
        }
        if (slices * kBytesOfSlice > max_bytes) {
            throw Error(
                ErrorKind::limit, {files[i].string()},
                fmt::format("the headers of {} slices need more than {} bytes", slices, max_bytes),
                {{RemedyKind::more_memory}});
        }
        add_frames(header, static_cast<std::uint32_t>(i), files[i].string(),
                   series_of(header, folder, known));
    }
    for (DicomSeries& series : folder.series) {
        std::stable_sort(series.groups.begin(), series.groups.end(),
                         [](const DicomGroup& a, const DicomGroup& b) {
                             return a.slices.size() > b.slices.size();
                         });
    }
    return folder;
}

DicomSeries& choose_series(std::vector<DicomSeries>& series, const std::string& wanted,
                           const std::string& name) {
    DicomSeries* found = nullptr;
    if (wanted.empty()) {
        std::size_t candidates = 0;
        for (DicomSeries& s : series) {
            if (series.size() == 1 || !s.groups.empty() || s.damaged.files > 0) {
                ++candidates;
                found = &s;
            }
        }
        if (candidates == 1) {
            return *found;
        }
        throw Error(ErrorKind::invalid_argument, {name},
                    fmt::format("the input has {} series:{}", series.size(), text_of(series)),
                    {{RemedyKind::choose_series}});
    }
    for (DicomSeries& s : series) {
        if (s.uid == wanted) {
            return s;
        }
        if (s.uid.ends_with(wanted)) {
            if (found != nullptr) {
                throw Error(
                    ErrorKind::invalid_argument, {name},
                    fmt::format("several series UIDs end with {}:{}", wanted, text_of(series)),
                    {{RemedyKind::choose_series}});
            }
            found = &s;
        }
    }
    if (found == nullptr) {
        throw Error(ErrorKind::not_found, {name},
                    fmt::format("there is no series {}; the input has:{}", wanted, text_of(series)),
                    {{RemedyKind::choose_series}});
    }
    return *found;
}

void drop_copies(DicomSeries& series, const std::vector<std::filesystem::path>& files) {
    struct Member {
        std::uint64_t instance;
        std::uint32_t file;
    };
    std::vector<Member> members;
    for (const DicomGroup& group : series.groups) {
        for (const DicomSlice& slice : group.slices) {
            if (slice.frame == 0 && slice.instance != 0) {
                members.push_back({slice.instance, slice.file});
            }
        }
    }
    std::stable_sort(members.begin(), members.end(), [](const Member& a, const Member& b) {
        return std::make_pair(a.instance, a.file) < std::make_pair(b.instance, b.file);
    });
    std::vector<std::uint32_t> copies;
    for (std::size_t i = 1; i < members.size(); ++i) {
        if (members[i].instance != members[i - 1].instance) {
            continue;
        }
        const std::filesystem::path& kept = files[members[i - 1].file];
        const std::filesystem::path& other = files[members[i].file];
        if (!same_dicom_object(kept, other)) {
            throw Error(ErrorKind::unsupported, {other.string()},
                        fmt::format("it has the same SOP instance UID as {}, but different "
                                    "contents; leave one of them out",
                                    kept.string()));
        }
        copies.push_back(members[i].file);
    }
    if (copies.empty()) {
        return;
    }
    std::sort(copies.begin(), copies.end());
    for (DicomGroup& group : series.groups) {
        std::erase_if(group.slices, [&](const DicomSlice& slice) {
            return std::binary_search(copies.begin(), copies.end(), slice.file);
        });
    }
    series.copies = static_cast<std::int64_t>(copies.size());
    series.first_copy = files[copies[0]].string();
}

const DicomGroup& choose_group(const DicomSeries& series, std::optional<std::int64_t> stack,
                               const std::vector<std::filesystem::path>& files,
                               const std::string& name) {
    const auto count = static_cast<std::int64_t>(series.groups.size());
    // A damaged file may be any of the slices.
    if (series.damaged.files > 0) {
        throw Error(*series.damaged.first);
    }
    if (count == 0 || (series.unsupported.files > 0 && !stack)) {
        std::vector<Remedy> remedies = series.unsupported.first->remedies();
        if (count > 0) {
            remedies.push_back({RemedyKind::choose_index, "stack=0"});
        }
        throw Error(
            ErrorKind::unsupported, series.unsupported.first->place(),
            series.unsupported.first->problem() +
                (count > 0 ? "; the other images of the series are:" + text_of_groups(series, files)
                           : ""),
            remedies);
    }
    if (count > 1 && !stack) {
        throw Error(ErrorKind::unsupported, {name},
                    fmt::format("the images of the series form {} stacks, not one volume:{}", count,
                                text_of_groups(series, files)),
                    {{RemedyKind::choose_index, "stack=0"}});
    }
    const std::int64_t at = stack.value_or(0) < 0 ? *stack + count : stack.value_or(0);
    if (at < 0 || at >= count) {
        throw Error(ErrorKind::invalid_argument, {name},
                    fmt::format("there is no stack {}; the series has:{}", *stack,
                                text_of_groups(series, files)),
                    {{RemedyKind::choose_index, "stack=0"}});
    }
    return series.groups[static_cast<std::size_t>(at)];
}

std::vector<std::string> notes_of_left_out(const DicomFolder& folder, const DicomSeries& series,
                                           const DicomGroup& chosen,
                                           const std::vector<std::filesystem::path>& files) {
    std::vector<std::string> notes;
    if (folder.others > 0) {
        notes.push_back(left_out(folder.others, "file") + ": no DICOM images");
    }
    if (series.copies > 0) {
        notes.push_back(fmt::format("{}: exact copies of other files, such as {}",
                                    left_out(series.copies, "file"), series.first_copy));
    }
    if (series.unsupported.files > 0) {
        notes.push_back(left_out(series.unsupported.files, "file") + ": " +
                        series.unsupported.first->what());
    }
    for (const DicomGroup& group : series.groups) {
        if (&group != &chosen) {
            notes.push_back(fmt::format(
                "{}: {} {}", left_out(static_cast<std::int64_t>(group.slices.size()), "image"),
                files[group.slices[0].file].string(),
                difference_of(chosen, group, "the chosen stack")));
        }
    }
    constexpr std::size_t kMax = 5;
    for (std::size_t i = 0, listed = 0; i < folder.series.size(); ++i) {
        if (&folder.series[i] == &series) {
            continue;
        }
        if (++listed > kMax) {
            notes.push_back(
                fmt::format("{} more series are left out", folder.series.size() - 1 - kMax));
            break;
        }
        notes.push_back("another series is left out: " + text_of(folder.series[i]));
    }
    return notes;
}

}  // namespace isonest::detail
