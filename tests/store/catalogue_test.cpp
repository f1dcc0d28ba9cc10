// Numbers in a footer and a catalogue that no writer makes: each is refused before anything is
// allocated or read because of it.
#include <algorithm>
#include <array>
#include <catch2/catch.hpp>
#include <cstdint>
#include <cstring>
#include <memory>
#include <string>
#include <vector>

#include <isonest/error.h>
#include <isonest/label_name.h>

#include "store/base/checksum.h"
#include "store/container/parts/footer.h"
#include "store/container/parts/header_reader.h"
#include "store/container/reader.h"
#include "tests/support/remote_bytes.h"
#include "tests/support/test_support.h"

using namespace isonest;
using namespace isonest::detail;
using namespace isonest::detail::test;

namespace {

constexpr std::uint64_t kHuge = std::uint64_t{1} << 63U;
constexpr std::uint64_t kAll = ~std::uint64_t{0};

enum Record : std::uint32_t { table_record = 2, ranges_record = 3, names_record = 4 };

class NamedCells : public FunctionVolume<double> {
  public:
    NamedCells()
        : FunctionVolume({40, 36, 33}, [](const Int3& p) {
              const std::int64_t cell = p.x / 9 + p.y / 9 + p.z / 9;
              return static_cast<double>(cell);
          }) {}
    [[nodiscard]] VolumeDescription describe() const override {
        VolumeDescription d = FunctionVolume::describe();
        d.labels = true;
        return d;
    }
    [[nodiscard]] std::vector<LabelName> label_names() const override {
        return {{1, "one", {}}, {3, "three", LabelColor{1, 2, 3}}};
    }
};

/// The bytes of a store with names and several levels of ranges.
std::string named_store() {
    const TemporaryFolder folder;
    NamedCells volume;
    make_store(volume, folder / "s", with_chunk(8));
    return read_file(folder / "s");
}

/// The store with another catalogue and valid checksums.
std::string with_catalogue(const std::string& store, std::span<const std::byte> catalogue) {
    const RemoteBytes bytes(store);
    const std::uint64_t begin = found_in(bytes).footer.hdf5_end;
    const auto tail = bytes_behind_hdf5(begin, catalogue);
    return store.substr(0, begin) +
           std::string(reinterpret_cast<const char*>(tail.data()), tail.size());
}

std::vector<std::byte> catalogue_of(const std::string& store) {
    const RemoteBytes bytes(store);
    const FoundCatalogue found = found_in(bytes);
    const auto view = found.bytes.bytes();
    return {view.begin(), view.end()};
}

/// The position of the head of the first record of this kind.
std::size_t record_at(std::span<const std::byte> catalogue, Record kind) {
    for (std::size_t at = 0; at < catalogue.size();) {
        std::array<std::uint64_t, 2> head{};
        std::memcpy(head.data(), catalogue.data() + at, sizeof(head));
        if (static_cast<std::uint32_t>(head[0]) == kind) {
            return at;
        }
        at += sizeof(head) + (head[1] + 7) / 8 * 8;
    }
    FAIL("no such record");
    return 0;
}

/// The catalogue with another number in the first record of this kind: -1 is its length, others are
/// its content.
std::vector<std::byte> changed(std::vector<std::byte> catalogue, Record kind, std::ptrdiff_t which,
                               std::uint64_t number) {
    const std::size_t at = record_at(catalogue, kind) +
                           static_cast<std::size_t>(16 + which * static_cast<std::ptrdiff_t>(8));
    std::memcpy(catalogue.data() + at, &number, sizeof(number));
    return catalogue;
}

std::string message_of(const std::string& store) {
    try {
        const StoreReader reader(std::make_shared<const RemoteBytes>(store));
        return "opens";
    } catch (const Error& error) {
        return error.what();
    }
}

}  // namespace

TEST_CASE("a catalogue of 64 MiB is read, and one with a greater length is not") {
    constexpr std::size_t kMax = std::size_t{64} << 20U;
    const std::string store = named_store();
    std::vector<std::byte> catalogue = catalogue_of(store);
    for (const bool is_too_long : {false, true}) {
        // A record of a later version.
        const std::uint64_t all = kMax + (is_too_long ? 8 : 0);
        const std::array<std::uint64_t, 2> head{1000, all - catalogue.size() - 16};
        std::vector<std::byte> longer = catalogue;
        longer.resize(all);
        std::memcpy(longer.data() + catalogue.size(), head.data(), sizeof(head));
        const std::string bytes = with_catalogue(store, longer);
        const std::string message = message_of(bytes);
        CHECK((message == "opens") == !is_too_long);
        CHECK((message.find("invalid length of the catalogue") != std::string::npos) ==
              is_too_long);
    }
}

