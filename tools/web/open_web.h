// The store that a page's worker has open.
#pragma once

#include <memory>

#include "tools/web/web_bytes.h"

namespace isonest::detail::web {

/// What open_location() returns from now on, whatever location it is given.
void set_web_bytes(std::shared_ptr<WebBytes> bytes);

}  // namespace isonest::detail::web
