#include "preprocess/sources/dicom/module/jpeg2000_frame.h"

#include <openjpeg.h>

#include <algorithm>
#include <cstring>
#include <memory>

namespace isonest::detail {
namespace {

/// What is left of the frame.
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
        return "OpenJPEG has no memory";
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
        return "the frame's JPEG 2000 stream cannot be unpacked";
    }
    const opj_image_comp_t& component = image->comps[0];
    if (image->numcomps != 1 || component.data == nullptr || component.w != numbers.columns ||
        component.h != numbers.rows) {
        return "the frame's JPEG 2000 stream has another size than its header";
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

}  // namespace isonest::detail
