// The answers of the viewer's server (PROTOCOL.md) for one store or one series.
#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <string>

#include "tools/view/http_server.h"
#include "tools/view/mesh_answers.h"
#include "tools/view/mesh_request.h"
#include "tools/view/store_answers.h"
#include "tools/view/tile_sets.h"
#include "tools/view/viewed_steps.h"
#include "tools/view/work_lane.h"

namespace isonest::detail::view {

// Folders of files that wait to be sent, so that they can be removed when a signal ends the
// program.

/// Registers a folder for remove_listed_folders(), as long as it exists. At most 192 existing
/// folders are registered; more are ignored. Not thread-safe.
void list_folder(const std::filesystem::path& folder);

/// Removes the registered folders with their files. Async-signal-safe; for the end of the program.
void remove_listed_folders();

// A new request of a stream replaces the previous one.

/// Not thread-safe.
class Streams {
  public:
    /// Throws Error{invalid_argument} unless it is a valid name: 1 to 64 letters, digits, '-', '_'.
    static void require_name(const std::string& name);
    /// Cancels the stream's current job; `job` becomes the current one.
    void replace(const std::string& name, const std::shared_ptr<Job>& job);
    void cancel(const std::string& name);

  private:
    std::map<std::string, std::weak_ptr<Job>> jobs_;
};

class ViewService : public HttpHandler {
  public:
    /// `steps` must outlive this object. `connections`: returns their number, for the status;
    /// called on the server's thread.
    ViewService(ViewedSteps& steps, const MemoryShares& shares, int threads, Access access,
                std::function<std::size_t()> connections);
    std::shared_ptr<Waiting> handle(const HttpRequest& request, Reply reply) override;

  private:
    using Work = std::function<HttpAnswer(Progress&)>;
    using StepWork = std::function<HttpAnswer(const OpenStep&, Progress&)>;
    std::size_t take_step(RequestTarget& target) const;
    /// Work on a step, which is opened in the lane if necessary.
    Work on_step(std::size_t step, StepWork work);
    std::shared_ptr<Waiting> answer(const HttpRequest& request, RequestTarget target,
                                    const Reply& reply);
    std::shared_ptr<Waiting> start(WorkLane& lane, const std::string& stream, Work work,
                                   const Reply& reply);
    std::shared_ptr<Waiting> start_mesh(std::size_t step, RequestTarget& target,
                                        const std::string& stream, const Reply& reply);
    std::shared_ptr<Waiting> start_file(std::size_t step, RequestTarget& target,
                                        const std::string& stream, const Reply& reply);
    [[nodiscard]] HttpAnswer status() const;
    HttpAnswer command(std::size_t step, RequestTarget& target);

    ViewedSteps& steps_;
    MemoryShares shares_;
    Access access_;
    std::function<std::size_t()> connections_;
    Streams streams_;
    MeshAnswers surfaces_;
    MeshAnswers slices_;
    MeshAnswers files_;
    TileSets tiles_;
    std::atomic<std::uint64_t> served_ = 0;
    std::atomic<std::uint64_t> cancelled_ = 0;
    // Declared last, so that their threads end first.
    WorkLane surface_lane_;
    WorkLane slice_lane_;
    WorkLane file_lane_;
    WorkLane small_lane_;
};

}  // namespace isonest::detail::view
