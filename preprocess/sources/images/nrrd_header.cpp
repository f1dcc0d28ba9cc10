#include "preprocess/sources/images/nrrd_header.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>
#include <cstdint>
#include <limits>
#include <sstream>
#include <string_view>
#include <utility>
#include <vector>

#include <isonest/error.h>

#include "preprocess/sources/bytes/header_words.h"
#include "preprocess/sources/images/nrrd_fields.h"
#include "preprocess/sources/numbers/raw_source.h"
#include "preprocess/sources/placement/axis_choice.h"

namespace isonest::detail {
namespace {

template <class T>
bool read_whole(std::string_view text, T& value) {
    const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
    return error == std::errc{} && end == text.data() + text.size() && !text.empty();
}

struct Segment {
    std::string name = {};
    std::string color = {};
    std::string value = "1";
    std::string layer = "0";
};

/// "0.5 0.25 1"
std::optional<LabelColor> color_of_segment(const std::string& text) {
    std::istringstream in(text);
    std::array<double, 3> parts{};
    for (double& part : parts) {
        std::string word;
        in >> word;
        if (!read_whole(word, part)) {
            return std::nullopt;
        }
    }
    std::string more;
    return in >> more ? std::nullopt : color_of_parts(parts[0], parts[1], parts[2]);
}

}  // namespace

FoundLabels labels_of_segments(const std::map<std::string, std::string, std::less<>>& keys,
                               std::optional<std::int64_t> layer) {
    constexpr std::string_view kStart = "Segment";
    std::map<std::uint32_t, Segment> segments;
    for (const auto& [key, text] : keys) {
        const std::string_view rest = std::string_view(key).substr(kStart.size());
        const std::size_t end = rest.find('_');
        std::uint32_t number = 0;
        if (end == std::string_view::npos || !read_whole(rest.substr(0, end), number)) {
            continue;  // "Segmentation_..."
        }
        const std::string_view what = rest.substr(end + 1);
        if (what == "Name") {
            segments[number].name = text;
        } else if (what == "Color") {
            segments[number].color = text;
        } else if (what == "LabelValue") {
            segments[number].value = trimmed(text);
        } else if (what == "Layer") {
            segments[number].layer = trimmed(text);
        }
    }
    FoundLabels labels;
    for (const auto& [number, segment] : segments) {
        std::int64_t id = 0;
        if (!read_whole(segment.value, id)) {
            labels.leave_out(fmt::format("segment {}: its label is not a whole number", number));
            continue;
        }
        std::int64_t own = 0;
        if (!layer || !read_whole(segment.layer, own) || own != *layer) {
            labels.leave_out(fmt::format("segment {} is in another layer", number));
            continue;
        }
        std::optional<LabelColor> color;
        if (!segment.color.empty()) {
            color = color_of_segment(segment.color);
            if (!color) {
                labels.leave_out(
                    fmt::format("segment {}: its colour is not three numbers from 0 to 1", number));
            }
        }
        labels.add(id, segment.name, color);
    }
    return labels;
}

namespace {

class Parser {
  public:
    Parser(std::string_view text, std::string name, const std::optional<Double3>& spacing,
           std::span<const AxisIndex> index)
        : fields_(text, name), name_(std::move(name)), spacing_(spacing), index_(index) {}

    NrrdHeader parse() {
        NrrdHeader header;
        read_type(header);
        read_axes(header);
        read_encoding(header);
        return header;
    }

  private:
    void read_type(NrrdHeader& header) const {
        const std::string type = lower(fields_.require("type"));
        const auto found = nrrd_type(type);
        if (!found) {
            fields_.unsupported(fmt::format(
                "type '{}' is not supported; use an integer of 8 to 64 bits, float or double",
                type));
        }
        header.layout.type = found->type;
        header.stored = found->stored;
    }

