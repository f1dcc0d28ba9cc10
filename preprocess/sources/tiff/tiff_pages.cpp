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

#include "preprocess/sources/bytes/input_file.h"

namespace isonest::detail {
namespace {

constexpr std::size_t kMaxPages = 1000000;

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

/// Keeps warnings about tags that were ignored, or read despite a wrong type, if they change the
/// meaning of numbers.
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

/// Bytes of `columns` values of a row, with `samples` samples per pixel.
std::size_t stored_bytes(const TiffPage& page, std::int64_t columns, std::int64_t samples) {
    return page.bits ? static_cast<std::size_t>((columns + 7) / 8)
                     : static_cast<std::size_t>(columns * samples) * bytes_of(page);
}

/// MetaMorph's tag UIC2 contains one number per plane.
std::int64_t planes_of_metamorph(TIFF* file) {
    constexpr std::uint32_t kUic2 = 33629;
    std::uint32_t count = 0;
    const void* numbers = nullptr;
    const bool has = TIFFGetField(file, kUic2, &count, &numbers) == 1 &&
                     TIFFFieldDataType(TIFFFieldWithTag(file, kUic2)) == TIFF_RATIONAL;
    return has ? std::max<std::int64_t>(count, 1) : 1;
}

/// Rows of the page in one strip, or in a row of tiles, which may be taller than the page.
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
                       bits                           ? "bits"
                       : !stored                      ? std::string(name_of(type))
                       : *stored == StoredNumber::f16 ? "float16"
                       : *stored == StoredNumber::i64 ? "int64"
                                                      : "uint64");
}

TiffPages::TiffPages(std::vector<std::filesystem::path> files, std::uint64_t max_heap)
    : files_(std::move(files)), max_heap_(max_heap) {
    for (std::uint32_t i = 0; i < files_.size(); ++i) {
        list(i);
    }
    choose();
    read_first();
    note_what_is_left_out();
}

std::uint64_t TiffPages::heap() const {
    return 2 * buffer_bytes_ + places_.size() * sizeof(Place);
}

