// Labels by their names, and what is said of them.
#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <mutex>
#include <string>
#include <utility>
#include <vector>

#include <isonest/extract_report.h>
#include <isonest/mesh_file.h>
#include <isonest/store.h>

#include "store/files/scratch_file.h"
#include "tools/cli/program.h"

namespace isonest::detail::cli {

// labels.json: which labels got a mesh, and what is known of each.

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

/// "12", "-3", "3-7": a number, or a range of numbers, and no name.
bool is_label_range(const std::string& text);

/// The label that is called so. Throws Error{not_found}, which names the nearest names, and
/// Error{invalid_argument} where several are called so.
std::int64_t label_named(const Store& store, const std::string& name);

/// A mesh of this label, with its name and colour; an existing file is replaced.
MeshFileOptions label_file_options(const Store& store, std::int64_t id, MeshSpace space);

/// Adds "name" and "color", as far as they are known.
void add_label_name(const Store& store, std::int64_t id, Json& json);

/// " (liver)", or nothing.
std::string label_name_text(const Store& store, std::int64_t id);

}  // namespace isonest::detail::cli
