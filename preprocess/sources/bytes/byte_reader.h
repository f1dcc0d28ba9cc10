// Sequences of bytes that are decoded from a file.
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

/// A sequence of bytes with reads at any position. Thread-safety: one thread.
class ByteReader {
  public:
    ByteReader() = default;
    ByteReader(const ByteReader&) = delete;
    ByteReader& operator=(const ByteReader&) = delete;
    virtual ~ByteReader() = default;
    /// Total number of bytes.
    [[nodiscard]] virtual std::uint64_t size() const = 0;
    /// REQUIRES: the whole range exists. Throws Error{io, corrupt}.
    virtual void read(std::uint64_t at, std::byte* dst, std::uint64_t bytes) = 0;
    /// If true, reads must come in ascending order.
    [[nodiscard]] virtual bool sequential() const { return false; }
    /// Called after the last read: compressed data are checked up to their end. Throws
    /// Error{corrupt}.
    virtual void finish() {}
    /// Bytes of memory that it holds.
    [[nodiscard]] virtual std::uint64_t heap() const { return 0; }
};

/// Bytes [start, start + size) of a file or a remote object. Throws Error{io}.
std::unique_ptr<ByteReader> file_bytes(const InputFile& file, std::uint64_t start,
                                       std::uint64_t size);
/// `size` bytes stored in base64 without line breaks, from byte `start` of a file. Throws
/// Error{io}.
std::unique_ptr<ByteReader> base64_bytes(const InputFile& file, std::uint64_t start,
                                         std::uint64_t size);
/// Compressed blocks, stored one after the other in `packed` with these compressed sizes. Each
/// decompresses to `block` bytes, the last one to the rest of `size`.
std::unique_ptr<ByteReader> packed_blocks(BlockPacking packing, std::unique_ptr<ByteReader> packed,
                                          std::string name,
                                          const std::vector<std::uint64_t>& packed_sizes,
                                          std::uint64_t block, std::uint64_t size);
/// All of `bytes` except the first `skipped`. REQUIRES: it has that many.
std::unique_ptr<ByteReader> bytes_behind(std::unique_ptr<ByteReader> bytes, std::uint64_t skipped);
/// `count` numbers of a type as text, separated by white space, from byte `start` of a file. They
/// end at a `<`, like text in XML. Sequential. Throws Error{io}; read() Error{corrupt}. `commas`:
/// also allowed between numbers, as in NRRD.
std::unique_ptr<ByteReader> text_numbers(const InputFile& file, std::uint64_t start, ValueType type,
                                         std::uint64_t count, bool commas = false);
/// The same for integers of 64 bits.
std::unique_ptr<ByteReader> text_integers(const InputFile& file, std::uint64_t start,
                                          bool is_signed, std::uint64_t count, bool commas = false);

}  // namespace isonest::detail
