#include "preprocess/nrrd_header.h"

#include <fmt/format.h>

#include <algorithm>
#include <charconv>
#include <cmath>
#include <iterator>
#include <limits>
#include <map>
#include <sstream>
#include <vector>

#include "store/error.h"

namespace isonest {
namespace {

std::string_view trim(std::string_view s) {
    const auto from = s.find_first_not_of(" \t\r");
    const auto to = s.find_last_not_of(" \t\r");
    return from == std::string_view::npos ? std::string_view{} : s.substr(from, to - from + 1);
}

std::string lower(std::string_view s) {
    std::string out(s);
    std::transform(out.begin(), out.end(), out.begin(),
                   [](unsigned char c) { return static_cast<char>(std::tolower(c)); });
    return out;
}

/// All numbers in a text, whatever separates them; "none" counts as no number.
std::vector<double> numbers(std::string_view s) {
    std::vector<double> out;
    for (std::size_t i = 0; i < s.size();) {
        double value = 0;
        const auto [end, error] = std::from_chars(s.data() + i, s.data() + s.size(), value);
        if (error == std::errc{}) {
            out.push_back(value);
            i = static_cast<std::size_t>(end - s.data());
        } else {
            ++i;
        }
        if (out.size() > 64) {
            break;
        }
    }
    return out;
}

class Parser {
  public:
    Parser(std::string_view text, const std::string& name) : text_(text), name_(name) {}

    NrrdHeader parse() {
        split();
        NrrdHeader header;
        read_type(header);
        read_axes(header);
        read_encoding(header);
        return header;
    }

  private:
    [[noreturn]] void corrupt(const std::string& what) const {
        throw Error(ErrorKind::corrupt, fmt::format("{}: NRRD header: {}", name_, what));
    }
    [[noreturn]] void unsupported(const std::string& what) const {
        throw Error(ErrorKind::unsupported, fmt::format("{}: NRRD header: {}", name_, what));
    }
    [[nodiscard]] const std::string* find(const char* key) const {
        const auto it = fields_.find(key);
        return it == fields_.end() ? nullptr : &it->second;
    }
    [[nodiscard]] const std::string& require(const char* key) const {
        const std::string* const value = find(key);
        if (value == nullptr) {
            corrupt(fmt::format("there is no field '{}'", key));
        }
        return *value;
    }

    void split() {
        std::size_t at = 0;
        bool first = true;
        while (true) {
            const std::size_t end = text_.find('\n', at);
            if (end == std::string_view::npos) {
                if (at < text_.size()) {
                    add(trim(text_.substr(at)));
                }
                bytes_ = text_.size();
                break;
            }
            const std::string_view line = trim(text_.substr(at, end - at));
            at = end + 1;
            if (first) {
                first = false;
                continue;
            }
            if (line.empty()) {
                bytes_ = at;
                break;
            }
            add(line);
        }
    }
    void add(std::string_view line) {
        const std::size_t colon = line.find(": ");
        if (line.empty() || line[0] == '#' || colon == std::string_view::npos) {
            return;  // comments, key:=value pairs and unknown lines carry nothing for us
        }
        std::string key = lower(trim(line.substr(0, colon)));
        std::erase(key, ' ');
        fields_[key] = std::string(trim(line.substr(colon + 2)));
    }

    void read_type(NrrdHeader& header) const {
        const std::string type = lower(require("type"));
        static const std::map<std::string, ValueType> types{{"signed char", ValueType::i8},
                                                            {"int8", ValueType::i8},
                                                            {"int8_t", ValueType::i8},
                                                            {"char", ValueType::i8},
                                                            {"uchar", ValueType::u8},
                                                            {"unsigned char", ValueType::u8},
                                                            {"uint8", ValueType::u8},
                                                            {"uint8_t", ValueType::u8},
                                                            {"short", ValueType::i16},
                                                            {"short int", ValueType::i16},
                                                            {"signed short", ValueType::i16},
                                                            {"signed short int", ValueType::i16},
                                                            {"int16", ValueType::i16},
                                                            {"int16_t", ValueType::i16},
                                                            {"ushort", ValueType::u16},
                                                            {"unsigned short", ValueType::u16},
                                                            {"unsigned short int", ValueType::u16},
                                                            {"uint16", ValueType::u16},
                                                            {"uint16_t", ValueType::u16},
                                                            {"int", ValueType::i32},
                                                            {"signed int", ValueType::i32},
                                                            {"int32", ValueType::i32},
                                                            {"int32_t", ValueType::i32},
                                                            {"uint", ValueType::u32},
                                                            {"unsigned int", ValueType::u32},
                                                            {"uint32", ValueType::u32},
                                                            {"uint32_t", ValueType::u32},
                                                            {"float", ValueType::f32},
                                                            {"double", ValueType::f64}};
        const auto it = types.find(type);
        if (it == types.end()) {
            unsupported(fmt::format(
                "type '{}': integers of 8 to 32 bits, float and double are read", type));
        }
        header.layout.type = it->second;
    }

