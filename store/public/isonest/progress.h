// Progress reports and cancellation of long operations.
#pragma once

#include <cstdint>
#include <string_view>

namespace isonest {

/// Passed to every long operation. The default reports nothing and never stops.
/// Thread-safety: all methods may be called from any thread at any time.
class Progress {
  public:
    Progress() = default;
    Progress(const Progress&) = delete;
    Progress& operator=(const Progress&) = delete;
    virtual ~Progress() = default;
    /// A phase of `total` units begins; `unit` is "B" for bytes, else a plural noun.
    virtual void begin(std::string_view /*phase*/, std::uint64_t /*total*/,
                       std::string_view /*unit*/) {}
    /// `amount` more units of the current phase are complete.
    virtual void advance(std::uint64_t /*amount*/) {}
    /// True once the user has asked to stop; the operation then soon throws Error{cancelled}.
    [[nodiscard]] virtual bool cancelled() const { return false; }
    /// Throws Error{cancelled} if cancelled().
    void check() const;
};

/// A shared silent instance.
Progress& silent_progress();

}  // namespace isonest
