#include "preprocess/sources/slices/slice_picture.h"

#if ISONEST_WITH_PNG

#include <fmt/format.h>
#include <png.h>

#include <algorithm>
#include <array>
#include <csetjmp>
#include <cstring>
#include <memory>
#include <string>
#include <vector>

#include <isonest/error.h>

#include "preprocess/sources/bytes/byte_reader.h"
#include "preprocess/sources/bytes/regular_file.h"
#include "store/lattice/lattice.h"

namespace isonest::detail {
namespace {

/// A PNG file that is read. libpng leaves its functions by longjmp(): those that call it here have
/// nothing to destroy.
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
    /// Nothing is thrown through libpng.
    static void read(png_structp png, png_bytep data, std::size_t size) {
        auto* const self = static_cast<PngFile*>(png_get_io_ptr(png));
        if (size > self->size_ - self->at_) {
            png_error(png, "the file ends before the picture does; it was cut short");
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
                    "its values are numbers of a palette's colours: write it as grey values, for "
                    "example with: convert IN.png -colorspace Gray OUT.png");
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
        throw Error(ErrorKind::corrupt, {file.string()}, "it has changed since it was looked at");
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
        throw Error(ErrorKind::corrupt, {file.string()}, "its rows have another length");
    }
    // Of interlaced pictures each pass adds pixels to all rows.
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
