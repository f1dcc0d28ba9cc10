// Tests of check: stores with valid checksums and wrong contents.
#include "query/check/check.h"

#include <catch2/catch.hpp>

#include "store/hdf5/handles.h"
#include "tests/support/test_support.h"
#include "tests/support/thread_ranks.h"

using namespace isonest;
using namespace isonest::detail;
using namespace isonest::detail::test;

namespace {

constexpr Int3 kWhole{-1, -1, -1};

FunctionVolume<float> noisy_volume() {
    return {{17, 20, 18}, [](const Int3& p) { return static_cast<float>(noise(p)); }};
}

/// Changes a store as a program with a bug would: checksums match what is written.
class Forger {
  public:
    explicit Forger(const std::filesystem::path& path)
        : layout_(StoreReader(path).layout()), bytes_(read_file(path)) {
        file_ = FileHandle(H5Fopen(path.c_str(), H5F_ACC_RDWR, H5P_DEFAULT));
        table_ = DatasetHandle(H5Dopen2(file_.get(), "/chunks", H5P_DEFAULT));
        type_ = TypeHandle(H5Dget_type(table_.get()));
        rows_.resize(layout_.rows());
        REQUIRE(H5Dread(table_.get(), type_.get(), H5S_ALL, H5S_ALL, H5P_DEFAULT, rows_.data()) >=
                0);
    }
    Forger(const Forger&) = delete;
    Forger& operator=(const Forger&) = delete;
    ~Forger() {
        const AttributeHandle sum(H5Aopen(table_.get(), "xxh64", H5P_DEFAULT));
        const std::uint64_t value = checksum_of(std::as_bytes(std::span(rows_)));
        H5Dwrite(table_.get(), type_.get(), H5S_ALL, H5S_ALL, H5P_DEFAULT, rows_.data());
        H5Awrite(sum.get(), H5T_NATIVE_UINT64, &value);
    }

    [[nodiscard]] const StoreLayout& layout() const { return layout_; }
    [[nodiscard]] ChunkRow& row(const ArrayInfo& array, const Int3& chunk) {
        return rows_[array.row_of(chunk)];
    }
    /// Stores `bytes` unchanged as this chunk in HDF5's index.
    void store(const ArrayInfo& array, const Int3& chunk, const std::vector<std::byte>& bytes) {
        const DatasetHandle data = open(array);
        const auto at = place(array, chunk);
        REQUIRE(H5Dwrite_chunk(data.get(), H5P_DEFAULT, array.filter_mask(row(array, chunk)),
                               at.data(), bytes.size(), bytes.data()) >= 0);
    }
    /// The same, and updates the table.
    void put(const ArrayInfo& array, const Int3& chunk, const std::vector<std::byte>& bytes) {
        store(array, chunk, bytes);
        const DatasetHandle data = open(array);
        const auto at = place(array, chunk);
        haddr_t offset = 0;
        hsize_t size = 0;
        unsigned mask = 0;
        REQUIRE(H5Dget_chunk_info_by_coord(data.get(), at.data(), &mask, &offset, &size) >= 0);
        ChunkRow& r = row(array, chunk);
        r.offset = offset;
        r.bytes = static_cast<std::uint32_t>(size);
        r.checksum = checksum_of(bytes);
    }
    /// The chunk with its elements changed by f(elements).
    [[nodiscard]] std::vector<std::byte> changed(const ArrayInfo& array, const Int3& chunk,
                                                 const std::function<void(std::span<float>)>& f) {
        std::vector<float> elements(array.chunk_bytes() / sizeof(float));
        const ChunkRow& r = row(array, chunk);
        decode_chunk(std::as_bytes(std::span(bytes_)).subspan(r.offset, r.bytes), array.codec_of(r),
                     std::as_writable_bytes(std::span(elements)), {"test"});
        f(elements);
        std::vector<std::byte> out;
        encode_chunk(std::as_bytes(std::span(elements)), array.codec_of(r), out);
        return out;
    }
    /// Changes a chunk, and updates the table with its new contents.
    void change(const ArrayInfo& array, const Int3& chunk,
                const std::function<void(std::span<float>)>& f) {
        put(array, chunk, changed(array, chunk, [&](std::span<float> elements) {
                f(elements);
                ChunkRow& r = row(array, chunk);
                r.min = std::numeric_limits<double>::infinity();
                r.max = -r.min;
                const Int3 n = min(array.chunk, array.nodes - array.first_node(chunk));
                for (std::int64_t i = 0; i < n.product() * array.components; ++i) {
                    const Int3 node = n.unlinear(i / array.components);
                    const float e = elements[static_cast<std::size_t>(
                        array.chunk.linear(node) * array.components + i % array.components)];
                    r.min = std::min<double>(r.min, e);
                    r.max = std::max<double>(r.max, e);
                }
            }));
    }
    /// Changes one element, given by its lattice node and component.
    void set(const ArrayInfo& array, const Int3& node, int component,
             const std::function<float(float)>& f) {
        const Int3 chunk = array.chunk_of(node);
        const std::int64_t at = array.chunk.linear(node - array.first_node(chunk));
        change(array, chunk, [&](std::span<float> elements) {
            float& e = elements[static_cast<std::size_t>(at * array.components + component)];
            e = f(e);
        });
    }

