// Stores are written completely or not at all, and damage is reported.
#include <catch2/catch.hpp>

#include <isonest/error.h>

#include "query/check/check.h"
#include "store/container/codec.h"
#include "tests/support/test_support.h"

using namespace isonest;
using namespace isonest::detail;
using namespace isonest::detail::test;

namespace {

float smooth_f(const Int3& p) {
    return static_cast<float>(smooth(p));
}

std::optional<ErrorKind> failure(const std::function<void()>& f) {
    try {
        f();
    } catch (const Error& e) {
        return e.kind();
    }
    return std::nullopt;
}

void write_file(const std::filesystem::path& path, const std::string& bytes) {
    std::ofstream(path, std::ios::binary) << bytes;
}

/// Cancels after some calls.
class Stopper : public Progress {
  public:
    explicit Stopper(int calls) : left_(calls) {}
    [[nodiscard]] bool cancelled() const override { return left_-- <= 0; }

  private:
    mutable std::atomic<int> left_;
};

class FailingVolume : public FunctionVolume<float> {
  public:
    using FunctionVolume::FunctionVolume;
    void read(std::int64_t z0, std::int64_t nz, std::int64_t y0, std::int64_t ny,
              std::byte* dst) override {
        if (z0 + nz > 40) {
            throw Error(ErrorKind::io, "the disk is gone");
        }
        FunctionVolume::read(z0, nz, y0, ny, dst);
    }
};

}  // namespace

TEST_CASE("codes are never below the value and at most 2^-5 above it") {
    for (int i = 0; i < 200000; ++i) {
        const auto v = static_cast<float>(std::exp(60 * noise({i, 1, 2}) - 30));
        const float up = decode_indicator(encode_indicator(v));
        REQUIRE(up >= v);
        REQUIRE(up <= v * (1 + 0x1p-5F));
        REQUIRE(encode_indicator(up) == encode_indicator(v));
        REQUIRE(encode_indicator(v) % 4 == 0);
    }
    CHECK(decode_indicator(encode_indicator(0.0F)) == 0.0F);
    CHECK(std::isinf(decode_indicator(encode_indicator(std::numeric_limits<float>::infinity()))));
    CHECK(static_cast<double>(round_up_to_float(0.1)) >= 0.1);
}

TEST_CASE("each plane of the input is read once") {
    for (const std::int64_t step : {1, 7, 64}) {
        FunctionVolume<float> volume({20, 20, 150}, smooth_f);
        volume.granularity_ = {step, 1};
        const TemporaryFolder folder;
        make_store(volume, folder / "s", with_chunk(16));
        CHECK(volume.planes_read_ == 150);
    }
}

TEST_CASE("planes that are cheap to read together are read together") {
    class Stepped : public FunctionVolume<float> {
      public:
        using FunctionVolume<float>::FunctionVolume;
        void read(std::int64_t z0, std::int64_t nz, std::int64_t y0, std::int64_t ny,
                  std::byte* dst) override {
            const std::int64_t step = granularity_.planes;
            if (z0 % step != 0 || ((z0 + nz) % step != 0 && z0 + nz != nodes().z)) {
                ++cut;
            }
            FunctionVolume<float>::read(z0, nz, y0, ny, dst);
        }
        int cut = 0;
    };
    for (const std::int64_t step : {7, 16, 64}) {
        Stepped volume({20, 20, 999}, smooth_f);
        volume.granularity_ = {step, 1};
        const TemporaryFolder folder;
        make_store(volume, folder / "s", with_chunk(16));
        CHECK(volume.cut == 0);
    }
}

TEST_CASE("an interrupted or failed run leaves no file, and does not touch an old store") {
    FunctionVolume<float> volume({60, 60, 90}, smooth_f);
    const TemporaryFolder folder;
    write_file(folder / "s", "precious");
    for (int calls = 0; calls < 12; calls += 2) {
        Stopper stopper(calls);
        PreprocessOptions options = with_chunk(8);
        options.force = true;
        CHECK(failure([&] { preprocess(volume, folder / "s", options, stopper); }) ==
              ErrorKind::cancelled);
    }
    FailingVolume failing({60, 60, 90}, smooth_f);
    CHECK(failure([&] { make_store(failing, folder / "s", with_chunk(8)); }) == ErrorKind::io);
    CHECK(failure([&] { preprocess(volume, folder / "s", with_chunk(8), silent_progress()); }) ==
          ErrorKind::invalid_argument);
    CHECK(read_file(folder / "s") == "precious");
    CHECK(folder.names().size() == 1);
}

