// The path and the parameters of a request.
#pragma once

#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace isonest::detail::view {

/// Throws Error{invalid_argument}.
[[noreturn]] void fail(const std::string& problem);

/// Every parameter has to be taken by whoever answers: what is left is one that nobody knows.
class RequestTarget {
  public:
    /// "/api/surface?iso=1&box=0,0,0,1,1,1". Throws Error{invalid_argument} for what is none, for
    /// more than 32 parameters, or one that is there twice.
    explicit RequestTarget(std::string_view target);

    [[nodiscard]] const std::string& path() const { return path_; }
    [[nodiscard]] bool has(const std::string& name) const;
    /// Takes a parameter; nothing if it is not there.
    std::optional<std::string> text(const std::string& name);
    // The same of numbers, which are finite. They throw Error{invalid_argument}, naming the
    // parameter.
    std::optional<double> number(const std::string& name, double lowest, double highest);
    std::optional<std::int64_t> integer(const std::string& name, std::int64_t lowest,
                                        std::int64_t highest);
    std::optional<std::vector<double>> numbers(const std::string& name, std::size_t count,
                                               std::string_view form);
    /// Throws Error{invalid_argument} if parameters are left.
    void require_all_taken() const;

  private:
    std::string path_;
    std::map<std::string, std::string> parameters_;
};

}  // namespace isonest::detail::view
