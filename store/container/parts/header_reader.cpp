#include "store/container/parts/header_reader.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include <isonest/error.h>

#include "store/base/checksum.h"
#include "store/base/vectors.h"

namespace isonest::detail {

std::vector<double> flat_directions(const Directions& direction) {
    std::vector<double> numbers;
    for (const Double3& axis : direction) {
        numbers.insert(numbers.end(), axis.begin(), axis.end());
    }
    return numbers;
}

std::vector<double> rounding_numbers(const DataRounding& rounding) {
    return {rounding.tolerance, rounding.step};
}

std::uint64_t numbers_digest(const std::vector<double>& numbers) {
    Checksum sum;
    sum.add(std::as_bytes(std::span(numbers)));
    return sum.value();
}

std::uint64_t offsets_digest(const UnevenAxes& axes) {
    Checksum sum;
    for (const std::vector<double>& offsets : axes.offsets) {
        sum.add(std::as_bytes(std::span(offsets)));
    }
    return sum.value();
}

std::vector<double> position_numbers(const CurvedNodes& nodes) {
    std::vector<double> numbers;
    for (const Double3& three : {nodes.low, nodes.high, nodes.step}) {
        numbers.insert(numbers.end(), three.begin(), three.end());
    }
    return numbers;
}

std::vector<std::uint64_t> position_folds(const CurvedNodes& nodes) {
    const Int3& first = nodes.first_folded;
    return {nodes.mirrored ? std::uint64_t{1} : std::uint64_t{0}, nodes.folded,
            static_cast<std::uint64_t>(first.x), static_cast<std::uint64_t>(first.y),
            static_cast<std::uint64_t>(first.z)};
}

std::uint64_t positions_digest(const CurvedNodes& nodes) {
    const std::string_view type = name_of(nodes.type);
    const std::vector<double> numbers = position_numbers(nodes);
    const std::vector<std::uint64_t> folds = position_folds(nodes);
    Checksum sum;
    sum.add(std::as_bytes(std::span(type)));
    sum.add(std::as_bytes(std::span(numbers)));
    sum.add(std::as_bytes(std::span(folds)));
    return sum.value();
}

std::uint64_t direction_digest(const Directions& direction) {
    return numbers_digest(flat_directions(direction));
}

std::uint64_t text_digest(std::string_view text) {
    Checksum sum;
    sum.add(std::as_bytes(std::span(text.data(), text.size())));
    return sum.value();
}

namespace {

constexpr FormatVersion kNewest{kFormatMajor, kFormatMinor};
constexpr FormatVersion kOldest{1, 0};

class CatalogueAttributes : public RootGroup {
  public:
    explicit CatalogueAttributes(const Catalogue& catalogue) : catalogue_(catalogue) {}
    [[nodiscard]] std::optional<std::string> text(const char* name) const override {
        const CatalogueAttribute* const found = catalogue_.find(name);
        if (found == nullptr || found->kind != AttributeKind::text) {
            return std::nullopt;
        }
        std::string text(reinterpret_cast<const char*>(found->bytes.data()), found->bytes.size());
        text.resize(text.find_last_not_of('\0') + 1);
        return text;
    }
    [[nodiscard]] std::optional<std::vector<std::uint64_t>> integers(
        const char* name, std::size_t count) const override {
        const CatalogueAttribute* const found = catalogue_.find(name);
        if (found == nullptr) {
            return std::nullopt;
        }
        return found->kind == AttributeKind::u32 ? read<std::uint32_t, std::uint64_t>(*found, count)
               : found->kind == AttributeKind::u64
                   ? read<std::uint64_t, std::uint64_t>(*found, count)
                   : std::nullopt;
    }
    [[nodiscard]] std::optional<std::vector<double>> numbers(const char* name,
                                                             std::size_t count) const override {
        const CatalogueAttribute* const found = catalogue_.find(name);
        return found != nullptr && found->kind == AttributeKind::f64
                   ? read<double, double>(*found, count)
                   : std::nullopt;
    }
    [[nodiscard]] std::optional<std::uint64_t> digest() const override {
        Checksum sum;
        for (const char* const name : kDigested) {
            const CatalogueAttribute* const found = catalogue_.find(name);
            if (found == nullptr) {
                return std::nullopt;
            }
            sum.add(found->bytes);
        }
        return sum.value();
    }
    [[nodiscard]] bool has_label_names() const override { return catalogue_.names.has_value(); }

  private:
    template <class Stored, class T>
    static std::optional<std::vector<T>> read(const CatalogueAttribute& attribute,
                                              std::size_t count) {
        std::vector<Stored> stored(count);
        if (attribute.bytes.size() != count * sizeof(Stored)) {
            return std::nullopt;
        }
        std::memcpy(stored.data(), attribute.bytes.data(), attribute.bytes.size());
        return std::vector<T>(stored.begin(), stored.end());
    }

