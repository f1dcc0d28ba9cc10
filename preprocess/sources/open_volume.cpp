#include <fcntl.h>
#include <fmt/format.h>
#include <sys/types.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <initializer_list>
#include <memory>
#include <optional>
#include <utility>
#include <vector>

#include <isonest/error.h>
#include <isonest/open_volume.h>

#include "preprocess/sources/bytes/header_words.h"
#include "preprocess/sources/bytes/input_file.h"
#include "preprocess/sources/bytes/remote_objects.h"
#include "preprocess/sources/bytes/stream_bytes.h"
#include "preprocess/sources/known_formats.h"
#include "preprocess/sources/placement/placement.h"
#include "preprocess/sources/volume_format.h"
#include "preprocess/sources/wrapping/cropped_source.h"
#include "preprocess/sources/wrapping/label_names.h"
#include "preprocess/sources/wrapping/repeated_source.h"
#include "preprocess/sources/wrapping/scaled_source.h"
#include "preprocess/sources/wrapping/wrapped_source.h"
#include "store/base/label_text.h"
#include "store/container/format.h"
#include "store/files/scratch_file.h"
#include "store/remote/open_location.h"

namespace isonest {
using namespace detail;
namespace {

/// A source whose spacing, origin, unit or frame replaces that of the file. With a new spacing the
/// axes are along the world's; if they were not before, the patient's orientation is lost.
class Placed : public DescribedSource {
  public:
    Placed(std::unique_ptr<VolumeSource> inner, const SourceOptions& options)
        : DescribedSource(std::move(inner)),
          spacing_(options.spacing),
          origin_(options.origin),
          unit_(options.unit),
          frame_(options.frame) {
        if (origin_ && !spacing_) {
            require_not_curved(inner_source().describe(), "an origin");
        }
    }
    [[nodiscard]] VolumeDescription describe() const override {
        VolumeDescription result = inner_source().describe();
        result.spacing = spacing_.value_or(result.spacing);
        result.uneven = spacing_ ? nullptr : result.uneven;
        result.curved = spacing_ ? nullptr : result.curved;
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

/// A source with the counts of what was fetched for it.
class Elsewhere : public DescribedSource {
  public:
    Elsewhere(std::unique_ptr<VolumeSource> inner, std::shared_ptr<const RemoteObjects> objects,
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
            return fmt::format("{}: the cache is not used for a folder of objects",
                               objects_->remote().cache.string());
        }
        const std::string warning = objects_->cache_warning();
        return warning.empty() ? inner_source().cache_warning() : warning;
    }

  private:
    std::shared_ptr<const RemoteObjects> objects_;
    bool is_folder_;  ///< many objects below one URL are read
};

/// Refuses options that were given but do not apply to the format.
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
                fmt::format("the option '{}' does not apply to {}", option, format.about.name),
                {{RemedyKind::leave_out, option}});
        }
    }
}

/// Returns less if the stream is damaged: reading further will report that.
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

