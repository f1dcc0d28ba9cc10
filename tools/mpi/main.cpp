// The program isonest-mpi: the commands that gain from several machines, run by ranks that MPI
// starts.
#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <string>
#include <vector>

#include <isonest/version.h>

#include "store/ranks/agreement.h"
#include "tools/cli/program.h"
#include "tools/cli/terminal/interrupt.h"
#include "tools/mpi/mpi_communicator.h"

namespace isonest::detail::cli {
namespace {

void declare(CLI::App& app, Invocation& chosen) {
    add_preprocess(app, chosen);
    add_extract(app, chosen);
    add_check(app, chosen);
}

/// Names commands of isonest that run in one process.
std::string why_missing(const std::string& command) {
    constexpr std::array kAlone{"slice",  "study",       "smooth",  "info",
                                "export", "make-volume", "picture", "view"};
    return std::find(kAlone.begin(), kAlone.end(), command) == kAlone.end()
               ? ""
               : fmt::format("{0} runs in one process only: use isonest {0}", command);
}

Program whole_program(Communicator& ranks) {
    return {
        "isonest-mpi",
        "isonest-mpi: isonest on several machines, or as several processes on one.\n"
        "Every rank is a process with its own threads and its own --memory; files have the "
        "same\nbytes as those of isonest.\n",
        "Start here:\n"
        "  mpirun -n 4 isonest-mpi preprocess scan.h5 -o scan.isonest --memory 2G\n"
        "  mpirun -n 4 isonest-mpi extract scan.isonest --iso 300 -o scan.ply\n"
        "`isonest-mpi COMMAND --help` explains a command; without mpirun there is one rank.\nAll "
        "ranks need access to the input, and to the output's folder, under the same names.\n\nExit "
        "codes are those of isonest. If one rank fails, all end with its message.",
        declare,
        why_missing,
        &ranks};
}

/// Ranks of different versions would write different bytes. Throws Error{cancelled} if another rank
/// has failed.
Outcome of_one_version(Communicator& ranks) {
    const std::string others = who_differs(ranks, ISONEST_VERSION, ISONEST_VERSION);
    if (!others.empty()) {
        Outcome outcome{static_cast<int>(ErrorKind::invalid_argument)};
        outcome.message = fmt::format(
            "rank 0 is isonest-mpi {}, and others are of another version, ranks {}; install one "
            "version everywhere",
            ISONEST_VERSION, others);
        outcome.error = {{"kind", "invalid_argument"}, {"message", outcome.message}};
        return outcome;
    }
    return {};
}

Outcome run_ranks(const Program& program, MpiCommunicator& ranks, int argc, char** argv) {
    Outcome outcome;
    try {
        outcome = of_one_version(ranks);
        if (outcome.exit_code == 0) {
            outcome = run_program(program, argc, argv);
        }
    } catch (const Error& error) {
        outcome = Outcome{static_cast<int>(error.kind())};
        outcome.message = error.what();
    }
    // An error that all ranks find alike is reported by rank 0, without its number and host.
    constexpr std::array kAlike{ErrorKind::invalid_argument, ErrorKind::not_found};
    const bool is_alike = std::any_of(kAlike.begin(), kAlike.end(), [&](ErrorKind kind) {
        return outcome.exit_code == static_cast<int>(kind);
    });
    if (!outcome.message.empty() && ranks.size() > 1 && !(ranks.rank() == 0 && is_alike)) {
        outcome.message =
            fmt::format("rank {} on {}: {}", ranks.rank(), ranks.host(), outcome.message);
    }
    MpiCommunicator::Ending own{outcome.exit_code, outcome.message,
                                outcome.error.dump(-1, ' ', false, Json::error_handler_t::replace)};
    own.is_consequence =
        outcome.exit_code == static_cast<int>(ErrorKind::cancelled) && !interrupted();
    int who = 0;
    const MpiCommunicator::Ending verdict = ranks.agree(own, who);
    if (verdict.has_failed()) {
        outcome = {verdict.exit_code, verdict.message,
                   Json::parse(verdict.details, nullptr, false)};
        outcome.error["rank"] = who;
    }
    outcome.exit_code = verdict.exit_code;
    return outcome;
}

}  // namespace
}  // namespace isonest::detail::cli

int main(int argc, char** argv) {
    using namespace isonest::detail;
    using namespace isonest::detail::cli;
    prepare_process();
    MpiCommunicator ranks(argc, argv, interrupted);
    const Program program = whole_program(ranks);
    const Outcome outcome = run_ranks(program, ranks, argc, argv);
    return ranks.rank() == 0 ? tell(program, outcome, asks_for_json(argc, argv))
                             : outcome.exit_code;
}