    void read_axes(NrrdHeader& header) {
        const std::vector<std::int64_t> dimension = fields_.integers("dimension");
        const std::vector<std::int64_t> sizes = fields_.integers("sizes");
        if (dimension.size() != 1 || sizes.empty() ||
            dimension[0] != static_cast<std::int64_t>(sizes.size())) {
            fields_.corrupt("'dimension' and 'sizes' do not agree");
        }
        if (std::any_of(sizes.begin(), sizes.end(), [](std::int64_t n) { return n < 1; })) {
            fields_.corrupt("'sizes' must be positive whole numbers");
        }
        const std::vector<ArrayAxis> file = array_axes(sizes);
        const ChosenAxes chosen = choose_axes(file, index_, name_);
        const ArrayPlace place = place_in_array(file, index_, name_);
        header.layout.nodes = place.nodes;
        header.layout.strides = place.strides;
        header.layout.first = place.first;
        if (place.whole != static_cast<std::uint64_t>(place.nodes.product())) {
            header.layout.whole = place.whole;
        }
        header.no_space = chosen.no_space;
        if (const auto times = time_axis(file, chosen)) {
            header.time = VolumeTime{{}, {}, file[*times].length};
        }
        set_pieces(header, sizes);
        // In the file's order from here on, fastest first.
        std::vector<std::size_t> axes;
        for (const auto& axis : chosen.axis) {
            if (axis) {
                axes.push_back(sizes.size() - 1 - *axis);
            }
        }
        const std::vector<std::int64_t> at(chosen.at.rbegin(), chosen.at.rend());
        read_geometry(header, axes, at);
        ChosenAxes noted = chosen;
        noted.no_space = header.no_space;
        const std::vector<std::string> about =
            notes_of(noted, file, Double3(header.layout.spacing));
        header.notes.insert(header.notes.end(), about.begin(), about.end());
        read_labels(header, axes, at);
    }

    /// The names and meanings of the axes, slowest first. An axis of a volume contains samples of
    /// one thing; a time axis is used as one if necessary.
    [[nodiscard]] std::vector<ArrayAxis> array_axes(const std::vector<std::int64_t>& sizes) const {
        const std::vector<std::string> kinds = words_per_axis("kinds", sizes.size());
        std::vector<std::string> labels = fields_.quoted("labels");
        labels.resize(labels.size() == sizes.size() ? labels.size() : 0);
        labels.resize(sizes.size());
        const auto is_space = [](const std::string& kind) {
            return kind.empty() || kind == "domain" || kind == "space" || kind == "none" ||
                   kind == "???";
        };
        std::size_t long_ones = 0;
        for (std::size_t i = 0; i < sizes.size(); ++i) {
            long_ones += is_space(kinds[i]) && sizes[i] > 1 ? 1 : 0;
        }
        constexpr std::array<const char*, 4> kNames{"x", "y", "z", "t"};
        std::size_t places = 0;
        std::vector<ArrayAxis> axes;
        for (std::size_t i = 0; i < sizes.size(); ++i) {
            const bool is_time = kinds[i] == "time";
            ArrayAxis axis{is_time              ? "t"
                           : kinds[i] == "list" ? (has_segments() ? "layer" : "list")
                           : sizes[i] > 1       ? "c"
                                                : "",
                           sizes[i], sizes[i] == 1 || (is_time && long_ones < 3)};
            if (is_space(kinds[i])) {
                axis.name = places < kNames.size() ? kNames.at(places) : "";
                axis.of_volume = true;
                ++places;
            }
            if (is_plain(labels[i])) {
                axis.name = labels[i];
            }
            if (axis.name == "layer" && sizes[i] > 1 && index_.empty()) {
                throw Error(
                    ErrorKind::unsupported, {name_, "NRRD header"},
                    fmt::format(
                        "the segments overlap and are stored in {} layers, but a volume has one "
                        "label per node; in 3D Slicer, export the segments to a labelmap",
                        sizes[i]),
                    {{RemedyKind::choose_index, "layer=0"}});
            }
            axes.insert(axes.begin(), std::move(axis));
        }
        return axes;
    }

    static bool is_plain(const std::string& label) {
        constexpr std::size_t kMax = 40;
        return !label.empty() && label.size() <= kMax &&
               label.find_first_of(",;=\"") == std::string::npos;
    }

    [[nodiscard]] bool has_segments() const { return !fields_.segment_keys().empty(); }

    void read_labels(NrrdHeader& header, const std::vector<std::size_t>& axes,
                     const std::vector<std::int64_t>& at) const {
        const std::vector<std::string> kinds = words_per_axis("kinds", at.size());
        const auto list =
            static_cast<std::size_t>(std::find(kinds.begin(), kinds.end(), "list") - kinds.begin());
        const bool is_whole = std::find(axes.begin(), axes.end(), list) != axes.end();
        std::optional<std::int64_t> layer = list < at.size() ? at[list] : 0;
        if (is_whole && header.no_space != std::array<bool, 3>{}) {
            layer.reset();
        }
        header.labels = labels_of_segments(fields_.segment_keys(), layer);
    }

