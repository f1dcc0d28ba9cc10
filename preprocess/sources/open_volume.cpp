#include <fmt/format.h>

#include <initializer_list>
#include <utility>

#include <isonest/error.h>
#include <isonest/open_volume.h>

#include "preprocess/sources/hdf5_source.h"
#include "preprocess/sources/mirrored_source.h"
#include "preprocess/sources/missing_source.h"
#include "preprocess/sources/nrrd_header.h"
#include "preprocess/sources/wrapped_source.h"

namespace isonest {
using namespace detail;
namespace {

/// A source with another spacing or origin than the file says.
class Placed : public WrappedSource {
  public:
    Placed(std::unique_ptr<VolumeSource> inner, const SourceOptions& options)
        : WrappedSource(std::move(inner)), spacing_(options.spacing), origin_(options.origin) {}
    [[nodiscard]] VolumeDescription describe() const override {
        VolumeDescription result = inner_source().describe();
        result.spacing = spacing_.value_or(result.spacing);
        result.origin = origin_.value_or(result.origin);
        return result;
    }
    [[nodiscard]] std::span<const std::byte> mapped() const override {
        return inner_source().mapped();
    }
    void read(std::int64_t z0, std::int64_t nz, std::int64_t y0, std::int64_t ny,
              std::byte* dst) override {
        inner_source().read(z0, nz, y0, ny, dst);
    }

  private:
    std::optional<Double3> spacing_;
    std::optional<Double3> origin_;
};

/// Some of its options (named as in SourceOptions) were given for a file of a format that has no
/// use for them.
void refuse_options(const std::filesystem::path& path, const char* format,
                    std::initializer_list<std::pair<const char*, bool>> given) {
    for (const auto& [option, there] : given) {
        if (there) {
            throw Error(ErrorKind::invalid_argument, {path.string()},
                        fmt::format("the option '{}' does not go with {}", option, format),
                        {{RemedyKind::leave_out, option}});
        }
    }
}

void refuse_raw_options(const std::filesystem::path& path, const char* format,
                        const SourceOptions& o) {
    refuse_options(path, format,
                   {{"dims", o.dims.has_value()},
                    {"type", o.type.has_value()},
                    {"big_endian", o.big_endian.has_value()},
                    {"offset", o.offset.has_value()}});
}

/// The file's start, with at least the whole header.
std::string read_nrrd_header(const std::filesystem::path& path) {
    constexpr std::size_t kUsual = std::size_t{1} << 16U;
    constexpr std::size_t kLongest = std::size_t{1} << 22U;
    for (const std::size_t most : {kUsual, kLongest}) {
        std::string text = first_bytes(path, most);
        if (text.size() < most || nrrd_header_ends(text)) {
            return text;
        }
    }
    throw Error(ErrorKind::unsupported, {path.string(), "NRRD header"},
                fmt::format("no empty line ends it within the first {} bytes", kLongest));
}

std::unique_ptr<VolumeSource> open_nrrd(const std::filesystem::path& path,
                                        const SourceOptions& options) {
    refuse_options(path, "NRRD", {{"dataset", !options.dataset.empty()}});
    refuse_raw_options(path, "NRRD, which says it itself", options);
    const std::string name = path.string();
    NrrdHeader header = parse_nrrd_header(read_nrrd_header(path), name, options.spacing);
    if (header.oblique && !options.spacing) {
        throw Error(ErrorKind::unsupported, {name, "NRRD header"},
                    "'space directions' that are not along the axes (they lead astray by a tenth "
                    "of a voxel or more); resample the volume, or ignore them",
                    {{RemedyKind::place_in_world, "spacing"}});
    }
    std::filesystem::path data = path;
    if (!header.data_file.empty()) {
        data = path.parent_path() / header.data_file;
        header.layout.header = path;
    } else {
        header.layout.start = header.header_bytes;
    }
    auto source = open_raw(data, data.string(), header.layout);
    const auto& back = header.backward;
    return back[0] || back[1] || back[2] ? mirrored(std::move(source), back) : std::move(source);
}

}  // namespace

std::unique_ptr<VolumeSource> open_volume(const std::filesystem::path& path,
                                          const SourceOptions& options) {
    regular_file_size(path);
    const std::string magic = first_bytes(path, 8);
    std::unique_ptr<VolumeSource> source;
    if (magic.starts_with("NRRD000")) {
        source = open_nrrd(path, options);
    } else if (is_hdf5(path)) {
        refuse_raw_options(path, "HDF5, which says it itself", options);
        source = open_hdf5_volume(path, options);
    } else {
        refuse_options(path, "raw numbers", {{"dataset", !options.dataset.empty()}});
        if (!options.dims || !options.type) {
            throw Error(ErrorKind::invalid_argument, {path.string()},
                        "neither HDF5 nor NRRD; raw numbers have to be described",
                        {{RemedyKind::describe_numbers, "dims,type"}});
        }
        RawLayout layout;
        layout.nodes = *options.dims;
        layout.type = *options.type;
        layout.big_endian = options.big_endian.value_or(false);
        layout.offset = options.offset.value_or(0);
        source = open_raw(path, path.string(), layout);
    }
    if (options.spacing || options.origin) {
        source = std::make_unique<Placed>(std::move(source), options);
    }
    if (options.missing) {
        source = with_missing(std::move(source), *options.missing);
    }
    return source;
}

}  // namespace isonest
