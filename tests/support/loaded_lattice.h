// A function's volume, its store, and the whole lattice in memory.
#pragma once

#include <cstdint>
#include <functional>
#include <optional>
#include <utility>

#include <isonest/preprocess.h>

#include "query/study/whole_lattice.h"
#include "store/container/chunk_cache.h"
#include "store/container/reader.h"
#include "tests/support/test_support.h"

namespace isonest::detail::test {

struct LoadedLattice {
    LoadedLattice(const Int3& n, const std::function<double(const Int3&)>& f,
                  const Double3& spacing, PreprocessOptions options)
        : volume(n, f) {
        volume.spacing_ = spacing;
        make_store(volume, folder / "s", std::move(options));
        store.emplace(folder / "s");
        whole.emplace(store->layout());
        cache.emplace(*store, std::uint64_t{1} << 24U);
        whole->load_values(*cache);
    }
    [[nodiscard]] double range() const { return store->max_value() - store->min_value(); }

    TemporaryFolder folder;
    FunctionVolume<double> volume;
    std::optional<StoreReader> store;
    std::optional<WholeLattice> whole;
    std::optional<ChunkCache> cache;
};

}  // namespace isonest::detail::test
