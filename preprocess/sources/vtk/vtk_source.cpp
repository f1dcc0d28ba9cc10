#include <fmt/format.h>

#include <algorithm>
#include <charconv>
#include <cmath>
#include <map>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include <isonest/error.h>

#include "preprocess/sources/bytes/byte_reader.h"
#include "preprocess/sources/bytes/lower_case.h"
#include "preprocess/sources/bytes/regular_file.h"
#include "preprocess/sources/placement/placed_array.h"
#include "preprocess/sources/vtk/vtk_format.h"

namespace isonest::detail {
namespace {

bool is_vtk(const VolumeInput& input) {
    return input.head.starts_with("# vtk DataFile Version");
}

/// Words of the file's text from a place on, line by line.
class Lines {
  public:
    Lines(const InputFile& file, std::string name)
        : file_(file), name_(std::move(name)), size_(regular_file_size(file)) {}

    /// The words of the next line that has some; none at the end of the file.
    std::vector<std::string> next() {
        constexpr std::size_t kLongest = 4096;
        std::vector<std::string> words;
        while (words.empty() && at_ < size_) {
            const std::string part = first_bytes(file_, kLongest, at_);
            const std::size_t end = part.find('\n');
            if (end == std::string::npos && part.size() == kLongest) {
                throw Error(ErrorKind::corrupt, {name_, fmt::format("byte {}", at_)},
                            fmt::format("no line ends within {} bytes", kLongest));
            }
            const std::string line = part.substr(0, end);
            at_ += end == std::string::npos ? part.size() : end + 1;
            std::size_t from = 0;
            while ((from = line.find_first_not_of(" \t\r", from)) != std::string::npos) {
                const std::size_t to = std::min(line.find_first_of(" \t\r", from), line.size());
                words.push_back(line.substr(from, to - from));
                from = to;
            }
        }
        return words;
    }
    [[nodiscard]] std::uint64_t at() const { return at_; }
    void skip(std::uint64_t bytes) { at_ += std::min(bytes, size_ - at_); }

  private:
    const InputFile& file_;
    std::string name_;
    std::uint64_t size_;
    std::uint64_t at_ = 0;
};

struct Found {
    std::string name;
    std::string type;
    std::int64_t components = 1;
    std::uint64_t at = 0;
    bool of_cells = false;
};

const std::map<std::string, ValueType>& types() {
    static const std::map<std::string, ValueType> types{{"char", ValueType::i8},
                                                        {"signed_char", ValueType::i8},
                                                        {"unsigned_char", ValueType::u8},
                                                        {"short", ValueType::i16},
                                                        {"unsigned_short", ValueType::u16},
                                                        {"int", ValueType::i32},
                                                        {"unsigned_int", ValueType::u32},
                                                        {"float", ValueType::f32},
                                                        {"double", ValueType::f64}};
    return types;
}

class LegacyHeader {
  public:
    LegacyHeader(const InputFile& file, const std::string& wanted)
        : name_(file.name()), wanted_(wanted), lines_(file, name_) {
        lines_.next();
        // The title may be empty, which next() would skip: it is followed by ASCII or BINARY.
        std::vector<std::string> words = lines_.next();
        for (int i = 0; i < 2 && !is(words, "ascii") && !is(words, "binary"); ++i) {
            words = lines_.next();
        }
        text_ = is(words, "ascii");
        if (!text_ && !is(words, "binary")) {
            corrupt("neither ASCII nor BINARY");
        }
        while (!found_ && !(words = lines_.next()).empty()) {
            read(words);
        }
        if (!found_) {
            throw Error(ErrorKind::not_found, {name_},
                        fmt::format("there is no array '{}'; the file has:{}", wanted,
                                    list_.empty() ? " none" : list_),
                        {{RemedyKind::choose_dataset}});
        }
    }
    [[nodiscard]] const Found& found() const { return *found_; }
    [[nodiscard]] bool text() const { return text_; }
    [[nodiscard]] const std::array<double, 3>& dimensions() const { return dimensions_; }
    [[nodiscard]] const Double3& spacing() const { return spacing_; }
    [[nodiscard]] const Double3& origin() const { return origin_; }

  private:
    [[noreturn]] void corrupt(const std::string& what) const {
        throw Error(ErrorKind::corrupt, {name_, fmt::format("before byte {}", lines_.at())}, what);
    }
    static bool is(const std::vector<std::string>& words, const char* keyword) {
        return !words.empty() && lower(words[0]) == keyword;
    }
    [[nodiscard]] double number(const std::vector<std::string>& words, std::size_t i) const {
        double value = 0;
        if (i < words.size()) {
            const std::string& word = words[i];
            const auto [end, error] =
                std::from_chars(word.data(), word.data() + word.size(), value);
            if (error == std::errc{} && end == word.data() + word.size() && std::isfinite(value)) {
                return value;
            }
        }
        corrupt(fmt::format("{:.40}: number {} is missing", words[0], i));
    }
    [[nodiscard]] std::array<double, 3> three(const std::vector<std::string>& words) const {
        return {number(words, 1), number(words, 2), number(words, 3)};
    }
    [[nodiscard]] std::int64_t whole(const std::vector<std::string>& words, std::size_t i) const {
        const double value = number(words, i);
        if (value < 1 || value > 1e15 || value != std::floor(value)) {
            corrupt(fmt::format("{:.40}: {} is not possible", words[0], value));
        }
        return static_cast<std::int64_t>(value);
    }

