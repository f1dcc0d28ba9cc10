// The part of a store after the end of HDF5's part: it is enough to open the store, and damage
// there is detected.
#include "store/container/parts/footer.h"

#include <algorithm>
#include <array>
#include <atomic>
#include <catch2/catch.hpp>
#include <thread>

#include <isonest/error.h>

#include "query/check/check.h"
#include "tests/support/remote_bytes.h"
#include "tests/support/test_support.h"

using namespace isonest;
using namespace isonest::detail;
using namespace isonest::detail::test;

namespace {

void write_file(const std::filesystem::path& path, const std::string& bytes) {
    std::ofstream(path, std::ios::binary) << bytes;
}

std::string surface(const StoreReader& store, const TemporaryFolder& folder, double error = 0) {
    Extraction options;
    options.iso = 0.3;
    options.error = error;
    options.threads = 1;
    extract(store, folder / "m.ply", options, silent_progress());
    return read_file(folder / "m.ply");
}

/// A store with several pages, the last of them shorter.
std::string store_of_pages(const TemporaryFolder& folder) {
    FunctionVolume<float> volume({65, 70, 66},
                                 [](const Int3& p) { return static_cast<float>(smooth(p)); });
    make_store(volume, folder / "s", with_chunk(8));
    return read_file(folder / "s");
}

std::vector<ChunkRow> all_rows(const std::string& bytes, const CatalogueTable& table) {
    std::vector<ChunkRow> rows(table.rows);
    std::memcpy(rows.data(), bytes.data() + table.offset, table.rows * sizeof(ChunkRow));
    return rows;
}

}  // namespace

TEST_CASE("a store is opened by its footer alone, and a remote one with one read") {
    const TemporaryFolder folder;
    const std::string bytes = store_of_pages(folder);
    const StoreReader local(folder / "s");
    REQUIRE(local.catalogue() != nullptr);
    CHECK(local.version().text() == "2.10");
    const auto remote_bytes = std::make_shared<const RemoteBytes>(bytes);
    const StoreReader remote(remote_bytes);
    CHECK(remote.is_remote());
    const auto opening = remote_bytes->reads();
    REQUIRE(opening.size() == 1);
    CHECK(opening[0].offset + opening[0].size == bytes.size());
    CHECK(opening[0].size == std::min<std::uint64_t>(kRemoteTail, bytes.size()));
    CHECK(remote.identity() == local.identity());
    for (const double error : {0.0, 0.1}) {
        CHECK(surface(remote, folder, error) == surface(local, folder, error));
    }

    // By HDF5, as if an HDF5 program had cut the footer off.
    const Footer& footer = local.catalogue()->footer;
    CHECK(footer.file_bytes == bytes.size());
    CHECK(hdf5_end_of(local.bytes()) == footer.hdf5_end);
    write_file(folder / "h", bytes.substr(0, footer.hdf5_end));
    const StoreReader by_hdf5(folder / "h");
    CHECK(by_hdf5.catalogue() == nullptr);
    CHECK(by_hdf5.identity() == local.identity());
    CHECK(surface(by_hdf5, folder) == surface(local, folder));
    CHECK(check(by_hdf5, {}, silent_progress()).failures == 0);
    for (const ArrayInfo& array : local.layout().arrays()) {
        const ArrayTotals a = local.totals(array);
        const ArrayTotals b = by_hdf5.totals(array);
        CHECK(same_bits(a, b));
    }
    const auto older = std::make_shared<const RemoteBytes>(bytes.substr(0, footer.hdf5_end));
    const StoreReader remote_by_hdf5(older);
    CHECK(remote_by_hdf5.catalogue() == nullptr);
    CHECK(surface(remote_by_hdf5, folder) == surface(local, folder));
    CHECK(check(remote_by_hdf5, {}, silent_progress()).failures == 0);
    CHECK(check(remote, {}, silent_progress()).failures == 0);
}

