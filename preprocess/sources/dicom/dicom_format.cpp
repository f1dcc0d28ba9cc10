#include <fmt/format.h>

#include <algorithm>
#include <cstring>
#include <iterator>
#include <memory>
#include <set>
#include <string_view>
#include <utility>

#include <isonest/error.h>

#include "preprocess/sources/bytes/header_words.h"
#include "preprocess/sources/bytes/input_file.h"
#include "preprocess/sources/dicom/dicom_frames.h"
#include "preprocess/sources/dicom/dicom_segments.h"
#include "preprocess/sources/dicom/dicom_series.h"
#include "preprocess/sources/dicom/dicom_stack.h"
#include "preprocess/sources/placement/axis_choice.h"
#include "preprocess/sources/placement/placement.h"
#include "preprocess/sources/volume_format.h"
#include "preprocess/sources/wrapping/cropped_source.h"
#include "preprocess/sources/wrapping/scaled_source.h"

namespace isonest::detail {
namespace {

constexpr std::string_view kDirectoryClass = "1.2.840.10008.1.3.10";

/// What all slices of a volume have in common.
struct SliceVolume {
    DicomNumbers numbers;
    std::vector<DicomSlice> slices;
    Placement place;
    AnatomicalFrame frame = AnatomicalFrame::unknown;
    std::string name;
    std::vector<std::string> notes;
    std::optional<LengthUnit> unit;
};

/// The type of values if each slice has its own scaling.
ValueType own_scaled_type(ValueType stored) {
    return size_of(stored) <= 2 || stored == ValueType::f32 ? ValueType::f32 : ValueType::f64;
}

/// Stored numbers; floating point values if each slice has its own scaling.
class DicomSource : public VolumeSource {
  public:
    DicomSource(std::vector<std::filesystem::path> files, SliceVolume volume, bool own_scalings)
        : frames_(std::move(files), volume.numbers),
          volume_(std::move(volume)),
          own_scalings_(own_scalings) {}
    [[nodiscard]] VolumeDescription describe() const override {
        const DicomNumbers& n = volume_.numbers;
        return {{n.columns, n.rows, static_cast<std::int64_t>(volume_.slices.size())},
                own_scalings_ ? own_scaled_type(n.value_type()) : n.value_type(),
                volume_.place.spacing,
                volume_.place.origin,
                volume_.name,
                volume_.place.direction,
                false,
                volume_.unit,
                volume_.frame};
    }
    [[nodiscard]] std::vector<std::filesystem::path> files() const override {
        return frames_.files();
    }
    [[nodiscard]] std::string identity() const override {
        std::uint64_t order = 0;
        for (const DicomSlice& s : volume_.slices) {
            order = order * 1000003 + s.file * 31 + s.frame;
        }
        return fmt::format("{}slices {} in order {:x}\n", identity_of(files()),
                           volume_.slices.size(), order);
    }
    [[nodiscard]] Granularity granularity() const override { return {1, volume_.numbers.rows}; }
    [[nodiscard]] std::uint64_t heap() const override {
        return (1U << 20U) + frames_.heap() + volume_.slices.size() * sizeof(DicomSlice);
    }
    [[nodiscard]] std::vector<std::string> notes() const override { return volume_.notes; }
    void read(std::int64_t z0, std::int64_t nz, std::int64_t y0, std::int64_t ny,
              std::byte* dst) override {
        const auto count = static_cast<std::size_t>(ny * volume_.numbers.columns);
        const std::size_t size = size_of(describe().type);
        for (std::int64_t z = z0; z < z0 + nz; ++z, dst += count * size) {
            const DicomSlice& slice = volume_.slices[static_cast<std::size_t>(z)];
            // Stored numbers are read into the end of the space for the values, which are at least
            // as large.
            const std::size_t stored = size_of(volume_.numbers.value_type());
            std::byte* const from = dst + count * (size - stored);
            frames_.read(slice.file, slice.frame, y0, ny, from);
            if (own_scalings_) {
                scale(slice, from, count, dst);
            }
        }
    }