TEST_CASE("a file that is not a store, or a damaged one, is reported as such") {
    FunctionVolume<float> volume({20, 20, 20}, smooth_f);
    const TemporaryFolder folder;
    make_store(volume, folder / "s", with_chunk(8));
    const std::string good = read_file(folder / "s");
    const auto open = [&] { StoreReader reader(folder / "t"); };
    CHECK(failure(open) == ErrorKind::not_found);
    for (const char* const other : {"", "HDF", "not a store at all"}) {
        write_file(folder / "t", other);
        CHECK(failure(open) == ErrorKind::invalid_argument);
    }
    for (std::size_t part = 1; part < 20; ++part) {
        write_file(folder / "t", good.substr(0, good.size() * part / 20));
        CHECK(failure(open) == ErrorKind::corrupt);
    }
}

TEST_CASE("a flipped byte gives the same surface or an error, and check finds it") {
    FunctionVolume<float> volume({20, 20, 20}, smooth_f);
    const TemporaryFolder folder;
    make_store(volume, folder / "s", with_chunk(8));
    const std::string good = read_file(folder / "s");
    Extraction options;
    extract(StoreReader(folder / "s"), folder / "m.ply", options, silent_progress());
    const std::string expected = read_file(folder / "m.ply");
    int errors = 0;
    int found = 0;
    for (int i = 0; i < 150; ++i) {
        std::string bad = good;
        const auto at =
            static_cast<std::size_t>(noise({i, 0, 0}) * static_cast<double>(bad.size()));
        bad[at] = static_cast<char>(bad[at] ^ (1 << (i % 8)));
        write_file(folder / "t", bad);
        const auto kind = failure([&] {
            const StoreReader store(folder / "t");
            found += check(store, {}, silent_progress()).failures > 0 ? 1 : 0;
            extract(store, folder / "n.ply", options, silent_progress());
            CHECK(read_file(folder / "n.ply") == expected);
        });
        errors += kind ? 1 : 0;
        CAPTURE(at);
        constexpr std::size_t kSignature = 8;  // without it, the file is not one of HDF5
        CHECK((!kind || *kind == ErrorKind::corrupt || *kind == ErrorKind::unsupported ||
               (*kind == ErrorKind::invalid_argument && at < kSignature)));
    }
    CHECK(errors > 10);
    CHECK(found > 50);
}

TEST_CASE("too little memory is reported with the minimum that is enough") {
    FunctionVolume<float> volume({200, 200, 200}, [](const Int3&) { return 0.0F; });
    const TemporaryFolder folder;
    PreprocessOptions options = with_chunk(64);
    options.memory = 20U << 20U;
    try {
        make_store(volume, folder / "s", options);
        CHECK(false);
    } catch (const Error& e) {
        CHECK(e.kind() == ErrorKind::limit);
        REQUIRE(!e.remedies().empty());
        CHECK(e.remedies().front().kind == RemedyKind::more_memory);
        CHECK(std::stoull(e.remedies().front().value) > options.memory);
    }
    CHECK(folder.names().empty());
}

TEST_CASE("with little memory the input is copied to disk, and the store is the same") {
    FunctionVolume<float> volume({300, 290, 80}, smooth_f);
    const TemporaryFolder folder;
    PreprocessOptions options = with_chunk(32);
    const auto wide = make_store(volume, folder / "a", options);
    options.memory = 28U << 20U;
    const auto narrow = make_store(volume, folder / "b", options);
    CHECK_FALSE(wide.input_on_disk);
    CHECK(narrow.input_on_disk);
    CHECK(read_file(folder / "a") == read_file(folder / "b"));
}
