#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cstring>
#include <limits>
#include <map>
#include <optional>
#include <span>
#include <string>
#include <utility>

#include <isonest/error.h>
#include <isonest/mesher_file.h>

#include "query/formats/mesh_files.h"
#include "query/mesh/scratch_mesh.h"
#include "query/meshers/regions.h"
#include "store/files/open_file.h"
#include "store/files/output_file.h"
#include "store/files/scratch_file.h"

// The formats: C. Geuzaine, J.-F. Remacle, "Gmsh 4.8 reference manual", section 9.1 (MSH 4.1); H.
// Si, "TetGen 1.5 user's manual", section 5.2.2 (.smesh).

namespace isonest {
namespace detail {
namespace {

/// Writes a file from its beginning to its end.
class Text {
  public:
    explicit Text(const OutputFile& file) : file_(file) {}
    Text& operator+=(std::string_view text) {
        text_ += text;
        if (text_.size() > kPiece) {
            flush();
        }
        return *this;
    }
    template <class T>
    void add(const T& value) {
        *this += std::string_view(reinterpret_cast<const char*>(&value), sizeof(value));
    }
    void flush() {
        file_.write_at(at_, std::as_bytes(std::span(text_)));
        at_ += text_.size();
        text_.clear();
    }

  private:
    static constexpr std::size_t kPiece = std::size_t{1} << 18U;
    const OutputFile& file_;
    std::uint64_t at_ = 0;
    std::string text_;
};

/// Triangles between the same two shells.
struct Surface {
    std::size_t pair = 0;  ///< of labels
    std::uint64_t triangles = 0;
    std::array<float, 3> lo = MeshLayout::kEmptyLo;
    std::array<float, 3> hi = MeshLayout::kEmptyHi;
    std::uint64_t next = 0;  ///< place of its next triangle among all
};

class MesherFile : public MeshSink {
  public:
    MesherFile(std::filesystem::path path, MesherFileOptions options)
        : path_(std::move(path)),
          options_(std::move(options)),
          folder_(ScratchFolder::metered(options_.scratch)),
          sides_file_(folder_) {
        for (const LabelName& label : options_.labels) {
            constexpr std::int64_t kMax = std::int64_t{1} << 53U;
            if (label.id > kMax || label.id < -kMax) {
                throw Error(ErrorKind::invalid_argument, {path_.string()},
                            fmt::format("label {}: programs for tetrahedra read labels as 64-bit "
                                        "floats, which hold whole numbers up to 2^53",
                                        label.id));
            }
            wanted_.push_back(label.id);
        }
        std::sort(wanted_.begin(), wanted_.end());
    }

    void prepare(const MeshLayout& layout, std::span<const std::filesystem::path> inputs) override {
        const std::vector<std::filesystem::path> all(inputs.begin(), inputs.end());
        check_output(path_, options_.replace, all);
        if (has_script()) {
            if (path_.filename().string().find_first_of("\"\\") != std::string::npos) {
                throw Error(ErrorKind::invalid_argument, {path_.string()},
                            "gmsh cannot read names of files with quotation marks or backslashes");
            }
            check_output(script(), options_.replace, all);
        }
        frame_in_file(layout.frame, options_.space, path_);
        if (!layout.has_sides) {
            throw Error(ErrorKind::invalid_argument, {path_.string()},
                        "only interfaces of labels can be written for programs that make "
                        "tetrahedra");
        }
        if (!layout.attributes.empty()) {
            throw Error(ErrorKind::invalid_argument, {path_.string()},
                        "the format cannot store values at the vertices");
        }
    }
    void begin(const MeshLayout& layout) override {
        MeshLayout own = layout;
        const AnatomicalFrame frame = frame_in_file(layout.frame, options_.space, path_);
        is_turned_ = sign_between(layout.frame, frame) < 0;
        for (std::size_t axis = 0; is_turned_ && axis < 2; ++axis) {
            own.lo[axis] = 0 - layout.hi[axis];
            own.hi[axis] = 0 - layout.lo[axis];
        }
        mesh_ = std::make_unique<ScratchMesh>(folder_);
        mesh_->begin(own);
    }
    void add_vertices(const VertexBatch& batch) override {
        VertexBatch turned = batch;
        std::vector<std::array<float, 3>> positions;
        if (is_turned_) {
            for (const auto& p : batch.positions) {
                positions.push_back({0 - p[0], 0 - p[1], p[2]});
            }
            turned.positions = positions;
        }
        mesh_->add_vertices(turned);
    }
    void add_elements(const ElementBatch& batch) override {
        mesh_->add_elements(batch);
        sides_file_.write_at(batch.first * sizeof(TriangleSides), std::as_bytes(batch.sides));
    }
    [[nodiscard]] bool concurrent() const override { return true; }

