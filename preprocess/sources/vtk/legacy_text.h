// Lines of VTK's legacy files, and what lies between them.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "preprocess/sources/bytes/input_file.h"

namespace isonest::detail {

/// Reads from a place on, which each call moves. Whatever lies behind the end of the file is
/// missing. All calls throw Error{io}; those that read lines, Error{corrupt} for one of more than
/// 4 KiB. REQUIRES: the file outlives it.
class LegacyText {
  public:
    explicit LegacyText(const InputFile& file);
    /// The next line without its end; empty at the end of the file.
    std::string line();
    /// The words of the next line that has some; none at the end of the file.
    std::vector<std::string> words();
    void skip_to_empty_line();
    void skip(std::uint64_t bytes);
    /// Words of any length, over lines, up to where the next one begins.
    void skip_words(std::uint64_t count);
    void skip_lines(std::uint64_t count);
    /// Texts with their lengths before them.
    void skip_binary_texts(std::uint64_t count);
    [[nodiscard]] std::uint64_t at() const { return at_; }

  private:
    const InputFile& file_;
    std::uint64_t size_;
    std::uint64_t at_ = 0;
};

}  // namespace isonest::detail
