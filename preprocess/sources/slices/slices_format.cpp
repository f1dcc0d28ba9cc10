#include "preprocess/sources/slices/slices_format.h"

#include <fmt/format.h>

#include <algorithm>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include <isonest/error.h>

#include "preprocess/sources/bytes/file_identity.h"
#include "preprocess/sources/bytes/natural_order.h"
#include "preprocess/sources/placement/unsaid_spacing.h"
#include "preprocess/sources/slices/slice_picture.h"
#include "preprocess/sources/wrapping/noted_source.h"

namespace isonest::detail {
namespace {

using namespace std::string_view_literals;

constexpr std::string_view kPngMagic = "\x89PNG\r\n\x1A\n"sv;

/// How pictures of a format are read.
struct PictureFormat {
    std::string_view ending;
    SlicePicture (*look)(const std::filesystem::path&);
    void (*decode)(const std::filesystem::path&, const SlicePicture&, bool, std::byte*);
};

/// Pictures of one size, one for each plane. One plane is held.
class SliceSource : public VolumeSource {
  public:
    SliceSource(const PictureFormat& format, std::vector<std::filesystem::path> files,
                std::vector<SlicePicture> pictures, bool full_range, std::string name)
        : format_(format),
          files_(std::move(files)),
          pictures_(std::move(pictures)),
          full_range_(full_range),
          name_(std::move(name)),
          plane_(static_cast<std::size_t>(pictures_[0].width * pictures_[0].height) *
                 size_of(type())) {
        for (const SlicePicture& picture : pictures_) {
            heap_ = std::max(heap_, picture.heap);
        }
        decode(0);  // so that colours are refused at once
    }
    [[nodiscard]] VolumeDescription describe() const override {
        VolumeDescription description;
        description.nodes = {pictures_[0].width, pictures_[0].height,
                             static_cast<std::int64_t>(pictures_.size())};
        description.type = type();
        description.name = name_;
        return description;
    }
    [[nodiscard]] std::vector<std::filesystem::path> files() const override { return files_; }
    [[nodiscard]] std::string identity() const override {
        return fmt::format("{}full range {}\n", identity_of(files_), full_range_);
    }
    [[nodiscard]] Granularity granularity() const override { return {1, pictures_[0].height}; }
    [[nodiscard]] std::uint64_t heap() const override {
        return (1U << 20U) + plane_.size() + heap_ + pictures_.size() * sizeof(SlicePicture);
    }
    void read(std::int64_t z0, std::int64_t nz, std::int64_t y0, std::int64_t ny,
              std::byte* dst) override {
        const std::size_t row = static_cast<std::size_t>(pictures_[0].width) * size_of(type());
        const std::size_t bytes = static_cast<std::size_t>(ny) * row;
        for (std::int64_t z = z0; z < z0 + nz; ++z, dst += bytes) {
            decode(z);
            std::copy_n(
                plane_.begin() + static_cast<std::ptrdiff_t>(static_cast<std::size_t>(y0) * row),
                bytes, dst);
        }
    }

  private:
    [[nodiscard]] ValueType type() const {
        return pictures_[0].bits == 16 ? ValueType::u16 : ValueType::u8;
    }
    void decode(std::int64_t z) {
        if (z != current_) {
            current_ = -1;
            format_.decode(files_[static_cast<std::size_t>(z)],
                           pictures_[static_cast<std::size_t>(z)], full_range_, plane_.data());
            current_ = z;
        }
    }

