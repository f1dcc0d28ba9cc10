// Several ranks write the store that one process writes.
#include "preprocess/ranks/preprocess_on_ranks.h"

#include <atomic>
#include <catch2/catch.hpp>
#include <memory>
#include <numeric>

#include <isonest/error.h>
#include <isonest/field.h>
#include <isonest/memory_volume.h>

#include "preprocess/ranks/own_chunks.h"
#include "preprocess/ranks/pencils.h"
#include "tests/support/test_support.h"
#include "tests/support/thread_ranks.h"

using namespace isonest;
using namespace isonest::detail;
using namespace isonest::detail::test;
using isonest::test::ThreadRanks;

namespace {

float rough(const Int3& p) {
    return static_cast<float>(smooth(p) + 0.1 * noise(p));
}

/// Runs on so many ranks, each with the source that `open` gives for its number; rank 0's report.
template <class Open>
PreprocessReport on_ranks(int ranks, const Open& open, const std::filesystem::path& store,
                          const PreprocessOptions& options,
                          const std::filesystem::path& scratch = {}) {
    PreprocessReport report;
    ThreadRanks(ranks).run([&](Communicator& all) {
        const std::unique_ptr<VolumeSource> source = open(all.rank());
        const PreprocessReport r =
            preprocess_on_ranks(all, *source, store, options, scratch, silent_progress());
        if (all.rank() == 0) {
            report = r;
        }
    });
    return report;
}

/// Whether several numbers of ranks all write what preprocess() writes, and leave nothing else.
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
        const PreprocessReport r = on_ranks(
            ranks, [&](int) { return std::make_unique<FunctionVolume<T>>(nodes, f); },
            folder / "s", options, scratch.path());
        const bool same = read_file(folder / "s") == expected;
        REQUIRE(same);
        CHECK(folder.names().size() == 2);
        CHECK(scratch.names().empty());
        CHECK(r.store_bytes == alone.store_bytes);
        CHECK(r.chunks == alone.chunks);
        CHECK(r.min_value == alone.min_value);
        CHECK(r.max_value == alone.max_value);
        CHECK(r.has_missing == alone.has_missing);
        CHECK(r.ranks.size() == static_cast<std::size_t>(ranks));
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
