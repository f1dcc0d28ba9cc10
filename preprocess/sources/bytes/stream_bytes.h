// Bytes that are decompressed from a file, from front to back.
#pragma once

#include <zlib.h>

#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "preprocess/sources/bytes/byte_reader.h"
#include "preprocess/sources/bytes/input_file.h"

namespace isonest::detail {

// Numbers in gzip: one stream from front to back, checked up to its last byte.

/// What surrounds deflate's data: RFC 1952, RFC 1950, nothing.
enum class DeflateWrapper { gzip, zlib, none };

/// The output of gzip(1) for a file from byte `start`: members one after the other, then nothing or
/// zeros. A truncated trailer, a wrong checksum or length, and anything else after the last member
/// (of which gzip(1) warns) are errors. For zlib and raw deflate, what follows the end of the
/// stream is ignored.
/// Thread-safety: one thread at a time.
class GzipStream {
  public:
    /// `name` is used in messages. Throws Error{io}.
    GzipStream(const InputFile& file, std::string name, std::uint64_t start,
               DeflateWrapper wrapper = DeflateWrapper::gzip);
    GzipStream(const GzipStream&) = delete;
    GzipStream& operator=(const GzipStream&) = delete;
    ~GzipStream();

    /// Reads the next bytes; fewer than `bytes` only at the end of the stream. The trailer of a
    /// member is checked by the read that goes beyond its last byte. Throws Error{corrupt, io}.
    std::uint64_t read(std::byte* dst, std::uint64_t bytes);

  private:
    [[noreturn]] void corrupt(const std::string& what) const;
    /// Returns false at the end of the file.
    bool refill();
    void next_member();

    std::string name_;
    DeflateWrapper wrapper_;
    int fd_ = -1;
    std::unique_ptr<ReadAhead> remote_;  ///< used instead of `fd_`
    std::uint64_t file_at_;              ///< file offset of the bytes after those in `in_`
    std::vector<std::byte> in_;
    z_stream stream_{};
    bool ended_ = false;
};

/// Whether a gzip stream starts at this byte of the file: its magic number, the only method, and no
/// reserved flags. Throws Error{io}.
bool is_gzip(const InputFile& file, std::uint64_t at = 0);

/// Where a stream begins in a file, and which of its decoded bytes are requested: [skip, skip +
/// size). More bytes may follow them.
struct StreamPart {
    InputFile file;
    std::uint64_t start = 0;
    std::uint64_t skip = 0;
    std::uint64_t size = 0;
};

/// All of these are sequential. They throw Error{io}; read() and finish() throw Error{corrupt} for
/// damage and for a stream that ends too early.
std::unique_ptr<ByteReader> deflated_bytes(const StreamPart& part, DeflateWrapper wrapper);
/// One or more bzip2 streams, one after the other. Throws Error{unsupported} if isonest was built
/// without libbz2.
std::unique_ptr<ByteReader> bzip2_bytes(const StreamPart& part);
/// Two hexadecimal digits per byte, with white space allowed between any digits.
std::unique_ptr<ByteReader> hex_bytes(const StreamPart& part);

/// The concatenated bytes of several files, `piece` bytes from each, as made by `open`. Only one
/// file is open at a time. `sequential`: whether the readers that `open` makes are sequential.
std::unique_ptr<ByteReader> joined_bytes(
    std::vector<InputFile> files, std::uint64_t piece, bool sequential,
    std::function<std::unique_ptr<ByteReader>(const InputFile&)> open);

}  // namespace isonest::detail
