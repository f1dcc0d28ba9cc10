// Progress on a terminal: phase, percent, rate and remaining time, redrawn in place.
#pragma once

#include <atomic>
#include <chrono>
#include <cstdint>
#include <mutex>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include <isonest/progress.h>

namespace isonest::detail::cli {

/// The state of a phase.
struct ProgressState {
    std::string phase;
    std::string unit;  ///< "B" for bytes, else a plural noun
    std::uint64_t done = 0;
    std::uint64_t total = 0;   ///< 0 = unknown
    double seconds = 0;        ///< since the phase began
    double whole = -1;         ///< fraction of the whole run that is done; below 0: unknown
    double whole_seconds = 0;  ///< since the run began
};

/// A phase of a run: its name for users, and its typical duration relative to the others.
struct ProgressStage {
    std::string phase;
    std::string words;
    double weight = 1;
};

/// For a run "[########------------]  43 %  reading the volume   312 MB/s   12 s left", for a
/// single phase "export   43 %   312 MB/s   12 s left". Truncated to `columns`.
std::string progress_line(const ProgressState& state, int columns);

/// Progress of a run whose stages usually occur in this order. Stages before the current one that
/// have not occurred are left out of the total. Progress never decreases.
class WholeProgress {
  public:
    explicit WholeProgress(std::vector<ProgressStage> stages) : stages_(std::move(stages)) {}
    /// Starts a phase and returns its stage; null if the phase is not a stage.
    const ProgressStage* begin(std::string_view phase);
    /// The fraction of the run that is done when the fraction `part` of the current stage is; below
    /// 0 if there are no stages.
    double at(double part);

  private:
    std::vector<ProgressStage> stages_;
    std::size_t next_ = 0;  ///< the first stage after the current one
    double before_ = 0;     ///< weight of the stages that are done
    double current_ = 0;    ///< weight of the current one
    double whole_ = 0;
};

/// Is cancelled by interrupted(); if `show`, draws on stderr at most five times per second.
class TerminalProgress : public Progress {
  public:
    explicit TerminalProgress(bool show, std::vector<ProgressStage> stages = {})
        : show_(show), whole_(std::move(stages)), run_start_(Clock::now()) {}
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
    WholeProgress whole_;
    Clock::time_point run_start_;
    Clock::time_point start_;
    std::atomic<std::uint64_t> done_ = 0;
    std::atomic<Clock::rep> next_draw_ = 0;
    bool drawn_ = false;
};

/// True if stderr is a terminal that can redraw a line.
bool can_draw();

}  // namespace isonest::detail::cli
