#if ISONEST_WITH_TIFF
#include "preprocess/sources/tiff/tiff_pages.h"

#include <fmt/format.h>

#include <algorithm>
#include <cstdarg>
#include <cstdio>
#include <cstring>
#include <limits>
#include <string_view>
#include <utility>

#include <isonest/error.h>

#include "preprocess/sources/bytes/regular_file.h"

namespace isonest::detail {
namespace {

constexpr std::size_t kMostPages = 1000000;

std::string message(const char* module, const char* format, va_list args) {
    std::array<char, 512> text{};
    // NOLINTNEXTLINE(clang-analyzer-valist.Uninitialized): libtiff gives it
    static_cast<void>(std::vsnprintf(text.data(), text.size(), format, args));
    return fmt::format("{}{}{}", module == nullptr ? "" : module, module == nullptr ? "" : ": ",
                       text.data());
}

int keep_message(TIFF* /*file*/, void* to, const char* module, const char* format, va_list args) {
    *static_cast<std::string*>(to) = message(module, format, args);
    return 1;
}

/// Keeps a warning that a tag is left out, or read in spite of its type, by which numbers would be
/// others.
int keep_warning(TIFF* /*file*/, void* to, const char* module, const char* format, va_list args) {
    constexpr std::array<std::string_view, 12> kTags{"BitsPerSample",
                                                     "Compression",
                                                     "FillOrder",
                                                     "ImageDescription",
                                                     "PhotometricInterpretation",
                                                     "PlanarConfiguration",
                                                     "Predictor",
                                                     "SampleFormat",
                                                     "SamplesPerPixel",
                                                     "StripOffsets",
                                                     "TileOffsets",
                                                     "SubFileType"};
    const std::string text = message(module, format, args);
    const bool is_left_out = text.find("ignored") != std::string::npos ||
                             text.find("Invalid data type") != std::string::npos;
    if (is_left_out && std::any_of(kTags.begin(), kTags.end(), [&](std::string_view tag) {
            return text.find(tag) != std::string::npos;
        })) {
        *static_cast<std::string*>(to) = text;
    }
    return 1;
}

template <class T>
T tag_or(TIFF* file, std::uint32_t tag, T otherwise) {
    T value{};
    return TIFFGetFieldDefaulted(file, tag, &value) == 1 ? value : otherwise;
}

std::size_t bytes_of(const TiffPage& page) {
    return size_of(page.stored ? bits_type(*page.stored) : page.type);
}

/// MetaMorph's tag UIC2 has a number for each plane.
std::int64_t planes_of_metamorph(TIFF* file) {
    constexpr std::uint32_t kUic2 = 33629;
    std::uint32_t count = 0;
    const void* numbers = nullptr;
    const bool has = TIFFGetField(file, kUic2, &count, &numbers) == 1 &&
                     TIFFFieldDataType(TIFFFieldWithTag(file, kUic2)) == TIFF_RATIONAL;
    return has ? std::max<std::int64_t>(count, 1) : 1;
}

/// Rows of the page that lie in one strip, or beside each other in tiles, which may be taller than
/// the page.
std::int64_t rows_of_part(TIFF* file, std::int64_t height) {
    constexpr std::uint32_t kAll = std::numeric_limits<std::uint32_t>::max();
    return std::min<std::int64_t>(
        height, TIFFIsTiled(file) != 0 ? tag_or<std::uint32_t>(file, TIFFTAG_TILELENGTH, 1)
                                       : tag_or<std::uint32_t>(file, TIFFTAG_ROWSPERSTRIP, kAll));
}

}  // namespace

std::string TiffPage::text() const {
    return fmt::format("{} x {}{} {}", width, height,
                       samples > 1 ? fmt::format(" x {} samples", samples) : "",
                       stored ? "float16 or 64-bit integers" : std::string(name_of(type)));
}

TiffPages::TiffPages(std::vector<std::filesystem::path> files, std::uint64_t max_heap)
    : files_(std::move(files)), max_heap_(max_heap) {
    for (std::uint32_t i = 0; i < files_.size(); ++i) {
        list(i);
    }
}

std::uint64_t TiffPages::heap() const {
    return 2 * buffer_bytes_ + places_.size() * sizeof(Place);
}

std::string TiffPages::name_of_page(std::int64_t page) const {
    return fmt::format("page {}", page);
}

void TiffPages::fail(std::int64_t page, const std::string& what) const {
    throw Error(ErrorKind::corrupt, {files_[open_].string(), name_of_page(page)},
                problem_.empty() ? what : fmt::format("{}: {}", what, problem_));
}

void TiffPages::open(std::uint32_t file) {
    if (file == open_ && file_) {
        return;
    }
    file_.reset();
    current_ = -1;
    regular_file_size(files_[file]);
    const std::unique_ptr<TIFFOpenOptions, decltype(&TIFFOpenOptionsFree)> options(
        TIFFOpenOptionsAlloc(), &TIFFOpenOptionsFree);
    TIFFOpenOptionsSetErrorHandlerExtR(options.get(), &keep_message, &problem_);
    TIFFOpenOptionsSetWarningHandlerExtR(options.get(), &keep_warning, &warning_);
    TIFFOpenOptionsSetMaxSingleMemAlloc(
        options.get(), static_cast<tmsize_t>(std::max<std::uint64_t>(max_heap_, 16U << 20U)));
    problem_.clear();
    warning_.clear();
    file_.reset(TIFFOpenExt(files_[file].c_str(), "rm", options.get()));
    open_ = file;
    if (!file_) {
        throw Error(ErrorKind::corrupt, {files_[file].string()},
                    fmt::format("libtiff cannot open it: {}", problem_));
    }
}

void TiffPages::list(std::uint32_t file) {
    open(file);
    std::int64_t number = 0;
    do {
        if (places_.size() >= kMostPages) {
            throw Error(ErrorKind::unsupported, {files_[file].string()},
                        fmt::format("more than {} pages", kMostPages));
        }
        // Small copies of an image, for viewers, are no slices.
        constexpr std::uint32_t kReduced = 1;
        if ((tag_or<std::uint32_t>(file_.get(), TIFFTAG_SUBFILETYPE, 0) & kReduced) == 0) {
            look_at({file, TIFFCurrentDirOffset(file_.get()), number});
        }
        // What look_at() does not read at all is told first.
        if (!warning_.empty()) {
            fail(number, "its directory is damaged: " + warning_);
        }
        ++number;
        problem_.clear();
    } while (TIFFReadDirectory(file_.get()) == 1);
    if (!problem_.empty()) {
        fail(count(), "its directory cannot be read");
    }
}

std::optional<std::int64_t> TiffPages::page_of(std::size_t file, std::int64_t directory) const {
    const auto found = std::lower_bound(
        places_.begin(), places_.end(), std::pair(file, directory),
        [](const Place& place, const std::pair<std::size_t, std::int64_t>& wanted) {
            return std::pair(std::size_t{place.file}, place.number) < wanted;
        });
    return found != places_.end() && found->file == file && found->number == directory
               ? std::optional<std::int64_t>(found - places_.begin())
               : std::nullopt;
}

void TiffPages::look_at(const Place& place) {
    TIFF* const t = file_.get();
    const std::int64_t number = count();
    TiffPage page;
    page.width = tag_or<std::uint32_t>(t, TIFFTAG_IMAGEWIDTH, 0);
    page.height = tag_or<std::uint32_t>(t, TIFFTAG_IMAGELENGTH, 0);
    page.samples = tag_or<std::uint16_t>(t, TIFFTAG_SAMPLESPERPIXEL, 1);
    const int bits = tag_or<std::uint16_t>(t, TIFFTAG_BITSPERSAMPLE, 1);
    const int format = tag_or<std::uint16_t>(t, TIFFTAG_SAMPLEFORMAT, SAMPLEFORMAT_UINT);
    const auto unsupported = [&](const std::string& what) {
        throw Error(ErrorKind::unsupported, {files_[place.file].string(), name_of_page(number)},
                    what);
    };
    if (page.width < 1 || page.height < 1 || page.samples < 1) {
        fail(number, "it has no size");
    }
    if (format == SAMPLEFORMAT_COMPLEXINT || format == SAMPLEFORMAT_COMPLEXIEEEFP) {
        unsupported("complex numbers");
    }
    if (const auto depth = std::max(tag_or<std::uint32_t>(t, TIFFTAG_IMAGEDEPTH, 1),
                                    tag_or<std::uint32_t>(t, TIFFTAG_TILEDEPTH, 1));
        depth > 1) {
        unsupported(
            fmt::format("{} planes in one page (ImageDepth, TileDepth); write each plane "
                        "to a page of its own",
                        depth));
    }
    const bool is_float = format == SAMPLEFORMAT_IEEEFP;
    const bool is_signed = format == SAMPLEFORMAT_INT;
    if (is_float && bits == 16) {
        page.stored = StoredNumber::f16;
    } else if (!is_float && bits == 64) {
        page.stored = is_signed ? StoredNumber::i64 : StoredNumber::u64;
    } else if (is_float && (bits == 32 || bits == 64)) {
        page.type = bits == 32 ? ValueType::f32 : ValueType::f64;
    } else if (!is_float && bits == 8) {
        page.type = is_signed ? ValueType::i8 : ValueType::u8;
    } else if (!is_float && bits == 16) {
        page.type = is_signed ? ValueType::i16 : ValueType::u16;
    } else if (!is_float && bits == 32) {
        page.type = is_signed ? ValueType::i32 : ValueType::u32;
    } else {
        unsupported(fmt::format("{} bits a value: 8, 16, 32 and 64 are read", bits));
    }
    if (tag_or<std::uint16_t>(t, TIFFTAG_PHOTOMETRIC, PHOTOMETRIC_MINISBLACK) ==
        PHOTOMETRIC_YCBCR) {
        unsupported("colours as brightness and two differences (YCbCr)");
    }
    const auto compression = tag_or<std::uint16_t>(t, TIFFTAG_COMPRESSION, COMPRESSION_NONE);
    if (TIFFIsCODECConfigured(compression) == 0) {
        unsupported(fmt::format("compression {}, which the installed libtiff does not decode",
                                compression));
    }
    if (places_.empty()) {
        page_ = page;
        description_ = [&] {
            const char* text = nullptr;
            return TIFFGetField(t, TIFFTAG_IMAGEDESCRIPTION, &text) == 1 && text != nullptr
                       ? std::string(text)
                       : std::string();
        }();
        planes_of_stack_ = planes_of_metamorph(t);
        resolution_ = {static_cast<double>(tag_or<float>(t, TIFFTAG_XRESOLUTION, 0)),
                       static_cast<double>(tag_or<float>(t, TIFFTAG_YRESOLUTION, 0))};
        if (compression == COMPRESSION_NONE && TIFFIsTiled(t) == 0 &&
            (page.samples == 1 ||
             tag_or<std::uint16_t>(t, TIFFTAG_PLANARCONFIG, PLANARCONFIG_CONTIG) ==
                 PLANARCONFIG_CONTIG)) {
            plain_ = Plain{TIFFGetStrileOffset(t, 0), TIFFIsBigEndian(t) != 0};
        }
    } else if (!(page == page_)) {
        unsupported(fmt::format("it is {}, but the first page is {}", page.text(), page_.text()));
    }
    const bool tiled = TIFFIsTiled(t) != 0;
    const std::int64_t rows = rows_of_part(t, page.height);
    if (rows < 1) {
        fail(number, "its strips have no rows");
    }
    const std::uint64_t row =
        static_cast<std::uint64_t>(page.width * page.samples) * bytes_of(page);
    const auto part = static_cast<std::uint64_t>(
        std::max<tmsize_t>(tiled ? TIFFTileSize(t) : TIFFStripSize(t), 0));
    check_size(static_cast<std::uint64_t>(rows) * row);
    check_size(part);
    buffer_bytes_ = std::max({buffer_bytes_, static_cast<std::uint64_t>(rows) * row, part});
    rows_ = std::max(rows_, rows);
    places_.push_back(place);
}

void TiffPages::check_size(std::uint64_t bytes) const {
    if (bytes > max_heap_ / 2) {
        throw Error(ErrorKind::limit, {files_[open_].string(), name_of_page(count())},
                    fmt::format("rows that are stored together take {} MiB", bytes >> 20U),
                    {{RemedyKind::more_memory}, {RemedyKind::smaller_input_chunk}});
    }
}

void TiffPages::go_to(std::int64_t page) {
    const Place& place = places_[static_cast<std::size_t>(page)];
    open(place.file);
    if (page == current_) {
        return;
    }
    problem_.clear();
    if (TIFFSetSubDirectory(file_.get(), place.directory) != 1) {
        fail(page, "its directory cannot be read");
    }
    TIFF* const t = file_.get();
    current_ = page;
    tiled_ = TIFFIsTiled(t) != 0;
    separate_ = tag_or<std::uint16_t>(t, TIFFTAG_PLANARCONFIG, PLANARCONFIG_CONTIG) ==
                PLANARCONFIG_SEPARATE;
    part_rows_ = rows_of_part(t, page_.height);
    if (part_rows_ < 1 || part_rows_ > rows_ ||
        tag_or<std::uint32_t>(t, TIFFTAG_IMAGEWIDTH, 0) != page_.width ||
        tag_or<std::uint32_t>(t, TIFFTAG_IMAGELENGTH, 0) != page_.height) {
        fail(page, "it has changed since it was looked at");
    }
}

void TiffPages::decode(std::int64_t page, std::int64_t y, std::int64_t sample) {
    go_to(page);
    TIFF* const t = file_.get();
    decoded_page_ = -1;
    problem_.clear();
    const auto row = static_cast<std::uint32_t>(y / part_rows_ * part_rows_);
    const auto plane = static_cast<std::uint16_t>(separate_ ? sample : 0);
    const std::int64_t stored = separate_ ? 1 : page_.samples;
    const std::size_t pixel = static_cast<std::size_t>(stored) * bytes_of(page_);
    const std::size_t row_bytes = static_cast<std::size_t>(page_.width) * pixel;
    const auto rows = static_cast<std::size_t>(std::min(part_rows_, page_.height - row));
    buffer_.resize(rows * row_bytes);
    if (!tiled_) {
        const tmsize_t n = TIFFReadEncodedStrip(t, TIFFComputeStrip(t, row, plane), buffer_.data(),
                                                static_cast<tmsize_t>(buffer_.size()));
        if (n != static_cast<tmsize_t>(buffer_.size())) {
            fail(page, fmt::format("rows from {} on cannot be decoded", row));
        }
    } else {
        const auto width = tag_or<std::uint32_t>(t, TIFFTAG_TILEWIDTH, 1);
        tile_.resize(static_cast<std::size_t>(TIFFTileSize(t)));
        if (width < 1 || tile_.size() < static_cast<std::size_t>(part_rows_) * width * pixel) {
            fail(page, "its tiles have no size");
        }
        for (std::int64_t x = 0; x < page_.width; x += width) {
            const auto number = TIFFComputeTile(t, static_cast<std::uint32_t>(x), row, 0, plane);
            if (TIFFReadEncodedTile(t, number, tile_.data(), static_cast<tmsize_t>(tile_.size())) <
                0) {
                fail(page, fmt::format("the tile at ({}, {}) cannot be decoded", x, row));
            }
            const auto columns =
                static_cast<std::size_t>(std::min<std::int64_t>(width, page_.width - x));
            for (std::size_t r = 0; r < rows; ++r) {
                std::memcpy(buffer_.data() + r * row_bytes + static_cast<std::size_t>(x) * pixel,
                            tile_.data() + r * width * pixel, columns * pixel);
            }
        }
    }
    decoded_page_ = page;
    decoded_from_ = row;
    decoded_sample_ = separate_ ? sample : -1;
}

void TiffPages::read_row(std::int64_t page, std::int64_t y, std::int64_t sample, std::byte* dst) {
    if (page != decoded_page_ || y < decoded_from_ || y >= decoded_from_ + part_rows_ ||
        (decoded_sample_ >= 0 && decoded_sample_ != sample)) {
        decode(page, y, sample);
    }
    const std::size_t value = bytes_of(page_);
    const std::int64_t stored = separate_ ? 1 : page_.samples;
    const std::size_t pixel = static_cast<std::size_t>(stored) * value;
    const std::byte* from =
        buffer_.data() + static_cast<std::size_t>((y - decoded_from_) * page_.width) * pixel;
    if (stored == 1) {
        std::memcpy(dst, from, static_cast<std::size_t>(page_.width) * value);
        return;
    }
    from += static_cast<std::size_t>(sample) * value;
    for (std::int64_t x = 0; x < page_.width; ++x, from += pixel, dst += value) {
        std::memcpy(dst, from, value);
    }
}

}  // namespace isonest::detail
#endif