void TiffPages::fail(const Place& place, const std::string& what) const {
    throw Error(ErrorKind::corrupt,
                {files_[place.file].string(), fmt::format("page {}", place.number)},
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
    Place place{file, 0, 0};
    do {
        if (seen_.size() >= kMaxPages) {
            throw Error(ErrorKind::unsupported, {files_[file].string()},
                        fmt::format("there are more than {} pages, which is the limit", kMaxPages));
        }
        place.directory = TIFFCurrentDirOffset(file_.get());
        const auto kind = tag_or<std::uint32_t>(file_.get(), TIFFTAG_SUBFILETYPE, 0);
        const auto old = tag_or<std::uint16_t>(file_.get(), TIFFTAG_OSUBFILETYPE, 0);
        // Reduced copies of an image, for viewers, and masks are not slices.
        if ((kind & FILETYPE_REDUCEDIMAGE) != 0 || old == OFILETYPE_REDUCEDIMAGE) {
            leave_out(place, "a reduced image");
        } else if ((kind & FILETYPE_MASK) != 0) {
            leave_out(place, "a mask");
        } else {
            look_at(place);
            if (!warning_.empty()) {
                fail(place, "the directory is damaged: " + warning_);
            }
        }
        warning_.clear();
        ++place.number;
        problem_.clear();
    } while (TIFFReadDirectory(file_.get()) == 1);
    if (!problem_.empty()) {
        fail(place, "the directory cannot be read");
    }
}

void TiffPages::leave_out(const Place& place, const std::string& why) {
    constexpr std::size_t kListed = 5;
    if (left_out_count_++ < kListed) {
        left_out_.push_back(fmt::format(
            "{}page {} ({})",
            files_.size() > 1 ? files_[place.file].filename().string() + ", " : std::string(),
            place.number, why));
    }
}

void TiffPages::note_what_is_left_out() {
    if (left_out_count_ == 0) {
        return;
    }
    std::string text;
    for (const std::string& page : left_out_) {
        text += (text.empty() ? "" : ", ") + page;
    }
    if (left_out_count_ > left_out_.size()) {
        text += fmt::format(" and {} more", left_out_count_ - left_out_.size());
    }
    notes_.push_back(fmt::format("{} page{} left out: {}", left_out_count_,
                                 left_out_count_ == 1 ? " is" : "s are", text));
}

/// Previews are at most half as wide and as high as the pages that they show, and come before or
/// after them in a file.
void TiffPages::choose() {
    const auto area = [](const Kind& kind) {
        return static_cast<double>(kind.page.width) * static_cast<double>(kind.page.height);
    };
    if (kinds_.empty()) {
        throw Error(ErrorKind::unsupported, {files_.front().string()},
                    "all pages are reduced images or masks");
    }
    const auto main =
        std::max_element(kinds_.begin(), kinds_.end(), [&](const Kind& a, const Kind& b) {
            return a.count != b.count ? a.count < b.count : area(a) < area(b);
        });
    const auto main_kind = static_cast<std::uint32_t>(main - kinds_.begin());
    const auto refuse = [&](const Place& place, const std::string& problem) {
        throw Error(ErrorKind::unsupported,
                    {files_[place.file].string(), fmt::format("page {}", place.number)}, problem);
    };
    const auto is_main = [&](const Seen& s) { return s.kind == main_kind; };
    if (!main->problem.empty()) {
        refuse(std::find_if(seen_.begin(), seen_.end(), is_main)->place, main->problem);
    }
    for (auto from = seen_.begin(); from != seen_.end();) {
        const auto to = std::find_if(
            from, seen_.end(), [&](const Seen& s) { return s.place.file != from->place.file; });
        const auto first = std::find_if(from, to, is_main);
        auto last = to;
        while (last != first && !is_main(*(last - 1))) {
            --last;
        }
        for (auto s = from; s != to; ++s) {
            const Kind& kind = kinds_[s->kind];
            if (is_main(*s)) {
                places_.push_back(s->place);
                continue;
            }
            const bool is_outside = first != to && (s < first || s >= last);
            if (!is_outside || 2 * kind.page.width > main->page.width ||
                2 * kind.page.height > main->page.height) {
                refuse(s->place,
                       kind.problem.empty()
                           ? fmt::format("it is {}, but {} {}", kind.page.text(),
                                         main->count > 1 ? "most pages are" : "another page is",
                                         main->page.text())
                           : kind.problem);
            }
            leave_out(s->place, fmt::format("a preview of {}", kind.page.text()));
        }
        from = to;
    }
    page_ = main->page;
    rows_ = main->rows;
    buffer_bytes_ = main->bytes;
    if (main->bytes > max_heap_ / 2) {
        throw Error(
            ErrorKind::limit,
            {files_[main->largest.file].string(), fmt::format("page {}", main->largest.number)},
            fmt::format("rows that are stored together need {} MiB of memory", main->bytes >> 20U),
            {{RemedyKind::more_memory}, {RemedyKind::smaller_input_chunk}});
    }
    seen_ = {};
    kinds_ = {};
}

/// Reads what the first page says about all pages.
void TiffPages::read_first() {
    const auto description_at = [this] {
        const char* text = nullptr;
        return TIFFGetField(file_.get(), TIFFTAG_IMAGEDESCRIPTION, &text) == 1 && text != nullptr
                   ? std::string(text)
                   : std::string();
    };
    go_to_directory(places_.front());
    TIFF* const t = file_.get();
    description_ = description_at();
    planes_of_stack_ = planes_of_metamorph(t);
    resolution_ = {static_cast<double>(tag_or<float>(t, TIFFTAG_XRESOLUTION, 0)),
                   static_cast<double>(tag_or<float>(t, TIFFTAG_YRESOLUTION, 0))};
    if (tag_or<std::uint16_t>(t, TIFFTAG_COMPRESSION, COMPRESSION_NONE) == COMPRESSION_NONE &&
        TIFFIsTiled(t) == 0 && !page_.bits &&
        (page_.samples == 1 || tag_or<std::uint16_t>(t, TIFFTAG_PLANARCONFIG,
                                                     PLANARCONFIG_CONTIG) == PLANARCONFIG_CONTIG)) {
        plain_ = Plain{TIFFGetStrileOffset(t, 0), TIFFIsBigEndian(t) != 0};
    }
    if (tag_or<std::uint16_t>(t, TIFFTAG_PHOTOMETRIC, PHOTOMETRIC_MINISBLACK) ==
        PHOTOMETRIC_MINISWHITE) {
        notes_.emplace_back(
            "larger values are displayed darker (MinIsWhite); the values are kept as stored");
    }
    // The description of a file may be in its preview.
    if (description_.empty() && places_.front().number > 0 && TIFFSetDirectory(t, 0) == 1) {
        description_ = description_at();
    }
    current_ = -1;
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
    constexpr std::size_t kMaxKinds = 1000;
    Kind kind = kind_of(place);
    const auto same = [&](const Kind& k) {
        return k.page == kind.page && k.problem == kind.problem;
    };
    // Consecutive pages are usually alike.
    auto found = !seen_.empty() && same(kinds_[seen_.back().kind])
                     ? kinds_.begin() + seen_.back().kind
                     : std::find_if(kinds_.begin(), kinds_.end(), same);
    if (found == kinds_.end()) {
        if (kinds_.size() >= kMaxKinds) {
            throw Error(
                ErrorKind::unsupported, {files_[place.file].string()},
                fmt::format("the pages have more than {} different sizes or types", kMaxKinds));
        }
        kinds_.push_back(kind);
        found = kinds_.end() - 1;
    }
    ++found->count;
    found->rows = std::max(found->rows, kind.rows);
    if (kind.bytes > found->bytes || found->count == 1) {
        found->bytes = kind.bytes;
        found->largest = place;
    }
    seen_.push_back({place, static_cast<std::uint32_t>(found - kinds_.begin())});
}

TiffPages::Kind TiffPages::kind_of(const Place& place) {
    TIFF* const t = file_.get();
    Kind kind;
    TiffPage& page = kind.page;
    page.width = tag_or<std::uint32_t>(t, TIFFTAG_IMAGEWIDTH, 0);
    page.height = tag_or<std::uint32_t>(t, TIFFTAG_IMAGELENGTH, 0);
    page.samples = tag_or<std::uint16_t>(t, TIFFTAG_SAMPLESPERPIXEL, 1);
    const int bits = tag_or<std::uint16_t>(t, TIFFTAG_BITSPERSAMPLE, 1);
    const int format = tag_or<std::uint16_t>(t, TIFFTAG_SAMPLEFORMAT, SAMPLEFORMAT_UINT);
    if (page.width < 1 || page.height < 1 || page.samples < 1) {
        fail(place, "the page has no width, height or samples");
    }
    const auto depth = std::max(tag_or<std::uint32_t>(t, TIFFTAG_IMAGEDEPTH, 1),
                                tag_or<std::uint32_t>(t, TIFFTAG_TILEDEPTH, 1));
    const auto compression = tag_or<std::uint16_t>(t, TIFFTAG_COMPRESSION, COMPRESSION_NONE);
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
    } else if (bits == 1 && page.samples == 1) {
        page.bits = true;
    } else {
        kind.problem =
            fmt::format("{} bits per value are not supported; 1, 8, 16, 32 and 64 are", bits);
    }
    if (format == SAMPLEFORMAT_COMPLEXINT || format == SAMPLEFORMAT_COMPLEXIEEEFP) {
        kind.problem = "complex numbers are not supported";
    } else if (depth > 1) {
        kind.problem = fmt::format(
            "the page has {} planes (ImageDepth, TileDepth); write each plane to a separate page",
            depth);
    } else if (kind.problem.empty() &&
               tag_or<std::uint16_t>(t, TIFFTAG_PHOTOMETRIC, PHOTOMETRIC_MINISBLACK) ==
                   PHOTOMETRIC_YCBCR) {
        kind.problem = "YCbCr colours are not supported";
    } else if (kind.problem.empty() && TIFFIsCODECConfigured(compression) == 0) {
        kind.problem =
            fmt::format("the installed libtiff cannot decode compression {}", compression);
    }
    const bool tiled = TIFFIsTiled(t) != 0;
    if (tiled && page.bits && tag_or<std::uint32_t>(t, TIFFTAG_TILEWIDTH, 1) % 8 != 0) {
        kind.problem = "single bits in tiles whose width is not a multiple of 8 are not supported";
    }
    if (!kind.problem.empty()) {
        return kind;
    }
    kind.rows = rows_of_part(t, page.height);
    if (kind.rows < 1) {
        fail(place, "the strips have no rows");
    }
    const auto part = static_cast<std::uint64_t>(
        std::max<tmsize_t>(tiled ? TIFFTileSize(t) : TIFFStripSize(t), 0));
    kind.bytes = std::max(
        static_cast<std::uint64_t>(kind.rows) * stored_bytes(page, page.width, page.samples), part);
    return kind;
}

