// Bytes that have to be made from what the file holds.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include <isonest/value_type.h>

#include "preprocess/sources/bytes/input_file.h"
#include "preprocess/sources/bytes/packed_block.h"

namespace isonest::detail {

/// A sequence of bytes at any place of which one can read. Thread-safety: one thread.
class ByteReader {
  public:
    ByteReader() = default;
    ByteReader(const ByteReader&) = delete;
    ByteReader& operator=(const ByteReader&) = delete;
    virtual ~ByteReader() = default;
    /// How many there are.
    [[nodiscard]] virtual std::uint64_t size() const = 0;
    /// REQUIRES: all of them are there. Throws Error{io, corrupt}.
    virtual void read(std::uint64_t at, std::byte* dst, std::uint64_t bytes) = 0;
    /// Reads must come in ascending order.
    [[nodiscard]] virtual bool sequential() const { return false; }
    /// All that is wanted was read: of what is packed, the rest is checked to its end. Throws
    /// Error{corrupt}.
    virtual void finish() {}
    /// Bytes that it holds.
    [[nodiscard]] virtual std::uint64_t heap() const { return 0; }
};

/// Bytes [start, start + size) of a file, or of an object elsewhere. Throws Error{io}.
std::unique_ptr<ByteReader> file_bytes(const InputFile& file, std::uint64_t start,
                                       std::uint64_t size);
/// `size` bytes in base64 without line breaks, from byte `start` of a file on. Throws Error{io}.
std::unique_ptr<ByteReader> base64_bytes(const InputFile& file, std::uint64_t start,
                                         std::uint64_t size);
/// Packed blocks, one after the other in `packed`, of these packed sizes; each makes `block` bytes,
/// but the last one the rest of `size`.
std::unique_ptr<ByteReader> packed_blocks(BlockPacking packing, std::unique_ptr<ByteReader> packed,
                                          std::string name,
                                          const std::vector<std::uint64_t>& packed_sizes,
                                          std::uint64_t block, std::uint64_t size);
/// All of `bytes` but its first `skipped`. REQUIRES: it has as many.
std::unique_ptr<ByteReader> bytes_behind(std::unique_ptr<ByteReader> bytes, std::uint64_t skipped);
/// `count` numbers of a type in text, white space between them, from byte `start` of a file on.
/// They end at a `<`, as text in XML does. Sequential. Throws Error{io}; read() Error{corrupt}.
/// `commas`: they may stand between numbers, too, as in NRRD.
std::unique_ptr<ByteReader> text_numbers(const InputFile& file, std::uint64_t start, ValueType type,
                                         std::uint64_t count, bool commas = false);
/// The same of integers of 64 bits.
std::unique_ptr<ByteReader> text_integers(const InputFile& file, std::uint64_t start,
                                          bool is_signed, std::uint64_t count, bool commas = false);

}  // namespace isonest::detail
