#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include <isonest/error.h>

#include "preprocess/sources/bytes/byte_reader.h"
#include "preprocess/sources/bytes/header_words.h"
#include "preprocess/sources/bytes/input_file.h"
#include "preprocess/sources/placement/placement.h"
#include "preprocess/sources/volume_format.h"
#include "preprocess/sources/wrapping/label_names.h"
#include "store/lattice/lattice.h"

namespace isonest::detail {

// One image of a stack: its description, and its numbers.

struct SlicePicture {
    std::int64_t width = 0;
    std::int64_t height = 0;
    int bits = 8;            ///< per value: 1, 2, 4, 8 or 16
    bool colours = false;    ///< red, green and blue are stored, and must be equal everywhere
    std::uint64_t heap = 0;  ///< bytes needed for decoding, besides the numbers
};

/// Throws Error{corrupt, io, not_found, unsupported}.
SlicePicture look_at_png(const std::filesystem::path& file);
SlicePicture look_at_bmp(const std::filesystem::path& file);

/// All numbers, top row first: one byte each, or two bytes in native endianness for 16 bits.
/// `full_range`: values of 1, 2 and 4 bits are scaled to 0 to 255.
/// REQUIRES: `picture` describes the file. Throws Error{corrupt, io}, and Error{unsupported} for a
/// pixel that is not grey.
void decode_png(const std::filesystem::path& file, const SlicePicture& picture, bool full_range,
                std::byte* dst);
void decode_bmp(const std::filesystem::path& file, const SlicePicture& picture, bool full_range,
                std::byte* dst);

/// Throws Error{unsupported}, about a pixel that is not grey.
[[noreturn]] void refuse_colour(const std::filesystem::path& file, std::int64_t x, std::int64_t y);

namespace {

struct Bmp {
    std::int64_t width = 0;
    std::int64_t height = 0;
    bool upside_down = true;      ///< the bottom row comes first
    int bits = 0;                 ///< per pixel
    std::uint64_t start = 0;      ///< file offset of the rows
    std::uint64_t row = 0;        ///< in bytes
    std::array<int, 256> grey{};  ///< of the palette's colours; -1 for numbers without a colour
};

Bmp read_bmp_header(const std::filesystem::path& file) {
    constexpr std::size_t kMax = 14 + 124 + 12 + 1024;
    constexpr std::size_t kMin = 14 + 40;
    const std::string head = first_bytes(file, kMax);
    const auto corrupt = [&](const std::string& what) {
        throw Error(ErrorKind::corrupt, {file.string(), "BMP header"}, what);
    };
    const auto unsupported = [&](const std::string& what) {
        throw Error(ErrorKind::unsupported, {file.string(), "BMP header"},
                    what +
                        "; convert it to 8-bit grey values, for example with: convert IN.bmp "
                        "-colorspace Gray OUT.png");
    };
    if (!head.starts_with("BM") || head.size() < kMin) {
        corrupt("not a BMP file, or cut short");
    }
    const auto word = [&](std::size_t at) { return number_at<std::uint32_t>(head, at, false); };
    const std::uint32_t header = word(14);
    constexpr std::array<std::uint32_t, 5> kHeaders{40, 52, 56, 108, 124};
    if (std::find(kHeaders.begin(), kHeaders.end(), header) == kHeaders.end()) {
        unsupported(fmt::format("a header of {} bytes is not supported", header));
    }
    if (head.size() < 14 + header) {
        corrupt("the header is cut short");
    }
    Bmp bmp;
    bmp.width = number_at<std::int32_t>(head, 18, false);
    bmp.height = number_at<std::int32_t>(head, 22, false);
    bmp.upside_down = bmp.height > 0;
    bmp.height = std::abs(bmp.height);
    bmp.bits = number_at<std::uint16_t>(head, 28, false);
    if (bmp.width < 1 || bmp.width > kMaxNodesPerAxis || bmp.height < 1 ||
        bmp.height > kMaxNodesPerAxis || number_at<std::uint16_t>(head, 26, false) != 1) {
        corrupt(fmt::format("invalid size: {} x {} pixels, {} planes", bmp.width, bmp.height,
                            number_at<std::uint16_t>(head, 26, false)));
    }
    constexpr std::uint32_t kBitFields = 3;
    const std::uint32_t compression = word(30);
    const bool has_masks = compression == kBitFields && bmp.bits == 32;
    if (compression != 0 && !has_masks) {
        unsupported(fmt::format("compression {} is not supported", compression));
    }
    if (bmp.bits != 1 && bmp.bits != 4 && bmp.bits != 8 && bmp.bits != 24 && bmp.bits != 32) {
        unsupported(fmt::format("{} bits per pixel are not supported", bmp.bits));
    }
    std::uint64_t behind = 14 + header;
    if (has_masks) {
        constexpr std::uint64_t kMasks = 12;
        behind += header == 40 ? kMasks : 0;
        if (head.size() < 14 + 40 + kMasks) {
            corrupt("the header is cut short");
        }
        if (word(54) != 0xFF0000U || word(58) != 0xFF00U || word(62) != 0xFFU) {
            unsupported("colours that do not have one byte each are not supported");
        }
    }
    bmp.grey.fill(-1);
    if (bmp.bits <= 8) {
        const std::uint32_t most = 1U << static_cast<unsigned>(bmp.bits);
        const std::uint32_t used = word(46) == 0 ? most : word(46);
        if (used > most || head.size() < behind + 4 * std::uint64_t{used}) {
            corrupt(fmt::format("the palette of {} colours is too large, or cut short", used));
        }
        for (std::uint32_t i = 0; i < used; ++i) {
            const auto* const colour =
                reinterpret_cast<const unsigned char*>(head.data()) + behind + 4 * std::size_t{i};
            if (colour[0] != colour[1] || colour[1] != colour[2]) {
                unsupported(
                    fmt::format("the palette is not grey (entry {} is red {}, green {}, blue {})",
                                i, colour[2], colour[1], colour[0]));
            }
            bmp.grey.at(i) = colour[0];
        }
        behind += 4 * std::uint64_t{used};
    }
    bmp.start = word(10);
    bmp.row = (static_cast<std::uint64_t>(bmp.width) * static_cast<std::uint64_t>(bmp.bits) + 31) /
              32 * 4;
    const std::uint64_t size = regular_file_size(file);
    const std::uint64_t need = bmp.row * static_cast<std::uint64_t>(bmp.height);
    if (bmp.start < behind || bmp.start > size || size - bmp.start < need) {
        corrupt(
            fmt::format("{} bytes of pixels from byte {} on overlap the header of {} bytes, or go "
                        "beyond the end of the file at byte {}",
                        need, bmp.start, behind, size));
    }
    return bmp;
}

/// The grey value of a pixel; -1 for a colour that is not grey, -2 for a number without a colour.
int grey_of(const Bmp& bmp, const unsigned char* row, std::int64_t x) {
    if (bmp.bits > 8) {
        const unsigned char* const pixel = row + x * (bmp.bits / 8);
        return pixel[0] == pixel[1] && pixel[1] == pixel[2] ? pixel[0] : -1;
    }
    const std::int64_t of_byte = 8 / bmp.bits;
    const auto shift = static_cast<unsigned>((of_byte - 1 - x % of_byte) * bmp.bits);
    const unsigned number =
        row[x / of_byte] >> shift & ((1U << static_cast<unsigned>(bmp.bits)) - 1);
    const int grey = bmp.grey.at(number);
    return grey < 0 ? -2 : grey;
}

}  // namespace

SlicePicture look_at_bmp(const std::filesystem::path& file) {
    const Bmp bmp = read_bmp_header(file);
    return {bmp.width, bmp.height, 8, bmp.bits > 8, bmp.row};
}

void decode_bmp(const std::filesystem::path& file, const SlicePicture& picture, bool /*full_range*/,
                std::byte* dst) {
    const Bmp bmp = read_bmp_header(file);
    if (bmp.width != picture.width || bmp.height != picture.height) {
        throw Error(ErrorKind::corrupt, {file.string()},
                    "the file has changed since it was opened");
    }
    const auto bytes =
        file_bytes(file, bmp.start, bmp.row * static_cast<std::uint64_t>(bmp.height));
    std::vector<unsigned char> row(bmp.row);
    for (std::int64_t y = 0; y < bmp.height; ++y) {
        const std::int64_t stored = bmp.upside_down ? bmp.height - 1 - y : y;
        bytes->read(static_cast<std::uint64_t>(stored) * bmp.row,
                    reinterpret_cast<std::byte*>(row.data()), row.size());
        for (std::int64_t x = 0; x < bmp.width; ++x) {
            const int grey = grey_of(bmp, row.data(), x);
            if (grey == -1) {
                refuse_colour(file, x, y);
            }
            if (grey < 0) {
                throw Error(
                    ErrorKind::corrupt, {file.string()},
                    fmt::format("the pixel ({}, {}) has a colour that is not in the palette", x,
                                y));
            }
            *dst++ = static_cast<std::byte>(grey);
        }
    }
}

}  // namespace isonest::detail