void TiffPages::go_to_directory(const Place& place) {
    open(place.file);
    problem_.clear();
    if (TIFFSetSubDirectory(file_.get(), place.directory) != 1) {
        fail(place, "the directory cannot be read");
    }
}

void TiffPages::go_to(std::int64_t page) {
    open(at(page).file);
    if (page == current_) {
        return;
    }
    go_to_directory(at(page));
    TIFF* const t = file_.get();
    current_ = page;
    tiled_ = TIFFIsTiled(t) != 0;
    separate_ = tag_or<std::uint16_t>(t, TIFFTAG_PLANARCONFIG, PLANARCONFIG_CONTIG) ==
                PLANARCONFIG_SEPARATE;
    part_rows_ = rows_of_part(t, page_.height);
    if (part_rows_ < 1 || part_rows_ > rows_ ||
        tag_or<std::uint32_t>(t, TIFFTAG_IMAGEWIDTH, 0) != page_.width ||
        tag_or<std::uint32_t>(t, TIFFTAG_IMAGELENGTH, 0) != page_.height) {
        fail(at(page), "the file has changed since it was opened");
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
    const std::size_t row_bytes = stored_bytes(page_, page_.width, stored);
    const auto rows = static_cast<std::size_t>(std::min(part_rows_, page_.height - row));
    buffer_.resize(rows * row_bytes);
    if (!tiled_) {
        const tmsize_t n = TIFFReadEncodedStrip(t, TIFFComputeStrip(t, row, plane), buffer_.data(),
                                                static_cast<tmsize_t>(buffer_.size()));
        if (n != static_cast<tmsize_t>(buffer_.size())) {
            fail(at(page), fmt::format("the rows from {} on cannot be decoded", row));
        }
    } else {
        const auto width = tag_or<std::uint32_t>(t, TIFFTAG_TILEWIDTH, 1);
        tile_.resize(static_cast<std::size_t>(TIFFTileSize(t)));
        const std::size_t tile_row = stored_bytes(page_, width, stored);
        if (width < 1 || tile_.size() < static_cast<std::size_t>(part_rows_) * tile_row) {
            fail(at(page), "the tiles have no size");
        }
        for (std::int64_t x = 0; x < page_.width; x += width) {
            const auto number = TIFFComputeTile(t, static_cast<std::uint32_t>(x), row, 0, plane);
            if (TIFFReadEncodedTile(t, number, tile_.data(), static_cast<tmsize_t>(tile_.size())) <
                0) {
                fail(at(page), fmt::format("the tile at ({}, {}) cannot be decoded", x, row));
            }
            const auto columns = std::min<std::int64_t>(width, page_.width - x);
            for (std::size_t r = 0; r < rows; ++r) {
                std::memcpy(buffer_.data() + r * row_bytes + stored_bytes(page_, x, stored),
                            tile_.data() + r * tile_row, stored_bytes(page_, columns, stored));
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
    const std::byte* from = buffer_.data() + static_cast<std::size_t>(y - decoded_from_) *
                                                 stored_bytes(page_, page_.width, stored);
    if (page_.bits) {  // highest bit first, whatever the file's fill order is
        for (std::int64_t x = 0; x < page_.width; ++x) {
            dst[x] = from[x / 8] >> static_cast<unsigned>(7 - x % 8) & std::byte{1};
        }
        return;
    }
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
