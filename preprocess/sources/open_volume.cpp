#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <initializer_list>
#include <memory>
#include <utility>

#include <isonest/error.h>
#include <isonest/open_volume.h>

#include "preprocess/sources/bytes/far_objects.h"
#include "preprocess/sources/bytes/gzip_stream.h"
#include "preprocess/sources/bytes/input_file.h"
#include "preprocess/sources/bytes/natural_order.h"
#include "preprocess/sources/bytes/regular_file.h"
#include "preprocess/sources/known/known_formats.h"
#include "preprocess/sources/label_names/label_file.h"
#include "preprocess/sources/placement/placement.h"
#include "preprocess/sources/volume_format.h"
#include "preprocess/sources/wrapping/converted_source.h"
#include "preprocess/sources/wrapping/cropped_source.h"
#include "preprocess/sources/wrapping/described_source.h"
#include "preprocess/sources/wrapping/missing_source.h"
#include "preprocess/sources/wrapping/named_labels_source.h"
#include "store/base/label_bits.h"
#include "store/remote/open_location.h"

namespace isonest {
using namespace detail;
namespace {

/// A source with another spacing, origin, unit or frame than the file says. With another spacing
/// the axes are along the world's: of axes that were not, nothing says any more how a patient lies.
class Placed : public DescribedSource {
  public:
    Placed(std::unique_ptr<VolumeSource> inner, const SourceOptions& options)
        : DescribedSource(std::move(inner)),
          spacing_(options.spacing),
          origin_(options.origin),
          unit_(options.unit),
          frame_(options.frame) {}
    [[nodiscard]] VolumeDescription describe() const override {
        VolumeDescription result = inner_source().describe();
        result.spacing = spacing_.value_or(result.spacing);
        result.origin = origin_.value_or(result.origin);
        result.unit = unit_ ? unit_ : result.unit;
        if (spacing_ && result.direction != kAlongWorld) {
            result.direction = kAlongWorld;
            result.frame = AnatomicalFrame::unknown;
        }
        result.frame = frame_.value_or(result.frame);
        return result;
    }
    [[nodiscard]] std::vector<std::string> notes() const override {
        std::vector<std::string> notes = inner_source().notes();
        std::string lost =
            spacing_ ? lost_by_own_spacing(inner_source().describe().direction) : std::string();
        if (!lost.empty()) {
            notes.push_back(std::move(lost));
        }
        return notes;
    }

  private:
    std::optional<Double3> spacing_;
    std::optional<Double3> origin_;
    std::optional<LengthUnit> unit_;
    std::optional<AnatomicalFrame> frame_;
};

/// A source with what was fetched for it.
class Elsewhere : public DescribedSource {
  public:
    Elsewhere(std::unique_ptr<VolumeSource> inner, std::shared_ptr<const FarObjects> objects,
              bool is_folder)
        : DescribedSource(std::move(inner)), objects_(std::move(objects)), is_folder_(is_folder) {}
    [[nodiscard]] FetchedCounts fetched() const override {
        FetchedCounts all = objects_->fetched();
        const FetchedCounts own = inner_source().fetched();
        all.remote_bytes += own.remote_bytes;
        all.requests += own.requests;
        all.round_trips += own.round_trips;
        all.cache_bytes += own.cache_bytes;
        return all;
    }
    [[nodiscard]] std::string cache_warning() const override {
        if (is_folder_ && !objects_->remote().cache.empty()) {
            return fmt::format(
                "{}: nothing of a folder of objects is kept in the cache or taken from it",
                objects_->remote().cache.string());
        }
        const std::string warning = objects_->cache_warning();
        return warning.empty() ? inner_source().cache_warning() : warning;
    }

