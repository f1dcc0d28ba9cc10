// What an input says about its labels and about itself.
#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include <isonest/label_name.h>
#include <isonest/volume_source.h>

namespace isonest::detail {

// A source that provides the names of its labels.

/// `inner` with these names instead of its own, sorted by id; `inner` itself if there are none.
/// `table`: the file that the names come from, if the inner source does not read it; otherwise
/// empty.
std::unique_ptr<VolumeSource> with_label_names(std::unique_ptr<VolumeSource> inner,
                                               std::vector<LabelName> names,
                                               const std::filesystem::path& table = {});

// Sources with additional notes, or with a position in time.

/// `inner` with these notes after its own; `inner` itself if there are none.
std::unique_ptr<VolumeSource> with_notes(std::unique_ptr<VolumeSource> inner,
                                         std::vector<std::string> notes);

/// `inner` with this position in time.
std::unique_ptr<VolumeSource> with_time(std::unique_ptr<VolumeSource> inner, VolumeTime time);

// Tables of labels stored beside a volume.

/// A text file, one label per line:
///
///   ID NAME RED GREEN BLUE [OPACITY]                      FreeSurfer, 3D Slicer (.ctbl)
///   ID RED GREEN BLUE OPACITY VISIBLE MESH "NAME"         ITK-SNAP
///   ID NAME
///
/// Colours are integers from 0 to 255, and a name without quotes is a single word; opacity and
/// visibility are dropped. Empty lines and lines that begin with # are ignored. Sources:
/// https://surfer.nmr.mgh.harvard.edu/fswiki/LabelsClutsAnnotationFiles, the head of ITK-SNAP's own
/// files.
/// Sorted by id. Throws Error{corrupt}, naming the line, for anything else, for a duplicate label,
/// and for what a store cannot hold; Error{limit} if it takes more than `max_heap` bytes;
/// Error{not_found, invalid_argument, io}.
std::vector<LabelName> read_label_file(const std::filesystem::path& path, std::uint64_t max_heap);

// The valid part of what an input says about its labels.

/// Collects names and colours. They never prevent a volume from being read: what cannot be stored,
/// and duplicates of a label, are left out, and a note says so.
class FoundLabels {
  public:
    /// Adds a name, a colour or both; `name` is empty if the label has none.
    void add(std::int64_t id, const std::string& name, const std::optional<LabelColor>& color);
    /// Reports something else that is invalid: "label 5: its colour is '1 2'".
    void leave_out(const std::string& what);

    /// Sorted by id.
    [[nodiscard]] std::vector<LabelName> names() const;
    /// Empty if nothing was left out.
    [[nodiscard]] std::vector<std::string> notes() const;

  private:
    std::map<std::int64_t, LabelName> labels_;
    std::size_t left_out_ = 0;
    std::vector<std::string> first_;  ///< the first items that were left out
};

/// The colour of three numbers from 0 to 1; none if one is out of range.
std::optional<LabelColor> color_of_parts(double red, double green, double blue);

/// Without leading and trailing blanks and zero bytes.
std::string trimmed(std::string text);

}  // namespace isonest::detail
