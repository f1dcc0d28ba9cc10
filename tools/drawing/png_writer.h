// PNG files.
#pragma once

#include <cstdint>
#include <filesystem>
#include <memory>
#include <span>

namespace isonest::detail::cli {

/// Whether the name ends with .png, in any case.
bool is_png(const std::filesystem::path& path);

/// A picture of 8-bit RGB pixels that is written row by row; only few rows are held. It appears
/// under its name, replacing what is there, whole or not at all. Thread-safety: one thread.
class PngFile {
  public:
    /// Throws Error{io, invalid_argument, not_found}.
    PngFile(const std::filesystem::path& path, int width, int height);
    PngFile(const PngFile&) = delete;
    PngFile& operator=(const PngFile&) = delete;
    ~PngFile();
    /// The next rows, from the top. REQUIRES: whole rows. Throws Error{io}.
    void write(std::span<const std::uint8_t> rgb);
    /// REQUIRES: all rows were written. Throws Error{io, invalid_argument}.
    void finish();

  private:
    struct State;
    [[noreturn]] void fail();
    std::filesystem::path path_;
    std::size_t row_bytes_;
    std::unique_ptr<State> state_;
};

}  // namespace isonest::detail::cli
