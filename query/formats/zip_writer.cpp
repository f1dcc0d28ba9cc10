// Sources: PKWARE, ".ZIP File Format Specification" (APPNOTE.TXT), 4.3 to 4.5; RFC 1951. Space for
// ZIP64 in an entry's header: 3MF Consortium, "3MF Core Specification" 1.4, 1.1.
#include "query/formats/zip_writer.h"

#include <zlib.h>

#include <algorithm>
#include <cassert>
#include <memory>
#include <new>
#include <span>
#include <utility>

namespace isonest::detail {
namespace {

constexpr int kLevel = 4;               // for a mesh as XML, 6 gives 7 % less in 2.8 times the time
constexpr int kRawWindow = -MAX_WBITS;  // without a zlib or gzip header
constexpr int kMemoryLevel = 8;
/// An empty block marked as the last.
constexpr std::string_view kLastBlock{"\x03\x00", 2};

constexpr std::uint64_t kVersion = 20;  // deflate
constexpr std::uint64_t kVersionZip64 = 45;
constexpr std::uint64_t kDeflate = 8;
constexpr std::uint64_t kFirstDay = 0x21;  // 1980-01-01, the earliest possible date
constexpr std::uint64_t kZip64Field = 0x0001;
constexpr std::uint64_t kUnusedField = 0x9999;
constexpr std::uint64_t kMax16 = 0xFFFF;

constexpr std::size_t kEntryHeader = 30;
constexpr std::size_t kFieldHeader = 4;
constexpr std::size_t kEntryField = 16;
constexpr std::size_t kDirectoryField = 24;
constexpr std::size_t kZip64End = 44;  // without its first two numbers

/// Numbers of 1 to 8 bytes, the lowest byte first.
class Record {
  public:
    Record& u16(std::uint64_t number) { return put(number, 2); }
    Record& u32(std::uint64_t number) { return put(number, 4); }
    Record& u64(std::uint64_t number) { return put(number, 8); }
    Record& text(std::string_view text) {
        bytes_ += text;
        return *this;
    }
    [[nodiscard]] const std::string& bytes() const { return bytes_; }

  private:
    Record& put(std::uint64_t number, int bytes) {
        for (; bytes > 0; --bytes, number >>= 8U) {
            bytes_ += static_cast<char>(number & 0xFFU);
        }
        return *this;
    }
    std::string bytes_;
};

}  // namespace

DeflatedPiece deflate_piece(std::string_view text) {
    z_stream stream{};
    if (::deflateInit2(&stream, kLevel, Z_DEFLATED, kRawWindow, kMemoryLevel, Z_DEFAULT_STRATEGY) !=
        Z_OK) {
        throw std::bad_alloc();
    }
    const std::unique_ptr<z_stream, int (*)(z_stream*)> ended(&stream, ::deflateEnd);
    constexpr std::size_t kFlush = 64;  // more than the end of a piece needs
    DeflatedPiece piece;
    piece.bytes.resize(::deflateBound(&stream, text.size()) + kFlush);
    const auto* const input = reinterpret_cast<const Bytef*>(text.data());
    stream.next_in = const_cast<Bytef*>(input);  // zlib does not write there
    stream.avail_in = static_cast<uInt>(text.size());
    stream.next_out = reinterpret_cast<Bytef*>(piece.bytes.data());
    stream.avail_out = static_cast<uInt>(piece.bytes.size());
    // Flush to a byte boundary, where the next piece starts.
    [[maybe_unused]] const int result = ::deflate(&stream, Z_FULL_FLUSH);
    assert(result == Z_OK && stream.avail_in == 0 && stream.avail_out > 0);
    piece.bytes.resize(stream.total_out);
    piece.size = text.size();
    piece.crc = static_cast<std::uint32_t>(::crc32_z(0, input, text.size()));
    return piece;
}

bool ZipWriter::is_large(const Entry& entry) const {
    return std::max({entry.place, entry.size, entry.deflated}) >= max_;
}

void ZipWriter::append(std::string_view bytes) {
    file_->write_at(at_, std::as_bytes(std::span(bytes)));
    at_ += bytes.size();
}

void ZipWriter::begin_entry(std::string name) {
    const std::uint64_t place = at_;
    at_ += kEntryHeader + name.size() + kFieldHeader + kEntryField;
    entries_.push_back({std::move(name), place});
}

void ZipWriter::add(const DeflatedPiece& piece) {
    Entry& entry = entries_.back();
    file_->write_at(at_, piece.bytes);
    at_ += piece.bytes.size();
    entry.deflated += piece.bytes.size();
    entry.size += piece.size;
    entry.crc = static_cast<std::uint32_t>(
        ::crc32_combine(entry.crc, piece.crc, static_cast<z_off_t>(piece.size)));
}

void ZipWriter::end_entry() {
    Entry& entry = entries_.back();
    append(kLastBlock);
    entry.deflated += kLastBlock.size();
    const bool large = is_large(entry);
    Record record;
    record.text("PK\x03\x04").u16(large ? kVersionZip64 : kVersion).u16(0).u16(kDeflate);
    record.u16(0).u16(kFirstDay).u32(entry.crc);
    record.u32(large ? kMax32 : entry.deflated).u32(large ? kMax32 : entry.size);
    record.u16(entry.name.size()).u16(kFieldHeader + kEntryField).text(entry.name);
    record.u16(large ? kZip64Field : kUnusedField).u16(kEntryField);
    record.u64(large ? entry.size : 0).u64(large ? entry.deflated : 0);
    file_->write_at(entry.place, std::as_bytes(std::span(record.bytes())));
}

void ZipWriter::finish() {
    const std::uint64_t begin = at_;
    bool zip64 = begin >= max_;
    for (const Entry& entry : entries_) {
        const bool large = is_large(entry);
        zip64 = zip64 || large;
        Record record;
        const std::uint64_t version = large ? kVersionZip64 : kVersion;
        record.text("PK\x01\x02").u16(version).u16(version).u16(0).u16(kDeflate);
        record.u16(0).u16(kFirstDay).u32(entry.crc);
        record.u32(large ? kMax32 : entry.deflated).u32(large ? kMax32 : entry.size);
        record.u16(entry.name.size()).u16(large ? kFieldHeader + kDirectoryField : 0).u16(0);
        record.u16(0).u16(0).u32(0).u32(large ? kMax32 : entry.place).text(entry.name);
        if (large) {
            record.u16(kZip64Field).u16(kDirectoryField);
            record.u64(entry.size).u64(entry.deflated).u64(entry.place);
        }
        append(record.bytes());
    }
    const std::uint64_t end = at_;
    const std::uint64_t count = entries_.size();
    Record record;
    if (zip64) {
        record.text("PK\x06\x06").u64(kZip64End).u16(kVersionZip64).u16(kVersionZip64);
        record.u32(0).u32(0).u64(count).u64(count).u64(end - begin).u64(begin);
        record.text("PK\x06\x07").u32(0).u64(end).u32(1);
    }
    record.text("PK\x05\x06").u16(0).u16(0).u16(zip64 ? kMax16 : count);
    record.u16(zip64 ? kMax16 : count).u32(zip64 ? kMax32 : end - begin);
    record.u32(zip64 ? kMax32 : begin).u16(0);
    append(record.bytes());
}

}  // namespace isonest::detail
