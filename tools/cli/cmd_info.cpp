// isonest info: what a store holds.
#include <fmt/format.h>
#include <fmt/ranges.h>

#include <memory>

#include "query/extract/info.h"
#include "tools/cli/command.h"
#include "tools/cli/units.h"

namespace isonest::detail::cli {
namespace {

double ratio(const ArrayReport& r) {
    return r.stored_bytes > 0
               ? static_cast<double>(r.raw_bytes) / static_cast<double>(r.stored_bytes)
               : 0;
}

/// JSON has no infinity: the range of an array without any finite value is null.
Json number(double value) {
    return std::isfinite(value) ? Json(value) : Json();
}

Json to_json(const Int3& v) {
    return Json{v.x, v.y, v.z};
}

Result run(const std::string& path) {
    const StoreReader store(path);
    const StoreHeader& h = store.layout().header();
    const std::vector<ArrayReport> arrays = describe_arrays(store);
    Result result;
    Json fields = Json::array();
    for (const Field field : h.fields) {
        fields.push_back(name_of(field));
    }
    const bool any = store.min_value() <= store.max_value();
    result.json = {{"store", path},
                   {"format", store.version().text()},
                   {"nodes", to_json(h.nodes)},
                   {"type", name_of(h.type)},
                   {"spacing", h.spacing},
                   {"origin", h.origin},
                   {"min_value", any ? number(store.min_value()) : Json()},
                   {"max_value", any ? number(store.max_value()) : Json()},
                   {"has_missing", store.has_missing()},
                   {"levels", store.layout().lattice().top() + 1},
                   {"fields", fields},
                   {"unknown_fields", h.unknown_fields},
                   {"exact", h.exact},
                   {"chunk", h.chunk},
                   {"compression", h.compression},
                   {"chunks", store.layout().rows()},
                   {"cube_range_bytes", cube_range_bytes(store)},
                   {"file_bytes", store.file_bytes()},
                   {"arrays", Json::array()}};
    result.text = fmt::format(
        "{}: {} x {} x {} {}, {} levels, {}\n"
        "spacing {:g} {:g} {:g}, origin {:g} {:g} {:g}\n"
        "values {}{}\n"
        "indicators {} ({}), chunks of {}^3 nodes, zstd level {}\n"
        "ranges of cubes: {}\n\n"
        "{:>5} {:<14} {:>18} {:>8} {:>10} {:>7}  {}\n",
        path, h.nodes.x, h.nodes.y, h.nodes.z, name_of(h.type), store.layout().lattice().top() + 1,
        human_bytes(static_cast<double>(store.file_bytes())), h.spacing[0], h.spacing[1],
        h.spacing[2], h.origin[0], h.origin[1], h.origin[2],
        human_range(store.min_value(), store.max_value()),
        store.has_missing() ? ", some missing" : "",
        h.fields.empty() ? std::string("none") : list_names(h.fields),
        h.exact ? "32-bit" : "16-bit, rounded up", h.chunk, h.compression,
        human_bytes(static_cast<double>(cube_range_bytes(store))), "level", "field", "nodes",
        "chunks", "stored", "ratio", "range");
    if (!h.unknown_fields.empty()) {
        result.warning = fmt::format("{}: of the newer format version {}; not read: {}", path,
                                     store.version().text(), fmt::join(h.unknown_fields, ", "));
    }
    for (const ArrayReport& r : arrays) {
        result.json["arrays"].push_back({{"level", r.level},
                                         {"field", name_of(r.field)},
                                         {"nodes", to_json(r.nodes)},
                                         {"chunk", to_json(r.chunk)},
                                         {"chunks", r.chunks},
                                         {"raw_bytes", r.raw_bytes},
                                         {"stored_bytes", r.stored_bytes},
                                         {"ratio", ratio(r)},
                                         {"min", number(r.min)},
                                         {"max", number(r.max)},
                                         {"alias", r.alias}});
        result.text +=
            fmt::format("{:>5} {:<14} {:>18} {:>8} {:>10} {:>7}  {}\n", r.level, name_of(r.field),
                        fmt::format("{}x{}x{}", r.nodes.x, r.nodes.y, r.nodes.z), r.chunks,
                        r.alias ? "shared" : human_bytes(static_cast<double>(r.stored_bytes)),
                        r.alias ? "" : fmt::format("{:.2f}", ratio(r)), human_range(r.min, r.max));
    }
    return result;
}

}  // namespace

void add_info(CLI::App& app, Invocation& chosen) {
    const auto path = std::make_shared<std::string>();
    CLI::App* const c =
        add_command(app, chosen, "info",
                    {"Say what a store holds: size, type, range, levels, fields, compression",
                     "Reads the header and the chunk table only.",
                     "isonest info scan.isonest\n"
                     "isonest info scan.isonest --json"});
    c->add_option("STORE", *path, "made by isonest preprocess")->required();
    c->callback(
        [path, &chosen] { chosen.run = [path](Progress& /*progress*/) { return run(*path); }; });
}

}  // namespace isonest::detail::cli
