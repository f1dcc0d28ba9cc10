// A thread that the system may refuse.
#pragma once

#include <functional>
#include <string>
#include <thread>

namespace isonest::detail {

/// Runs `work` in a thread of its own. Throws Error{limit}, with `name` as its file, if the system
/// starts none.
std::thread started_thread(const std::string& name, std::function<void()> work);

}  // namespace isonest::detail
