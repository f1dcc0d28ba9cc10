#include "tools/cli/terminal/interrupt.h"

#include <fmt/format.h>
#include <unistd.h>

#include <atomic>
#include <cerrno>
#include <charconv>
#include <csignal>
#include <set>
#include <string_view>
#include <system_error>

#include <isonest/error.h>

#include "store/files/output_file.h"
#include "store/files/scratch_file.h"
#include "tools/cli/options/units.h"

namespace isonest::detail::cli {
namespace {

std::atomic<int> signals{0};
static_assert(std::atomic<int>::is_always_lock_free);
std::atomic<void (*)()> before_end{nullptr};
static_assert(std::atomic<void (*)()>::is_always_lock_free);

extern "C" void on_signal(int signal) {
    // When a terminal is closed, SIGHUP arrives twice: from the terminal and from its shell.
    if (signals.fetch_add(1) > 0 && signal != SIGHUP) {
        ::_exit(static_cast<int>(ErrorKind::cancelled));
    }
}

/// Raised on access to a mapped file that was truncated.
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
    if (before.sa_handler != SIG_IGN) {  // SIG_IGN is set by nohup
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

namespace {

/// Whether `name` is `prefix` followed by the id of a process that is no longer running.
bool is_of_a_run_that_is_over(std::string_view name, std::string_view prefix) {
    if (!name.starts_with(prefix)) {
        return false;
    }
    pid_t process = 0;
    const auto parsed =
        std::from_chars(name.data() + prefix.size(), name.data() + name.size(), process);
    return parsed.ec == std::errc{} && process > 0 &&
           (process == ::getpid() || (::kill(process, 0) != 0 && errno == ESRCH));
}

std::string message_of(const std::filesystem::path& file) {
    const std::string path = file.string();
    std::error_code ignored;
    const auto bytes = std::filesystem::file_size(file, ignored);
    const std::string size = human_bytes(ignored ? 0.0 : static_cast<double>(bytes));
    if (std::filesystem::exists(path + ".journal", ignored)) {
        return fmt::format(
            "{0} ({1}) was left by an interrupted run; continue it with --resume, or delete it "
            "with {0}.journal and {0}.centres",
            path, size);
    }
    return fmt::format("{} ({}) was left by a killed run; delete it", path, size);
}

/// Whether the file accompanies another file that exists; that one's message names both.
bool goes_with_another(const std::string& path) {
    for (const std::string_view end : {".journal", ".centres"}) {
        std::error_code ignored;
        if (path.ends_with(end) &&
            std::filesystem::exists(path.substr(0, path.size() - end.size()), ignored)) {
            return true;
        }
    }
    return false;
}

}  // namespace

std::string leftovers_of(const std::filesystem::path& output) {
    return leftovers_of(std::vector{output});
}

std::string leftovers_of(const std::vector<std::filesystem::path>& outputs) {
    std::set<std::filesystem::path> found;
    std::set<std::filesystem::path> folders;
    std::set<std::string> prefixes;
    for (const std::filesystem::path& output : outputs) {
        const std::filesystem::path names = temporary_prefix(output);
        folders.insert(names.parent_path());
        prefixes.insert(names.filename().string());
    }
    prefixes.insert(ScratchFile::kPrefix);
    for (const std::filesystem::path& folder : folders) {
        std::error_code error;
        for (auto entry = std::filesystem::directory_iterator(folder, error);
             !error && entry != std::filesystem::directory_iterator(); entry.increment(error)) {
            const std::string name = entry->path().filename().string();
            for (const std::string& prefix : prefixes) {
                if (is_of_a_run_that_is_over(name, prefix) &&
                    !goes_with_another(entry->path().string())) {
                    found.insert(entry->path());
                }
            }
        }
    }
    std::string text;
    for (const std::filesystem::path& file : found) {
        text += (text.empty() ? "" : "\n") + message_of(file);
    }
    return text;
}

}  // namespace isonest::detail::cli