    void end() override {
        mesh_->end();
        sides_file_.map(mesh_->corners().size() * sizeof(TriangleSides));
        try {
            regions_.emplace(*mesh_, sides(), wanted_, folder_, silent_progress());
        } catch (const Error& e) {
            throw Error(e.kind(), {path_.string()}, e.problem(), e.remedies());
        }
        find_surfaces();
        if (has_script()) {
            write_gmsh();
        } else {
            write_tetgen();
        }
        regions_.reset();
        mesh_.reset();
        sides_file_.clear();
    }

  private:
    [[nodiscard]] std::span<const TriangleSides> sides() const {
        return sides_file_.as<const TriangleSides>().first(mesh_->corners().size());
    }
    [[nodiscard]] bool has_script() const { return lower_extension(path_) == ".msh"; }
    [[nodiscard]] std::filesystem::path script() const {
        return std::filesystem::path(path_).replace_extension(".geo");
    }
    /// gmsh knows a region by the surfaces around it, so those around a cavity are not the same as
    /// those around the region that has it.
    using ShellPair = std::array<std::uint64_t, 2>;
    /// The shells on both sides of a triangle; for labels that are not wanted, numbers above them.
    [[nodiscard]] ShellPair shells_at(std::uint64_t triangle) const {
        ShellPair both{};
        for (std::size_t side = 0; side < 2; ++side) {
            const std::uint32_t shell = regions_->shell(triangle, side);
            both[side] = shell != Regions::kNone
                             ? shell
                             : Regions::kMax + others_.at(sides()[triangle][side]);
        }
        return both;
    }

    void find_surfaces() {
        pairs_.clear();
        others_.clear();
        surfaces_.clear();
        std::map<TriangleSides, std::uint64_t> pairs;
        for (const TriangleSides& pair : sides()) {
            ++pairs[pair];
            for (const std::int64_t label : pair) {
                others_.try_emplace(label, others_.size());
            }
        }
        for (const auto& [pair, triangles] : pairs) {
            pairs_.push_back(pair);
        }
        const CornerView& corners = mesh_->corners();
        for (std::uint64_t t = 0; t < corners.size(); ++t) {
            Surface& surface = surfaces_[shells_at(t)];
            surface.pair = pair_of(t);
            ++surface.triangles;
            for (const std::uint64_t v : corners[t]) {
                for (std::size_t axis = 0; axis < 3; ++axis) {
                    surface.lo[axis] = std::min(surface.lo[axis], mesh_->positions()[v][axis]);
                    surface.hi[axis] = std::max(surface.hi[axis], mesh_->positions()[v][axis]);
                }
            }
        }
        std::uint64_t next = 0;
        for (auto& [shells, surface] : surfaces_) {
            surface.next = next;
            next += surface.triangles;
        }
    }
    [[nodiscard]] std::size_t pair_of(std::uint64_t triangle) const {
        return static_cast<std::size_t>(
            std::lower_bound(pairs_.begin(), pairs_.end(), sides()[triangle]) - pairs_.begin());
    }
    /// "12", or "12 liver".
    [[nodiscard]] std::string name_of_label(std::int64_t label) const {
        const auto at = std::find_if(options_.labels.begin(), options_.labels.end(),
                                     [&](const LabelName& l) { return l.id == label; });
        if (at == options_.labels.end() || at->name.empty()) {
            return fmt::format("{}", label);
        }
        std::string name = at->name;
        std::replace(name.begin(), name.end(), '"', '\'');  // would end the name
        std::replace(name.begin(), name.end(), '\\', '/');
        return fmt::format("{} {}", label, name);
    }
    [[nodiscard]] std::string name_of_pair(const TriangleSides& pair) const {
        return name_of_label(pair[0]) + " | " + name_of_label(pair[1]);
    }

