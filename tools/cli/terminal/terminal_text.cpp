#include "tools/cli/terminal/terminal_text.h"

#include <fmt/format.h>

#include <algorithm>
#include <cstddef>
#include <cstdlib>
#include <filesystem>
#include <utility>

#include "store/base/label_text.h"
#include "tools/cli/options/option_table.h"

namespace isonest::detail::cli {

// Source: Unicode Standard 15, table 3-7 (well-formed UTF-8), Annex 9 (direction).

namespace {

/// Length of the UTF-8 character that begins with this byte; 1 if no character does.
std::size_t length_of(unsigned char first) {
    return first >= 0xF0U ? 4 : first >= 0xE0U ? 3 : first >= 0xC0U ? 2 : 1;
}

bool turns_direction(std::string_view character) {
    // U+061C, U+200E and U+200F, U+202A to U+202E, U+2066 to U+2069
    return character == "\xD8\x9C" || character == "\xE2\x80\x8E" || character == "\xE2\x80\x8F" ||
           (character >= "\xE2\x80\xAA" && character <= "\xE2\x80\xAE" && character.size() == 3) ||
           (character >= "\xE2\x81\xA6" && character <= "\xE2\x81\xA9" && character.size() == 3);
}

/// U+0080 to U+009F, encoded as C2 followed by the number.
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

namespace {

std::size_t edits(const std::string& a, const std::string& b) {
    std::vector<std::vector<std::size_t>> d(a.size() + 1, std::vector<std::size_t>(b.size() + 1));
    for (std::size_t i = 0; i <= a.size(); ++i) {
        for (std::size_t j = 0; j <= b.size(); ++j) {
            if (i == 0 || j == 0) {
                d[i][j] = i + j;
                continue;
            }
            const std::size_t same = a[i - 1] == b[j - 1] ? 0 : 1;
            d[i][j] = std::min({d[i - 1][j] + 1, d[i][j - 1] + 1, d[i - 1][j - 1] + same});
            if (i > 1 && j > 1 && a[i - 1] == b[j - 2] && a[i - 2] == b[j - 1]) {
                d[i][j] = std::min(d[i][j], d[i - 2][j - 2] + 1);
            }
        }
    }
    return d[a.size()][b.size()];
}

}  // namespace

std::vector<std::string> nearest_names(const std::string& word,
                                       const std::vector<std::string>& names, std::size_t most) {
    constexpr std::size_t kLongest = 64;
    if (word.size() > kLongest) {
        return {};
    }
    const std::size_t least = word.size() / 3 + 1;
    std::vector<std::pair<std::size_t, std::string>> near;
    for (const std::string& name : names) {
        // The word may be the beginning of a longer name.
        const bool begins = name.starts_with(word) && word.size() > 3;
        if (!begins && name.size() >= word.size() + least) {
            continue;  // at least `least` letters are missing
        }
        const std::size_t count = begins ? 1 : edits(word, name);
        if (count < least) {
            near.emplace_back(count, name);
        }
    }
    std::stable_sort(near.begin(), near.end(),
                     [](const auto& a, const auto& b) { return a.first < b.first; });
    near.resize(std::min(near.size(), most));
    std::vector<std::string> nearest;
    for (auto& [count, name] : near) {
        nearest.push_back(std::move(name));
    }
    return nearest;
}

std::optional<std::string> nearest_name(const std::string& word,
                                        const std::vector<std::string>& names) {
    const std::vector<std::string> nearest = nearest_names(word, names, 1);
    return nearest.empty() ? std::nullopt : std::optional(nearest.front());
}

namespace {

constexpr std::size_t kLeft = 28;  ///< columns for the names

/// A name on the left and its description on the right.
std::string row(const std::string& name, const std::string& words) {
    std::string text = "  " + name;
    if (words.empty()) {
        return text + "\n";
    }
    if (text.size() + 2 > kLeft) {
        text += "\n" + std::string(kLeft, ' ');
    } else {
        text.resize(kLeft, ' ');
    }
    return text + wrapped(words, kLeft, kLeft) + "\n";
}

}  // namespace

std::string wrapped(const std::string& text, std::size_t column, std::size_t indent) {
    std::string out;
    std::size_t at = 0;
    bool is_first = true;
    while (at < text.size()) {
        if (text[at] == '\n' && at + 1 < text.size() && text[at + 1] == '\n') {
            out += "\n\n" + std::string(indent, ' ');
            column = indent;
            is_first = true;
        }
        const std::size_t begin = text.find_first_not_of(" \n", at);
        if (begin == std::string::npos) {
            break;
        }
        const std::size_t end = std::min(text.find_first_of(" \n", begin), text.size());
        const std::size_t size = end - begin;
        if (!is_first && column + 1 + size > kHelpColumns) {
            out += "\n" + std::string(indent, ' ');
            column = indent;
        } else if (!is_first) {
            out += ' ';
            ++column;
        }
        out += text.substr(begin, size);
        column += size;
        is_first = false;
        at = end;
    }
    return out;
}

std::string HelpFormat::make_subcommand(const CLI::App* command) const {
    const std::string text = command->get_description();
    return row(command->get_name(), text.substr(0, text.find('\n')));
}

std::string HelpFormat::make_option(const CLI::Option* option, bool is_positional) const {
    std::string name = option->get_name(is_positional, true);
    std::replace(name.begin(), name.end(), '\n', ' ');
    if (!is_positional && !option->get_type_name().empty()) {
        // The form of a flag, "[=N]", follows the name without a blank.
        name += (option->get_type_name().starts_with('[') ? "" : " ") + option->get_type_name();
    }
    const std::string must = !is_positional && option->get_required() ? " (required)" : "";
    return row(name, option->get_description() + must);
}

std::string HelpFormat::make_help(const CLI::App* app, std::string name,
                                  CLI::AppFormatMode mode) const {
    if (app->get_parent() == nullptr) {
        return CLI::Formatter::make_help(app, std::move(name), mode);
    }
    std::string text = make_description(app) + make_usage(app, std::move(name));
    text += make_positionals(app);
    for (const char* const group : option_groups()) {
        const std::vector<const CLI::Option*> options = options_in(*app, group);
        text += options.empty() ? "" : make_group(group, false, options);
    }
    return text + "\n" + make_footer(app);
}

std::string HelpFormat::make_description(const CLI::App* app) const {
    const std::string text = app->get_description();
    return text.empty() ? text : wrapped(text, 0, 0) + "\n\n";
}

namespace {

namespace fs = std::filesystem;

/// The folder with the zstd filter plugin: that of the build tree, or the installed one; empty if
/// there is none.
std::string filter_folder() {
    std::error_code error;
    const fs::path program = fs::read_symlink("/proc/self/exe", error);
    const fs::path prefix = program.parent_path().parent_path();
    for (const char* const folder : {"plugin", ISONEST_LIBDIR "/isonest/hdf5-plugin"}) {
        if (!error && fs::is_directory(prefix / folder, error)) {
            return (prefix / folder).string();
        }
    }
    return {};
}

}  // namespace

std::string paraview_hint() {
    const std::string folder =
        std::getenv("HDF5_PLUGIN_PATH") == nullptr ? filter_folder() : std::string{};
    return fmt::format(
        "ParaView opens a store named .hdf (5.11 and newer) or .vtkhdf (5.12 and newer){}, but not "
        "one of 64-bit labels, which isonest export writes as .vti.",
        folder.empty() ? std::string{} : fmt::format(", with HDF5_PLUGIN_PATH={}", folder));
}

}  // namespace isonest::detail::cli
