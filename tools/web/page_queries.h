// The interface for a page's worker: queries of one store, one request after the other.
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <variant>
#include <vector>

#include <isonest/store.h>

#include "tools/view/http_messages.h"
#include "tools/view/mesh_answers.h"
#include "tools/view/store_answers.h"
#include "tools/web/array_answers.h"
#include "tools/web/web_bytes.h"

namespace isonest::detail::web {

/// The answer; or none: then the bytes of WebBytes::needed() must be provided and the same request
/// repeated.
using Answered = std::optional<view::HttpAnswer>;

/// Not thread-safe.
class PageQueries {
  public:
    /// `name`: the URL, for messages; `bytes`: of the object; `memory`: the memory budget of the
    /// page, of which the queries get the shares that `isonest view --memory` would give them.
    PageQueries(std::shared_ptr<WebBytes> bytes, std::string name, std::uint64_t memory);

    /// Opens the store. Answers 200 without a body if that succeeds, otherwise an error.
    Answered open();
    [[nodiscard]] bool is_open() const { return opened_ != nullptr; }
    /// `target`: as in PROTOCOL.md, "/api/surface?iso=1", or as in ArrayAnswers, "/arrays/...".
    /// REQUIRES: open() has answered 200.
    Answered ask(const std::string& target);
    /// The arrays that belong to the last answer; empty if it was not to "/arrays/...".
    [[nodiscard]] const NumberArrays& arrays() const;
    /// The arrays are no longer used.
    void clear_arrays();
    /// Must be called before each open() and ask(), also when the same request is repeated.
    void begin_run(bool may_unwind, const WebTimes& times) { bytes_->begin_run(may_unwind, times); }
    [[nodiscard]] WebBytes& bytes() { return *bytes_; }

  private:
    struct Opened {
        Opened(const std::string& name, std::uint64_t memory);
        Store store;
        view::MemoryShares shares;
        view::StoreAnswers answers;
        view::MeshAnswers surfaces;
        view::MeshAnswers slices;
        ArrayAnswers arrays;
    };
    /// Throws Error{limit} if the memory is not sufficient.
    view::HttpAnswer answer_within_memory(const std::string& target);
    view::HttpAnswer answer(const std::string& target);
    [[nodiscard]] view::HttpAnswer status() const;

    std::shared_ptr<WebBytes> bytes_;
    std::string name_;
    std::uint64_t memory_;
    std::unique_ptr<Opened> opened_;
    std::uint64_t served_ = 0;
};

}  // namespace isonest::detail::web
