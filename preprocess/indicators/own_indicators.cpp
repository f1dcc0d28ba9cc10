#include "preprocess/indicators/own_indicators.h"

#include <fmt/format.h>

#include <algorithm>
#include <filesystem>
#include <limits>
#include <memory>
#include <optional>
#include <string>
#include <utility>

#include <isonest/error.h>
#include <isonest/value_type.h>

#include "store/files/scratch_file.h"

namespace isonest {

OwnIndicator own_indicator(std::string name, std::function<double(const RefinementNode&)> eta,
                           std::string identity) {
    OwnIndicator made;
    made.name = std::move(name);
    made.identity = std::move(identity);
    made.eta = [f = std::move(eta)](std::span<const RefinementNode> nodes, std::span<double> to) {
        std::transform(nodes.begin(), nodes.end(), to.begin(), f);
    };
    return made;
}

namespace {

/// All numbers of a volume, mapped.
struct MappedNumbers {
    VolumeDescription volume;
    std::optional<detail::ScratchFile> file;  ///< nullopt: the source's own map
    const std::byte* data = nullptr;

    template <class T>
    void look_up(std::span<const RefinementNode> nodes, std::span<double> to) const {
        const T* const numbers = reinterpret_cast<const T*>(data);
        const Int3 last = volume.nodes - Int3{1, 1, 1};
        for (std::size_t i = 0; i < nodes.size(); ++i) {
            to[i] = static_cast<double>(numbers[volume.nodes.linear(min(nodes[i].node, last))]);
        }
    }
    void operator()(std::span<const RefinementNode> nodes, std::span<double> to) const {
        const VolumeDescription& of = *nodes.front().volume;
        if (of.nodes != volume.nodes) {
            const Int3& n = volume.nodes;
            throw Error(ErrorKind::invalid_argument, {volume.name},
                        fmt::format("has {} x {} x {} nodes; the volume {} has {} x {} x {}", n.x,
                                    n.y, n.z, of.name, of.nodes.x, of.nodes.y, of.nodes.z),
                        {{RemedyKind::leave_out, "own"}});
        }
        dispatch(volume.type, [&](auto tag) { look_up<typename decltype(tag)::type>(nodes, to); });
    }
};

}  // namespace

OwnIndicator own_indicator(std::string name, VolumeSource& numbers,
                           const std::filesystem::path& scratch, Progress& progress) {
    const auto mapped = std::make_shared<MappedNumbers>();
    mapped->volume = numbers.describe();
    mapped->data = numbers.mapped().data();
    if (mapped->data == nullptr) {
        const Int3& n = mapped->volume.nodes;
        const std::uint64_t plane =
            static_cast<std::uint64_t>(n.x * n.y) * size_of(mapped->volume.type);
        mapped->file.emplace(scratch);
        std::byte* const to = mapped->file->map(plane * static_cast<std::uint64_t>(n.z)).data();
        mapped->data = to;
        progress.begin("read indicator", static_cast<std::uint64_t>(n.z), "planes");
        const std::int64_t step = numbers.granularity().planes;
        for (std::int64_t z = 0; z < n.z; z += step) {
            progress.check();
            const std::int64_t count = std::min(step, n.z - z);
            numbers.read(z, count, 0, n.y, to + static_cast<std::uint64_t>(z) * plane);
            progress.advance(static_cast<std::uint64_t>(count));
        }
    }
    OwnIndicator made;
    made.name = std::move(name);
    made.identity = numbers.identity();
    made.eta = [mapped](std::span<const RefinementNode> nodes, std::span<double> to) {
        (*mapped)(nodes, to);
    };
    return made;
}

namespace detail {

OwnIndicators::OwnIndicators(std::span<const OwnIndicator> indicators, VolumeDescription volume)
    : indicators_(indicators), volume_(std::move(volume)) {
    const auto refuse = [&](ErrorKind kind, const std::string& problem) {
        throw Error(kind, {volume_.name}, problem);
    };
    if (indicators.size() > static_cast<std::size_t>(kMaxOwnIndicators)) {
        refuse(ErrorKind::invalid_argument,
               fmt::format("there are {} own indicators; a store can hold at most {}",
                           indicators.size(), kMaxOwnIndicators));
    }
    if (!indicators.empty() && volume_.labels) {
        refuse(ErrorKind::unsupported, "own indicators are not supported for 64-bit labels");
    }
    for (const OwnIndicator& indicator : indicators) {
        for (const Saturation saturation : {Saturation::bar, Saturation::plus}) {
            const Field field = own_field(indicator.name, saturation);
            if (std::find(fields_.begin(), fields_.end(), field) != fields_.end()) {
                refuse(ErrorKind::invalid_argument,
                       fmt::format("two own indicators are called {}", indicator.name));
            }
            fields_.push_back(field);
        }
        if (!indicator.eta) {
            refuse(ErrorKind::invalid_argument,
                   fmt::format("the own indicator {} has no function", indicator.name));
        }
    }
}

std::size_t OwnIndicators::index_of(Field field) const {
    return static_cast<std::size_t>(std::find(fields_.begin(), fields_.end(), field) -
                                    fields_.begin()) /
           2;
}

void OwnIndicators::evaluate(std::size_t which, std::span<const RefinementNode> nodes,
                             std::span<double> eta) const {
    if (nodes.empty()) {
        return;
    }
    // Detects entries that the function does not write.
    std::fill(eta.begin(), eta.end(), std::numeric_limits<double>::quiet_NaN());
    const OwnIndicator& indicator = indicators_[which];
    indicator.eta(nodes, eta);
    for (std::size_t n = 0; n < nodes.size(); ++n) {
        if (!(eta[n] >= 0)) {
            const Int3& p = nodes[n].node;
            throw Error(ErrorKind::invalid_argument, {volume_.name},
                        fmt::format("the own indicator {} is {} at node {} {} {}; it must be at "
                                    "least 0",
                                    indicator.name, eta[n], p.x, p.y, p.z));
        }
    }
}

}  // namespace detail
}  // namespace isonest
