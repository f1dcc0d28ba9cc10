// The file that keeps the analysis of one surface: meshes near to it, each within a proven
// distance. Its format is in FORMAT.md, "Analyses". Private to the library.
#pragma once

#include <array>
#include <cstdint>
#include <filesystem>
#include <span>
#include <string>
#include <vector>

#include "store/files/mapped_file.h"

namespace isonest::detail {

/// Of the format, and of how the meshes are made: to be raised whenever these become others.
inline constexpr std::uint32_t kAnalysisVersion = 1;

/// What an analysis says of the surface as it was extracted.
struct AnalysedSurface {
    std::string key;              ///< of which store and query it is, as a text; at most 4096 bytes
    std::uint64_t triangles = 0;  ///< after components were dropped
    std::uint64_t components = 0;
    std::uint64_t dropped_components = 0;
    std::uint64_t dropped_triangles = 0;
    std::uint64_t largest_dropped = 0;
    std::uint64_t border_vertices = 0;
    std::uint64_t mended_triangles = 0;
    double coordinate_rounding = 0;  ///< as in ExtractReport, and the next one, too
    double value_rounding = 0;
    std::uint64_t row_bytes = 0;  ///< of a vertex's attributes
};

/// One mesh of an analysis.
struct AnalysisStep {
    double bound = 0;  ///< proven distance from the surface, world units
    std::uint64_t vertices = 0;
    std::uint64_t triangles = 0;
    std::uint64_t checksum = 0;  ///< XXH64 of positions, rows and corners
};

/// Where the arrays of a step begin in the file.
struct AnalysisOffsets {
    std::uint64_t positions = 0;
    std::uint64_t rows = 0;
    std::uint64_t corners = 0;
};

/// Creates the file with all arrays allocated. Throws Error{io}.
std::vector<AnalysisOffsets> create_analysis(const std::filesystem::path& path,
                                             const AnalysedSurface& surface,
                                             std::span<const AnalysisStep> steps);

/// A file that was made so. Thread-safety: const methods from any thread.
class AnalysisFile {
  public:
    /// Most meshes in a file.
    static constexpr std::uint64_t kMostSteps = 64;

    /// Throws Error{not_found, io}, Error{corrupt} (not such a file, or damaged),
    /// Error{unsupported} (another version of the format).
    explicit AnalysisFile(const std::filesystem::path& path);

    [[nodiscard]] const std::filesystem::path& path() const { return path_; }
    [[nodiscard]] std::uint64_t file_bytes() const { return file_.bytes().size(); }
    [[nodiscard]] const AnalysedSurface& surface() const { return surface_; }
    /// Bounds rise.
    [[nodiscard]] const std::vector<AnalysisStep>& steps() const { return steps_; }

    // A mesh as it is stored: without alignment.
    [[nodiscard]] std::span<const std::byte> positions(std::size_t step) const;  ///< 3 float32
    [[nodiscard]] std::span<const std::byte> rows(std::size_t step) const;
    [[nodiscard]] std::span<const std::byte> corners(std::size_t step) const;  ///< 3 uint64
    /// Compares the checksum of a step, and that its corners are vertices and its positions
    /// numbers. Throws Error{corrupt}.
    void verify(std::size_t step) const;

  private:
    struct Arrays {
        std::span<const std::byte> positions, rows, corners;
    };
    [[noreturn]] void damaged(const std::string& problem) const;
    /// Adds to steps_, too.
    Arrays arrays_of(std::int64_t root, std::size_t i);

    std::filesystem::path path_;
    MappedFile file_;
    AnalysedSurface surface_;
    std::vector<AnalysisStep> steps_;
    std::vector<Arrays> arrays_;
};

/// XXH64 of a mesh's arrays one after the other.
std::uint64_t analysis_checksum(std::span<const std::byte> positions,
                                std::span<const std::byte> rows,
                                std::span<const std::byte> corners);

}  // namespace isonest::detail
