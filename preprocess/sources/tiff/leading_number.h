// Numbers in the texts of TIFF's descriptions.
#pragma once

#include <charconv>
#include <string_view>
#include <system_error>

namespace isonest::detail {

/// The number that a text begins with; `otherwise` if it begins with none.
template <class T>
T leading_number(std::string_view text, T otherwise) {
    T value{};
    const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
    return error == std::errc{} && end != text.data() ? value : otherwise;
}

}  // namespace isonest::detail