    void read_axes(NrrdHeader& header) const {
        const std::vector<double> sizes = numbers(require("sizes"));
        const std::vector<double> dimension = numbers(require("dimension"));
        if (dimension.size() != 1 || sizes.empty() ||
            dimension[0] != static_cast<double>(sizes.size())) {
            corrupt("'dimension' and 'sizes' do not agree");
        }
        for (const double s : sizes) {
            if (!(s >= 1) || s > 1e15 || s != std::floor(s)) {
                corrupt("'sizes' must be positive whole numbers");
            }
        }
        std::vector<std::size_t> axes;
        for (std::size_t i = 0; i < sizes.size(); ++i) {
            if (sizes.size() <= 3 || sizes[i] != 1) {
                axes.push_back(i);
            }
        }
        if (axes.size() > 3) {
            unsupported(fmt::format("{} axes: volumes of one scalar on at most 3 axes are read",
                                    axes.size()));
        }
        for (std::size_t a = 0; a < axes.size(); ++a) {
            header.layout.nodes[static_cast<int>(a)] = static_cast<std::int64_t>(sizes[axes[a]]);
        }
        read_geometry(header, axes, sizes.size());
    }

    /// `axes`: which of the file's `count` axes are the volume's.
    void read_geometry(NrrdHeader& header, const std::vector<std::size_t>& axes,
                       std::size_t count) const {
        RawLayout& layout = header.layout;
        constexpr double kUnknown = std::numeric_limits<double>::quiet_NaN();
        std::array<double, 3> steps{kUnknown, kUnknown, kUnknown};
        if (const auto spacing = per_axis("spacings", count); !spacing.empty()) {
            for (std::size_t a = 0; a < axes.size(); ++a) {
                const double s = spacing[axes[a]];
                steps.at(a) = !std::isfinite(s) ? kUnknown : s != 0 ? s : 1;
            }
        } else if (const std::string* const directions = find("spacedirections")) {
            const auto vectors = read_vectors(*directions);
            if (vectors.size() != count) {
                corrupt("'space directions' and 'sizes' do not agree");
            }
            for (std::size_t a = 0; a < axes.size(); ++a) {
                const std::vector<double>& v = vectors[axes[a]];
                if (v.empty()) {
                    continue;  // none
                }
                double squares = 0;
                for (const double component : v) {
                    squares += component * component;
                }
                const double length = std::sqrt(squares);
                if (a >= v.size() || !(length > 0) || !std::isfinite(length) ||
                    std::fabs(v[a]) < length * (1 - 1e-6)) {
                    header.oblique = true;
                    return;
                }
                steps.at(a) = std::copysign(length, v[a]);
            }
        }
        if (find("spacedirections") == nullptr) {
            read_axis_ends(layout, axes, count, steps);
        }
        if (const std::string* const text = find("spaceorigin")) {
            const std::vector<double> origin = numbers(*text);
            for (std::size_t a = 0; a < std::min<std::size_t>(origin.size(), 3); ++a) {
                layout.origin[a] = std::isfinite(origin[a]) ? origin[a] : 0;
            }
        }
        for (std::size_t a = 0; a < 3; ++a) {
            const double step = std::isfinite(steps.at(a)) ? steps.at(a) : 1;
            layout.spacing[a] = std::fabs(step);
            header.backward.at(a) = step < 0;
            if (header.backward.at(a)) {
                const std::int64_t last = layout.nodes[static_cast<int>(a)] - 1;
                layout.origin[a] += step * static_cast<double>(last);
            }
        }
    }

    /// A number of the field for each of the file's axes; none if there is no such field.
    [[nodiscard]] std::vector<double> per_axis(const std::string& field, std::size_t count) const {
        std::string key = field;
        std::erase(key, ' ');
        const std::string* const text = find(key.c_str());
        std::vector<double> out = text == nullptr ? std::vector<double>{} : numbers(*text);
        if (text != nullptr && out.size() != count) {
            corrupt(fmt::format("'{}' and 'sizes' do not agree", field));
        }
        return out;
    }

