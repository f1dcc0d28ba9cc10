#include "tools/cli/command.h"

#include <fmt/format.h>

#include "tools/cli/options/units.h"
#include "tools/cli/terminal/help_format.h"

namespace isonest::detail::cli {

namespace {

/// A command line that is too long for a line of the help goes on in the next one.
std::string continued(const std::string& example) {
    constexpr std::size_t kIndent = 6;
    std::string text = wrapped(example, 4, kIndent);
    for (std::size_t at = text.find('\n'); at != std::string::npos; at = text.find('\n', at + 3)) {
        text.insert(at, " \\");
    }
    return text;
}

}  // namespace

Json unit_json(std::optional<LengthUnit> unit) {
    return unit ? Json(symbol_of(*unit)) : Json();
}

Json frame_json(AnatomicalFrame frame) {
    return frame == AnatomicalFrame::unknown ? Json() : Json(name_of(frame));
}

CLI::App* add_command(CLI::App& app, Invocation& chosen, const std::string& name,
                      const Description& description) {
    CLI::App* const command =
        app.add_subcommand(name, description.summary + "\n\n" + description.details + "\n");
    command->add_flag("--json", chosen.json, "print one JSON object instead of text");
    command->add_flag("-q,--quiet", chosen.quiet, "no progress, and no text where all is well");
    const std::string& examples = description.examples;
    std::string footer = "Examples:";
    std::size_t begin = 0;
    while (begin < examples.size()) {
        const std::size_t end = std::min(examples.find('\n', begin), examples.size());
        footer += "\n  " + continued(examples.substr(begin, end - begin));
        begin = end + 1;
    }
    command->footer(footer);
    return command;
}

CLI::Option* add_parsed(CLI::App* command, const std::string& name,
                        const std::function<void(const std::string&)>& parse,
                        const std::string& description, const std::string& form) {
    return command->add_option_function<std::string>(name, parse, description)->type_name(form);
}

void add_memory(CLI::App* command, std::uint64_t& memory) {
    add_parsed(
        command, "--memory",
        [&memory](const std::string& text) { memory = parse_bytes("--memory", text); },
        fmt::format("heap to stay within [{}M]", memory >> 20U), "SIZE");
}

void add_threads(CLI::App* command, int& threads) {
    add_parsed(
        command, "--threads",
        [&threads](const std::string& text) {
            constexpr int kMost = 4096;
            threads = static_cast<int>(parse_integer("--threads", text, 0, kMost));
        },
        "threads to use; 0 = one per core [0]", "N");
}

}  // namespace isonest::detail::cli