    /// Sets the files of `data file: LIST` or of a pattern, which all have the same number of
    /// values.
    void set_pieces(NrrdHeader& header, const std::vector<std::int64_t>& sizes) const {
        constexpr std::uint64_t kMax = kMaxPieces;
        const auto pieces = fields_.pieces();
        if (!pieces) {
            return;
        }
        const auto count = static_cast<std::int64_t>(sizes.size());
        const std::int64_t own = pieces->axes.value_or(count - 1);
        if (own < 1 || own > count) {
            fields_.corrupt(
                fmt::format("'data file': each file has {} axes, but 'sizes' has {}", own, count));
        }
        const std::uint64_t files = pieces->files.size();
        std::uint64_t needed = 1;
        for (auto i = static_cast<std::size_t>(own); i < sizes.size() && needed <= kMax; ++i) {
            needed *= static_cast<std::uint64_t>(std::min<std::int64_t>(sizes[i], kMax + 1));
        }
        // Files with all axes are slabs of the slowest one.
        const bool fits =
            own == count ? static_cast<std::uint64_t>(sizes.back()) % files == 0 : needed == files;
        if (!fits) {
            fields_.corrupt(fmt::format(
                "'data file' names {} files of {} axes, but 'sizes' needs {}", files, own,
                own == count    ? fmt::format("a divisor of {}", sizes.back())
                : needed > kMax ? fmt::format("more than {}", kMax)
                                : fmt::format("{}", needed)));
        }
        header.pieces = pieces->files;
    }

    /// The unit of the world's axes or, if they have none, of the volume's. A list of another
    /// length is ignored.
    CommonUnit read_unit(NrrdHeader& header, const std::vector<std::size_t>& axes,
                         std::size_t count) const {
        AxisUnits units;
        if (const auto space = fields_.quoted("space units"); !space.empty()) {
            std::copy_n(space.begin(), std::min<std::size_t>(space.size(), 3), units.begin());
        } else if (const auto each = fields_.quoted("units"); each.size() == count) {
            for (std::size_t a = 0; a < axes.size(); ++a) {
                units.at(a) = counted_unit(header.layout.nodes[static_cast<int>(a)], each[axes[a]]);
            }
        }
        CommonUnit unit = common_unit(units);
        header.layout.unit = unit.unit;
        header.notes = unit.notes;
        return unit;
    }

    /// `axes`: which of the file's axes are the volume's. `at`: the position on each of the file's
    /// axes.
    void read_geometry(NrrdHeader& header, const std::vector<std::size_t>& axes,
                       const std::vector<std::int64_t>& at) {
        const std::size_t count = at.size();
        RawLayout& layout = header.layout;
        const CommonUnit unit = read_unit(header, axes, count);
        constexpr double kUnknown = std::numeric_limits<double>::quiet_NaN();
        Double3 steps{kUnknown, kUnknown, kUnknown};
        const bool directed = fields_.find("space directions") != nullptr;
        if (directed) {
            layout.frame = read_space();
        }
        const auto spacing = per_axis("spacings", count);
        for (std::size_t a = 0; a < axes.size() && !spacing.empty(); ++a) {
            steps.at(a) = unit.converted(a, spacing[axes[a]]);
        }
        if (directed) {
            auto vectors = converted_vectors("space directions", unit);
            if (vectors.size() != count) {
                fields_.corrupt("'space directions' and 'sizes' do not agree");
            }
            for (std::size_t i = 0; i < spacing.size(); ++i) {
                if (!vectors[i].empty() && !std::isnan(spacing[i])) {
                    fields_.corrupt(
                        fmt::format("axis {} has both 'spacings' and 'space directions'", i));
                }
            }
            take_off_space(axes, vectors, header, steps);
            header.oblique = !along_axes(layout.nodes, axes, vectors, steps);
            for (std::size_t a = 0; a < axes.size(); ++a) {
                const std::vector<double>& v = vectors[axes[a]];
                std::copy_n(v.begin(), std::min<std::size_t>(v.size(), 3),
                            header.steps.at(a).begin());
            }
        }
        std::array<bool, 3> assumed{};
        if (!directed) {
            assumed = read_axis_ends(layout, axes, count, unit, steps);
        }
        for (std::size_t a = 0; a < 3; ++a) {
            header.said.at(a) = (!std::isnan(steps.at(a)) && !assumed.at(a)) ||
                                header.steps.at(a) != Double3{0, 0, 0};
        }
        for (std::size_t a = 0; a < 3 && spacing_; ++a) {
            steps.at(a) = std::copysign((*spacing_).at(a), steps.at(a) < 0 ? -1.0 : 1.0);
        }
        if (fields_.find("space origin") != nullptr) {
            read_origin(layout, unit);
        }
        if (directed) {
            move_origin(converted_vectors("space directions", unit), at, layout);
        }
        for (std::size_t a = 0; a < 3; ++a) {
            const double step = std::isnan(steps.at(a)) ? 1 : steps.at(a);
            layout.spacing[a] = std::fabs(step);
            header.backward.at(a) = step < 0;
            if (header.backward.at(a)) {
                const std::int64_t last = layout.nodes[static_cast<int>(a)] - 1;
                layout.origin[a] += step * static_cast<double>(last);
            }
        }
    }

