// A folder that appears whole under its name or not at all.
#pragma once

#include <filesystem>
#include <functional>

namespace isonest::detail {

/// Under its temporary name, beside the output; what is in it is removed at the end unless it was
/// published. Thread-safety: one thread.
class OutputFolder {
  public:
    /// Throws Error if what lies under the output's name, a folder, must not be replaced.
    using MayReplace = std::function<void(const std::filesystem::path& folder)>;

    /// Creates the temporary folder. What exists is refused, or with `force` if it is no folder, or
    /// `may_replace` throws. Throws Error{invalid_argument, not_found, io}.
    OutputFolder(std::filesystem::path output, bool force, MayReplace may_replace);
    OutputFolder(const OutputFolder&) = delete;
    OutputFolder& operator=(const OutputFolder&) = delete;
    ~OutputFolder();

    /// To be filled.
    [[nodiscard]] const std::filesystem::path& name() const { return name_; }
    /// What failed while it was filled failed for another reason if it is there. Throws Error{io}
    /// if somebody removed it.
    void require_there() const;
    /// Gives it the output's name. A folder that it replaces is exchanged for it in one step, where
    /// the file system can do that, and then removed. Throws as the constructor does.
    void publish();

  private:
    void check() const;

    std::filesystem::path output_;
    std::filesystem::path name_;
    bool force_;
    MayReplace may_replace_;
};

}  // namespace isonest::detail
