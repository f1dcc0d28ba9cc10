#include "tools/web/page_queries.h"

#include <fmt/format.h>
#include <malloc.h>

#include <new>
#include <nlohmann/json.hpp>
#include <utility>

#include <isonest/error.h>
#include <isonest/progress.h>

#include "tools/view/mesh_message.h"
#include "tools/view/mesh_request.h"
#include "tools/view/store_answers.h"
#include "tools/web/web_bytes.h"

namespace isonest::detail::web {

using view::HttpAnswer;

PageQueries::PageQueries(std::shared_ptr<WebBytes> bytes, std::string name, std::uint64_t memory)
    : bytes_(std::move(bytes)), name_(std::move(name)), memory_(memory) {}

PageQueries::Opened::Opened(const std::string& name, std::uint64_t memory)
    : store(name),
      shares(view::MemoryShares::of_page(memory)),
      answers(store, shares, 1),
      surfaces({shares.surface, shares.surface_message / view::MeshMessage::kTriangleHeap, 1},
               view::range_of(store)),
      slices({shares.slice, shares.slice_message / view::MeshMessage::kTriangleHeap, 1},
             view::range_of(store)),
      arrays(store, shares, answers.are_labels()) {}

Answered PageQueries::open() {
    try {
        return view::guarded([&]() -> HttpAnswer {
            set_web_bytes(bytes_);
            opened_ = std::make_unique<Opened>(name_, memory_);
            return {200, "text/plain", std::string(), {}};
        });
    } catch (const BytesAreMissing&) {
        return std::nullopt;
    }
}

Answered PageQueries::ask(const std::string& target) {
    try {
        HttpAnswer made = view::guarded([&] { return answer_within_memory(target); });
        ++served_;
        return made;
    } catch (const BytesAreMissing&) {
        return std::nullopt;
    }
}

const NumberArrays& PageQueries::arrays() const {
    static const NumberArrays none;
    return opened_ ? opened_->arrays.arrays() : none;
}

void PageQueries::clear_arrays() {
    if (opened_) {
        opened_->arrays.clear();
    }
}

HttpAnswer PageQueries::answer_within_memory(const std::string& target) {
    try {
        return answer(target);
    } catch (const std::bad_alloc&) {
        throw Error(ErrorKind::limit,
                    "this takes more memory than a page can use: allow a larger error, or open the "
                    "store with `isonest view`");
    }
}

HttpAnswer PageQueries::answer(const std::string& target) {
    view::RequestTarget request(target);
    const std::string path = request.path();
    request.text("stream");
    Progress& progress = silent_progress();
    if (path.starts_with("/arrays/")) {
        return opened_->arrays.answer(request, progress);
    }
    if (path == "/api/surface" || path == "/api/slice") {
        const view::MeshRequest mesh = opened_->answers.take_mesh(request, path);
        return (mesh.is_slice() ? opened_->slices : opened_->surfaces)
            .message(opened_->store, mesh, progress);
    }
    if (path == "/api/value") {
        return opened_->answers.value(view::StoreAnswers::take_place(request));
    }
    if (path == "/api/store") {
        return opened_->answers.describe();
    }
    if (path == "/api/label") {
        return opened_->answers.label(request);
    }
    if (path == "/api/labels") {
        return opened_->answers.labels(view::StoreAnswers::take_labels(request), progress);
    }
    if (path == "/api/histogram") {
        return opened_->answers.histogram(opened_->answers.take_histogram(request), progress);
    }
    if (path == "/api/status") {
        return status();
    }
    if (path == "/api/export" || path == "/api/command") {
        return view::plain_error(
            501, "unsupported",
            fmt::format("{} needs a server: open the store with `isonest view`", path));
    }
    return view::plain_error(404, "not_found", fmt::format("there is nothing at {}", path));
}

HttpAnswer PageQueries::status() const {
    const struct mallinfo heap = ::mallinfo();
    const FetchedCounts counts = bytes_->fetched();
    return view::json_answer(
        {{"heap_bytes", static_cast<std::uint64_t>(static_cast<std::size_t>(heap.uordblks))},
         {"memory", memory_},
         {"surface", 0},
         {"slice", 0},
         {"file", 0},
         {"waiting", 0},
         {"served", served_},
         {"cancelled", 0},
         {"connections", 0},
         {"store", "ok"},
         {"remote",
          {{"remote_bytes", counts.remote_bytes},
           {"requests", counts.requests},
           {"round_trips", counts.round_trips},
           {"cache_bytes", counts.cache_bytes}}}});
}

}  // namespace isonest::detail::web