    const Catalogue& catalogue_;
};

class Reader {
  public:
    Reader(const RootGroup& root, const std::string& file) : root_(root), file_(file) {}

    RootAttributes read() {
        if (root_.text("format") != kFormatName) {
            throw Error(ErrorKind::invalid_argument, {file_}, "an HDF5 file, but not a store",
                        {{RemedyKind::make_store}});
        }
        read_version();
        read_flags();
        if (root_.integers("complete", 1) != std::vector<std::uint64_t>{1}) {
            throw Error(ErrorKind::corrupt, {file_}, "the store is incomplete",
                        {{RemedyKind::preprocess_again}});
        }
        require_digest();
        read_numbers_and_names();
        if (out_.version < FormatVersion{2, 0}) {
            require_volume();
        }
        out_.header.cube_ranges = out_.version >= FormatVersion{2, 2};
        out_.header.outward = out_.version >= FormatVersion{2, 3};
        return std::move(out_);
    }

  private:
    [[noreturn]] void damaged(const std::string& problem) const {
        throw Error(ErrorKind::corrupt, {file_, "header"}, problem, {{RemedyKind::good_copy}});
    }
    [[noreturn]] void unsupported(const std::string& problem, RemedyKind remedy) const {
        throw Error(ErrorKind::unsupported, {file_}, problem, {{remedy}});
    }

    void read_version() {
        const auto version = root_.integers("version", 2);
        if (!version) {
            damaged("no version");
        }
        out_.version = {(*version)[0], (*version)[1]};
        const FormatVersion& v = out_.version;
        if (v == kOldest || v.major == kFormatMajor) {
            return;
        }
        const bool newer = v > kNewest;
        unsupported(fmt::format("written in format version {}; this isonest reads {} and {}.x",
                                v.text(), kOldest.text(), kFormatMajor),
                    newer ? RemedyKind::newer_version : RemedyKind::preprocess_again);
    }

    void read_flags() {
        const auto flags = root_.integers("flags", 1);
        if (!flags) {
            damaged("no flags");
        }
        const std::uint64_t known =
            out_.version >= FormatVersion{2, 15}
                ? kHasDirection | kHasLabels | kIsSheared | kIsUneven | kIsCurved | kSkipsShuffle |
                      kIsRounded
            : out_.version >= FormatVersion{2, 14}
                ? kHasDirection | kHasLabels | kIsSheared | kIsUneven | kSkipsShuffle | kIsRounded
            : out_.version >= FormatVersion{2, 13}
                ? kHasDirection | kHasLabels | kIsSheared | kSkipsShuffle | kIsRounded
            : out_.version >= FormatVersion{2, 11} ? kHasDirection | kHasLabels | kIsSheared
            : out_.version >= FormatVersion{2, 6}  ? kHasDirection | kHasLabels
            : out_.version >= FormatVersion{2, 5}  ? kHasDirection
                                                   : 0;
        if (((*flags)[0] & ~known) != 0) {
            unsupported(fmt::format("reserved header flags are set ({:#x})", (*flags)[0]),
                        RemedyKind::newer_version);
        }
        turned_ = ((*flags)[0] & kHasDirection) != 0;
        sheared_ = ((*flags)[0] & kIsSheared) != 0;
        uneven_ = ((*flags)[0] & kIsUneven) != 0;
        curved_ = ((*flags)[0] & kIsCurved) != 0;
        out_.header.labels = ((*flags)[0] & kHasLabels) != 0;
        out_.header.skips_shuffle = ((*flags)[0] & kSkipsShuffle) != 0;
        rounded_ = ((*flags)[0] & kIsRounded) != 0;
    }

    void require_digest() const {
        if (out_.version < FormatVersion{2, 3}) {
            return;
        }
        const auto digest = root_.integers("xxh64", 1);
        if (!digest || root_.digest() != (*digest)[0]) {
            damaged("damaged: checksum mismatch: its attributes have changed");
        }
    }

