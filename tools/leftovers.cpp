#include "tools/leftovers.h"

#include <fmt/format.h>
#include <unistd.h>

#include <cerrno>
#include <charconv>
#include <csignal>
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
        if (!name.starts_with(prefix) || name.ends_with(".journal") || name.ends_with(".centres")) {
            continue;
        }
        pid_t process = 0;
        const auto parsed =
            std::from_chars(name.data() + prefix.size(), name.data() + name.size(), process);
        const bool is_over = process == ::getpid() || (::kill(process, 0) != 0 && errno == ESRCH);
        if (parsed.ec != std::errc{} || process <= 0 || !is_over) {
            continue;
        }
        const std::string path = entry->path().string();
        std::error_code ignored;
        const auto bytes = std::filesystem::file_size(path, ignored);
        const std::string size = human_bytes(ignored ? 0.0 : static_cast<double>(bytes));
        found += found.empty() ? "" : "\n";
        if (std::filesystem::exists(path + ".journal", ignored)) {
            found += fmt::format(
                "{0} ({1}) was left by a run that was interrupted; go on with it by --resume, or "
                "delete it with {0}.journal and {0}.centres",
                path, size);
        } else {
            found +=
                fmt::format("{} ({}) was left by a run that was killed; delete it", path, size);
        }
    }
    return found;
}

}  // namespace isonest::cli
