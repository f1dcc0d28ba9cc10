#include "tools/view/answers/answers.h"

#include "tools/cli/terminal/remedies.h"

namespace isonest::detail::view {
namespace {

using Json = nlohmann::ordered_json;

/// The options that the command has.
bool has_option(const std::string& option) {
    return option == "--memory" || option == "--threads";
}

unsigned status_of(ErrorKind kind) {
    switch (kind) {
        case ErrorKind::invalid_argument:
        case ErrorKind::not_found:
        case ErrorKind::unsupported:
            return 400;
        case ErrorKind::limit:
            return 413;
        case ErrorKind::cancelled:
            return 409;
        case ErrorKind::corrupt:
        case ErrorKind::io:
            return 500;
    }
    return 500;
}

}  // namespace

HttpAnswer json_answer(const Json& json, unsigned status) {
    return {status,
            "application/json",
            json.dump(-1, ' ', false, Json::error_handler_t::replace) + "\n",
            {}};
}

HttpAnswer error_answer(const Error& error) {
    return json_answer({{"error", cli::json_of(error, has_option)}}, status_of(error.kind()));
}

HttpAnswer plain_error(unsigned status, const std::string& kind, const std::string& message) {
    return json_answer(
        {{"error", {{"kind", kind}, {"message", message}, {"remedies", Json::array()}}}}, status);
}

}  // namespace isonest::detail::view