  private:
    [[nodiscard]] DatasetHandle open(const ArrayInfo& array) const {
        return DatasetHandle(
            H5Dopen2(file_.get(), StoreLayout::path_of(array).c_str(), H5P_DEFAULT));
    }
    [[nodiscard]] static std::array<hsize_t, 4> place(const ArrayInfo& array, const Int3& chunk) {
        const Int3 n = array.first_node(chunk);
        return {static_cast<hsize_t>(n.z), static_cast<hsize_t>(n.y), static_cast<hsize_t>(n.x), 0};
    }

    StoreLayout layout_;
    std::string bytes_;  ///< of the file before the changes
    FileHandle file_;
    DatasetHandle table_;
    TypeHandle type_;
    std::vector<ChunkRow> rows_;
};

/// Checks that ranks together find the same as one process.
void require_same_on_ranks(const std::filesystem::path& path, const CheckOptions& options,
                           const CheckReport& expected) {
    for (const int count : {2, 5}) {
        CAPTURE(count);
        CheckReport report;
        isonest::test::ThreadRanks(count).run([&](Communicator& ranks) {
            CheckReport found = check(StoreReader(path), options, silent_progress(), &ranks);
            if (ranks.rank() == 0) {
                report = std::move(found);
            }
        });
        CHECK(report.chunks == expected.chunks);
        CHECK(report.nodes == expected.nodes);
        CHECK(report.cubes == expected.cubes);
        CHECK(report.failures == expected.failures);
        REQUIRE(report.findings.size() == expected.findings.size());
        for (std::size_t i = 0; i < report.findings.size(); ++i) {
            const Finding& a = report.findings[i];
            const Finding& b = expected.findings[i];
            CHECK((a.test == b.test && a.field == b.field && a.level == b.level &&
                   a.chunk == b.chunk && a.node == b.node && a.message == b.message));
        }
    }
}

CheckReport checked(const std::filesystem::path& path, const CheckOptions& options = {}) {
    CheckReport report = check(StoreReader(path), options, silent_progress());
    require_same_on_ranks(path, options, report);
    return report;
}

/// A valid store of noise, exact, in chunks of 8.
struct Made {
    TemporaryFolder folder;
    std::filesystem::path path = folder / "s";
    FunctionVolume<float> volume = noisy_volume();
    Made() {
        make_store(volume, path, with_chunk(8, true));
        REQUIRE(checked(path).failures == 0);
    }
};

void require_one(const CheckReport& report, const char* test, int level, const Int3& chunk,
                 const Int3& node) {
    REQUIRE(report.failures == 1);
    const Finding& f = report.findings.at(0);
    CHECK(f.test == test);
    CHECK(f.level == level);
    CHECK(f.chunk == chunk);
    CHECK(f.node == node);
}

}  // namespace

