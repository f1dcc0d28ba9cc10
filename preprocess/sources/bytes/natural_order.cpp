#include "preprocess/sources/bytes/natural_order.h"

#include <fmt/format.h>

#include <algorithm>
#include <string>
#include <system_error>

#include <isonest/error.h>

#include "preprocess/sources/bytes/lower_case.h"
#include "preprocess/sources/bytes/regular_file.h"

namespace isonest::detail {
namespace {

bool is_digit(char c) {
    return c >= '0' && c <= '9';
}

/// The run of digits at `at`, without zeros in front; `at` moves behind it.
std::string_view number_of(std::string_view text, std::size_t& at) {
    while (at < text.size() && text[at] == '0') {
        ++at;
    }
    const std::size_t from = at;
    while (at < text.size() && is_digit(text[at])) {
        ++at;
    }
    return text.substr(from, at - from);
}

}  // namespace

bool naturally_less(std::string_view a, std::string_view b) {
    std::size_t i = 0;
    std::size_t j = 0;
    while (i < a.size() && j < b.size()) {
        if (is_digit(a[i]) && is_digit(b[j])) {
            const std::string_view m = number_of(a, i);
            const std::string_view n = number_of(b, j);
            if (m != n) {
                return m.size() != n.size() ? m.size() < n.size() : m < n;
            }
        } else if (a[i] != b[j]) {
            return a[i] < b[j];
        } else {
            ++i;
            ++j;
        }
    }
    return a.size() - i != b.size() - j ? a.size() - i < b.size() - j : a < b;
}

std::vector<std::filesystem::path> files_in(const std::filesystem::path& folder,
                                            const std::vector<std::string_view>& extensions) {
    std::vector<std::filesystem::path> files;
    std::error_code error;
    for (auto entry = std::filesystem::directory_iterator(folder, error);
         !error && entry != std::filesystem::directory_iterator(); entry.increment(error)) {
        const std::string extension = lower(entry->path().extension().string());
        if (entry->path().filename().string().starts_with('.') ||
            (!extensions.empty() &&
             std::find(extensions.begin(), extensions.end(), extension) == extensions.end()) ||
            !is_file_of_folder(*entry)) {
            continue;
        }
        if (files.size() >= kMostFolderFiles) {
            throw Error(ErrorKind::unsupported, {folder.string()},
                        fmt::format("more than {} files", kMostFolderFiles));
        }
        files.push_back(entry->path());
    }
    if (error) {
        throw Error(ErrorKind::io, {folder.string()},
                    fmt::format("cannot list it: {}", error.message()));
    }
    std::sort(files.begin(), files.end(), [](const auto& a, const auto& b) {
        return naturally_less(a.filename().string(), b.filename().string());
    });
    return files;
}

}  // namespace isonest::detail
