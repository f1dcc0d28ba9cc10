// Objects of servers, as the bytes of a store.
#pragma once

#include <memory>
#include <string_view>

#include "store/bytes/object_folder.h"
#include "store/bytes/store_bytes.h"
#include "store/remote/remote_options.h"

namespace isonest::detail {

/// Opens an object by one request (two, if the server does not know ranges that count from the
/// end): its last 64 KiB are then there. `url`: is_url(). Throws Error{invalid_argument, not_found,
/// io, unsupported}, and what options.check throws.
std::unique_ptr<StoreBytes> open_url(std::string_view url, const RemoteOptions& options);

/// What lies below a URL; asks for nothing yet. Throws Error{invalid_argument, unsupported}.
std::unique_ptr<ObjectFolder> open_url_folder(std::string_view url, const RemoteOptions& options);

}  // namespace isonest::detail
