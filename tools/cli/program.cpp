#include "tools/cli/program.h"

#include <fmt/format.h>
#include <malloc.h>
#include <sys/resource.h>

#include <algorithm>
#include <cstdio>
#include <filesystem>
#include <memory>
#include <new>
#include <optional>
#include <sstream>
#include <string>
#include <string_view>
#include <system_error>
#include <vector>

#include <isonest/open_volume.h>
#include <isonest/version.h>

#include "store/container/format.h"
#include "store/container/writer.h"
#include "store/ranks/communicator.h"
#include "store/remote/open_location.h"
#include "tools/cli/mistyped.h"
#include "tools/cli/options/extract_options.h"
#include "tools/cli/options/option_table.h"
#include "tools/cli/options/units.h"
#include "tools/cli/terminal/interrupt.h"
#include "tools/cli/terminal/terminal_progress.h"
#include "tools/cli/terminal/terminal_text.h"

namespace isonest::detail::cli {
namespace {

/// Breaks an example command line that is too long for a line of the help.
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
    command->add_flag("--json", chosen.json);
    command->add_flag("-q,--quiet", chosen.quiet);
    // Only for the chosen command, before its words are parsed.
    command->preparse_callback([command](std::size_t /*words*/) { describe_options(*command); });
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
                        const std::string& standard) {
    return command->add_option_function<std::string>(name, parse, standard);
}

void add_memory(CLI::App* command, std::uint64_t& memory) {
    add_parsed(
        command, "--memory",
        [&memory](const std::string& text) { memory = parse_bytes("--memory", text); },
        fmt::format("{}M", memory >> 20U));
}

void add_threads(CLI::App* command, int& threads) {
    add_parsed(command, "--threads", [&threads](const std::string& text) {
        constexpr int kMax = 4096;
        threads = static_cast<int>(parse_integer("--threads", text, 0, kMax));
    });
}

namespace {

constexpr int kInternal = 1;

/// Serializes JSON. Messages may quote names and contents of files, so invalid UTF-8 is replaced,
/// and characters that control a terminal are escaped.
std::string dump(const Json& json, int indent = 2) {
    const std::string text = json.dump(indent, ' ', false, Json::error_handler_t::replace);
    return shown_lines(text) == text ? text
                                     : json.dump(indent, ' ', true, Json::error_handler_t::replace);
}

Outcome failed(const Error& error, const HasOption& has) {
    return {static_cast<int>(error.kind()), message_of(error, has), json_of(error, has)};
}

/// Runs `work` and turns exceptions into an Outcome. `has`: whether the chosen command has an
/// option.
template <class Work>
Outcome guarded(const HasOption& has, const Work& work) {
    try {
        return work();
    } catch (const Error& e) {
        return failed(e, has);
    } catch (const std::bad_alloc&) {
        return failed(Error(ErrorKind::limit, "out of memory",
                            {{RemedyKind::less_memory}, {RemedyKind::fewer_threads}}),
                      has);
    } catch (const std::filesystem::filesystem_error& e) {
        return failed(Error(ErrorKind::io, {e.path1().string()}, e.code().message()), has);
    } catch (const std::system_error& e) {
        const std::error_code& code = e.code();
        const bool lacks = code == std::errc::resource_unavailable_try_again ||
                           code == std::errc::not_enough_memory;  // a thread could not be started
        return failed(Error(lacks ? ErrorKind::limit : ErrorKind::io,
                            fmt::format("the system refused a resource: {}", e.what())),
                      has);
    } catch (const std::exception& e) {
        const std::string message = fmt::format("internal error, please report it: {}", e.what());
        return {kInternal,
                message,
                {{"kind", "internal"},
                 {"message", message},
                 {"file", ""},
                 {"inside", ""},
                 {"remedies", Json::array()}}};
    }
}

/// Version, the formats that this build can read, and the packages that the others need.
std::string version_text(const Program& program) {
    std::string text = fmt::format("{} {} (store format {}.{})\nreads:", program.name,
                                   ISONEST_VERSION, kFormatMajor, kFormatMinor);
    std::string missing;
    for (const auto& [name, package] : program.missing) {
        missing += fmt::format("\n  {:<16} (needs {})", name, package);
    }
    for (const InputFormat& format : input_formats()) {
        std::string& list = format.package.empty() ? text : missing;
        list += fmt::format("\n  {:<16} {}", format.name, format.extensions);
        list += format.package.empty() ? "" : fmt::format(" (needs {})", format.package);
    }
    return missing.empty() ? text : text + "\nnot in this build:" + missing;
}

void declare(const Program& program, CLI::App& app, Invocation& chosen) {
    app.set_version_flag("--version", version_text(program));
    app.require_subcommand(1);
    app.formatter(std::make_shared<HelpFormat>());
    app.footer(program.footer);
    program.declare(app, chosen);
}

/// Removes credentials from those URLs in `text` that are on the command line.
std::string without_credentials(std::string text, int argc, char** argv) {
    for (int i = 1; i < argc; ++i) {
        const std::string argument(argv[i]);
        const std::string shown = shown_location(argument);
        for (std::size_t at = 0; shown != argument; at += shown.size()) {
            at = text.find(argument, at);
            if (at == std::string::npos) {
                break;
            }
            text.replace(at, argument.size(), shown);
        }
    }
    return text;
}

/// Progress of one rank: shown at rank 0 only, and cancelled as soon as another rank fails.
class RunProgress : public TerminalProgress {
  public:
    RunProgress(bool show, const std::vector<ProgressStage>& stages, Communicator* ranks)
        : TerminalProgress(show && (ranks == nullptr || ranks->rank() == 0), stages),
          ranks_(ranks) {}
    [[nodiscard]] bool cancelled() const override {
        if (ranks_ != nullptr) {
            ranks_->check();
        }
        return TerminalProgress::cancelled();
    }

