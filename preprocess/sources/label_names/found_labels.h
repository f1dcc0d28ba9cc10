// What an input says of its labels, as far as it makes sense.
#pragma once

#include <cstddef>
#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include <isonest/label_name.h>

namespace isonest::detail {

/// Collects names and colours. They never keep a volume from being read: what cannot be stored, and
/// what comes a second time for the same label, is left out, and a note says so.
class FoundLabels {
  public:
    /// A name or a colour or both; of one that has no name it is empty.
    void add(std::int64_t id, const std::string& name, const std::optional<LabelColor>& color);
    /// Something else makes no sense: "label 5: its colour is '1 2'".
    void leave_out(const std::string& what);

    /// By rising ids.
    [[nodiscard]] std::vector<LabelName> names() const;
    /// None if nothing was left out.
    [[nodiscard]] std::vector<std::string> notes() const;

  private:
    std::map<std::int64_t, LabelName> labels_;
    std::size_t left_out_ = 0;
    std::vector<std::string> first_;  ///< of what was left out
};

/// Of three numbers from 0 to 1; none if one is not.
std::optional<LabelColor> color_of_parts(double red, double green, double blue);

/// Without blanks and zeros around it.
std::string trimmed(std::string text);

}  // namespace isonest::detail
