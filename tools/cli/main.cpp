// The command line: parses, runs one command, turns errors into messages and exit codes.
#include <fmt/format.h>
#include <malloc.h>

#include <algorithm>
#include <cstdio>
#include <memory>
#include <new>
#include <sstream>

#include <isonest/error.h>
#include <isonest/open_volume.h>
#include <isonest/version.h>

#include "store/container/format.h"
#include "store/container/writer.h"
#include "tools/cli/command.h"
#include "tools/cli/terminal/help_format.h"
#include "tools/cli/terminal/interrupt.h"
#include "tools/cli/terminal/remedies.h"
#include "tools/cli/terminal/suggestions.h"
#include "tools/cli/terminal/terminal_progress.h"

namespace isonest::detail::cli {
namespace {

constexpr int kInternal = 1;

/// The message may quote file names and file contents: whatever is not UTF-8 is replaced.
std::string dump(const Json& json) {
    return json.dump(2, ' ', false, Json::error_handler_t::replace) + "\n";
}

int report(int exit_code, const std::string& message, const Json& error, bool json) {
    std::fputs(fmt::format("isonest: error: {}\n", message).c_str(), stderr);
    if (json) {
        std::fputs(dump({{"error", error}}).c_str(), stdout);
        std::fflush(stdout);
    }
    return exit_code;
}

int report(const Error& error, const HasOption& has, bool json) {
    return report(static_cast<int>(error.kind()), message_of(error, has), json_of(error, has),
                  json);
}

void print(const std::string& text) {
    if (std::fputs(text.c_str(), stdout) == EOF || std::fflush(stdout) != 0) {
        throw Error(ErrorKind::io, "cannot write to standard output");
    }
}

/// Runs `work`, which gives an exit code; `has` tells the options of the command that was chosen.
template <class Work>
int guarded(bool json, const HasOption& has, const Work& work) {
    try {
        return work();
    } catch (const Error& e) {
        return report(e, has, json);
    } catch (const std::bad_alloc&) {
        return report(Error(ErrorKind::limit, "out of memory",
                            {{RemedyKind::less_memory}, {RemedyKind::fewer_threads}}),
                      has, json);
    } catch (const std::exception& e) {
        const std::string message = fmt::format("internal error, please report it: {}", e.what());
        return report(kInternal, message,
                      {{"kind", "internal"},
                       {"message", message},
                       {"file", ""},
                       {"inside", ""},
                       {"remedies", Json::array()}},
                      json);
    }
}

/// With the formats that this build reads, and what the others need.
std::string version_text() {
    std::string text = fmt::format("isonest {} (store format {}.{})\nreads:", ISONEST_VERSION,
                                   kFormatMajor, kFormatMinor);
    std::string missing;
    for (const InputFormat& format : input_formats()) {
        std::string& list = format.package.empty() ? text : missing;
        list += fmt::format("\n  {:<16} {}", format.name, format.extensions);
        list += format.package.empty() ? "" : fmt::format(" (needs {})", format.package);
    }
    return missing.empty() ? text : text + "\nnot in this build:" + missing;
}

void declare(CLI::App& app, Invocation& chosen) {
    app.set_version_flag("--version", version_text);
    app.require_subcommand(1);
    app.formatter(std::make_shared<HelpFormat>());
    app.footer(
        "Start here:\n"
        "  isonest make-volume bucky --size 129 -o bucky.h5\n"
        "  isonest preprocess bucky.h5 -o bucky.isonest\n"
        "  isonest extract bucky.isonest --iso 0.5 --error 0.01 -o bucky.ply\n"
        "  isonest picture bucky.ply -o bucky.png\n"
        "`isonest COMMAND --help` explains a command and ends with examples.\n\n"
        "Exit codes: 0 done, 1 internal error, 2 the request makes no sense, 3 not found,\n"
        "4 corrupt data, 5 unsupported, 6 input/output failed, 7 a limit or the memory is\n"
        "too small, 130 interrupted. No output file is left behind unless it is whole.\n"
        "Meshes, pictures and plots replace an existing file of their name; stores and\n"
        "volumes, which take longer to make, only with --force. Never replaced are files\n"
        "that the command reads, links, devices, FIFOs and sockets; permissions stay.");
    add_preprocess(app, chosen);
    add_extract(app, chosen);
    add_slice(app, chosen);
    add_study(app, chosen);
    add_smooth(app, chosen);
    add_info(app, chosen);
    add_export(app, chosen);
    add_check(app, chosen);
    add_make_volume(app, chosen);
    add_picture(app, chosen);
#if ISONEST_WITH_VIEW
    add_view(app, chosen);
#endif
}

int run(const Invocation& chosen) {
    Result result = [&] {
        TerminalProgress progress(can_draw() && !chosen.quiet && !chosen.json, chosen.stages);
        return chosen.run(progress);
    }();
    let_a_closed_pipe_end_the_program();
    if (!result.warning.empty()) {
        std::fputs(fmt::format("isonest: warning: {}\n", result.warning).c_str(), stderr);
        result.json["warning"] = result.warning;
    }
    if (chosen.json) {
        print(dump(result.json));
    } else if (!chosen.quiet || result.exit_code != 0) {
        print(result.text);
    }
    return result.exit_code;
}

/// What is wrong with the first name on the command line that nobody knows.
std::optional<std::string> mistyped(const CLI::App& app, int argc, char** argv) {
    const std::vector<CLI::App*> chosen = app.get_subcommands();
    if (chosen.empty()) {
        if (argc < 2 || argv[1][0] == '-') {
            return std::nullopt;
        }
#if !ISONEST_WITH_VIEW
        if (std::string_view(argv[1]) == "view") {
            return "this build has no viewer: it needs libboost-dev, libmeshoptimizer-dev, nodejs "
                   "and "
                   "npm when it is built";
        }
#endif
        std::vector<std::string> names;
        for (const CLI::App* const command :
             app.get_subcommands([](const CLI::App* /*any*/) { return true; })) {
            names.push_back(command->get_name());
        }
        const std::optional<std::string> meant = nearest_name(argv[1], names);
        return fmt::format("there is no command '{}'{}", argv[1],
                           meant ? fmt::format("; did you mean {}?", *meant) : "");
    }
    const CLI::App& command = *chosen.front();
    std::vector<std::string> names;
    for (const CLI::Option* const option :
         command.get_options([](const CLI::Option* /*any*/) { return true; })) {
        for (const std::string& name : option->get_lnames()) {
            names.push_back("--" + name);
        }
    }
    for (int i = 2; i < argc; ++i) {
        const std::string argument(argv[i]);
        if (argument == "--") {
            break;
        }
        const std::string name = argument.substr(0, argument.find('='));
        if (!name.starts_with("--") || std::find(names.begin(), names.end(), name) != names.end()) {
            continue;
        }
        const std::optional<std::string> meant = nearest_name(name, names);
        return fmt::format("there is no option {}{}", name,
                           meant ? fmt::format("; did you mean {}?", *meant) : "");
    }
    return std::nullopt;
}

int parse_and_run(CLI::App& app, const Invocation& chosen, int argc, char** argv) {
    try {
        app.parse(argc, argv);
    } catch (const CLI::ParseError& e) {
        if (e.get_exit_code() == 0) {
            return app.exit(e);  // --help, --version
        }
        const std::vector<CLI::App*> command = app.get_subcommands();
        const std::optional<std::string> typo = mistyped(app, argc, argv);
        throw Error(ErrorKind::invalid_argument,
                    fmt::format("{}; see: isonest {}{}--help", typo.value_or(e.what()),
                                command.empty() ? "" : command.front()->get_name(),
                                command.empty() ? "" : " "));
    }
    watch_signals();
    return run(chosen);
}

int main_guarded(int argc, char** argv) {
    const bool json = std::any_of(argv, argv + argc, [](const char* argument) {
        return std::string_view(argument) == "--json";
    });
    CLI::App app(
        "isonest: isosurfaces with a guaranteed error from volumes of any size.\n"
        "A volume is preprocessed once into a store; any isovalue, error and region is then\n"
        "extracted from it without reading more than it needs.\n",
        "isonest");
    const HasOption has = [&app](const std::string& option) {
        const std::vector<CLI::App*> command = app.get_subcommands();
        return !command.empty() && command.front()->get_option_no_throw(option) != nullptr;
    };
    return guarded(json, has, [&] {
        Invocation chosen;
        declare(app, chosen);
        return parse_and_run(app, chosen, argc, argv);
    });
}

}  // namespace
}  // namespace isonest::detail::cli

int main(int argc, char** argv) {
    isonest::detail::leave_hdf5_alone_at_exit();
    // Blocks and chunks of a few MB come and go all the time: fetching their pages from the kernel
    // anew each time costs more than the work on them.
    ::mallopt(M_MMAP_THRESHOLD, 32 << 20);
    ::mallopt(M_TRIM_THRESHOLD, 512 << 20);
    return isonest::detail::cli::main_guarded(argc, argv);
}
