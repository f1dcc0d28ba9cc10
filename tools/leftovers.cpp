#include "tools/leftovers.h"

#include <fmt/format.h>
#include <signal.h>

#include <cerrno>
#include <charconv>
#include <system_error>

#include "store/output_file.h"
#include "tools/units.h"

namespace isonest::cli {

std::string leftovers_of(const std::filesystem::path& output) {
    const std::filesystem::path names = temporary_prefix(output);
    const std::string prefix = names.filename().string();
    std::string found;
    std::error_code error;
    for (auto entry = std::filesystem::directory_iterator(names.parent_path(), error);
         !error && entry != std::filesystem::directory_iterator(); entry.increment(error)) {
        const std::string name = entry->path().filename().string();
        if (!name.starts_with(prefix)) {
            continue;
        }
        pid_t process = 0;
        const char* const end = name.data() + name.size();
        const auto parsed = std::from_chars(name.data() + prefix.size(), end, process);
        if (parsed.ec != std::errc{} || parsed.ptr != end || process <= 0 ||
            ::kill(process, 0) == 0 || errno != ESRCH) {
            continue;
        }
        std::error_code ignored;
        const auto bytes = std::filesystem::file_size(entry->path(), ignored);
        found += fmt::format("{}{} ({}) was left by a run that was killed; delete it",
                             found.empty() ? "" : "\n", entry->path().string(),
                             human_bytes(ignored ? 0.0 : static_cast<double>(bytes)));
    }
    return found;
}

}  // namespace isonest::cli
