// info, export, check: commands that look into a store.
#include <fmt/format.h>

#include "preprocess/volume_source.h"
#include "query/check.h"
#include "query/export.h"
#include "query/info.h"
#include "store/error.h"
#include "tools/command.h"

namespace isonest::tools {
namespace {

void run_info(const std::string& path, const Common& common) {
    const StoreReader store(path);
    const StoreHeader& h = store.layout().header();
    const auto arrays = describe_arrays(store);
    nlohmann::json list = nlohmann::json::array();
    for (const ArrayReport& a : arrays) {
        list.push_back({{"level", a.level},
                        {"field", name_of(a.field)},
                        {"nodes", {a.nodes.x, a.nodes.y, a.nodes.z}},
                        {"chunk", {a.chunk.x, a.chunk.y, a.chunk.z}},
                        {"chunks", a.chunks},
                        {"raw_bytes", a.raw_bytes},
                        {"stored_bytes", a.stored_bytes},
                        {"min", a.min},
                        {"max", a.max},
                        {"linked_to_linf_bar", a.alias}});
    }
    if (common.json) {
        return print({{"store", path},
                      {"nodes", {h.nodes.x, h.nodes.y, h.nodes.z}},
                      {"type", name_of(h.type)},
                      {"spacing", h.spacing},
                      {"origin", h.origin},
                      {"range", {store.min_value(), store.max_value()}},
                      {"has_missing", store.has_missing()},
                      {"levels", store.layout().lattice().top() + 1},
                      {"fields",
                       [&] {
                           std::vector<std::string> names;
                           for (const Field f : h.fields) {
                               names.emplace_back(name_of(f));
                           }
                           return names;
                       }()},
                      {"chunk", h.chunk},
                      {"exact", h.exact},
                      {"compression", h.compression},
                      {"file_bytes", store.file_bytes()},
                      {"chunks", store.layout().rows()},
                      {"arrays", list}});
    }
    fmt::print("{}: {} x {} x {} nodes of {}, values {} to {}{}\n", path, h.nodes.x, h.nodes.y,
               h.nodes.z, name_of(h.type), store.min_value(), store.max_value(),
               store.has_missing() ? ", with missing data" : "");
    fmt::print("spacing {}, origin {}\n", fmt::join(h.spacing, " "), fmt::join(h.origin, " "));
    fmt::print("{} levels, chunks of {}, indicators: {}{}, zstd level {}, {}\n\n",
               store.layout().lattice().top() + 1, h.chunk, list_names(h.fields),
               h.exact ? " (exact)" : "", h.compression, format_bytes(store.file_bytes()));
    fmt::print("level  field           nodes               chunks      stored   ratio  range\n");
    for (const ArrayReport& a : arrays) {
        if (a.alias) {
            fmt::print("{:5}  {:14}  the same array as linf_bar\n", a.level, name_of(a.field));
            continue;
        }
        fmt::print("{:5}  {:14}  {:18}  {:6}  {:>10}  {:6.1f}  {:.6g} to {:.6g}\n", a.level,
                   name_of(a.field), fmt::format("{} x {} x {}", a.nodes.x, a.nodes.y, a.nodes.z),
                   a.chunks, format_bytes(a.stored_bytes),
                   static_cast<double>(a.raw_bytes) / static_cast<double>(a.stored_bytes), a.min,
                   a.max);
    }
}

struct ExportArguments {
    std::string store;
    std::string output;
    std::string field = "values";
    ExportOptions options;
};

void run_export(ExportArguments& a, const Common& common) {
    const auto field = field_from_name(a.field);
    if (!field) {
        throw CLI::ValidationError("--field: there is no field '" + a.field +
                                   "'; there are: values, " + list_names(all_indicators()));
    }
    a.options.field = *field;
    const StoreReader store(a.store);
    {
        TerminalProgress progress(!common.json && !common.quiet);
        export_field(store, a.output, a.options, progress);
    }
    if (common.json) {
        print({{"output", a.output}, {"field", a.field}, {"level", a.options.level}});
    } else {
        fmt::print("{}: {} of level {}\n", a.output, a.field, a.options.level);
    }
}

struct CheckArguments {
    std::string store;
    std::string source;
    std::string dataset;
    std::string dims;
    std::string type;
    std::string endian = "little";
    std::uint64_t offset = 0;
    std::string memory = "512M";
    CheckOptions options;
};

void run_check(CheckArguments& a, const Common& common) {
    a.options.memory = parse_size(a.memory);
    const StoreReader store(a.store);
    std::unique_ptr<VolumeSource> source;
    if (!a.source.empty()) {
        SourceOptions s;
        s.dataset = a.dataset;
        s.offset = a.offset;
        s.big_endian = a.endian == "big";
        s.max_heap = a.options.memory / 4;
        if (!a.dims.empty()) {
            s.dims = parse_dims(a.dims, "--dims");
        }
        if (!a.type.empty()) {
            s.type = value_type_from_name(a.type);
        }
        source = open_volume(a.source, s);
        const StoreHeader& h = store.layout().header();
        if (source->nodes() != h.nodes || source->type() != h.type) {
            throw Error(
                ErrorKind::invalid_argument,
                fmt::format("{} has {} x {} x {} nodes of {}, the store {} x {} x {} of {}: "
                            "not its source",
                            source->name(), source->nodes().x, source->nodes().y, source->nodes().z,
                            name_of(source->type()), h.nodes.x, h.nodes.y, h.nodes.z,
                            name_of(h.type)));
        }
        a.options.source = [&](std::int64_t z, std::int64_t y0, std::int64_t ny, std::byte* out) {
            source->read(z, 1, y0, ny, out);
        };
    }
    CheckReport r;
    {
        TerminalProgress progress(!common.json && !common.quiet);
        r = check(store, a.options, progress);
    }
    if (common.json) {
        nlohmann::json findings = nlohmann::json::array();
        for (const Finding& f : r.findings) {
            findings.push_back({{"test", f.test},
                                {"field", f.field},
                                {"level", f.level},
                                {"chunk", {f.chunk.x, f.chunk.y, f.chunk.z}},
                                {"node", {f.node.x, f.node.y, f.node.z}},
                                {"message", f.message}});
        }
        print({{"store", a.store},
               {"ok", r.failures == 0},
               {"failures", r.failures},
               {"chunks", r.chunks},
               {"nodes_compared", r.nodes},
               {"cubes_checked", r.cubes},
               {"findings", findings}});
    } else {
        for (const Finding& f : r.findings) {
            fmt::print("{}: {} of level {}, chunk {} {} {}", f.test, f.field, f.level, f.chunk.x,
                       f.chunk.y, f.chunk.z);
            fmt::print("{}: {}\n",
                       f.node.x < 0 ? std::string()
                                    : fmt::format(", node {} {} {}", f.node.x, f.node.y, f.node.z),
                       f.message);
        }
        fmt::print("{}: {} ({} chunks, {} comparisons, {} cubes by brute force)\n", a.store,
                   r.failures == 0 ? "no fault found" : fmt::format("{} faults", r.failures),
                   r.chunks, r.nodes, r.cubes);
    }
    if (r.failures != 0) {
        throw CLI::RuntimeError(static_cast<int>(ErrorKind::corrupt));
    }
}

}  // namespace

void add_info(CLI::App& app, Common& common) {
    auto* const command = app.add_subcommand("info", "what a store holds");
    const auto store = std::make_shared<std::string>();
    command->add_option("STORE", *store)->required();
    add_common(*command, common);
    command->footer("Example:\n  isonest info scan.isonest --json");
    command->callback([store, &common] { run_info(*store, common); });
}

void add_export(CLI::App& app, Common& common) {
    auto* const command = app.add_subcommand("export", "a field of a store as a plain volume file");
    const auto a = std::make_shared<ExportArguments>();
    command->add_option("STORE", a->store)->required();
    command->add_option("-o,--output", a->output, "OUT.h5 (dataset data), OUT.nrrd or OUT.raw")
        ->required();
    command->add_option("--field", a->field, "values, " + list_names(all_indicators()))
        ->capture_default_str();
    command
        ->add_option("--level", a->options.level,
                     "values: the level; indicators: nodes of this level and coarser")
        ->check(CLI::Range(0, 62))
        ->capture_default_str();
    command->add_flag("--force", a->options.force, "replace an existing file");
    add_common(*command, common);
    command->footer(
        "Examples:\n"
        "  isonest export scan.isonest --field values --level 3 -o preview.nrrd\n"
        "  isonest export scan.isonest --field deviation_bar -o error.h5");
    command->callback([a, &common] { run_export(*a, common); });
}

void add_check(CLI::App& app, Common& common) {
    auto* const command = app.add_subcommand("check", "the chunked consistency tests of a store");
    const auto a = std::make_shared<CheckArguments>();
    command->add_option("STORE", a->store)->required();
    command->add_flag("--quick", a->options.quick, "only the table and the checksums");
    command->add_option("--source", a->source, "compare with the volume the store was made from");
    command->add_option("--dataset", a->dataset, "HDF5 source: the dataset");
    command->add_option("--dims", a->dims, "raw source: X,Y,Z");
    command->add_option("--type", a->type, "raw source: value type");
    command->add_option("--endian", a->endian, "raw source")
        ->check(CLI::IsMember({"little", "big"}));
    command->add_option("--offset", a->offset, "raw source: bytes before the data");
    command->add_option("--memory", a->memory, "most heap to use")->capture_default_str();
    command->add_option("--threads", a->options.threads, "0 = all cores")->capture_default_str();
    add_common(*command, common);
    command->footer(
        "Exit code 0 if nothing is wrong, 4 if something is.\n\n"
        "Examples:\n"
        "  isonest check scan.isonest --quick\n"
        "  isonest check scan.isonest --source scan.h5 --json");
    command->callback([a, &common] { run_check(*a, common); });
}

}  // namespace isonest::tools
