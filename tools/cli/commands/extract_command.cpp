#include "tools/cli/commands/extract_command.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <limits>
#include <memory>
#include <utility>

#include <isonest/error.h>
#include <isonest/march.h>
#include <isonest/mesh_file.h>

#include "tools/cli/options/source_options.h"
#include "tools/cli/options/units.h"

namespace isonest::detail::cli {
namespace {

/// `what` needs a store.
[[noreturn]] void refuse_without_store(const ExtractCommand& arguments, const char* what) {
    throw Error(ErrorKind::invalid_argument, {arguments.extract.store},
                std::string("is no store, which ") + what + " need", {{RemedyKind::make_store}});
}

void require_no_store(const ExtractCommand& a, bool has_iso) {
    if (a.labels.one || a.labels.several) {
        refuse_without_store(a, "surfaces of labels");
    }
    if (a.extract.is_graph) {
        refuse_without_store(a, "graphs");
    }
    if (a.isovalues.all.size() > 1) {
        refuse_without_store(a, "several isovalues at once");
    }
    if (!has_iso) {
        throw Error(ErrorKind::invalid_argument, {a.extract.store}, "give the isovalue, --iso V");
    }
    // The library refuses the others, but knows nothing of these.
    if (a.labels.smooth) {
        refuse_without_store(a, "--smooth and surfaces of labels");
    }
    if (a.labels.keep_nodes) {
        refuse_without_store(a, "--keep-nodes and surfaces of labels");
    }
    if (a.extract.error.guarantee != Guarantee::deviation) {
        refuse_without_store(a, "errors and their --guarantee");
    }
}

/// Names the options that a store is needed for.
[[noreturn]] void rethrow_named(const Error& error, const ExtractCommand& a) {
    const bool needs_store =
        std::any_of(error.remedies().begin(), error.remedies().end(),
                    [](const Remedy& r) { return r.kind == RemedyKind::make_store; });
    if (!needs_store || a.store_options.empty()) {
        throw Error(error);
    }
    throw Error(error.kind(), error.place(),
                fmt::format("{}: {}", fmt::join(a.store_options, ", "), error.problem()),
                error.remedies());
}

/// Says of a file that nothing describes that it is no store either.
std::unique_ptr<VolumeSource> open_any_volume(const ExtractCommand& a,
                                              const std::filesystem::path& scratch) {
    try {
        return open_input(a.input, scratch, a.source);
    } catch (const Error& error) {
        const bool is_unknown = !error.remedies().empty() &&
                                (error.remedies().front().kind == RemedyKind::describe_numbers ||
                                 error.remedies().front().kind == RemedyKind::download);
        if (!is_unknown) {
            throw;
        }
        throw Error(error.kind(), error.place(), "is no store; " + error.problem(),
                    error.remedies());
    }
}

/// Why there is no surface. The volume is read once more.
std::string empty_volume(VolumeSource& volume, double iso, const ExtractOptions& options,
                         Progress& progress) {
    if (volume.sequential()) {
        return fmt::format("The surface is empty: no cell has values on both sides of {}.\n", iso);
    }
    constexpr double kNone = std::numeric_limits<double>::quiet_NaN();
    const auto [low, high] =
        finite_range(volume, options, progress).value_or(std::pair{kNone, kNone});
    if (!(low <= high)) {
        return "The surface is empty: all values are missing.\n";
    }
    return fmt::format("The surface is empty: {}; they are {}.\n",
                       iso <= low ? fmt::format("no value is below {}", iso)
                       : high < iso
                           ? fmt::format("every value is below {}", iso)
                           : fmt::format("values are missing wherever others pass {}", iso),
                       human_range(low, high));
}

/// REQUIRES: require_no_store().
Result extract_from_volume(ExtractCommand arguments, Progress& progress) {
    ExtractArguments& a = arguments.extract;
    a.mesh = mesh_name(a.mesh, arguments.isovalues.texts.front());
    const std::optional<Store> others = open_values(arguments, progress);
    reach_volume(arguments.input, arguments.remote, a.options.memory, arguments.source, progress);
    const ExtractOptions options = options_of(a);
    // As preprocess does: a quarter of the budget for chunks of the input.
    arguments.source.max_heap = options.memory / 4;
    const std::unique_ptr<VolumeSource> volume = open_any_volume(arguments, options.scratch);
    const VolumeDescription description = volume->describe();
    arguments.distance.resolve(description.unit, description.name);
    const SurfaceQuery query = arguments.surface_query(others ? &*others : nullptr);
    const std::unique_ptr<MeshSink> sink = open_mesh_file(a.mesh, a.file_options());
    const ExtractReport report = isonest::extract(*volume, query, *sink, options, progress);
    ExtractOrigin origin{nullptr, volume.get(), description.unit, description.frame, {}};
    if (report.triangles == 0) {
        origin.why_empty = empty_volume(*volume, query.iso, options, progress);
    }
    Result result = result_of(origin, arguments, report);
    add_fetched(*volume, result);
    if (others && others->is_remote()) {
        result.json["remote_values"] = fetched_json(others->fetched());
    }
    return result;
}

}  // namespace

SurfaceQuery ExtractCommand::surface_query(const Store* others) const {
    const ExtractArguments& a = extract;
    auto query = begun<SurfaceQuery>(others);
    query.iso = isovalues.one();
    query.grid = {a.cells, vertices, bound, culling};
    if (distance.by_error && distance.distance) {
        throw Error(ErrorKind::invalid_argument,
                    "--by error goes without --distance: the triangles are the nested grid's");
    }
    if (distance.simplify && !distance.by_error) {
        if (a.error.value == 0) {
            throw Error(ErrorKind::invalid_argument,
                        "--simplify goes with --error or --error-relative, above 0, or with "
                        "--triangles N --by error; --distance simplifies by itself");
        }
        query.stop = SimplifiedErrorBound{a.error};
    }
    distance.require_sense();
    query.stop = distance.stop().value_or(query.stop);
    query.stages = {close, components};
    if (distance.analysis && !distance.stop()) {
        throw Error(ErrorKind::invalid_argument,
                    "--keep-analysis goes with --distance or --triangles");
    }
    query.analysis = distance.analysis;
    query.volume_interval = volume_interval;
    return query;
}

std::optional<Store> open_values(ExtractCommand& arguments, Progress& progress) {
    std::optional<Store> others;
    if (!arguments.values.empty()) {
        others.emplace(open_store(arguments.values, arguments.remote,
                                  arguments.extract.options.memory, progress,
                                  arguments.input.front()));
    }
    return others;
}

Result extract_volume_file(ExtractCommand arguments, bool has_iso, Progress& progress) {
    try {
        require_no_store(arguments, has_iso);
        return extract_from_volume(arguments, progress);
    } catch (const Error& error) {
        rethrow_named(error, arguments);
    }
}

}  // namespace isonest::detail::cli
