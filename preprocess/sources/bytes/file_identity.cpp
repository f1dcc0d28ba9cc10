#include "preprocess/sources/bytes/file_identity.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>

#include "store/container/codec.h"

namespace isonest::detail {
namespace {

constexpr std::size_t kSample = std::size_t{1} << 16U;

std::string state_of(const std::filesystem::path& path) {
    const int file = ::open(path.c_str(), O_RDONLY | O_CLOEXEC | O_NONBLOCK);
    struct stat status {};
    if (file < 0 || ::fstat(file, &status) != 0) {
        if (file >= 0) {
            ::close(file);
        }
        return "cannot be read";
    }
    const auto size = static_cast<std::uint64_t>(std::max<off_t>(status.st_size, 0));
    std::vector<std::byte> bytes(2 * kSample);
    std::size_t count = 0;
    for (const std::uint64_t at :
         {std::uint64_t{0}, size - std::min<std::uint64_t>(size, kSample)}) {
        const ssize_t n = ::pread(file, bytes.data() + count, kSample, static_cast<off_t>(at));
        count += static_cast<std::size_t>(std::max<ssize_t>(n, 0));
    }
    ::close(file);
    return fmt::format("bytes {}, time {}.{:09}, ends {:016x}", size, status.st_mtim.tv_sec,
                       status.st_mtim.tv_nsec, checksum_of(std::span(bytes).first(count)));
}

}  // namespace

std::string identity_of(const std::vector<std::filesystem::path>& files) {
    return identity_of_inputs({files.begin(), files.end()});
}

std::string identity_of_inputs(const std::vector<InputFile>& files) {
    constexpr std::size_t kOwnLine = 32;
    std::string text;
    std::string others;
    for (std::size_t i = 0; i < files.size(); ++i) {
        const bool is_far = files[i].is_far();
        if (is_far && files[i].state().empty()) {
            return "";
        }
        const std::string state = is_far ? files[i].state() : state_of(files[i].path());
        if (i < kOwnLine) {
            text += fmt::format("{} {}\n", i == 0 ? "input" : "data", state);
        } else {
            others += state + "\n";
        }
    }
    if (!others.empty()) {
        text += fmt::format("data of {} other files {:016x}\n", files.size() - kOwnLine,
                            checksum_of(std::as_bytes(std::span(others))));
    }
    return text;
}

}  // namespace isonest::detail