    void write_gmsh() {
        using Limits = std::numeric_limits<std::int32_t>;
        if (mesh_->layout().vertices >= Limits::max() || surfaces_.size() >= Limits::max()) {
            throw Error(ErrorKind::limit, {path_.string()},
                        "the mesh has more vertices than gmsh can number (2^31 - 1)");
        }
        OutputFile file(path_, options_.replace);
        Text out(file);
        out += "$MeshFormat\n4.1 1 8\n";
        out.add(std::int32_t{1});  // the order of bytes
        out += fmt::format("\n$EndMeshFormat\n$PhysicalNames\n{}\n", pairs_.size());
        for (std::size_t i = 0; i < pairs_.size(); ++i) {
            out += fmt::format("2 {} \"{}\"\n", i + 1, name_of_pair(pairs_[i]));
        }
        out += "$EndPhysicalNames\n$Entities\n";
        for (const std::uint64_t count : {std::uint64_t{0}, std::uint64_t{0},
                                          std::uint64_t{surfaces_.size()}, std::uint64_t{0}}) {
            out.add(count);
        }
        std::int32_t tag = 0;
        for (const auto& [shells, surface] : surfaces_) {
            out.add(++tag);
            for (const auto& corner : {surface.lo, surface.hi}) {
                for (const float x : corner) {
                    out.add(static_cast<double>(x));
                }
            }
            out.add(std::uint64_t{1});
            out.add(static_cast<std::int32_t>(surface.pair + 1));
            out.add(std::uint64_t{0});  // bounding curves
        }
        out += "\n$EndEntities\n";
        write_nodes(out);
        write_triangles(out);
        out.flush();
        write_script();
        file.publish_as_named();
    }
    void write_nodes(Text& out) const {
        out += "$Nodes\n";
        const std::uint64_t count = mesh_->layout().vertices;
        const std::uint64_t blocks = count > 0 ? 1 : 0;
        for (const std::uint64_t number : {blocks, count, std::uint64_t{1}, count}) {
            out.add(number);
        }
        if (blocks > 0) {
            for (const std::int32_t number :
                 {2, 1, 0}) {  // of the first surface, without parameters
                out.add(number);
            }
            out.add(count);
            for (std::uint64_t v = 1; v <= count; ++v) {
                out.add(v);
            }
            for (const auto& p : mesh_->positions()) {
                for (const float x : p) {
                    out.add(static_cast<double>(x));
                }
            }
        }
        out += "\n$EndNodes\n";
    }
    /// Sorted by surfaces.
    void write_triangles(Text& out) {
        ScratchFile sorted_file(folder_);
        const CornerView& corners = mesh_->corners();
        sorted_file.map(corners.size() * sizeof(std::uint64_t));
        const auto sorted = sorted_file.as<std::uint64_t>();
        for (std::uint64_t t = 0; t < corners.size(); ++t) {
            sorted[surfaces_[shells_at(t)].next++] = t;
        }
        out += "$Elements\n";
        for (const std::uint64_t number :
             {std::uint64_t{surfaces_.size()}, std::uint64_t{corners.size()}, std::uint64_t{1},
              std::uint64_t{corners.size()}}) {
            out.add(number);
        }
        constexpr std::int32_t kTriangle = 2;
        std::int32_t tag = 0;
        std::uint64_t at = 0;
        for (const auto& [shells, surface] : surfaces_) {
            for (const std::int32_t number : {2, ++tag, kTriangle}) {
                out.add(number);
            }
            out.add(surface.triangles);
            for (std::uint64_t i = 0; i < surface.triangles; ++i) {
                const ElementCorners c = corners[sorted[at]];
                for (const std::uint64_t number : {++at, c[0] + 1, c[1] + 1, c[2] + 1}) {
                    out.add(number);
                }
            }
        }
        out += "\n$EndElements\n";
    }
    void write_script() const {
        std::vector<std::string> loops(regions_->all().size());
        std::size_t tag = 0;
        for (const auto& [shells, surface] : surfaces_) {
            ++tag;
            for (const std::uint64_t shell : shells) {
                if (shell < Regions::kMax) {
                    const auto region = regions_->region_of(static_cast<std::uint32_t>(shell));
                    loops[region] += fmt::format("{}{}", loops[region].empty() ? "" : ", ", tag);
                }
            }
        }
        OutputFile file(script(), options_.replace);
        Text out(file);
        out +=
            "// Made by isonest. gmsh -3 makes tetrahedra in the labels; the surfaces stay as they "
            "are.\n";
        out += fmt::format("Mesh.MeshOnlyEmpty = 1;\nMerge \"{}\";\n", path_.filename().string());
        std::map<std::int64_t, std::string> volumes;
        for (std::size_t i = 0; i < loops.size(); ++i) {
            out += fmt::format("Surface Loop({0}) = {{{1}}};\nVolume({0}) = {{{0}}};\n", i + 1,
                               loops[i]);
            std::string& all = volumes[regions_->all()[i].label];
            all += fmt::format("{}{}", all.empty() ? "" : ", ", i + 1);
        }
        const bool is_label =
            wanted_.empty() ||
            (wanted_.front() >= 1 && wanted_.back() <= std::numeric_limits<std::int32_t>::max());
        for (const auto& [label, all] : volumes) {
            const std::int64_t place =
                std::lower_bound(wanted_.begin(), wanted_.end(), label) - wanted_.begin() + 1;
            out += fmt::format("Physical Volume(\"{}\", {}) = {{{}}};\n", name_of_label(label),
                               is_label ? label : place, all);
        }
        out.flush();
        file.publish_as_named();
    }

