#include "tools/view/http_messages.h"

#include <filesystem>
#include <system_error>

namespace isonest::detail::view {

SentFile::~SentFile() {
    if (!folder_.empty()) {
        std::error_code ignored;
        std::filesystem::remove_all(folder_, ignored);
    }
}

}  // namespace isonest::detail::view