  private:
    std::shared_ptr<const FarObjects> objects_;
    bool is_folder_;  ///< what is read is many objects below one URL
};

/// Options that were given but mean nothing for the format are refused.
void refuse_options(const VolumeInput& input, const VolumeFormat& format, const SourceOptions& o) {
    const FormatOptions& takes = format.takes;
    const std::initializer_list<std::pair<const char*, bool>> given{
        {"dataset", !takes.dataset && !o.dataset.empty()},
        {"index", !takes.index && !o.index.empty()},
        {"series", !takes.series && !o.series.empty()},
        {"dims", !takes.numbers && o.dims.has_value()},
        {"type", !takes.numbers && o.type.has_value()},
        {"big_endian", !takes.numbers && o.big_endian.has_value()},
        {"offset", !takes.numbers && o.offset.has_value()}};
    for (const auto& [option, refused] : given) {
        if (refused) {
            throw Error(
                ErrorKind::invalid_argument, {input.name()},
                fmt::format("the option '{}' does not go with {}", option, format.about.name),
                {{RemedyKind::leave_out, option}});
        }
    }
}

/// Less where the stream is damaged: who reads it on will say so.
std::string first_unpacked(const InputFile& file) {
    std::string text(VolumeInput::kHeadBytes, '\0');
    try {
        GzipStream stream(file, file.name(), 0);
        text.resize(stream.read(reinterpret_cast<std::byte*>(text.data()), text.size()));
    } catch (const Error& error) {
        if (error.kind() != ErrorKind::corrupt) {
            throw;
        }
        text.clear();
    }
    return text;
}

void read_head(VolumeInput& input) {
    input.head = first_bytes(input.file, VolumeInput::kHeadBytes);
    input.unpacked = is_gzip(input.file) ? first_unpacked(input.file) : input.head;
}

/// What a URL names: an object, or, where there is no object of that name, what is taken for a
/// folder, of which only the names of its objects are known, not which there are.
VolumeInput look_at_url(const std::vector<std::filesystem::path>& paths,
                        const RemoteAccess& remote) {
    const std::string shown = shown_location(paths[0].native());
    if (paths.size() > 1) {
        throw Error(ErrorKind::unsupported, {shown},
                    "of what is elsewhere, one object or one Zarr folder is read, not several",
                    {{RemedyKind::download}});
    }
    VolumeInput input{
        .paths = paths, .far = true, .elsewhere = std::make_shared<FarObjects>(remote)};
    if (shown.ends_with('/') || shown.ends_with(".zarr")) {
        input.folder = true;
        return input;
    }
    try {
        input.file = {paths[0].native(), input.elsewhere};
    } catch (const Error& error) {
        if (error.kind() != ErrorKind::not_found) {
            throw;
        }
        input.folder = true;
        input.missing = std::make_shared<const Error>(error);
        return input;
    }
    read_head(input);
    return input;
}

VolumeInput look_at(const std::vector<std::filesystem::path>& paths, const RemoteAccess& remote) {
    if (paths.empty()) {
        throw Error(ErrorKind::invalid_argument, "no input is named");
    }
    if (std::any_of(paths.begin(), paths.end(),
                    [](const std::filesystem::path& path) { return is_url(path.native()); })) {
        return look_at_url(paths, remote);
    }
    VolumeInput input{.paths = paths, .file = paths[0]};
    std::error_code error;
    input.folder = paths.size() == 1 && std::filesystem::is_directory(paths[0], error);
    if (!input.folder) {
        for (const std::filesystem::path& path : paths) {
            regular_file_size(path);
        }
        read_head(input);
    }
    return input;
}

[[noreturn]] void refuse_far(const VolumeInput& input, const std::string& name) {
    throw Error(ErrorKind::unsupported, {input.name()},
                fmt::format("of what is elsewhere, {} is not read", name),
                {{RemedyKind::download}});
}

[[noreturn]] void refuse_known(const VolumeInput& input, const KnownFormat& known) {
    throw Error(ErrorKind::unsupported, {input.name()},
                fmt::format("this is {}, which is not read: {}", known.what, known.advice));
}

/// A folder that no format recognises: says what it is, or what the first file in it is that is
/// known.
[[noreturn]] void refuse_folder(const VolumeInput& input) {
    const std::filesystem::path& folder = input.path();
    if (const auto known = known_folder(folder)) {
        refuse_known(input, *known);
    }
    std::error_code error;
    if (std::filesystem::is_empty(folder, error)) {
        throw Error(ErrorKind::unsupported, {input.name()}, "the folder is empty");
    }
    constexpr std::size_t kMostLookedAt = 32;
    std::vector<std::filesystem::path> files = files_in(folder);
    files.resize(std::min(files.size(), kMostLookedAt));
    for (const std::filesystem::path& path : files) {
        VolumeInput file{.paths = {path}, .file = path};
        try {
            read_head(file);
        } catch (const Error&) {
            continue;  // not readable: no reason to say less of the others
        }
        for (const VolumeFormat& format : volume_formats()) {
            if (!format.takes.numbers && format.recognises(file)) {
                throw Error(ErrorKind::unsupported, {input.name()},
                            fmt::format("a folder with '{}', which is {}: name that file",
                                        path.filename().string(), format.about.name));
            }
        }
        if (const auto known = known_format(file)) {
            throw Error(ErrorKind::unsupported, {input.name()},
                        fmt::format("a folder with '{}', which is {} and not read: {}",
                                    path.filename().string(), known->what, known->advice));
        }
    }
    std::string names;
    for (const VolumeFormat& format : volume_formats()) {
        names += fmt::format("\n  {} {}{}", format.about.name, format.about.extensions,
                             format.open == nullptr ? " (not in this build)" : "");
    }
    throw Error(ErrorKind::unsupported, {input.path().string()},
                fmt::format("there is no volume in this folder; what is read:{}", names));
}

const VolumeFormat& format_of(const VolumeInput& input) {
    for (const VolumeFormat& format : volume_formats()) {
        // Those that are not read from URLs look at an object's first bytes, and at no folder
        // there.
        if ((format.reads_urls || !input.far || !input.folder) && format.recognises(input)) {
            if (input.far && !format.reads_urls) {
                refuse_far(input, format.about.name);
            }
            return format;
        }
    }
    if (input.missing != nullptr) {
        throw Error(*input.missing);
    }
    if (input.far) {
        throw Error(ErrorKind::not_found, {input.name()},
                    "there is no Zarr array or image in this folder, and of folders elsewhere no "
                    "others are read",
                    {{RemedyKind::download}});
    }
    refuse_folder(input);
}

/// Whether the error is one of the contents of a file that the input names (a header's data).
bool is_of_named_file(const Error& error, const VolumeInput& input) {
    const std::string& file = error.place().file;
    return error.kind() != ErrorKind::io && error.kind() != ErrorKind::limit && !file.empty() &&
           !file.starts_with(input.name()) &&
           std::none_of(
               input.paths.begin(), input.paths.end(),
               [&](const std::filesystem::path& path) { return file.starts_with(path.native()); });
}

/// Errors of a file that the input names say which input that is: its reader may not know that it
/// names one.
std::unique_ptr<VolumeSource> opened(const VolumeFormat& format, const VolumeInput& input,
                                     const SourceOptions& options) {
    try {
        return format.open(input, options);
    } catch (const Error& error) {
        if (!is_of_named_file(error, input)) {
            throw;
        }
        throw Error(error.kind(), error.place(),
                    fmt::format("{} ({} names this file)", error.problem(), input.name()),
                    error.remedies());
    }
}

}  // namespace

std::vector<InputFormat> input_formats() {
    std::vector<InputFormat> formats;
    for (const VolumeFormat& format : volume_formats()) {
        formats.push_back(format.about);
        if (format.open != nullptr) {
            formats.back().package.clear();
        }
    }
    return formats;
}

std::unique_ptr<VolumeSource> open_volume(const std::vector<std::filesystem::path>& paths,
                                          const SourceOptions& options) {
    const VolumeInput input = look_at(paths, options.remote);
    const VolumeFormat& format = format_of(input);
    if (format.takes.numbers && !(options.dims && options.type)) {
        if (const auto known = known_format(input)) {
            refuse_known(input, *known);
        }
    }
    if (format.open == nullptr) {
        throw Error(ErrorKind::unsupported, {input.name()},
                    fmt::format("this is {}, which this build does not read", format.about.name),
                    {{RemedyKind::install_package, format.about.package}});
    }
    if (paths.size() > 1 && !format.several_files) {
        throw Error(ErrorKind::invalid_argument, {input.path().string()},
                    fmt::format("one {} file is one volume, but {} were named", format.about.name,
                                paths.size()));
    }
    refuse_options(input, format, options);
    if (!options.label_names.empty() && !options.labels) {
        throw Error(ErrorKind::invalid_argument, {options.label_names.string()},
                    "a table of labels is for volumes that are opened as labels");
    }
    std::unique_ptr<VolumeSource> source = opened(format, input, options);
    if (!options.label_names.empty()) {
        source = with_label_names(std::move(source),
                                  read_label_file(options.label_names, options.max_heap),
                                  options.label_names);
    }
    if (options.labels) {
        take_for_labels(*source);
    }
    if (options.spacing || options.origin || options.unit || options.frame) {
        source = std::make_unique<Placed>(std::move(source), options);
    }
    if (input.elsewhere) {
        source = std::make_unique<Elsewhere>(std::move(source), input.elsewhere, input.folder);
    }
    source = cropped(std::move(source), options.crop, options.every);
    if (options.missing) {
        double missing = *options.missing;
        if (source->describe().labels) {
            constexpr double kMost = 9007199254740992.0;  // 2^53
            if (!(missing >= 0 && missing <= kMost) || missing != std::floor(missing)) {
                throw Error(ErrorKind::invalid_argument, {source->describe().name},
                            fmt::format("{} is no label that can be missing: they are whole "
                                        "numbers from 0 to 2^53",
                                        missing));
            }
            missing = value_of_label(static_cast<std::uint64_t>(missing));
        }
        source = with_missing(std::move(source), missing);
    }
    return source;
}

std::unique_ptr<VolumeSource> open_volume(const std::filesystem::path& path,
                                          const SourceOptions& options) {
    return open_volume(std::vector{path}, options);
}

}  // namespace isonest
