#include "store/base/label_text.h"

#include <fmt/format.h>

#include <cstddef>
#include <cstdint>

namespace isonest::detail {
namespace {

/// The code point that begins at byte `at`, which is advanced past it; nullopt if it is incomplete
/// or not in its shortest form.
std::optional<std::uint32_t> next_code_point(std::string_view text, std::size_t& at) {
    const auto byte = [&](std::size_t i) { return static_cast<std::uint8_t>(text[i]); };
    const std::uint32_t first = byte(at);
    std::size_t more = 0;
    std::uint32_t least = 0;
    std::uint32_t code = first;
    if (first >= 0xF0 && first <= 0xF4) {
        more = 3;
        least = 0x10000;
        code = first & 0x07U;
    } else if (first >= 0xE0 && first < 0xF0) {
        more = 2;
        least = 0x800;
        code = first & 0x0FU;
    } else if (first >= 0xC2 && first < 0xE0) {
        more = 1;
        least = 0x80;
        code = first & 0x1FU;
    } else if (first >= 0x80) {
        return std::nullopt;
    }
    if (text.size() - at <= more) {
        return std::nullopt;
    }
    for (++at; more > 0; --more, ++at) {
        if ((byte(at) & 0xC0U) != 0x80U) {
            return std::nullopt;
        }
        code = (code << 6U) | (byte(at) & 0x3FU);
    }
    constexpr std::uint32_t kMax = 0x10FFFF;
    const bool surrogate = code >= 0xD800 && code < 0xE000;
    return code < least || code > kMax || surrogate ? std::nullopt : std::optional(code);
}

}  // namespace

bool is_printable_utf8(std::string_view text) {
    for (std::size_t at = 0; at < text.size();) {
        const auto code = next_code_point(text, at);
        if (!code || *code < 0x20 || (*code >= 0x7F && *code < 0xA0) || *code == 0xFFFE ||
            *code == 0xFFFF) {
            return false;
        }
    }
    return true;
}

std::string why_no_label_names(std::span<const LabelName> names) {
    if (names.size() > LabelName::kMaxOfStore) {
        return fmt::format("{} labels with names: a store holds {} at most", names.size(),
                           LabelName::kMaxOfStore);
    }
    for (std::size_t i = 0; i < names.size(); ++i) {
        const LabelName& label = names[i];
        if (i > 0 && label.id <= names[i - 1].id) {
            return fmt::format("names of labels {} and {}: ids must be increasing", names[i - 1].id,
                               label.id);
        }
        constexpr auto kMax = static_cast<std::int64_t>(kMaxLabel);
        if (label.id < -kMax || label.id > kMax) {
            return fmt::format("a name of label {}: labels go from -(2^62 - 1) to 2^62 - 1",
                               label.id);
        }
        if (label.name.size() > LabelName::kMaxBytes) {
            return fmt::format("the name of label {} has {} bytes: {} at most", label.id,
                               label.name.size(), LabelName::kMaxBytes);
        }
        if (!is_printable_utf8(label.name)) {
            return fmt::format("the name of label {} is not valid UTF-8, or has control characters",
                               label.id);
        }
        if (label.name.empty() && !label.color) {
            return fmt::format("label {} has neither a name nor a colour", label.id);
        }
    }
    return "";
}

}  // namespace isonest::detail
