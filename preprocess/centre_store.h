// The centre values of each level's cubes (or squares, see Lattice::elements_at()), which the next
// two levels need, outside of memory.
#pragma once

#include <filesystem>
#include <map>

#include "preprocess/layer.h"
#include "store/field.h"
#include "store/lattice.h"
#include "store/scratch_file.h"

namespace isonest {

/// Saturated values of cube centres per level, as binary32 in temporary files: so that the 16-bit
/// rounding of the stored indicators does not add up over the levels.
/// Thread-safety: put() and get() on disjoint boxes from any thread; the rest from one.
class CentreStore {
  public:
    CentreStore(const Lattice& lattice, std::filesystem::path folder)
        : lattice_(lattice), folder_(std::move(folder)) {}
    /// Throws Error{io}, for example on a full disk.
    void allocate(int level, Field what);
    void release(int level);
    void put(int level, Field what, const Box<float>& centres);
    /// Cubes outside the volume get `outside`.
    void get(int level, Field what, float outside, Box<float>& centres) const;

  private:
    Lattice lattice_;
    std::filesystem::path folder_;
    std::map<std::pair<int, Field>, ScratchFile> files_;
};

}  // namespace isonest
