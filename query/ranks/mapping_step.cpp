#include "query/ranks/mapping_step.h"

namespace isonest::detail {
namespace {

struct StepHead {
    bool is_end = false;
    CollapseLimits limits;
};

}  // namespace

void tell_step(Communicator& ranks, const MappingStep& step) {
    std::string text = text_of_value(StepHead{step.is_end, step.limits});
    for (const std::uint64_t messages : step.messages) {
        text += text_of_value(messages);
    }
    ranks.broadcast(std::move(text));
}

MappingStep hear_step(Communicator& ranks) {
    const std::string text = ranks.broadcast({});
    std::string_view rest = text;
    const auto head = value_of_text<StepHead>(rest);
    MappingStep step{head.is_end, head.limits, {}};
    for (rest.remove_prefix(sizeof(StepHead)); !rest.empty();
         rest.remove_prefix(sizeof(std::uint64_t))) {
        step.messages.push_back(value_of_text<std::uint64_t>(rest));
    }
    return step;
}

}  // namespace isonest::detail
