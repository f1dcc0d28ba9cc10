#include "tools/cli/terminal/help_format.h"

#include <algorithm>

namespace isonest::detail::cli {
namespace {

constexpr std::size_t kLeft = 28;  ///< characters for the names

/// A name on the left and words on the right.
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
        name += " " + option->get_type_name();
    }
    const std::string must = !is_positional && option->get_required() ? " (required)" : "";
    return row(name, option->get_description() + must);
}

std::string HelpFormat::make_description(const CLI::App* app) const {
    const std::string text = app->get_description();
    return text.empty() ? text : wrapped(text, 0, 0) + "\n\n";
}

}  // namespace isonest::detail::cli
