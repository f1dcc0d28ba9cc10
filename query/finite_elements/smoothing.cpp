#include <fmt/format.h>

#include <string>
#include <utility>

#include <isonest/error.h>
#include <isonest/smooth.h>

#include "query/finite_elements/nonlinear_diffusion.h"
#include "query/finite_elements/volume_values.h"
#include "store/base/memory.h"
#include "store/container/format.h"
#include "store/container/reader.h"

namespace isonest {
namespace {

/// Throws Error{invalid_argument, unsupported}.
void require_sense(const SmoothOptions& options, const VolumeDescription& volume) {
    const auto require = [](bool is_right, const char* what) {
        if (!is_right) {
            throw Error(ErrorKind::invalid_argument, what);
        }
    };
    require(options.tau > 0, "tau: give a number > 0");
    require(options.lambda > 0, "lambda: give a number > 0");
    require(!options.sigma || *options.sigma >= 0, "sigma: give a number >= 0");
    require(options.threshold >= 0, "threshold: give a number >= 0");
    require(options.tolerance > 0, "tolerance: give a number > 0");
    detail::require_right_angles(volume.direction, volume.name, "smoothing");
    detail::require_even_axes(volume, "smoothing");
    if (volume.nodes == Int3{1, 1, 1}) {
        throw Error(ErrorKind::unsupported, {volume.name}, "there is only one node");
    }
}

}  // namespace

Smoothing::Smoothing(const detail::VolumeValues& input, const SmoothOptions& options,
                     Progress& progress) {
    const VolumeDescription volume = input.describe();
    require_sense(options, volume);
    const detail::Lattice lattice(volume.nodes);
    detail::require_memory(
        volume.name, options.memory,
        detail::kLibraryHeap + input.heap() + detail::NonlinearDiffusion::heap(lattice, options),
        "this many unknowns");
    diffusion_ = std::make_unique<detail::NonlinearDiffusion>(lattice, volume.spacing,
                                                              input.read(progress), options);
}

Smoothing::Smoothing(const Store& store, const SmoothOptions& options, Progress& progress)
    : Smoothing(detail::VolumeValues(store.reader()), options, progress) {}

Smoothing::Smoothing(VolumeSource& volume, const SmoothOptions& options, Progress& progress)
    : Smoothing(detail::VolumeValues(volume), options, progress) {}

Smoothing::Smoothing(Smoothing&& other) noexcept = default;
Smoothing& Smoothing::operator=(Smoothing&& other) noexcept = default;
Smoothing::~Smoothing() = default;

SmoothStep Smoothing::step(Progress& progress) {
    return diffusion_->step(progress);
}

std::span<const float> Smoothing::values() const {
    return diffusion_->values();
}

std::vector<std::uint8_t> Smoothing::grid(Progress& progress) const {
    const NodeSet set = diffusion_->grid(progress);
    const Int3 n = set.nodes();
    std::vector<std::uint8_t> members(static_cast<std::size_t>(n.product()), 0);
    set.for_each([&](const Int3& p, std::size_t /*number*/) {
        members[static_cast<std::size_t>(n.linear(p))] = 1;
    });
    return members;
}

Int3 Smoothing::nodes() const {
    return diffusion_->lattice().nodes();
}

const SmoothOptions& Smoothing::options() const {
    return diffusion_->options();
}

}  // namespace isonest