TEST_CASE("check finds a coarse value that differs from the finer level") {
    const Made made;
    {
        Forger forger(made.path);
        forger.set(forger.layout().array(1, Field::values), {3, 9, 5}, 0,
                   [](float v) { return v / 2; });
    }
    require_one(checked(made.path), "injection", 1, {0, 1, 0}, {6, 18, 10});
}

TEST_CASE("check finds an indicator below that of its child") {
    const Made made;
    {
        Forger forger(made.path);
        forger.set(forger.layout().array(2, Field::deviation_bar), {1, 2, 1}, slot_of({1, 0, 0}),
                   [](float) { return 0.0F; });
    }
    const CheckReport report = checked(made.path);
    CHECK(report.failures == 8);  // the cubes around an edge's midpoint
    for (const Finding& f : report.findings) {
        CHECK(f.test == "saturation");
        CHECK(f.level == 2);
        CHECK(f.node == Int3{6, 8, 4});
    }
}

TEST_CASE("check finds an indicator of level 1 that does not follow from the values") {
    for (const float factor : {0.99F, 1.05F}) {
        const Made made;
        {
            Forger forger(made.path);
            forger.set(forger.layout().array(1, Field::linf_bar), {2, 1, 3}, 0,
                       [&](float v) { return v * factor; });
        }
        const CheckReport report = checked(made.path);
        const auto at = std::find_if(report.findings.begin(), report.findings.end(),
                                     [](const Finding& f) { return f.test == "indicator"; });
        REQUIRE(at != report.findings.end());
        CHECK(at->level == 1);
        CHECK(at->node == Int3{5, 3, 7});
    }
}

TEST_CASE("check finds a row of the table that does not match the chunk") {
    const Made made;
    const Int3 chunk{1, 0, 2};
    SECTION("the smallest value") {
        Forger forger(made.path);
        forger.row(forger.layout().array(0, Field::values), chunk).min += 0.001;
    }
    SECTION("the largest value") {
        Forger forger(made.path);
        forger.row(forger.layout().array(0, Field::values), chunk).max = 0.5;
    }
    require_one(checked(made.path), "range", 0, chunk, kWhole);
}

TEST_CASE("check finds a row of a coarse level that claims missing values") {
    const Made made;
    {
        Forger forger(made.path);
        forger.row(forger.layout().array(1, Field::values), {0, 0, 0}).flags = kChunkHasMissing;
    }
    require_one(checked(made.path), "range", 1, {0, 0, 0}, kWhole);
}

TEST_CASE("a table that contradicts the header's range is refused") {
    const Made made;
    {
        Forger forger(made.path);
        ChunkRow& row = forger.row(forger.layout().array(0, Field::values), {1, 0, 2});
        SECTION("the smallest value") {
            row.min -= 1;
        }
        SECTION("a claim of missing values") {
            row.flags = kChunkHasMissing;
        }
    }
    CHECK_THROWS_WITH(StoreReader(made.path), Catch::Contains("the chunk table"));
}

TEST_CASE("check finds reserved flags in the table, also with depth quick") {
    const Made made;
    {
        Forger forger(made.path);
        forger.row(forger.layout().array(0, Field::values), {1, 0, 2}).flags = 4;
    }
    CheckOptions quick;
    quick.depth = CheckDepth::quick;
    require_one(checked(made.path, quick), "table", 0, {1, 0, 2}, kWhole);
}

TEST_CASE("check finds a chunk that cannot be decoded although its checksum is valid") {
    const Made made;
    {
        Forger forger(made.path);
        const ArrayInfo& array = forger.layout().array(1, Field::linf_plus);
        forger.put(array, {0, 0, 0}, std::vector<std::byte>(100, std::byte{7}));
    }
    require_one(checked(made.path), "decode", 1, {0, 0, 0}, kWhole);
}

