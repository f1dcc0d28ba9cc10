#include "preprocess/sources/wrapping/label_names.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <charconv>
#include <cmath>
#include <cstdint>
#include <map>
#include <span>
#include <sstream>
#include <string>
#include <string_view>
#include <utility>

#include <isonest/error.h>

#include "preprocess/sources/bytes/input_file.h"
#include "preprocess/sources/wrapping/wrapped_source.h"
#include "store/base/label_text.h"
#include "store/container/codec.h"

namespace isonest::detail {
namespace {

class NamedLabelsSource : public DescribedSource {
  public:
    NamedLabelsSource(std::unique_ptr<VolumeSource> inner, std::vector<LabelName> names,
                      std::filesystem::path table)
        : DescribedSource(std::move(inner)), names_(std::move(names)), table_(std::move(table)) {}
    [[nodiscard]] std::vector<LabelName> label_names() const override { return names_; }
    [[nodiscard]] std::string identity() const override {
        std::string all;
        for (const LabelName& label : names_) {
            const LabelColor color = label.color.value_or(LabelColor{});
            all += fmt::format("{} {} {} {} {} {}\n", label.id, label.color.has_value(), color[0],
                               color[1], color[2], label.name);
        }
        return identity_and(
            fmt::format("names of labels {:016x}", checksum_of(std::as_bytes(std::span(all)))));
    }
    [[nodiscard]] std::vector<std::filesystem::path> files() const override {
        std::vector<std::filesystem::path> all = inner_source().files();
        if (!table_.empty()) {
            all.push_back(table_);
        }
        return all;
    }
    /// A caller that asks for the names gets a copy.
    [[nodiscard]] std::uint64_t heap() const override {
        std::uint64_t bytes = inner_source().heap();
        for (const LabelName& label : names_) {
            bytes += 2 * (sizeof(LabelName) + label.name.size());
        }
        return bytes;
    }

  private:
    std::vector<LabelName> names_;
    std::filesystem::path table_;
};

}  // namespace

std::unique_ptr<VolumeSource> with_label_names(std::unique_ptr<VolumeSource> inner,
                                               std::vector<LabelName> names,
                                               const std::filesystem::path& table) {
    return names.empty()
               ? std::move(inner)
               : std::make_unique<NamedLabelsSource>(std::move(inner), std::move(names), table);
}

namespace {

class NotedSource : public DescribedSource {
  public:
    NotedSource(std::unique_ptr<VolumeSource> inner, std::vector<std::string> notes)
        : DescribedSource(std::move(inner)), notes_(std::move(notes)) {}
    [[nodiscard]] std::vector<std::string> notes() const override {
        std::vector<std::string> all = inner_source().notes();
        all.insert(all.end(), notes_.begin(), notes_.end());
        return all;
    }

  private:
    std::vector<std::string> notes_;
};

}  // namespace

std::unique_ptr<VolumeSource> with_notes(std::unique_ptr<VolumeSource> inner,
                                         std::vector<std::string> notes) {
    return notes.empty() ? std::move(inner)
                         : std::make_unique<NotedSource>(std::move(inner), std::move(notes));
}

namespace {

class TimedSource : public DescribedSource {
  public:
    TimedSource(std::unique_ptr<VolumeSource> inner, VolumeTime time)
        : DescribedSource(std::move(inner)), time_(std::move(time)) {}
    [[nodiscard]] VolumeDescription describe() const override {
        VolumeDescription result = inner_source().describe();
        result.time = time_;
        return result;
    }

  private:
    VolumeTime time_;
};

}  // namespace

std::unique_ptr<VolumeSource> with_time(std::unique_ptr<VolumeSource> inner, VolumeTime time) {
    return std::make_unique<TimedSource>(std::move(inner), std::move(time));
}

namespace {

/// Bytes per label besides its name: in the map, and in the returned list.
constexpr std::uint64_t kLabelHeap = 2 * sizeof(LabelName) + 64;

class LabelFile {
  public:
    LabelFile(const std::filesystem::path& path, std::uint64_t max_heap)
        : path_(path), left_(max_heap) {}

    std::vector<LabelName> read() {
        const std::uint64_t size = regular_file_size(path_);
        take_heap(size);
        std::string text = first_bytes(path_, static_cast<std::size_t>(size));
        constexpr std::string_view kByteOrderMark = "\xEF\xBB\xBF";
        if (text.starts_with(kByteOrderMark)) {
            text.erase(0, kByteOrderMark.size());
        }
        for (std::size_t at = 0; at < text.size();) {
            const std::size_t end = std::min(text.find('\n', at), text.size());
            ++number_;
            const std::string one = trimmed(text.substr(at, end - at));
            if (!one.empty() && one[0] != '#') {
                add(one);
            }
            at = end + 1;
        }
        std::vector<LabelName> all;
        all.reserve(labels_.size());
        for (auto& [id, label] : labels_) {
            all.push_back(std::move(label));
        }
        if (all.empty()) {
            throw Error(ErrorKind::corrupt, {path_.string()}, "the table has no labels");
        }
        return all;
    }

  private:
    void take_heap(std::uint64_t bytes) {
        if (bytes > left_) {
            throw Error(ErrorKind::limit, {path_.string()},
                        "the table of labels does not fit in memory", {{RemedyKind::more_memory}});
        }
        left_ -= bytes;
    }
    [[noreturn]] void fail(const std::string& what) const {
        throw Error(ErrorKind::corrupt, {path_.string(), fmt::format("line {}", number_)}, what);
    }
    [[noreturn]] void fail_form() const {
        fail(
            "not of the form 'ID NAME RED GREEN BLUE OPACITY', 'ID RED GREEN BLUE OPACITY VISIBLE "
            "MESH \"NAME\"' or 'ID NAME'");
    }

