// Several ranks write the same store as one process.
#include "preprocess/ranks/preprocess_on_ranks.h"

#include <atomic>
#include <catch2/catch.hpp>
#include <cmath>
#include <memory>
#include <numeric>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include <isonest/error.h>
#include <isonest/field.h>
#include <isonest/memory_volume.h>

#include "preprocess/ranks/pencils.h"
#include "store/container/reader.h"
#include "tests/support/rank_runs.h"
#include "tests/support/test_support.h"
#include "tests/support/thread_ranks.h"

using namespace isonest;
using namespace isonest::detail;
using namespace isonest::detail::test;
using isonest::test::ThreadRanks;

namespace {

/// Checks that several numbers of ranks all write the same bytes as preprocess(), and leave no
/// other file.
template <class T>
void require_same_bytes(const Int3& nodes, const std::function<T(const Int3&)>& f,
                        PreprocessOptions options,
                        const std::vector<int>& counts = {1, 2, 3, 4, 7, 16}) {
    CAPTURE(nodes.x, nodes.y, nodes.z, options.chunk);
    const TemporaryFolder folder;
    const TemporaryFolder scratch;
    FunctionVolume<T> volume(nodes, f);
    const PreprocessReport alone = preprocess(volume, folder / "alone", options);
    const std::string expected = read_file(folder / "alone");
    for (const int ranks : counts) {
        CAPTURE(ranks);
        options.threads = ranks % 2 + 1;
        const std::vector<RanksReport> all = on_ranks(
            ranks, [&](int) { return std::make_unique<FunctionVolume<T>>(nodes, f); }, folder / "s",
            options, scratch.path());
        const PreprocessReport& r = all.front().whole;
        const bool same = read_file(folder / "s") == expected;
        REQUIRE(same);
        CHECK(folder.names().size() == 2);
        CHECK(scratch.names().empty());
        CHECK(r.store_bytes == alone.store_bytes);
        CHECK(r.chunks == alone.chunks);
        CHECK(r.min_value == alone.min_value);
        CHECK(r.max_value == alone.max_value);
        CHECK(r.has_missing == alone.has_missing);
        std::filesystem::remove(folder / "s");
    }
}

}  // namespace

TEST_CASE("any number of ranks writes the bytes of one process, for all shapes") {
    for (const Int3& nodes :
         {Int3{1, 1, 1}, Int3{1, 1, 90}, Int3{70, 1, 1}, Int3{1, 61, 83}, Int3{41, 1, 100},
          Int3{50, 77, 1}, Int3{2, 2, 2}, Int3{3, 2, 5}, Int3{17, 17, 17}, Int3{33, 65, 49},
          Int3{21, 130, 75}, Int3{9, 40, 150}}) {
        require_same_bytes<float>(nodes, rough, with_chunk(8));
    }
}

TEST_CASE("each pencil of a pass has one owner, and boxes contain only a rank's own pencils") {
    for (const Int3& nodes :
         {Int3{1, 1, 1}, Int3{5, 200, 90}, Int3{5, 16, 500}, Int3{9, 131, 131}}) {
        StoreHeader header;
        header.nodes = nodes;
        header.chunk = 8;
        header.fields = all_fields();
        const StoreLayout layout(header);
        for (const int ranks : {1, 2, 3, 5, 8, 40}) {
            CAPTURE(nodes.y, nodes.z, ranks);
            const Pencils pencils(layout, ranks);
            std::vector<int> made(layout.rows());
            for (int r = 0; r < ranks; ++r) {
                std::vector<Pencil> boxed;
                for (const PencilBox& box : pencils.boxes(r)) {
                    for (std::int64_t z = box.z_begin; z < box.z_end; ++z) {
                        for (std::int64_t y = box.y_begin; y < box.y_end; ++y) {
                            boxed.push_back({y, z});
                            CHECK(pencils.owner(kBasePass, {y, z}) == r);
                        }
                    }
                }
                CHECK(boxed.size() == pencils.of(r, kBasePass).size());
                OwnChunks chunks(layout, pencils, r);
                for (ChunkPlace place; chunks.next(place);) {
                    ++made[place.array->row_of(place.chunk)];
                }
            }
            CHECK(std::count(made.begin(), made.end(), 1) ==
                  static_cast<std::ptrdiff_t>(made.size()));
        }
    }
}

