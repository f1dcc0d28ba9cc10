// Volumes in memory: the same store for any layout of the numbers, and no confusion with another
// volume.
#include <atomic>
#include <catch2/catch.hpp>
#include <cmath>
#include <cstring>
#include <functional>
#include <string>
#include <thread>
#include <vector>

#include <isonest/error.h>
#include <isonest/memory_volume.h>
#include <isonest/preprocess.h>

#include "query/check/check.h"
#include "tests/support/test_support.h"

using namespace isonest;
using namespace isonest::detail;
using namespace isonest::detail::test;

namespace {

/// A value for each node that fits into every type and is unique among nearby nodes.
template <class T>
T value_at(const Int3& p) {
    return static_cast<T>((5 * p.x + 17 * p.y + 41 * p.z) % 120);
}

/// An array of bytes with numbers at data() + p * strides.
template <class T>
class Scattered {
  public:
    /// `strides` in bytes; `shift`: bytes between an aligned address and the lowest number.
    Scattered(const Int3& nodes, const Int3& strides, std::size_t shift = 0) {
        std::int64_t low = 0;
        std::int64_t high = 0;
        for (int axis = 0; axis < 3; ++axis) {
            const std::int64_t reach = (nodes[axis] - 1) * strides[axis];
            (reach < 0 ? low : high) += reach;
        }
        bytes_.assign(static_cast<std::size_t>(high - low) + sizeof(T) + shift, std::byte{0xEE});
        origin_ = bytes_.data() + shift - low;
        for (std::int64_t i = 0; i < nodes.product(); ++i) {
            const Int3 p = nodes.unlinear(i);
            const T value = value_at<T>(p);
            std::memcpy(origin_ + p.x * strides.x + p.y * strides.y + p.z * strides.z, &value,
                        sizeof(T));
        }
    }
    [[nodiscard]] const void* data() const { return origin_; }

  private:
    std::vector<std::byte> bytes_;
    std::byte* origin_ = nullptr;
};

std::vector<std::byte> all_of(VolumeSource& volume) {
    const VolumeDescription d = volume.describe();
    std::vector<std::byte> bytes(static_cast<std::size_t>(d.nodes.product()) * size_of(d.type));
    volume.read(0, d.nodes.z, 0, d.nodes.y, bytes.data());
    return bytes;
}

template <class T>
void require_any_layout(const Int3& n) {
    constexpr auto kSize = static_cast<std::int64_t>(sizeof(T));
    CAPTURE(name_of(value_type_of<T>), n.x, n.y, n.z);
    std::vector<T> dense(static_cast<std::size_t>(n.product()));
    for (std::int64_t i = 0; i < n.product(); ++i) {
        dense[static_cast<std::size_t>(i)] = value_at<T>(n.unlinear(i));
    }
    MemoryVolume plain(dense.data(), n);
    CHECK(plain.describe().type == value_type_of<T>);
    CHECK(plain.mapped().data() == reinterpret_cast<const std::byte*>(dense.data()));
    CHECK(plain.mapped().size() == dense.size() * sizeof(T));
    const std::vector<std::byte> expected = all_of(plain);
    CHECK(std::memcmp(expected.data(), dense.data(), expected.size()) == 0);

    const Int3 row{kSize, kSize * n.x, kSize * n.x * n.y};
    const Int3 fortran{kSize * n.y * n.z, kSize * n.z, kSize};
    const Int3 padded{kSize, kSize * n.x + 7, (kSize * n.x + 7) * n.y + 64};
    const Int3 records{3 * kSize + 1, (3 * kSize + 1) * n.x, (3 * kSize + 1) * n.x * n.y};
    for (const Int3& size : {row, fortran, padded, records}) {
        for (int signs = 0; signs < 8; ++signs) {
            Int3 strides = size;
            for (int axis = 0; axis < 3; ++axis) {
                strides[axis] *= ((signs >> axis) & 1) != 0 ? -1 : 1;
            }
            CAPTURE(strides.x, strides.y, strides.z);
            const Scattered<T> numbers(n, strides);
            MemoryVolume volume(numbers.data(), value_type_of<T>, n, {.strides = strides});
            CHECK(all_of(volume) == expected);
            CHECK(volume.identity() == plain.identity());
        }
    }
    const Scattered<T> shifted(n, row, 1);
    MemoryVolume unaligned(shifted.data(), value_type_of<T>, n);
    CHECK(unaligned.mapped().empty() == (sizeof(T) > 1));
    CHECK(all_of(unaligned) == expected);
    CHECK(unaligned.identity() == plain.identity());
}

class CancelAt : public Progress {
  public:
    explicit CancelAt(int n) : left_(n) {}
    [[nodiscard]] bool cancelled() const override { return --left_ < 0; }

