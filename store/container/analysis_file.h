// The file that keeps the analysis of one surface: meshes near it, each within a proven distance.
// The format is described in FORMAT.md, "Analyses". Private to the library.
#pragma once

#include <array>
#include <cstdint>
#include <filesystem>
#include <span>
#include <string>
#include <vector>

#include "store/files/open_file.h"

namespace isonest::detail {

/// Version of the format and of the way the meshes are made; must be raised when either changes.
inline constexpr std::uint32_t kAnalysisVersion = 1;

/// Facts about the surface as it was extracted.
struct AnalysedSurface {
    std::string key;              ///< identifies store and query, as text of at most 4096 bytes
    std::uint64_t triangles = 0;  ///< after components were dropped
    std::uint64_t components = 0;
    std::uint64_t dropped_components = 0;
    std::uint64_t dropped_triangles = 0;
    std::uint64_t largest_dropped = 0;
    std::uint64_t border_vertices = 0;
    std::uint64_t mended_triangles = 0;
    double coordinate_rounding = 0;  ///< as in ExtractReport, like the next one
    double value_rounding = 0;
    std::uint64_t row_bytes = 0;  ///< of the attributes of a vertex
};

/// One mesh of an analysis.
struct AnalysisStep {
    double bound = 0;  ///< proven distance from the surface, world units
    std::uint64_t vertices = 0;
    std::uint64_t triangles = 0;
    std::uint64_t checksum = 0;  ///< XXH64 of positions, rows and corners
};

/// Offsets of the arrays of a step in the file.
struct AnalysisOffsets {
    std::uint64_t positions = 0;
    std::uint64_t rows = 0;
    std::uint64_t corners = 0;
};

/// Creates the file with all arrays allocated. Throws Error{io}.
std::vector<AnalysisOffsets> create_analysis(const std::filesystem::path& path,
                                             const AnalysedSurface& surface,
                                             std::span<const AnalysisStep> steps);

/// Reads a file made by create_analysis(). Thread-safety: const methods from any thread.
class AnalysisFile {
  public:
    /// Maximum number of meshes in a file.
    static constexpr std::uint64_t kMaxSteps = 64;

    /// Throws Error{not_found, io}, Error{corrupt} (not such a file, or damaged),
    /// Error{unsupported} (another version of the format).
    explicit AnalysisFile(const std::filesystem::path& path);

    [[nodiscard]] const std::filesystem::path& path() const { return path_; }
    [[nodiscard]] std::uint64_t file_bytes() const { return file_.bytes().size(); }
    [[nodiscard]] const AnalysedSurface& surface() const { return surface_; }
    /// In order of ascending bounds.
    [[nodiscard]] const std::vector<AnalysisStep>& steps() const { return steps_; }

    // The arrays of a mesh as stored, not aligned.
    [[nodiscard]] std::span<const std::byte> positions(std::size_t step) const;  ///< 3 float32
    [[nodiscard]] std::span<const std::byte> rows(std::size_t step) const;
    [[nodiscard]] std::span<const std::byte> corners(std::size_t step) const;  ///< 3 uint64
    /// Checks the checksum of a step, that its corners are vertices, and that its positions are
    /// finite. Throws Error{corrupt}.
    void verify(std::size_t step) const;

  private:
    struct Arrays {
        std::span<const std::byte> positions, rows, corners;
    };
    [[noreturn]] void damaged(const std::string& problem) const;
    /// The arrays of step i, below the group `root`. Appends the step to steps_.
    Arrays arrays_of(std::int64_t root, std::size_t i);

    std::filesystem::path path_;
    MappedFile file_;
    AnalysedSurface surface_;
    std::vector<AnalysisStep> steps_;
    std::vector<Arrays> arrays_;
};

/// XXH64 of the concatenated arrays of a mesh.
std::uint64_t analysis_checksum(std::span<const std::byte> positions,
                                std::span<const std::byte> rows,
                                std::span<const std::byte> corners);

}  // namespace isonest::detail
