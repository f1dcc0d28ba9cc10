// Text in JSON.
#pragma once

#include <string>
#include <string_view>

namespace isonest::detail {

/// The text as a JSON string, with its quotes. REQUIRES: UTF-8 without control characters.
inline std::string json_string(std::string_view text) {
    std::string out = "\"";
    for (const char c : text) {
        if (c == '"' || c == '\\') {
            out += '\\';
        }
        out += c;
    }
    return out + "\"";
}

}  // namespace isonest::detail
