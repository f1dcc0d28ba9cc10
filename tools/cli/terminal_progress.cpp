#include "tools/cli/terminal_progress.h"

#include <fmt/format.h>
#include <sys/ioctl.h>
#include <unistd.h>

#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <string_view>

#include "tools/cli/interrupt.h"
#include "tools/cli/units.h"

namespace isonest::detail::cli {
namespace {

constexpr double kSettled = 0.5;  // seconds before a rate means something

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
    std::string line = fmt::format("{:<16}", state.phase);
    const auto done = static_cast<double>(state.done);
    const auto total = static_cast<double>(state.total);
    if (state.total > 0) {
        line += fmt::format(" {:3.0f} %", std::min(100.0, 100 * done / total));
    }
    if (state.seconds >= kSettled && state.done > 0) {
        const double rate = done / state.seconds;
        line += state.unit == "B" ? fmt::format("   {}/s", human_bytes(rate))
                                  : fmt::format("   {} {}/s", human_count(rate), state.unit);
        if (state.total > state.done) {
            line += fmt::format("   {} left", human_seconds((total - done) / rate));
        }
    }
    line.resize(std::min(line.size(), static_cast<std::size_t>(std::max(columns - 1, 0))));
    return line;
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
    state_ = {std::string(phase), std::string(unit), 0, total, 0};
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
