// The program isonest: all commands in a single process.
#include <string>
#include <vector>

#include "tools/cli/program.h"
#include "tools/publish/site.h"
#if ISONEST_WITH_VIEW
#include "tools/view/page_files.h"
#endif

namespace isonest::detail::cli {
namespace {

/// The files of the page of a published site.
std::vector<publish::PageFile> site_page_files() {
    std::vector<publish::PageFile> files;
#if ISONEST_WITH_VIEW
    for (const view::NamedPageFile& file : view::page_files()) {
        files.push_back({file.path.substr(1), file.file.bytes});
    }
#endif
    return files;
}

void declare(CLI::App& app, Invocation& chosen) {
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
    add_publish(app, chosen, site_page_files());
}

std::string why_missing([[maybe_unused]] const std::string& command) {
#if !ISONEST_WITH_VIEW
    if (command == "view") {
        return "this build has no viewer; building it needs libboost-dev, libmeshoptimizer-dev, "
               "nodejs and npm";
    }
#endif
    return {};
}

Program whole_program() {
    return {
        "isonest",
        "isonest: isosurfaces with a guaranteed error from volumes of any size.\n"
        "A volume is preprocessed once into a store, from which surfaces of any isovalue, "
        "error\nand region are then extracted, reading only the data that they need.\n",

        "Start here:\n"
        "  isonest make-volume bucky --size 129 -o bucky.h5\n"
        "  isonest preprocess bucky.h5 -o bucky.isonest\n"
        "  isonest extract bucky.isonest --iso 0.5 --error 0.01 -o bucky.ply\n"
        "  isonest picture bucky.ply -o bucky.png\n"
        "`isonest COMMAND --help` explains a command and ends with examples.\n\n"
        "Exit codes: 0 done, 1 internal error, 2 invalid request, 3 not found,\n4 corrupt data, "
        "5 unsupported, 6 input/output failed, 7 a limit or the memory is\ntoo small, 130 "
        "interrupted. An output file appears only when it is complete.\nMeshes, pictures and "
        "plots replace an existing file; stores and volumes, which\ntake longer to make, only "
        "with --force. Inputs of the command, links, devices,\nFIFOs and sockets are never "
        "replaced; a replaced file keeps its permissions.",
        declare,
        why_missing,
        nullptr,
        publish::has_library(site_page_files()) ? std::vector<std::pair<std::string, std::string>>{}
                                                : std::vector<std::pair<std::string, std::string>>{
                                                      {"writing sites (publish)", kPublishNeeds}}};
}

}  // namespace
}  // namespace isonest::detail::cli

int main(int argc, char** argv) {
    using namespace isonest::detail::cli;
    prepare_process();
    const Program program = whole_program();
    return tell(program, run_program(program, argc, argv), asks_for_json(argc, argv));
}
