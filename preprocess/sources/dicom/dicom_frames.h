// The numbers of the frames of DICOM files.
#pragma once

#include <cstdint>
#include <filesystem>
#include <memory>
#include <string>
#include <vector>

#include "preprocess/sources/dicom/dicom_elements.h"
#include "preprocess/sources/dicom/dicom_header.h"

namespace isonest::detail {

/// One file at a time is open. Thread-safety: one thread.
class DicomFrames {
  public:
    /// All frames are to be of such numbers, stored of at most `max_heap` bytes. Throws
    /// Error{limit}.
    DicomFrames(std::vector<std::filesystem::path> files, const DicomNumbers& numbers);

    [[nodiscard]] const std::vector<std::filesystem::path>& files() const { return files_; }
    /// Rows [y0, y0 + ny) of a frame: sign and unused bits are in order, native endianness; of
    /// numbers with a table, the table's values (DicomNumbers::value_type()).
    /// Throws Error{corrupt, io, unsupported}.
    void read(std::uint32_t file, std::int64_t frame, std::int64_t y0, std::int64_t ny,
              std::byte* dst);
    [[nodiscard]] std::uint64_t heap() const;

  private:
    void open(std::uint32_t file);
    void read_stored(std::int64_t frame, std::int64_t y0, std::int64_t ny, std::byte* dst);
    void read_bits(std::uint64_t first, std::size_t count, std::byte* dst);
    /// Values of the stored image from pixel `first` on.
    void read_pixels(std::int64_t image, std::uint64_t first, std::size_t count, std::byte* dst);
    [[nodiscard]] std::int64_t images() const { return numbers_.mosaic == 1 ? header_.frames : 1; }
    void find_frames(const std::vector<DicomElement>& fragments);
    void unpack(std::int64_t frame);
    void mend_bits(std::byte* data, std::size_t count) const;
    void use_table(const std::byte* stored, std::size_t count, std::byte* values) const;

    std::vector<std::filesystem::path> files_;
    DicomNumbers numbers_;
    DicomNumbers stored_;  ///< of the whole image of which a frame may be a part
    std::uint32_t current_ = ~std::uint32_t{0};
    std::unique_ptr<DicomFile> file_;
    DicomHeader header_;
    std::vector<DicomElement> fragments_;
    /// Of each frame the first of its fragments, and behind the last one their number.
    std::vector<std::size_t> first_;
    std::vector<char> packed_;
    std::vector<std::byte> unpacked_;
    std::int64_t unpacked_frame_ = -1;
};

}  // namespace isonest::detail