TEST_CASE("pages of the chunk table are the same for many threads, local and remote") {
    const TemporaryFolder folder;
    const std::string bytes = store_of_pages(folder);
    const StoreReader local(folder / "s");
    const CatalogueTable& place = *local.catalogue()->catalogue.table;
    const std::vector<ChunkRow> rows = all_rows(bytes, place);
    REQUIRE(rows.size() > 2 * kRowsOfPage);
    REQUIRE(rows.size() % kRowsOfPage != 0);
    const RemoteBytes remote(bytes);
    const FoundCatalogue found = found_in(remote);
    const ChunkTable near_table(local.bytes(), *local.catalogue());
    const ChunkTable remote_table(remote, found);
    std::atomic<int> wrong = 0;
    std::vector<std::thread> threads;
    for (std::size_t t = 0; t < 8; ++t) {
        threads.emplace_back([&, t] {
            for (std::size_t i = 0; i < rows.size(); ++i) {
                const std::size_t at = (i * 37 + t * 101) % rows.size();
                wrong += same_bits(near_table.row(at), rows[at]) ? 0 : 1;
                wrong += same_bits(remote_table.row(at), rows[at]) ? 0 : 1;
            }
        });
    }
    for (std::thread& thread : threads) {
        thread.join();
    }
    CHECK(wrong == 0);
}

TEST_CASE("a damaged page is detected when one of its rows is used, and not before") {
    const TemporaryFolder folder;
    const std::string whole = store_of_pages(folder);
    const RemoteBytes original(whole);
    const CatalogueTable place = *found_in(original).catalogue.table;
    const std::uint64_t pages = (place.rows - 1) / kRowsOfPage + 1;
    for (const std::uint64_t damaged : {std::uint64_t{0}, pages - 1}) {
        std::string bytes = whole;
        // The last row of the page.
        const std::uint64_t row = std::min((damaged + 1) * kRowsOfPage, place.rows) - 1;
        bytes[place.offset + row * sizeof(ChunkRow) + 20] ^= 0x40;
        write_file(folder / "d", bytes);
        const StoreReader local(folder / "d");
        const StoreReader remote(std::make_shared<const RemoteBytes>(bytes));
        for (const StoreReader* store : {&local, &remote}) {
            for (const ArrayInfo& array : store->layout().arrays()) {
                for (std::int64_t i = 0; i < array.grid.product(); ++i) {
                    const Int3 chunk = array.grid.unlinear(i);
                    const bool there = array.row_of(chunk) / kRowsOfPage == damaged;
                    CHECK(failure([&] { static_cast<void>(store->row(array, chunk)); }) ==
                          (there ? std::optional(ErrorKind::corrupt) : std::nullopt));
                }
            }
        }
        const CheckReport report = check(local, {}, silent_progress());
        // Its chunks, and the footer, whose checksum does not match.
        CHECK(report.failures == row - damaged * kRowsOfPage + 1 + 1);
        CHECK(report.findings[0].test == "table");
    }
}

TEST_CASE("the pages kept of a remote table stay within the limit for any access") {
    constexpr std::uint64_t kPages = 5;
    std::vector<ChunkRow> rows(kPages * kMaxRowsOfPage - 7);
    for (std::size_t i = 0; i < rows.size(); ++i) {
        rows[i].offset = i;
    }
    const auto table = std::as_bytes(std::span(rows));
    const std::size_t page = kMaxRowsOfPage * sizeof(ChunkRow);
    REQUIRE(page * kPages > 2 * ChunkTable::kMaxHeld);
    std::vector<std::uint64_t> sums;
    for (std::size_t i = 0; i < table.size(); i += page) {
        sums.push_back(checksum_of(table.subspan(i, std::min(page, table.size() - i))));
    }
    const RemoteBytes bytes({reinterpret_cast<const char*>(table.data()), table.size()});
    FoundCatalogue found;
    found.tail_begin = table.size();
    found.catalogue.table = {0, rows.size(), kMaxRowsOfPage, 0, std::as_bytes(std::span(sums))};
    const ChunkTable remote(bytes, found);
    for (const std::size_t step : {std::size_t{1}, kMaxRowsOfPage}) {
        for (std::size_t i = 0; i < 40; ++i) {
            const std::size_t at = i * step % rows.size();
            REQUIRE(remote.row(at).offset == at);
        }
    }
    CHECK(bytes.reads().size() > kPages);  // replaced pages were read again
    CHECK(failure([&] { static_cast<void>(remote.row(rows.size() - 1)); }) == std::nullopt);
}

