// A run continues from what an interrupted run of several ranks has left.
#include <algorithm>
#include <atomic>
#include <catch2/catch.hpp>
#include <filesystem>
#include <fstream>
#include <memory>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include <isonest/error.h>

#include "preprocess/ranks/preprocess_on_ranks.h"
#include "tests/support/rank_runs.h"
#include "tests/support/test_support.h"
#include "tests/support/thread_ranks.h"

using namespace isonest;
using namespace isonest::detail;
using namespace isonest::detail::test;
using isonest::test::ThreadRanks;

namespace {

/// A run of `ranks` ranks of which one fails when it reads plane `plane`.
void leave_interrupted(int ranks, const Int3& nodes, std::int64_t plane,
                       const std::filesystem::path& store, const PreprocessOptions& options,
                       const std::filesystem::path& scratch) {
    std::atomic<std::uint64_t> read = 0;
    const Error error = error_of([&] {
        on_ranks(
            ranks,
            [&](int rank) {
                auto volume = std::make_unique<CountedVolume>(nodes, read);
                volume->fails_at_ = rank == ranks - 1 ? plane : volume->fails_at_;
                return volume;
            },
            store, options, scratch);
    });
    CHECK(error.problem().starts_with("the disk is broken; "));
    CHECK(error.remedies().back().kind == RemedyKind::resume);
}

std::vector<std::string> sorted_names(const TemporaryFolder& folder) {
    std::vector<std::string> names = folder.names();
    std::sort(names.begin(), names.end());
    return names;
}

}  // namespace

TEST_CASE("files left by ranks are taken over by the same or another number of ranks") {
    const Int3 nodes{40, 70, 90};
    PreprocessOptions options = with_chunk(8);
    const TemporaryFolder folder;
    FunctionVolume<float> alone(nodes, rough);
    preprocess(alone, folder / "alone", options);
    const std::string expected = read_file(folder / "alone");
    options.resume = true;
    std::uint64_t most = 0;
    for (const int before : {1, 4}) {
        for (const int after : {1, 3, 4, 7}) {
            for (const bool damaged : {false, true}) {
                CAPTURE(before, after, damaged);
                const TemporaryFolder scratch;
                leave_interrupted(before, nodes, 80, folder / "s", options, scratch.path());
                CHECK(!std::filesystem::exists(folder / "s"));
                // Two files for each rank that has finished a block; with several ranks possibly
                // none has.
                const bool has_left = !scratch.names().empty();
                CHECK((has_left || before > 1));
                CHECK(scratch.names().size() % 2 == 0);
                CHECK(scratch.names().size() <= static_cast<std::size_t>(2 * before));
                for (const std::string& name : scratch.names()) {
                    const std::filesystem::path file = scratch / name.c_str();
                    const std::uint64_t size = std::filesystem::file_size(file);
                    if (damaged && size > 2000) {
                        std::fstream(file, std::ios::in | std::ios::out | std::ios::binary)
                            .seekp(static_cast<std::streamoff>(size / 2))
                            .write("damage", 6);
                    }
                }
                std::atomic<std::uint64_t> read = 0;
                const auto all = on_ranks(
                    after, [&](int) { return std::make_unique<CountedVolume>(nodes, read); },
                    folder / "s", options, scratch.path());
                const bool same = read_file(folder / "s") == expected;
                CHECK(same);
                CHECK(scratch.names().empty());
                if (!damaged && has_left) {
                    CHECK(all.front().whole.resumed_chunks > 0);
                }
                most = std::max(most, all.front().whole.resumed_chunks);
                std::filesystem::remove(folder / "s");
            }
        }
    }
    CHECK(most > 500);
    CHECK(folder.names().size() == 1);
}

namespace {

/// Stops a run at the start of a phase.
class StoppedAt : public Progress {
  public:
    explicit StoppedAt(std::string phase) : phase_(std::move(phase)) {}
    void begin(std::string_view phase, std::uint64_t /*total*/,
               std::string_view /*unit*/) override {
        is_reached_ = is_reached_ || phase == phase_;
    }
    [[nodiscard]] bool cancelled() const override { return is_reached_; }

