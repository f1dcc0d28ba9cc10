// Flipped bytes and truncation: a correct result or a clear error, never a wrong mesh.
//
// ISONEST_FLIPS=10000 ISONEST_TRUNCATIONS=1000 in the environment: the numbers of tries.
#include <sys/resource.h>

#include <catch2/catch.hpp>
#include <cstdlib>
#include <random>

#include <isonest/error.h>

#include "query/check/check.h"
#include "query/extract/extract.h"
#include "tests/support/sanitized.h"
#include "tests/support/test_support.h"

using namespace isonest;
using namespace isonest::detail;
using namespace isonest::detail::test;

namespace {

int times(const char* name, int otherwise) {
    const char* const text = std::getenv(name);
    return text != nullptr ? std::atoi(text) : otherwise;
}

void write_file(const std::filesystem::path& path, const std::string& bytes) {
    std::ofstream out(path, std::ios::binary);
    out << bytes;
}

bool is_clean(ErrorKind kind) {
    return kind == ErrorKind::corrupt || kind == ErrorKind::unsupported;
}

/// The results for damaged stores.
struct Outcomes {
    int right = 0;    ///< opened, and all meshes are those of the undamaged store
    int refused = 0;  ///< some command ended with an error of the right kind
    int found = 0;    ///< check had a finding
    int wrong = 0;
};

struct Expected {
    std::array<std::string, 3> meshes;
    double iso;
    const char* name;  ///< of the mesh file
};

Extraction extraction_of(const Expected& expected, std::size_t i) {
    Extraction options;
    options.iso = expected.iso;
    options.error_relative = std::array<double, 3>{0, 0.05, 0.4}[i];
    options.memory = std::uint64_t{64} << 20U;
    options.threads = 1;
    return options;
}

Expected expectation(const std::filesystem::path& path, double iso, const char* name,
                     const TemporaryFolder& folder) {
    Expected expected{{}, iso, name};
    const StoreReader store(path);
    for (std::size_t i = 0; i < 3; ++i) {
        extract(store, folder / name, extraction_of(expected, i), silent_progress());
        expected.meshes[i] = read_file(folder / name);
    }
    return expected;
}

void try_store(const std::filesystem::path& path, const Expected& expected,
               const TemporaryFolder& folder, Outcomes& outcomes) {
    bool refused = false;
    bool wrong = false;
    const auto attempt = [&](const auto& f) {
        try {
            f();
        } catch (const Error& error) {
            refused = true;
            wrong = wrong || !is_clean(error.kind());
            if (!is_clean(error.kind())) {
                FAIL_CHECK("an error of the wrong kind: " << error.what());
            }
        }
    };
    attempt([&] {
        const StoreReader store(path);
        for (std::size_t i = 0; i < 3; ++i) {
            attempt([&] {
                extract(store, folder / expected.name, extraction_of(expected, i),
                        silent_progress());
                wrong = wrong || read_file(folder / expected.name) != expected.meshes[i];
            });
        }
        attempt([&] {
            CheckOptions options;
            options.threads = 1;
            options.memory = std::uint64_t{64} << 20U;
            options.depth = CheckDepth::deep;
            if (check(store, options, silent_progress()).failures > 0) {
                ++outcomes.found;
            } else if (refused) {
                FAIL_CHECK("check finds nothing wrong where a query failed");
            }
        });
    });
    outcomes.right += !refused && !wrong ? 1 : 0;
    outcomes.refused += refused ? 1 : 0;
    outcomes.wrong += wrong ? 1 : 0;
    for (const std::string& name : folder.names()) {
        CHECK(name.find(".partial-") == std::string::npos);
    }
}

/// For stores of a few hundred kilobytes, a larger heap would be an allocation caused by a false
/// size.
struct HeapLimit {
    HeapLimit() {
#ifndef SANITIZED
        ::getrlimit(RLIMIT_DATA, &before);
        const rlimit limit{rlim_t{1} << 30U, before.rlim_max};
        ::setrlimit(RLIMIT_DATA, &limit);
#endif
    }
    HeapLimit(const HeapLimit&) = delete;
    HeapLimit& operator=(const HeapLimit&) = delete;
    ~HeapLimit() {
#ifndef SANITIZED
        ::setrlimit(RLIMIT_DATA, &before);
#endif
    }
    rlimit before{};
};

template <class T>
void damage(const Int3& nodes, const std::function<T(const Int3&)>& f, double iso,
            const PreprocessOptions& options, int flips, int cuts) {
    const HeapLimit limit;
    const TemporaryFolder folder;
    FunctionVolume<T> volume(nodes, f);
    make_store(volume, folder / "s", options);
    const std::string whole = read_file(folder / "s");
    const Expected expected =
        expectation(folder / "s", iso, nodes.z > 1 ? "m.ply" : "m.obj", folder);
    std::mt19937_64 random(static_cast<std::uint64_t>(nodes.product()));
    // Covers all kinds of places: metadata, table and values at the ends are small compared with
    // the chunks.
    const auto place = [&] {
        const std::size_t kind = random() % 4;
        const std::size_t size = whole.size();
        const std::size_t edge = std::min<std::size_t>(size, 8192);
        return kind == 0   ? random() % edge
               : kind == 1 ? size - 1 - random() % edge
                           : random() % size;
    };
    Outcomes flipped;
    for (int i = 0; i < flips; ++i) {
        std::string bytes = whole;
        const std::size_t at = place();
        const auto bit = static_cast<char>(random() % 255 + 1);
        CAPTURE(i, at, static_cast<int>(bit));
        bytes[at] = static_cast<char>(bytes[at] ^ bit);
        write_file(folder / "d", bytes);
        try_store(folder / "d", expected, folder, flipped);
        CHECK(flipped.wrong == 0);
    }
    CHECK(flipped.right + flipped.refused == flips);
    CHECK(flipped.refused > 0);
    CHECK(flipped.found > flips / 2);
    // A store without a footer is opened through HDF5.
    const std::uint64_t hdf5_end = StoreReader(folder / "s").catalogue()->footer.hdf5_end;
    int behind = 0;
    Outcomes cut;
    for (int i = 0; i < cuts; ++i) {
        const std::size_t at = place();
        CAPTURE(i, at);
        write_file(folder / "d", whole.substr(0, at));
        try_store(folder / "d", expected, folder, cut);
        CHECK(cut.wrong == 0);
        behind += at >= hdf5_end ? 1 : 0;
    }
    CHECK(cut.right == behind);
    CHECK(cut.refused == cuts - behind);
    WARN(whole.size() << " bytes: " << flips << " flips: " << flipped.right << " harmless, "
                      << flipped.refused << " refused, " << flipped.found << " found by check; "
                      << cuts << " truncations, " << cut.refused << " refused");
}

}  // namespace

