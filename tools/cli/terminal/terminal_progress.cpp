#include "tools/cli/terminal/terminal_progress.h"

#include <fmt/format.h>
#include <sys/ioctl.h>
#include <unistd.h>

#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <string_view>

#include "tools/cli/options/units.h"
#include "tools/cli/terminal/interrupt.h"

namespace isonest::detail::cli {
namespace {

constexpr double kSettled = 0.5;  // seconds before a rate is meaningful

int terminal_columns() {
    winsize size{};
    if (::ioctl(STDERR_FILENO, TIOCGWINSZ, &size) == 0 && size.ws_col > 0) {
        return size.ws_col;
    }
    return 80;
}

void put(const std::string& text) {
    std::fwrite(text.data(), 1, text.size(), stderr);
    std::fflush(stderr);
}

}  // namespace

std::string progress_line(const ProgressState& state, int columns) {
    const auto done = static_cast<double>(state.done);
    const auto total = static_cast<double>(state.total);
    std::string line;
    if (state.whole >= 0) {
        constexpr int kBar = 20;
        const int full = static_cast<int>(state.whole * kBar);
        line = fmt::format("[{:#<{}}{:-<{}}] {:3.0f} %  {}", "", full, "", kBar - full,
                           100 * state.whole, state.phase);
    } else {
        line = fmt::format("{:<16}", state.phase);
        if (state.total > 0) {
            line += fmt::format(" {:3.0f} %", std::min(100.0, 100 * done / total));
        }
    }
    if (state.seconds >= kSettled && state.done > 0) {
        const double rate = done / state.seconds;
        line += state.unit == "B" ? fmt::format("   {}/s", human_bytes(rate))
                                  : fmt::format("   {} {}/s", human_count(rate), state.unit);
        if (state.whole > 0) {
            line += fmt::format("   {} left",
                                human_seconds(state.whole_seconds * (1 / state.whole - 1)));
        } else if (state.total > state.done && state.whole < 0) {
            line += fmt::format("   {} left", human_seconds((total - done) / rate));
        }
    }
    line.resize(std::min(line.size(), static_cast<std::size_t>(std::max(columns - 1, 0))));
    return line;
}

const ProgressStage* WholeProgress::begin(std::string_view phase) {
    before_ += current_;
    current_ = 0;
    for (std::size_t i = next_; i < stages_.size(); ++i) {
        if (stages_[i].phase == phase) {
            next_ = i + 1;
            current_ = stages_[i].weight;
            return &stages_[i];
        }
    }
    // A stage that comes again does not move the progress back.
    for (const ProgressStage& stage : stages_) {
        if (stage.phase == phase) {
            return &stage;
        }
    }
    return nullptr;
}

double WholeProgress::at(double part) {
    if (stages_.empty()) {
        return -1;
    }
    double all = before_ + current_;
    for (std::size_t i = next_; i < stages_.size(); ++i) {
        all += stages_[i].weight;
    }
    if (all > 0) {
        whole_ = std::clamp((before_ + part * current_) / all, whole_, 1.0);
    }
    return whole_;
}

TerminalProgress::~TerminalProgress() {
    if (drawn_) {
        put("\r\x1b[K");
    }
}

void TerminalProgress::begin(std::string_view phase, std::uint64_t total, std::string_view unit) {
    if (!show_) {
        return;
    }
    const std::lock_guard lock(mutex_);
    const ProgressStage* const stage = whole_.begin(phase);
    state_ = {stage != nullptr ? stage->words : std::string(phase), std::string(unit), 0, total};
    start_ = Clock::now();
    done_ = 0;
    draw();
}

void TerminalProgress::advance(std::uint64_t amount) {
    if (!show_) {
        return;
    }
    done_.fetch_add(amount, std::memory_order_relaxed);
    if (Clock::now().time_since_epoch().count() < next_draw_.load(std::memory_order_relaxed)) {
        return;
    }
    const std::unique_lock lock(mutex_, std::try_to_lock);
    if (lock.owns_lock()) {
        draw();
    }
}

bool TerminalProgress::cancelled() const {
    return interrupted();
}

void TerminalProgress::draw() {
    const Clock::time_point now = Clock::now();
    state_.done = done_.load(std::memory_order_relaxed);
    state_.seconds = std::chrono::duration<double>(now - start_).count();
    state_.whole = whole_.at(
        state_.total > 0
            ? std::min(static_cast<double>(state_.done) / static_cast<double>(state_.total), 1.0)
            : 0);
    state_.whole_seconds = std::chrono::duration<double>(now - run_start_).count();
    put("\r" + progress_line(state_, terminal_columns()) + "\x1b[K");
    drawn_ = true;
    constexpr auto kPeriod = std::chrono::milliseconds(200);
    next_draw_ = (now + kPeriod).time_since_epoch().count();
}

bool can_draw() {
    const char* const terminal = std::getenv("TERM");
    return ::isatty(STDERR_FILENO) == 1 &&
           !(terminal != nullptr && std::string_view(terminal) == "dumb");
}

}  // namespace isonest::detail::cli