    /// The first sample lies at an axis' minimum or, where samples are the middles of cells, half a
    /// step from it. An axis that does not say so is taken for one of cells, as ITK and VTK do.
    void read_axis_ends(RawLayout& layout, const std::vector<std::size_t>& axes, std::size_t count,
                        std::array<double, 3>& steps) const {
        const std::vector<double> mins = per_axis("axis mins", count);
        const std::vector<double> maxs = per_axis("axis maxs", count);
        const std::string* const text = find(find("centers") != nullptr ? "centers" : "centerings");
        const std::vector<std::string> centers =
            text == nullptr ? std::vector<std::string>(count) : words(lower(*text));
        if (centers.size() != count) {
            corrupt("'centers' and 'sizes' do not agree");
        }
        for (std::size_t a = 0; a < axes.size() && !mins.empty(); ++a) {
            const std::size_t axis = axes[a];
            if (!std::isfinite(mins[axis])) {
                continue;
            }
            const bool nodes = centers[axis] == "node";
            const auto cells =
                static_cast<double>(layout.nodes[static_cast<int>(a)] - (nodes ? 1 : 0));
            if (!std::isfinite(steps.at(a))) {
                const double step =
                    maxs.empty() || cells < 1 ? 0 : (maxs[axis] - mins[axis]) / cells;
                steps.at(a) = std::isfinite(step) && step != 0 ? step : 1;
            }
            layout.origin[a] = mins[axis] + (nodes ? 0 : steps.at(a) / 2);
        }
    }

    static std::vector<std::string> words(const std::string& text) {
        std::istringstream in(text);
        return {std::istream_iterator<std::string>(in), {}};
    }

    /// "none (1,0,0) (0,1,0)": the numbers of each, of none no number.
    static std::vector<std::vector<double>> read_vectors(std::string_view text) {
        std::vector<std::vector<double>> vectors;
        for (std::size_t i = 0; i < text.size() && vectors.size() <= 64;) {
            const std::size_t open = text.find_first_of("(nN", i);
            if (open == std::string_view::npos) {
                break;
            }
            const std::size_t end = text.find_first_of(text[open] == '(' ? ")" : " \t", open);
            const std::size_t length = end == std::string_view::npos ? end : end - open;
            vectors.push_back(text[open] == '(' ? numbers(text.substr(open, length))
                                                : std::vector<double>{});
            i = end == std::string_view::npos ? text.size() : end + 1;
        }
        return vectors;
    }

    void read_encoding(NrrdHeader& header) const {
        const std::string encoding = lower(require("encoding"));
        if (encoding == "gzip" || encoding == "gz") {
            header.gzip = true;
        } else if (encoding != "raw") {
            unsupported(fmt::format("encoding '{}': raw and gzip are read", encoding));
        }
        if (size_of(header.layout.type) > 1) {
            const std::string endian = lower(require("endian"));
            if (endian != "little" && endian != "big") {
                corrupt(fmt::format("endian '{}'", endian));
            }
            header.layout.big_endian = endian == "big";
        }
        for (const char* key : {"byteskip", "lineskip"}) {
            const std::string* const text = find(key);
            if (text == nullptr) {
                continue;
            }
            const std::vector<double> skip = numbers(*text);
            if (skip.size() != 1 || skip[0] != std::floor(skip[0]) || skip[0] < -1 ||
                skip[0] > 1e15) {
                corrupt(fmt::format("'{}: {}'", key, *text));
            }
            if (std::string_view(key) == "lineskip" && skip[0] != 0) {
                unsupported("'line skip'; use 'byte skip'");
            }
            header.byte_skip = static_cast<std::int64_t>(skip[0]);
        }
        const std::string* const file = find("datafile");
        if (file != nullptr) {
            if (file->starts_with("LIST") || file->find('%') != std::string::npos) {
                unsupported("data spread over several files; join them into one");
            }
            header.data_file = *file;
        }
        header.header_bytes = bytes_;
    }

    std::string_view text_;
    const std::string& name_;
    std::map<std::string, std::string> fields_;
    std::uint64_t bytes_ = 0;
};

}  // namespace

NrrdHeader parse_nrrd_header(std::string_view text, const std::string& name) {
    if (!text.starts_with("NRRD000")) {
        throw Error(ErrorKind::corrupt, name + ": not an NRRD file");
    }
    return Parser(text, name).parse();
}

}  // namespace isonest