    /// An axis whose direction has no component in the world's first three axes, like the time in a
    /// four-dimensional world, only has a spacing.
    static void take_off_space(const std::vector<std::size_t>& axes,
                               std::vector<std::vector<double>>& vectors, NrrdHeader& header,
                               Double3& steps) {
        for (std::size_t a = 0; a < axes.size(); ++a) {
            std::vector<double>& v = vectors[axes[a]];
            if (v.size() > 3 && v[0] == 0 && v[1] == 0 && v[2] == 0 && v[3] != 0) {
                steps.at(a) = std::fabs(v[3]);
                v.clear();
                header.no_space.at(a) = true;
            }
        }
    }

    /// Moves the origin to the positions chosen on the other axes.
    static void move_origin(const std::vector<std::vector<double>>& vectors,
                            const std::vector<std::int64_t>& at, RawLayout& layout) {
        for (std::size_t i = 0; i < at.size(); ++i) {
            for (std::size_t w = 0; w < std::min<std::size_t>(vectors[i].size(), 3); ++w) {
                if (at[i] != 0) {
                    layout.origin.at(w) += vectors[i][w] * static_cast<double>(at[i]);
                }
            }
        }
    }

    /// Of the spaces in teem, with and without time, three define the orientation of a patient. LAS
    /// is read as RAS with x reversed. Axes of a volume only have a direction in space if there are
    /// 'space directions'.
    [[nodiscard]] AnatomicalFrame read_space() {
        const std::string* const field = fields_.find("space");
        std::string space = field == nullptr ? "" : lower(*field);
        std::erase_if(space, [](char c) { return c == '-' || c == ' '; });
        const auto is = [&space](const std::string& words, const std::string& letters) {
            return space == words || space == words + "time" || space == letters ||
                   space == letters + "t";
        };
        mirrored_ = is("leftanteriorsuperior", "las");
        return mirrored_ || is("rightanteriorsuperior", "ras") ? AnatomicalFrame::ras
               : is("leftposteriorsuperior", "lps")            ? AnatomicalFrame::lps
                                                               : AnatomicalFrame::unknown;
    }

    /// Vectors in the world, converted to its common unit.
    [[nodiscard]] std::vector<std::vector<double>> converted_vectors(const char* field,
                                                                     const CommonUnit& unit) const {
        auto vectors = fields_.vectors(field);
        for (std::vector<double>& v : vectors) {
            for (std::size_t w = 0; w < std::min<std::size_t>(v.size(), 3); ++w) {
                v[w] = unit.converted(w, v[w]);
            }
            if (mirrored_ && !v.empty()) {
                v[0] = 0 - v[0];
            }
        }
        return vectors;
    }

    void read_origin(RawLayout& layout, const CommonUnit& unit) const {
        const auto origin = converted_vectors("space origin", unit);
        if (origin.size() != 1 || origin[0].empty()) {
            fields_.corrupt("'space origin' is not one vector");
        }
        for (std::size_t a = 0; a < std::min<std::size_t>(origin[0].size(), 3); ++a) {
            layout.origin[a] = std::isnan(origin[0][a]) ? 0 : origin[0][a];
        }
    }