    void read_numbers_and_names() {
        const auto nodes = root_.integers("nodes", 3);
        const auto spacing = root_.numbers("spacing", 3);
        const auto origin = root_.numbers("origin", 3);
        const auto type = root_.text("value_type");
        const auto known_type = type ? value_type_from_name(*type) : std::nullopt;
        const auto chunk = root_.integers("chunk", 1);
        const auto compression = root_.integers("compression", 1);
        const auto exact = root_.integers("exact", 1);
        const auto fields = root_.text("fields");
        const auto range = root_.numbers("range", 2);
        const auto missing = root_.integers("has_missing", 1);
        if (!nodes || !spacing || !origin || !known_type || !chunk || !compression || !exact ||
            !fields || !range || !missing || (*chunk)[0] > kMaxChunk) {
            damaged("damaged");
        }
        StoreHeader& header = out_.header;
        for (int axis = 0; axis < 3; ++axis) {
            const auto a = static_cast<std::size_t>(axis);
            header.nodes[axis] = static_cast<std::int64_t>((*nodes)[a]);
            header.spacing[a] = (*spacing)[a];
            header.origin[a] = (*origin)[a];
        }
        if (turned_) {
            read_direction();
        } else if (sheared_) {
            damaged("damaged: it has sheared axes, but no directions");
        }
        if (uneven_) {
            read_uneven_axes();
        }
        if (curved_) {
            read_curved_nodes();
        }
        if (out_.version >= FormatVersion{2, 7}) {
            read_unit();
        }
        if (out_.version >= FormatVersion{2, 10}) {
            read_frame();
        }
        if (rounded_) {
            read_rounding();
        }
        header.label_names = out_.version >= FormatVersion{2, 8} && root_.has_label_names();
        header.type = *known_type;
        if (header.labels && header.type != ValueType::f64) {
            damaged("damaged: 64-bit labels must be stored as float64");
        }
        header.chunk = static_cast<int>((*chunk)[0]);
        header.compression = static_cast<int>(std::min<std::uint64_t>((*compression)[0], 100));
        header.exact = (*exact)[0] != 0;
        read_fields(*fields);
        out_.range = {(*range)[0], (*range)[1]};
        out_.has_missing = (*missing)[0];
    }

    void read_direction() {
        const auto numbers = root_.numbers("direction", 9);
        const auto digest = root_.integers("direction_xxh64", 1);
        Directions& direction = out_.header.direction;
        for (std::size_t i = 0; numbers && i < 9; ++i) {
            direction.at(i / 3).at(i % 3) = (*numbers)[i];
        }
        if (!numbers || !digest || direction_digest(direction) != (*digest)[0] ||
            !why_no_directions(out_.header.nodes, direction).empty() ||
            are_directions(direction) == sheared_ || direction == kAlongWorld) {
            damaged("damaged: checksum mismatch: its directions have changed");
        }
    }

    void read_uneven_axes() {
        const StoreHeader& header = out_.header;
        const auto digest = root_.integers("offsets_xxh64", 1);
        auto axes = std::make_shared<UnevenAxes>();
        for (std::size_t a = 0; a < 3; ++a) {
            const auto count = static_cast<std::uint64_t>(header.nodes[static_cast<int>(a)]);
            if (count <= kMaxUnevenNodes) {
                axes->offsets.at(a) = root_.numbers(kOffsets.at(a), static_cast<std::size_t>(count))
                                          .value_or(std::vector<double>());
            }
        }
        out_.header.uneven = std::move(axes);
        if (!digest || offsets_digest(*header.uneven) != (*digest)[0] ||
            !why_not_uneven(header.nodes, header.spacing, header.origin, header.direction,
                            header.uneven)
                 .empty()) {
            damaged("damaged: its uneven axes have changed");
        }
    }

    void read_curved_nodes() {
        const auto type = root_.text("position_type");
        const auto known = type ? value_type_from_name(*type) : std::nullopt;
        const auto numbers = root_.numbers("position_numbers", 9);
        const auto folds = root_.integers("position_folds", 5);
        const auto digest = root_.integers("position_xxh64", 1);
        CurvedNodes nodes;
        bool good = known && numbers && folds && digest && !turned_ && !uneven_;
        if (good) {
            nodes.type = *known;
            for (std::size_t a = 0; a < 3; ++a) {
                nodes.low.at(a) = (*numbers)[a];
                nodes.high.at(a) = (*numbers)[3 + a];
                nodes.step.at(a) = (*numbers)[6 + a];
                nodes.first_folded[static_cast<int>(a)] =
                    static_cast<std::int64_t>((*folds)[2 + a]);
                good = good && nodes.low.at(a) <= nodes.high.at(a) && nodes.step.at(a) > 0 &&
                       std::isfinite(nodes.step.at(a)) && nodes.low.at(a) >= -kMaxPosition &&
                       nodes.high.at(a) <= kMaxPosition;
            }
            nodes.mirrored = (*folds)[0] == 1;
            nodes.folded = (*folds)[1];
        }
        if (!good || positions_digest(nodes) != (*digest)[0]) {
            damaged("damaged: what it says of the positions of the nodes has changed");
        }
        out_.header.curved = std::make_shared<const CurvedNodes>(nodes);
    }

