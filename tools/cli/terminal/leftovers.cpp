#include "tools/cli/terminal/leftovers.h"

#include <fmt/format.h>
#include <unistd.h>

#include <cerrno>
#include <charconv>
#include <csignal>
#include <set>
#include <string_view>
#include <system_error>

#include "store/files/output_file.h"
#include "store/files/scratch_file.h"
#include "tools/cli/options/units.h"

namespace isonest::detail::cli {
namespace {

/// Whether a name goes on after the prefix with the id of a process that is not running.
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
            "{0} ({1}) was left by a run that was interrupted; go on with it by --resume, or "
            "delete it with {0}.journal and {0}.centres",
            path, size);
    }
    return fmt::format("{} ({}) was left by a run that was killed; delete it", path, size);
}

/// A file that goes with another one that is there, which is named for both.
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
