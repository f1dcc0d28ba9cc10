#include "store/container/analysis_file.h"

#include <fmt/format.h>

#include <cmath>
#include <cstring>
#include <limits>
#include <optional>

#include <isonest/error.h>

#include "store/container/codec.h"
#include "store/container/parts/hdf5_types.h"
#include "store/hdf5/handles.h"

namespace isonest::detail {
namespace {

constexpr const char* kAnalysisName = "isonest analysis";
constexpr std::uint64_t kPositionBytes = 3 * sizeof(float);
constexpr std::uint64_t kCornerBytes = 3 * sizeof(std::uint64_t);
constexpr std::size_t kCounts = 8;
constexpr std::size_t kNumbers = 2;

std::string group_of(std::size_t step) {
    return fmt::format("step_{:02}", step);
}

std::vector<std::uint64_t> counts_of(const AnalysedSurface& s) {
    return {s.triangles,       s.components,      s.dropped_components, s.dropped_triangles,
            s.largest_dropped, s.border_vertices, s.mended_triangles,   s.row_bytes};
}

/// Checksum of everything in the attributes.
std::uint64_t header_checksum(const AnalysedSurface& s, std::span<const AnalysisStep> steps) {
    Checksum sum;
    sum.add(std::as_bytes(std::span(s.key)));
    const std::vector<std::uint64_t> counts = counts_of(s);
    sum.add(std::as_bytes(std::span(counts)));
    const std::array<double, kNumbers> numbers{s.coordinate_rounding, s.value_rounding};
    sum.add(std::as_bytes(std::span(numbers)));
    for (const AnalysisStep& step : steps) {
        sum.add(std::as_bytes(std::span(&step.bound, 1)));
        const std::array sizes{step.vertices, step.triangles, step.checksum};
        sum.add(std::as_bytes(std::span(sizes)));
    }
    return sum.value();
}

}  // namespace

std::uint64_t analysis_checksum(std::span<const std::byte> positions,
                                std::span<const std::byte> rows,
                                std::span<const std::byte> corners) {
    Checksum sum;
    sum.add(positions);
    sum.add(rows);
    sum.add(corners);
    return sum.value();
}

std::vector<AnalysisOffsets> create_analysis(const std::filesystem::path& path,
                                             const AnalysedSurface& surface,
                                             std::span<const AnalysisStep> steps) {
    const QuietHdf5 quiet;
    Hdf5Frame frame(path);
    write_attribute(frame.file(), "format", std::string(kAnalysisName));
    write_attribute(frame.file(), "version", kAnalysisVersion);
    write_attribute(frame.file(), "key", surface.key);
    write_attribute(frame.file(), "counts", counts_of(surface));
    write_attribute(frame.file(), "rounding",
                    std::vector<double>{surface.coordinate_rounding, surface.value_rounding});
    write_attribute(frame.file(), "steps", static_cast<std::uint64_t>(steps.size()));
    write_attribute(frame.file(), "xxh64", header_checksum(surface, steps));
    std::vector<AnalysisOffsets> offsets;
    for (std::size_t i = 0; i < steps.size(); ++i) {
        const AnalysisStep& step = steps[i];
        const GroupHandle group = frame.group(frame.file(), group_of(i).c_str());
        write_attribute(group.get(), "bound", std::vector<double>{step.bound});
        write_attribute(group.get(), "xxh64", step.checksum);
        write_attribute(group.get(), "size",
                        std::vector<std::uint64_t>{step.vertices, step.triangles});
        offsets.push_back(
            {frame.array(group.get(), "positions", H5T_IEEE_F32LE, {step.vertices, 3}),
             frame.array(group.get(), "rows", H5T_STD_U8LE, {step.vertices, surface.row_bytes}),
             frame.array(group.get(), "corners", H5T_STD_U64LE, {step.triangles, 3})});
    }
    frame.close();
    return offsets;
}

AnalysisFile::AnalysisFile(const std::filesystem::path& path) : path_(path), file_(path) {
    const QuietHdf5 quiet;
    const FileHandle file = open_hdf5(path_);
    if (!file.valid() || read_text(file.get(), "format") != kAnalysisName) {
        damaged("not a surface analysis");
    }
    const auto version = read_integers(file.get(), "version", 1);
    if (!version || (*version)[0] != kAnalysisVersion) {
        throw Error(
            ErrorKind::unsupported, {path_.string()},
            fmt::format("an analysis made by another version of isonest; this one reads version {}",
                        kAnalysisVersion));
    }
    const auto key = read_text(file.get(), "key");
    const auto counts = read_integers(file.get(), "counts", kCounts);
    const auto rounding = read_numbers(file.get(), "rounding", kNumbers);
    const auto steps = read_integers(file.get(), "steps", 1);
    const auto checksum = read_integers(file.get(), "xxh64", 1);
    if (!key || !counts || !rounding || !steps || !checksum || (*steps)[0] > kMaxSteps) {
        damaged("an attribute is missing");
    }
    const auto& c = *counts;
    surface_ = {*key, c[0], c[1],           c[2],           c[3], c[4],
                c[5], c[6], (*rounding)[0], (*rounding)[1], c[7]};
    for (std::size_t i = 0; i < (*steps)[0]; ++i) {
        arrays_.push_back(arrays_of(file.get(), i));
    }
    if (header_checksum(surface_, steps_) != (*checksum)[0]) {
        damaged("checksum mismatch: its attributes have changed");
    }
}

void AnalysisFile::damaged(const std::string& problem) const {
    throw Error(ErrorKind::corrupt, {path_.string()}, problem);
}

AnalysisFile::Arrays AnalysisFile::arrays_of(std::int64_t root, std::size_t i) {
    const GroupHandle group(H5Gopen2(root, group_of(i).c_str(), H5P_DEFAULT));
    const auto bound = group.valid() ? read_numbers(group.get(), "bound", 1) : std::nullopt;
    const auto size = group.valid() ? read_integers(group.get(), "size", 2) : std::nullopt;
    const auto checksum = group.valid() ? read_integers(group.get(), "xxh64", 1) : std::nullopt;
    if (!bound || !size || !checksum) {
        damaged(fmt::format("step {} is missing", i));
    }
    const AnalysisStep step{(*bound)[0], (*size)[0], (*size)[1], (*checksum)[0]};
    const std::uint64_t most = file_bytes();
    if (step.vertices > most || step.triangles > most || surface_.row_bytes > most) {
        damaged(fmt::format("step {} is larger than the file", i));
    }
    const auto bytes = [&](const char* name, std::uint64_t count, std::uint64_t each) {
        const DatasetHandle dataset(H5Dopen2(group.get(), name, H5P_DEFAULT));
        if (count == 0 || each == 0) {
            return std::span<const std::byte>();
        }
        const auto offset = dataset.valid() && each <= most / count
                                ? offset_of(dataset.get(), count * each, most)
                                : std::nullopt;
        if (!offset) {
            damaged(fmt::format("{} of step {} are missing or cut off", name, i));
        }
        return file_.bytes().subspan(*offset, count * each);
    };
    steps_.push_back(step);
    return {bytes("positions", step.vertices, kPositionBytes),
            bytes("rows", step.vertices, surface_.row_bytes),
            bytes("corners", step.triangles, kCornerBytes)};
}

std::span<const std::byte> AnalysisFile::positions(std::size_t step) const {
    return arrays_[step].positions;
}
std::span<const std::byte> AnalysisFile::rows(std::size_t step) const {
    return arrays_[step].rows;
}
std::span<const std::byte> AnalysisFile::corners(std::size_t step) const {
    return arrays_[step].corners;
}

void AnalysisFile::verify(std::size_t step) const {
    const Arrays& a = arrays_[step];
    if (analysis_checksum(a.positions, a.rows, a.corners) != steps_[step].checksum) {
        damaged(fmt::format("checksum mismatch in step {}: the bytes have changed", step));
    }
    for (std::size_t at = 0; at < a.positions.size(); at += sizeof(float)) {
        float x = 0;
        std::memcpy(&x, a.positions.data() + at, sizeof(x));
        if (!std::isfinite(x)) {
            damaged(fmt::format("a position of step {} is not a number", step));
        }
    }
    for (std::size_t at = 0; at < a.corners.size(); at += sizeof(std::uint64_t)) {
        std::uint64_t v = 0;
        std::memcpy(&v, a.corners.data() + at, sizeof(v));
        if (v >= steps_[step].vertices) {
            damaged(fmt::format("a triangle of step {} has an invalid vertex", step));
        }
    }
}

}  // namespace isonest::detail
