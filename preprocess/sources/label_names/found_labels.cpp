#include "preprocess/sources/label_names/found_labels.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <cmath>

#include "store/base/label_text.h"

namespace isonest::detail {

void FoundLabels::add(std::int64_t id, const std::string& name,
                      const std::optional<LabelColor>& color) {
    LabelName label{id, trimmed(name), color};
    if (label.name.empty() && !color) {
        return;
    }
    if (const std::string why = why_no_label_names({&label, 1}); !why.empty()) {
        leave_out(why);
        // A name may be wrong, and the colour right.
        label.name.clear();
        if (!color || !why_no_label_names({&label, 1}).empty()) {
            return;
        }
    }
    if (labels_.size() >= LabelName::kMostOfStore && labels_.count(id) == 0) {
        leave_out(fmt::format("label {}: a store holds the names of {} at most", id,
                              LabelName::kMostOfStore));
        return;
    }
    LabelName& known = labels_[id];
    known.id = id;
    if ((!known.name.empty() && !label.name.empty()) || (known.color && label.color)) {
        leave_out(fmt::format("label {} comes again", id));
        return;
    }
    known.name += label.name;
    known.color = label.color ? label.color : known.color;
}

void FoundLabels::leave_out(const std::string& what) {
    constexpr std::size_t kMostSaid = 3;
    ++left_out_;
    if (first_.size() < kMostSaid) {
        first_.push_back(what);
    }
}

std::vector<LabelName> FoundLabels::names() const {
    std::vector<LabelName> all;
    all.reserve(labels_.size());
    for (const auto& [id, label] : labels_) {
        all.push_back(label);
    }
    return all;
}

std::vector<std::string> FoundLabels::notes() const {
    if (left_out_ == 0) {
        return {};
    }
    return {fmt::format("of what it says of its labels, {} {} left out: {}{}", left_out_,
                        left_out_ == 1 ? "thing was" : "things were", fmt::join(first_, "; "),
                        left_out_ > first_.size() ? "; ..." : "")};
}

std::optional<LabelColor> color_of_parts(double red, double green, double blue) {
    constexpr double kMost = 255;
    LabelColor color{};
    std::size_t i = 0;
    for (const double part : {red, green, blue}) {
        if (!(part >= 0 && part <= 1)) {
            return std::nullopt;
        }
        color.at(i++) = static_cast<std::uint8_t>(std::lround(part * kMost));
    }
    return color;
}

std::string trimmed(std::string text) {
    constexpr std::string_view kAround{" \t\r\n\0", 5};
    text.erase(text.find_last_not_of(kAround) + 1);
    text.erase(0, text.find_first_not_of(kAround));
    return text;
}

}  // namespace isonest::detail
