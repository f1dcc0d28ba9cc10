// Meshes as files: what a page gets from a server alone.
#include <fmt/format.h>

#include <cerrno>
#include <cstdlib>
#include <filesystem>
#include <memory>
#include <string>
#include <system_error>
#include <utility>
#include <variant>

#include <isonest/error.h>
#include <isonest/mesh_file.h>

#include "tools/view/listed_folders.h"
#include "tools/view/mesh_answers.h"

namespace isonest::detail::view {
namespace {

/// A new folder below `scratch`.
std::filesystem::path new_folder(const std::filesystem::path& scratch) {
    std::string name = (scratch / "isonest-view-XXXXXX").string();
    if (::mkdtemp(name.data()) == nullptr) {
        throw Error(
            ErrorKind::io, {scratch.string()},
            fmt::format("cannot make a folder: {}", std::generic_category().message(errno)));
    }
    return name;
}

}  // namespace

HttpAnswer MeshAnswers::file(const MeshRequest& request, const std::string& ending,
                             const std::filesystem::path& scratch, Progress& progress) {
    if (std::holds_alternative<AtMostTriangles>(request.stop)) {
        throw Error(ErrorKind::invalid_argument,
                    "a file is made for an error, a camera or a distance, not for a number of "
                    "triangles");
    }
    const std::string name = (request.is_slice() ? "slice." : "surface.") + ending;
    const std::filesystem::path folder = new_folder(scratch);
    SentFile file(folder, folder / name);
    list_folder(folder);
    const auto* const choice = std::get_if<LabelChoice>(&request.what);
    const LabelName label =
        choice != nullptr ? store_.label_name(choice->id).value_or(LabelName{}) : LabelName{};
    const std::unique_ptr<MeshSink> sink =
        open_mesh_file(file.path(), {.title = label.name, .color = label.color});
    extract_to(*sink, request, 0, progress);
    return {200, "application/octet-stream", std::move(file), name};
}

}  // namespace isonest::detail::view