TEST_CASE("each part of a pass has one owner, who also has the pencil below it") {
    for (const Int3& nodes :
         {Int3{1, 1, 1}, Int3{5, 200, 90}, Int3{5, 1, 255}, Int3{9, 130, 258}}) {
        for (const int chunk : {8, 16, 64}) {
            StoreHeader header;
            header.nodes = nodes;
            header.chunk = chunk;
            header.fields = all_fields();
            const StoreLayout layout(header);
            for (const int ranks : {2, 3, 8}) {
                CAPTURE(nodes.y, nodes.z, chunk, ranks);
                const Pencils pencils(layout, ranks);
                for (int pass = kBasePass; pass < last_pass(layout); ++pass) {
                    const PencilCut cut = pencils.part_cut(pass);
                    CHECK(cut.cells << pencils.chunk_cut(pass).shift == (chunk / 2) << cut.shift);
                    std::int64_t found = 0;
                    for (int r = 0; r < ranks; ++r) {
                        for (const Pencil& p : pencils.of(r, cut)) {
                            ++found;
                            CHECK(pencils.owner(cut, p) == r);
                            CHECK(pencils.owner(kBasePass, {p.y << cut.shift, p.z << cut.shift}) ==
                                  r);
                        }
                    }
                    CHECK(found == cut.grid.y * cut.grid.z);
                    // Rows of values and of indicators each belong to some part.
                    const Int3 made = layout.array(pass - 1, Field::values).nodes;
                    CHECK(2 * cut.cells * cut.grid.y >= made.y);
                    CHECK(2 * cut.cells * cut.grid.z >= made.z);
                }
            }
        }
    }
}

TEST_CASE("ranks have nearly equal shares") {
    StoreHeader header;
    header.nodes = {1025, 1025, 1025};
    header.fields = default_indicators();
    const StoreLayout layout(header);
    for (const int ranks : {2, 4, 8, 16, 32, 64}) {
        CAPTURE(ranks);
        const Pencils pencils(layout, ranks);
        std::size_t most = 0;
        for (int r = 0; r < ranks; ++r) {
            std::size_t full = 0;
            for (const Pencil& p : pencils.of(r, kBasePass)) {
                full += p.y < 8 && p.z < 8 ? 1 : 0;
            }
            most = std::max(most, full);
        }
        CHECK(most == static_cast<std::size_t>(64 / ranks));
    }
}

TEST_CASE("any number of ranks writes the bytes of one process, for chunks of other sizes") {
    require_same_bytes<float>({70, 95, 81}, rough, with_chunk(16));
    require_same_bytes<float>({40, 95, 81}, rough, with_chunk(64), {2, 3});
    require_same_bytes<float>({20, 197, 131}, rough, with_chunk(32), {2, 5, 16});
}

TEST_CASE("any number of ranks writes the bytes of one process, for all types") {
    const Int3 nodes{27, 50, 68};
    const auto small = [](const Int3& p) { return static_cast<std::uint8_t>(60 * noise(p)); };
    require_same_bytes<std::uint8_t>(nodes, small, with_chunk(8), {3, 7});
    require_same_bytes<std::int16_t>(
        nodes, [&](const Int3& p) { return static_cast<std::int16_t>(small(p) - 30); },
        with_chunk(8), {3, 7});
    require_same_bytes<std::uint32_t>(nodes, [&](const Int3& p) { return 70000U * small(p); },
                                      with_chunk(8), {3, 7});
    require_same_bytes<double>(nodes, [&](const Int3& p) { return smooth(p) + noise(p); },
                               with_chunk(8), {3, 7});
}

TEST_CASE(
    "any number of ranks writes the bytes of one process, with chunks that are not shuffled") {
    const Int3 nodes{27, 50, 68};
    const auto few = [](const Int3& p) {  // 8 bits in 32, in a half of the volume
        return p.y < 24 ? static_cast<float>(std::floor(200 * noise(p)) / 255) : rough(p);
    };
    const TemporaryFolder folder;
    FunctionVolume<float> volume(nodes, few);
    make_store(volume, folder / "s", with_chunk(8));
    const StoreReader store(folder / "s");
    const ArrayInfo& values = store.layout().array(0, Field::values);
    CHECK((store.row(values, {0, 0, 0}).flags & kChunkUnshuffled) != 0);
    CHECK((store.row(values, {0, values.grid.y - 1, 0}).flags & kChunkUnshuffled) == 0);
    require_same_bytes<float>(nodes, few, with_chunk(8), {3, 7});
}

