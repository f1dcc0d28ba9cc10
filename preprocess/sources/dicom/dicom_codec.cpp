#include "preprocess/sources/dicom/dicom_codec.h"

#include "preprocess/sources/dicom/dicom_rle.h"

#if ISONEST_WITH_GDCM
#include "preprocess/sources/dicom/module/gdcm_module.h"
#include "preprocess/sources/modules/module_loader.h"
#else
#include <fmt/format.h>

#include <isonest/error.h>
#endif

namespace isonest::detail {
namespace {

/// Needs nothing but what is here.
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
        load_from_module({"isonest_gdcm.so", "unpacks DICOM's frames of JPEG", "isonest",
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
                fmt::format("the numbers are packed ({}), which this build does not read", syntax),
                {{RemedyKind::install_package, "libgdcm-dev libopenjp2-7-dev"}});
}

#endif

}  // namespace isonest::detail
