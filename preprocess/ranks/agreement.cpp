#include "preprocess/ranks/agreement.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <span>
#include <string>
#include <vector>

#include <isonest/error.h>
#include <isonest/field.h>

#include "store/base/label_text.h"
#include "store/container/codec.h"
#include "store/container/format.h"
#include "store/ranks/who_differs.h"

namespace isonest::detail {
namespace {

std::string digest_of(const std::string& text) {
    return fmt::format("{:016x}", checksum_of(std::as_bytes(std::span(text))));
}

/// All that decides which values lie where; not what the input is called.
std::string input_text(const VolumeSource& source) {
    const VolumeDescription v = source.describe();
    std::string text = fmt::format(
        "{}\n{} {} {} {} {} {} {} {}\n", source.identity(), v.nodes.x, v.nodes.y, v.nodes.z,
        name_of(v.type), v.labels, v.unit ? static_cast<int>(*v.unit) : -1, name_of(v.frame),
        fmt::format("{} {}", fmt::join(v.spacing, " "), fmt::join(v.origin, " ")));
    for (const Double3& axis : v.direction) {
        text += fmt::format("{}\n", fmt::join(axis, " "));
    }
    for (const LabelName& name : source.label_names()) {
        text += fmt::format("{} {}\n", name.id, name.name);
    }
    return text;
}

std::string options_text(const PreprocessOptions& options) {
    return fmt::format("{} {} {} {} {} {}", options.chunk, options.compression, options.exact,
                       options.force, options.resume, list_names(options.fields));
}

}  // namespace

void require_same_work(Communicator& ranks, const VolumeSource& source,
                       const PreprocessOptions& options) {
    const std::string input = digest_of(input_text(source));
    const std::string chosen = digest_of(options_text(options));
    const std::string other_inputs = who_differs(ranks, input, input);
    const std::string other_choices = who_differs(ranks, chosen, chosen);
    if (!other_inputs.empty()) {
        throw Error(ErrorKind::invalid_argument, {source.describe().name},
                    "ranks see different inputs: not what rank 0 sees, see ranks " + other_inputs);
    }
    if (!other_choices.empty()) {
        throw Error(
            ErrorKind::invalid_argument, {source.describe().name},
            "ranks have different options: not those of rank 0, have ranks " + other_choices);
    }
    ranks.meet();
}

}  // namespace isonest::detail