/// What a URL refers to: an object or, if there is no object of that name, a folder. The objects in
/// a folder can be requested by name, but not listed.
VolumeInput look_at_url(const std::vector<std::filesystem::path>& paths,
                        const RemoteAccess& remote) {
    const std::string shown = shown_location(paths[0].native());
    if (paths.size() > 1) {
        throw Error(
            ErrorKind::unsupported, {shown},
            "several inputs are given, but only one object or Zarr folder can be read from a URL",
            {{RemedyKind::download}});
    }
    VolumeInput input{
        .paths = paths, .remote = true, .elsewhere = std::make_shared<RemoteObjects>(remote)};
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
        throw Error(ErrorKind::invalid_argument, "no input given");
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

[[noreturn]] void refuse_remote(const VolumeInput& input, const std::string& name) {
    throw Error(ErrorKind::unsupported, {input.name()},
                fmt::format("{} cannot be read from a URL", name), {{RemedyKind::download}});
}

[[noreturn]] void refuse_known(const VolumeInput& input, const KnownFormat& known) {
    throw Error(ErrorKind::unsupported, {input.name()},
                fmt::format("this is {}, which is not supported: {}", known.what, known.advice));
}

/// Refuses a folder that no format recognises: names what it is, or what the first known file in it
/// is.
[[noreturn]] void refuse_folder(const VolumeInput& input) {
    const std::filesystem::path& folder = input.path();
    if (const auto known = known_folder(folder)) {
        refuse_known(input, *known);
    }
    std::error_code error;
    if (std::filesystem::is_empty(folder, error)) {
        throw Error(ErrorKind::unsupported, {input.name()}, "the folder is empty");
    }
    constexpr std::size_t kMaxLookedAt = 32;
    std::vector<std::filesystem::path> files = files_in(folder);
    files.resize(std::min(files.size(), kMaxLookedAt));
    for (const std::filesystem::path& path : files) {
        VolumeInput file{.paths = {path}, .file = path};
        try {
            read_head(file);
        } catch (const Error&) {
            continue;  // not readable: try the others
        }
        for (const VolumeFormat& format : volume_formats()) {
            if (!format.takes.numbers && format.recognises(file)) {
                throw Error(ErrorKind::unsupported, {input.name()},
                            fmt::format("the folder holds '{}', which is {}: give that file",
                                        path.filename().string(), format.about.name));
            }
        }
        if (const auto known = known_format(file)) {
            throw Error(ErrorKind::unsupported, {input.name()},
                        fmt::format("the folder holds '{}', which is {} and not supported: {}",
                                    path.filename().string(), known->what, known->advice));
        }
    }
    std::string names;
    for (const VolumeFormat& format : volume_formats()) {
        names += fmt::format("\n  {} {}{}", format.about.name, format.about.extensions,
                             format.open == nullptr ? " (not in this build)" : "");
    }
    throw Error(
        ErrorKind::unsupported, {input.path().string()},
        fmt::format("there is no volume in this folder; the supported formats are:{}", names));
}

const VolumeFormat& format_of(const VolumeInput& input) {
    for (const VolumeFormat& format : volume_formats()) {
        // Formats that do not support URLs only check an object's first bytes, not remote folders.
        if ((format.reads_urls || !input.remote || !input.folder) && format.recognises(input)) {
            if (input.remote && !format.reads_urls) {
                refuse_remote(input, format.about.name);
            }
            return format;
        }
    }
    if (input.missing != nullptr) {
        throw Error(*input.missing);
    }
    if (input.remote) {
        throw Error(ErrorKind::not_found, {input.name()},
                    "there is no Zarr array or image in this folder, and no other folder can be "
                    "read from a URL",
                    {{RemedyKind::download}});
    }
    refuse_folder(input);
}

/// Whether the error is about the contents of a file that the input refers to (a header's data
/// file).
bool is_of_named_file(const Error& error, const VolumeInput& input) {
    const std::string& file = error.place().file;
    return error.kind() != ErrorKind::io && error.kind() != ErrorKind::limit && !file.empty() &&
           !file.starts_with(input.name()) &&
           std::none_of(
               input.paths.begin(), input.paths.end(),
               [&](const std::filesystem::path& path) { return file.starts_with(path.native()); });
}

/// Adds the name of the input to errors about a file that it refers to, as the user may not know
/// that it does.
std::unique_ptr<VolumeSource> opened(const VolumeFormat& format, const VolumeInput& input,
                                     const SourceOptions& options) {
    try {
        return format.open(input, options);
    } catch (const Error& error) {
        if (!is_of_named_file(error, input)) {
            throw;
        }
        throw Error(error.kind(), error.place(),
                    fmt::format("{} (the file is named in {})", error.problem(), input.name()),
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

std::string input_format_of(const std::filesystem::path& path) {
    try {
        const VolumeFormat& format = format_of(look_at({path}, {}));
        return format.takes.numbers ? std::string() : format.about.name;
    } catch (const Error&) {
        return {};
    }
}

bool holds_whole_volume(const std::filesystem::path& path) {
    std::error_code ignored;
    if (!std::filesystem::is_regular_file(path, ignored)) {
        return false;
    }
    try {
        const VolumeFormat& format = format_of(look_at({path}, {}));
        return !format.takes.numbers && !format.several_files;
    } catch (const Error&) {
        return false;
    }
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
                    fmt::format("this is {}, which this build does not support", format.about.name),
                    {{RemedyKind::install_package, format.about.package}});
    }
    if (paths.size() > 1 && !format.several_files) {
        throw Error(ErrorKind::invalid_argument, {input.path().string()},
                    fmt::format("one {} file is one volume, but {} files are given",
                                format.about.name, paths.size()));
    }
    refuse_options(input, format, options);
    if (!options.label_names.empty() && !options.labels) {
        throw Error(ErrorKind::invalid_argument, {options.label_names.string()},
                    "a table of label names needs a volume that is read as labels");
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
            constexpr double kMax = 9007199254740992.0;  // 2^53
            if (!(missing >= 0 && missing <= kMax) || missing != std::floor(missing)) {
                throw Error(ErrorKind::invalid_argument, {source->describe().name},
                            fmt::format("the missing value {} is not a label: labels are whole "
                                        "numbers from 0 to 2^53",
                                        missing));
            }
            missing = value_of_label(static_cast<std::uint64_t>(missing));
        }
        source = with_missing(std::move(source), missing);
    }
    return repeated(std::move(source), options.periodic, options.repeat);
}

std::unique_ptr<VolumeSource> open_volume(const std::filesystem::path& path,
                                          const SourceOptions& options) {
    return open_volume(std::vector{path}, options);
}

// Reading from a pipe by way of a temporary file.

using namespace detail;
namespace {

constexpr const char* kName = "standard input";

/// A source that reads the copy, and owns it.
class StreamedSource : public DescribedSource {
  public:
    StreamedSource(ScratchFile copy, std::unique_ptr<VolumeSource> inner)
        : DescribedSource(std::move(inner)), copy_(std::move(copy)) {}
    [[nodiscard]] VolumeDescription describe() const override {
        VolumeDescription result = inner_source().describe();
        result.name = kName;
        return result;
    }
    /// The next run could not read it again.
    [[nodiscard]] std::string identity() const override { return ""; }
    [[nodiscard]] std::vector<std::filesystem::path> files() const override { return {}; }

  private:
    ScratchFile copy_;
};

void copy_all(int descriptor, ScratchFile& copy) {
    std::vector<std::byte> buffer(std::size_t{1} << 20U);
    std::uint64_t at = 0;
    while (true) {
        const ssize_t n = ::read(descriptor, buffer.data(), buffer.size());
        if (n < 0 && errno == EINTR) {
            continue;
        }
        if (n < 0) {
            throw Error(ErrorKind::io, {kName},
                        fmt::format("cannot read: {}", std::strerror(errno)));
        }
        if (n == 0) {
            break;
        }
        copy.write_at(at, {buffer.data(), static_cast<std::size_t>(n)});
        at += static_cast<std::uint64_t>(n);
    }
    if (at == 0) {
        throw Error(ErrorKind::invalid_argument, {kName}, "the input is empty");
    }
}

/// A temporary name of the copy while HDF5 opens it, because HDF5 does not accept names in /proc.
class ShortName {
  public:
    ShortName(const ScratchFile& copy, const std::filesystem::path& folder)
        : name_(folder / fmt::format("{}{}", ScratchFile::kPrefix, ::getpid())) {
        const std::string from = fmt::format("/proc/self/fd/{}", copy.descriptor());
        if (::linkat(AT_FDCWD, from.c_str(), AT_FDCWD, name_.c_str(), AT_SYMLINK_FOLLOW) != 0) {
            throw Error(ErrorKind::unsupported, {kName},
                        fmt::format("HDF5 needs a file with a name, but its temporary copy in {} "
                                    "cannot get one ({}); give the file itself, not a pipe",
                                    folder.string(), std::strerror(errno)));
        }
    }
    ShortName(const ShortName&) = delete;
    ShortName& operator=(const ShortName&) = delete;
    ~ShortName() { ::unlink(name_.c_str()); }
    [[nodiscard]] const std::filesystem::path& path() const { return name_; }

  private:
    std::filesystem::path name_;
};

/// Rethrows the error with the name that the user gave.
[[noreturn]] void rethrow_named(const Error& error, const std::string& path) {
    ErrorPlace place = error.place();
    if (place.file.starts_with(path)) {
        place.file = kName + place.file.substr(path.size());
    }
    throw Error(error.kind(), place, error.problem(), error.remedies());
}

}  // namespace

std::unique_ptr<VolumeSource> open_volume_stream(int descriptor,
                                                 const std::filesystem::path& scratch_folder,
                                                 const SourceOptions& options) {
    ScratchFile copy(scratch_folder);
    copy_all(descriptor, copy);
    std::string path = fmt::format("/proc/self/fd/{}", copy.descriptor());
    std::optional<ShortName> name;
    if (is_hdf5(std::filesystem::path(path))) {
        name.emplace(copy, scratch_folder);
        path = name->path().string();
    }
    try {
        std::unique_ptr<VolumeSource> source = open_volume(path, options);
        return std::make_unique<StreamedSource>(std::move(copy), std::move(source));
    } catch (const Error& error) {
        rethrow_named(error, path);
    }
}

}  // namespace isonest

