// HDF5 over bytes from any source: it reads the same as from the file, with few reads of remote
// bytes, and an exception of a read reaches the caller unchanged.
#include <algorithm>
#include <array>
#include <atomic>
#include <catch2/catch.hpp>
#include <cstring>
#include <filesystem>
#include <stdexcept>
#include <string>
#include <string_view>
#include <thread>
#include <vector>

#include <isonest/error.h>

#include "store/bytes/store_bytes.h"
#include "store/container/parts/hdf5_types.h"
#include "store/container/parts/header_reader.h"
#include "store/hdf5/file_drivers.h"
#include "store/hdf5/zstd_filter.h"
#include "tests/support/test_support.h"

using namespace isonest;
using namespace isonest::detail;
using namespace isonest::detail::test;

namespace {

constexpr std::size_t kNever = static_cast<std::size_t>(-1);

/// A type that nothing else throws.
struct ReadFailed {
    std::size_t read = 0;
};

/// Counts reads, and throws at one of them.
class CountedBytes : public StoreBytes {
  public:
    CountedBytes(const std::filesystem::path& file, bool is_remote)
        : name_("https://host/" + file.filename().string()),
          text_(read_file(file)),
          is_remote_(is_remote) {}

    [[nodiscard]] const std::string& name() const override { return name_; }
    [[nodiscard]] std::uint64_t size() const override { return text_.size(); }
    [[nodiscard]] bool is_remote() const override { return is_remote_; }
    [[nodiscard]] HeldBytes read(std::uint64_t offset, std::uint64_t size) const override {
        if (size == 0 || offset + size > text_.size()) {
            throw std::logic_error("a read outside the bytes");
        }
        const std::size_t number = reads_++;
        if (number == fails_at_) {
            throw ReadFailed{number};
        }
        bytes_ += size;
        max_ = std::max(max_.load(), size);
        // A copy that is freed as soon as nothing holds it.
        const auto copy = std::make_shared<std::vector<char>>(
            text_.begin() + static_cast<std::ptrdiff_t>(offset),
            text_.begin() + static_cast<std::ptrdiff_t>(offset + size));
        return {copy, std::as_bytes(std::span(*copy))};
    }
    void want(std::span<const ByteRange> /*ranges*/) const override {}

    void fail_at(std::size_t read) {
        fails_at_ = read;
        reads_ = 0;
    }
    [[nodiscard]] std::size_t reads() const { return reads_; }
    [[nodiscard]] std::uint64_t bytes() const { return bytes_; }
    /// The size of the longest read.
    [[nodiscard]] std::uint64_t most() const { return max_; }

