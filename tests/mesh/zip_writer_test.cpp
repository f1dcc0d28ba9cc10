// An archive, read back by PKWARE's APPNOTE.TXT, starting at its last record; with sizes and
// positions that need ZIP64 and without.
#include "query/formats/zip_writer.h"

#include <zlib.h>

#include <catch2/catch.hpp>

#include "tests/support/test_support.h"

using namespace isonest;
using namespace isonest::detail;
using namespace isonest::detail::test;

namespace {

struct Record {
    std::string_view bytes;
    [[nodiscard]] std::uint64_t number(std::size_t at, std::size_t size) const {
        std::uint64_t out = 0;
        for (std::size_t i = size; i-- > 0;) {
            out = out << 8U | static_cast<unsigned char>(bytes.at(at + i));
        }
        return out;
    }
};

struct Read {
    std::string name;
    std::string text;
    bool zip64 = false;
};

std::string inflated(std::string_view bytes, std::uint64_t size) {
    std::string out(size + 1, '\0');
    z_stream stream{};
    REQUIRE(::inflateInit2(&stream, -MAX_WBITS) == Z_OK);
    stream.next_in = reinterpret_cast<Bytef*>(const_cast<char*>(bytes.data()));
    stream.avail_in = static_cast<uInt>(bytes.size());
    stream.next_out = reinterpret_cast<Bytef*>(out.data());
    stream.avail_out = static_cast<uInt>(out.size());
    CHECK(::inflate(&stream, Z_FINISH) == Z_STREAM_END);
    CHECK(stream.avail_in == 0);
    CHECK(stream.total_out == size);
    ::inflateEnd(&stream);
    out.resize(size);
    return out;
}

/// Reads one entry, whose directory record is at `at`; moves `at` to the next.
Read read_entry(const std::string& file, std::size_t& at) {
    constexpr std::uint64_t kMax32 = 0xFFFFFFFF;
    const Record d{std::string_view(file).substr(at)};
    CHECK(d.bytes.substr(0, 4) == "PK\x01\x02");
    const std::uint64_t name_size = d.number(28, 2);
    const std::uint64_t extra_size = d.number(30, 2);
    Read out;
    out.name = d.bytes.substr(46, name_size);
    out.zip64 = extra_size > 0;
    const std::uint64_t version = out.zip64 ? 45 : 20;
    CHECK(d.number(6, 2) == version);
    CHECK(d.number(8, 2) == 0);
    CHECK(d.number(10, 2) == 8);
    CHECK(d.number(12, 4) == 0x210000);
    std::uint64_t deflated = d.number(20, 4);
    std::uint64_t size = d.number(24, 4);
    std::uint64_t place = d.number(42, 4);
    if (out.zip64) {
        CHECK((deflated == kMax32 && size == kMax32 && place == kMax32));
        const Record extra{d.bytes.substr(46 + name_size, extra_size)};
        CHECK((extra_size == 28 && extra.number(0, 2) == 1 && extra.number(2, 2) == 24));
        size = extra.number(4, 8);
        deflated = extra.number(12, 8);
        place = extra.number(20, 8);
    }
    at += 46 + name_size + extra_size;

    const Record h{std::string_view(file).substr(place)};
    CHECK(h.bytes.substr(0, 4) == "PK\x03\x04");
    CHECK(h.number(4, 2) == version);
    CHECK(h.bytes.substr(6, 12) == d.bytes.substr(8, 12));  // flags, method, time, CRC
    CHECK(h.number(18, 4) == (out.zip64 ? kMax32 : deflated));
    CHECK(h.number(22, 4) == (out.zip64 ? kMax32 : size));
    CHECK(h.bytes.substr(30, name_size) == out.name);
    CHECK(h.number(28, 2) == 20);
    const Record extra{h.bytes.substr(30 + name_size, 20)};
    CHECK(extra.number(0, 2) == (out.zip64 ? 1 : 0x9999));
    CHECK(extra.number(2, 2) == 16);
    CHECK(extra.number(4, 8) == (out.zip64 ? size : 0));
    CHECK(extra.number(12, 8) == (out.zip64 ? deflated : 0));
    out.text = inflated(h.bytes.substr(30 + name_size + 20, deflated), size);
    CHECK(::crc32(0, reinterpret_cast<const Bytef*>(out.text.data()),
                  static_cast<uInt>(out.text.size())) == d.number(14 + 2, 4));
    return out;
}

std::vector<Read> read_archive(const std::string& file, bool zip64) {
    const Record end{std::string_view(file).substr(file.size() - 22)};
    CHECK(end.bytes.substr(0, 8) == std::string_view("PK\x05\x06\0\0\0\0", 8));
    std::uint64_t count = end.number(10, 2);
    std::uint64_t size = end.number(12, 4);
    std::uint64_t at = end.number(16, 4);
    std::uint64_t directory_end = file.size() - 22;
    if (zip64) {
        CHECK((count == 0xFFFF && size == 0xFFFFFFFF && at == 0xFFFFFFFF));
        const Record locator{std::string_view(file).substr(file.size() - 22 - 20)};
        CHECK(locator.bytes.substr(0, 4) == "PK\x06\x07");
        CHECK((locator.number(4, 4) == 0 && locator.number(16, 4) == 1));
        directory_end = locator.number(8, 8);
        CHECK(directory_end + 56 == file.size() - 22 - 20);
        const Record large{std::string_view(file).substr(directory_end)};
        CHECK(large.bytes.substr(0, 4) == "PK\x06\x06");
        CHECK((large.number(4, 8) == 44 && large.number(14, 2) == 45));
        CHECK(large.number(24, 8) == large.number(32, 8));
        count = large.number(32, 8);
        size = large.number(40, 8);
        at = large.number(48, 8);
    }
    CHECK(at + size == directory_end);
    std::vector<Read> out;
    for (std::size_t next = at; next < directory_end;) {
        out.push_back(read_entry(file, next));
    }
    CHECK(out.size() == count);
    return out;
}

std::string written(const TemporaryFolder& folder, std::uint64_t most,
                    const std::vector<std::pair<std::string, std::vector<std::string>>>& entries) {
    const auto path = folder / "a.zip";
    OutputFile file(path, true);
    ZipWriter zip(file, most);
    for (const auto& [name, pieces] : entries) {
        zip.begin_entry(name);
        for (const std::string& piece : pieces) {
            zip.add(piece);
        }
        zip.end_entry();
    }
    zip.finish();
    file.publish_as_named();
    return read_file(path);
}

}  // namespace