namespace isonest::detail {

// The only list of formats.

std::vector<std::filesystem::path> VolumeInput::slices(
    const std::vector<std::string_view>& extensions) const {
    if (folder) {
        return files_in(path(), extensions);
    }
    std::vector<std::filesystem::path> files = paths;
    std::stable_sort(files.begin(), files.end(), [](const auto& a, const auto& b) {
        return naturally_less(a.string(), b.string());
    });
    return files;
}

std::string VolumeInput::name_of_slices(const std::vector<std::filesystem::path>& files) const {
    return files.size() == 1 || folder
               ? path().string()
               : fmt::format("{} and {} more", files.front().string(), files.size() - 1);
}

std::string VolumeInput::name() const {
    return shown_location(paths.front().native());
}

const std::vector<VolumeFormat>& volume_formats() {
    static const std::vector<VolumeFormat> formats{
        nrrd_format(), hdf5_format(), netcdf3_format(), nifti_format(), meta_image_format(),
        mgh_format(), mrc_format(), vti_format(), vtk_format(), npy_format(), npz_format(),
        zarr_format(), dicom_format(), tiff_format(), png_format(), bmp_format(), vdb_format(),
        // Must be last: it accepts every file.
        raw_format()};
    return formats;
}

}  // namespace isonest::detail