    void read(const std::vector<std::string>& words) {
        const std::string keyword = lower(words[0]);
        if (keyword == "dataset") {
            if (words.size() < 2 || lower(words[1]) != "structured_points") {
                throw Error(ErrorKind::unsupported, {name_},
                            "it is no image: STRUCTURED_POINTS are read");
            }
            image_ = true;
        } else if (keyword == "dimensions") {
            for (std::size_t i = 1; i <= 3; ++i) {
                static_cast<void>(whole(words, i));
            }
            dimensions_ = three(words);
        } else if (keyword == "spacing" || keyword == "aspect_ratio") {
            spacing_ = three(words);
        } else if (keyword == "origin") {
            origin_ = three(words);
        } else if (keyword == "point_data" || keyword == "cell_data") {
            of_cells_ = keyword == "cell_data";
            values_ = whole(words, 1);
        } else if (keyword == "scalars" && words.size() >= 3) {
            read_scalars(words);
        } else if (keyword == "color_scalars" && words.size() >= 3) {
            // As VTK writes unsigned_char; in text they are fractions of 255.
            take({words[1], text_ ? "text of colours" : "unsigned_char", whole(words, 2),
                  lines_.at(), of_cells_},
                 values_);
        } else if (keyword == "field" && values_ > 0) {
            for (std::int64_t i = whole(words, 2); i > 0 && !found_; --i) {
                const std::vector<std::string> of = lines_.next();
                if (of.size() < 4) {
                    corrupt("an array of a field has no name, sizes and type");
                }
                take({of[0], lower(of[3]), whole(of, 1), lines_.at(), of_cells_}, whole(of, 2));
            }
        }
    }
    void read_scalars(const std::vector<std::string>& words) {
        const std::int64_t components = words.size() > 3 ? whole(words, 3) : 1;
        const std::uint64_t before = lines_.at();
        const std::vector<std::string> table = lines_.next();
        if (!is(table, "lookup_table")) {
            corrupt(fmt::format("no LOOKUP_TABLE line follows byte {}", before));
        }
        take({words[1], lower(words[2]), components, lines_.at(), of_cells_}, values_);
    }
    void take(const Found& array, std::int64_t tuples) {
        constexpr int kMostListed = 40;
        if (listed_++ < kMostListed) {
            list_ += fmt::format("\n  {:.80} {:.40}", array.name, array.type);
        }
        if (!image_) {
            corrupt("numbers come before DATASET");
        }
        if (wanted_.empty() || array.name == wanted_) {
            double values = 1;
            for (const double nodes : dimensions_) {
                values *= of_cells_ ? std::max(nodes - 1, 1.0) : nodes;
            }
            if (static_cast<double>(tuples) != values) {
                corrupt(fmt::format("'{:.80}' has {} values, but the image {} {}", array.name,
                                    tuples, values, of_cells_ ? "cells" : "points"));
            }
            found_ = array;
            return;
        }
        const auto type = types().find(array.type);
        if (text_ || type == types().end()) {
            throw Error(ErrorKind::unsupported, {name_},
                        fmt::format("arrays behind '{:.80}' cannot be found: it is text, or of "
                                    "another type",
                                    array.name));
        }
        lines_.skip(static_cast<std::uint64_t>(array.components) *
                    static_cast<std::uint64_t>(tuples) * size_of(type->second));
    }

    std::string name_;
    const std::string& wanted_;
    Lines lines_;
    bool text_ = false;
    bool image_ = false;
    bool of_cells_ = false;
    std::int64_t values_ = 0;
    std::array<double, 3> dimensions_{1, 1, 1};
    Double3 spacing_{1, 1, 1};
    Double3 origin_{0, 0, 0};
    std::string list_;
    int listed_ = 0;
    std::optional<Found> found_;
};

std::unique_ptr<VolumeSource> open_vtk(const VolumeInput& input, const SourceOptions& options) {
    const LegacyHeader header(input.file, options.dataset);
    const Found& found = header.found();
    PlacedArray array;
    array.file = input.file;
    array.name = input.name() + ":" + found.name;
    const bool wide = found.type == "long" || found.type == "vtktypeint64" ||
                      found.type == "unsigned_long" || found.type == "vtktypeuint64";
    if (const auto it = types().find(found.type); it != types().end()) {
        array.layout.type = it->second;
    } else if (wide && !header.text()) {
        array.stored = found.type == "long" || found.type == "vtktypeint64" ? StoredNumber::i64
                                                                            : StoredNumber::u64;
    } else {
        throw Error(ErrorKind::unsupported, {array.name},
                    fmt::format("numbers of type '{:.40}'", found.type));
    }
    constexpr std::array<const char*, 3> kNames{"x", "y", "z"};
    array.first = header.origin();
    for (std::size_t i = 3; i-- > 0;) {
        const auto nodes = static_cast<std::int64_t>(header.dimensions().at(i));
        const bool between = found.of_cells && nodes > 1;
        array.axes.push_back({kNames.at(i), between ? nodes - 1 : nodes, true});
        array.first.at(i) += between ? header.spacing().at(i) / 2 : 0;
        Double3 step{};
        step.at(i) = header.spacing().at(i);
        array.steps.push_back(step);
    }
    if (found.components > 1) {
        array.axes.push_back({"c", found.components, false});
        array.steps.push_back({0, 0, 0});
    }
    if (options.spacing) {
        array.steps.clear();
    }
    array.layout.exact_length = false;
    if (header.text()) {
        const std::uint64_t count = place_in_array(array.axes, options.index, array.name).whole;
        return open_placed(array, options.index,
                           text_numbers(array.file, found.at, array.layout.type, count));
    }
    array.layout.big_endian = true;
    array.layout.packing = Packing::plain;
    array.layout.offset = found.at;
    return open_placed(array, options.index);
}

}  // namespace

VolumeFormat vtk_format() {
    return {.about = {"VTK legacy image", ".vtk", ""},
            .takes = {.dataset = true, .index = true},
            .reads_urls = true,
            .recognises = is_vtk,
            .open = open_vtk};
}

}  // namespace isonest::detail
