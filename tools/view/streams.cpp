#include "tools/view/streams.h"

#include <fmt/format.h>

#include <algorithm>
#include <cctype>

#include <isonest/error.h>

namespace isonest::detail::view {

void Streams::require_name(const std::string& name) {
    constexpr std::size_t kMostLetters = 64;
    const bool good = std::all_of(name.begin(), name.end(), [](unsigned char c) {
        return std::isalnum(c) != 0 || c == '-' || c == '_';
    });
    if (name.empty() || name.size() > kMostLetters || !good) {
        throw Error(ErrorKind::invalid_argument,
                    fmt::format("stream '{}': give 1 to {} letters, digits, - or _",
                                name.substr(0, kMostLetters), kMostLetters));
    }
}

void Streams::replace(const std::string& name, const std::shared_ptr<Job>& job) {
    std::erase_if(jobs_, [](const auto& entry) { return entry.second.expired(); });
    cancel(name);
    jobs_[name] = job;
}

void Streams::cancel(const std::string& name) {
    const auto found = jobs_.find(name);
    if (found == jobs_.end()) {
        return;
    }
    if (const std::shared_ptr<Job> job = found->second.lock()) {
        job->cancel();
    }
    jobs_.erase(found);
}

}  // namespace isonest::detail::view
