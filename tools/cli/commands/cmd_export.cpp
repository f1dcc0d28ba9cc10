// isonest export: writes a field of a store as a plain volume file.
#include <fmt/format.h>

#include <memory>
#include <string>
#include <variant>

#include <isonest/export_field.h>

#include "query/values/label_view.h"
#include "store/container/reader.h"
#include "tools/cli/options/extract_options.h"
#include "tools/cli/options/remote_options.h"
#include "tools/cli/options/units.h"
#include "tools/cli/program.h"
#include "tools/cli/terminal/interrupt.h"

namespace isonest::detail::cli {
namespace {

struct ExportArguments {
    std::string store;
    std::string output;
    ExportOptions options;
    RemoteArguments remote;
};

Result run(ExportArguments& a, Progress& progress) {
    const Store opened = open_required_store(a.store, a.remote, a.options.memory, progress);
    const Int3 nodes = export_field(opened, a.output, a.options, progress);
    const std::string name = name_of(a.options.field);
    const Field* const stored = std::get_if<Field>(&a.options.field);
    const std::string_view type = stored != nullptr && *stored == Field::values
                                      ? type_of_values(opened.reader().layout().header())
                                      : name_of(ValueType::f32);
    Result result;
    result.warning = leftovers_of(a.output);
    result.json = {{"output", a.output},
                   {"field", name},
                   {"level", a.options.level},
                   {"nodes", {nodes.x, nodes.y, nodes.z}},
                   {"type", type},
                   {"tolerance", opened.rounding().tolerance}};
    result.text =
        fmt::format("{}: {}, {} x {} x {} {}\n", a.output, name, nodes.x, nodes.y, nodes.z, type) +
        rounding_note(opened);
    add_fetched(opened, result);
    return result;
}

}  // namespace

void add_export(CLI::App& app, Invocation& chosen) {
    const auto a = std::make_shared<ExportArguments>();
    CLI::App* const c = add_command(
        app, chosen, "export",
        {"Write the values of a store, or an indicator, as a plain volume file",
         "The extension of FILE selects the format; an .h5 file has one dataset, 'data' [z,y,x]. "
         "Values have "
         "the "
         "type of the input (64-bit labels: int64). An indicator is float32 on the finest lattice, "
         "0 at the macro vertices.\n\nIndicators: " +
             list_names(node_indicators()) +
             "; computed in memory, at 20 bytes per node: lp:P, grad_lp:P, deviation_lp:P, "
             "deviation_grad_lp:P (P from 1 to inf), gradient, curvature, graph_curvature, "
             "deviation_graph, alone or with _bar or _plus.",
         "isonest export scan.isonest -o scan.nrrd\n"
         "isonest export scan.isonest --level 2 -o quarter.nrrd\n"
         "isonest export scan.isonest --field deviation_bar -o deviation.h5\n"
         "isonest export scan.isonest --field lp:3 -o eta3.nrrd"});
    ExportOptions& e = a->options;
    c->add_option("STORE", a->store)->required();
    add_parsed(c, "--field", [a](const std::string& text) {
        if (const auto computed = computed_field_from_name(text)) {
            a->options.field = *computed;
        } else {
            a->options.field = parse_field_or_values("--field", text);
        }
    });
    add_parsed(c, "--level", [&e](const std::string& text) {
        constexpr int kMax = 64;
        e.level = static_cast<int>(parse_integer("--level", text, 0, kMax));
    });
    c->add_option("-o,--output", a->output)->required();
    c->add_flag("--force", e.force);
    add_memory(c, e.memory);
    add_remote_options(c, a->remote);
    c->callback([a, &chosen] {
        chosen.run = [a](Progress& progress) {
            return run_beside_fetching(a->remote, {a->store}, [&] { return run(*a, progress); });
        };
    });
}

}  // namespace isonest::detail::cli