  private:
    std::string name_;
    std::string text_;
    bool is_remote_;
    std::size_t fails_at_ = kNever;
    mutable std::atomic<std::size_t> reads_ = 0;
    mutable std::atomic<std::uint64_t> bytes_ = 0;
    mutable std::atomic<std::uint64_t> max_ = 0;
};

template <class T>
T checked(T status) {
    if (status < 0) {
        throw std::runtime_error("HDF5 failed: " + hdf5_message());
    }
    return status;
}

std::size_t bytes_of(hid_t type, hid_t space) {
    const auto count = static_cast<std::size_t>(checked(H5Sget_simple_extent_npoints(space)));
    return count * H5Tget_size(type);
}

void add_attributes(hid_t object, std::string& out) {
    H5O_info_t info{};
    checked(H5Oget_info2(object, &info, H5O_INFO_NUM_ATTRS));
    for (hsize_t i = 0; i < info.num_attrs; ++i) {
        const AttributeHandle attribute(checked(
            H5Aopen_by_idx(object, ".", H5_INDEX_NAME, H5_ITER_INC, i, H5P_DEFAULT, H5P_DEFAULT)));
        const TypeHandle type(checked(H5Aget_type(attribute.get())));
        const SpaceHandle space(checked(H5Aget_space(attribute.get())));
        std::array<char, 256> name{};
        checked(H5Aget_name(attribute.get(), name.size(), name.data()));
        std::string bytes(bytes_of(type.get(), space.get()), '\0');
        checked(H5Aread(attribute.get(), type.get(), bytes.data()));
        out += std::string("@") + name.data() + "=" + bytes + "\n";
    }
}

void add_data(hid_t dataset, std::string& out) {
    const SpaceHandle space(checked(H5Dget_space(dataset)));
    const PropertyHandle creation(checked(H5Dget_create_plist(dataset)));
    if (checked(H5Pget_layout(creation.get())) != H5D_CHUNKED) {
        const TypeHandle type(checked(H5Dget_type(dataset)));
        std::string bytes(bytes_of(type.get(), space.get()), '\0');
        checked(H5Dread(dataset, type.get(), H5S_ALL, H5S_ALL, H5P_DEFAULT, bytes.data()));
        out += bytes;
        return;
    }
    hsize_t chunks = 0;
    checked(H5Dget_num_chunks(dataset, space.get(), &chunks));
    for (hsize_t i = 0; i < chunks; ++i) {
        std::array<hsize_t, 4> at{};
        unsigned mask = 0;
        haddr_t address = 0;
        hsize_t size = 0;
        checked(H5Dget_chunk_info(dataset, space.get(), i, at.data(), &mask, &address, &size));
        std::string bytes(size, '\0');
        checked(H5Dread_chunk(dataset, H5P_DEFAULT, at.data(), &mask, bytes.data()));
        out += bytes;
    }
}

/// Everything in a file, as HDF5 reads it. Throws std::runtime_error if it cannot be read.
std::string contents(hid_t file) {
    const QuietHdf5 quiet;
    std::vector<std::string> names;
    checked(H5Ovisit2(
        file, H5_INDEX_NAME, H5_ITER_INC,
        [](hid_t /*root*/, const char* name, const H5O_info_t* /*info*/, void* to) -> herr_t {
            static_cast<std::vector<std::string>*>(to)->emplace_back(name);
            return 0;
        },
        &names, H5O_INFO_BASIC));
    std::string out;
    for (const std::string& name : names) {
        const hid_t object = checked(H5Oopen(file, name.c_str(), H5P_DEFAULT));
        const bool is_dataset = H5Iget_type(object) == H5I_DATASET;
        const GroupHandle group(is_dataset ? H5I_INVALID_HID : object);
        const DatasetHandle dataset(is_dataset ? object : H5I_INVALID_HID);
        out += name + "\n";
        add_attributes(object, out);
        if (is_dataset) {
            add_data(object, out);
        }
    }
    return out;
}

/// contents(), or nothing if HDF5 cannot open or read it.
template <class F>
std::string contents_or_nothing(const F& open) {
    const QuietHdf5 quiet;
    const FileHandle file = open();
    if (!file.valid()) {
        return {};
    }
    try {
        return contents(file.get());
    } catch (const std::runtime_error&) {
        return {};
    }
}

std::filesystem::path golden_folder() {
    return std::filesystem::path(ISONEST_FUZZ_CORPUS) / ".." / ".." / "store" / "golden";
}

/// Noise, so that chunks are large and there are some of each kind.
void make_noisy_store(const std::filesystem::path& path) {
    FunctionVolume<float> volume({65, 66, 67},
                                 [](const Int3& p) { return static_cast<float>(noise(p)); });
    make_store(volume, path, with_chunk(32));
}

/// Reads a whole file over `bytes`, as a caller does.
std::string read_over(const std::shared_ptr<const StoreBytes>& bytes) {
    const QuietHdf5 quiet;
    const FileHandle file = open_hdf5(bytes);
    if (!file.valid()) {
        throw std::runtime_error("not opened");
    }
    return reading(file.get(), [&] { return contents(file.get()); });
}

/// Makes each read fail in turn: the failure is reported as often as it is asked for, and nothing
/// stays open. After opening again, the file gives everything.
void fail_everywhere(const std::shared_ptr<CountedBytes>& bytes, const std::string& expected) {
    const QuietHdf5 quiet;
    bytes->fail_at(kNever);
    REQUIRE((read_over(bytes) == expected));
    const std::size_t reads = bytes->reads();
    REQUIRE(reads > 0);
    for (std::size_t n = 0; n < reads; ++n) {
        CAPTURE(n, reads);
        bytes->fail_at(n);
        std::size_t failed_at = kNever;
        try {
            const FileHandle file = open_hdf5(bytes);
            REQUIRE(file.valid());
            try {
                reading(file.get(), [&] { return contents(file.get()); });
            } catch (const ReadFailed& failure) {
                failed_at = failure.read;
                CHECK_THROWS_AS(rethrow_failed_read(file.get()), ReadFailed);
                CHECK(bytes->reads() == n + 1);
            }
        } catch (const ReadFailed& failure) {
            failed_at = failure.read;
        }
        CHECK(failed_at == n);
        CHECK(bytes.use_count() == 1);
    }
    bytes->fail_at(kNever);
    CHECK((read_over(bytes) == expected));
}

}  // namespace

