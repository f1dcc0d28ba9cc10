// The numbers of the frames of DICOM files.
#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "preprocess/sources/dicom/dicom_elements.h"
#include "preprocess/sources/dicom/dicom_header.h"

namespace isonest::detail {

// DICOM's RLE: PackBits on byte planes. Source: DICOM PS3.5, annex G.

/// Decompresses a frame of numbers of `size` bytes into `dst`. Returns what is wrong with the
/// frame, or an empty text. No I/O.
std::string unpack_dicom_rle(std::span<const char> frame, std::size_t size,
                             std::span<std::byte> dst);

// Frames compressed as streams of an image format: JPEG, JPEG-LS, JPEG 2000, RLE. A module decodes
// JPEG and JPEG-LS with GDCM, and JPEG 2000 (also High-Throughput) with OpenJPEG.

/// Whether this build decompresses more than RLE.
bool dicom_codec_is_built();

/// Decompresses a frame into `dst`: numbers.frame_bytes() bytes, native endianness, bits as
/// allocated. `frame` is the whole stream. Returns what is wrong with the frame, or an empty text.
/// Throws Error{unsupported} for a transfer syntax that this build does not decompress, or if the
/// module is missing; `name` is the file's.
std::string unpack_dicom_frame(const std::string& syntax, const DicomNumbers& numbers,
                               std::span<const char> frame, std::span<std::byte> dst,
                               const std::string& name);

/// Keeps one file open at a time. Thread-safety: one thread.
class DicomFrames {
  public:
    /// All frames must have such numbers.
    DicomFrames(std::vector<std::filesystem::path> files, const DicomNumbers& numbers);

    [[nodiscard]] const std::vector<std::filesystem::path>& files() const { return files_; }
    /// Rows [y0, y0 + ny) of a frame, in native endianness, with the sign extended and unused bits
    /// cleared; for numbers with a table, the table's values (DicomNumbers::value_type()).
    /// Throws Error{corrupt, io, unsupported}.
    void read(std::uint32_t file, std::int64_t frame, std::int64_t y0, std::int64_t ny,
              std::byte* dst);
    [[nodiscard]] std::uint64_t heap() const;

  private:
    void open(std::uint32_t file);
    void read_stored(std::int64_t frame, std::int64_t y0, std::int64_t ny, std::byte* dst);
    void read_bits(std::uint64_t first, std::size_t count, std::byte* dst);
    /// Values of the stored image, from pixel `first`.
    void read_pixels(std::int64_t image, std::uint64_t first, std::size_t count, std::byte* dst);
    [[nodiscard]] std::int64_t images() const { return numbers_.mosaic == 1 ? header_.frames : 1; }
    void find_frames(const std::vector<DicomElement>& fragments);
    void unpack(std::int64_t frame);
    void mend_bits(std::byte* data, std::size_t count) const;
    void use_table(const std::byte* stored, std::size_t count, std::byte* values) const;

    std::vector<std::filesystem::path> files_;
    DicomNumbers numbers_;
    DicomNumbers stored_;  ///< of the whole stored image; a frame may be a part of it
    std::uint32_t current_ = ~std::uint32_t{0};
    std::unique_ptr<DicomFile> file_;
    DicomHeader header_;
    std::vector<DicomElement> fragments_;
    /// For each frame, the index of its first fragment; then, as last entry, the number of
    /// fragments.
    std::vector<std::size_t> first_;
    std::vector<char> packed_;
    std::vector<std::byte> unpacked_;
    std::int64_t unpacked_frame_ = -1;
};

}  // namespace isonest::detail
