// labels.json: which labels got a mesh, and what is known of each.
#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <mutex>
#include <utility>
#include <vector>

#include <isonest/extract_report.h>

#include "store/files/scratch_file.h"
#include "tools/cli/command.h"

namespace isonest::detail::cli {

/// The neighbours of labels, in a temporary file until they are written: there may be many.
/// Thread-safety: take() from any thread; of() after it.
class LabelNeighbours {
  public:
    /// Of so many labels. The file is in `folder`.
    LabelNeighbours(const std::filesystem::path& folder, std::size_t labels)
        : file_(folder), place_(labels) {}
    /// Those of a label are moved out of its report. Throws Error{io}.
    void take(std::size_t label, SmoothReport& report);
    [[nodiscard]] std::vector<NeighbourLabel> of(std::size_t label) const;

  private:
    std::mutex mutex_;
    ScratchFile file_;
    std::uint64_t end_ = 0;
    std::vector<std::pair<std::uint64_t, std::size_t>> place_;  ///< bytes, and how many
};

/// Writes `head` with a member "labels" behind its others: `labels`, each with its neighbours where
/// they are given. Throws Error{io}.
void write_label_list(const std::filesystem::path& path, const Json& head, const Json& labels,
                      const LabelNeighbours* neighbours);

}  // namespace isonest::detail::cli
