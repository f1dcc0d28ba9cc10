// Gives every vertex of a mesh whose parts several ranks have one number, the one that Weld gives
// it where all parts are in one process.
//
//     each rank     its own parts are welded
//     all           names that several ranks have are exchanged      query/ranks/shared_names.h
//     rank 0        the records of all parts: who begins where
//     all           numbers of vertices that other ranks' parts own
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "query/mesh/part_store.h"
#include "query/mesh/weld.h"
#include "query/ranks/shared_names.h"
#include "store/files/scratch_file.h"
#include "store/ranks/communicator.h"

namespace isonest::detail {

/// What grows with the mesh lies in temporary files: 48 bytes for each shared element of a rank's
/// own parts, 128 for each name that these have, 56 for each name of which the rank is the home,
/// and on rank 0 besides 100 bytes for each part of the mesh.
class RankWeld : public VertexNumbers {
  public:
    /// Sets in the records what Weld sets, in numbers of the whole mesh. REQUIRES: parts.seal() was
    /// called; no two parts of the mesh have the same order. Collective. Throws Error{io,
    /// cancelled}.
    RankWeld(Communicator& ranks, PartStore& parts, const ScratchFolder& folder);

    [[nodiscard]] std::uint64_t vertices() const override { return vertices_; }
    [[nodiscard]] std::uint64_t triangles() const override { return triangles_; }
    void numbers(const PartRecord& record, std::vector<std::uint64_t>& number,
                 std::vector<bool>& owned) const override;

  private:
    void begin_places();
    void unite_across_ranks();
    void count_owned();
    void find_firsts();
    void number_own();
    void number_others();
    [[nodiscard]] SharedPlace own_place(const PartRecord& r, std::uint64_t element,
                                        const MeshPart::Shared& shared) const;
    /// work(record, element, shared) for all shared elements of this rank.
    template <class Work>
    void each_shared(const Work& work) const;

    Communicator& ranks_;
    PartStore& parts_;
    ScratchFolder folder_;
    Weld own_;  ///< of this rank's parts
    ScratchFile best_file_;
    ScratchFile number_file_;
    std::span<SharedPlace> best_;      ///< of each representative, who owns it
    std::span<std::uint64_t> number_;  ///< of each representative with a vertex
    std::uint64_t vertices_ = 0;
    std::uint64_t triangles_ = 0;
};

}  // namespace isonest::detail