TEST_CASE("flipped bytes and truncation give a correct mesh or a clear error") {
    const int flips = times("ISONEST_FLIPS", 240);
    const int cuts = times("ISONEST_TRUNCATIONS", 45);
    damage<float>(
        {21, 18, 19}, [](const Int3& p) { return static_cast<float>(smooth(p)); }, 0.2,
        with_chunk(8), flips / 4, cuts / 4);
    damage<std::uint8_t>(
        {33, 20, 17}, [](const Int3& p) { return static_cast<std::uint8_t>(100 + 40 * smooth(p)); },
        110, with_chunk(16, true), flips / 4, cuts / 4);
    PreprocessOptions all = with_chunk(8);
    all.fields = node_indicators();
    damage<std::int16_t>(
        {40, 30, 1}, [](const Int3& p) { return static_cast<std::int16_t>(900 * smooth(p)); }, 99,
        all, flips / 4, cuts / 4);
    damage<std::int16_t>(
        {18, 17, 20}, [](const Int3& p) { return static_cast<std::int16_t>(900 * smooth(p)); }, 99,
        all, flips / 4, cuts / 4);
}

TEST_CASE("damage on a fine level does not affect a coarse surface") {
    const TemporaryFolder folder;
    FunctionVolume<float> volume({65, 65, 65},
                                 [](const Int3& p) { return static_cast<float>(p.x) + 0.25F; });
    make_store(volume, folder / "s", with_chunk(8));
    const Expected expected = expectation(folder / "s", 20, "m.ply", folder);
    std::string bytes = read_file(folder / "s");
    {
        const StoreReader store(folder / "s");
        const ArrayInfo& fine = store.layout().array(0, Field::values);
        for (std::int64_t i = 0; i < fine.grid.product(); ++i) {
            bytes[store.row(fine, fine.grid.unlinear(i)).offset + 12] ^= 0x10;
        }
    }
    write_file(folder / "d", bytes);
    const StoreReader damaged(folder / "d");
    extract(damaged, folder / "m.ply", extraction_of(expected, 2), silent_progress());
    CHECK(read_file(folder / "m.ply") == expected.meshes[2]);
    try {
        extract(damaged, folder / "m.ply", extraction_of(expected, 0), silent_progress());
        FAIL("the finest surface needs the damaged chunks");
    } catch (const Error& error) {
        CHECK(error.kind() == ErrorKind::corrupt);
        CHECK(std::string(error.what()).find("level 0, values, chunk") != std::string::npos);
    }
    const CheckReport report = check(damaged, {}, silent_progress());
    CHECK(report.failures == 729);
    for (const Finding& f : report.findings) {
        CHECK(f.level == 0);
        CHECK(f.test == "checksum");
    }
}
