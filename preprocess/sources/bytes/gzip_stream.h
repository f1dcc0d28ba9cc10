// Numbers in gzip: one stream from front to back, checked to its last byte.
#pragma once

#include <zlib.h>

#include <cstddef>
#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "preprocess/sources/bytes/input_file.h"
#include "preprocess/sources/bytes/read_ahead.h"

namespace isonest::detail {

/// What is around deflate's data: RFC 1952, RFC 1950, nothing.
enum class DeflateWrapper { gzip, zlib, none };

/// What gzip(1) would give for a file from byte `start` on: members one after the other, then
/// nothing or zeros. A cut trailer, a wrong checksum or length, and anything else behind the last
/// member (of which gzip(1) warns) are errors. Of zlib's streams and of bare deflate, what follows
/// the end is not looked at.
/// Thread-safety: one thread at a time.
class GzipStream {
  public:
    /// `name` is used in messages. Throws Error{io}.
    GzipStream(const InputFile& file, std::string name, std::uint64_t start,
               DeflateWrapper wrapper = DeflateWrapper::gzip);
    GzipStream(const GzipStream&) = delete;
    GzipStream& operator=(const GzipStream&) = delete;
    ~GzipStream();

    /// The next bytes; fewer than `bytes` only where the stream ends. The trailer of a member is
    /// checked by the read that goes beyond its last byte. Throws Error{corrupt, io}.
    std::uint64_t read(std::byte* dst, std::uint64_t bytes);

  private:
    [[noreturn]] void corrupt(const std::string& what) const;
    /// False at the end of the file.
    bool refill();
    void next_member();

    std::string name_;
    DeflateWrapper wrapper_;
    int fd_ = -1;
    std::unique_ptr<ReadAhead> far_;  ///< in the place of `fd_`
    std::uint64_t file_at_;           ///< of the bytes behind those in `in_`
    std::vector<std::byte> in_;
    z_stream stream_{};
    bool ended_ = false;
};

/// True if a gzip stream starts at this byte of the file: its magic, the only method there is, and
/// no reserved flag. Throws Error{io}.
bool is_gzip(const InputFile& file, std::uint64_t at = 0);

}  // namespace isonest::detail
