#include "preprocess/sources/dicom/dicom_frames.h"

#include <fmt/format.h>

#include <algorithm>
#include <cstdint>
#include <cstring>
#include <string_view>
#include <utility>

#include <isonest/error.h>

#include "preprocess/sources/bytes/header_words.h"
#include "preprocess/sources/numbers/raw_rows.h"

#if ISONEST_WITH_GDCM
#include "preprocess/sources/dicom/module/gdcm_module.h"
#include "preprocess/sources/module_loader.h"
#else

#endif

namespace isonest::detail {
namespace {

constexpr std::size_t kHeader = 64;

/// Decompresses `count` bytes, written `step` apart; false if the segment has fewer.
bool unpack_segment(std::string_view segment, std::size_t count, std::size_t step, std::byte* dst) {
    std::size_t done = 0;
    std::size_t at = 0;
    while (done < count) {
        if (at >= segment.size()) {
            return false;
        }
        const auto control = static_cast<std::int8_t>(segment[at++]);
        if (control >= 0) {  // control + 1 literal bytes
            const auto literal = static_cast<std::size_t>(control) + 1;
            if (literal > segment.size() - at) {
                return false;
            }
            for (std::size_t i = 0; i < std::min(literal, count - done); ++i) {
                dst[(done + i) * step] = static_cast<std::byte>(segment[at + i]);
            }
            at += literal;
            done += literal;
        } else if (control != INT8_MIN) {  // repeats the next byte 1 - control times
            if (at >= segment.size()) {
                return false;
            }
            const auto repeated = static_cast<std::size_t>(1 - control);
            for (std::size_t i = 0; i < std::min(repeated, count - done); ++i) {
                dst[(done + i) * step] = static_cast<std::byte>(segment[at]);
            }
            ++at;
            done += repeated;
        }
    }
    return true;
}

}  // namespace

std::string unpack_dicom_rle(std::span<const char> frame, std::size_t size,
                             std::span<std::byte> dst) {
    const std::string_view text(frame.data(), frame.size());
    if (text.size() < kHeader) {
        return "the frame ends inside its list of segments";
    }
    const auto segments = number_at<std::uint32_t>(text, 0, false);
    if (segments != size) {
        return fmt::format("the frame has {} segments, but its numbers have {} bytes", segments,
                           size);
    }
    for (std::size_t s = 0; s < size; ++s) {
        const std::size_t begin = number_at<std::uint32_t>(text, 4 + 4 * s, false);
        const std::size_t end =
            s + 1 < size ? number_at<std::uint32_t>(text, 8 + 4 * s, false) : text.size();
        if (begin < kHeader || begin > end || end > text.size()) {
            return fmt::format("segment {} has an invalid position: bytes {} to {} of {}", s, begin,
                               end, text.size());
        }
        // The most significant byte comes first.
        if (!unpack_segment(text.substr(begin, end - begin), dst.size() / size, size,
                            dst.data() + size - 1 - s)) {
            return fmt::format("segment {} is cut short", s);
        }
    }
    return {};
}

namespace {

/// Needs no other library.
bool is_rle(const std::string& syntax) {
    return syntax == "1.2.840.10008.1.2.5";
}

std::string unpack_rle(const DicomNumbers& numbers, std::span<const char> frame,
                       std::span<std::byte> dst) {
    return unpack_dicom_rle(frame, static_cast<std::size_t>(numbers.allocated / 8), dst);
}

}  // namespace

#if ISONEST_WITH_GDCM

bool dicom_codec_is_built() {
    return true;
}

std::string unpack_dicom_frame(const std::string& syntax, const DicomNumbers& numbers,
                               std::span<const char> frame, std::span<std::byte> dst,
                               const std::string& name) {
    if (is_rle(syntax)) {
        return unpack_rle(numbers, frame, dst);
    }
    static const auto unpack = reinterpret_cast<decltype(&isonest_unpack_dicom)>(
        load_from_module({"isonest_gdcm.so", "decodes JPEG frames of DICOM", "isonest",
                          "libgdcm-dev libopenjp2-7-dev"},
                         "isonest_unpack_dicom", name));
    std::string problem;
    unpack(syntax, numbers, frame, dst, name, problem);
    return problem;
}

#else

bool dicom_codec_is_built() {
    return false;
}

std::string unpack_dicom_frame(const std::string& syntax, const DicomNumbers& numbers,
                               std::span<const char> frame, std::span<std::byte> dst,
                               const std::string& name) {
    if (is_rle(syntax)) {
        return unpack_rle(numbers, frame, dst);
    }
    throw Error(ErrorKind::unsupported, {name},
                fmt::format("the pixel data are compressed with transfer syntax {}, which this "
                            "build does not support",
                            syntax),
                {{RemedyKind::install_package, "libgdcm-dev libopenjp2-7-dev"}});
}

#endif

namespace {

constexpr std::size_t kMaxFragments = 4000000;

}  // namespace

DicomFrames::DicomFrames(std::vector<std::filesystem::path> files, const DicomNumbers& numbers)
    : files_(std::move(files)), numbers_(numbers), stored_(numbers.whole_image()) {}

std::uint64_t DicomFrames::heap() const {
    // Compressed frames are hardly larger than decompressed ones; a decoder holds 32-bit numbers.
    return 8 * static_cast<std::uint64_t>(stored_.columns * stored_.rows) +
           4 * stored_.frame_bytes();
}

void DicomFrames::open(std::uint32_t file) {
    if (file == current_) {
        return;
    }
    current_ = ~std::uint32_t{0};
    unpacked_frame_ = -1;
    file_ = std::make_unique<DicomFile>(files_[file]);
    header_ = {};
    read_dicom_header(*file_, ~std::uint64_t{0}, header_);
    header_.per_frame = {};
    if (header_.pixels.tag == 0 || header_.numbers != numbers_) {
        file_->fail(0, "the file changed while it was being read");
    }
    if (file_->syntax().native) {
        const std::uint64_t need = stored_.bytes_of(images());
        if (header_.pixels.length < need) {
            file_->fail(
                header_.pixels.at,
                fmt::format("{} frames of {} x {} pixels need {} bytes, but there are only {}",
                            images(), stored_.columns, stored_.rows, need, header_.pixels.length));
        }
        if (file_->syntax().big_endian && header_.pixels.vr == "OW" && numbers_.allocated <= 8) {
            throw Error(ErrorKind::unsupported, {file_->name()},
                        "8-bit numbers in big-endian 16-bit words are not supported; convert the "
                        "file, for example with gdcmconv");
        }
    } else if (numbers_.allocated == 1) {
        throw Error(
            ErrorKind::unsupported, {file_->name()},
            fmt::format("single-bit pixels compressed with transfer syntax {} are not supported",
                        file_->syntax().uid));
    } else {
        find_frames(file_->fragments(header_.pixels, kMaxFragments));
    }
    current_ = file;
}

/// PS3.5, A.4: one fragment per frame, or all fragments for a single frame, or by the offset table.
void DicomFrames::find_frames(const std::vector<DicomElement>& fragments) {
    const auto frames = static_cast<std::size_t>(images());
    first_.clear();
    if (fragments.empty()) {
        file_->fail(header_.pixels.at, "the pixel data have no offset table");
    }
    fragments_.assign(fragments.begin() + 1, fragments.end());
    if (fragments_.size() == frames) {
        for (std::size_t i = 0; i <= frames; ++i) {
            first_.push_back(i);
        }
        return;
    }
    if (frames == 1 && !fragments_.empty()) {
        first_ = {0, fragments_.size()};
        return;
    }
    const DicomElement& table = fragments[0];
    if (table.length != 4 * frames) {
        file_->fail(
            table.at,
            fmt::format(
                "there are {} fragments and {} frames, but no valid offset table that assigns them",
                fragments_.size(), frames));
    }
    // Offsets are relative to the first fragment's header.
    for (std::size_t i = 0; i < frames; ++i) {
        const std::uint64_t head =
            table.at + table.length + 8 +
            number_at<std::uint32_t>(file_->bytes(table.at + 4 * i, 4), 0, false);
        const auto found = std::lower_bound(
            fragments_.begin(), fragments_.end(), head,
            [](const DicomElement& fragment, std::uint64_t at) { return fragment.at < at; });
        const auto index = static_cast<std::size_t>(found - fragments_.begin());
        if (found == fragments_.end() || found->at != head ||
            (i == 0 ? index != 0 : index <= first_.back())) {
            file_->fail(
                table.at,
                fmt::format("the offset of frame {} does not point to the beginning of a fragment",
                            i));
        }
        first_.push_back(index);
    }
    first_.push_back(fragments_.size());
}

void DicomFrames::unpack(std::int64_t frame) {
    if (frame == unpacked_frame_) {
        return;
    }
    unpacked_frame_ = -1;
    std::uint64_t bytes = 0;
    for (std::size_t i = first_[static_cast<std::size_t>(frame)];
         i < first_[static_cast<std::size_t>(frame) + 1]; ++i) {
        bytes += fragments_[i].length;
    }
    // Normally compressed frames are smaller; allow for incompressible ones.
    const std::uint64_t most = 2 * stored_.frame_bytes() + 65536;
    if (bytes > most || bytes > 0xFFFFFFFE) {
        file_->fail(header_.pixels.at,
                    fmt::format("frame {} has {} compressed bytes, but only {} uncompressed bytes",
                                frame, bytes, stored_.frame_bytes()));
    }
    packed_.resize(bytes);
    std::uint64_t at = 0;
    for (std::size_t i = first_[static_cast<std::size_t>(frame)];
         i < first_[static_cast<std::size_t>(frame) + 1]; ++i) {
        file_->read(fragments_[i].at, reinterpret_cast<std::byte*>(packed_.data() + at),
                    fragments_[i].length);
        at += fragments_[i].length;
    }
    unpacked_.resize(stored_.frame_bytes());
    const std::string problem =
        unpack_dicom_frame(file_->syntax().uid, stored_, packed_, unpacked_, file_->name());
    if (!problem.empty()) {
        throw Error(ErrorKind::corrupt, {file_->name(), fmt::format("frame {}", frame)}, problem,
                    {{RemedyKind::good_copy}});
    }
    unpacked_frame_ = frame;
}

/// Extracts the stored bits, with sign extension, from the allocated ones.
void DicomFrames::mend_bits(std::byte* data, std::size_t count) const {
    if (numbers_.floating || numbers_.stored == numbers_.allocated) {
        return;
    }
    const auto shift = static_cast<unsigned>(numbers_.high + 1 - numbers_.stored);
    const auto unused = static_cast<unsigned>(32 - numbers_.stored);
    const auto size = static_cast<std::size_t>(numbers_.allocated / 8);
    for (std::size_t i = 0; i < count; ++i) {
        std::uint32_t bits = 0;
        std::memcpy(&bits, data + i * size, size);
        bits = bits >> shift << unused;
        bits = numbers_.is_signed
                   ? static_cast<std::uint32_t>(static_cast<std::int32_t>(bits) >> unused)
                   : bits >> unused;
        std::memcpy(data + i * size, &bits, size);
    }
}

void DicomFrames::use_table(const std::byte* stored, std::size_t count, std::byte* values) const {
    const std::vector<std::uint16_t>& table = header_.table.values;
    const auto last = static_cast<std::int64_t>(table.size()) - 1;
    const std::size_t size = size_of(numbers_.value_type());
    dispatch(numbers_.type(), [&](auto tag) {
        using T = typename decltype(tag)::type;
        for (std::size_t i = 0; i < count; ++i) {
            T number{};
            std::memcpy(&number, stored + i * sizeof(T), sizeof(T));
            const std::int64_t at = static_cast<std::int64_t>(number) - header_.table.first;
            const std::uint16_t value =
                table[static_cast<std::size_t>(std::clamp<std::int64_t>(at, 0, last))];
            // For 8-bit values, the lower byte, which comes first (little-endian machines).
            std::memcpy(values + i * size, &value, size);
        }
    });
}

/// Single bits, lowest bit of each byte first.
void DicomFrames::read_bits(std::uint64_t first, std::size_t count, std::byte* dst) {
    constexpr std::uint64_t kBits = 8;
    packed_.resize((first + count + kBits - 1) / kBits - first / kBits);
    file_->read(header_.pixels.at + first / kBits, reinterpret_cast<std::byte*>(packed_.data()),
                packed_.size());
    for (std::size_t i = 0; i < count; ++i) {
        const std::uint64_t bit = first % kBits + i;
        dst[i] = static_cast<std::byte>(
            static_cast<unsigned char>(packed_[bit / kBits]) >> bit % kBits & 1U);
    }
}

void DicomFrames::read_pixels(std::int64_t image, std::uint64_t first, std::size_t count,
                              std::byte* dst) {
    const auto size = static_cast<std::size_t>(numbers_.allocated / 8);
    if (file_->syntax().native) {
        file_->read(header_.pixels.at + static_cast<std::uint64_t>(image) * stored_.frame_bytes() +
                        first * size,
                    dst, count * size);
        if (file_->syntax().big_endian) {
            swap_bytes(dst, count * size, size);
        }
    } else {
        unpack(image);
        std::memcpy(dst, unpacked_.data() + first * size, count * size);
    }
}

void DicomFrames::read_stored(std::int64_t frame, std::int64_t y0, std::int64_t ny,
                              std::byte* dst) {
    const auto width = static_cast<std::uint64_t>(numbers_.columns);
    const auto pixels = static_cast<std::uint64_t>(numbers_.columns * numbers_.rows);
    const auto first = static_cast<std::uint64_t>(y0) * width;
    const std::size_t count = static_cast<std::size_t>(ny) * width;
    if (numbers_.allocated == 1) {
        read_bits(static_cast<std::uint64_t>(frame) * pixels + first, count, dst);
    } else if (numbers_.mosaic == 1) {
        read_pixels(frame, first, count, dst);
    } else {
        const std::int64_t top = frame / numbers_.mosaic * numbers_.rows + y0;
        const std::int64_t left = frame % numbers_.mosaic * numbers_.columns;
        const std::size_t row = width * static_cast<std::size_t>(numbers_.allocated / 8);
        for (std::int64_t y = 0; y < ny; ++y, dst += row) {
            read_pixels(0, static_cast<std::uint64_t>((top + y) * stored_.columns + left), width,
                        dst);
        }
    }
}

void DicomFrames::read(std::uint32_t file, std::int64_t frame, std::int64_t y0, std::int64_t ny,
                       std::byte* dst) {
    open(file);
    const auto count = static_cast<std::size_t>(ny * numbers_.columns);
    // Stored numbers are read into the end of the space for the values, which are at least as
    // large.
    std::byte* const values = dst;
    dst += count * (size_of(numbers_.value_type()) - size_of(numbers_.type()));
    read_stored(frame, y0, ny, dst);
    mend_bits(dst, count);
    if (numbers_.table_bits != 0) {
        use_table(dst, count, values);
    }
}

}  // namespace isonest::detail
