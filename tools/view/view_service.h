// What the viewer's server answers (PROTOCOL.md): a store, seen.
#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <memory>
#include <optional>
#include <string>

#include <isonest/store.h>

#include "tools/view/access.h"
#include "tools/view/answers/store_answers.h"
#include "tools/view/mesh_answers.h"
#include "tools/view/request_target.h"
#include "tools/view/store_watch.h"
#include "tools/view/streams.h"
#include "tools/view/work_lane.h"

namespace isonest::detail::view {

class ViewService : public HttpHandler {
  public:
    /// Of a store elsewhere, the coarsest levels are asked for at once. `connections`: how many
    /// there are, for the status; called from the server's thread.
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
    // Their threads end first.
    WorkLane surface_lane_;
    WorkLane slice_lane_;
    WorkLane file_lane_;
    WorkLane small_lane_;
};

}  // namespace isonest::detail::view
