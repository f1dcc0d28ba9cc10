// Which volumes are marched, and how their layers are shared out.
#pragma once

#include <cstdint>

#include <isonest/extract.h>
#include <isonest/volume_source.h>

#include "query/slabs/slab_reader.h"

namespace isonest::detail {

/// Whether the volume, if it can lie where it says, can be marched along its axes.
bool is_marchable(const VolumeDescription& volume);

/// Throws Error{invalid_argument, unsupported, limit} for a volume that cannot be marched, and for
/// an isovalue that is not finite.
void require_marchable(const VolumeDescription& volume, double iso);

struct SlabPlan {
    std::int64_t layers = 1;  ///< of a slab
    int slabs_at_once = 1;
    int threads = 1;
    std::uint64_t spare = 0;  ///< bytes of the memory that are left
};

/// `each_more`: bytes that a slab takes beside its planes and a marcher. Throws Error{limit}.
SlabPlan slab_plan(const SlabReader& reader, const VolumeDescription& volume,
                   const ExtractOptions& options, std::uint64_t each_more = 0);

/// The least memory for which there is a plan.
std::uint64_t least_slab_memory(const SlabReader& reader, const VolumeDescription& volume,
                                std::uint64_t each_more = 0);

}  // namespace isonest::detail
