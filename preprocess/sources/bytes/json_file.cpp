#include "preprocess/sources/bytes/json_file.h"

#include <fmt/format.h>

#include <algorithm>
#include <string>
#include <string_view>
#include <system_error>

#include <isonest/error.h>

#include "preprocess/sources/bytes/regular_file.h"

namespace isonest::detail {
namespace {

struct JsonSize {
    std::size_t depth = 0;
    std::size_t bytes = 0;  ///< of memory that it takes when it is parsed, roughly
};

/// Puts quotation marks around NaN and the infinities that stand outside of strings.
std::string quoted_numbers(const std::string& text, JsonSize& size) {
    // An element of a list is 16 bytes, of which a growing list has up to three times as many; a
    // member of an object is a node of a tree with its name.
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
    constexpr std::size_t kMostMemory = std::size_t{80} << 20U;
    JsonSize size;
    const std::string quoted = quoted_numbers(text, size);
    if (size.depth > kDeepest) {
        throw Error(ErrorKind::unsupported, {name},
                    fmt::format("JSON that nests {} levels deep", size.depth));
    }
    if (size.bytes > kMostMemory) {
        throw Error(ErrorKind::unsupported, {name},
                    fmt::format("JSON that takes {} MiB of memory: up to {} are read",
                                size.bytes >> 20U, kMostMemory >> 20U));
    }
    nlohmann::json json = nlohmann::json::parse(quoted, nullptr, false);
    if (json.is_discarded()) {
        throw Error(ErrorKind::corrupt, {name}, "not JSON");
    }
    return json;
}

std::optional<nlohmann::json> read_json(const std::filesystem::path& path) {
    std::error_code error;
    if (!std::filesystem::is_regular_file(path, error)) {
        return std::nullopt;
    }
    const std::uint64_t size = regular_file_size(path);
    if (size > kMostJsonBytes) {
        throw Error(ErrorKind::unsupported, {path.string()},
                    fmt::format("a description of {} bytes", size));
    }
    return parse_json(first_bytes(path, static_cast<std::size_t>(size)), path.string());
}

}  // namespace isonest::detail