    PictureFormat format_;
    std::vector<std::filesystem::path> files_;
    std::vector<SlicePicture> pictures_;
    bool full_range_;
    std::string name_;
    std::uint64_t heap_ = 0;
    std::vector<std::byte> plane_;
    std::int64_t current_ = -1;
};

/// Pictures of one size and type; values of less than 8 bits may become those of 8.
std::vector<SlicePicture> look_at_all(const PictureFormat& format,
                                      const std::vector<std::filesystem::path>& files,
                                      std::uint64_t max_heap) {
    std::vector<SlicePicture> pictures;
    pictures.reserve(files.size());
    for (const std::filesystem::path& file : files) {
        const SlicePicture picture = format.look(file);
        if (picture.heap + static_cast<std::uint64_t>(picture.width * picture.height) * 2 >
            max_heap / 2) {
            throw Error(ErrorKind::limit, {file.string()},
                        fmt::format("a slice of {} x {} values is held as a whole", picture.width,
                                    picture.height),
                        {{RemedyKind::more_memory}});
        }
        pictures.push_back(picture);
        const SlicePicture& first = pictures.front();
        if (picture.width != first.width || picture.height != first.height ||
            (picture.bits == 16) != (first.bits == 16)) {
            throw Error(ErrorKind::unsupported, {file.string()},
                        fmt::format("it has {} x {} values of {} bits, but the first slice has "
                                    "{} x {} of {}: slices of one volume have one size and type",
                                    picture.width, picture.height, picture.bits, first.width,
                                    first.height, first.bits));
        }
    }
    return pictures;
}

std::unique_ptr<VolumeSource> open_slices(const PictureFormat& format, const VolumeInput& input,
                                          const SourceOptions& options) {
    std::vector<std::filesystem::path> files = input.paths;
    if (input.folder) {
        files = files_in(input.path(), {format.ending});
    } else {
        std::stable_sort(files.begin(), files.end(), [](const auto& a, const auto& b) {
            return naturally_less(a.string(), b.string());
        });
    }
    const std::string name =
        files.size() == 1 || input.folder
            ? input.path().string()
            : fmt::format("{} and {} more", files.front().string(), files.size() - 1);
    std::vector<SlicePicture> pictures = look_at_all(format, files, options.max_heap);
    const bool full_range =
        std::any_of(pictures.begin(), pictures.end(),
                    [&](const SlicePicture& p) { return p.bits != pictures.front().bits; });
    const bool has_colours = std::any_of(pictures.begin(), pictures.end(),
                                         [](const SlicePicture& p) { return p.colours; });
    std::vector<std::string> notes;
    if (full_range) {
        notes.emplace_back(
            "some slices have values of fewer bits than others: they are scaled to 0 to 255");
    }
    if (has_colours) {
        notes.emplace_back("its colours are read as grey: red, green and blue must be equal");
    }
    auto source = std::make_unique<SliceSource>(format, std::move(files), std::move(pictures),
                                                full_range, name);
    return without_spacing(with_notes(std::move(source), std::move(notes)), options);
}

bool is_in_folder(const VolumeInput& input, std::string_view ending) {
    return input.folder && !input.far && !files_in(input.path(), {ending}).empty();
}

constexpr PictureFormat kBmp{".bmp", look_at_bmp, decode_bmp};

/// "BM", and a header of one of the sizes that there are.
bool is_bmp(const VolumeInput& input) {
    constexpr std::size_t kHeaderSize = 14;
    return is_in_folder(input, kBmp.ending) ||
           (input.head.size() > kHeaderSize + 4 && input.head.starts_with("BM") &&
            input.head.substr(kHeaderSize + 1, 3) == "\0\0\0"sv &&
            input.head.substr(6, 4) == "\0\0\0\0"sv);
}

}  // namespace

void refuse_colour(const std::filesystem::path& file, std::int64_t x, std::int64_t y) {
    throw Error(ErrorKind::unsupported, {file.string()},
                fmt::format("the pixel ({}, {}) has a colour or is transparent: a volume has one "
                            "value at each node; write the slices as grey values, for example "
                            "with: convert IN.png -alpha off -colorspace Gray OUT.png",
                            x, y));
}

VolumeFormat png_format() {
    return {
        .about = {"PNG slices", ".png, a folder or a list of them", "libpng-dev"}, .takes = {},
        .several_files = true,
        .recognises =
            [](const VolumeInput& input) {
                return is_in_folder(input, ".png") || input.head.starts_with(kPngMagic);
            },
#if ISONEST_WITH_PNG
        .open = [](const VolumeInput& input, const SourceOptions& options) {
            return open_slices({".png", look_at_png, decode_png}, input, options);
        }
#else
        .open = nullptr
#endif
    };
}

VolumeFormat bmp_format() {
    return {.about = {"BMP slices", ".bmp, a folder or a list of them", ""},
            .takes = {},
            .several_files = true,
            .recognises = is_bmp,
            .open = [](const VolumeInput& input, const SourceOptions& options) {
                return open_slices(kBmp, input, options);
            }};
}

}  // namespace isonest::detail
