#include "tools/cli/commands/vertex_values.h"

#include <fmt/format.h>

#include <algorithm>
#include <filesystem>
#include <system_error>
#include <utility>

#include <isonest/error.h>

#include "store/files/output_file.h"
#include "store/remote/open_location.h"
#include "tools/cli/options/remote_options.h"
#include "tools/cli/options/source_options.h"

namespace isonest::detail::cli {
namespace {

bool exists(const std::string& name) {
    std::error_code ignored;
    return std::filesystem::exists(name, ignored);
}

}  // namespace

InputArguments arguments_of_source(const std::string& source, const RemoteArguments& remote) {
    InputArguments a;
    a.remote = remote;
    a.input = {source};
    const std::size_t colon = source.rfind(':');
    if (!is_url(source) && !exists(source) && colon != std::string::npos &&
        exists(source.substr(0, colon))) {
        a.input = {source.substr(0, colon)};
        a.source.dataset = source.substr(colon + 1);
        a.source_option = ":" + a.source.dataset;
    }
    return a;
}

std::optional<NamedValues> parse_named_values(const std::string& text) {
    const std::size_t sign = text.find('=');
    const bool is_name =
        sign != std::string::npos && sign > 0 &&
        std::all_of(text.begin(), text.begin() + static_cast<std::ptrdiff_t>(sign), [](char c) {
            return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') ||
                   c == '_';
        });
    if (!is_name || exists(text)) {
        return std::nullopt;
    }
    NamedValues values{text.substr(0, sign), {}};
    const std::string sources = text.substr(sign + 1);
    values.sources = items_of(sources, ',');
    // A comma may be part of a name or of a URL.
    if (exists(sources) ||
        (is_url(sources) && !std::all_of(values.sources.begin(), values.sources.end(), is_url))) {
        values.sources = {sources};
    }
    const bool has_empty = std::any_of(values.sources.begin(), values.sources.end(),
                                       [](const std::string& source) { return source.empty(); });
    if (has_empty || (values.sources.size() != 1 && values.sources.size() != 3)) {
        throw Error(ErrorKind::invalid_argument,
                    fmt::format("--vertex-values '{}': give NAME=STORE, or NAME=X,Y,Z with the "
                                "stores of the three components of a vector",
                                text));
    }
    return values;
}

VertexValues::VertexValues(const std::vector<NamedValues>& values, ExtractArguments& a,
                           const RemoteArguments& remote, Communicator* ranks, Progress& progress)
    : values_(values) {
    if (values.empty()) {
        return;
    }
    std::vector<VertexField> fields;
    for (const NamedValues& one : values) {
        fields.push_back({one.name, {}});
        for (const std::string& source : one.sources) {
            Source& opened = sources_.emplace_back(Source{arguments_of_source(source, remote), {}});
            const StoreRequest request{{}, a.mesh, {}, 0, a.options.threads};
            if (ranks == nullptr) {
                opened.input =
                    open_or_make_store(opened.arguments, request, a.options.memory, progress);
            } else {
                opened.input.opened = open_if_store(opened.arguments, a.options.memory, progress);
                require_same_store(*ranks,
                                   opened.input.opened ? &opened.input.opened->reader() : nullptr,
                                   opened.arguments.shown());
                if (!opened.input.opened) {
                    throw Error(ErrorKind::invalid_argument, {opened.arguments.shown()},
                                "--vertex-values on several ranks needs stores: make one with "
                                "isonest preprocess");
                }
            }
            fields.back().components.push_back(&opened.input.store());
        }
        if (one.sources.size() == 1 && !a.field_to_color) {
            const Store& store = sources_.back().input.store();
            a.field_to_color = ColoredField{one.name, store.min_value(), store.max_value()};
        }
    }
    in_tiles_ = a.tiles;
    mesh_ = a.mesh;
    const std::uint64_t memory = a.options.memory / 4;
    a.options.memory -= memory;
    try {
        fields_ = std::make_unique<VertexFields>(std::move(fields),
                                                 ReadOptions{memory, a.options.threads});
    } catch (const Error& error) {
        throw with_enough_memory(error, [](std::uint64_t enough) { return 4 * enough + 4; });
    }
    a.fields = fields_.get();
}

void VertexValues::report(Result& result) const {
    if (!fields_) {
        return;
    }
    Json list = Json::array();
    auto source = sources_.begin();
    const std::vector<VertexFieldReport> reports = fields_->reports();
    for (std::size_t i = 0; i < reports.size(); ++i) {
        const VertexFieldReport& r = reports[i];
        Json names = Json::array();
        Json remote = Json::array();
        for (std::size_t k = 0; k < values_[i].sources.size(); ++k, ++source) {
            names.push_back(shown_location(values_[i].sources[k]));
            if (source->input.store().is_remote()) {
                const FetchedCounts fetched = source->input.store().fetched();
                remote.push_back(fetched_json(fetched));
                result.text += r.name + ": " + fetched_text(fetched);
            }
        }
        const bool is_bounded = r.bounded_elements > 0 || r.unbounded_elements == 0;
        list.push_back({{"name", r.name},
                        {"components", r.components},
                        {"sources", names},
                        {"linear_bound", is_bounded && !in_tiles_ ? Json(r.linear_bound) : Json()},
                        {"missing_vertices", r.missing_vertices},
                        {"unbounded_triangles", r.unbounded_elements}});
        if (!remote.empty()) {
            list.back()["remote"] = std::move(remote);
        }
        result.text +=
            in_tiles_ ? fmt::format("{}: rounded to 32 bits in the tiles, without a bound", r.name)
            : !is_bounded
                ? fmt::format("{}: no triangle has values everywhere", r.name)
                : fmt::format(
                      "{}: linear interpolation between vertices differs from the quantity "
                      "by at most {:.4g}",
                      r.name, r.linear_bound);
        if (r.missing_vertices > 0) {
            if (lower_extension(mesh_) == ".glb" || in_tiles_) {
                result.warning += fmt::format(
                    "{}{}: glTF has no missing values, and some programs refuse the "
                    "NaN of vertices without a value of {}; .ply, .vtp and .vtkhdf "
                    "have them",
                    result.warning.empty() ? "" : "\n", mesh_, r.name);
            }
            result.text += fmt::format("; {} vertices have no value", r.missing_vertices);
        }
        if (r.unbounded_elements > 0) {
            result.text += fmt::format("; {} triangles next to missing values have no bound",
                                       r.unbounded_elements);
        }
        result.text += "\n";
    }
    result.json["vertex_fields"] = std::move(list);
}

}  // namespace isonest::detail::cli
