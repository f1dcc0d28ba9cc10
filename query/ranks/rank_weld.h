// Assigns one number to every vertex of a mesh whose parts are on several ranks: the number from
// Weld if all parts were in one process.
//
//     each rank     its own parts are welded
//     all           names that several ranks have are exchanged      query/ranks/row_mail.h
//     rank 0        the records of all parts: where each begins
//     all           numbers of vertices owned by parts of other ranks
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "query/mesh/part_store.h"
#include "query/mesh/weld.h"
#include "query/ranks/row_mail.h"
#include "store/files/scratch_file.h"
#include "store/ranks/communicator.h"

namespace isonest::detail {

/// Data that grows with the mesh is kept in temporary files: 48 bytes for each shared element of a
/// rank's own parts, 128 for each of their names, 56 for each name of which the rank is the home,
/// and on rank 0 also 100 bytes for each part of the mesh.
class RankWeld : public VertexNumbers {
  public:
    /// Sets the same fields in the records as Weld, with numbers in the whole mesh. REQUIRES:
    /// parts.seal() was called; no two parts of the mesh have the same order. Collective. Throws
    /// Error{io, cancelled}.
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
    /// Calls work(record, element, shared) for all shared elements of this rank.
    template <class Work>
    void each_shared(const Work& work) const;

    Communicator& ranks_;
    PartStore& parts_;
    ScratchFolder folder_;
    Weld own_;  ///< of this rank's parts
    ScratchFile best_file_;
    ScratchFile number_file_;
    std::span<SharedPlace> best_;      ///< owner of each representative
    std::span<std::uint64_t> number_;  ///< number of each representative with a vertex
    std::uint64_t vertices_ = 0;
    std::uint64_t triangles_ = 0;
};

}  // namespace isonest::detail