TEST_CASE("impossible rows, pages and planes in a catalogue are refused") {
    const std::string store = named_store();
    const std::vector<std::byte> good = catalogue_of(store);
    const std::uint64_t size = store.size();
    const RemoteBytes far(store);
    const FoundCatalogue found = found_in(far);
    const CatalogueTable table = *found.catalogue.table;
    REQUIRE(found.catalogue.names);
    REQUIRE(found.catalogue.ranges.size() > 1);
    REQUIRE(message_of(with_catalogue(store, good)) == "opens");
    struct Lie {
        Record record;
        std::ptrdiff_t which;
        std::vector<std::uint64_t> numbers;
    };
    const std::uint64_t max_name = LabelName::kMaxBytes;
    for (const Lie& lie : std::vector<Lie>{
             {table_record, -1, {8, 40, kHuge, kAll, kAll - 7, size}},
             {table_record, 0, {size, size - 39, kHuge, kAll, kAll - 40 * table.rows + 1}},
             {table_record, 1, {0, table.rows - 1, table.rows + 1, kHuge, kAll, kAll / 40}},
             {table_record, 2, {0, 39, 41, 48, kHuge, kAll}},
             {table_record, 3, {0, 1, kMaxRowsOfPage + 1, kHuge, kAll}},
             {table_record, 4, {0, 1000, kHuge, kAll, std::uint64_t{1} << 61U}},
             {ranges_record, -1, {0, 16, kHuge, kAll}},
             {ranges_record, 0, {size, kHuge, kAll}},
             {ranges_record, 1, {0, 1, size, kHuge, kAll}},
             {ranges_record, 2, {0, 1000, kHuge, kAll, std::uint64_t{1} << 61U}},
             {names_record, -1, {24, kHuge, kAll}},
             {names_record, 0, {size, size - 1, kHuge, kAll}},
             {names_record, 1, {0, 3, 65'537, std::uint64_t{1} << 60U, kHuge, kAll}},
             {names_record, 2, {0, 12, 12 + max_name + 1, 4096, std::uint64_t{1} << 62U, kAll}}}) {
        for (const std::uint64_t number : lie.numbers) {
            CAPTURE(lie.record, lie.which, number);
            const std::string bytes =
                with_catalogue(store, changed(good, lie.record, lie.which, number));
            CHECK(failure([&] {
                      // Ranges are checked when they are used.
                      const StoreReader reader(std::make_shared<const RemoteBytes>(bytes));
                      static_cast<void>(reader.cube_range(3, {0, 0, 0}));
                  }) == ErrorKind::corrupt);
        }
    }
}

TEST_CASE("unknown fields of a later version are ignored, up to 64 of them") {
    const std::string store = named_store();
    for (const int unknown : {1, 64, 65, 1000}) {
        CAPTURE(unknown);
        const RemoteBytes far(store);
        const FoundCatalogue found = found_in(far);
        Catalogue catalogue = found.catalogue;
        const std::string_view fields = [&] {
            const auto bytes = catalogue.find("fields")->bytes;
            return std::string_view(reinterpret_cast<const char*>(bytes.data()), bytes.size());
        }();
        std::string longer(fields.substr(0, fields.find('\0')));
        for (int i = 0; i < unknown; ++i) {
            longer += ",x" + std::to_string(i % 10);
        }
        const std::array<std::uint32_t, 2> version{kFormatMajor, kFormatMinor + 1};
        Checksum sum;
        std::uint64_t digest = 0;
        for (CatalogueAttribute& attribute : catalogue.attributes) {
            attribute.bytes = attribute.name == "fields"    ? std::as_bytes(std::span(longer))
                              : attribute.name == "version" ? std::as_bytes(std::span(version))
                                                            : attribute.bytes;
        }
        for (const char* name : kDigested) {
            sum.add(catalogue.find(name)->bytes);
        }
        digest = sum.value();
        for (CatalogueAttribute& attribute : catalogue.attributes) {
            if (attribute.name == "xxh64") {
                attribute.bytes = std::as_bytes(std::span(&digest, 1));
            }
        }
        const std::string message = message_of(with_catalogue(store, catalogue_bytes(catalogue)));
        INFO(message);
        // The table has no rows for fields that do not exist.
        CHECK(message.find(unknown <= 64 ? "chunk table" : "more than 64 unknown fields") !=
              std::string::npos);
        CHECK(message != "opens");
    }
}
