// The answers of the viewer's server (PROTOCOL.md) for one store.
#pragma once

#include <sys/stat.h>

#include <cstdint>
#include <filesystem>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <string>

#include <isonest/store.h>

#include "tools/view/http_server.h"
#include "tools/view/mesh_answers.h"
#include "tools/view/mesh_request.h"
#include "tools/view/store_answers.h"
#include "tools/view/work_lane.h"

namespace isonest::detail::view {

// Folders of files that wait to be sent, so that they can be removed when a signal ends the
// program.

/// Registers a folder for remove_listed_folders(), as long as it exists. At most 192 existing
/// folders are registered; more are ignored. Not thread-safe.
void list_folder(const std::filesystem::path& folder);

/// Removes the registered folders with their files. Async-signal-safe; for the end of the program.
void remove_listed_folders();

// Whether the file of an open store is still the one that was opened. For a remote store the reader
// checks this: fetching from a changed object is an error.

enum class StoreState : std::uint8_t { same, replaced, cut_off };

/// Thread-safe.
class StoreWatch {
  public:
    /// Throws Error{not_found} if the file no longer exists.
    explicit StoreWatch(const Store& store);
    /// Always `same` for a remote store. `replaced` if the file of that name is another one, was
    /// written to, or no longer exists.
    [[nodiscard]] StoreState state() const;

  private:
    std::filesystem::path path_;  ///< empty: remote
    struct stat opened_ {};
};

/// "ok", "replaced" or "cut off".
const char* name_of(StoreState state);

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
    /// For a remote store, the coarsest levels are requested at once. `connections`: returns their
    /// number, for the status; called on the server's thread.
    ViewService(const Store& store, const MemoryShares& shares, int threads, Access access,
                std::function<std::size_t()> connections);
    std::shared_ptr<Waiting> handle(const HttpRequest& request, Reply reply) override;

  private:
    using Work = std::function<HttpAnswer(Progress&)>;
    std::shared_ptr<Waiting> answer(const HttpRequest& request, RequestTarget target,
                                    const Reply& reply);
    std::shared_ptr<Waiting> start(WorkLane& lane, const std::string& stream, Work work,
                                   const Reply& reply);
    std::shared_ptr<Waiting> start_mesh(RequestTarget& target, const std::string& stream,
                                        const Reply& reply);
    std::shared_ptr<Waiting> start_file(RequestTarget& target, const std::string& stream,
                                        const Reply& reply);
    std::shared_ptr<Waiting> start_value(RequestTarget& target, const std::string& stream,
                                         const Reply& reply);
    [[nodiscard]] HttpAnswer status() const;
    [[nodiscard]] HttpAnswer command(RequestTarget& target) const;

    const Store& store_;
    MemoryShares shares_;
    StoreAnswers answers_;
    Access access_;
    std::function<std::size_t()> connections_;
    StoreWatch watch_;
    Streams streams_;
    MeshAnswers surfaces_;
    MeshAnswers slices_;
    MeshAnswers files_;
    std::atomic<std::uint64_t> served_ = 0;
    std::atomic<std::uint64_t> cancelled_ = 0;
    // Declared last, so that their threads end first.
    WorkLane surface_lane_;
    WorkLane slice_lane_;
    WorkLane file_lane_;
    WorkLane small_lane_;
};

}  // namespace isonest::detail::view
