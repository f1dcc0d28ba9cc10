// The octree of Neuroglancer's fragments of a mesh.
#pragma once

#include <cstdint>
#include <memory>
#include <span>
#include <utility>
#include <vector>

#include <isonest/int3.h>

#include "query/simplify/growing_file.h"
#include "store/files/scratch_file.h"

namespace isonest::detail {

/// A cell of a level of detail.
struct DetailNode {
    Int3 cell{};
    std::uint32_t bytes = 0;    ///< of its fragment; 0: it has none
    std::uint32_t eighths = 0;  ///< of it that have triangles, a bit each (eighths_of())
};

/// Which nodes Neuroglancer has to find in a manifest. Beside those with a fragment these are, with
/// none: each node above another one, so that the tree hangs together; and below a node with a
/// fragment those in which it has triangles, so that what is drawn in place of a part of it is all
/// of what the finer level has there, which may be nothing. In temporary files. Not thread-safe.
class DetailNodes {
  public:
    explicit DetailNodes(ScratchFolder folder) : folder_(std::move(folder)) {}

    /// Of the level behind the last one; they come by add(), in the order of the Z-curve.
    void begin_level() { levels_.push_back(std::make_unique<GrowingFile<DetailNode>>(folder_)); }
    /// A node with a fragment.
    void add(const DetailNode& node) { levels_.back()->append(node); }
    /// After all were added, once: adds those without a fragment.
    void finish();

    [[nodiscard]] std::size_t levels() const { return levels_.size(); }
    /// In the order of the Z-curve. REQUIRES: finish() was called.
    [[nodiscard]] std::span<const DetailNode> of(std::size_t level) const {
        return levels_[level]->all();
    }

  private:
    using List = std::unique_ptr<GrowingFile<DetailNode>>;
    List merged(std::span<const DetailNode> a, std::span<const DetailNode> b) const;
    List children_of(std::span<const DetailNode> nodes) const;
    List parents_of(std::span<const DetailNode> nodes) const;

    ScratchFolder folder_;
    std::vector<List> levels_;
};

}  // namespace isonest::detail