  private:
    Communicator* ranks_;
};

/// Adds the figures of each rank, including its messages, to the result. Collective.
void gather_ranks(Communicator& ranks, Result& result) {
    const RankTraffic traffic = ranks.traffic();
    Json own{{"rank", ranks.rank()},
             {"host", ranks.host()},
             {"messages_sent", traffic.messages_sent},
             {"bytes_sent", traffic.bytes_sent},
             {"messages_received", traffic.messages_received},
             {"bytes_received", traffic.bytes_received},
             {"seconds_in_messages", traffic.seconds}};
    own.update(result.rank);
    for (const std::string& text : ranks.gather(dump(own, -1))) {
        result.json["ranks"].push_back(Json::parse(text));
    }
}

/// `notes`: added to the result's warning.
Outcome run(const Program& program, const Invocation& chosen, const std::string& notes) {
    Result result = [&] {
        RunProgress progress(can_draw() && !chosen.quiet && !chosen.json, chosen.stages,
                             program.ranks);
        return chosen.run(progress);
    }();
    if (program.ranks != nullptr) {
        program.ranks->ignore_stop(true);  // this rank has finished its work
        gather_ranks(*program.ranks, result);
    }
    result.warning += (notes.empty() || result.warning.empty() ? "" : "\n") + notes;
    if (!result.warning.empty()) {
        result.json["warning"] = result.warning;
    }
    Outcome outcome{result.exit_code};
    outcome.warning = std::move(result.warning);
    if (chosen.json) {
        outcome.text = dump(result.json) + "\n";
    } else if (!chosen.quiet || result.exit_code != 0) {
        outcome.text = shown_lines(result.text);
    }
    return outcome;
}

/// The options of the chosen command; without one, of all commands.
Json help_json(CLI::App& app) {
    const auto of_command = [](const CLI::App& command) {
        return Json{{"command", command.get_name()}, {"options", options_json(command)}};
    };
    if (const std::vector<CLI::App*> chosen = app.get_subcommands(); !chosen.empty()) {
        return of_command(*chosen.front());
    }
    Json commands = Json::array();
    for (CLI::App* const command : app.get_subcommands([](CLI::App* /*any*/) { return true; })) {
        describe_options(*command);
        commands.push_back(of_command(*command));
    }
    return {{"commands", commands}};
}

Outcome parse_and_run(const Program& program, CLI::App& app, const Invocation& chosen,
                      std::string& notes, int argc, char** argv) {
    std::optional<std::string> wrong;
    try {
        app.parse(argc, argv);
        wrong = stray_word(*app.get_subcommands().front(), argc, argv);
    } catch (const CLI::ParseError& e) {
        if (e.get_exit_code() == 0) {  // --help, --version
            if (e.get_name() == "CallForHelp" && asks_for_json(argc, argv)) {
                Outcome outcome;
                outcome.text = dump(help_json(app)) + "\n";
                return outcome;
            }
            std::ostringstream text;
            app.exit(e, text, text);
            Outcome outcome;
            outcome.text = text.str();
            return outcome;
        }
        wrong = parse_message(program, app, e, argc, argv);
    }
    if (wrong) {
        const std::vector<CLI::App*> command = app.get_subcommands();
        throw Error(ErrorKind::invalid_argument,
                    fmt::format("{}; see: {} {}{}--help", without_credentials(*wrong, argc, argv),
                                program.name, command.empty() ? "" : command.front()->get_name(),
                                command.empty() ? "" : " "));
    }
    watch_signals();
    notes = notes_on_names(*app.get_subcommands().front());
    return run(program, chosen, notes);
}

void tell_warning(const Program& program, const Outcome& outcome) {
    if (!outcome.warning.empty()) {
        std::fputs(
            fmt::format("{}: warning: {}\n", program.name, shown_lines(outcome.warning)).c_str(),
            stderr);
    }
}

}  // namespace

bool asks_for_json(int argc, char** argv) {
    return std::any_of(argv, argv + argc,
                       [](const char* argument) { return std::string_view(argument) == "--json"; });
}

Outcome run_program(const Program& program, int argc, char** argv) {
    CLI::App app(program.summary, program.name);
    const HasOption has = [&app](const std::string& option) {
        const std::vector<CLI::App*> command = app.get_subcommands();
        return !command.empty() && command.front()->get_option_no_throw(option) != nullptr;
    };
    std::string notes;
    Outcome outcome = guarded(has, [&] {
        Invocation chosen;
        chosen.ranks = program.ranks;
        declare(program, app, chosen);
        return parse_and_run(program, app, chosen, notes, argc, argv);
    });
    if (!outcome.message.empty()) {
        outcome.warning = notes;
    }
    return outcome;
}

int tell(const Program& program, const Outcome& outcome, bool json) {
    if (!outcome.message.empty()) {
        tell_warning(program, outcome);
        std::fputs(
            fmt::format("{}: error: {}\n", program.name, shown_lines(outcome.message)).c_str(),
            stderr);
        if (json) {
            std::fputs((dump({{"error", outcome.error}}) + "\n").c_str(), stdout);
            std::fflush(stdout);
        }
        return outcome.exit_code;
    }
    let_a_closed_pipe_end_the_program();
    tell_warning(program, outcome);
    if (std::fputs(outcome.text.c_str(), stdout) == EOF || std::fflush(stdout) != 0) {
        return tell(program,
                    failed(Error(ErrorKind::io, "cannot write to standard output"),
                           [](const std::string& /*option*/) { return false; }),
                    json);
    }
    return outcome.exit_code;
}

void prepare_process() {
    leave_hdf5_alone_at_exit();
    // Blocks and chunks of a few MB are allocated and freed constantly; with the default threshold,
    // the kernel would map their pages anew each time, which costs more than the work on them.
    ::mallopt(M_MMAP_THRESHOLD, 32 << 20);
    ::mallopt(M_TRIM_THRESHOLD, 512 << 20);
    // The arena of a thread takes 64 MiB of address space, and twice that while it is created. If
    // the address space is limited, all threads share one arena; otherwise the last threads could
    // not be started.
    constexpr rlim_t kLittle = rlim_t{16} << 30U;
    rlimit space{};
    if (::getrlimit(RLIMIT_AS, &space) == 0 && space.rlim_cur < kLittle) {
        ::mallopt(M_ARENA_MAX, 1);
    }
}

}  // namespace isonest::detail::cli
