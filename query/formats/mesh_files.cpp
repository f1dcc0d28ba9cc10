#include "query/formats/mesh_files.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cctype>

#include <isonest/error.h>

#include "store/base/label_text.h"

namespace isonest {
namespace {

using Open = std::unique_ptr<MeshSink> (*)(const std::filesystem::path&, const MeshFileOptions&);
struct Format {
    std::string_view extension;
    Open open;
};
constexpr std::array<Format, 8> kFormats{{{".ply", detail::ply_file},
                                          {".stl", detail::stl_file},
                                          {".obj", detail::obj_file},
                                          {".vtp", detail::vtp_file},
                                          {".vtkhdf", detail::vtkhdf_file},
                                          {".glb", detail::glb_file},
                                          {".3mf", detail::threemf_file},
                                          {".ngmesh", detail::ngmesh_file}}};

}  // namespace

std::unique_ptr<MeshSink> open_mesh_file(const std::filesystem::path& path,
                                         const MeshFileOptions& options) {
    if (!detail::is_printable_utf8(options.title)) {
        throw Error(ErrorKind::invalid_argument, {path.string()},
                    "the title of the mesh is no text in UTF-8, or has control characters");
    }
    std::string end = path.extension().string();
    std::transform(end.begin(), end.end(), end.begin(),
                   [](unsigned char c) { return static_cast<char>(std::tolower(c)); });
    for (const Format& format : kFormats) {
        if (format.extension == end) {
            if (options.shift != Double3{} && end != ".ngmesh") {
                throw Error(ErrorKind::invalid_argument, {path.string()},
                            "only meshes in .ngmesh are moved");
            }
            return format.open(path, options);
        }
    }
    throw Error(ErrorKind::invalid_argument, {path.string()},
                "a mesh's name must end with .ply, .stl, .obj, .vtp, .vtkhdf, .glb, .3mf or "
                ".ngmesh, which chooses its format");
}

namespace detail {

AnatomicalFrame frame_in_file(AnatomicalFrame frame, MeshSpace space,
                              const std::filesystem::path& path) {
    const bool as_it_is = space == MeshSpace::automatic &&
                          (frame == AnatomicalFrame::unknown || path.extension() == ".ngmesh");
    if (space == MeshSpace::as_stored || as_it_is) {
        return frame;
    }
    const AnatomicalFrame wanted =
        space == MeshSpace::lps ? AnatomicalFrame::lps : AnatomicalFrame::ras;
    if (frame == AnatomicalFrame::unknown) {
        throw Error(ErrorKind::invalid_argument, {path.string()},
                    fmt::format("it cannot be written in {}: nothing says what the volume's axes "
                                "are in a patient",
                                name_of(wanted)),
                    {{RemedyKind::place_in_world, "frame"}, {RemedyKind::preprocess_again}});
    }
    return wanted;
}

void MeshFile::prepare(const MeshLayout& layout, std::span<const std::filesystem::path> inputs) {
    check_output(path_, options_.replace, {inputs.begin(), inputs.end()});
    frame_in_file(layout.frame, options_.space, path_);
    if (layout.corners == 2 && !holds_lines()) {
        throw Error(ErrorKind::invalid_argument, {path_.string()},
                    "lines are written as .vtp or .obj");
    }
    if (layout.has_sides && !holds_sides()) {
        throw Error(ErrorKind::invalid_argument, {path_.string()},
                    "interfaces, triangles with the labels on both sides, are written as .vtp, "
                    ".vtkhdf or .ply");
    }
}

void MeshFile::begin(const MeshLayout& layout) {
    MeshLayout written = layout;
    written.frame = frame_in_file(layout.frame, options_.space, path_);
    turned_ = sign_between(layout.frame, written.frame) < 0;
    for (std::size_t axis = 0; turned_ && axis < 2 && layout.lo[axis] <= layout.hi[axis]; ++axis) {
        written.lo[axis] = 0 - layout.hi[axis];
        written.hi[axis] = 0 - layout.lo[axis];
    }
    begin_file(written);
}

std::string space_text(AnatomicalFrame frame) {
    return frame == AnatomicalFrame::unknown ? "" : fmt::format("SPACE={}", name_of(frame));
}

OutputFile& MeshFile::create(
    const std::function<void(const std::filesystem::path& temporary)>& prepare) {
    file_.reset();
    return file_.emplace(path_, options_.replace, prepare);
}

void MeshFile::end() {
    file_->publish_as_named();
    file_.reset();
}

void MeshFile::require_bits(unsigned bits, std::uint64_t count, const char* what,
                            const char* format) const {
    if (count >= std::uint64_t{1} << bits) {
        throw Error(ErrorKind::limit, {path_.string()},
                    fmt::format("the surface has {} {}, more than {} can number (2^{} - 1)", count,
                                what, format, bits),
                    {{RemedyKind::other_format, ".vtp,.vtkhdf"},
                     {RemedyKind::smaller_box},
                     {RemedyKind::larger_error}});
    }
}

}  // namespace detail
}  // namespace isonest