  private:
    void scale(const DicomSlice& slice, const std::byte* from, std::size_t count,
               std::byte* dst) const {
        dispatch(volume_.numbers.value_type(), [&](auto tag) {
            using T = typename decltype(tag)::type;
            if (own_scaled_type(volume_.numbers.value_type()) == ValueType::f32) {
                scale_to<T, float>(slice, from, count, dst);
            } else {
                scale_to<T, double>(slice, from, count, dst);
            }
        });
    }
    template <class From, class To>
    static void scale_to(const DicomSlice& slice, const std::byte* from, std::size_t count,
                         std::byte* dst) {
        for (std::size_t i = 0; i < count; ++i) {
            From in{};
            std::memcpy(&in, from + i * sizeof(From), sizeof(From));
            const auto out =
                static_cast<To>(slice.slope * static_cast<double>(in) + slice.intercept);
            std::memcpy(dst + i * sizeof(To), &out, sizeof(To));
        }
    }

    DicomFrames frames_;
    SliceVolume volume_;
    bool own_scalings_;
};

/// Calls goes_on(path) for each file in or below the folder, except hidden ones, until it returns
/// false.
template <class F>
std::error_code for_files_below(const std::filesystem::path& folder, const F& goes_on) {
    std::error_code error;
    std::filesystem::recursive_directory_iterator it(folder, error);
    for (; !error && it != std::filesystem::recursive_directory_iterator(); it.increment(error)) {
        if (it->path().filename().string().starts_with('.')) {
            it.disable_recursion_pending();
        } else if (is_file_of_folder(*it) && !goes_on(it->path())) {
            break;
        }
    }
    return error;
}

std::vector<std::filesystem::path> files_below(const std::filesystem::path& folder) {
    std::vector<std::filesystem::path> files;
    const std::error_code error = for_files_below(folder, [&](const std::filesystem::path& file) {
        if (files.size() >= kMaxFolderFiles) {
            throw Error(ErrorKind::unsupported, {folder.string()},
                        fmt::format("the folder has more than {} files, which is the limit",
                                    kMaxFolderFiles));
        }
        files.push_back(file);
        return true;
    });
    if (error) {
        throw Error(ErrorKind::io, {folder.string()}, error.message());
    }
    std::sort(files.begin(), files.end(),
              [](const auto& a, const auto& b) { return naturally_less(a.string(), b.string()); });
    return files;
}

/// The files to examine.
std::vector<std::filesystem::path> files_of(const VolumeInput& input) {
    if (input.folder) {
        return files_below(input.path());
    }
    // A DICOMDIR lists the files below its folder.
    if (input.paths.size() == 1 && DicomFile(input.path()).class_uid() == kDirectoryClass) {
        const std::filesystem::path folder = input.path().parent_path();
        return files_below(folder.empty() ? "." : folder);
    }
    std::vector<std::filesystem::path> files = input.paths;
    std::stable_sort(files.begin(), files.end(), [](const auto& a, const auto& b) {
        return naturally_less(a.string(), b.string());
    });
    return files;
}

/// The slices of the stack that the caller wants: all slices of one time.
std::vector<DicomSlice> chosen_slices(const DicomStack& stack, const DicomNumbers& numbers,
                                      const std::vector<AxisIndex>& index,
                                      const std::string& name) {
    std::vector<ArrayAxis> axes;
    if (stack.times > 1) {
        axes.push_back({"t", stack.times, false});
    }
    const std::size_t z = axes.size();
    axes.push_back({"z", stack.count});
    axes.push_back({"y", numbers.rows});
    axes.push_back({"x", numbers.columns});
    const ChosenAxes chosen = [&] {
        try {
            return choose_axes(axes, index, name);
        } catch (const Error& error) {
            if (stack.times_are.empty()) {
                throw;
            }
            throw Error(error.kind(), error.place(),
                        fmt::format("{}; t is {}", error.problem(), stack.times_are),
                        error.remedies());
        }
    }();
    const bool takes_times =
        z == 1 && std::any_of(chosen.axis.begin(), chosen.axis.end(),
                              [](const std::optional<std::size_t>& a) { return a == 0; });
    if (takes_times || chosen.nodes.x != numbers.columns || chosen.nodes.y != numbers.rows ||
        chosen.nodes.z != stack.count) {
        throw Error(
            ErrorKind::unsupported, {name},
            "an index can only choose a time; to read a part of the slices, crop the volume",
            {z == 1 ? Remedy{RemedyKind::choose_index, "t=0"}
                    : Remedy{RemedyKind::leave_out, "index"}});
    }
    const std::int64_t time = z == 1 ? chosen.at[0] : 0;
    const auto from = stack.slices.begin() + static_cast<std::ptrdiff_t>(time * stack.count);
    return {from, from + static_cast<std::ptrdiff_t>(stack.count)};
}

std::vector<std::string> notes_of(const DicomGroup& series, const DicomStack& stack) {
    std::vector<std::string> notes = stack.notes;
    if (stack.times > 1) {
        notes.push_back(fmt::format("this is one of {} volumes along the axis t: {}", stack.times,
                                    stack.times_are));
    }
    if (series.dark_is_large) {
        notes.emplace_back("larger values are displayed darker (MONOCHROME1)");
    }
    if (series.numbers.table_bits != 0) {
        notes.push_back(
            fmt::format("values are taken from the file's lookup table (Modality LUT){}{}",
                        series.table_type.empty() ? "" : " of type ", series.table_type));
    }
    if (series.padding) {
        notes.push_back(
            fmt::format("the stored number {} is padding outside the image; it is kept as a value",
                        *series.padding));
    }
    return notes;
}

/// A slope of 0 would map all stored numbers to one value.
void check_slopes(const std::vector<DicomSlice>& slices,
                  const std::vector<std::filesystem::path>& files) {
    for (const DicomSlice& slice : slices) {
        if (slice.slope == 0) {
            throw Error(
                ErrorKind::corrupt,
                {files[slice.file].string(), fmt::format("frame {}, RescaleSlope", slice.frame)},
                "the slope is 0");
        }
    }
}

/// Throws Error{invalid_argument} if `own` has a single slice and the folder contains other slices
/// of the same stack. Images without positions (projections) and single files are volumes of one
/// slice.
void require_no_other_slices(const std::filesystem::path& file, const DicomGroup& own,
                             std::uint64_t max_heap) {
    constexpr std::size_t kMaxLookedAt = 10000;
    if (own.slices.size() != 1 || !own.slices[0].position) {
        return;
    }
    const std::filesystem::path folder = file.parent_path().empty() ? "." : file.parent_path();
    std::vector<std::filesystem::path> files{file};
    DicomFolder found;
    try {
        for (std::filesystem::path& other : files_in(folder)) {
            if (files.size() < kMaxLookedAt && other.filename() != file.filename()) {
                files.push_back(std::move(other));
            }
        }
        found = find_dicom_series(files, max_heap);
    } catch (const Error&) {
        return;  // the others are unknown
    }
    for (const DicomSeries& series : found.series) {
        for (const DicomGroup& group : series.groups) {
            if (std::none_of(group.slices.begin(), group.slices.end(),
                             [](const DicomSlice& s) { return s.file == 0; })) {
                continue;  // `file` is in another one
            }
            std::set<Double3> places;
            for (const DicomSlice& slice : group.slices) {
                if (slice.position) {
                    places.insert(*slice.position);
                }
            }
            if (places.size() > 1) {
                throw Error(ErrorKind::invalid_argument, {file.string()},
                            fmt::format("the file is one slice of {}; give the folder, {}, and "
                                        "crop it to get one slice",
                                        places.size(), folder.string()));
            }
        }
    }
}

std::unique_ptr<VolumeSource> open_dicom(const VolumeInput& input, const SourceOptions& options) {
    const std::string name =
        input.paths.size() == 1
            ? input.path().string()
            : fmt::format("{} and {} more", input.path().string(), input.paths.size() - 1);
    const std::vector<std::filesystem::path> files = files_of(input);
    std::vector<AxisIndex> index = options.index;
    const std::optional<std::int64_t> chosen_stack = taken_entry(index, "stack", name);
    DicomFolder folder = find_dicom_series(files, options.max_heap);
    if (folder.series.empty()) {
        throw Error(ErrorKind::unsupported, {name}, "it contains no DICOM images");
    }
    DicomSeries& whole_series = choose_series(folder.series, options.series, name);
    drop_copies(whole_series, files);
    const DicomGroup& series = choose_group(whole_series, chosen_stack, files, name);
    if (series.segmentation) {
        return open_dicom_segments(series, files, options, std::move(index),
                                   notes_of_left_out(folder, whole_series, series, files), name);
    }
    if (!input.folder && input.paths.size() == 1 && files.size() == 1) {
        require_no_other_slices(files[0], series, options.max_heap);
    }
    const DicomStack stack = stack_slices(series, files, options.spacing.has_value(), name);
    SliceVolume volume;
    volume.numbers = series.numbers;
    volume.slices = chosen_slices(stack, series.numbers, index, name);
    volume.name = name;
    volume.notes = notes_of(series, stack);
    for (std::string& note : notes_of_left_out(folder, whole_series, series, files)) {
        volume.notes.push_back(std::move(note));
    }
    if (series.spacing) {
        volume.unit = LengthUnit::millimetre;
    }
    PlacedStack placed = place_stack({series.numbers.columns, series.numbers.rows, stack.count},
                                     stack, options.spacing.has_value(), name);
    volume.place = placed.place;
    volume.frame = placed.frame;
    std::move(placed.notes.begin(), placed.notes.end(), std::back_inserter(volume.notes));
    const std::array<bool, 3> backward = volume.place.backward;
    // Keep only the files of the volume.
    std::vector<std::filesystem::path> used;
    std::vector<std::uint32_t> number(files.size(), ~std::uint32_t{0});
    for (DicomSlice& slice : volume.slices) {
        std::uint32_t& n = number[slice.file];
        if (n == ~std::uint32_t{0}) {
            n = static_cast<std::uint32_t>(used.size());
            used.push_back(files[slice.file]);
        }
        slice.file = n;
    }
    Scaling scaling;
    scaling.slope = volume.slices[0].slope;
    scaling.intercept = volume.slices[0].intercept;
    if (!series.numbers.floating && series.numbers.table_bits == 0) {
        const int bits = series.numbers.stored;
        scaling.stored =
            series.numbers.is_signed
                ? std::pair{-(std::int64_t{1} << (bits - 1)), (std::int64_t{1} << (bits - 1)) - 1}
                : std::pair{std::int64_t{0}, (std::int64_t{1} << bits) - 1};
    }
    const bool own_scalings =
        std::any_of(volume.slices.begin(), volume.slices.end(), [&](const DicomSlice& s) {
            return s.slope != scaling.slope || s.intercept != scaling.intercept;
        });
    if (own_scalings) {
        check_slopes(volume.slices, used);
        volume.notes.emplace_back("each slice has its own scaling, which is applied");
    }
    auto source = std::make_unique<DicomSource>(std::move(used), std::move(volume), own_scalings);
    if (source->heap() > options.max_heap) {
        throw Error(ErrorKind::limit, {name},
                    fmt::format("reading a slice of {} needs {} bytes", series.numbers.text(),
                                source->heap()),
                    {{RemedyKind::more_memory}});
    }
    std::unique_ptr<VolumeSource> result = std::move(source);
    if (!own_scalings) {
        result = scaled(std::move(result), scaling);
    }
    result = mirrored(std::move(result), backward);
    if (stack.offsets.empty()) {
        return result;
    }
    auto axes = std::make_shared<UnevenAxes>();
    axes->offsets[2] = stack.offsets;
    if (backward[2]) {
        std::vector<double>& offsets = axes->offsets[2];
        const double last = offsets.back();
        std::reverse(offsets.begin(), offsets.end());
        for (double& offset : offsets) {
            offset = last - offset;
        }
    }
    return with_uneven_axes(std::move(result), UnevenAxesPtr(std::move(axes)));
}

/// Whether any of the first files in or below the folder is DICOM.
bool has_dicom(const std::filesystem::path& folder) {
    constexpr int kMaxLookedAt = 200;
    int looked_at = 0;
    bool found = false;
    // A folder that cannot be searched has none.
    static_cast<void>(for_files_below(folder, [&](const std::filesystem::path& file) {
        found = is_dicom_file(file);
        return !found && ++looked_at < kMaxLookedAt;
    }));
    return found;
}

bool is_dicom(const VolumeInput& input) {
    return input.folder ? has_dicom(input.path()) : starts_as_dicom(input.head);
}

}  // namespace

VolumeFormat dicom_format() {
    return {.about = {dicom_codec_is_built() ? "DICOM" : "DICOM (without JPEG)",
                      ".dcm, a folder or a list of them", ""},
            .takes = {.index = true, .series = true},
            .several_files = true,
            .recognises = is_dicom,
            .open = open_dicom};
}

}  // namespace isonest::detail