    /// Newer versions may know more units.
    void read_unit() {
        const auto symbol = root_.text("unit");
        const auto digest = root_.integers("unit_xxh64", 1);
        if (!symbol && !digest) {
            return;
        }
        const auto units = length_units();
        const auto found = std::find_if(units.begin(), units.end(), [&](const LengthUnitInfo& u) {
            return symbol && u.symbol == *symbol;
        });
        if (!symbol || !digest || text_digest(*symbol) != (*digest)[0] ||
            (found == units.end() && out_.version <= kNewest)) {
            damaged("damaged: checksum mismatch: its unit of length has changed");
        }
        if (found != units.end()) {
            out_.header.unit = found->unit;
        }
    }

    /// Newer versions may know more frames.
    void read_frame() {
        const auto name = root_.text("frame");
        const auto digest = root_.integers("frame_xxh64", 1);
        if (!name && !digest) {
            return;
        }
        const auto frame = name ? frame_from(*name) : std::nullopt;
        if (!name || !digest || text_digest(*name) != (*digest)[0] ||
            (!frame && out_.version <= kNewest)) {
            damaged("damaged: checksum mismatch: its anatomical frame has changed");
        }
        out_.header.frame = frame.value_or(AnatomicalFrame::unknown);
    }

    void read_rounding() {
        const auto numbers = root_.numbers("tolerance", 2);
        const auto digest = root_.integers("tolerance_xxh64", 1);
        const DataRounding read =
            numbers ? DataRounding{(*numbers)[0], (*numbers)[1]} : DataRounding{};
        if (!numbers || !digest || numbers_digest(*numbers) != (*digest)[0] ||
            !std::isfinite(read.step) || !(read.tolerance > 0) || !(read.tolerance <= read.step)) {
            damaged("damaged: checksum mismatch: its tolerance has changed");
        }
        out_.header.rounding = read;
    }

    /// Names added by a newer minor version follow all older ones, so that the rows of the known
    /// fields in the chunk table are known. Their number is limited, so that the rows can be
    /// counted in 64 bits.
    void read_fields(const std::string& names) {
        constexpr std::size_t kMaxUnknown = 64;
        StoreHeader& header = out_.header;
        for (std::size_t at = 0; at < names.size();) {
            const std::size_t end = std::min(names.find(',', at), names.size());
            const std::string name = names.substr(at, end - at);
            // Names of own indicators are kept by the process, so there is a limit on them.
            const bool refused =
                name.starts_with(kOwnPrefix) &&
                (out_.version < FormatVersion{2, 12} || !header.unknown_fields.empty() ||
                 std::count_if(header.fields.begin(), header.fields.end(), is_own) ==
                     2 * kMaxOwnIndicators);
            const auto field = refused ? std::nullopt : field_from_stored_name(name);
            if (field && *field != Field::values && header.unknown_fields.empty()) {
                if (!header.fields.empty() && is_own(header.fields.back()) &&
                    !precedes(header.fields.back(), *field)) {
                    damaged("damaged: the own indicators are not sorted");
                }
                header.fields.push_back(*field);
            } else if (!field && out_.version > kNewest) {
                if (header.unknown_fields.size() == kMaxUnknown) {
                    unsupported(fmt::format("more than {} unknown fields", kMaxUnknown),
                                RemedyKind::newer_version);
                }
                header.unknown_fields.push_back(name);
            } else {
                unsupported(
                    fmt::format("{} '{}'", field ? "misplaced field" : "unknown field", name),
                    RemedyKind::newer_version);
            }
            at = end + 1;
        }
    }

    /// Slots and saturation for flat axes were introduced in version 2.0.
    void require_volume() const {
        const Int3& n = out_.header.nodes;
        if (n.x == 1 || n.y == 1 || n.z == 1) {
            unsupported(fmt::format("written in format version {}, in which planar data ({} x {} x "
                                    "{}) had different indicators",
                                    out_.version.text(), n.x, n.y, n.z),
                        RemedyKind::preprocess_again);
        }
    }

    const RootGroup& root_;
    const std::string& file_;
    bool turned_ = false;   ///< the axes are not parallel to the world's
    bool sheared_ = false;  ///< the axes are not at right angles
    bool uneven_ = false;   ///< some axes are uneven
    bool curved_ = false;   ///< each node has a position of its own
    bool rounded_ = false;  ///< the values were rounded
    RootAttributes out_;
};

}  // namespace

RootAttributes read_root_attributes(const RootGroup& root, const std::string& file) {
    return Reader(root, file).read();
}

RootAttributes read_root_attributes(const Catalogue& catalogue, const std::string& file) {
    return read_root_attributes(CatalogueAttributes(catalogue), file);
}

}  // namespace isonest::detail
