// Query strings as of the URL standard's application/x-www-form-urlencoded.
#include "tools/view/request_target.h"

#include <fmt/format.h>

#include <limits>

#include <isonest/error.h>

#include "tools/cli/options/units.h"

namespace isonest::detail::view {
namespace {

constexpr std::size_t kMostParameters = 32;

int hex_digit(char c) {
    if (c >= '0' && c <= '9') {
        return c - '0';
    }
    const char lower = static_cast<char>(static_cast<unsigned char>(c) | 0x20U);
    return lower >= 'a' && lower <= 'f' ? lower - 'a' + 10 : -1;
}

std::string decoded(std::string_view text) {
    std::string out;
    for (std::size_t i = 0; i < text.size(); ++i) {
        if (text[i] == '+') {
            out += ' ';
        } else if (text[i] == '%') {
            const int high = i + 2 < text.size() ? hex_digit(text[i + 1]) : -1;
            const int low = i + 2 < text.size() ? hex_digit(text[i + 2]) : -1;
            if (high < 0 || low < 0) {
                fail("the request has a % without two hexadecimal digits");
            }
            out += static_cast<char>(high * 16 + low);
            i += 2;
        } else {
            out += text[i];
        }
    }
    return out;
}

}  // namespace

[[noreturn]] void fail(const std::string& problem) {
    throw Error(ErrorKind::invalid_argument, problem);
}

RequestTarget::RequestTarget(std::string_view target) {
    const std::size_t end = target.find('?');
    path_ = decoded(target.substr(0, end));
    std::string_view rest = end == std::string_view::npos ? "" : target.substr(end + 1);
    while (!rest.empty()) {
        const std::size_t next = rest.find('&');
        const std::string_view one = rest.substr(0, next);
        rest = next == std::string_view::npos ? "" : rest.substr(next + 1);
        if (one.empty()) {
            continue;
        }
        const std::size_t equals = one.find('=');
        const std::string name = decoded(one.substr(0, equals));
        const std::string value =
            equals == std::string_view::npos ? "" : decoded(one.substr(equals + 1));
        if (!parameters_.emplace(name, value).second) {
            fail(fmt::format("the parameter {} is there twice", name));
        }
        if (parameters_.size() > kMostParameters) {
            fail("the request has too many parameters");
        }
    }
}

bool RequestTarget::has(const std::string& name) const {
    return parameters_.contains(name);
}

std::optional<std::string> RequestTarget::text(const std::string& name) {
    const auto found = parameters_.find(name);
    if (found == parameters_.end()) {
        return std::nullopt;
    }
    std::string value = std::move(found->second);
    parameters_.erase(found);
    return value;
}

std::optional<double> RequestTarget::number(const std::string& name, double lowest,
                                            double highest) {
    const std::optional<std::string> value = text(name);
    if (!value) {
        return std::nullopt;
    }
    const double number = cli::parse_number(name, *value);
    if (!(lowest <= number && number <= highest)) {
        fail(highest == std::numeric_limits<double>::max()
                 ? fmt::format("{} '{}': give a number of at least {:g}", name, *value, lowest)
                 : fmt::format("{} '{}': give a number from {:g} to {:g}", name, *value, lowest,
                               highest));
    }
    return number;
}

std::optional<std::int64_t> RequestTarget::integer(const std::string& name, std::int64_t lowest,
                                                   std::int64_t highest) {
    const std::optional<std::string> value = text(name);
    return value ? std::optional(cli::parse_integer(name, *value, lowest, highest)) : std::nullopt;
}

std::optional<std::vector<double>> RequestTarget::numbers(const std::string& name,
                                                          std::size_t count,
                                                          std::string_view form) {
    const std::optional<std::string> value = text(name);
    return value ? std::optional(cli::parse_numbers(name, *value, count, form)) : std::nullopt;
}

void RequestTarget::require_all_taken() const {
    if (!parameters_.empty()) {
        fail(
            fmt::format("the parameter {} is not known for {}", parameters_.begin()->first, path_));
    }
}

}  // namespace isonest::detail::view