    /// Sets the steps along the world's axes and returns true if these alone place all nodes less
    /// than a tenth of a voxel from where the directions place them. Otherwise leaves the steps
    /// unchanged.
    static bool along_axes(const Int3& nodes, const std::vector<std::size_t>& axes,
                           const std::vector<std::vector<double>>& vectors, Double3& steps) {
        constexpr double kMaxShift = 0.1;
        Double3 found = steps;
        Double3 voxel{HUGE_VAL, HUGE_VAL, HUGE_VAL};
        for (std::size_t a = 0; a < axes.size(); ++a) {
            const std::vector<double>& v = vectors[axes[a]];
            if (v.empty()) {
                continue;  // none
            }
            double length = 0;
            for (const double component : v) {
                length = std::hypot(length, component);
            }
            if (a >= v.size() || !(length > 0) || !std::isfinite(length)) {
                return false;
            }
            found.at(a) = std::copysign(length, v[a]);
            voxel.at(a) = length;
        }
        const double least = std::min({voxel[0], voxel[1], voxel[2]});
        for (std::size_t world = 0;; ++world) {
            double shift = 0;
            bool there = world < 3;
            for (std::size_t a = 0; a < axes.size(); ++a) {
                const std::vector<double>& v = vectors[axes[a]];
                if (world < v.size()) {
                    there = true;
                    const double along = world == a ? found.at(a) : 0;
                    const auto cells = std::max<std::int64_t>(nodes[static_cast<int>(a)] - 1, 1);
                    shift += std::fabs(v[world] - along) * static_cast<double>(cells);
                }
            }
            if (!there) {
                break;
            }
            const double size = world < 3 && voxel.at(world) < HUGE_VAL ? voxel.at(world) : least;
            if (!(shift < kMaxShift * size)) {
                return false;
            }
        }
        steps = found;
        return true;
    }

    /// A word of the field for each of the file's axes; empty words if there is no such field.
    [[nodiscard]] std::vector<std::string> words_per_axis(const char* field,
                                                          std::size_t count) const {
        std::vector<std::string> out = fields_.words(field);
        out.resize(fields_.find(field) == nullptr ? count : out.size());
        if (out.size() != count) {
            fields_.corrupt(fmt::format("'{}' and 'sizes' do not agree", field));
        }
        return out;
    }

    /// A number of the field for each of the file's axes; empty if there is no such field.
    [[nodiscard]] std::vector<double> per_axis(const char* field, std::size_t count) const {
        std::vector<double> out = fields_.numbers(field);
        if (fields_.find(field) != nullptr && out.size() != count) {
            fields_.corrupt(fmt::format("'{}' and 'sizes' do not agree", field));
        }
        return out;
    }

    /// The first sample is at the axis' minimum or, if samples are centres of cells, half a step
    /// from it. An axis without centering is taken as cells, like in ITK and VTK. Returns the axes
    /// that have a minimum but no step.
    std::array<bool, 3> read_axis_ends(RawLayout& layout, const std::vector<std::size_t>& axes,
                                       std::size_t count, const CommonUnit& unit,
                                       Double3& steps) const {
        std::array<bool, 3> assumed{};
        std::vector<double> mins = per_axis("axis mins", count);
        std::vector<double> maxs = per_axis("axis maxs", count);
        for (std::size_t a = 0; a < axes.size(); ++a) {
            for (std::vector<double>* const ends : {&mins, &maxs}) {
                if (!ends->empty()) {
                    (*ends)[axes[a]] = unit.converted(a, (*ends)[axes[a]]);
                }
            }
        }
        const std::vector<std::string> centers = words_per_axis("centers", count);
        for (std::size_t a = 0; a < axes.size() && !mins.empty(); ++a) {
            const std::size_t axis = axes[a];
            if (std::isnan(mins[axis])) {
                continue;
            }
            const bool nodes = centers[axis] == "node";
            const std::int64_t cells = layout.nodes[static_cast<int>(a)] - (nodes ? 1 : 0);
            if (std::isnan(steps.at(a)) && !maxs.empty() && cells > 0) {
                steps.at(a) = (maxs[axis] - mins[axis]) / static_cast<double>(cells);
            }
            assumed.at(a) = std::isnan(steps.at(a));
            steps.at(a) = assumed.at(a) ? 1 : steps.at(a);
            if (spacing_) {
                steps.at(a) = std::copysign((*spacing_).at(a), steps.at(a));
            }
            layout.origin[a] = mins[axis] + (nodes ? 0 : steps.at(a) / 2);
        }
        return assumed;
    }