TEST_CASE("HDF5 reads the same over bytes as from a file, for stores of every version") {
    register_zstd_filter();
    std::size_t stores = 0;
    std::size_t read = 0;
    for (const auto& entry : std::filesystem::directory_iterator(golden_folder())) {
        if (entry.path().extension() != ".store") {
            continue;
        }
        CAPTURE(entry.path().string());
        ++stores;
        const std::string expected = contents_or_nothing([&] { return open_hdf5(entry.path()); });
        read += expected.empty() ? 0 : 1;
        const auto file = std::make_shared<FileBytes>(entry.path());
        const auto remote = std::make_shared<CountedBytes>(entry.path(), true);
        CHECK(contents_or_nothing([&] { return open_hdf5(file); }) == expected);
        CHECK(contents_or_nothing([&] { return open_hdf5(remote); }) == expected);
        CHECK(remote->bytes() <= remote->size());
        CHECK(file.use_count() == 1);
        CHECK(remote.use_count() == 1);
    }
    CHECK(stores > 20);
    CHECK(read > 15);
}

TEST_CASE("a store of many chunks reads the same over bytes") {
    register_zstd_filter();
    const TemporaryFolder folder;
    const auto path = folder / "a.isonest";
    make_noisy_store(path);
    const std::string expected = contents_or_nothing([&] { return open_hdf5(path); });
    REQUIRE(expected.size() > 8 * kDriverBlock);
    const auto near = std::make_shared<CountedBytes>(path, false);
    const auto remote = std::make_shared<CountedBytes>(path, true);
    CHECK((read_over(std::make_shared<FileBytes>(path)) == expected));
    CHECK((read_over(near) == expected));
    CHECK((read_over(remote) == expected));
    CHECK(remote->reads() < near->reads() / 2);
}

TEST_CASE("opening an older store takes few reads of remote bytes") {
    const TemporaryFolder folder;
    const auto path = folder / "a.isonest";
    make_noisy_store(path);
    const QuietHdf5 quiet;
    const auto remote = std::make_shared<CountedBytes>(path, true);
    const FileHandle file = open_hdf5(remote);
    reading(file.get(), [&] {
        CHECK(read_root_attributes(file.get(), remote->name()).header.nodes == Int3{65, 66, 67});
        const DatasetHandle table(checked(H5Dopen2(file.get(), "chunks", H5P_DEFAULT)));
        CHECK(read_integers(table.get(), "xxh64", 1));
        CHECK(H5Dget_offset(table.get()) != HADDR_UNDEF);
    });
    CHECK(remote->reads() <= 4);
    CHECK(remote->bytes() <= remote->size() / 4);
}

TEST_CASE("an exception thrown by any read ends in that error") {
    register_zstd_filter();
    const TemporaryFolder folder;
    const auto path = folder / "a.isonest";
    for (const char* name : {"1.0.store", "2.3.store", "2.8-named.store"}) {
        CAPTURE(name);
        const auto golden = golden_folder() / name;
        const std::string expected = contents_or_nothing([&] { return open_hdf5(golden); });
        REQUIRE_FALSE(expected.empty());
        // With local bytes, each read of HDF5 is one read.
        fail_everywhere(std::make_shared<CountedBytes>(golden, false), expected);
        fail_everywhere(std::make_shared<CountedBytes>(golden, true), expected);
    }
    make_noisy_store(path);
    const std::string expected = contents_or_nothing([&] { return open_hdf5(path); });
    fail_everywhere(std::make_shared<CountedBytes>(path, true), expected);
}

TEST_CASE("the exception keeps its type and message, and belongs to its file") {
    class Refused : public CountedBytes {
      public:
        using CountedBytes::CountedBytes;
        [[nodiscard]] HeldBytes read(std::uint64_t offset, std::uint64_t size) const override {
            if (refuses) {
                throw Error(ErrorKind::io, {name()}, "the server answered 503",
                            {{RemedyKind::good_copy}});
            }
            return CountedBytes::read(offset, size);
        }
        bool refuses = false;
    };
    const QuietHdf5 quiet;
    const auto golden = golden_folder() / "2.8-named.store";
    const auto bytes = std::make_shared<Refused>(golden, false);
    const auto other = std::make_shared<CountedBytes>(golden, false);
    const FileHandle file = open_hdf5(bytes);
    const FileHandle same = open_hdf5(bytes);
    const FileHandle second = open_hdf5(other);
    bytes->refuses = true;
    try {
        reading(file.get(), [&] { return contents(file.get()); });
        FAIL("was read");
    } catch (const Error& error) {
        CHECK(error.kind() == ErrorKind::io);
        CHECK(error.problem() == "the server answered 503");
        CHECK(error.remedies() == std::vector<Remedy>{{RemedyKind::good_copy}});
    }
    // Functions that take a failure for a missing object report it, too.
    CHECK_THROWS_AS(
        reading(same.get(),
                [&] { return H5Lexists(same.get(), "levels/1/values", H5P_DEFAULT) > 0; }),
        Error);
    bytes->refuses = false;
    CHECK_THROWS_AS(reading(file.get(), [&] { contents(file.get()); }), Error);
    CHECK_FALSE(reading(second.get(), [&] { return contents(second.get()); }).empty());
    CHECK_FALSE(read_over(bytes).empty());
    // A file opened by its path has no such failures, nor has an invalid handle.
    const FileHandle local = open_hdf5(golden);
    rethrow_failed_read(local.get());
    rethrow_failed_read(H5I_INVALID_HID);
}