TEST_CASE("any number of ranks writes the bytes of one process, with missing values") {
    const auto with_holes = [](double share) {
        return [share](const Int3& p) {
            return noise(p, 3) < share || (p.y > 20 && p.z > 30)
                       ? std::numeric_limits<float>::quiet_NaN()
                       : rough(p);
        };
    };
    require_same_bytes<float>({33, 50, 68}, with_holes(0.01), with_chunk(8));
    // Every coarse cube has missing values.
    require_same_bytes<float>({33, 50, 68}, with_holes(0.3), with_chunk(8, true), {2, 7});
}

TEST_CASE("any number of ranks writes the bytes of one process, for all choices of indicators") {
    const Int3 nodes{27, 50, 68};
    PreprocessOptions options = with_chunk(8, true);
    options.fields = all_fields();
    require_same_bytes<float>(nodes, rough, options, {1, 3, 7});
    options.exact = false;
    options.fields = {Field::deviation_plus};
    require_same_bytes<float>(nodes, rough, options, {2, 4});
    options.fields = {Field::hex_deviation, Field::linf_bar};
    require_same_bytes<float>(nodes, rough, options, {2, 4});
    options.fields = {};
    require_same_bytes<float>(nodes, rough, options, {2, 4});
}

namespace {

/// Labels with names.
class NamedLabels : public FunctionVolume<double> {
  public:
    NamedLabels()
        : FunctionVolume({30, 45, 50}, [](const Int3& p) {
              return static_cast<double>((p.x / 8 + p.y / 9 + p.z / 10) % 4);
          }) {}
    [[nodiscard]] VolumeDescription describe() const override {
        VolumeDescription d = FunctionVolume::describe();
        d.labels = true;
        return d;
    }
    [[nodiscard]] std::vector<LabelName> label_names() const override {
        return {{1, "liver", {}}, {3, "spleen", {}}};
    }
};

class SequentialVolume : public FunctionVolume<float> {
  public:
    using FunctionVolume<float>::FunctionVolume;
    [[nodiscard]] bool sequential() const override { return true; }
};

}  // namespace

TEST_CASE("labels keep their names on ranks") {
    const TemporaryFolder folder;
    NamedLabels alone;
    preprocess(alone, folder / "alone", with_chunk(8));
    const auto all = on_ranks(
        5, [&](int) { return std::make_unique<NamedLabels>(); }, folder / "s", with_chunk(8));
    CHECK(read_file(folder / "s") == read_file(folder / "alone"));
    CHECK(all.front().whole.label_names == 2);
}

TEST_CASE("ranks with little memory first copy their part of the input, and write the same bytes") {
    const Int3 nodes{3000, 60, 40};
    const auto flat = [](const Int3& p) { return static_cast<std::uint8_t>((p.x ^ p.y) + p.z); };
    FunctionVolume<std::uint8_t> volume(nodes, flat);
    const TemporaryFolder folder;
    PreprocessOptions options = with_chunk(64);
    options.fields = {Field::deviation_bar};
    preprocess(volume, folder / "alone", options);
    options.threads = 1;
    // The minimum memory, as the error message gives it.
    options.memory = 1;
    const Error refused = error_of([&] { preprocess(volume, folder / "s", options); });
    REQUIRE(refused.remedies().front().kind == RemedyKind::more_memory);
    options.memory = std::stoull(refused.remedies().front().value);
    for (const int ranks : {1, 3}) {
        const auto all = on_ranks(
            ranks, [&](int) { return std::make_unique<FunctionVolume<std::uint8_t>>(nodes, flat); },
            folder / "s", options);
        CHECK(read_file(folder / "s") == read_file(folder / "alone"));
        CHECK(all.front().whole.input_on_disk);
        std::filesystem::remove(folder / "s");
    }
}

TEST_CASE("ranks together read little more than the input, and report how much") {
    const Int3 nodes{3, 512, 512};
    const auto volume_bytes = static_cast<double>(nodes.product()) * sizeof(float);
    for (const int ranks : {1, 2, 4, 16}) {
        CAPTURE(ranks);
        const TemporaryFolder folder;
        std::atomic<std::uint64_t> read = 0;
        const auto all = on_ranks(
            ranks, [&](int) { return std::make_unique<CountedVolume>(nodes, read); }, folder / "s",
            with_chunk(64));
        const std::uint64_t told = std::accumulate(
            all.begin(), all.end(), std::uint64_t{0},
            [](std::uint64_t sum, const RanksReport& r) { return sum + r.input_bytes; });
        CHECK(told == read);
        CHECK(static_cast<double>(read) >= volume_bytes);
        CHECK(static_cast<double>(read) <= 1.1 * volume_bytes);
    }
}