#if ISONEST_WITH_PNG

#include <png.h>

#include <csetjmp>
#include <cstring>
#include <memory>

namespace isonest::detail {
namespace {

/// A PNG file being read. libpng leaves its functions by longjmp(), so functions that call it must
/// have nothing to destroy.
class PngFile {
  public:
    explicit PngFile(const std::filesystem::path& path)
        : path_(path), size_(regular_file_size(path)), bytes_(file_bytes(path, 0, size_)) {
        png_ = png_create_read_struct(PNG_LIBPNG_VER_STRING, this, keep_error, no_warning);
        info_ = png_ != nullptr ? png_create_info_struct(png_) : nullptr;
        if (!begin()) {
            fail();
        }
    }
    PngFile(const PngFile&) = delete;
    PngFile& operator=(const PngFile&) = delete;
    ~PngFile() { png_destroy_read_struct(&png_, &info_, nullptr); }

    [[noreturn]] void fail() const {
        throw Error(ErrorKind::corrupt, {path_.string()},
                    fmt::format("libpng cannot read it: {}", problem_.data()));
    }
    [[nodiscard]] png_structp png() const { return png_; }
    [[nodiscard]] png_infop info() const { return info_; }
    bool prepare(bool full_range, int* passes) {
        if (setjmp(png_jmpbuf(png_)) != 0) {
            return false;
        }
        if (full_range) {
            png_set_expand_gray_1_2_4_to_8(png_);
        }
        png_set_packing(png_);
        png_set_swap(png_);
        *passes = png_set_interlace_handling(png_);
        png_read_update_info(png_, info_);
        return true;
    }
    bool read_row(std::byte* row) {
        if (setjmp(png_jmpbuf(png_)) != 0) {
            return false;
        }
        png_read_row(png_, reinterpret_cast<png_bytep>(row), nullptr);
        return true;
    }
    bool end() {
        if (setjmp(png_jmpbuf(png_)) != 0) {
            return false;
        }
        png_read_end(png_, nullptr);
        return true;
    }