TEST_CASE("much metadata takes few reads of remote bytes, and little memory") {
    const QuietHdf5 quiet;
    const TemporaryFolder folder;
    const auto path = folder / "many.h5";
    constexpr int kMany = 4000;
    {
        const FileHandle file = create_hdf5(path);
        const hsize_t numbers = 20;
        const SpaceHandle space(H5Screate_simple(1, &numbers, nullptr));
        for (int i = 0; i < kMany; ++i) {
            const std::string name = "dataset " + std::to_string(i);
            const DatasetHandle made(H5Dcreate2(file.get(), name.c_str(), H5T_STD_I64LE,
                                                space.get(), H5P_DEFAULT, H5P_DEFAULT,
                                                H5P_DEFAULT));
            const AttributeHandle attribute(H5Acreate2(made.get(), "numbers", H5T_STD_I64LE,
                                                       space.get(), H5P_DEFAULT, H5P_DEFAULT));
            const std::vector<std::int64_t> values(numbers, i);
            REQUIRE(H5Awrite(attribute.get(), H5T_NATIVE_INT64, values.data()) >= 0);
        }
    }
    const std::string expected = contents_or_nothing([&] { return open_hdf5(path); });
    const auto near = std::make_shared<CountedBytes>(path, false);
    const auto remote = std::make_shared<CountedBytes>(path, true);
    CHECK((read_over(near) == expected));
    CHECK((read_over(remote) == expected));
    const std::size_t blocks = remote->size() / kDriverBlock + 1;
    CAPTURE(remote->size(), near->reads(), remote->reads(), remote->bytes(), blocks);
    CHECK(near->reads() > kMany);
    CHECK(blocks > 10);
    CHECK(remote->reads() <= 2 * blocks / 3);
    CHECK(remote->bytes() <= 2 * remote->size());
    CHECK(remote->most() <= kDriverHolds / 4);
}

TEST_CASE("files over bytes are read-only, and do not open other files") {
    const QuietHdf5 quiet;
    const TemporaryFolder folder;
    const auto target = folder / "target.h5";
    const auto path = folder / "links.h5";
    { const FileHandle file = create_hdf5(target); }
    {
        const FileHandle file = create_hdf5(path);
        REQUIRE(H5Lcreate_external(target.c_str(), "/", file.get(), "elsewhere", H5P_DEFAULT,
                                   H5P_DEFAULT) >= 0);
    }
    const FileHandle local = open_hdf5(path);
    CHECK(GroupHandle(H5Gopen2(local.get(), "elsewhere", H5P_DEFAULT)).valid());
    const FileHandle file = open_hdf5(std::make_shared<FileBytes>(path));
    REQUIRE(file.valid());
    CHECK_FALSE(GroupHandle(H5Gopen2(file.get(), "elsewhere", H5P_DEFAULT)).valid());
    CHECK_FALSE(
        GroupHandle(H5Gcreate2(file.get(), "new", H5P_DEFAULT, H5P_DEFAULT, H5P_DEFAULT)).valid());
    rethrow_failed_read(file.get());
}

TEST_CASE("a file that is not HDF5 is not opened, and hdf5_cannot_open() says why") {
    const QuietHdf5 quiet;
    const TemporaryFolder folder;
    const auto path = folder / "text";
    for (const std::size_t size : {0, 5, 100'000}) {
        std::ofstream(path) << std::string(size, 'x');
        CHECK_FALSE(open_hdf5(path).valid());
        const std::string why = hdf5_cannot_open();
        for (const bool is_remote : {false, true}) {
            CHECK_FALSE(open_hdf5(std::make_shared<CountedBytes>(path, is_remote)).valid());
            CHECK(hdf5_cannot_open() == why);
        }
    }
}

TEST_CASE("several threads read files over the same bytes") {
    register_zstd_filter();
    const auto golden = golden_folder() / "2.7.store";
    const std::string expected = contents_or_nothing([&] { return open_hdf5(golden); });
    const auto bytes = std::make_shared<CountedBytes>(golden, true);
    std::atomic<int> same = 0;
    std::vector<std::thread> threads;
    for (int t = 0; t < 4; ++t) {
        threads.emplace_back([&] {
            for (int i = 0; i < 5; ++i) {
                same += read_over(bytes) == expected ? 1 : 0;
            }
        });
    }
    for (std::thread& thread : threads) {
        thread.join();
    }
    CHECK(same == 20);
    CHECK(bytes.use_count() == 1);
}
