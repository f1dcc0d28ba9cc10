// What others have written, for a terminal.
#pragma once

#include <string>
#include <string_view>

namespace isonest::detail::cli {

/// The text with what may move, colour or rename the terminal written out: control characters,
/// those of Unicode that turn the direction of text, and bytes that are no UTF-8, as \x1b.
std::string shown_text(std::string_view text);
/// The same of a message or a report, which may have several lines: ends of lines and tabs stay.
std::string shown_lines(std::string_view text);

}  // namespace isonest::detail::cli