TEST_CASE("ranks send each other little more than margins") {
    // Like 513^3 in chunks of 64, with margins twice as wide.
    const Int3 nodes{129, 257, 257};
    const auto volume_bytes = static_cast<double>(nodes.product()) * sizeof(float);
    const TemporaryFolder folder;
    for (const auto& [ranks, most] : {std::pair{2, 0.02}, {8, 0.07}}) {
        CAPTURE(ranks);
        std::atomic<std::uint64_t> sent = 0;
        ThreadRanks(ranks).run([&](Communicator& all) {
            FunctionVolume<float> volume(nodes, rough);
            PreprocessOptions options = with_chunk(32);
            options.force = true;
            options.threads = 1;
            preprocess_on_ranks(all, volume, folder / "s", options, {}, silent_progress());
            sent += all.traffic().bytes_sent;
        });
        CHECK(static_cast<double>(sent) < most * volume_bytes);
    }
}

TEST_CASE("if one rank's input fails, all ranks end and no file is left") {
    const Int3 nodes{40, 60, 70};
    for (const int failing : {0, 2}) {
        const TemporaryFolder folder;
        std::atomic<std::uint64_t> read = 0;
        const Error error = error_of([&] {
            on_ranks(
                4,
                [&](int rank) {
                    auto volume = std::make_unique<CountedVolume>(nodes, read);
                    volume->fails_at_ = rank == failing ? 15 : volume->fails_at_;
                    return volume;
                },
                folder / "s", with_chunk(8));
        });
        CHECK(error.kind() == ErrorKind::io);
        CHECK(error.problem() == "the disk is broken");
        CHECK(folder.names().empty());
    }
}

TEST_CASE("ranks with different inputs, options or folders are refused before any work") {
    const Int3 nodes{20, 30, 40};
    const TemporaryFolder folder;
    const auto plain = [&](int) { return std::make_unique<FunctionVolume<float>>(nodes, rough); };
    const Error input = error_of([&] {
        on_ranks(
            4,
            [&](int rank) {
                auto volume = plain(rank);
                volume->identity_ = rank == 2 ? "another one\n" : volume->identity_;
                return volume;
            },
            folder / "s", with_chunk(8));
    });
    CHECK(input.kind() == ErrorKind::invalid_argument);
    CHECK_THAT(input.problem(), Catch::Contains("input") && Catch::EndsWith(": 2 (thread)"));
    const Error options = error_of([&] {
        ThreadRanks(3).run([&](Communicator& ranks) {
            const auto volume = plain(0);
            preprocess_on_ranks(ranks, *volume, folder / "s",
                                with_chunk(ranks.rank() == 1 ? 16 : 8), {}, silent_progress());
        });
    });
    CHECK_THAT(options.problem(), Catch::Contains("options") && Catch::EndsWith(": 1 (thread)"));
    const TemporaryFolder other;
    const Error elsewhere = error_of([&] {
        ThreadRanks(3).run([&](Communicator& ranks) {
            const auto volume = plain(0);
            preprocess_on_ranks(ranks, *volume, ranks.rank() == 2 ? other / "s" : folder / "s",
                                with_chunk(8), {}, silent_progress());
        });
    });
    CHECK(elsewhere.kind() == ErrorKind::invalid_argument);
    CHECK(elsewhere.problem().find("ranks 2 (thread)") != std::string::npos);
    CHECK(folder.names().empty());
    CHECK(other.names().empty());
}

TEST_CASE("an input that can only be read in order is refused for several ranks") {
    const Int3 nodes{20, 30, 40};
    const TemporaryFolder folder;
    const auto open = [&](int) { return std::make_unique<SequentialVolume>(nodes, rough); };
    CHECK(error_of([&] { on_ranks(2, open, folder / "s", with_chunk(8)); }).kind() ==
          ErrorKind::unsupported);
    CHECK(folder.names().empty());
    on_ranks(1, open, folder / "s", with_chunk(8));
    FunctionVolume<float> volume(nodes, rough);
    preprocess(volume, folder / "alone", with_chunk(8));
    CHECK(read_file(folder / "s") == read_file(folder / "alone"));
}
