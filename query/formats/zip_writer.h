// ZIP archives whose entries are too large for the memory, and are deflated by several threads.
#pragma once

#include <cstddef>
#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

#include "store/files/output_file.h"

namespace isonest::detail {

/// A piece of an entry. It refers to nothing before it, so pieces can be made at the same time.
struct DeflatedPiece {
    std::vector<std::byte> bytes;
    std::uint64_t size = 0;  ///< of the text
    std::uint32_t crc = 0;   ///< of the text
};
/// Throws std::bad_alloc. REQUIRES: less than 1 GiB of text.
DeflatedPiece deflate_piece(std::string_view text);

/// Writes an archive into a file, one entry after the other. Its bytes depend on the pieces alone:
/// it holds no times. ZIP64 where, and only where, it is needed.
class ZipWriter {
  public:
    static constexpr std::uint64_t kMost32 = 0xFFFFFFFF;

    /// `file` has to outlive it. What reaches `most` is written as ZIP64 (for tests: less than 2^32
    /// - 1).
    explicit ZipWriter(const OutputFile& file, std::uint64_t most = kMost32)
        : file_(&file), most_(most) {}
    /// REQUIRES: the last entry has ended; a name of ASCII characters.
    void begin_entry(std::string name);
    void add(const DeflatedPiece& piece);
    void add(std::string_view text) { add(deflate_piece(text)); }
    void end_entry();
    /// Writes the directory; nothing may follow. REQUIRES: the last entry has ended.
    void finish();

  private:
    struct Entry {
        std::string name;
        std::uint64_t place = 0;
        std::uint64_t size = 0;      ///< of the text
        std::uint64_t deflated = 0;  ///< its bytes
        std::uint32_t crc = 0;
    };
    [[nodiscard]] bool is_large(const Entry& entry) const;
    void append(std::string_view bytes);

    const OutputFile* file_;
    std::uint64_t most_;
    std::uint64_t at_ = 0;
    std::vector<Entry> entries_;
};

}  // namespace isonest::detail
