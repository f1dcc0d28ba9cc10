// Preprocessing by ranks that are threads.
#pragma once

#include <atomic>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <limits>
#include <memory>
#include <vector>

#include <isonest/error.h>

#include "preprocess/ranks/preprocess_on_ranks.h"
#include "tests/support/test_support.h"
#include "tests/support/thread_ranks.h"

namespace isonest::detail::test {

inline float rough(const Int3& p) {
    return static_cast<float>(smooth(p) + 0.1 * noise(p));
}

/// Runs on `ranks` ranks, each with the source that `open` returns for its number; returns all
/// reports.
template <class Open>
std::vector<RanksReport> on_ranks(int ranks, const Open& open, const std::filesystem::path& store,
                                  const PreprocessOptions& options,
                                  const std::filesystem::path& scratch = {}) {
    std::vector<RanksReport> reports(static_cast<std::size_t>(ranks));
    isonest::test::ThreadRanks(ranks).run([&](Communicator& all) {
        const std::unique_ptr<VolumeSource> source = open(all.rank());
        reports[static_cast<std::size_t>(all.rank())] =
            preprocess_on_ranks(all, *source, store, options, scratch, silent_progress());
    });
    return reports;
}

/// Counts what is read, and fails where it is told to.
class CountedVolume : public FunctionVolume<float> {
  public:
    CountedVolume(const Int3& n, std::atomic<std::uint64_t>& bytes)
        : FunctionVolume(n, rough), bytes_(bytes) {}
    void read(std::int64_t z0, std::int64_t nz, std::int64_t y0, std::int64_t ny,
              std::byte* dst) override {
        bytes_ += static_cast<std::uint64_t>(nz * ny * nodes().x) * sizeof(float);
        if (z0 + nz > fails_at_) {
            throw Error(ErrorKind::io, "the disk is broken");
        }
        FunctionVolume::read(z0, nz, y0, ny, dst);
    }
    std::int64_t fails_at_ = std::numeric_limits<std::int64_t>::max();

  private:
    std::atomic<std::uint64_t>& bytes_;
};

template <class Run>
Error error_of(const Run& run) {
    try {
        run();
    } catch (const Error& error) {
        return error;
    }
    return {ErrorKind::io, "nothing was thrown"};
}

}  // namespace isonest::detail::test
