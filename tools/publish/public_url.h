// URLs that a published site may hold.
#pragma once

#include <string>

namespace isonest::detail::publish {

/// The URL by which a page reads a store, as it was given, an s3:// one in its https:// form.
/// Throws Error{invalid_argument} for what is no URL of a store, and for one with a password, a
/// signature, or a parameter of its query that looks like a secret: everybody can read what a site
/// holds. The message has no secret.
std::string public_url(const std::string& text);

}  // namespace isonest::detail::publish