  private:
    static void keep_error(png_structp png, png_const_charp text) {
        auto* const self = static_cast<PngFile*>(png_get_error_ptr(png));
        std::strncpy(self->problem_.data(), text, self->problem_.size() - 1);
        png_longjmp(png, 1);
    }
    static void no_warning(png_structp /*png*/, png_const_charp /*text*/) {}
    /// Must not throw through libpng.
    static void read(png_structp png, png_bytep data, std::size_t size) {
        auto* const self = static_cast<PngFile*>(png_get_io_ptr(png));
        if (size > self->size_ - self->at_) {
            png_error(png, "the image is incomplete; the file was cut short");
        }
        if (!self->fetch(reinterpret_cast<std::byte*>(data), size)) {
            png_error(png, "the file cannot be read");
        }
    }
    bool fetch(std::byte* data, std::size_t size) {
        try {
            bytes_->read(at_, data, size);
        } catch (const Error&) {
            return false;
        }
        at_ += size;
        return true;
    }
    bool begin() {
        if (png_ == nullptr || info_ == nullptr || setjmp(png_jmpbuf(png_)) != 0) {
            return false;
        }
        png_set_user_limits(png_, kMaxNodesPerAxis, kMaxNodesPerAxis);
        png_set_read_fn(png_, this, read);
        png_set_crc_action(png_, PNG_CRC_ERROR_QUIT, PNG_CRC_WARN_DISCARD);
        png_read_info(png_, info_);
        return true;
    }