  private:
    std::string phase_;
    std::atomic<bool> is_reached_ = false;
};

}  // namespace

TEST_CASE(
    "a run that has the whole base pass and is interrupted after it leaves no further files") {
    const Int3 nodes{40, 70, 90};
    PreprocessOptions options = with_chunk(8);
    const TemporaryFolder folder;
    const TemporaryFolder scratch;
    FunctionVolume<float> alone(nodes, rough);
    preprocess(alone, folder / "alone", options);
    options.resume = true;
    leave_interrupted(4, nodes, 80, folder / "s", options, scratch.path());
    const std::vector<std::string> first = scratch.names();
    CHECK_FALSE(first.empty());
    std::vector<std::string> left;
    for (int i = 0; i < 3; ++i) {
        const Error error = error_of([&] {
            StoppedAt progress("level 4");
            ThreadRanks(3).run([&](Communicator& ranks) {
                FunctionVolume<float> volume(nodes, rough);
                preprocess_on_ranks(ranks, volume, folder / "s", options, scratch.path(), progress);
            });
        });
        CHECK(error.kind() == ErrorKind::cancelled);
        for (const std::string& name : first) {
            CHECK(std::filesystem::exists(scratch / name.c_str()));
        }
        CHECK((i == 0 || sorted_names(scratch) == left));
        left = sorted_names(scratch);
    }
    std::atomic<std::uint64_t> read = 0;
    const auto all = on_ranks(
        2, [&](int) { return std::make_unique<CountedVolume>(nodes, read); }, folder / "s", options,
        scratch.path());
    CHECK(read == 0);  // the whole base pass was there
    CHECK(all.front().whole.resumed_chunks > 500);
    CHECK(read_file(folder / "s") == read_file(folder / "alone"));
    CHECK(scratch.names().empty());
}

TEST_CASE("files left for another input or other options are not taken over") {
    const Int3 nodes{40, 70, 90};
    PreprocessOptions options = with_chunk(8);
    options.resume = true;
    const TemporaryFolder folder;
    leave_interrupted(2, nodes, 80, folder / "s", options, {});
    options.compression = 2;
    const Error error = error_of([&] {
        on_ranks(
            2, [&](int) { return std::make_unique<FunctionVolume<float>>(nodes, rough); },
            folder / "s", options);
    });
    CHECK(error.kind() == ErrorKind::invalid_argument);
    CHECK(error.remedies().front().kind == RemedyKind::same_options);
    CHECK(folder.names().size() == 4);
}

TEST_CASE("runs interrupted repeatedly in the base pass leave each block once") {
    const Int3 nodes{40, 70, 90};
    PreprocessOptions options = with_chunk(8);
    const TemporaryFolder folder;
    FunctionVolume<float> alone(nodes, rough);
    preprocess(alone, folder / "alone", options);
    const std::uint64_t whole = std::filesystem::file_size(folder / "alone");
    options.resume = true;
    const TemporaryFolder scratch;
    std::uint64_t left = 0;
    for (const int ranks : {4, 4, 3, 7, 4, 1, 2, 4, 4, 3}) {
        leave_interrupted(ranks, nodes, 80, folder / "s", options, scratch.path());
        const std::uint64_t before = left;
        left = 0;
        for (const std::string& name : scratch.names()) {
            left += name.ends_with(".chunks") ? std::filesystem::file_size(scratch / name.c_str())
                                              : std::uint64_t{0};
        }
        CHECK(left >= before);
        CHECK(left > 0);
        CHECK(left < whole);
    }
    CHECK(left > whole / 2);
    const std::vector<std::string> files = sorted_names(scratch);
    // The last run has nothing to add, and so leaves no further files.
    leave_interrupted(1, nodes, 80, folder / "s", options, scratch.path());
    CHECK(sorted_names(scratch) == files);
    on_ranks(
        3, [&](int) { return std::make_unique<FunctionVolume<float>>(nodes, rough); }, folder / "s",
        options, scratch.path());
    const bool same = read_file(folder / "s") == read_file(folder / "alone");
    CHECK(same);
    CHECK(scratch.names().empty());
}
