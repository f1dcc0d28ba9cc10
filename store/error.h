// The one exception family of isonest.
#pragma once

#include <stdexcept>
#include <string>

namespace isonest {

/// What went wrong, as a caller or a script needs to tell it apart. The numbers are the exit codes
/// of the command line tool.
enum class ErrorKind : int {
    invalid_argument = 2,  ///< the request makes no sense; nothing was touched
    not_found = 3,         ///< a file, dataset, level or field that is not there
    corrupt = 4,           ///< bytes that contradict their own format or checksum
    unsupported = 5,       ///< well formed, but not something this version can do
    io = 6,                ///< the operating system or a library refused a read or a write
    limit = 7,             ///< the work needs more memory, or a larger format, than allowed
    cancelled = 130        ///< the user interrupted the run
};

/// Thrown at the boundaries of the library. The message names the file, the place in it and the way
/// out. Kernels never throw it.
class Error : public std::runtime_error {
  public:
    Error(ErrorKind kind, const std::string& message) : std::runtime_error(message), kind_(kind) {}
    [[nodiscard]] ErrorKind kind() const noexcept { return kind_; }

  private:
    ErrorKind kind_;
};

}  // namespace isonest
