// Bytes that a file unpacks to, from front to back.
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "preprocess/sources/bytes/byte_reader.h"
#include "preprocess/sources/bytes/gzip_stream.h"
#include "preprocess/sources/bytes/input_file.h"

namespace isonest::detail {

/// Where in a file a stream begins, and which of its bytes are wanted: [skip, skip + size). More
/// bytes may follow them.
struct StreamPart {
    InputFile file;
    std::uint64_t start = 0;
    std::uint64_t skip = 0;
    std::uint64_t size = 0;
};

/// All of these are sequential. They throw Error{io}; read() and finish() Error{corrupt} for
/// damage, and where a stream ends too early.
std::unique_ptr<ByteReader> deflated_bytes(const StreamPart& part, DeflateWrapper wrapper);
/// Streams of bzip2, one after the other. Throws Error{unsupported} where isonest was built without
/// libbz2.
std::unique_ptr<ByteReader> bzip2_bytes(const StreamPart& part);
/// Two hexadecimal digits for each byte, white space anywhere between digits.
std::unique_ptr<ByteReader> hex_bytes(const StreamPart& part);

/// The bytes of several files, each of which has `piece` of them, as `open` makes them. One file at
/// a time is open. `sequential`: what `open` makes is so.
std::unique_ptr<ByteReader> joined_bytes(
    std::vector<InputFile> files, std::uint64_t piece, bool sequential,
    std::function<std::unique_ptr<ByteReader>(const InputFile&)> open);

}  // namespace isonest::detail