TEST_CASE("only a deep check finds that HDF5's index and the table differ") {
    const Made made;
    {
        Forger forger(made.path);
        const ArrayInfo& array = forger.layout().array(0, Field::values);
        forger.store(array, {0, 1, 0},
                     forger.changed(array, {0, 1, 0}, [](std::span<float> e) { e[17] = 0; }));
    }
    CHECK(checked(made.path).failures == 0);
    CheckOptions deep;
    deep.depth = CheckDepth::deep;
    require_one(checked(made.path, deep), "hdf5", 0, {0, 1, 0}, kWhole);
}

TEST_CASE("check of a store with damage in many places") {
    const Made made;
    {
        Forger forger(made.path);
        for (const int level : {0, 1}) {
            const ArrayInfo& values = forger.layout().array(level, Field::values);
            forger.put(values, {0, 0, 0}, std::vector<std::byte>(100, std::byte{7}));
            forger.put(values, {1, 1, 1}, std::vector<std::byte>(100, std::byte{7}));
            forger.row(values, {1, 0, 1}).checksum ^= 1U;
        }
        forger.row(forger.layout().array(1, Field::linf_plus), {0, 0, 0}).checksum ^= 1U;
    }
    for (const CheckDepth depth : {CheckDepth::quick, CheckDepth::standard, CheckDepth::deep}) {
        CheckOptions options;
        options.depth = depth;
        CHECK(checked(made.path, options).failures >= 3);
    }
}

TEST_CASE("check finds the node that differs from the source") {
    const Made made;
    FunctionVolume<float> other(made.volume.nodes(), [&](const Int3& p) {
        return static_cast<float>(made.volume.at(p)) + (p == Int3{16, 11, 7} ? 1.0F : 0.0F);
    });
    CheckOptions options;
    options.source = &other;
    options.sampled_cubes = 10;
    require_one(checked(made.path, options), "source", 0, {2, 1, 0}, {16, 11, 7});
}

TEST_CASE("check finds bounds that are too small, and names the same first ones for any threads") {
    Made made;
    {
        Forger forger(made.path);
        const ArrayInfo& array = forger.layout().array(2, Field::deviation_bar);
        forger.change(array, {0, 0, 0},
                      [](std::span<float> e) { std::fill(e.begin(), e.end(), 0.0F); });
    }
    CheckOptions options;
    options.source = &made.volume;
    options.sampled_cubes = 300;
    const CheckReport all = checked(made.path, options);
    CHECK(all.failures > 500);
    REQUIRE(all.findings.size() == 100);
    for (const int threads : {1, 2, 5}) {
        options.threads = threads;
        const CheckReport again = checked(made.path, options);
        CHECK(again.failures == all.failures);
        REQUIRE(again.findings.size() == 100);
        for (std::size_t i = 0; i < 100; ++i) {
            CHECK(again.findings[i].test == all.findings[i].test);
            CHECK(again.findings[i].node == all.findings[i].node);
            CHECK(again.findings[i].message == all.findings[i].message);
        }
    }
    // Nothing else is wrong in a store of one level, so the bounds are reported first.
    const TemporaryFolder folder;
    FunctionVolume<float> cube({3, 3, 3},
                               [](const Int3& p) { return static_cast<float>(noise(p)); });
    make_store(cube, folder / "s", with_chunk(8, true));
    {
        Forger forger(folder / "s");
        forger.set(forger.layout().array(1, Field::linf_plus), {0, 0, 0}, 0,
                   [](float) { return 0.0F; });
    }
    options.source = &cube;
    const CheckReport report = checked(folder / "s", options);
    CHECK(report.failures > 100);
    CHECK(report.findings.at(0).test == "indicator");
    CHECK(report.findings.at(1).test == "bound");
    CHECK(report.findings.at(1).node == Int3{1, 1, 1});
}
