// What a part of a page asks for replaces what it asked for before.
#pragma once

#include <map>
#include <memory>
#include <string>

#include "tools/view/work_lane.h"

namespace isonest::detail::view {

/// Not thread-safe.
class Streams {
  public:
    /// Throws Error{invalid_argument} if it is no name: 1 to 64 letters, digits, '-', '_'.
    static void require_name(const std::string& name);
    /// Cancels what is under way for the stream; `job` is what is from now on.
    void replace(const std::string& name, const std::shared_ptr<Job>& job);
    void cancel(const std::string& name);

  private:
    std::map<std::string, std::weak_ptr<Job>> jobs_;
};

}  // namespace isonest::detail::view