    std::filesystem::path path_;
    std::uint64_t size_;
    std::unique_ptr<ByteReader> bytes_;
    std::uint64_t at_ = 0;
    std::array<char, 200> problem_{};
    png_structp png_ = nullptr;
    png_infop info_ = nullptr;
};

}  // namespace

SlicePicture look_at_png(const std::filesystem::path& file) {
    const PngFile png(file);
    const int type = png_get_color_type(png.png(), png.info());
    if (type == PNG_COLOR_TYPE_PALETTE) {
        throw Error(ErrorKind::unsupported, {file.string()},
                    "the image has a colour palette; convert it to grey values, for example with: "
                    "convert IN.png -colorspace Gray OUT.png");
    }
    SlicePicture picture;
    picture.width = png_get_image_width(png.png(), png.info());
    picture.height = png_get_image_height(png.png(), png.info());
    picture.bits = png_get_bit_depth(png.png(), png.info());
    picture.colours = type != PNG_COLOR_TYPE_GRAY;
    const auto value = static_cast<std::uint64_t>(picture.bits == 16 ? 2 : 1);
    const auto channels = static_cast<std::uint64_t>(png_get_channels(png.png(), png.info()));
    picture.heap = static_cast<std::uint64_t>(picture.width) * value * channels *
                       (png_get_interlace_type(png.png(), png.info()) == PNG_INTERLACE_NONE
                            ? 1
                            : static_cast<std::uint64_t>(picture.height)) +
                   (std::uint64_t{1} << 20U);
    return picture;
}

void decode_png(const std::filesystem::path& file, const SlicePicture& picture, bool full_range,
                std::byte* dst) {
    PngFile png(file);
    if (png_get_image_width(png.png(), png.info()) != picture.width ||
        png_get_image_height(png.png(), png.info()) != picture.height ||
        png_get_bit_depth(png.png(), png.info()) != picture.bits) {
        throw Error(ErrorKind::corrupt, {file.string()},
                    "the file has changed since it was opened");
    }
    int passes = 1;
    if (!png.prepare(full_range, &passes)) {
        png.fail();
    }
    const std::size_t value = picture.bits == 16 ? 2 : 1;
    const std::size_t channels = png_get_channels(png.png(), png.info());
    const auto width = static_cast<std::size_t>(picture.width);
    const std::size_t row_bytes = width * value * channels;
    const auto height = static_cast<std::size_t>(picture.height);
    if (png_get_rowbytes(png.png(), png.info()) != row_bytes) {
        throw Error(ErrorKind::corrupt, {file.string()},
                    "the rows do not have the expected length");
    }
    // In interlaced images, each pass adds pixels to all rows.
    std::vector<std::byte> rows(row_bytes * (passes > 1 ? height : 1));
    const bool direct = channels == 1;
    for (int pass = 0; pass < passes; ++pass) {
        for (std::size_t y = 0; y < height; ++y) {
            std::byte* const to = direct       ? dst + y * row_bytes
                                  : passes > 1 ? rows.data() + y * row_bytes
                                               : rows.data();
            if (!png.read_row(to)) {
                png.fail();
            }
            if (direct || pass + 1 < passes) {
                continue;
            }
            for (std::size_t x = 0; x < width; ++x) {
                const std::byte* const pixel = to + x * value * channels;
                const bool has_alpha = channels % 2 == 0;
                const bool is_grey =
                    channels < 3 || (std::memcmp(pixel, pixel + value, value) == 0 &&
                                     std::memcmp(pixel, pixel + 2 * value, value) == 0);
                const bool is_solid =
                    !has_alpha ||
                    std::all_of(pixel + (channels - 1) * value, pixel + channels * value,
                                [](std::byte b) { return b == std::byte{255}; });
                if (!is_grey || !is_solid) {
                    refuse_colour(file, static_cast<std::int64_t>(x), static_cast<std::int64_t>(y));
                }
                std::memcpy(dst + (y * width + x) * value, pixel, value);
            }
        }
    }
    if (!png.end()) {
        png.fail();
    }
}

}  // namespace isonest::detail
#endif