  private:
    mutable std::atomic<int> left_;
};

std::vector<float> uneven(const Int3& n) {
    std::vector<float> values;
    for (std::int64_t i = 0; i < n.product(); ++i) {
        values.push_back(static_cast<float>(smooth(n.unlinear(i)) + 0.1 * noise(n.unlinear(i))));
    }
    return values;
}

void interrupt(VolumeSource& volume, const std::filesystem::path& store,
               const PreprocessOptions& options) {
    CancelAt progress(120);
    CHECK_THROWS_AS(preprocess(volume, store, options, progress), Error);
}

ErrorKind failure(const std::function<void()>& call) {
    try {
        call();
    } catch (const Error& error) {
        return error.kind();
    }
    return ErrorKind::io;
}

PreprocessOptions resuming() {
    PreprocessOptions options = with_chunk(8);
    options.resume = true;
    options.threads = 1;
    return options;
}

/// Implements only three functions.
class Ramp : public VolumeSource {
  public:
    explicit Ramp(std::string identity) : identity_(std::move(identity)) {}
    [[nodiscard]] VolumeDescription describe() const override {
        return {.nodes = {50, 41, 120}, .name = "ramp"};
    }
    [[nodiscard]] std::string identity() const override { return identity_; }
    void read(std::int64_t z0, std::int64_t nz, std::int64_t y0, std::int64_t ny,
              std::byte* dst) override {
        for (std::int64_t i = 0; i < nz * ny * 50; ++i) {
            const std::int64_t row = i / 50;
            const std::int64_t number = i % 50 + 3 * (y0 + row % ny) + 7 * (z0 + row / ny);
            const auto value = static_cast<float>(number);
            std::memcpy(dst + i * 4, &value, 4);
        }
    }

  private:
    std::string identity_;
};

}  // namespace

TEST_CASE("a volume in memory gives the same store for all types, layouts and directions") {
    for (const Int3& n : {Int3{1, 1, 1}, Int3{1, 1, 9}, Int3{2, 2, 2}, Int3{7, 5, 4}}) {
#define ISONEST_ANY_LAYOUT(tag, T) require_any_layout<T>(n);
        ISONEST_FOR_EACH_VALUE_TYPE(ISONEST_ANY_LAYOUT)
#undef ISONEST_ANY_LAYOUT
    }
}

TEST_CASE("rows longer than the digest's buffer have the same digest in any layout") {
    const Int3 n{40000, 2, 1};
    const Scattered<double> dense(n, {8, 8 * n.x, 0});
    const Scattered<double> backward(n, {-8, -8 * n.x, 0});
    CHECK(MemoryVolume(dense.data(), ValueType::f64, n).identity() ==
          MemoryVolume(backward.data(), ValueType::f64, n, {.strides = Int3{-8, -8 * n.x, 0}})
              .identity());
}

TEST_CASE("the store of a volume in memory is the same as that of a file with the same values") {
    for (const Int3& n : {Int3{1, 1, 40}, Int3{2, 2, 2}, Int3{33, 20, 41}}) {
        const TemporaryFolder folder;
        const std::vector<float> values = uneven(n);
        MemoryLayout layout;
        layout.spacing = {1, 2, 0.5};
        layout.origin = {-3, 0, 4};
        MemoryVolume dense(values.data(), n, layout);
        layout.strides = Int3{4 * n.y * n.z, -4 * n.z, 4};
        std::vector<float> turned(values.size());
        for (std::int64_t i = 0; i < n.product(); ++i) {
            const Int3 p = n.unlinear(i);
            turned[static_cast<std::size_t>((p.x * n.y + n.y - 1 - p.y) * n.z + p.z)] =
                values[static_cast<std::size_t>(i)];
        }
        MemoryVolume strided(turned.data() + (n.y - 1) * n.z, n, layout);
        PreprocessOptions options = with_chunk(8);
        preprocess(dense, folder / "dense", options);
        preprocess(strided, folder / "strided", options);
        CHECK(read_file(folder / "dense") == read_file(folder / "strided"));
        CheckOptions with_source;
        with_source.source = &strided;
        CHECK(check(StoreReader(folder / "dense"), with_source, silent_progress()).failures == 0);
    }
}

