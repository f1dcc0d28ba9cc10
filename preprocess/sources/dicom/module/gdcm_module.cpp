// Decodes JPEG, JPEG-LS and JPEG 2000 frames, in a separate module: GDCM fills tables when it is
// loaded, which takes as long as the rest of the program's start.

#include "preprocess/sources/dicom/module/gdcm_module.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <gdcmDataElement.h>
#include <gdcmFragment.h>
#include <gdcmJPEGCodec.h>
#include <gdcmJPEGLSCodec.h>
#include <gdcmSequenceOfFragments.h>
#include <gdcmTrace.h>
#include <gdcmTransferSyntax.h>
#include <openjpeg.h>
#include <sys/mman.h>
#include <sys/prctl.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <csignal>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <string_view>

#include <isonest/error.h>

#include "preprocess/sources/bytes/header_words.h"
#include "preprocess/sources/dicom/dicom_header.h"

namespace isonest::detail {

// The size in the header of a JPEG, JPEG-LS or JPEG 2000 stream: ISO/IEC 10918-1 B.2.2 (frame
// header), 14495-1 C.2.2 (SOF55), 15444-1 A.5.1 (SIZ).

struct CodestreamSize {
    std::int64_t columns = 0;
    std::int64_t rows = 0;
    int components = 0;
    int bits = 0;  ///< per number
};

/// Whether this is a JPEG 2000 stream without the boxes of a file.
bool is_jpeg2000(std::span<const char> stream);
/// None if the stream is of another kind or ends before its size. No I/O.
std::optional<CodestreamSize> codestream_size(std::span<const char> stream);

// JPEG 2000 frames, decoded by OpenJPEG, which also supports High-Throughput JPEG 2000.

/// Like unpack_dicom_frame(), for a stream whose size was checked.
std::string unpack_jpeg2000(std::span<const char> frame, const DicomNumbers& numbers,
                            std::span<std::byte> dst);

namespace {

std::string_view text(std::span<const char> stream) {
    return {stream.data(), stream.size()};
}

std::optional<CodestreamSize> jpeg2000_size(std::string_view s) {
    constexpr std::size_t kSiz = 2;  // after SOC
    if (s.size() < kSiz + 41 || number_at<std::uint16_t>(s, kSiz, true) != 0xFF51) {
        return std::nullopt;
    }
    const auto at = [&](std::size_t offset) {
        return static_cast<std::int64_t>(number_at<std::uint32_t>(s, kSiz + offset, true));
    };
    CodestreamSize size;
    size.columns = at(6) - at(14);
    size.rows = at(10) - at(18);
    size.components = number_at<std::uint16_t>(s, kSiz + 38, true);
    size.bits = (static_cast<unsigned char>(s[kSiz + 40]) & 0x7F) + 1;
    return size;
}

bool is_frame_header(unsigned marker) {
    constexpr unsigned kHuffmanTable = 0xFFC4;
    constexpr unsigned kReserved = 0xFFC8;
    constexpr unsigned kArithmetic = 0xFFCC;
    constexpr unsigned kJpegLs = 0xFFF7;
    return marker == kJpegLs || (marker >= 0xFFC0 && marker <= 0xFFCF && marker != kHuffmanTable &&
                                 marker != kReserved && marker != kArithmetic);
}

std::optional<CodestreamSize> jpeg_size(std::string_view s) {
    std::size_t at = 2;  // after SOI
    while (at + 10 <= s.size()) {
        const unsigned marker = number_at<std::uint16_t>(s, at, true);
        if (marker == 0xFFFF) {  // a fill byte
            ++at;
            continue;
        }
        const std::size_t length = number_at<std::uint16_t>(s, at + 2, true);
        if (marker >> 8U != 0xFF || length < 2) {
            return std::nullopt;
        }
        if (is_frame_header(marker)) {
            CodestreamSize size;
            size.bits = static_cast<unsigned char>(s[at + 4]);
            size.rows = number_at<std::uint16_t>(s, at + 5, true);
            size.columns = number_at<std::uint16_t>(s, at + 7, true);
            size.components = static_cast<unsigned char>(s[at + 9]);
            return size;
        }
        at += 2 + length;
    }
    return std::nullopt;
}

}  // namespace

bool is_jpeg2000(std::span<const char> stream) {
    return text(stream).starts_with("\xFF\x4F");
}

std::optional<CodestreamSize> codestream_size(std::span<const char> stream) {
    if (is_jpeg2000(stream)) {
        return jpeg2000_size(text(stream));
    }
    return text(stream).starts_with("\xFF\xD8") ? jpeg_size(text(stream)) : std::nullopt;
}

namespace {

/// The remaining bytes of the frame.
struct Rest {
    std::span<const char> bytes;
    std::size_t at = 0;
};

OPJ_SIZE_T read_rest(void* dst, OPJ_SIZE_T bytes, void* user) {
    Rest& rest = *static_cast<Rest*>(user);
    const std::size_t count = std::min<std::size_t>(bytes, rest.bytes.size() - rest.at);
    if (count == 0) {
        return static_cast<OPJ_SIZE_T>(-1);
    }
    std::memcpy(dst, rest.bytes.data() + rest.at, count);
    rest.at += count;
    return count;
}

OPJ_OFF_T skip(OPJ_OFF_T bytes, void* user) {
    Rest& rest = *static_cast<Rest*>(user);
    const auto left = static_cast<OPJ_OFF_T>(rest.bytes.size() - rest.at);
    const OPJ_OFF_T count = std::clamp<OPJ_OFF_T>(bytes, 0, left);
    rest.at += static_cast<std::size_t>(count);
    return count;
}

OPJ_BOOL seek(OPJ_OFF_T at, void* user) {
    Rest& rest = *static_cast<Rest*>(user);
    if (at < 0 || static_cast<std::size_t>(at) > rest.bytes.size()) {
        return OPJ_FALSE;
    }
    rest.at = static_cast<std::size_t>(at);
    return OPJ_TRUE;
}

template <class T>
void put(const opj_image_comp_t& component, std::span<std::byte> dst) {
    for (std::size_t i = 0; i < dst.size() / sizeof(T); ++i) {
        const T value = static_cast<T>(component.data[i]);
        std::memcpy(dst.data() + i * sizeof(T), &value, sizeof(T));
    }
}

}  // namespace

std::string unpack_jpeg2000(std::span<const char> frame, const DicomNumbers& numbers,
                            std::span<std::byte> dst) {
    Rest rest{frame};
    const std::unique_ptr<opj_codec_t, void (*)(opj_codec_t*)> codec(
        opj_create_decompress(OPJ_CODEC_J2K), opj_destroy_codec);
    const std::unique_ptr<opj_stream_t, void (*)(opj_stream_t*)> stream(
        opj_stream_create(frame.size(), OPJ_TRUE), opj_stream_destroy);
    opj_dparameters_t parameters;
    opj_set_default_decoder_parameters(&parameters);
    if (!codec || !stream || opj_setup_decoder(codec.get(), &parameters) == OPJ_FALSE) {
        return "OpenJPEG is out of memory";
    }
    opj_stream_set_read_function(stream.get(), read_rest);
    opj_stream_set_skip_function(stream.get(), skip);
    opj_stream_set_seek_function(stream.get(), seek);
    opj_stream_set_user_data(stream.get(), &rest, nullptr);
    opj_stream_set_user_data_length(stream.get(), frame.size());
    opj_image_t* header = nullptr;
    const OPJ_BOOL read = opj_read_header(stream.get(), codec.get(), &header);
    const std::unique_ptr<opj_image_t, void (*)(opj_image_t*)> image(header, opj_image_destroy);
    if (read == OPJ_FALSE || opj_decode(codec.get(), stream.get(), image.get()) == OPJ_FALSE) {
        return "the frame's JPEG 2000 stream cannot be decoded";
    }
    const opj_image_comp_t& component = image->comps[0];
    if (image->numcomps != 1 || component.data == nullptr || component.w != numbers.columns ||
        component.h != numbers.rows) {
        return "the frame's JPEG 2000 stream does not have the size in its header";
    }
    switch (numbers.allocated) {
        case 8:
            put<std::uint8_t>(component, dst);
            break;
        case 16:
            put<std::uint16_t>(component, dst);
            break;
        default:
            put<std::uint32_t>(component, dst);
            break;
    }
    return {};
}

namespace {

/// Unused if the analyzer skips unpack_with_gdcm().
[[maybe_unused]] gdcm::PixelFormat pixel_format(const DicomNumbers& n) {
    const auto bits = [](int count) { return static_cast<unsigned short>(count); };
    return gdcm::PixelFormat(1, bits(n.allocated), bits(n.stored), bits(n.high),
                             bits(n.is_signed ? 1 : 0));
}

template <class Codec>
bool unpack_with(const gdcm::TransferSyntax& syntax, const DicomNumbers& numbers,
                 const gdcm::DataElement& pixels, std::span<std::byte> dst) {
    Codec codec;
    if (!codec.CanDecode(syntax)) {
        return false;
    }
    const std::array<unsigned, 3> size{static_cast<unsigned>(numbers.columns),
                                       static_cast<unsigned>(numbers.rows), 1};
    codec.SetNumberOfDimensions(2);
    codec.SetDimensions(size.data());
    codec.SetPixelFormat(pixel_format(numbers));
    codec.SetPhotometricInterpretation(gdcm::PhotometricInterpretation::MONOCHROME2);
    codec.SetPlanarConfiguration(0);
    gdcm::DataElement out;
    if (!codec.Decode(pixels, out) || out.GetByteValue() == nullptr ||
        out.GetByteValue()->GetLength() < dst.size()) {
        return false;
    }
    std::memcpy(dst.data(), out.GetByteValue()->GetPointer(), dst.size());
    return true;
}

/// Whether GDCM succeeded. Calls the codecs one by one, because GDCM's image class also tries one
/// that runs another program on temporary files.
bool unpack_with_gdcm(const gdcm::TransferSyntax& syntax, const DicomNumbers& numbers,
                      std::span<const char> frame, std::span<std::byte> dst) {
#ifdef __clang_analyzer__
    // The analyzer does not follow the reference counts of GDCM's pointers.
    static_cast<void>(syntax), static_cast<void>(numbers), static_cast<void>(frame);
    return dst.empty();
#else
    gdcm::Trace::DebugOff();
    gdcm::Trace::WarningOff();
    gdcm::Trace::ErrorOff();
    const gdcm::SmartPointer<gdcm::SequenceOfFragments> fragments =
        gdcm::SequenceOfFragments::New();
    gdcm::Fragment fragment;
    fragment.SetByteValue(frame.data(), static_cast<std::uint32_t>(frame.size()));
    fragments->AddFragment(fragment);
    gdcm::DataElement pixels(gdcm::Tag(0x7fe0, 0x0010), 0, gdcm::VR::OB);
    pixels.SetValue(*fragments);
    try {
        return unpack_with<gdcm::JPEGCodec>(syntax, numbers, pixels, dst) ||
               unpack_with<gdcm::JPEGLSCodec>(syntax, numbers, pixels, dst);
    } catch (const std::exception&) {
        return false;
    }
#endif
}

/// The same in a separate process, because GDCM's assertions abort it for some damaged frames.
/// Success is reported by a byte after the numbers, not by the exit status, which a program that
/// ignores or reaps its children would not get.
bool unpack_apart(const gdcm::TransferSyntax& syntax, const DicomNumbers& numbers,
                  std::span<const char> frame, std::span<std::byte> dst, const std::string& name) {
    constexpr rlim_t kMaxSeconds = 300;  ///< of processor time; a frame takes less than one second
    constexpr std::byte kGood{1};
    const std::size_t size = dst.size() + 1;
    void* const shared =
        ::mmap(nullptr, size, PROT_READ | PROT_WRITE, MAP_SHARED | MAP_ANONYMOUS, -1, 0);
    if (shared == MAP_FAILED) {
        throw Error(ErrorKind::limit, {name}, "there is too little memory to decode a frame",
                    {{RemedyKind::less_memory}});
    }
    const std::span<std::byte> room(static_cast<std::byte*>(shared), size);
    const pid_t parent = ::getpid();
    const pid_t child = ::fork();
    if (child == 0) {
        // Leaves nothing behind: no core file, no message, no orphan process.
        ::prctl(PR_SET_PDEATHSIG, SIGKILL);
        const rlimit none{0, 0};
        ::setrlimit(RLIMIT_CORE, &none);
        const rlimit seconds{kMaxSeconds, kMaxSeconds};
        ::setrlimit(RLIMIT_CPU, &seconds);
        if (const int nowhere = ::open("/dev/null", O_WRONLY | O_CLOEXEC); nowhere >= 0) {
            ::dup2(nowhere, STDERR_FILENO);
        }
        if (::getppid() == parent &&
            unpack_with_gdcm(syntax, numbers, frame, room.first(dst.size()))) {
            room.back() = kGood;
        }
        ::_exit(0);
    }
    while (child > 0 && ::waitpid(child, nullptr, 0) < 0 && errno == EINTR) {
    }
    const bool good = child > 0 && room.back() == kGood;
    if (good) {
        std::memcpy(dst.data(), shared, dst.size());
    }
    ::munmap(shared, size);
    if (child < 0) {
        throw Error(ErrorKind::limit, {name}, "the system cannot start a process to decode a frame",
                    {{RemedyKind::raise_limit}});
    }
    return good;
}

std::string unpack_frame(const std::string& syntax, const DicomNumbers& numbers,
                         std::span<const char> frame, std::span<std::byte> dst,
                         const std::string& name) {
    const gdcm::TransferSyntax::TSType type = gdcm::TransferSyntax::GetTSType(syntax.c_str());
    const bool jpeg = syntax.starts_with("1.2.840.10008.1.2.4.") &&
                      (type != gdcm::TransferSyntax::TS_END || is_jpeg2000(frame));
    if (!jpeg) {
        throw Error(ErrorKind::unsupported, {name},
                    fmt::format("the transfer syntax {} is not supported; convert the file, for "
                                "example with gdcmconv",
                                syntax));
    }
    // A decoder trusts the size in the stream, so it is checked first.
    const std::optional<CodestreamSize> size = codestream_size(frame);
    if (!size) {
        return "the frame is not a JPEG, JPEG-LS or JPEG 2000 stream";
    }
    if (size->columns != numbers.columns || size->rows != numbers.rows || size->components != 1) {
        return fmt::format(
            "the stream has {} x {} pixels of {} components, but the header says {} x {} of 1",
            size->columns, size->rows, size->components, numbers.columns, numbers.rows);
    }
    if (size->bits > numbers.allocated || (size->bits <= 8 && numbers.stored > 8)) {
        return fmt::format("the stream has numbers of {} bits, but the header says {}", size->bits,
                           numbers.stored);
    }
    if (is_jpeg2000(frame)) {
        return unpack_jpeg2000(frame, numbers, dst);
    }
    if (type != gdcm::TransferSyntax::TS_END &&
        unpack_apart(gdcm::TransferSyntax(type), numbers, frame, dst, name)) {
        return {};
    }
    return "the frame cannot be decoded";
}

}  // namespace
}  // namespace isonest::detail

void isonest_unpack_dicom(const std::string& syntax, const isonest::detail::DicomNumbers& numbers,
                          std::span<const char> frame, std::span<std::byte> dst,
                          const std::string& name, std::string& problem) {
    problem = isonest::detail::unpack_frame(syntax, numbers, frame, dst, name);
}
