// Frames of JPEG, JPEG-LS and JPEG 2000 in a module of its own: GDCM fills tables as soon as it is
// loaded, which takes as long as all the rest of the program's start.
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
#include <sys/mman.h>
#include <sys/prctl.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <csignal>
#include <cstring>
#include <optional>

#include <isonest/error.h>

#include "preprocess/sources/dicom/module/codestream_size.h"
#include "preprocess/sources/dicom/module/jpeg2000_frame.h"

namespace isonest::detail {
namespace {

/// Not used where the analyzer does not see unpack_with_gdcm().
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

/// Whether GDCM could do it. Codec by codec: its image class also tries one that runs another
/// program on temporary files.
bool unpack_with_gdcm(const gdcm::TransferSyntax& syntax, const DicomNumbers& numbers,
                      std::span<const char> frame, std::span<std::byte> dst) {
#ifdef __clang_analyzer__
    // It does not follow the counts of references in GDCM's pointers.
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

/// The same in a process of its own: GDCM ends it where a frame is damaged in a way that its
/// assertions forbid. Whether it was good is said by a byte behind the numbers, not by how the
/// process ended: a program that ignores or collects its children is not told.
bool unpack_apart(const gdcm::TransferSyntax& syntax, const DicomNumbers& numbers,
                  std::span<const char> frame, std::span<std::byte> dst, const std::string& name) {
    constexpr rlim_t kMostSeconds = 300;  ///< of processor time; a frame takes less than one
    constexpr std::byte kGood{1};
    const std::size_t size = dst.size() + 1;
    void* const shared =
        ::mmap(nullptr, size, PROT_READ | PROT_WRITE, MAP_SHARED | MAP_ANONYMOUS, -1, 0);
    if (shared == MAP_FAILED) {
        throw Error(ErrorKind::limit, {name}, "there is no memory to unpack a frame",
                    {{RemedyKind::less_memory}});
    }
    const std::span<std::byte> room(static_cast<std::byte*>(shared), size);
    const pid_t parent = ::getpid();
    const pid_t child = ::fork();
    if (child == 0) {
        // Nothing of it stays behind: no core, no message, and not itself.
        ::prctl(PR_SET_PDEATHSIG, SIGKILL);
        const rlimit none{0, 0};
        ::setrlimit(RLIMIT_CORE, &none);
        const rlimit seconds{kMostSeconds, kMostSeconds};
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
        throw Error(ErrorKind::limit, {name}, "the system refuses a process to unpack a frame",
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
                    fmt::format("the numbers are packed as {} (transfer syntax), which is not "
                                "read: repack the file, for example with gdcmconv",
                                syntax));
    }
    // A decoder trusts the stream's own size.
    const std::optional<CodestreamSize> size = codestream_size(frame);
    if (!size) {
        return "the frame is no stream of JPEG, JPEG-LS or JPEG 2000";
    }
    if (size->columns != numbers.columns || size->rows != numbers.rows || size->components != 1) {
        return fmt::format(
            "the stream has {} x {} pixels of {} components, the header says "
            "{} x {} of 1",
            size->columns, size->rows, size->components, numbers.columns, numbers.rows);
    }
    if (size->bits > numbers.allocated || (size->bits <= 8 && numbers.stored > 8)) {
        return fmt::format("the stream has numbers of {} bits, the header says {}", size->bits,
                           numbers.stored);
    }
    if (is_jpeg2000(frame)) {
        return unpack_jpeg2000(frame, numbers, dst);
    }
    if (type != gdcm::TransferSyntax::TS_END &&
        unpack_apart(gdcm::TransferSyntax(type), numbers, frame, dst, name)) {
        return {};
    }
    return "the frame cannot be unpacked";
}

}  // namespace
}  // namespace isonest::detail

void isonest_unpack_dicom(const std::string& syntax, const isonest::detail::DicomNumbers& numbers,
                          std::span<const char> frame, std::span<std::byte> dst,
                          const std::string& name, std::string& problem) {
    problem = isonest::detail::unpack_frame(syntax, numbers, frame, dst, name);
}
