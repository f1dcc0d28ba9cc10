// Tiles of surfaces with more triangles than a page can show: made in the background, kept in
// temporary files (PROTOCOL.md, /api/tiles).
#pragma once

#include <atomic>
#include <cstddef>
#include <cstdint>
#include <list>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <utility>

#include "store/files/scratch_file.h"
#include "tools/view/http_messages.h"
#include "tools/view/mesh_request.h"
#include "tools/view/viewed_steps.h"
#include "tools/view/work_lane.h"

namespace isonest::detail::view {

/// The files of a tileset in one temporary file without a name, so that nothing is left behind
/// however the program ends. About 150 bytes of heap per file. Thread-safe.
class PackedTileset {
  public:
    explicit PackedTileset(const ScratchFolder& folder) : file_(folder) {}
    /// Throws Error{io}. REQUIRES: no file with this path was written before.
    void write(const std::string& path, const std::string& bytes);
    /// None if there is no such file. Throws Error{io}.
    [[nodiscard]] std::optional<std::string> read(const std::string& path) const;
    [[nodiscard]] std::uint64_t bytes() const;

  private:
    ScratchFile file_;
    mutable std::mutex mutex_;
    std::uint64_t end_ = 0;
    std::map<std::string, std::pair<std::uint64_t, std::uint64_t>> places_;  ///< offset, bytes
};

/// Tilesets of a store or a series by step and isovalue. They are made one after the other, and
/// what was found for the last four requests is kept. Thread-safety: all methods from any thread.
class TileSets {
  public:
    /// `memory`: heap in bytes while tiles are made. `steps` must outlive this object, and this
    /// object the lanes that it is given.
    TileSets(ViewedSteps& steps, std::uint64_t memory, int threads)
        : steps_(steps), memory_(memory), threads_(threads) {}

    /// /api/tiles: starts the work in the lane if necessary, and answers at once. The stream's
    /// request for another tileset ends. Throws Error{invalid_argument}.
    HttpAnswer state(std::size_t step, RequestTarget& target, const std::string& stream,
                     WorkLane& lane);
    /// /api/tileset/ID/PATH; `path`: the whole path.
    [[nodiscard]] HttpAnswer file(const std::string& path) const;
    /// Ends the work for a stream, unless another stream wants the same tiles.
    void cancel(const std::string& stream);
    /// Ends the work that has not finished, so that the lane is free for something else; the next
    /// request for the same tiles starts it again.
    void make_way();

  private:
    class TileJob;
    struct Set;
    using SetPointer = std::shared_ptr<Set>;
    // All of these with mutex_ locked:
    SetPointer find(std::size_t step, double iso) const;
    void forget(const SetPointer& set);
    void leave(const std::string& stream);
    void drop_oldest();
    [[nodiscard]] HttpAnswer describe(const SetPointer& set, std::uint64_t limit);

    void make(Set& set, TileJob& job);
    void run(const SetPointer& set, TileJob& job);

    ViewedSteps& steps_;
    std::uint64_t memory_;
    int threads_;
    mutable std::mutex mutex_;
    std::list<SetPointer> sets_;                   ///< the most recently requested first
    std::map<std::string, SetPointer> wanted_by_;  ///< those in the making, by stream
};

}  // namespace isonest::detail::view