TEST_CASE("an interrupted run on memory is resumed with the same values and refuses others") {
    const TemporaryFolder folder;
    const Int3 n{50, 41, 120};
    const std::vector<float> values = uneven(n);
    MemoryVolume volume(values.data(), n);
    preprocess(volume, folder / "whole", with_chunk(8));
    interrupt(volume, folder / "s", resuming());
    const auto left = folder.names();
    // One bit of a value in the middle, in a plane that is not read again.
    std::vector<float> others = values;
    others[others.size() / 2] = std::nextafter(others[others.size() / 2], 100.0F);
    MemoryVolume other(others.data(), n);
    try {
        preprocess(other, folder / "s", resuming());
        FAIL("not noticed");
    } catch (const Error& error) {
        CHECK(error.kind() == ErrorKind::invalid_argument);
        CHECK(std::string(error.what()).find("values in memory") != std::string::npos);
    }
    CHECK(folder.names() == left);
    const std::vector<float> elsewhere(values.begin(), values.end());
    MemoryVolume same(elsewhere.data(), n, {.name = "another name"});
    CHECK(preprocess(same, folder / "s", resuming()).resumed_chunks > 0);
    CHECK(read_file(folder / "s") == read_file(folder / "whole"));
}

TEST_CASE("three functions make a source, and a run on it can be resumed if it has an identity") {
    const TemporaryFolder folder;
    Ramp ramp("ramp 1");
    preprocess(ramp, folder / "whole", with_chunk(8));
    interrupt(ramp, folder / "s", resuming());
    Ramp other("ramp 2");
    CHECK(failure([&] { preprocess(other, folder / "s", resuming()); }) ==
          ErrorKind::invalid_argument);
    CHECK(preprocess(ramp, folder / "s", resuming()).resumed_chunks > 0);
    CHECK(read_file(folder / "s") == read_file(folder / "whole"));
    Ramp nobody("");
    CHECK(failure([&] { preprocess(nobody, folder / "t", resuming()); }) ==
          ErrorKind::invalid_argument);
    Ramp tiresome(std::string(100000, 'x'));
    CHECK(failure([&] { preprocess(tiresome, folder / "t", with_chunk(8)); }) ==
          ErrorKind::invalid_argument);
    preprocess(nobody, folder / "t", with_chunk(8));
    CHECK(read_file(folder / "t") == read_file(folder / "whole"));
}

TEST_CASE("two concurrent runs give the bytes of each alone") {
    const TemporaryFolder folder;
    const Int3 n{50, 41, 60};
    const std::vector<float> values = uneven(n);
    MemoryVolume volume(values.data(), n);
    preprocess(volume, folder / "alone", with_chunk(8));
    std::vector<std::thread> runs;
    for (const char* const name : {"a", "b"}) {
        runs.emplace_back([&, name] {
            MemoryVolume own(values.data(), n);
            preprocess(own, folder / name, with_chunk(8));
        });
    }
    for (std::thread& run : runs) {
        run.join();
    }
    CHECK(read_file(folder / "a") == read_file(folder / "alone"));
    CHECK(read_file(folder / "b") == read_file(folder / "alone"));
}

TEST_CASE("preprocess only replaces a file on request") {
    const TemporaryFolder folder;
    const std::vector<std::uint8_t> values(27, 3);
    MemoryVolume volume(values.data(), {3, 3, 3});
    preprocess(volume, folder / "s");
    CHECK(failure([&] { preprocess(volume, folder / "s"); }) == ErrorKind::invalid_argument);
    PreprocessOptions options;
    options.force = true;
    preprocess(volume, folder / "s", options);
}

TEST_CASE("missing data, no nodes and another volume's shape are refused") {
    const std::vector<float> values(8);
    const float* const nothing = nullptr;
    const auto make = [](const float* data, const Int3& n) {
        return failure([&] { const MemoryVolume volume(data, n); });
    };
    CHECK(make(nothing, {2, 2, 2}) == ErrorKind::invalid_argument);
    CHECK(make(values.data(), {2, 0, 2}) == ErrorKind::invalid_argument);
    CHECK(make(values.data(), {2, 2, -2}) == ErrorKind::invalid_argument);
    const TemporaryFolder folder;
    MemoryVolume volume(values.data(), {2, 2, 2});
    preprocess(volume, folder / "s");
    MemoryVolume longer(values.data(), {4, 2, 1});
    CheckOptions options;
    options.source = &longer;
    CHECK(failure([&] { check(StoreReader(folder / "s"), options, silent_progress()); }) ==
          ErrorKind::invalid_argument);
}