    std::int64_t whole(const std::string& word) const {
        std::int64_t value = 0;
        const auto [end, error] = std::from_chars(word.data(), word.data() + word.size(), value);
        if (error != std::errc{} || end != word.data() + word.size()) {
            fail(fmt::format("'{:.40}' is not a whole number", shown(word)));
        }
        return value;
    }
    /// Parses three words from number `first`.
    LabelColor color(const std::vector<std::string>& words, std::size_t first) const {
        constexpr std::int64_t kMax = 255;
        LabelColor color{};
        for (std::size_t i = 0; i < color.size(); ++i) {
            const std::int64_t part = whole(words[first + i]);
            if (part < 0 || part > kMax) {
                fail(fmt::format("a colour component must be from 0 to 255, not {}", part));
            }
            color.at(i) = static_cast<std::uint8_t>(part);
        }
        return color;
    }
    static std::string shown(const std::string& word) {
        return is_printable_utf8(word) ? word : "?";
    }

    void add(const std::string& line) {
        constexpr std::size_t kLongest = 4096;
        if (line.size() > kLongest) {
            fail_form();
        }
        const std::size_t quote = line.find('"');
        std::istringstream in(line.substr(0, quote));
        std::vector<std::string> words;
        for (std::string word; in >> word;) {
            words.push_back(word);
        }
        LabelName label;
        constexpr std::size_t kNumbersOfSnap = 7;
        if (quote != std::string::npos) {
            if (words.size() != kNumbersOfSnap || line.back() != '"' || line.size() < quote + 2) {
                fail_form();
            }
            label.name = trimmed(line.substr(quote + 1, line.size() - quote - 2));
            label.color = color(words, 1);
        } else if (words.size() == 2 || words.size() == 5 || words.size() == 6) {
            label.name = words[1];
            if (words.size() > 2) {
                label.color = color(words, 2);
            }
        } else {
            fail_form();
        }
        label.id = whole(words[0]);
        if (const std::string why = why_no_label_names({&label, 1}); !why.empty()) {
            fail(why);
        }
        if (labels_.size() >= LabelName::kMaxOfStore) {
            fail(fmt::format("the table has more than {} labels, which is the limit of a store",
                             LabelName::kMaxOfStore));
        }
        take_heap(kLabelHeap + label.name.size());
        const std::int64_t id = label.id;
        if (!labels_.emplace(id, std::move(label)).second) {
            fail(fmt::format("duplicate label {}", id));
        }
    }

    const std::filesystem::path& path_;
    std::uint64_t left_;      ///< remaining heap
    std::size_t number_ = 0;  ///< line number
    std::map<std::int64_t, LabelName> labels_;
};

}  // namespace

std::vector<LabelName> read_label_file(const std::filesystem::path& path, std::uint64_t max_heap) {
    return LabelFile(path, max_heap).read();
}

void FoundLabels::add(std::int64_t id, const std::string& name,
                      const std::optional<LabelColor>& color) {
    LabelName label{id, trimmed(name), color};
    if (label.name.empty() && !color) {
        return;
    }
    if (const std::string why = why_no_label_names({&label, 1}); !why.empty()) {
        leave_out(why);
        // The colour may be valid although the name is not.
        label.name.clear();
        if (!color || !why_no_label_names({&label, 1}).empty()) {
            return;
        }
    }
    if (labels_.size() >= LabelName::kMaxOfStore && labels_.count(id) == 0) {
        leave_out(fmt::format("label {}: a store has at most {} label names", id,
                              LabelName::kMaxOfStore));
        return;
    }
    LabelName& known = labels_[id];
    known.id = id;
    if ((!known.name.empty() && !label.name.empty()) || (known.color && label.color)) {
        leave_out(fmt::format("duplicate label {}", id));
        return;
    }
    known.name += label.name;
    known.color = label.color ? label.color : known.color;
}

void FoundLabels::leave_out(const std::string& what) {
    constexpr std::size_t kMaxSaid = 3;
    ++left_out_;
    if (first_.size() < kMaxSaid) {
        first_.push_back(what);
    }
}

std::vector<LabelName> FoundLabels::names() const {
    std::vector<LabelName> all;
    all.reserve(labels_.size());
    for (const auto& [id, label] : labels_) {
        all.push_back(label);
    }
    return all;
}

std::vector<std::string> FoundLabels::notes() const {
    if (left_out_ == 0) {
        return {};
    }
    return {fmt::format("of the label names and colours, {} {} left out: {}{}", left_out_,
                        left_out_ == 1 ? "entry is" : "entries are", fmt::join(first_, "; "),
                        left_out_ > first_.size() ? "; ..." : "")};
}

std::optional<LabelColor> color_of_parts(double red, double green, double blue) {
    constexpr double kMax = 255;
    LabelColor color{};
    std::size_t i = 0;
    for (const double part : {red, green, blue}) {
        if (!(part >= 0 && part <= 1)) {
            return std::nullopt;
        }
        color.at(i++) = static_cast<std::uint8_t>(std::lround(part * kMax));
    }
    return color;
}

std::string trimmed(std::string text) {
    constexpr std::string_view kAround{" \t\r\n\0", 5};
    text.erase(text.find_last_not_of(kAround) + 1);
    text.erase(0, text.find_first_not_of(kAround));
    return text;
}

}  // namespace isonest::detail
