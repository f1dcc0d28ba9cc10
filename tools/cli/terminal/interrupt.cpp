#include "tools/cli/terminal/interrupt.h"

#include <unistd.h>

#include <atomic>
#include <csignal>

#include <isonest/error.h>

namespace isonest::detail::cli {
namespace {

std::atomic<int> signals{0};
static_assert(std::atomic<int>::is_always_lock_free);
std::atomic<void (*)()> before_end{nullptr};
static_assert(std::atomic<void (*)()>::is_always_lock_free);

extern "C" void on_signal(int signal) {
    // A terminal that is closed hangs up twice, once itself and once through its shell.
    if (signals.fetch_add(1) > 0 && signal != SIGHUP) {
        ::_exit(static_cast<int>(ErrorKind::cancelled));
    }
}

/// A page of a mapped file that is not there any more.
extern "C" void on_bus_error(int /*signal*/) {
    constexpr char kMessage[] =
        "isonest: an input file or store was truncated, or its disk failed, while it was being "
        "read; the output was not made. Restore the file and run again.\n";
    [[maybe_unused]] const auto written = ::write(STDERR_FILENO, kMessage, sizeof(kMessage) - 1);
    if (void (*const last)() = before_end.load()) {
        last();
    }
    ::_exit(static_cast<int>(ErrorKind::io));
}

}  // namespace

void watch_signals() {
    struct sigaction action {};
    action.sa_handler = &on_signal;
    action.sa_flags = SA_RESTART;
    sigemptyset(&action.sa_mask);
    ::sigaction(SIGINT, &action, nullptr);
    ::sigaction(SIGTERM, &action, nullptr);
    ::sigaction(SIGXCPU, &action, nullptr);
    struct sigaction before {};
    ::sigaction(SIGHUP, nullptr, &before);
    if (before.sa_handler != SIG_IGN) {  // else nohup asked for that
        ::sigaction(SIGHUP, &action, nullptr);
    }
    action.sa_handler = SIG_IGN;
    ::sigaction(SIGXFSZ, &action, nullptr);
    ::sigaction(SIGPIPE, &action, nullptr);
    action.sa_handler = &on_bus_error;
    ::sigaction(SIGBUS, &action, nullptr);
}

void let_a_closed_pipe_end_the_program() {
    ::signal(SIGPIPE, SIG_DFL);
}

void before_a_bus_error_ends_the_program(void (*last)()) {
    before_end.store(last);
}

bool interrupted() {
    return signals.load(std::memory_order_relaxed) > 0;
}

}  // namespace isonest::detail::cli
