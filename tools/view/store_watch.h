// Whether the file of an open store is still the one that was opened. An object elsewhere is
// watched by who reads it: what is fetched of another one is an error.
#pragma once

#include <sys/stat.h>

#include <cstdint>
#include <filesystem>

#include <isonest/store.h>

namespace isonest::detail::view {

enum class StoreState : std::uint8_t { same, replaced, cut_off };

/// Thread-safe.
class StoreWatch {
  public:
    /// Throws Error{not_found} if there is no such file any more.
    explicit StoreWatch(const Store& store);
    /// A store elsewhere is the same. A file of that name that is another one, was written to, or
    /// is gone, is replaced.
    [[nodiscard]] StoreState state() const;

  private:
    std::filesystem::path path_;  ///< empty: it is elsewhere
    struct stat opened_ {};
};

/// "ok", "replaced" or "cut off".
const char* name_of(StoreState state);

}  // namespace isonest::detail::view
