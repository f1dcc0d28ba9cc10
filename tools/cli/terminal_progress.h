// Progress on a terminal: phase, percent, rate and remaining time, redrawn in place.
#pragma once

#include <atomic>
#include <chrono>
#include <cstdint>
#include <mutex>
#include <string>

#include <isonest/progress.h>

namespace isonest::detail::cli {

/// Where a phase is.
struct ProgressState {
    std::string phase;
    std::string unit;  ///< "B" for bytes, else a plural noun
    std::uint64_t done = 0;
    std::uint64_t total = 0;  ///< 0 = unknown
    double seconds = 0;       ///< since the phase began
};

/// "levels 0-2   43 %   312 MB/s   12 s left", cut to `columns`.
std::string progress_line(const ProgressState& state, int columns);

/// Reads interrupted(); draws on stderr, five times per second at most, if `show`.
class TerminalProgress : public Progress {
  public:
    explicit TerminalProgress(bool show) : show_(show) {}
    TerminalProgress(const TerminalProgress&) = delete;
    TerminalProgress& operator=(const TerminalProgress&) = delete;
    ~TerminalProgress() override;  ///< erases the line

    void begin(std::string_view phase, std::uint64_t total, std::string_view unit) override;
    void advance(std::uint64_t amount) override;
    [[nodiscard]] bool cancelled() const override;

  private:
    using Clock = std::chrono::steady_clock;
    void draw();

    const bool show_;
    std::mutex mutex_;
    ProgressState state_;
    Clock::time_point start_;
    std::atomic<std::uint64_t> done_ = 0;
    std::atomic<Clock::rep> next_draw_ = 0;
    bool drawn_ = false;
};

/// True if stderr is a terminal that can redraw a line.
bool can_draw();

}  // namespace isonest::detail::cli