TEST_CASE("chunks of a remote store are prefetched together, after the pages that locate them") {
    const TemporaryFolder folder;
    // Pages that are not all in the end that is read first.
    FunctionVolume<std::uint8_t> volume(
        {150, 145, 140}, [](const Int3& p) { return static_cast<std::uint8_t>(255 * noise(p)); });
    make_store(volume, folder / "s", with_chunk(8));
    const auto bytes = std::make_shared<const RemoteBytes>(read_file(folder / "s"));
    const StoreReader store(bytes);
    const CatalogueTable& place = *store.catalogue()->catalogue.table;
    REQUIRE(place.offset < store.catalogue()->tail_begin);
    static_cast<void>(bytes->reads());
    const ArrayInfo& values = store.layout().array(0, Field::values);
    const std::vector<WantedChunk> chunks{
        {&values, {0, 0, 0}}, {&values, {1, 0, 0}}, {&values, {0, 0, 9}}, {&values, {99, 0, 0}}};
    store.prefetch_all(chunks);
    const std::vector<ByteRange> wanted = bytes->wanted();
    REQUIRE(wanted.size() == 5);
    for (std::size_t i = 0; i < 2; ++i) {
        CHECK(lies_within(wanted[i].offset - place.offset, wanted[i].size, place.rows * 40));
        CHECK(wanted[i].size == kRowsOfPage * 40);
    }
    for (std::size_t i = 0; i < 3; ++i) {
        const ChunkRow row = store.row(values, chunks[i].chunk);
        CHECK(wanted[i + 2].offset == row.offset);
        CHECK(wanted[i + 2].size == row.bytes);
    }
    CHECK(bytes->reads().size() == 2);
    // Rows of a box are prefetched page by page, and those present are not prefetched again.
    const StoreReader another(bytes);
    static_cast<void>(bytes->reads());
    another.prefetch_rows(values, {0, 0, 9}, {1, 1, 10});
    CHECK(bytes->wanted().size() == 1);
    another.prefetch_rows(values, {0, 0, 0}, values.grid);
    const std::vector<ByteRange> pages = bytes->wanted();
    for (std::int64_t i = 0; i < values.grid.product(); ++i) {
        static_cast<void>(another.row(values, values.grid.unlinear(i)));
    }
    CHECK(pages.size() > 2);
    CHECK(bytes->reads().size() == pages.size());
    another.prefetch_rows(values, {0, 0, 0}, values.grid);
    CHECK(bytes->wanted().empty());
    // Ranges of coarse levels are prefetched together, and read plane by plane, each once.
    CHECK(store.cube_range(4, {0, 0, 0}));
    const std::vector<ByteRange> ranges = bytes->wanted();
    CHECK(ranges.size() == static_cast<std::size_t>(store.layout().lattice().top()) - 2);
    for (const ByteRange& plane : bytes->reads()) {
        CHECK(std::any_of(ranges.begin(), ranges.end(), [&](const ByteRange& level) {
            return plane.offset >= level.offset &&
                   plane.offset + plane.size <= level.offset + level.size;
        }));
    }
    CHECK(store.cube_range(5, {0, 0, 0}));
    CHECK(bytes->reads().empty());
    const StoreReader local(folder / "s");
    CHECK(store.cube_range(3, {1, 2, 3}) == local.cube_range(3, {1, 2, 3}));
}