namespace isonest::detail {
namespace {

using namespace std::string_view_literals;

constexpr std::string_view kPngMagic = "\x89PNG\r\n\x1A\n"sv;

/// How images of a format are read.
struct PictureFormat {
    std::string_view ending;
    SlicePicture (*look)(const std::filesystem::path&);
    void (*decode)(const std::filesystem::path&, const SlicePicture&, bool, std::byte*);
};

/// Images of the same size, one per plane. Holds one plane.
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
        decode(0);  // so that colours are refused immediately
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

/// Requires images of the same size and type; values of less than 8 bits may be scaled to 8 bits.
std::vector<SlicePicture> look_at_all(const PictureFormat& format,
                                      const std::vector<std::filesystem::path>& files,
                                      std::uint64_t max_heap) {
    std::vector<SlicePicture> pictures;
    pictures.reserve(files.size());
    for (const std::filesystem::path& file : files) {
        const SlicePicture picture = format.look(file);
        if (picture.heap + static_cast<std::uint64_t>(picture.width * picture.height) * 2 >
            max_heap / 2) {
            throw Error(
                ErrorKind::limit, {file.string()},
                fmt::format(
                    "a slice of {} x {} values, which is read as a whole, does not fit in memory",
                    picture.width, picture.height),
                {{RemedyKind::more_memory}});
        }
        pictures.push_back(picture);
        const SlicePicture& first = pictures.front();
        if (picture.width != first.width || picture.height != first.height ||
            (picture.bits == 16) != (first.bits == 16)) {
            throw Error(
                ErrorKind::unsupported, {file.string()},
                fmt::format("the slice has {} x {} values of {} bits, but the first slice has {} x "
                            "{} of {} bits; all slices must have the same size and type",
                            picture.width, picture.height, picture.bits, first.width, first.height,
                            first.bits));
        }
    }
    return pictures;
}

std::unique_ptr<VolumeSource> open_slices(const PictureFormat& format, const VolumeInput& input,
                                          const SourceOptions& options) {
    std::vector<std::filesystem::path> files = input.slices({format.ending});
    const std::string name = input.name_of_slices(files);
    std::vector<SlicePicture> pictures = look_at_all(format, files, options.max_heap);
    const bool full_range =
        std::any_of(pictures.begin(), pictures.end(),
                    [&](const SlicePicture& p) { return p.bits != pictures.front().bits; });
    const bool has_colours = std::any_of(pictures.begin(), pictures.end(),
                                         [](const SlicePicture& p) { return p.colours; });
    std::vector<std::string> notes;
    if (full_range) {
        notes.emplace_back(
            "some slices have fewer bits per value than others; their values are scaled to 0 to "
            "255");
    }
    if (has_colours) {
        notes.emplace_back("colours are read as grey values, so red, green and blue must be equal");
    }
    auto source = std::make_unique<SliceSource>(format, std::move(files), std::move(pictures),
                                                full_range, name);
    return without_spacing(with_notes(std::move(source), std::move(notes)), options);
}

bool is_in_folder(const VolumeInput& input, std::string_view ending) {
    return input.folder && !input.remote && !files_in(input.path(), {ending}).empty();
}

constexpr PictureFormat kBmp{".bmp", look_at_bmp, decode_bmp};

/// "BM", and a header of a known size.
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
                fmt::format("the pixel ({}, {}) is coloured or transparent, but a volume has one "
                            "value per node; convert the slices to grey values, for example with: "
                            "convert IN.png -alpha off -colorspace Gray OUT.png",
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