TEST_CASE(
    "the entries of an archive are read back unchanged, with ZIP64 fields where sizes and "
    "positions need them") {
    const TemporaryFolder folder;
    std::string noise;
    for (unsigned i = 0; i < 100000; ++i) {
        noise += static_cast<char>((i * 2654435761U) >> 13U);
    }
    const std::vector<std::pair<std::string, std::vector<std::string>>> entries{
        {"a.txt", {"some text"}},
        {"of/pieces", {noise, "", "x", noise + noise, std::string(300000, 'y')}},
        {"empty", {}},
        {"at the end", {"z"}}};
    const std::uint64_t second = 30 + 5 + 20;  // less than the position of the second entry
    for (const std::uint64_t most :
         {ZipWriter::kMax32, std::uint64_t{500000}, second, std::uint64_t{0}}) {
        const std::string file = written(folder, most, entries);
        const std::vector<Read> read = read_archive(file, most != ZipWriter::kMax32);
        REQUIRE(read.size() == entries.size());
        for (std::size_t i = 0; i < read.size(); ++i) {
            std::string text;
            for (const std::string& piece : entries[i].second) {
                text += piece;
            }
            CHECK(read[i].name == entries[i].first);
            CHECK(read[i].text == text);
        }
        CHECK(read[0].zip64 == (most == 0));
        CHECK(read[1].zip64 == (most != ZipWriter::kMax32));
        CHECK(read[3].zip64 == (most <= second));
        CHECK(file == written(folder, most, entries));
    }
}

TEST_CASE(
    "an archive with only its directory beyond the limit has a ZIP64 end record and plain "
    "entries") {
    const TemporaryFolder folder;
    const std::uint64_t entry_end = 30 + 1 + 20 + 11 + 7 + 2;  // approximately
    const std::string file = written(folder, entry_end - 20, {{"a", {"0123456789a"}}});
    const std::vector<Read> read = read_archive(file, true);
    REQUIRE(read.size() == 1);
    CHECK(!read[0].zip64);
    CHECK(read[0].text == "0123456789a");
}
