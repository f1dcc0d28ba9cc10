// Source: Unicode Standard 15, table 3-7 (well-formed UTF-8), Annex 9 (direction).
#include "tools/cli/terminal/shown_text.h"

#include <fmt/format.h>

#include <algorithm>
#include <cstddef>

#include "store/base/label_text.h"

namespace isonest::detail::cli {
namespace {

/// Of the character that begins with this byte; 1 where none does.
std::size_t length_of(unsigned char first) {
    return first >= 0xF0U ? 4 : first >= 0xE0U ? 3 : first >= 0xC0U ? 2 : 1;
}

bool turns_direction(std::string_view character) {
    // U+061C, U+200E and U+200F, U+202A to U+202E, U+2066 to U+2069
    return character == "\xD8\x9C" || character == "\xE2\x80\x8E" || character == "\xE2\x80\x8F" ||
           (character >= "\xE2\x80\xAA" && character <= "\xE2\x80\xAE" && character.size() == 3) ||
           (character >= "\xE2\x81\xA6" && character <= "\xE2\x81\xA9" && character.size() == 3);
}

/// U+0080 to U+009F: C2 and their number.
bool is_latin_control(std::string_view character) {
    return character.size() == 2 && character[0] == '\xC2' &&
           static_cast<unsigned char>(character[1]) < 0xA0U &&
           static_cast<unsigned char>(character[1]) >= 0x80U;
}

std::string shown(std::string_view text, std::string_view as_they_are) {
    std::string result;
    for (std::size_t at = 0; at < text.size();) {
        const std::size_t length =
            std::min(length_of(static_cast<unsigned char>(text[at])), text.size() - at);
        const std::string_view character = text.substr(at, length);
        if (as_they_are.find(text[at]) != std::string_view::npos ||
            (is_printable_utf8(character) && !turns_direction(character))) {
            result += character;
            at += length;
        } else {
            at += is_latin_control(character) ? 1 : 0;
            result += fmt::format("\\x{:02x}", static_cast<unsigned char>(text[at]));
            ++at;
        }
    }
    return result;
}

}  // namespace

std::string shown_text(std::string_view text) {
    return shown(text, "");
}
std::string shown_lines(std::string_view text) {
    return shown(text, "\n\t");
}

}  // namespace isonest::detail::cli
