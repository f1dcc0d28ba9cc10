// Answers of the viewer as they are sent: JSON, and errors in it (PROTOCOL.md).
#pragma once

#include <fmt/format.h>

#include <exception>
#include <new>
#include <nlohmann/json.hpp>
#include <string>

#include <isonest/error.h>

#include "tools/view/http_messages.h"

namespace isonest::detail::view {

HttpAnswer json_answer(const nlohmann::ordered_json& json, unsigned status = 200);
/// With the remedies as the command `isonest view` has options for them.
HttpAnswer error_answer(const Error& error);
HttpAnswer plain_error(unsigned status, const std::string& kind, const std::string& message);

/// Runs the work; whatever it throws of the library's errors and the standard's is an answer.
template <class Work>
HttpAnswer guarded(const Work& work) {
    try {
        return work();
    } catch (const Error& e) {
        return error_answer(e);
    } catch (const std::bad_alloc&) {
        return error_answer(Error(ErrorKind::limit, "out of memory", {{RemedyKind::less_memory}}));
    } catch (const std::exception& e) {
        return plain_error(500, "internal",
                           fmt::format("internal error, please report it: {}", e.what()));
    }
}

}  // namespace isonest::detail::view
