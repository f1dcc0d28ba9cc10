#include "query/ranks/mesh_on_ranks.h"

#include <array>
#include <chrono>
#include <cstddef>
#include <span>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "query/formats/mesh_sections.h"
#include "query/mesh/emit_mesh.h"
#include "query/ranks/mapping_step.h"
#include "query/ranks/rank_apart.h"
#include "query/ranks/rank_weld.h"

namespace isonest::detail {
namespace {

using Clock = std::chrono::steady_clock;

double seconds_since(Clock::time_point start) {
    return std::chrono::duration<double>(Clock::now() - start).count();
}

/// Null if not all ranks can write it.
SectionedFile* file_behind(MeshSink& sink) {
    auto* const measuring = dynamic_cast<MeasuringSink*>(&sink);
    return measuring == nullptr ? nullptr : dynamic_cast<SectionedFile*>(&measuring->inner());
}

/// Of the mesh, for the other ranks; what SectionedFile::share() says follows it.
struct SharedLayout {
    std::uint64_t vertices = 0;
    std::uint64_t elements = 0;
    std::array<float, 3> lo{};
    std::array<float, 3> hi{};
    bool measures_angles = false;
};

/// Adds what all ranks have measured to what rank 0 has, once their rows are on the disk, and
/// completes what several of them have a part of. `loose_ends`: of another rank's rows. `file`: of
/// rank 0, else null.
void gather_sums(Communicator& ranks, MeasuringSink& measuring, const std::string& loose_ends,
                 SectionedFile* file) {
    bool is_sent = ranks.rank() == 0;
    ranks.exchange(
        [&](Communicator::Message& message) {
            if (is_sent) {
                return false;
            }
            is_sent = true;
            const std::string own = measuring.sums();
            const std::string sums = text_of_value(own.size()) + own + loose_ends;
            const auto bytes = std::as_bytes(std::span(sums));
            message = {0, {bytes.begin(), bytes.end()}};
            return true;
        },
        ranks.rank() == 0 ? static_cast<std::uint64_t>(ranks.size()) - 1 : 0,
        [&](int /*from*/, std::span<const std::byte> bytes) {
            const std::string_view text(reinterpret_cast<const char*>(bytes.data()), bytes.size());
            const auto size = value_of_text<std::size_t>(text);
            measuring.include(text.substr(sizeof(size), size));
            file->include(text.substr(sizeof(size) + size));
        });
}

/// What all ranks do before the file.
class WeldedOnRanks {
  public:
    WeldedOnRanks(RankTeam& team, PartStore& parts, const std::optional<ApartRange>& range,
                  const ScratchFolder& folder, Progress& progress)
        : start_(Clock::now()), weld_(team.ranks, parts, folder) {
        if (range) {
            apart_ = keep_apart_on_ranks(team.ranks, parts, weld_, *range, folder, progress);
        }
        ++team.work.meshes;
        team.work.welding_seconds += seconds_since(start_);
    }
    [[nodiscard]] const RankWeld& weld() const { return weld_; }
    [[nodiscard]] const ApartVertices& apart() const { return apart_; }

  private:
    Clock::time_point start_;
    RankWeld weld_;
    ApartVertices apart_;
};

void emit_own(RankTeam& team, const PartStore& parts, const RankWeld& weld, MeshSink& sink,
              Progress& progress) {
    emit_parts(parts, weld, sink, progress);
    for (const PartRecord& r : parts.records()) {
        team.work.written_triangles += r.triangles;
    }
}

}  // namespace

bool is_written_by_all(MeshSink& sink) {
    return file_behind(sink) != nullptr;
}

MeshOnRanks mesh_on_ranks(RankTeam& team, PartStore& parts, std::optional<ApartRange> apart,
                          MeshLayout layout, MeshSink& sink, const ScratchFolder& folder,
                          Progress& progress) {
    if (apart) {
        apart->lo = parts.lo();
        apart->hi = parts.hi();
    }
    team.ranks.broadcast(text_of_value(apart.has_value()));
    const WeldedOnRanks welded(team, parts, apart, folder, progress);
    const auto start = Clock::now();
    auto& measuring = dynamic_cast<MeasuringSink&>(sink);
    layout.vertices = welded.weld().vertices();
    layout.elements = welded.weld().triangles();
    layout.lo = parts.lo();
    layout.hi = parts.hi();
    sink.begin(layout);
    const SharedLayout shared{layout.vertices, layout.elements, layout.lo, layout.hi,
                              measuring.measures_angles()};
    team.ranks.broadcast(text_of_value(shared) + file_behind(sink)->share());
    emit_own(team, parts, welded.weld(), sink, progress);
    gather_sums(team.ranks, measuring, {}, file_behind(sink));
    sink.end();
    team.work.writing_seconds += seconds_since(start);
    return {layout.vertices, layout.elements, welded.apart()};
}

void help_with_mesh(RankTeam& team, PartStore& parts, const ScratchFolder& folder,
                    Progress& progress) {
    std::optional<ApartRange> apart;
    if (value_of_text<bool>(team.ranks.broadcast({}))) {
        apart.emplace();
    }
    const WeldedOnRanks welded(team, parts, apart, folder, progress);
    const std::string text = team.ranks.broadcast({});
    const auto start = Clock::now();
    const auto shared = value_of_text<SharedLayout>(text);
    MeshLayout layout;
    layout.vertices = shared.vertices;
    layout.elements = shared.elements;
    layout.lo = shared.lo;
    layout.hi = shared.hi;
    RowWriter rows(std::string_view(text).substr(sizeof(shared)));
    MeasuringSink measuring(rows, shared.measures_angles);
    measuring.begin(layout);
    emit_own(team, parts, welded.weld(), measuring, progress);
    measuring.end();
    // What is left is rank 0's; once it has this rank's sums, it publishes the mesh.
    team.ranks.ignore_stop(true);
    gather_sums(team.ranks, measuring, rows.loose_ends(), nullptr);
    team.work.writing_seconds += seconds_since(start);
}

}  // namespace isonest::detail
