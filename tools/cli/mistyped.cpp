#include "tools/cli/mistyped.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <array>
#include <cctype>
#include <filesystem>
#include <string_view>
#include <system_error>
#include <utility>
#include <vector>

#include <isonest/error.h>

#include "store/remote/open_location.h"
#include "tools/cli/options/units.h"
#include "tools/cli/program.h"
#include "tools/cli/terminal/terminal_text.h"

namespace isonest::detail::cli {
namespace {

/// Names that other programs use for an option. If several rows have the same name, the last one
/// whose option the command has is used.
constexpr std::array<std::pair<std::string_view, std::string_view>, 38> kOtherNames{
    {{"--guarantee", "--indicator"},
     {"--isovalue", "--iso"},
     {"--isovalues", "--iso"},
     {"--isolevel", "--iso"},
     {"--isosurface", "--iso"},
     {"--level", "--iso"},
     {"--value", "--iso"},
     {"--contour", "--iso"},
     {"--threshold", "--iso"},
     {"-i", "--iso"},
     {"-l", "--iso"},
     {"-v", "--iso"},
     {"--tolerance", "--error"},
     {"--tol", "--error"},
     {"-e", "--error"},
     {"--relative-error", "--error-relative"},
     {"-d", "--distance"},
     {"--simplify", "--distance"},
     {"--decimate", "--triangles"},
     {"--reduce", "--triangles"},
     {"--faces", "--triangles"},
     {"-n", "--triangles"},
     {"--out", "--output"},
     {"--output", "--out"},
     {"--dims", "--size"},
     {"--shape", "--size"},
     {"--shape", "--dims"},
     {"--size", "--dims"},
     {"--dtype", "--type"},
     {"--voxel-size", "--spacing"},
     {"--resolution", "--spacing"},
     {"--roi", "--box"},
     {"--bounds", "--box"},
     {"--overwrite", "--force"},
     {"-f", "--force"},
     {"--jobs", "--threads"},
     {"-j", "--threads"},
     {"-t", "--threads"}}};

bool is_option(std::string_view word) {
    return word.size() > 1 && word[0] == '-' &&
           (word[1] == '-' || std::isalpha(static_cast<unsigned char>(word[1])) != 0);
}

bool is_file(const std::string& word) {
    std::error_code ignored;
    return word == "-" || is_url(word) ||
           std::filesystem::exists(std::filesystem::symlink_status(word, ignored));
}

/// The name of the option in a word: "--iso" of "--iso=3", "-o" of "-ofile".
std::string option_name(const std::string& word) {
    return word.starts_with("--") ? word.substr(0, word.find('=')) : word.substr(0, 2);
}

bool takes_nothing(const CLI::Option& option) {
    return option.get_expected_max() == 0 || option.get_type_size_max() == 0;
}

/// Whether `parse` accepts its text, i.e. does not throw an Error.
template <class Parse>
bool is_taken(const Parse& parse) {
    try {
        parse();
        return true;
    } catch (const Error&) {
        return false;
    }
}

bool is_number(const std::string& text) {
    return is_taken([&] { parse_number("", text); });
}

/// Suggests a replacement for a flag that is followed by a stray word.
std::optional<std::string> meant_by_flag(const std::string& name, const CLI::Option& flag,
                                         const std::string& word) {
    // "[=below|above]", "[=N]"
    std::string form = flag.get_type_name();
    if (form.starts_with("[=") && form.ends_with("]")) {
        form = "|" + form.substr(2, form.size() - 3) + "|";
        if (form == "|N|" ? is_number(word) : form.find("|" + word + "|") != std::string::npos) {
            return fmt::format("write {}={}", name, word);
        }
    }
    constexpr std::array kYes{"yes", "true", "on", "1"};
    constexpr std::array kNo{"no", "false", "off", "0"};
    if (std::find(kYes.begin(), kYes.end(), word) != kYes.end()) {
        return fmt::format("write {} alone: it takes no value", name);
    }
    if (std::find(kNo.begin(), kNo.end(), word) != kNo.end()) {
        return fmt::format("leave out {}: it takes no value", name);
    }
    return std::nullopt;
}

/// Suggests a replacement for an option and its value that are followed by stray words.
std::optional<std::string> meant_by_option(const std::string& name, const CLI::Option& option,
                                           const std::string& value,
                                           const std::vector<std::string>& words) {
    const std::string& form = option.get_type_name();
    const std::string joined = value + words.front();
    const bool is_unit =
        !is_number(words.front()) &&
        ((name == "--distance" && is_taken([&] { parse_length(name, joined); })) ||
         (form == "SIZE" && is_taken([&] { parse_bytes(name, joined); })) ||
         (name.starts_with("--error") && words.front() == "%" && is_number(value)));
    if (is_unit) {
        return fmt::format("write {} {}", name, joined);
    }
    if (form.find(',') == std::string::npos || !is_number(words.front())) {
        return std::nullopt;
    }
    std::string list = value;
    for (const std::string& word : words) {
        if (!is_number(word) || is_file(word)) {
            break;
        }
        list += "," + word;
    }
    const bool fits =
        form.find("...") != std::string::npos ||
        std::count(list.begin(), list.end(), ',') <= std::count(form.begin(), form.end(), ',');
    return fits ? std::optional(fmt::format("write {} {}", name, list)) : std::nullopt;
}

/// The words from `first` on that are not options.
std::vector<std::string> words_from(int first, int argc, char** argv) {
    std::vector<std::string> words;
    for (int i = first; i < argc && !is_option(argv[i]); ++i) {
        words.emplace_back(argv[i]);
    }
    return words;
}

std::string unknown_command(const Program& program, const CLI::App& app, const std::string& word) {
    if (program.why_missing) {
        if (std::string why = program.why_missing(word); !why.empty()) {
            return why;
        }
    }
    std::vector<std::string> names;
    for (const CLI::App* const command :
         app.get_subcommands([](const CLI::App* /*any*/) { return true; })) {
        names.push_back(command->get_name());
    }
    if (word.empty()) {
        return fmt::format("give a command: {}", fmt::join(names, ", "));
    }
    const std::optional<std::string> meant = nearest_name(word, names);
    return fmt::format("there is no command '{}'{}", word,
                       meant ? fmt::format("; did you mean {}?", *meant) : "");
}

/// The first word from `first` on that looks like an option but is not one of the command's.
std::optional<std::string> unknown_option(const CLI::App& command, int first, int argc,
                                          char** argv) {
    std::vector<std::string> names;
    for (const CLI::Option* const option :
         command.get_options([](const CLI::Option* /*any*/) { return true; })) {
        for (const std::string& name : option->get_lnames()) {
            names.push_back("--" + name);
        }
    }
    for (int i = first; i < argc && std::string_view(argv[i]) != "--"; ++i) {
        if (!is_option(argv[i])) {
            continue;
        }
        const std::string word =
            std::string(argv[i]).substr(0, std::string_view(argv[i]).find('='));
        if (word.size() > 2 && word[1] != '-' &&
            command.get_option_no_throw("-" + word) != nullptr) {
            return fmt::format("there is no option {0}; did you mean -{0}?", word);
        }
        const std::string name = option_name(argv[i]);
        const CLI::Option* const option = command.get_option_no_throw(name);
        if (option != nullptr) {
            // Skips the option's value, which may look like an option.
            i += name == argv[i] && !takes_nothing(*option) ? 1 : 0;
            continue;
        }
        std::optional<std::string> meant;
        for (const auto& [other, ours] : kOtherNames) {
            if (name == other && std::find(names.begin(), names.end(), ours) != names.end()) {
                meant = ours;
            }
        }
        if (!meant && name.size() > 2) {
            meant = nearest_name(name, names);
        }
        return fmt::format("there is no option {}{}", name,
                           meant ? fmt::format("; did you mean {}?", *meant) : "");
    }
    return std::nullopt;
}

/// Lists the required options that were not given: "-o MESH: the mesh to write, ...".
std::string missing_options(const CLI::App& command) {
    std::string text;
    for (const CLI::Option* const option :
         command.get_options([](const CLI::Option* o) { return o->get_required(); })) {
        if (option->count() > 0) {
            continue;
        }
        const std::vector<std::string>& shorts = option->get_snames();
        const std::string name =
            option->get_positional() ? option->get_name(true)
            : shorts.empty()
                ? fmt::format("--{} {}", option->get_lnames().front(), option->get_type_name())
                : fmt::format("-{} {}", shorts.front(), option->get_type_name());
        text += fmt::format("{}{}: {}", text.empty() ? "missing " : "; and ", name,
                            option->get_description());
    }
    return text;
}

/// The kind of a parse error. For some kinds, CLI11's get_name() is the name of the command.
CLI::ExitCodes kind_of(const CLI::ParseError& error) {
    return static_cast<CLI::ExitCodes>(error.get_exit_code());
}

/// Replaces `verb` in a message of CLI11, such as "--a excludes --b", by `between`.
std::string with_words(const std::string& text, std::string_view verb, std::string_view between,
                       std::string_view end) {
    const std::size_t at = text.find(verb);
    return fmt::format("{}{}{}{}", text.substr(0, at), between, text.substr(at + verb.size()), end);
}

/// Message for an option with too few values, or one that is given twice. `text`: CLI11's message,
/// which begins with the option and a colon.
std::string count_of_values(const CLI::App& command, const std::string& text) {
    const std::string name = text.substr(0, text.find(':'));
    const CLI::Option* const option = command.get_option_no_throw(name);
    if (option == nullptr) {
        return text;
    }
    return option->count() > 1 ? fmt::format("{} is given more than once", name)
                               : fmt::format("{} needs a value, {}", name, option->get_type_name());
}

}  // namespace

std::optional<std::string> stray_word(const CLI::App& command, int argc, char** argv) {
    for (int i = 2; i < argc && std::string_view(argv[i]) != "--"; ++i) {
        const std::string word(argv[i]);
        const std::string name = is_option(word) ? option_name(word) : "";
        const CLI::Option* const option =
            name.empty() ? nullptr : command.get_option_no_throw(name);
        if (option == nullptr) {
            continue;
        }
        const bool is_flag = takes_nothing(*option);
        if (!is_flag && word != name) {
            continue;  // --iso=3
        }
        i += is_flag ? 0 : 1;
        const std::vector<std::string> words = words_from(i + 1, argc, argv);
        if (words.empty() || is_file(words.front())) {
            continue;
        }
        const std::optional<std::string> meant =
            is_flag ? meant_by_flag(name, *option, words.front())
                    : meant_by_option(name, *option, argv[i], words);
        if (meant) {
            return fmt::format("unexpected '{}'; {}", words.front(), *meant);
        }
    }
    return std::nullopt;
}

std::string parse_message(const Program& program, const CLI::App& app, const CLI::ParseError& error,
                          int argc, char** argv) {
    const std::vector<CLI::App*> chosen = app.get_subcommands();
    if (chosen.empty()) {
        const bool has_word = argc > 1 && argv[1][0] != '-';
        return has_word || argc < 2 ? unknown_command(program, app, has_word ? argv[1] : "")
                                    : unknown_option(app, 1, argc, argv).value_or(error.what());
    }
    const CLI::App& command = *chosen.front();
    if (const auto unknown = unknown_option(command, 2, argc, argv)) {
        return *unknown;
    }
    if (const auto stray = stray_word(command, argc, argv)) {
        return *stray;
    }
    const std::string text = error.what();
    switch (kind_of(error)) {
        case CLI::ExitCodes::RequiredError: {
            const std::string missing = missing_options(command);
            return missing.empty() ? text : missing;
        }
        case CLI::ExitCodes::ExtrasError: {
            const std::vector<std::string> extras = command.remaining();
            return extras.empty() ? text : fmt::format("unexpected '{}'", extras.front());
        }
        case CLI::ExitCodes::ExcludesError:
            return with_words(text, " excludes ", " and ", " cannot be combined");
        case CLI::ExitCodes::RequiresError:
            return with_words(text, " requires ", " needs ", "");
        case CLI::ExitCodes::ArgumentMismatch:
            return count_of_values(command, text);
        default:
            return text;
    }
}

}  // namespace isonest::detail::cli