    void write_tetgen() const {
        OutputFile file(path_, options_.replace);
        Text out(file);
        const CornerView& corners = mesh_->corners();
        out += "# Made by isonest. tetgen -pA makes tetrahedra with the labels as attributes.\n";
        for (std::size_t i = 0; i < pairs_.size(); ++i) {
            out += fmt::format("# marker {}: {}\n", i + 1, name_of_pair(pairs_[i]));
        }
        out += fmt::format("{} 3 0 0\n", mesh_->layout().vertices);
        std::uint64_t number = 0;
        for (const auto& p : mesh_->positions()) {
            out += fmt::format("{} {:.9g} {:.9g} {:.9g}\n", ++number, p[0], p[1], p[2]);
        }
        out += fmt::format("{} 1\n", corners.size());
        for (std::uint64_t t = 0; t < corners.size(); ++t) {
            const ElementCorners c = corners[t];
            out += fmt::format("3 {} {} {} {}\n", c[0] + 1, c[1] + 1, c[2] + 1, pair_of(t) + 1);
        }
        out += fmt::format("0\n{}\n", regions_->all().size());
        number = 0;
        for (const Region& region : regions_->all()) {
            out += fmt::format("{} {:.17g} {:.17g} {:.17g} {} -1\n", ++number, region.inside[0],
                               region.inside[1], region.inside[2], region.label);
        }
        out.flush();
        file.publish_as_named();
    }

    std::filesystem::path path_;
    MesherFileOptions options_;
    ScratchFolder folder_;
    ScratchFile sides_file_;
    std::vector<std::int64_t> wanted_;  ///< ascending
    std::unique_ptr<ScratchMesh> mesh_;
    bool is_turned_ = false;  ///< to the other frame
    std::optional<Regions> regions_;
    std::vector<TriangleSides> pairs_;              ///< ascending
    std::map<std::int64_t, std::uint64_t> others_;  ///< a number for each label
    std::map<ShellPair, Surface> surfaces_;
};

}  // namespace
}  // namespace detail

bool is_mesher_file(const std::filesystem::path& path) {
    const std::string end = detail::lower_extension(path);
    return end == ".msh" || end == ".smesh";
}

std::unique_ptr<MeshSink> open_mesher_file(const std::filesystem::path& path,
                                           const MesherFileOptions& options) {
    if (!is_mesher_file(path)) {
        throw Error(ErrorKind::invalid_argument, {path.string()},
                    "the name of a file for programs that make tetrahedra must end with .msh or "
                    ".smesh");
    }
    auto file = std::make_unique<detail::MesherFile>(path, options);
    return options.unit ? detail::converted(std::move(file), *options.unit) : std::move(file);
}

}  // namespace isonest