TEST_CASE("every flipped bit after the end of HDF5's part is detected, or has no effect") {
    const TemporaryFolder folder;
    FunctionVolume<std::uint8_t> volume({9, 10, 11}, [](const Int3& p) {
        return static_cast<std::uint8_t>(p.x + 9 * p.y % 7 + p.z);
    });
    make_store(volume, folder / "s", with_chunk(8));
    const std::string whole = read_file(folder / "s");
    Extraction options;
    options.iso = 9.5;
    options.threads = 1;
    std::uint64_t begin = 0;
    {
        const StoreReader store(folder / "s");
        begin = store.catalogue()->footer.hdf5_end;
        extract(store, folder / "m.ply", options, silent_progress());
        CHECK(check(store, {}, silent_progress()).failures == 0);
    }
    const std::string expected = read_file(folder / "m.ply");
    CheckOptions quick;
    quick.depth = CheckDepth::quick;
    quick.threads = 1;
    int refused = 0;
    int harmless = 0;
    for (std::size_t at = begin; at < whole.size(); ++at) {
        CAPTURE(at - begin, whole.size() - at);
        std::string bytes = whole;
        bytes[at] = static_cast<char>(bytes[at] ^ (1 << (at % 8)));
        write_file(folder / "d", bytes);
        const auto kind = failure([&] {
            const StoreReader store(folder / "d");
            CHECK(check(store, quick, silent_progress()).failures == 1);
            extract(store, folder / "m.ply", options, silent_progress());
            CHECK(read_file(folder / "m.ply") == expected);
        });
        CHECK((!kind || kind == ErrorKind::corrupt));
        (kind ? refused : harmless) += 1;
        const auto remote = failure([&] {
            const StoreReader store(std::make_shared<const RemoteBytes>(bytes));
            extract(store, folder / "m.ply", options, silent_progress());
            CHECK(read_file(folder / "m.ply") == expected);
        });
        CHECK((!remote || remote == ErrorKind::corrupt || remote == ErrorKind::unsupported));
    }
    CHECK(refused > 500);  // the catalogue
    CHECK(harmless >
          10);  // the footer's magic, version and end of HDF5, zeros before the catalogue
    CHECK(harmless < 40);
    for (std::size_t size = begin; size < whole.size(); ++size) {
        write_file(folder / "d", whole.substr(0, size));
        const StoreReader store(folder / "d");
        CHECK(store.catalogue() == nullptr);
        CHECK(check(store, quick, silent_progress()).failures == (size > begin ? 1 : 0));
    }
}

TEST_CASE("unknown or longer records are ignored") {
    const TemporaryFolder folder;
    const std::string bytes = store_of_pages(folder);
    const RemoteBytes remote(bytes);
    const FoundCatalogue found = found_in(remote);
    const std::span<const std::byte> old = found.bytes.bytes();
    const auto later = [&](std::uint32_t tag, std::uint64_t size) {
        const std::array<std::uint32_t, 2> head{tag, 7};
        std::vector<std::byte> out(sizeof(head) + sizeof(size) + (size + 7) / 8 * 8);
        std::memcpy(out.data(), head.data(), sizeof(head));
        std::memcpy(out.data() + sizeof(head), &size, sizeof(size));
        return out;
    };
    std::vector<std::byte> changed;
    std::uint64_t longer = 0;
    for (std::size_t at = 0; at < old.size();) {
        std::array<std::uint64_t, 2> head{};
        std::memcpy(head.data(), old.data() + at, sizeof(head));
        const std::size_t end = at + sizeof(head) + (head[1] + 7) / 8 * 8;
        const auto tag = static_cast<std::uint32_t>(head[0]);
        const std::uint64_t more = tag == 2 || tag == 3 ? 8 : 0;
        longer += more;
        const std::vector<std::byte> before = later(1000 + tag, 13);
        changed.insert(changed.end(), before.begin(), before.end());
        head[1] += more;
        const auto first = std::as_bytes(std::span(head));
        changed.insert(changed.end(), first.begin(), first.end());
        changed.insert(changed.end(), old.begin() + static_cast<std::ptrdiff_t>(at + sizeof(head)),
                       old.begin() + static_cast<std::ptrdiff_t>(end));
        changed.resize(changed.size() + more);
        at = end;
    }
    REQUIRE(longer > 8);
    const std::uint64_t begin = found.footer.hdf5_end;
    const auto tail = bytes_behind_hdf5(begin, changed);
    write_file(folder / "d",
               bytes.substr(0, begin) +
                   std::string(reinterpret_cast<const char*>(tail.data()), tail.size()));
    const StoreReader store(folder / "d");
    REQUIRE(store.catalogue() != nullptr);
    CHECK(surface(store, folder) == surface(StoreReader(folder / "s"), folder));
    // A list that ends within a record is invalid.
    CHECK_FALSE(parse_catalogue(std::span(changed).first(changed.size() - 8)).has_value());
    const std::vector<std::byte> one = later(9, 8);
    CHECK(parse_catalogue(one).has_value());
    CHECK_FALSE(parse_catalogue(std::span(one).first(16)).has_value());
}
