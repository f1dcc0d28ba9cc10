// Label names, and the list of labels that extract writes.
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

// labels.json: lists the labels that have a mesh, with a report on each.

/// Collects the neighbours of labels in a temporary file until they are written, as there may be
/// many. Thread safety: take() may be called from any thread; of() only after the last take().
class LabelNeighbours {
  public:
    /// `labels`: their number. The temporary file is in `folder`.
    LabelNeighbours(const std::filesystem::path& folder, std::size_t labels)
        : file_(folder), place_(labels) {}
    /// Moves the neighbours of label number `label` out of its report. Throws Error{io}.
    void take(std::size_t label, SmoothReport& report);
    [[nodiscard]] std::vector<NeighbourLabel> of(std::size_t label) const;

  private:
    std::mutex mutex_;
    ScratchFile file_;
    std::uint64_t end_ = 0;
    std::vector<std::pair<std::uint64_t, std::size_t>> place_;  ///< offset in bytes, and count
};

/// Writes `head` followed by a member "labels", which lists `labels`, each with its neighbours if
/// `neighbours` is given. Throws Error{io}.
void write_label_list(const std::filesystem::path& path, const Json& head, const Json& labels,
                      const LabelNeighbours* neighbours);

/// Whether the text is a number or a range of numbers, not a name: "12", "-3", "3-7".
bool is_label_range(const std::string& text);

/// The label with this name. Throws Error{not_found}, which lists the nearest names, and
/// Error{invalid_argument} if several labels have this name.
std::int64_t label_named(const Store& store, const std::string& name);

/// The options for a mesh file of a label, which stores its name and colour.
MeshFileOptions label_file_options(const Store& store, std::int64_t id, MeshFileOptions options);

/// Adds "name" and "color" if they are known.
void add_label_name(const Store& store, std::int64_t id, Json& json);

/// " (liver)", or an empty text if the label has no name.
std::string label_name_text(const Store& store, std::int64_t id);

}  // namespace isonest::detail::cli
