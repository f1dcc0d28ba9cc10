#include "preprocess/sources/label_names/label_file.h"

#include <fmt/format.h>

#include <algorithm>
#include <charconv>
#include <cstdint>
#include <map>
#include <sstream>
#include <string>
#include <string_view>
#include <utility>

#include <isonest/error.h>

#include "preprocess/sources/bytes/regular_file.h"
#include "preprocess/sources/label_names/found_labels.h"
#include "store/base/label_text.h"

namespace isonest::detail {
namespace {

/// Of a label beside its name: in the map, and in the list that is returned.
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
            throw Error(ErrorKind::corrupt, {path_.string()}, "there is no label in this table");
        }
        return all;
    }

  private:
    void take_heap(std::uint64_t bytes) {
        if (bytes > left_) {
            throw Error(ErrorKind::limit, {path_.string()},
                        "this table of labels takes more memory than a source may hold",
                        {{RemedyKind::more_memory}});
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
            fail(fmt::format("'{:.40}' is no whole number", shown(word)));
        }
        return value;
    }
    /// Three words from number `first` on.
    LabelColor color(const std::vector<std::string>& words, std::size_t first) const {
        constexpr std::int64_t kMost = 255;
        LabelColor color{};
        for (std::size_t i = 0; i < color.size(); ++i) {
            const std::int64_t part = whole(words[first + i]);
            if (part < 0 || part > kMost) {
                fail(fmt::format("a colour has numbers from 0 to 255, not {}", part));
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
        if (labels_.size() >= LabelName::kMostOfStore) {
            fail(fmt::format("more than {} labels, which is what a store holds the names of",
                             LabelName::kMostOfStore));
        }
        take_heap(kLabelHeap + label.name.size());
        const std::int64_t id = label.id;
        if (!labels_.emplace(id, std::move(label)).second) {
            fail(fmt::format("label {} comes a second time", id));
        }
    }

    const std::filesystem::path& path_;
    std::uint64_t left_;      ///< of the heap
    std::size_t number_ = 0;  ///< of the line
    std::map<std::int64_t, LabelName> labels_;
};

}  // namespace

std::vector<LabelName> read_label_file(const std::filesystem::path& path, std::uint64_t max_heap) {
    return LabelFile(path, max_heap).read();
}

}  // namespace isonest::detail