    [[nodiscard]] NrrdEncoding encoding_of(const std::string& word) const {
        using Entry = std::pair<const char*, NrrdEncoding>;
        constexpr std::array<Entry, 9> kNames{{{"raw", NrrdEncoding::raw},
                                               {"gzip", NrrdEncoding::gzip},
                                               {"gz", NrrdEncoding::gzip},
                                               {"bzip2", NrrdEncoding::bzip2},
                                               {"bz2", NrrdEncoding::bzip2},
                                               {"text", NrrdEncoding::text},
                                               {"txt", NrrdEncoding::text},
                                               {"ascii", NrrdEncoding::text},
                                               {"hex", NrrdEncoding::hex}}};
        const auto* const found = std::find_if(
            kNames.begin(), kNames.end(), [&](const Entry& entry) { return word == entry.first; });
        if (found == kNames.end()) {
            fields_.unsupported(
                fmt::format("encoding '{}' is not supported; raw, gzip, bzip2, text and hex are; "
                            "convert the file with: unu save -f nrrd -e gzip",
                            word));
        }
        return found->second;
    }

    void read_encoding(NrrdHeader& header) const {
        RawLayout& layout = header.layout;
        header.encoding = encoding_of(lower(fields_.require("encoding")));
        layout.packing = header.encoding == NrrdEncoding::gzip ? Packing::gzip : Packing::plain;
        layout.exact_length = false;
        if (size_of(layout.type) > 1 && header.encoding != NrrdEncoding::text) {
            const std::string endian = lower(fields_.require("endian"));
            if (endian != "little" && endian != "big") {
                fields_.corrupt(fmt::format("endian must be little or big, not '{}'", endian));
            }
            layout.big_endian = endian == "big";
        }
        layout.lines = static_cast<std::uint64_t>(skip("line skip", 0));
        const std::int64_t bytes = skip("byte skip", -1);
        layout.offset_from_end = bytes < 0;
        layout.offset = static_cast<std::uint64_t>(std::max<std::int64_t>(bytes, 0));
        const std::string* const file = fields_.find("data file");
        if (file != nullptr) {
            if (file->empty()) {
                fields_.corrupt("'data file' names no file");
            }
            header.data_file = *file;
        } else if (fields_.bytes() == 0) {
            fields_.corrupt("no empty line ends the header, and there is no 'data file'");
        }
        header.header_bytes = fields_.bytes();
    }

    /// 0 if there is no such field.
    [[nodiscard]] std::int64_t skip(const char* field, std::int64_t least) const {
        if (fields_.find(field) == nullptr) {
            return 0;
        }
        const std::vector<std::int64_t> skip = fields_.integers(field);
        if (skip.size() != 1 || skip[0] < least) {
            fields_.corrupt(fmt::format("'{}: {}' must be one number, at least {}", field,
                                        *fields_.find(field), least));
        }
        return skip[0];
    }

    NrrdFields fields_;
    std::string name_;
    std::optional<Double3> spacing_;
    std::span<const AxisIndex> index_;
    bool mirrored_ = false;  ///< the world's x is reversed
};

}  // namespace

NrrdHeader parse_nrrd_header(std::string_view text, const std::string& name,
                             const std::optional<Double3>& spacing,
                             std::span<const AxisIndex> index) {
    if (!text.starts_with("NRRD000")) {
        throw Error(ErrorKind::corrupt, {name}, "not an NRRD file");
    }
    const std::string_view version = text.substr(0, text.find_first_of("\r\n"));
    if (version < "NRRD0001" || version > "NRRD0005") {
        throw Error(ErrorKind::unsupported, {name},
                    fmt::format("the version '{:.20}' is not supported; NRRD0001 to NRRD0005 are",
                                version));
    }
    return Parser(text, name, spacing, index).parse();
}

bool nrrd_header_ends(std::string_view text) {
    return text.find("\n\n") != std::string_view::npos ||
           text.find("\n\r\n") != std::string_view::npos;
}

}  // namespace isonest::detail
