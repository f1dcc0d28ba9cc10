#include "preprocess/sources/bytes/header_words.h"

#include <fmt/format.h>

#include <algorithm>
#include <string>
#include <string_view>
#include <system_error>

#include <isonest/error.h>

#include "preprocess/sources/bytes/input_file.h"

namespace isonest::detail {

std::string lower(std::string_view text) {
    std::string out(text);
    std::transform(out.begin(), out.end(), out.begin(), [](char c) {
        return c >= 'A' && c <= 'Z' ? static_cast<char>(c - 'A' + 'a') : c;
    });
    return out;
}

namespace {

bool is_digit(char c) {
    return c >= '0' && c <= '9';
}

/// The run of digits at `at`, without leading zeros; `at` moves past it.
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
        if (files.size() >= kMaxFolderFiles) {
            throw Error(ErrorKind::unsupported, {folder.string()},
                        fmt::format("the folder has more than {} files, which is the limit",
                                    kMaxFolderFiles));
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

namespace {

struct JsonSize {
    std::size_t depth = 0;
    std::size_t bytes = 0;  ///< approximate memory for the parsed text
};

/// Quotes NaN and the infinities outside of strings.
std::string quoted_numbers(const std::string& text, JsonSize& size) {
    // A list element takes 16 bytes, and a growing list has capacity for up to three times as many;
    // an object member is a tree node with its name.
    constexpr std::size_t kElement = 48;
    constexpr std::size_t kMember = 96;
    constexpr std::size_t kList = 32;
    constexpr std::array<std::string_view, 3> kWords{"NaN", "-Infinity", "Infinity"};
    std::string out;
    bool inside = false;
    std::size_t open = 0;
    for (std::size_t at = 0; at < text.size();) {
        const char c = text[at];
        if (inside && c == '\\') {
            out += text.substr(at, 2);
            at += 2;
            continue;
        }
        inside = c == '"' ? !inside : inside;
        if (!inside) {
            open += c == '{' || c == '[' ? 1 : 0;
            open -= (c == '}' || c == ']') && open > 0 ? 1 : 0;
            size.depth = std::max(size.depth, open);
            size.bytes += c == ','               ? kElement
                          : c == ':'             ? kMember
                          : c == '{' || c == '[' ? kList
                                                 : 0;
            const auto* const word = std::find_if(
                kWords.begin(), kWords.end(),
                [&](std::string_view w) { return text.compare(at, w.size(), w) == 0; });
            if (word != kWords.end()) {
                out += fmt::format("\"{}\"", *word);
                at += word->size();
                continue;
            }
        }
        out += c;
        ++at;
    }
    return out;
}

}  // namespace

nlohmann::json parse_json(const std::string& text, const std::string& name) {
    constexpr std::size_t kDeepest = 64;
    constexpr std::size_t kMaxMemory = std::size_t{80} << 20U;
    JsonSize size;
    const std::string quoted = quoted_numbers(text, size);
    if (size.depth > kDeepest) {
        throw Error(ErrorKind::unsupported, {name},
                    fmt::format("the JSON is nested too deeply: {} levels", size.depth));
    }
    if (size.bytes > kMaxMemory) {
        throw Error(ErrorKind::unsupported, {name},
                    fmt::format("the JSON needs {} MiB of memory; the limit is {} MiB",
                                size.bytes >> 20U, kMaxMemory >> 20U));
    }
    nlohmann::json json = nlohmann::json::parse(quoted, nullptr, false);
    if (json.is_discarded()) {
        throw Error(ErrorKind::corrupt, {name}, "not valid JSON");
    }
    return json;
}

std::optional<nlohmann::json> read_json(const std::filesystem::path& path) {
    std::error_code error;
    if (!std::filesystem::is_regular_file(path, error)) {
        return std::nullopt;
    }
    const std::uint64_t size = regular_file_size(path);
    if (size > kMaxJsonBytes) {
        throw Error(ErrorKind::unsupported, {path.string()},
                    fmt::format("a JSON file of {} bytes is too large", size));
    }
    return parse_json(first_bytes(path, static_cast<std::size_t>(size)), path.string());
}

}  // namespace isonest::detail
