#include <fmt/format.h>

#include "preprocess/file_identity.h"
#include "preprocess/hdf5_source.h"
#include "preprocess/mirrored_source.h"
#include "preprocess/missing_source.h"
#include "preprocess/nrrd_header.h"
#include "preprocess/wrapped_source.h"
#include "store/error.h"

namespace isonest {
namespace {

/// A source with another spacing or origin than the file says.
class Placed : public WrappedSource {
  public:
    Placed(std::unique_ptr<VolumeSource> inner, const SourceOptions& options)
        : WrappedSource(std::move(inner)),
          spacing_(options.spacing.value_or(inner_source().spacing())),
          origin_(options.origin.value_or(inner_source().origin())) {}
    [[nodiscard]] Double3 spacing() const override { return spacing_; }
    [[nodiscard]] Double3 origin() const override { return origin_; }
    [[nodiscard]] std::span<const std::byte> mapped() const override {
        return inner_source().mapped();
    }
    void read(std::int64_t z0, std::int64_t nz, std::int64_t y0, std::int64_t ny,
              std::byte* dst) override {
        inner_source().read(z0, nz, y0, ny, dst);
    }

  private:
    Double3 spacing_;
    Double3 origin_;
};

std::unique_ptr<VolumeSource> open_nrrd_data(const std::filesystem::path& path,
                                             const NrrdHeader& header) {
    const std::string name = path.string();
    RawLayout layout = header.layout;
    layout.offset_from_end = header.byte_skip < 0;
    layout.offset = header.byte_skip > 0 ? static_cast<std::uint64_t>(header.byte_skip) : 0;
    layout.exact_length = false;
    if (!header.data_file.empty()) {
        const std::filesystem::path data = path.parent_path() / header.data_file;
        layout.header = path;
        if (header.gzip != is_gzip((regular_file_size(data), data))) {
            throw Error(ErrorKind::corrupt,
                        fmt::format("{}: says encoding {}, but {} is not so", name,
                                    header.gzip ? "gzip" : "raw", data.string()));
        }
        return open_raw(data, data.string(), layout);
    }
    if (header.gzip) {
        return open_gzip_behind(path, name, header.header_bytes, layout);
    }
    layout.offset += header.header_bytes;
    return open_raw(path, name, layout);
}

std::unique_ptr<VolumeSource> open_nrrd(const std::filesystem::path& path,
                                        const SourceOptions& options) {
    constexpr std::size_t kLongestHeader = std::size_t{1} << 16U;
    const std::string name = path.string();
    const NrrdHeader header = parse_nrrd_header(first_bytes(path, kLongestHeader), name);
    if (header.oblique && !options.spacing) {
        throw Error(ErrorKind::unsupported,
                    fmt::format("{}: 'space directions' that are not along the axes; resample the "
                                "volume, or give --spacing to ignore them",
                                name));
    }
    auto source = open_nrrd_data(path, header);
    const auto& back = header.backward;
    return back[0] || back[1] || back[2] ? mirrored(std::move(source), back) : std::move(source);
}

}  // namespace

std::string VolumeSource::identity() const {
    return identity_of(files());
}

std::unique_ptr<VolumeSource> open_volume(const std::filesystem::path& path,
                                          const SourceOptions& options) {
    regular_file_size(path);
    const std::string magic = first_bytes(path, 8);
    std::unique_ptr<VolumeSource> source;
    if (magic.starts_with("NRRD000")) {
        source = open_nrrd(path, options);
    } else if (is_hdf5(path)) {
        source = open_hdf5_volume(path, options);
    } else {
        if (!options.dims || !options.type) {
            throw Error(ErrorKind::invalid_argument,
                        fmt::format("{}: neither HDF5 nor NRRD; to read it as raw numbers give "
                                    "--dims X,Y[,Z] and --type T",
                                    path.string()));
        }
        RawLayout layout;
        layout.nodes = *options.dims;
        layout.type = *options.type;
        layout.big_endian = options.big_endian;
        layout.offset = options.offset;
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
