// A page is one process, which keeps nothing between its visits: there are no other ranks and no
// kept analyses in it. The library asks for them where somebody has named some, which no request of
// a page can.
#include <stdexcept>

#include "query/extract/analysis/extract_analysed.h"
#include "query/extract/analysis/kept_analysis.h"
#include "query/extract/extract_on_ranks.h"
#include "query/ranks/cube_shares.h"
#include "query/ranks/gathered_parts.h"
#include "query/ranks/mesh_on_ranks.h"
#include "query/ranks/rank_mapping.h"
#include "query/simplify/mapping/block_mapping.h"

namespace isonest::detail {
namespace {

[[noreturn]] void nobody_is_there() {
    throw std::logic_error("a page has no other ranks and no kept analyses");
}

}  // namespace

std::unique_ptr<BlockMapping> mapping_by(RankTeam* team, std::uint64_t /*memory*/) {
    if (team != nullptr) {
        nobody_is_there();
    }
    return std::make_unique<LocalMapping>();
}

bool is_shared(const ExtractQuery& /*asked*/) {
    return false;
}

bool is_written_by_all(MeshSink& /*sink*/) {
    return false;
}

void begin_shared_traversal(RankTeam& /*team*/, const StoreReader& /*store*/,
                            const ExtractQuery& /*asked*/, std::span<const double> /*isovalues*/) {
    nobody_is_there();
}

void begin_shared_mesh(RankTeam& /*team*/, std::size_t /*i*/) {
    nobody_is_there();
}

SettledParts settle_parts(Communicator& /*ranks*/, PartStore& /*parts*/,
                          const std::function<bool()>& /*may_stay*/) {
    nobody_is_there();
}

MeshOnRanks mesh_on_ranks(RankTeam& /*team*/, PartStore& /*parts*/,
                          std::optional<ApartRange> /*apart*/, MeshLayout /*layout*/,
                          MeshSink& /*sink*/, const ScratchFolder& /*folder*/,
                          Progress& /*progress*/) {
    nobody_is_there();
}

CubeShare share_of(Communicator& /*ranks*/, const ChunkSource& /*source*/,
                   const TraversalQuery& /*query*/, std::span<const double> /*isovalues*/) {
    nobody_is_there();
}

void Communicator::sum(std::span<std::uint64_t> /*numbers*/) {
    nobody_is_there();
}

void Communicator::largest(std::span<double> /*numbers*/) {
    nobody_is_there();
}

std::optional<ExtractReport> extract_analysed(const StoreReader& /*store*/,
                                              const ExtractQuery& /*query*/, MeshSink& /*sink*/,
                                              const ExtractOptions& /*options*/,
                                              Progress& /*progress*/) {
    nobody_is_there();
}

std::filesystem::path analysis_folder_of(const StoreReader& /*store*/) {
    nobody_is_there();
}

}  // namespace isonest::detail
