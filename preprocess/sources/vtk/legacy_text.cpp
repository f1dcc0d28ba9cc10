#include "preprocess/sources/vtk/legacy_text.h"

#include <fmt/format.h>

#include <algorithm>

#include <isonest/error.h>

#include "preprocess/sources/bytes/regular_file.h"

namespace isonest::detail {
namespace {

constexpr std::size_t kLongestLine = 4096;

bool is_blank(char c) {
    return c == ' ' || (c >= '\t' && c <= '\r');
}

}  // namespace

LegacyText::LegacyText(const InputFile& file) : file_(file), size_(regular_file_size(file)) {}

std::string LegacyText::line() {
    if (at_ >= size_) {
        return "";
    }
    const std::string part = first_bytes(file_, kLongestLine, at_);
    const std::size_t end = part.find('\n');
    if (end == std::string::npos && part.size() == kLongestLine) {
        throw Error(ErrorKind::corrupt, {file_.name(), fmt::format("byte {}", at_)},
                    fmt::format("no line ends within {} bytes", kLongestLine));
    }
    at_ += end == std::string::npos ? part.size() : end + 1;
    return part.substr(0, end);
}

std::vector<std::string> LegacyText::words() {
    std::vector<std::string> words;
    while (words.empty() && at_ < size_) {
        const std::string text = line();
        for (auto from = text.begin(); true;) {
            from = std::find_if_not(from, text.end(), is_blank);
            if (from == text.end()) {
                break;
            }
            const auto to = std::find_if(from, text.end(), is_blank);
            words.emplace_back(from, to);
            from = to;
        }
    }
    return words;
}

void LegacyText::skip_to_empty_line() {
    while (at_ < size_) {
        const std::string text = line();
        if (std::all_of(text.begin(), text.end(), is_blank)) {
            return;
        }
    }
}

void LegacyText::skip(std::uint64_t bytes) {
    at_ += std::min(bytes, size_ - at_);
}

void LegacyText::skip_words(std::uint64_t count) {
    constexpr std::size_t kPart = std::size_t{1} << 16U;
    bool within = false;
    while (at_ < size_) {
        const std::string part = first_bytes(file_, kPart, at_);
        if (part.empty()) {
            return;
        }
        for (const char c : part) {
            const bool blank = is_blank(c);
            if (!blank && !within) {
                if (count == 0) {
                    return;
                }
                --count;
            }
            within = !blank;
            ++at_;
        }
    }
}

void LegacyText::skip_lines(std::uint64_t count) {
    for (; count > 0 && at_ < size_; --count) {
        line();
    }
}

void LegacyText::skip_binary_texts(std::uint64_t count) {
    constexpr std::uint64_t kLengthBits = 0x3F;
    for (; count > 0 && at_ < size_; --count) {
        const std::string head = first_bytes(file_, sizeof(std::uint64_t), at_);
        if (head.empty()) {
            return;
        }
        // Two bits say how many bytes the length has: 8, 4, 2 or 1.
        const std::size_t bytes = std::size_t{8} >> (static_cast<unsigned char>(head[0]) >> 6U);
        std::uint64_t length = 0;
        for (std::size_t i = 0; i < std::min(bytes, head.size()); ++i) {
            const std::uint64_t byte = static_cast<unsigned char>(head[i]);
            length = (length << 8U) + (i == 0 ? byte & kLengthBits : byte);
        }
        skip(bytes);
        skip(length);
    }
}

}  // namespace isonest::detail
